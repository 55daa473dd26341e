"""Files at URLs, with the file system in memory of fsspec in place of a store."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import fsspec
import pytest

from metric_base import folders, remote
from metric_base.errors import InputError
from metric_base.remote import StoreError, fetched, file_identity, file_size, opened, remote_files, staged

FOLDER = Path("memory://bucket/raw")


@pytest.fixture(autouse=True)
def store(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[fsspec.AbstractFileSystem]:
    """A store with two files; the cache is in `tmp_path`."""
    monkeypatch.setattr(remote, "LIBRARIES", {"memory": "fsspec"})
    monkeypatch.setenv(folders.CACHE_VARIABLE, str(tmp_path / "cache"))
    system = fsspec.filesystem("memory")
    system.pipe({"/bucket/raw/a.jsonl": b"abc", "/bucket/raw/pictures/b.png": b"de"})
    yield system
    system.store.clear()
    remote._remove_fetched()


def test_files_of_a_store_are_listed_and_read() -> None:
    assert [remote.url_of(path) for path in remote_files(FOLDER)] == [
        "memory://bucket/raw/a.jsonl",
        "memory://bucket/raw/pictures/b.png",
    ]
    with opened(FOLDER / "a.jsonl") as file:
        assert file.read() == b"abc"
    assert file_size(FOLDER / "a.jsonl") == 3
    with pytest.raises(InputError, match="memory://bucket/none: expected an existing file or folder; found none"):
        remote_files(Path("memory://bucket/none"))


def test_the_identity_of_a_folder_changes_with_its_files(store: fsspec.AbstractFileSystem) -> None:
    before = file_identity(FOLDER)
    assert before.count("\n") == 2
    store.pipe("/bucket/raw/c.jsonl", b"")
    assert file_identity(FOLDER) != before


def test_a_command_writes_locally_and_uploads_at_its_end(store: fsspec.AbstractFileSystem, tmp_path: Path) -> None:
    out = Path("memory://bucket/out/release")

    def run() -> int:
        local = staged(out, "--out", may_exist=False)
        assert local.is_relative_to(tmp_path / "cache")
        local.mkdir()
        (local / "manifest.json").write_text("{}")
        (local / ".hidden").write_text("")
        (local.parent / "release.log").write_text("done")
        missing = staged(Path("memory://bucket/none"), "--out", may_exist=False)
        assert not missing.exists()
        return 3

    assert remote.with_remote_files(run) == 3
    assert set(store.find("/bucket/out")) == {
        "/bucket/out/release/manifest.json",
        "/bucket/out/release.log",
    }
    assert not list((tmp_path / "cache" / "outputs").glob("*/release"))
    with pytest.raises(InputError, match="--out: memory://bucket/out/release already exists"):
        staged(out, "--out", may_exist=False)
    assert staged(out, "--out", may_exist=True).name == "release"
    assert staged(Path("file:///a%20b"), "--out", may_exist=False) == Path("/a b")


def test_an_error_of_the_store_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(*_: object, **__: object) -> None:
        raise RuntimeError("no\nconnection" + "x" * 300)

    monkeypatch.setattr("fsspec.core.url_to_fs", failing)
    with pytest.raises(StoreError, match="expected a store that can be used; found RuntimeError: no") as caught:
        remote_files(FOLDER)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 250
    with pytest.raises(InputError, match="expected a URL without credentials"):
        remote_files(Path("memory://user:word@bucket/raw"))


@pytest.mark.parametrize(
    ("path", "found"),
    [("memory://a/b", True), ("memory:/a", True), ("memory", False), ("s3://a/b", False), ("a/memory:/b", False)],
)
def test_a_remote_path_begins_with_a_scheme(path: str, found: bool) -> None:
    assert remote.is_remote(Path(path)) is found


def test_a_part_of_a_folder_is_fetched_once(store: fsspec.AbstractFileSystem, tmp_path: Path) -> None:
    folder = fetched(Path("memory://bucket/raw"), "/pictures")
    assert fetched(Path("memory://bucket/raw"), "/pictures") == folder
    assert fetched(tmp_path) == tmp_path

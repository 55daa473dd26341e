"""Input files: regular files and pipes of bounded size are read; others are refused at once, in one line."""

from __future__ import annotations

import os
import socket
import threading
import time
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import pytest

from metric_base import input_files
from metric_base.errors import InputError
from metric_base.input_files import folder_entries, read_bytes, read_json


def test_a_pipe_is_read_while_it_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(input_files, "PIPE_SECONDS", 300.0)  # until the thread opens it
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)

    def write() -> None:
        with pipe.open("wb") as file:
            for _ in range(3):
                file.write(b"x" * 100_000)
                file.flush()
                time.sleep(0.03)

    writer = threading.Thread(target=write, daemon=True)
    writer.start()
    assert len(read_bytes(pipe)) == 300_000
    writer.join(timeout=10)


def test_a_pipe_without_a_writer_and_one_without_an_end_are_errors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(input_files, "PIPE_SECONDS", 0.1)
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(InputError, match="zero bytes"):
        read_bytes(pipe)
    endless = os.open(pipe, os.O_RDWR)
    os.set_blocking(endless, False)
    stop = threading.Event()

    def write() -> None:
        while not stop.is_set():
            try:
                os.write(endless, b"x" * 4096)
            except BlockingIOError:
                time.sleep(0.001)

    writer = threading.Thread(target=write, daemon=True)
    writer.start()
    try:
        with pytest.raises(InputError, match="at most 100,000 bytes, found more"):
            read_bytes(pipe, limit=100_000)
    finally:
        stop.set()
        writer.join(timeout=10)
        os.close(endless)


@pytest.mark.parametrize("path", ["/dev/zero", "/dev/random", "/dev/null"])
def test_devices_are_not_read(path: str) -> None:
    with pytest.raises(InputError, match="expected a regular file or a pipe, found a device"):
        read_bytes(Path(path))


def test_other_objects_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a folder"):
        read_bytes(tmp_path)
    with pytest.raises(InputError, match="a name of a file"):
        read_bytes(Path("a\0b"))
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(InputError, match="symbolic links"):
        read_bytes(tmp_path / "loop")
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(tmp_path / "s"))
        with pytest.raises(InputError, match="a readable file"):
            read_bytes(tmp_path / "s")
    with (tmp_path / "huge").open("wb") as file:
        file.truncate(1 << 40)  # a sparse file, without bytes on the disk
    with pytest.raises(InputError, match="at most"):
        read_json(tmp_path / "huge")


def test_folders_have_a_bound(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in "cab":
        (tmp_path / name).touch()
    assert [path.name for path in folder_entries(tmp_path)] == ["a", "b", "c"]
    monkeypatch.setattr(input_files, "MAX_ENTRIES", 2)
    with pytest.raises(InputError, match="at most 2 entries"):
        folder_entries(tmp_path)


@pytest.mark.parametrize(("n", "is_listed"), [(100_000, True), (100_001, False)])
def test_a_folder_has_at_most_100000_entries(
    n: int, is_listed: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    entries = [SimpleNamespace(name=f"{k:06d}") for k in range(n)]
    monkeypatch.setattr(input_files.os, "scandir", lambda _: nullcontext(entries))
    with nullcontext() if is_listed else pytest.raises(InputError, match="at most 100,000 entries"):
        assert len(folder_entries(tmp_path)) == n


def test_the_first_bytes_of_a_pipe_and_of_a_file(tmp_path: Path) -> None:
    reader, writer = os.pipe()
    os.write(writer, b"abcdef")
    os.close(writer)
    assert read_bytes(Path(f"/dev/fd/{reader}"), most=3) == b"abc"
    os.close(reader)
    (tmp_path / "a").write_bytes(b"abcdef")
    assert read_bytes(tmp_path / "a", most=3, limit=5) == b"abc"
    assert read_bytes(tmp_path / "a", limit=6) == b"abcdef"
    with pytest.raises(InputError, match="at most 5 bytes, found 6"):
        read_bytes(tmp_path / "a", limit=5)


def test_a_folder_that_is_missing_or_a_file(tmp_path: Path) -> None:
    (tmp_path / "a").touch()
    for name in ("a", "missing"):
        with pytest.raises(InputError, match=f"{name}: folder: expected a readable folder, found N"):
            folder_entries(tmp_path / name)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 100_000, "JSON: expected a document of ordinary depth, found endless nesting"),
        ("9" * 5000, "JSON: expected a valid document, found "),
        ('"\\ud800"', "JSON: expected whole characters, found half of a surrogate pair"),
        ("{", "JSON: expected "),
        ("", "file: expected some content, found zero bytes"),
    ],
)
def test_a_text_that_is_no_json_document(text: str, message: str, tmp_path: Path) -> None:
    (path := tmp_path / "a.json").write_text(text)
    with pytest.raises(InputError, match=message):
        read_json(path)
    path.write_text('["\\ud83d\\ude00"]')
    assert read_json(path) == ["\N{GRINNING FACE}"]

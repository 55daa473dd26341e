"""Files and folders that appear whole or not at all, and names that stay inside a folder."""

from __future__ import annotations

import os
import stat
import threading
import unicodedata
from contextlib import nullcontext
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from metric_base import files
from metric_base.errors import InputError
from metric_base.files import (
    OutputNames,
    check_folder,
    check_output,
    has_schema,
    inside,
    set_rules,
    sole_writer,
    whole_file,
    whole_folder,
)
from metric_cli import subcommands
from metric_cli.estimate_scale import estimate


def half_written(path: Path) -> None:
    with whole_file(path) as work:
        work.write_text("half")
        raise RuntimeError


def test_a_file_appears_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "items.jsonl"
    with whole_file(path) as work:
        work.write_text("a")
        assert not path.exists()
        assert not list(tmp_path.glob("*.jsonl")), "an incomplete file is not read as one of its kind"
    assert [(one.name, one.read_text()) for one in tmp_path.iterdir()] == [("items.jsonl", "a")]


def test_an_error_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "items.jsonl"
    path.write_text("before")
    with pytest.raises(RuntimeError):
        half_written(path)
    assert [(one.name, one.read_text()) for one in tmp_path.iterdir()] == [("items.jsonl", "before")]


def test_a_link_stays_and_its_file_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("before")
    (tmp_path / "link").symlink_to("file")
    with whole_file(tmp_path / "link") as work:
        work.write_text("after")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "file").read_text() == "after"
    assert sorted(one.name for one in tmp_path.iterdir()) == ["file", "link"]


@pytest.mark.parametrize(
    "command", ["estimate-scale --output", "estimate-scale --figure", "metric-tree priors --parquet"]
)
def test_an_output_at_a_loop_of_links_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    (tmp_path / "loop").symlink_to("loop")
    program, *words = [*command.split(), str(tmp_path / "loop")]
    scene = ["data/scenes/demo_room"] if program == "estimate-scale" else []
    assert {"estimate-scale": estimate, "metric-tree": subcommands}[program].main([*scene, *words]) == 2
    assert "found a loop of symbolic links" in capsys.readouterr().err


def test_a_pipe_is_written_in_place(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    received: list[str] = []
    reader = threading.Thread(target=lambda: received.append(pipe.read_text()), daemon=True)
    reader.start()
    with whole_file(pipe) as work:
        work.write_text("said")
    reader.join(timeout=10)
    assert received == ["said"]
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_a_device_is_not_replaced() -> None:
    with whole_file(Path("/dev/null"), "--output") as work:
        work.write_text("said")
    assert stat.S_ISCHR(Path("/dev/null").stat().st_mode)


def test_a_place_that_cannot_be_written_is_an_error_of_the_option(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    error = "--output: expected a place that can be written"
    with pytest.raises(InputError, match=error), whole_file(tmp_path / "file" / "out", "--output") as work:
        work.write_text("said")
    with pytest.raises(InputError, match=error), whole_folder(tmp_path / "file" / "out", "--output"):
        pass


def test_a_folder_appears_whole_or_not_at_all(tmp_path: Path) -> None:
    with whole_folder(tmp_path / "out") as work:
        (work / "a").write_text("x")
        assert not (tmp_path / "out").exists()
    assert [one.name for one in (tmp_path / "out").iterdir()] == ["a"]
    with pytest.raises(InputError, match="not there yet"), whole_folder(tmp_path / "out"):
        pass
    with pytest.raises(RuntimeError), whole_folder(tmp_path / "other"):
        raise RuntimeError
    assert [one.name for one in tmp_path.iterdir()] == ["out"]


def test_a_folder_of_frames_is_replaced_with_overwrite_and_nothing_else_is(tmp_path: Path) -> None:
    frames = tmp_path / "frames-out"
    (frames / "left").mkdir(parents=True)
    (frames / "left" / "old.png").write_text("old")
    set_rules([], overwrite=False)
    with pytest.raises(InputError, match=r"--out: .*already exists; .*--overwrite"):
        check_folder(frames, "--out", ".png")
    set_rules([], overwrite=True)
    with pytest.raises(InputError, match="not there yet"):
        check_folder(frames, "--layers")
    with pytest.raises(RuntimeError), whole_folder(frames, "--out", ".png"):
        raise RuntimeError
    assert (frames / "left" / "old.png").read_text() == "old"
    with whole_folder(frames, "--out", ".png") as work:
        (work / "new.png").write_text("new")
    assert [one.name for one in frames.iterdir()] == ["new.png"]
    assert [one.name for one in tmp_path.iterdir()] == ["frames-out"]
    (frames / "notes.txt").write_text("mine")
    with pytest.raises(
        InputError, match=r"--out: expected a folder with only .png files to replace; found .*notes.txt"
    ):
        check_folder(frames, "--out", ".png")
    (tmp_path / "scene" / "frames").mkdir(parents=True)
    for inputs in ([tmp_path / "scene"], [tmp_path / "scene" / "frames" / "a.png"]):
        set_rules(inputs, overwrite=True)
        with pytest.raises(InputError, match="is read in this run"):
            check_folder(tmp_path / "scene" / "frames", "--out", ".png")
    set_rules([], overwrite=False)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("a/b.png", "a/b.png"),
        ("../../a/b.png", "a/b.png"),
        ("/etc/passwd", "etc/passwd"),
        (r"C:\Users\x.png", "Users/x.png"),
        (r"..\..\x.png", "x.png"),
        ("nul.txt", "_nul.txt"),
        ("a/COM1", "a/_COM1"),
        ("a. /b ", "a/b"),
        ("..", "_"),
        ("", "_"),
        ("a\x1b[2J\n.png", "a_[2J_.png"),
        ("what?<is>|this*.png", "what__is__this_.png"),
    ],
)
def test_names_stay_inside(name: str, expected: str) -> None:
    assert inside(Path("out"), name) == Path("out", expected)


@given(st.lists(st.text(max_size=300) | st.sampled_from(["a", "A", "a/b", "b/../a", "é", "e\u0301"]), max_size=8))
def test_no_two_names_are_one_file(names: list[str]) -> None:
    folder = Path("/out")
    outputs = OutputNames(folder)
    paths = [outputs.path(name) for name in names]
    assert all(path.is_relative_to(folder) and path != folder and ".." not in path.parts for path in paths)
    assert all(len(part.encode()) < 250 for path in paths for part in path.parts)
    folded = [unicodedata.normalize("NFC", str(path)).casefold() for path in paths]
    assert len(set(folded)) == len(folded)
    assert not any(other.startswith(f"{path}/") for path in folded for other in folded)


def test_a_lock_file_that_its_last_holder_removes_is_not_locked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last holder removes the file after this run has opened it, and before this run locks it."""
    out, note, lock = tmp_path / "out.jsonl", tmp_path / ".out.jsonl.lock", files.lock
    calls: list[int] = []

    def late_lock(descriptor: int) -> None:
        calls.append(descriptor)
        if len(calls) == 1:
            note.unlink()
        lock(descriptor)

    monkeypatch.setattr(files, "lock", late_lock)
    with sole_writer(out):
        with pytest.raises(InputError, match="another run is writing this output"), sole_writer(out):
            pass
        assert note.exists()
    assert len(calls) == 3
    assert not note.exists()


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("a" * 200, "a" * 200),
        ("a" * 201, "a" * 200),
        ("ä" * 101, "ä" * 100),
        (f"{'a' * 300}.jpeg", f"{'a' * 195}.jpeg"),
        (f"{'a' * 300}.12345678", f"{'a' * 191}.12345678"),
        (f"{'a' * 300}.123456789", "a" * 200),
        (f".{'a' * 300}", f".{'a' * 199}"),
    ],
)
def test_a_long_name_is_cut_before_its_ending(name: str, expected: str) -> None:
    assert inside(Path(), name) == Path(expected)


def test_a_schema_is_read_from_the_beginning_of_a_file(tmp_path: Path) -> None:
    files_of = {"a.json": b'{"schema": "metric-tree/a/1"}', "b.json.gz": b"\x1f\x8b", "c.parquet": b"PAR1", "d": b""}
    for name, content in files_of.items():
        (tmp_path / name).write_bytes(content)
    found = {name: has_schema(tmp_path / name, "metric-tree/a/") for name in (*files_of, "missing")}
    assert found == {"a.json": True, "b.json.gz": False, "c.parquet": False, "d": False, "missing": False}
    assert not has_schema(tmp_path / "a.json", "metric-tree/b/")
    for padding, is_found in ((512 - 29, True), (512 - 25, False)):
        (tmp_path / "a.json").write_bytes(b" " * padding + files_of["a.json"])
        assert has_schema(tmp_path / "a.json", "metric-tree/a/") is is_found


def test_an_input_that_is_missing_is_not_compared_with_the_output(tmp_path: Path) -> None:
    (out := tmp_path / "out").write_text("x")
    set_rules([tmp_path / "missing"], overwrite=True)
    check_output(out, "--out")
    set_rules([out], overwrite=True)
    with pytest.raises(InputError, match="is read in this run"):
        check_output(out, "--out")
    set_rules([], overwrite=False)


def test_a_folder_that_cannot_be_replaced_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (out := tmp_path / "out").mkdir()
    (out / "old.png").touch()
    rename = Path.rename

    def failing(path: Path, target: Path) -> Path:
        if target == out and path.parent == tmp_path:
            raise OSError("no space")
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", failing)
    set_rules([], overwrite=True)
    with pytest.raises(OSError, match="no space"), whole_folder(out, suffix=".png"):
        pass
    set_rules([], overwrite=False)
    assert [path.relative_to(tmp_path).as_posix() for path in sorted(tmp_path.rglob("*"))] == ["out", "out/old.png"]


@pytest.mark.parametrize(
    ("source", "out", "is_read"),
    [
        ("model", "model/points.ply", True),
        ("model", "model/notes.md", False),
        ("model", "model/images/a.xyz", True),
        ("flat", "flat/a.xyz", True),
        ("model", "other/points.ply", False),
        ("model/cameras.bin", "model/points.ply", True),
        ("model/points.ply", "model/notes.md", False),
        ("model/a.gltf", "model/a.xyz", True),
        ("model/a.gltf", "model/b.xyz", False),
    ],
)
def test_what_a_reader_may_open_is_not_replaced(tmp_path: Path, source: str, out: str, is_read: bool) -> None:
    for name in ("model/points.ply", "model/notes.md", "model/images/a.xyz", "flat/a.xyz", "other/points.ply"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("x")
    for name in ("model/cameras.bin", "model/a.xyz", "model/b.xyz"):
        (tmp_path / name).write_text("x")
    (tmp_path / "model/a.gltf").write_text('{"buffers": [{"uri": "a.xyz"}, {"uri": "data:b.xyz"}, {"uri": 3}]}')
    set_rules([tmp_path / source], overwrite=True)
    with pytest.raises(InputError, match="is read in this run") if is_read else nullcontext():
        check_output(tmp_path / out, "--out")
    set_rules([], overwrite=False)


def test_a_command_continues_its_own_file_and_replaces_no_other(tmp_path: Path) -> None:
    out = tmp_path / "a.json"
    out.write_text('{"schema": "metric-tree/a/1"}')
    check_output(out, "--out", "metric-tree/a/")
    with pytest.raises(InputError, match="already exists"):
        check_output(out, "--out", "metric-tree/b/")

"""The work folder: stages are made once, again when an input changed, and never half."""

from __future__ import annotations

import errno
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from capture.work_folder import WorkFolder, content_digest
from metric_base.errors import InputError

#: Two stages, the second from the first; `KILL` names the moment at which the process kills itself.
SCRIPT = """
import os, signal, sys
from pathlib import Path
from capture.work_folder import WorkFolder

moment, text = sys.argv[2], sys.argv[3]
seen = {"publish": 0}

def die(now):
    if now == moment:
        os.kill(os.getpid(), signal.SIGKILL)

original = WorkFolder.publish
def counted(work, made, place):
    die(f"before output {seen['publish']}")
    original(work, made, place)
    seen["publish"] += 1
    die(f"after output {seen['publish'] - 1}")
WorkFolder.publish = counted

def first(part):
    print("first is made")
    (part / "folder").mkdir()
    die("within first")
    (part / "folder" / "a.txt").write_text(text)
    (part / "b.txt").write_text(text * 2)

def second(part):
    print("second is made")
    (part / "c.txt").write_text((work.path / "folder" / "a.txt").read_text() + "!")
    die("within second")

work = WorkFolder(Path(sys.argv[1]))
with work.lock():
    digest = work.stage("first", {"text": text}, ["folder", "b.txt"], first)
    work.stage("second", {"first": digest}, ["c.txt"], second)
"""
MOMENTS = ["within first", "before output 0", "after output 0", "after output 1", "within second", "after output 2"]


def _run(folder: Path, moment: str, text: str) -> tuple[int, list[str]]:
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(folder), moment, text],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    return done.returncode, done.stdout.splitlines()


def _content(folder: Path) -> dict[str, str]:
    files = [folder / "folder" / "a.txt", folder / "b.txt", folder / "c.txt"]
    return {file.name: file.read_text() for file in files if file.exists()}


@pytest.mark.parametrize("moment", MOMENTS)
def test_a_kill_at_any_moment_leaves_whole_outputs_or_none(tmp_path: Path, moment: str) -> None:
    _run(tmp_path / "w", "never", "old")
    status, _ = _run(tmp_path / "w", moment, "new")
    assert status == -signal.SIGKILL
    between = _content(tmp_path / "w")
    assert set(between.values()) <= {"old", "oldold", "old!", "new", "newnew", "new!"}
    assert _run(tmp_path / "w", "never", "new")[0] == 0
    assert _content(tmp_path / "w") == {"a.txt": "new", "b.txt": "newnew", "c.txt": "new!"}
    assert sorted(entry.name for entry in (tmp_path / "w").iterdir()) == [".lock", "b.txt", "c.txt", "folder", "stamps"]
    assert sorted(entry.name for entry in (tmp_path / "w" / "stamps").iterdir()) == ["first.json", "second.json"]


def test_a_stage_is_made_once_and_again_when_its_input_or_output_changed(tmp_path: Path) -> None:
    both = ["first is made", "second is made"]
    assert _run(tmp_path, "never", "x") == (0, both)
    assert _run(tmp_path, "never", "x") == (0, [])
    assert _run(tmp_path, "never", "y") == (0, both)
    (tmp_path / "c.txt").unlink()
    assert _run(tmp_path, "never", "y") == (0, ["second is made"])
    (tmp_path / "b.txt").unlink()
    assert _run(tmp_path, "never", "y") == (0, ["first is made"])  # made the same again, so that what follows stands
    (tmp_path / "stamps" / "first.json").write_text("{")  # nothing states any more whose the outputs are
    assert _run(tmp_path, "never", "y") == (1, [])


def test_a_stage_replaces_nothing_that_it_did_not_write(tmp_path: Path) -> None:
    (tmp_path / "b.txt").write_text("a user's")
    assert _run(tmp_path, "never", "x") == (1, [])
    assert (tmp_path / "b.txt").read_text() == "a user's"
    (tmp_path / "b.txt").unlink()
    assert _run(tmp_path, "never", "x")[0] == 0
    (tmp_path / "folder" / "note.txt").write_text("a user's")  # among ours
    assert _run(tmp_path, "never", "y") == (1, [])
    assert (tmp_path / "folder" / "note.txt").read_text() == "a user's"


def test_one_run_at_a_time(tmp_path: Path) -> None:
    one, two = WorkFolder(tmp_path / "w"), WorkFolder(tmp_path / "w")
    with one.lock(), pytest.raises(InputError, match="in use by another run"), two.lock():
        pass
    with two.lock():
        pass


def test_a_file_in_the_way_is_named(tmp_path: Path) -> None:
    (tmp_path / "w").write_text("")
    with pytest.raises(InputError, match="--work"), WorkFolder(tmp_path / "w").lock():
        pass


def test_a_digest_is_of_names_and_bytes(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "x").write_bytes(b"1")
    before = content_digest(tmp_path / "a")
    (tmp_path / "a" / "x").rename(tmp_path / "a" / "y")
    assert content_digest(tmp_path / "a") != before
    (tmp_path / "a" / "y").rename(tmp_path / "a" / "x")
    assert content_digest(tmp_path / "a") == before
    (tmp_path / "a" / "x").write_bytes(b"2")
    assert content_digest(tmp_path / "a") != before


def test_what_was_made_of_other_inputs_is_discarded(tmp_path: Path) -> None:
    work = WorkFolder(tmp_path / "w")
    with work.lock():
        work.stage("dense", {"model": "one"}, ["d.txt"], lambda part: (part / "d.txt").touch())
        work.discard_stale("dense", {"model": "one"}, ["d.txt"])
        assert (tmp_path / "w" / "d.txt").exists()
        work.discard_stale("dense", {"model": "two"}, ["d.txt"])
        assert not (tmp_path / "w" / "d.txt").exists()
        assert list((tmp_path / "w" / "stamps").iterdir()) == []


def test_an_error_is_of_the_file_that_it_names(tmp_path: Path) -> None:
    work = tmp_path / "w"
    with pytest.raises(InputError, match="--work"), WorkFolder(work).lock():
        raise OSError(errno.ENOSPC, "No space left on device", str(work / "frames" / "a.jpg"))
    with pytest.raises(OSError, match="No space left") as error, WorkFolder(work).lock():
        raise OSError(errno.ENOSPC, "No space left on device", str(tmp_path / "figure.png"))
    assert error.value.filename == str(tmp_path / "figure.png")


def made(text: str) -> Callable[[Path], None]:
    def make(part: Path) -> None:
        (part / "d.txt").write_text(text)

    return make


@pytest.mark.parametrize(
    ("free", "error", "number"),
    [
        ((1 << 16) - 1, OSError("cannot write the model"), errno.ENOSPC),
        (1 << 16, OSError("cannot write the model"), None),
        (0, OSError(errno.EACCES, "denied"), errno.EACCES),
    ],
)
def test_an_error_without_a_number_on_a_full_disk_is_that_of_the_disk(
    free: int, error: OSError, number: int | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Less than 65,536 bytes are free (MAX_FREE_OF_FULL_DISK); COLMAP's writers state no number."""

    def make(part: Path) -> None:
        raise error

    work = WorkFolder(tmp_path / "w")
    with work.lock():
        monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=free))
        with pytest.raises(OSError) as raised:  # noqa: PT011 - the number of the error is checked
            work.stage("dense", {}, ["d.txt"], make)
    assert raised.value.errno == number
    assert sorted(entry.name for entry in (tmp_path / "w").iterdir()) == [".lock", "stamps"]


def test_another_error_on_a_full_disk_is_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def make(part: Path) -> None:
        raise ValueError(part.name)

    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=0))
    work = WorkFolder(tmp_path / "w")
    with work.lock(), pytest.raises(ValueError, match="dense"):
        work.stage("dense", {}, ["d.txt"], make)


@pytest.mark.parametrize("stamp", ["[]", "{}", '{"outputs": "d.txt"}', "{"])
def test_a_stamp_of_another_form_owns_nothing(stamp: str, tmp_path: Path) -> None:
    work = WorkFolder(tmp_path / "w")
    with work.lock():
        work.stage("dense", {}, ["d.txt"], made("a"))
        (tmp_path / "w" / "stamps" / "dense.json").write_text(stamp)
        assert not work.is_made("dense", {})
        with pytest.raises(InputError, match="already exists and is not of an earlier run"):
            work.stage("dense", {}, ["d.txt"], made("b"))


def test_outputs_of_an_older_version_are_replaced_without_a_digest(tmp_path: Path) -> None:
    work = WorkFolder(tmp_path / "w")
    with work.lock():
        work.stage("dense", {}, ["d.txt"], made("a"))
        (tmp_path / "w" / "stamps" / "dense.json").write_text('{"key": "old", "outputs": ["d.txt"]}')
        (tmp_path / "w" / "d.txt").write_text("changed")
        work.stage("dense", {}, ["d.txt"], made("b"))
        assert (tmp_path / "w" / "d.txt").read_text() == "b"


def test_a_link_or_a_changed_file_is_no_output_of_a_stage(tmp_path: Path) -> None:
    work = WorkFolder(tmp_path / "w")
    with work.lock():
        work.stage("dense", {"model": 1}, ["d.txt"], made("a"))
        (tmp_path / "other.txt").write_text("a")
        (tmp_path / "w" / "d.txt").unlink()
        (tmp_path / "w" / "d.txt").symlink_to(tmp_path / "other.txt")  # to equal bytes
        with pytest.raises(InputError, match="it was changed since the run that wrote it"):
            work.stage("dense", {"model": 2}, ["d.txt"], made("b"))
        (tmp_path / "w" / "d.txt").unlink()
        (tmp_path / "w" / "d.txt").write_text("mine")
        with pytest.raises(InputError, match="it was changed since the run that wrote it"):
            work.discard("dense", ["d.txt"])
        assert (tmp_path / "w" / "d.txt").read_text() == "mine"


def test_a_stage_that_is_made_keeps_its_digest_and_its_time(tmp_path: Path) -> None:
    work, again = WorkFolder(tmp_path / "w"), WorkFolder(tmp_path / "w")
    with work.lock():
        digest = work.stage("dense", {"model": 1}, ["d.txt", "e.txt"], made("a"))
        assert work.is_made("dense", {"model": 1})
        assert not work.is_made("dense", {"model": 2})
        assert not work.is_made("other", {"model": 1})
        assert again.stage("dense", {"model": 1}, ["d.txt", "e.txt"], made("b")) == digest
        assert again.processor_s == work.processor_s
        assert (again.seconds, list(work.seconds)) == ({}, ["dense"])
        work.discard_stale("none", {}, ["n.txt"])  # of a stage that was never made
        # an output that a stage no longer writes is removed
        assert again.stage("dense", {"model": 3}, ["d.txt"], lambda part: None) != digest
        assert not (tmp_path / "w" / "d.txt").exists()

"""Leftovers of a killed run are removed by the next one; files of a live run are not."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from metric_base.files import whole_file, whole_folder
from tests.support.processes import started

#: Open a file or a folder for writing, and wait before it is complete.
WRITER = """
import sys, time
from pathlib import Path
from metric_base.files import whole_file, whole_folder

with {"file": whole_file, "folder": whole_folder}[sys.argv[1]](Path(sys.argv[2])) as work:
    (work if work.is_dir() else work.parent).joinpath(work.name if not work.is_dir() else "a").write_text("half")
    print("half-way", flush=True)
    time.sleep(600)
"""


@pytest.mark.parametrize("kind", ["file", "folder"])
def test_a_live_writer_keeps_its_part_and_a_dead_one_loses_it(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "out[1].x"  # a name that a pattern would misread
    neighbour = tmp_path / ".out[1].x.kept"
    neighbour.write_text("the user's own")
    with started([sys.executable, "-c", WRITER, kind, str(path)], stdout=subprocess.PIPE) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == b"half-way\n"
        (part,) = tmp_path.glob("*.part")
        copy = part.with_name(f"{part.name}.glb")  # as models3d.rescaling writes it
        copy.write_text("half")
        _write(path, kind)
        assert part.exists()
        assert copy.exists()
        writer.send_signal(signal.SIGKILL)
    assert part.exists()
    if path.is_dir():
        path.rename(tmp_path / "first")
    _write(path, kind)
    names = {entry.name for entry in tmp_path.iterdir()} - {"first"}
    assert names == {path.name, neighbour.name}


@pytest.mark.parametrize("kind", ["file", "folder"])
@pytest.mark.parametrize(
    "suffix", ["kept.part", "old.0.part", "{machine}.999999999.part", "{machine}.999999999.x.part"]
)
def test_files_and_folders_of_the_user_are_kept(tmp_path: Path, kind: str, suffix: str) -> None:
    with whole_file(tmp_path / "out") as work:
        machine = work.name.split(".")[2]
    path, other = tmp_path / "other", tmp_path / f".other.{suffix.format(machine=machine)}"
    other.mkdir()
    (other / "work").write_text("the user's own")
    _write(path, kind)
    assert (other / "work").read_text() == "the user's own"


def test_temporary_names_are_random_and_not_taken(tmp_path: Path) -> None:
    names = set()
    for _ in range(3):
        with whole_file(tmp_path / "out") as work, whole_folder(tmp_path / "folder") as folder:
            assert work.stat().st_size == 0
            names |= {work.name, folder.name}
        (tmp_path / "folder").rmdir()
    assert len(names) == 6


def _write(path: Path, kind: str) -> None:
    if kind == "file":
        with whole_file(path) as work:
            work.write_text("whole")
    else:
        with whole_folder(path) as work:
            (work / "a").write_text("whole")

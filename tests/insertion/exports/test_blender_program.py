"""The process of Blender: its program, its progress and its errors."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from insertion.blender.run import VARIABLE, blender_program, run_blender
from metric_base.errors import InputError


def fake_blender(folder: Path, monkeypatch: pytest.MonkeyPatch, body: str) -> None:
    """Let the program of Blender be a shell script."""
    program = folder / "blender"
    program.write_text(f"#!/bin/sh\n{body}\n")
    program.chmod(0o755)
    monkeypatch.setenv(VARIABLE, str(program))


def test_python_runs_the_script_and_blender_runs_it_in_the_background(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake_blender(tmp_path, monkeypatch, "exit 0")
    program, *options = blender_program()
    assert (program, options[:2], options[-1]) == (
        str(tmp_path / "blender"),
        ["--background", "--factory-startup"],
        "--",
    )
    monkeypatch.setenv(VARIABLE, sys.executable)
    assert len(blender_program()) == 2
    monkeypatch.setenv(VARIABLE, str(tmp_path / "absent"))
    with pytest.raises(InputError, match="--renderer blender: found no program"):
        blender_program()


@pytest.mark.parametrize(("job", "total"), [({"keys": [1, 2], "out": "out"}, 2), ({"keys": [1, 2]}, None)])
def test_progress_counts_the_images_of_a_job(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, job: dict[str, object], total: int | None
) -> None:
    fake_blender(tmp_path, monkeypatch, f"touch {tmp_path}/1.npy; sleep 0.5")  # longer than the start of the loop
    steps: list[tuple[str, int, int | None]] = []
    run_blender(job, tmp_path, lambda step, done, total: steps.append((step, done, total)))
    assert {(step, total) for step, _, total in steps} == {("Cycles", total)}
    assert steps[-1][1] == 1


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("echo no memory; exit 3", "status 3: no memory"),
        ("echo Traceback: error", "status 0: Traceback: error"),
        ("exit 1", "status 1: no word"),
    ],
)
def test_an_error_of_blender_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, body: str, message: str
) -> None:
    fake_blender(tmp_path, monkeypatch, body)
    with pytest.raises(InputError, match=f"--renderer blender: Blender ended with {message}"):
        run_blender({"keys": []}, tmp_path)

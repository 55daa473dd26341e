"""A full disk is one line, and nothing half-written stays: on a small tmpfs, where mounting is allowed."""

from __future__ import annotations

import contextvars
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from estimator.outputs.rescaled import write_rescaled
from estimator.reconstructions.scene_reader import read_scene
from metric_base.errors import InputError
from metric_base.files import set_rules, whole_file, whole_folder
from metric_base.images import write_image
from metric_cli.estimate_scale.estimate import main
from tests.synthetic.small_scene import write_small_scene


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 64 KiB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(disk)],
        capture_output=True,
        check=False,
        timeout=300,
    )
    if mounted.returncode:
        pytest.skip(f"mounting a tmpfs is not allowed here: {mounted.stderr.decode(errors='replace').strip()}")
    yield disk
    subprocess.run(["umount", str(disk)], check=True, timeout=300)


def test_a_scaled_model(small_disk: Path, tmp_path: Path) -> None:
    write_small_scene(tmp_path / "whole")
    (small_disk / "filler").write_bytes(b"x" * 60_000)
    with pytest.raises(
        InputError, match="--write-scaled: expected a place that can be written, found No space left"
    ) as error:
        write_rescaled(read_scene(tmp_path / "whole" / "colmap"), 0.5, small_disk / "metric")
    assert "\n" not in str(error.value)
    assert [path.name for path in small_disk.iterdir()] == ["filler"]


def test_pictures_of_an_overlay(small_disk: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (300, 300, 3), dtype=np.uint8)
    with (
        pytest.raises(InputError, match="--overlay: expected a place that can be written, found No space left"),
        whole_folder(small_disk / "overlay", "--overlay") as folder,
    ):
        write_image(folder / "a" / "b.png", noise)
    assert list(small_disk.iterdir()) == []


def test_a_file_that_was_there_stays(small_disk: Path) -> None:
    file = small_disk / "result.json"
    before = '{"schema": "metric-tree/scale/1"}'
    file.write_text(before)

    def overwrite() -> None:
        set_rules([], overwrite=True)
        with whole_file(file, "--output") as work:
            work.write_bytes(b"x" * 100_000)

    with pytest.raises(InputError, match="No space left"):
        contextvars.copy_context().run(overwrite)
    assert [(path.name, path.read_text()) for path in small_disk.iterdir()] == [("result.json", before)]


def test_a_stage_of_a_video(small_disk: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Features need more than this disk has: one line names the folder, and half a stage is removed."""
    video = Path(__file__).resolve().parents[3] / "data" / "scenes" / "demo_video" / "video.mp4"
    subprocess.run(["mount", "-o", "remount,size=1m", str(small_disk)], check=True, timeout=300)
    assert main([str(video), "--work", str(small_disk / "work"), "--frames", "4", "--gps", "auto"]) == 2
    lines = capfd.readouterr().err.strip().split("\n")
    assert len(lines) == 1
    assert "--work: expected a folder that can be written, found No space left" in lines[0]
    assert not list(small_disk.rglob("*.part*"))

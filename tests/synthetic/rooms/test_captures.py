"""Rendered captures have the stated shutter, exposure and truth."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from tests.support.skips import skip_without
from tests.synthetic.captures import SMALL, RenderedCapture, rolling_shutter, write_capture
from tests.synthetic.rooms.render import NoOpenGL
from tests.synthetic.rooms.world import Pose
from tests.synthetic.videos import orbit, recorded, room


def test_rolling_shutter_exposes_bands_at_different_times_and_without_readout_at_one_time() -> None:
    """The outer bands are rendered from cameras between the frames."""
    world = replace(room("study", 3, orbit(1.8, 3, degrees=20.0)), objects=())
    with skip_without(NoOpenGL):
        still = list(rolling_shutter(world, SMALL, 0.0, 0.0, 0.0))
        rolling = list(rolling_shutter(world, SMALL, 0.4, 0.0, 0.0))
        global_shutter = list(recorded(world, SMALL, 0.0))
    assert all((a.colour == b.colour).all() for a, b in zip(still, global_shutter, strict=True))
    changes = [np.abs(a.colour[:60].astype(int) - b.colour[:60]).mean() for a, b in zip(still, rolling, strict=True)]
    assert changes[0] == 0  # times before the first frame are clipped
    assert min(changes[1:]) > 2
    assert [frame.pose for frame in rolling] == list(world.poses)


def test_gain_changes_the_brightness_of_equal_frames() -> None:
    world = room("study", 3, (orbit(1.8, 1)[0],) * 4)
    with skip_without(NoOpenGL):
        bright = [frame.colour.mean() for frame in rolling_shutter(world, SMALL, 0.0, 0.0, 0.2)]
    assert 1.1 < max(bright) / min(bright) < 1.5


def test_truth_file_contains_the_camera_centre_of_every_image(tmp_path: Path) -> None:
    world = room("study", 3, orbit(1.8, 2))
    capture = RenderedCapture(partial(recorded, world, SMALL), SMALL)
    with skip_without(NoOpenGL):
        write_capture(capture, tmp_path)
    truth = json.loads((tmp_path / "truth.json").read_text(encoding="utf-8"))
    assert truth["focal"] == SMALL.focal / SMALL.width
    names = [file.name for file in sorted((tmp_path / "images").iterdir())]
    assert names == list(truth["centres"])
    poses: tuple[Pose, ...] = world.poses
    assert np.allclose(list(truth["centres"].values()), [pose.centre for pose in poses])

"""The height of the camera over the floor."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from estimator.evidence.camera_height import PRESETS, CameraHeight
from estimator.pipeline import measure_objects
from estimator.records.objects import Measurements
from metric_base.errors import InputError
from tests.synthetic.evidence import one
from tests.synthetic.walk import Walk, synthetic_walk


@pytest.mark.parametrize("scale", [0.02, 0.4, 30.0])
def test_camera_height(tmp_path: Path, scale: float) -> None:
    walk = synthetic_walk(tmp_path, height=1.5, scale=scale)
    row = one(CameraHeight(1.5, 0.15).observe(walk.scene, measure_objects(walk.scene, ())))
    assert row.scale == pytest.approx(scale, rel=0.02)
    assert row.sd_log == pytest.approx(0.1, abs=0.02)


def test_a_camera_height_needs_a_floor(walk: Walk, nothing: Measurements) -> None:
    row = one(CameraHeight(1.5, 0.15).observe(walk.scene, replace(nothing, floor=None)))
    assert (row.scale, row.reason) == (None, "no floor was found under the cameras")
    # the lowest plane is above the cameras: a table top or a ceiling, not the floor
    (floor, *_) = nothing.planes
    row = one(CameraHeight(1.5, 0.15).observe(walk.scene, replace(nothing, floor=replace(floor, height=1e3))))
    assert row.scale is None


def test_words_of_a_camera_height() -> None:
    assert CameraHeight.of("1.5+-0.15") == CameraHeight.of("1.5±0.15") == CameraHeight(1.5, 0.15)
    for name, (metres, sd) in PRESETS.items():
        assert CameraHeight.of(name) == CameraHeight(metres, sd)
    assert CameraHeight.of("5ft") == CameraHeight(1.524, 0.1524)
    assert CameraHeight.of("150cm+-20 cm") == CameraHeight(1.5, 0.2)
    for word in (
        "",
        "1.5 furlongs",
        "tall",
        "1.5+-0",
        "-1+-0.1",
        "nan+-1",
        "1+-2",
        "1+-inf",
        "1e300+-1",
        "1e-300+-1e-301",
    ):
        with pytest.raises(InputError, match=r"camera.height"):
            CameraHeight.of(word)


@pytest.mark.parametrize(("under", "silent"), [(2, False), (3, True)])
def test_a_tenth_of_the_cameras_may_be_under_the_floor(
    walk: Walk, nothing: Measurements, under: int, silent: bool
) -> None:
    (floor, *_) = nothing.planes
    views = [replace(walk.scene.views[0], name=str(number)) for number in range(25)]
    sunk = views[0].translation + views[0].rotation @ (1e3 * walk.scale * floor.basis[2])
    views[:under] = [replace(view, translation=sunk) for view in views[:under]]
    (row,) = CameraHeight(1.5, 0.15).observe(replace(walk.scene, views=tuple(views)), nothing)
    assert (row.scale is None) == silent


@pytest.mark.parametrize(
    ("metres", "sd", "is_valid"),
    [
        (1e-6, 1e-7, True),
        (0.9e-6, 1e-7, False),
        (1e5, 1.0, True),
        (1.1e5, 1.0, False),
        (1.5, 1.49, True),
        (1.5, 1.5, False),
    ],
)
def test_a_height_is_a_micrometre_to_100_km_and_larger_than_its_error(metres: float, sd: float, is_valid: bool) -> None:
    if is_valid:
        assert CameraHeight(metres, sd).metres == metres
    else:
        with pytest.raises(InputError, match="a height of 1e-06 to 100000 metres"):
            CameraHeight(metres, sd)

"""Ranges of scales, sizes and option values of an insertion, in numbers on each side."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from insertion.placement.model_size import model_size
from insertion.placement.path import path_motion
from insertion.request import PixelPosition, parse_facing, parse_frame_range, parse_pixel_position
from insertion.scene.scale import read_scale
from metric_base.errors import InputError
from models3d.model import Model


def model(longest_m: float, height_m: float = 0.001) -> Model:
    """A model with extents."""
    size_m = {"length": longest_m, "width": 0.001, "height": height_m}
    return cast(Model, SimpleNamespace(name="a.glb", size_m=size_m))


@pytest.mark.parametrize(("longest_m", "is_plausible"), [(0.0019, False), (0.002, True), (100.0, True), (100.1, False)])
def test_a_file_is_plausible_from_2_mm_to_100_m(longest_m: float, is_plausible: bool) -> None:
    size = model_size(model(longest_m), "file")
    assert (size.factor, size.source, not size.warnings) == (1.0, "file", is_plausible)


@pytest.mark.parametrize(("text", "is_valid"), [("10000", True), ("10000.1", False), ("1e-9", True), ("0", False)])
def test_a_stated_extent_is_at_most_10_km(text: str, is_valid: bool) -> None:
    if is_valid:
        assert model_size(model(1.0), f"length={text}").factor == float(text)
    else:
        with pytest.raises(InputError, match="at most 10000; found"):
            model_size(model(1.0), f"length={text}")


def test_a_model_without_an_extent_has_no_stated_one() -> None:
    with pytest.raises(InputError, match="--size height: expected a model with a height; a"):
        model_size(model(1.0, height_m=0.0), "height=1")


@pytest.mark.parametrize(
    ("scale", "is_valid"), [(1e-12, False), (1.1e-12, True), (0.99e12, True), (1e12, False), (math.nan, False)]
)
def test_a_scale_has_a_range(tmp_path: Path, scale: float, is_valid: bool) -> None:
    if is_valid:
        assert read_scale(tmp_path, scale).metres_per_unit == scale
    else:
        with pytest.raises(InputError, match="--scale: expected metres per scene unit, above 1e-12"):
            read_scale(tmp_path, scale)


@pytest.mark.parametrize(("length_m", "rounding_m"), [(2.0, 0.2), (3.0, 0.3), (4.0, 0.3)])
def test_a_corner_is_rounded_over_a_tenth_of_the_path_at_most_30_cm(length_m: float, rounding_m: float) -> None:
    motion = path_motion(np.array([[0, 0, 0], [length_m / 2, 0, 0]]), 2.0, 1.0, 0.0)
    assert motion.rounding == pytest.approx(rounding_m / 2)
    with pytest.raises(InputError, match="--path: expected several frames, or --speed; found one frame"):
        path_motion(motion.corners, 2.0, None, 0.0)


def test_ranges_of_frames_are_two_ascending_indices() -> None:
    assert parse_frame_range("3:3") == (3, 3)
    assert parse_frame_range("0:9") == (0, 9)
    for text in ("4:3", "3", "-1:3", "a:3", "3:"):
        with pytest.raises(InputError, match="--frames: expected FIRST:LAST"):
            parse_frame_range(text)


def test_directions_and_positions_are_finite() -> None:
    assert [parse_facing(text) for text in ("camera", "wall", "-90")] == ["camera", "wall", -90.0]
    for text in ("inf", "nan", "left"):
        with pytest.raises(InputError, match="--facing"):
            parse_facing(text)
    assert parse_pixel_position("auto") is None
    assert parse_pixel_position("frame=a.jpg,x=1,y=-2.5") == PixelPosition("a.jpg", 1.0, -2.5)
    for text in ("frame=a,x=1", "frame=a,x=1,y=inf", "frame=a,x=nan,y=1", "frame=a,x=1,y=2,z=3", "frame=a,x=l,y=2"):
        with pytest.raises(InputError, match="--at: expected frame="):
            parse_pixel_position(text)

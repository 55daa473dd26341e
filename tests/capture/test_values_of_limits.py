"""Both sides of the limits of a capture in absolute numbers; `test_refusals` checks the rules relative to them."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pytest

from capture.mapping.match_graph import FramePair, MatchGraph
from capture.mapping.model_metrics import ModelMetrics
from capture.mapping.refusals import early_failure, model_failure

NAMES = [f"{k:06d}.jpg" for k in range(20)]


def graph_of(pairs: list[FramePair], keypoints: int = 1500) -> MatchGraph:
    """Twenty sharp frames of 640 x 480 pixels with these pairs."""
    return MatchGraph(NAMES, np.full(20, keypoints), tuple(pairs), (640, 480), np.tile([0.19, 0.22], (20, 1)))


def code_of(graph: MatchGraph) -> str | None:
    failure = early_failure(graph)
    return None if failure is None else failure.code


@pytest.mark.parametrize(("motion_px", "code"), [(2.9, "static_camera"), (3.5, None)])
def test_a_static_camera_moves_by_less_than_half_a_percent_of_the_width(motion_px: float, code: str | None) -> None:
    assert code_of(graph_of([FramePair(k, k + 1, 200, 0.4, motion_px, None) for k in range(19)])) == code


@pytest.mark.parametrize(("keypoints", "code"), [(149, "no_texture"), (151, "too_few_frames")])
def test_a_frame_with_texture_has_150_features(keypoints: int, code: str) -> None:
    assert code_of(graph_of([], keypoints)) == code


@pytest.mark.parametrize(("n_rotations", "code"), [(11, None), (12, "pure_rotation")])
def test_a_rotation_explains_more_than_60_percent_of_the_pairs(n_rotations: int, code: str | None) -> None:
    """11 and 12 of 19 pairs are 58 and 63 %."""
    rotations = [FramePair(k, k + 1, 200, 1.0, 90.0, np.eye(3)) for k in range(n_rotations)]
    walk = [FramePair(k, k + 1, 200, 0.4, 90.0, None) for k in range(n_rotations, 19)]
    assert code_of(graph_of(rotations + walk)) == code


WALK = graph_of([FramePair(k, k + 1, 200, 0.4, 60.0, None) for k in range(19)])
RIGHT = ModelMetrics(
    names=tuple(NAMES),
    points=4000,
    angle_deg=9.0,
    error_px=0.4,
    focal=0.8,
    lens_bend=0.01,
    camera="SIMPLE_RADIAL",
    focal_deviation=0.01,
    focal_spread=0.001,
    pattern=0.02,
    triplets=100,
    pieces=(20,),
)


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"angle_deg": 1.4}, "pure_rotation"),
        ({"angle_deg": 1.6}, None),
        ({"broken": ("a.jpg", "b.jpg")}, "drift"),
        ({"broken": ("a.jpg",)}, None),
        ({"aspect": 1.06}, "implausible_focal_length"),
        ({"aspect": 1.04}, None),
        ({"names": tuple(NAMES[:10])}, "too_few_frames"),
        ({"names": tuple(NAMES[:11])}, None),
    ],
)
def test_a_right_model_is_within_each_limit(changes: dict[str, Any], code: str | None) -> None:
    """1.5 degrees, one broken frame, 5 % between the focal lengths, more than half of the frames."""
    failure = model_failure(WALK, msgspec.structs.replace(RIGHT, **changes), focal_held=False)
    assert (None if failure is None else failure.code) == code

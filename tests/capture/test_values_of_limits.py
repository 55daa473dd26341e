"""Both sides of the limits of a capture in absolute numbers; `test_refusals` checks the rules relative to them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from capture.mapping.mapper import ModelReport
from capture.mapping.match_graph import FramePair, MatchGraph
from capture.mapping.refusals import early_failure, model_failure
from capture.pipeline import CaptureOptions
from capture.quality_warnings import capture_cautions
from capture.sources.frames import ChosenFrame, Frames
from metric_base.errors import InputError
from tests.support.captures import right_model, walk_graph

NAMES = [f"{k:06d}.jpg" for k in range(20)]


def graph_of(pairs: list[FramePair], keypoints: int = 1500) -> MatchGraph:
    """Twenty sharp frames of 640 x 480 pixels with these pairs."""
    return MatchGraph(NAMES, np.full(20, keypoints), tuple(pairs), (640, 480), np.tile([0.19, 0.22], (20, 1)))


def code_of(graph: MatchGraph) -> str | None:
    failure = early_failure(graph)
    return None if failure is None else failure.code


@pytest.mark.parametrize(("motion_px", "code"), [(2.9, "static_camera"), (3.5, None)])
def test_a_static_camera_moves_by_less_than_half_a_percent_of_the_width(motion_px: float, code: str | None) -> None:
    assert code_of(graph_of([FramePair(k, k + 1, 200, motion_px, None) for k in range(19)])) == code


@pytest.mark.parametrize(("keypoints", "code"), [(149, "no_texture"), (151, "too_few_frames")])
def test_a_frame_with_texture_has_150_features(keypoints: int, code: str) -> None:
    assert code_of(graph_of([], keypoints)) == code


@pytest.mark.parametrize(("n_rotations", "code"), [(11, None), (12, "pure_rotation")])
def test_a_rotation_explains_more_than_60_percent_of_the_pairs(n_rotations: int, code: str | None) -> None:
    """11 and 12 of 19 pairs are 58 and 63 %."""
    rotations = [FramePair(k, k + 1, 200, 90.0, np.eye(3)) for k in range(n_rotations)]
    walk = [FramePair(k, k + 1, 200, 90.0, None) for k in range(n_rotations, 19)]
    assert code_of(graph_of(rotations + walk)) == code


WALK, RIGHT = walk_graph(), right_model()


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"broken": ("a.jpg", "b.jpg")}, "drift"),
        ({"broken": ("a.jpg",)}, None),
        ({"aspect": 1.06}, "implausible_focal_length"),
        ({"aspect": 1.04}, None),
        ({"names": tuple(NAMES[:10])}, "too_few_frames"),
        ({"names": tuple(NAMES[:11])}, None),
    ],
)
def test_a_right_model_is_within_each_limit(changes: dict[str, Any], code: str | None) -> None:
    """One broken frame, 5 % between the focal lengths, more than half of the frames."""
    failure = model_failure(WALK, msgspec.structs.replace(RIGHT, **changes), focal_held=False)
    assert (None if failure is None else failure.code) == code


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"pieces": (12, 7)}, "several_places"),
        ({"pieces": (12, 6)}, None),
        ({"focal_deviation": 0.11}, "focal_length_undetermined"),
        ({"focal_deviation": 0.09}, None),
        ({"lens_bend": 0.21}, "implausible_focal_length"),
        ({"lens_bend": 0.19}, None),
        ({"lens_bend": 0.5, "camera": "OPENCV_FISHEYE"}, None),
        ({"focal_change": -0.11}, "focal_length_changes"),
        ({"focal_change": -0.09}, None),
        ({"focal_change": 0.13, "focal_change_error": 0.03}, "focal_length_changes"),
        ({"focal_change": 0.11, "focal_change_error": 0.03}, None),
        ({"contradicted": 6}, "drift"),
        ({"contradicted": 5}, None),
    ],
)
def test_parts_lens_zoom_and_triplets_of_a_right_model(changes: dict[str, Any], code: str | None) -> None:
    """Half of the largest part, 10 % of the focal length or four standard errors, 5 % of the triplets."""
    failure = model_failure(WALK, msgspec.structs.replace(RIGHT, **changes), focal_held=False)
    assert (None if failure is None else failure.code) == code


@pytest.mark.parametrize(
    ("inliers", "is_planar", "moved_px", "zoom", "code"),
    [
        (30, True, 65.0, 1.029, "pure_rotation"),
        (29, True, 65.0, 1.029, None),
        (30, False, 65.0, 1.029, None),
        (30, True, 63.0, 1.029, None),
        (30, True, 65.0, 1.032, None),
        (15, False, 65.0, 1.0, None),
        (14, False, 65.0, 1.0, "too_few_frames"),
    ],
)
def test_pairs_that_are_linked_and_tested_for_a_rotation(
    inliers: int, is_planar: bool, moved_px: float, zoom: float, code: str | None
) -> None:
    """30 matches, most of them planar, a tenth of 640 pixels, a misfit of 0.03; 15 matches of linked frames."""
    matrix = np.array([[zoom, 0, (1 - zoom) * 320], [0, zoom, (1 - zoom) * 240], [0, 0, 1]])
    pairs = [FramePair(k, k + 1, inliers, moved_px, matrix if is_planar else None) for k in range(19)]
    assert code_of(graph_of(pairs)) == code


@pytest.mark.parametrize(
    ("edges", "code"),
    [((0.11, 0.18), "motion_blur"), ((0.13, 0.18), "too_few_frames"), ((0.11, 0.2), "too_few_frames")],
)
def test_frames_are_blurred_if_all_edges_are_flat(edges: tuple[float, float], code: str) -> None:
    assert code_of(MatchGraph(NAMES, np.full(20, 1500), (), (640, 480), np.tile(edges, (20, 1)))) == code


@pytest.mark.parametrize(("n_frames", "code"), [(5, "too_few_frames"), (6, None)])
def test_a_capture_has_six_frames(n_frames: int, code: str | None) -> None:
    pairs = tuple(FramePair(k, k + 1, 200, 60.0, None) for k in range(n_frames - 1))
    edges = np.tile([0.19, 0.22], (n_frames, 1))
    assert code_of(MatchGraph(NAMES[:n_frames], np.full(n_frames, 1500), pairs, (640, 480), edges)) == code


@pytest.mark.parametrize(
    ("first", "second", "code"), [(10, 6, "several_places"), (10, 5, "too_few_frames"), (11, 6, "too_few_frames")]
)
def test_several_places_have_six_frames_each_and_none_most_of_them(first: int, second: int, code: str) -> None:
    links = [*range(first - 1), *range(first, first + second - 1)]
    graph = graph_of([FramePair(k, k + 1, 200, 60.0, None) for k in links])
    failure = model_failure(graph, None, focal_held=False)
    assert failure is not None
    assert failure.code == code


@pytest.mark.parametrize(
    ("changes", "edges", "words"),
    [
        ({"pattern": 0.13}, (0.19, 0.22), "leaves a pattern"),
        ({"pattern": 0.11}, (0.19, 0.22), None),
        ({"focal_deviation": 0.021}, (0.19, 0.22), "only to about 4 %"),
        ({"focal_deviation": 0.019}, (0.19, 0.22), None),
        ({"focal_spread": 0.0036}, (0.19, 0.22), "disagree about the focal length"),
        ({"focal_spread": 0.0034}, (0.19, 0.22), None),
        ({}, (0.119, 0.189), "are blurred"),
        ({}, (0.121, 0.189), None),
        ({}, (0.119, 0.191), None),
    ],
)
def test_a_model_is_used_with_a_warning(changes: dict[str, Any], edges: tuple[float, float], words: str | None) -> None:
    chosen = [ChosenFrame(0, "a.jpg", None, 640, 480, None, (0.0, 0.0))]
    frames = Frames(source="/a", size=(640, 480), turned_deg=0, hdr=None, remarks=[], times_s=None, chosen=chosen)
    report = ModelReport(model=msgspec.structs.replace(RIGHT, **changes), pairs={"edges": list(edges)})
    warnings = capture_cautions(Path("p"), frames, report, focal_given=False)
    assert len(warnings) == (words is not None)
    assert all(str(words) in warning for warning in warnings)


@pytest.mark.parametrize(
    ("option", "values", "others"),
    [
        ("frames", (2, 10_000), (1, 0)),
        ("focal_px", (1.01, 0.99e6), (1.0, 1e6)),
        ("max_time_s", (1.0, 0.99e6), (0.99, 1e6)),
        ("camera_model", ("PINHOLE", None), ("FISH", "")),
    ],
)
def test_options_of_a_capture_have_ranges(option: str, values: tuple[object, ...], others: tuple[object, ...]) -> None:
    for value in values:
        assert getattr(CaptureOptions(**{option: value}), option) == value  # type: ignore[arg-type]
    for value in others:
        with pytest.raises(InputError, match="--"):
            CaptureOptions(**{option: value})  # type: ignore[arg-type]

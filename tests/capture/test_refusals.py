"""Captures that cannot be used, each made here and refused by its name, through the real stages."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from capture.caution_files import read_cautions
from capture.mapping.camera_models import CameraModelChoice
from capture.mapping.features import MAIN, POOLED, QUICK
from capture.mapping.mapper import ModelReport
from capture.mapping.match_graph import FramePair
from capture.mapping.refusals import (
    CODES,
    MAX_ASPECT,
    MAX_BEND,
    MAX_CONTRADICTED_RATIO,
    MAX_FOCAL_STD,
    MAX_STATIC_MOTION,
    MIN_BROKEN_FRAMES,
    MIN_EDGE_STEEPNESS,
    MIN_FRAMES,
    MIN_KEYPOINTS,
    MIN_WARNED_FOCAL_STD,
    MIN_WARNED_FOCAL_VARIATION,
    MIN_WARNED_PATTERN,
    MIN_ZOOM,
    MIN_ZOOM_ERRORS,
    early_failure,
    model_failure,
    refusal,
)
from capture.mapping.search import best_run, is_certain
from capture.quality_warnings import capture_cautions
from capture.sources.frames import ChosenFrame, Frames
from metric_cli.estimate_scale.estimate import main
from tests.support.captures import right_model, walk_graph
from tests.support.skips import skip_without
from tests.synthetic.refused_videos import FRAMES, LENS, RARE_VIDEOS, REFUSED_VIDEOS
from tests.synthetic.rooms.render import NoOpenGL
from tests.synthetic.videos import SyntheticFrame, recorded, room, straight_ahead, times_of, write_video

#: The codes of which every strategy is tried. The pooled strategy would take most of the time of the two rooms cut
#: together, whose frames fall into the same groups with both.
POOLED_CODES = {"no_texture", "motion_blur"}


@pytest.fixture
def few_features(monkeypatch: pytest.MonkeyPatch) -> None:
    """Do not double the images before the search for features, which takes most of the time of small frames."""
    main = replace(MAIN, first_octave=0)
    monkeypatch.setattr("capture.mapping.search.MAIN", main)
    monkeypatch.setattr("capture.mapping.search.STRATEGIES", (QUICK, main, POOLED))


@pytest.mark.slow
@pytest.mark.usefixtures("few_features")
@pytest.mark.parametrize("code", REFUSED_VIDEOS)
def test_a_capture_that_cannot_be_used_is_named(
    code: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    if code not in POOLED_CODES:
        monkeypatch.setattr("capture.mapping.search.MAX_POOLED_S", 0.0)
    with skip_without(NoOpenGL):
        _film(REFUSED_VIDEOS[code](), tmp_path / "video.mp4")
    words = [str(tmp_path / "video.mp4"), "--work", str(tmp_path / "w"), "--json"]
    for _ in range(2):  # a refusal is kept, too
        assert main(words) == 3
        captured = capsys.readouterr()
        record = json.loads(captured.out)
        assert record["schema"] == "metric-tree/scale/1"
        assert record["status"] == "unresolved"
        assert record["failure"]["code"] == code
        assert code in captured.err
        assert len(captured.err.splitlines()) == 1
    assert not (tmp_path / "w" / "sparse").exists()
    assert not (tmp_path / "w" / "result.json").exists()


@pytest.mark.usefixtures("few_features")
def test_a_focal_length_that_is_given_is_held(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Straight ahead no video determines it; with it, the video is used, and the result states what rests on it."""
    with skip_without(NoOpenGL):
        _film(recorded(room("sitting room", 7, straight_ahead(FRAMES, 0.9)), LENS), tmp_path / "video.mp4")
    assert main([str(tmp_path / "video.mp4"), "--work", str(tmp_path / "w"), "--focal", "250"]) == 2
    assert "--draw (a local page), --detector auto" in capsys.readouterr().err
    report = json.loads((tmp_path / "w" / "reconstruction.json").read_text())
    assert report["focal_held"]
    assert report["model"]["focal"] == pytest.approx(250 / 320)
    assert report["model"]["focal_deviation"] > MAX_FOCAL_STD
    (caution,) = read_cautions(tmp_path / "w")
    assert "the frames do not determine the focal length, and that of --focal is held" in caution


def _film(frames: Iterable[SyntheticFrame], file: Path) -> None:
    pictures = [frame.colour for frame in frames]
    write_video(file, pictures, times_of(len(pictures), rate=10.0))


def test_a_good_capture_passes() -> None:
    assert early_failure(walk_graph()) is None
    assert model_failure(walk_graph(), right_model(), focal_held=False) is None
    assert is_certain(ModelReport(model=right_model()), 20)


#: Maximum number of contradicted triplets of the 100 of `right_model`.
N_CONTRADICTED = int(100 * MAX_CONTRADICTED_RATIO)
#: Changes of a right model just beyond and just within the limit of each test, and the code of its refusal.
LIMITS: list[tuple[str, dict[str, Any], dict[str, Any]]] = [
    ("focal_length_undetermined", {"focal_deviation": 1.1 * MAX_FOCAL_STD}, {"focal_deviation": 0.9 * MAX_FOCAL_STD}),
    ("focal_length_undetermined", {"focal_deviation": None}, {"focal_deviation": 0.0}),
    ("implausible_focal_length", {"aspect": MAX_ASPECT + 0.01}, {"aspect": MAX_ASPECT}),
    ("implausible_focal_length", {"lens_bend": MAX_BEND + 0.01}, {"lens_bend": MAX_BEND}),
    ("implausible_focal_length", {"lens_bend": 0.4}, {"lens_bend": 0.4, "camera": "OPENCV_FISHEYE"}),
    ("focal_length_changes", {"focal_change": MIN_ZOOM + 0.01}, {"focal_change": MIN_ZOOM}),
    (
        "focal_length_changes",
        {"focal_change": -0.2, "focal_change_error": 0.19 / MIN_ZOOM_ERRORS},
        {"focal_change": -0.2, "focal_change_error": 0.21 / MIN_ZOOM_ERRORS},
    ),
    (
        "drift",
        {"contradicted": int(100 * MAX_CONTRADICTED_RATIO) + 1},
        {"contradicted": int(100 * MAX_CONTRADICTED_RATIO)},
    ),
    ("drift", {"broken": ("a.jpg",) * MIN_BROKEN_FRAMES}, {"broken": ("a.jpg",) * (MIN_BROKEN_FRAMES - 1)}),
    ("several_places", {"pieces": (20, 11)}, {"pieces": (20, 10)}),
    ("too_few_frames", {"names": tuple(walk_graph(10).names)}, {"names": tuple(walk_graph(11).names)}),
]


@pytest.mark.parametrize(("code", "beyond", "within"), LIMITS)
def test_a_model_is_refused_beyond_each_limit(code: str, beyond: dict[str, Any], within: dict[str, Any]) -> None:
    failure = model_failure(walk_graph(), right_model(**beyond), focal_held=False)
    assert failure is not None
    assert failure.code == code
    assert model_failure(walk_graph(), right_model(**within), focal_held=False) is None


def test_a_held_focal_length_is_not_refused() -> None:
    assert model_failure(walk_graph(), right_model(aspect=1.1, focal_deviation=0.6), focal_held=True) is None


@pytest.mark.parametrize(
    ("code", "changes"),
    [
        (
            "static_camera",
            {"pairs": tuple(FramePair(k, k + 1, 200, 640 * 0.9 * MAX_STATIC_MOTION, None) for k in range(19))},
        ),
        ("pure_rotation", {"pairs": tuple(FramePair(k, k + 1, 200, 90.0, np.eye(3)) for k in range(19))}),
        ("too_few_frames", {"pairs": ()}),
        ("no_texture", {"pairs": (), "keypoints": np.full(20, MIN_KEYPOINTS - 1)}),
        ("motion_blur", {"pairs": (), "edges": np.tile(np.array(MIN_EDGE_STEEPNESS) - 0.01, (20, 1))}),
        ("too_few_frames", {"names": walk_graph().names[: MIN_FRAMES - 1], "pairs": ()}),
    ],
)
def test_matches_show_why_there_is_no_model(code: str, changes: dict[str, Any]) -> None:
    failure = early_failure(walk_graph(**changes))
    assert failure is not None
    assert failure.code == code


def test_two_places_are_named() -> None:
    pairs = tuple(FramePair(k, k + 1, 200, 60.0, None) for k in range(19) if k != 9)
    failure = model_failure(walk_graph(pairs=pairs), right_model(10), focal_held=False)
    assert failure is not None
    assert failure.code == "several_places"
    assert "groups of 10 and 10" in failure.message


@pytest.mark.parametrize(
    "change",
    [
        {"names": tuple(walk_graph(19).names)},
        {"focal_deviation": MIN_WARNED_FOCAL_STD},
        {"pattern": MIN_WARNED_PATTERN},
    ],
)
def test_a_doubtful_quick_model_is_not_used(change: dict[str, Any]) -> None:
    assert not is_certain(ModelReport(model=right_model(**change)), 20)


@pytest.mark.parametrize(("n_main", "chosen"), [(19, "quick SIFT"), (20, "SIFT")])
def test_doubtful_quick_model_is_used_only_if_it_has_more_frames(n_main: int, chosen: str) -> None:
    refused = ModelReport(model=right_model(n_main), failure=refusal("focal_length_undetermined", "straight ahead"))
    runs = [(QUICK, "a", ModelReport(model=right_model(20))), (MAIN, "b", refused)]
    assert best_run(runs)[0].name == chosen


def _warnings(edges: list[float | None] | None = None, report: dict[str, Any] | None = None, **model: Any) -> list[str]:
    """Warnings of a report with a changed model, without the path."""
    chosen = [ChosenFrame(0, "a.jpg", None, 320, 240, None, (0.0, 0.0))]
    frames = Frames(source="/a", size=(320, 240), turned_deg=0, hdr=None, remarks=[], times_s=None, chosen=chosen)
    pairs = {"edges": edges or [0.19, 0.22]}
    made = ModelReport(model=right_model(**model), pairs=pairs, **(report or {}))
    return [row.removeprefix("p: ") for row in capture_cautions(Path("p"), frames, made, focal_given=False)]


@pytest.mark.parametrize(
    ("edges", "spread", "words"),
    [
        ([0.19, 0.22], 0.0007, None),
        ([0.14, 0.20], 0.0007, None),
        ([0.11, 0.18], 0.0007, "the frames are blurred"),
        ([0.11, 0.18], 0.004, "the frames are blurred"),  # the blur explains the spread
        ([0.19, 0.22], MIN_WARNED_FOCAL_VARIATION + 0.0005, "the frames disagree about the focal length, by 0.4 %"),
        ([None, None], None, None),
    ],
)
def test_what_is_used_with_a_warning(edges: list[float | None], spread: float | None, words: str | None) -> None:
    warnings = _warnings(edges, focal_spread=spread)
    assert len(warnings) == (words is not None)
    assert all(warning.startswith(str(words)) for warning in warnings)


def test_the_error_of_the_focal_length_is_stated() -> None:
    (warning,) = _warnings(focal_deviation=0.03)
    assert "only to about 6 %" in warning
    assert not _warnings(focal_deviation=0.015)
    (warning,) = _warnings(report={"focal_held": True}, focal_deviation=0.6)
    assert "that of the file is held" in warning


def test_frames_without_a_place_are_named() -> None:
    (warning,) = _warnings(report={"left_out": [f"{k}.jpg" for k in range(7)]})
    assert warning.startswith("7 of 1 frames could not be placed")
    assert warning.endswith("and are not used: 0.jpg, 1.jpg, 2.jpg, 3.jpg, 4.jpg, ...")


def test_frames_that_see_only_distant_points_are_stated() -> None:
    _, warning = _warnings(report={"left_out": ["1.jpg"]}, undetermined=("1.jpg",))
    assert warning.startswith("1 of these frames share only distant points")


def test_a_pattern_is_stated_unless_the_camera_model_is_the_best_one() -> None:
    chosen = ("OPENCV_FISHEYE", "SIMPLE_RADIAL")
    choices = [None, *(CameraModelChoice({}, "SIMPLE_RADIAL", name) for name in chosen)]
    rows = [_warnings(report={"lenses": choice}, pattern=MIN_WARNED_PATTERN + 0.01) for choice in choices]
    assert [len(row) for row in rows] == [1, 1, 0]
    assert "the camera model (SIMPLE_RADIAL) leaves a pattern in the residuals" in rows[0][0]


def test_a_failure_that_two_mappers_overrule_is_a_warning() -> None:
    (warning,) = _warnings(report={"overruled": refusal("drift", "the steps change")})
    assert warning.startswith("the steps change; record a loop")
    assert warning.endswith("another mapper finds the same path")


def test_every_code_of_the_contract_is_there() -> None:
    assert set(CODES) == {*REFUSED_VIDEOS, *RARE_VIDEOS, "wrong_camera_model", "out_of_time"}

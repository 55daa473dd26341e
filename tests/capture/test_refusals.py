"""Captures that cannot be used, each made here and refused by its name, through the real stages."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from capture.mapping.features import STRATEGIES as RUNGS
from capture.mapping.features import model_rank
from capture.mapping.features import next_strategies as next_rungs
from capture.mapping.mapper import MappingResult as Mapped
from capture.mapping.mapper import more_reliable as _better_supported
from capture.mapping.match_graph import CaptureEvidence, Pair
from capture.mapping.model_metrics import ModelShape, TripletAgreement, weakest_seam
from capture.mapping.pairs import all_pairs
from capture.mapping.refusals import (
    CODES,
    UNDETERMINED,
    can_answer,
    contradiction,
    early_failure,
    failure,
    is_disputed,
    lens_is_doubtful,
    model_failure,
    needs_check,
)
from capture.quality_warnings import capture_cautions, read_cautions
from capture.sources.frames import Frames
from metric_cli.estimate_scale.estimate import main
from tests.synthetic.refused_videos import FRAMES, LENS, RARE_VIDEOS, REFUSED_VIDEOS
from tests.synthetic.rooms.render import NoOpenGL
from tests.synthetic.skips import skip_without
from tests.synthetic.videos import SyntheticFrame, recorded, room, straight_ahead, times_of, write_video


@pytest.mark.slow
@pytest.mark.parametrize("code", REFUSED_VIDEOS)
def test_a_capture_that_cannot_be_used_is_named(code: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
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


def test_a_focal_length_that_is_given_is_held(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Straight ahead no video determines it; with it, the video is used, and the result says what rests on it."""
    with skip_without(NoOpenGL):
        _film(recorded(room("sitting room", 7, straight_ahead(FRAMES, 0.9)), LENS), tmp_path / "video.mp4")
    assert main([str(tmp_path / "video.mp4"), "--work", str(tmp_path / "w"), "--focal", "250"]) == 2
    assert "--instances FILE, --detector MODEL, or --draw" in capsys.readouterr().err
    report = json.loads((tmp_path / "w" / "reconstruction.json").read_text())
    assert report["focal_held"]
    assert report["model"]["focal"] == pytest.approx(250 / 320)
    assert report["model"]["focal_deviation"] > UNDETERMINED
    (caution,) = read_cautions(tmp_path / "w")
    assert "the frames do not determine the focal length, and that of --focal is held" in caution


def _film(frames: Iterable[SyntheticFrame], file: Path) -> None:
    pictures = [frame.colour for frame in frames]
    write_video(file, pictures, times_of(len(pictures), rate=10.0))


def _evidence(n: int = 20) -> CaptureEvidence:
    """Frames of a walk: every frame matches the next three, with parallax."""
    generator = np.random.default_rng(0)
    pairs = [
        Pair(a, b, 300, 200, 0.4, 60.0 * (b - a), np.eye(3) + generator.normal(0, 0.02, (3, 3)))
        for a in range(n)
        for b in range(a + 1, min(a + 4, n))
    ]
    names = [f"{k:06d}.jpg" for k in range(n)]
    edges = np.tile([0.19, 0.22], (n, 1))
    return CaptureEvidence(names, np.full(n, 1500), tuple(pairs), (640, 480), edges)


def _shape(evidence: CaptureEvidence) -> ModelShape:
    n = len(evidence.names)
    return ModelShape(tuple(evidence.names), np.eye(n, 3), 4000, 9.0, 0.4, 0.8, 0.01, 0.01)


def test_a_good_capture_passes() -> None:
    evidence = _evidence()
    assert early_failure(evidence) is None
    assert model_failure(evidence, _shape(evidence), focal_held=False) is None


def test_what_the_model_shows() -> None:
    evidence = _evidence()
    shape = _shape(evidence)
    refusals = {
        "pure_rotation": model_failure(evidence, replace(shape, angle_deg=0.8), focal_held=False),
        "drift": contradiction(replace(shape, agreement=TripletAgreement(20, 40, 3))),
        "implausible_focal_length": model_failure(evidence, replace(shape, focal=9.0), focal_held=False),
        "focal_length_changes": model_failure(evidence, replace(shape, focal_spread=0.01), focal_held=True),
        "focal_length_undetermined": model_failure(evidence, replace(shape, focal_deviation=0.6), focal_held=False),
        "too_few_frames": model_failure(evidence, None, focal_held=False),
    }
    assert {code: refusal and refusal.code for code, refusal in refusals.items()} == {code: code for code in refusals}
    assert model_failure(evidence, replace(shape, focal=9.0, focal_deviation=0.6), focal_held=True) is None
    assert model_failure(evidence, replace(shape, focal=9.0), focal_held=False, stated_focal=8.8) is None
    assert model_failure(evidence, replace(shape, focal=0.34), focal_held=False) is None  # a wide lens
    bent = model_failure(evidence, replace(shape, lens_bend=0.4), focal_held=True)
    assert bent is not None
    assert bent.code == "implausible_focal_length"
    oblong = model_failure(evidence, replace(shape, aspect=1.2), focal_held=False)
    assert oblong is not None
    assert "20 % apart" in oblong.message
    assert model_failure(evidence, replace(shape, aspect=1.03), focal_held=False) is None
    fisheye = replace(shape, lens_bend=0.4, camera="OPENCV_FISHEYE")
    assert model_failure(evidence, fisheye, focal_held=True) is None


def test_when_the_other_mapper_is_asked_and_when_it_may_answer() -> None:
    evidence = replace(_evidence(), pairs=tuple(Pair(a, b, 300, 200, 0.4, 60.0, None) for a, b in all_pairs(20)))
    assert evidence.most_steps() == 1
    assert _evidence().most_steps() == 7  # 19 frames on, in steps of up to three
    whole = replace(_shape(evidence), agreement=TripletAgreement(20, 60, 2, 0.4, (tuple(evidence.names),)))
    torn = replace(whole, agreement=replace(whole.agreement, pieces=(whole.names[:9], whole.names[9:])))
    contradicted = replace(whole, agreement=replace(whole.agreement, contradicted=9))
    broken = replace(whole, agreement=replace(whole.agreement, broken=whole.names[7:9]))
    assert contradiction(replace(whole, agreement=replace(whole.agreement, broken=whole.names[7:8]))) is None
    assert not needs_check(evidence, whole, None)
    assert needs_check(_evidence(), whole, None)  # a long chain may drift
    for shape in (torn, contradicted, broken, replace(whole, angle_deg=2.0), replace(whole, names=whole.names[:12])):
        assert needs_check(evidence, shape, None)
    for shape in (torn, contradicted, broken, replace(whole, angle_deg=2.0)):
        assert not can_answer(shape, None)
    assert needs_check(evidence, None, failure("too_few_frames", "two of twenty"))
    assert not needs_check(evidence, whole, failure("focal_length_undetermined", "straight ahead"))
    assert not needs_check(evidence, None, failure("pure_rotation", "it turns"))


@pytest.mark.parametrize(
    ("edges", "spread", "words"),
    [
        ([0.19, 0.22], 0.0007, None),
        ([0.14, 0.20], 0.0007, None),
        ([0.11, 0.18], 0.0007, "the frames are smeared"),
        ([0.11, 0.18], 0.004, "the frames are smeared"),  # the smear explains the spread
        ([0.19, 0.22], 0.004, "the frames disagree about the focal length, by 0.4 %"),
        ([None, None], None, None),
    ],
)
def test_what_is_used_with_a_caution(edges: list[float | None], spread: float | None, words: str | None) -> None:
    frames = Frames(["a.jpg"], [0], None, np.zeros((1, 2)), [(320, 240)], [None], (320, 240), 0, None, [])
    model = {"focal": 0.8, "focal_deviation": 0.01, "focal_spread": spread, "left_out": [], "pattern": 0.02}
    report = {"pairs": {"edges": edges}, "model": model, "focal_held": False}
    cautions = capture_cautions(Path("video.mp4"), frames, report, focal_given=False)
    assert len(cautions) == (words is not None)
    assert all(f"video.mp4: {words}" in caution for caution in cautions)


def test_a_focal_length_that_the_frames_hardly_determine_is_said_with_its_error() -> None:
    frames = Frames(["a.jpg"], [0], None, np.zeros((1, 2)), [(320, 240)], [None], (320, 240), 0, None, [])
    model = {"focal": 0.8, "focal_deviation": 0.03, "focal_spread": 0.0, "left_out": [], "pattern": 0.02}
    report = {"pairs": {"edges": [0.2, 0.2]}, "model": model, "focal_held": False}
    (caution,) = capture_cautions(Path("p"), frames, report, focal_given=False)
    assert "only to about 6 %" in caution
    model["focal_deviation"] = 0.015
    assert not capture_cautions(Path("p"), frames, report, focal_given=False)


def test_frames_without_a_place_are_named() -> None:
    frames = Frames(["a.jpg"], [0], None, np.zeros((1, 2)), [(320, 240)], [None], (320, 240), 0, None, [])
    names = [f"{k}.jpg" for k in range(7)]
    model = {"focal": 0.8, "focal_deviation": 0.01, "focal_spread": 0.0, "left_out": names, "pattern": 0.02}
    report = {"pairs": {"edges": [0.2, 0.2], "frames": 20}, "model": model, "focal_held": False}
    (caution,) = capture_cautions(Path("p"), frames, report, focal_given=False)
    assert caution.endswith(
        "7 of 20 frames could not be placed and are not used: 0.jpg, 1.jpg, 2.jpg, 3.jpg, 4.jpg, ..."
    )


def test_a_lens_that_no_model_describes_is_said() -> None:
    frames = Frames(["a.jpg"], [0], None, np.zeros((1, 2)), [(320, 240)], [None], (320, 240), 0, None, [])
    model = {"focal": 0.8, "focal_deviation": 0.01, "focal_spread": 0.0, "left_out": [], "pattern": 0.15}
    model |= {"camera": "SIMPLE_RADIAL"}
    report = {"pairs": {"edges": [0.2, 0.2], "frames": 20}, "model": model, "focal_held": False}
    (caution,) = capture_cautions(Path("p"), frames, report, focal_given=False)
    assert "the camera model (SIMPLE_RADIAL) leaves a pattern in the residuals" in caution


def test_a_group_of_more_than_half_of_the_frames_is_used() -> None:
    evidence = _evidence()
    shape = replace(_shape(evidence), names=tuple(evidence.names[:11]))
    assert model_failure(evidence, shape, focal_held=False) is None
    half = model_failure(evidence, replace(shape, names=tuple(evidence.names[:10])), focal_held=False)
    assert half is not None
    assert half.code == "too_few_frames"


def test_when_other_lenses_and_features_are_tried() -> None:
    evidence = _evidence()
    shape = _shape(evidence)
    assert not lens_is_doubtful(shape, None)
    assert lens_is_doubtful(replace(shape, pattern=0.16), None)
    spread = model_failure(evidence, replace(shape, focal_spread=0.01), focal_held=False)
    assert spread is not None
    assert lens_is_doubtful(shape, spread)
    assert next_rungs(RUNGS[0], spread, 20, evidence) == RUNGS[1:]
    assert next_rungs(RUNGS[-1], spread, 20, evidence) == ()
    turning = failure("pure_rotation", "it turns")
    assert next_rungs(RUNGS[0], turning, 0, evidence) == ()
    open_focal = failure("focal_length_undetermined", "it does not turn")
    assert next_rungs(RUNGS[0], open_focal, 20, evidence) == ()
    assert next_rungs(RUNGS[0], open_focal, 12, evidence) == RUNGS[1:]
    assert next_rungs(RUNGS[0], None, 12, evidence) == RUNGS[1:]  # more frames may be placed
    assert next_rungs(RUNGS[0], None, 20, evidence) == ()
    assert next_rungs(RUNGS[0], None, 20, evidence, disputed=True) == RUNGS[1:2]
    assert next_rungs(RUNGS[1], None, 20, evidence, disputed=True) == ()


def test_a_path_that_the_other_mapper_disputes_counts_less_than_one_that_it_does_not() -> None:
    report = {"mapper": "global", "disagreement": 0.5, "model": {"seam": 10}}
    assert is_disputed(report)
    changes = [{"disagreement": None}, {"disagreement": 0.01}, {"mapper": "incremental"}, {"model": {"seam": 60}}]
    assert not any(is_disputed(report | change) for change in [*changes, {"model": {}}, {"model": None}])
    settled, disputed, more = (
        model_rank(False, 18, 20, 0),
        model_rank(False, 20, 20, 0.3),
        model_rank(False, 20, 20, 0.5),
    )
    part, failed = model_rank(False, 12, 20, 0), model_rank(True, 20, 20, 0)
    assert settled > disputed > more > part > failed


def test_every_code_of_the_contract_is_there() -> None:
    assert set(CODES) == {*REFUSED_VIDEOS, *RARE_VIDEOS, "out_of_time"}


def test_a_pattern_is_reported_unless_the_camera_model_was_found_best() -> None:
    frames = Frames(["a.jpg"], [0], None, np.zeros((1, 2)), [(320, 240)], [None], (320, 240), 0, None, [])
    model = {"focal": 0.8, "focal_deviation": 0.01, "focal_spread": 0.0, "left_out": [], "pattern": 0.15}
    report = {"pairs": {"edges": [0.2, 0.2]}, "model": model | {"camera": "SIMPLE_RADIAL"}, "focal_held": False}
    rows = [
        capture_cautions(Path("p"), frames, report | {"lenses": choice}, focal_given=False)
        for choice in (None, {"chosen": "OPENCV_FISHEYE", "scores": {}}, {"chosen": "SIMPLE_RADIAL", "scores": {}})
    ]
    assert [len(cautions) for cautions in rows] == [1, 1, 0]
    assert "leaves a pattern in the residuals" in rows[0][0]


def test_what_another_lens_leaves_open_does_not_hide_what_the_motion_left_open() -> None:
    shape = _shape(_evidence())
    first = Mapped(failure("focal_length_undetermined", "straight ahead"), shape)
    bent = Mapped(failure("implausible_focal_length", "oblong"), shape)
    by_chance, settled = (Mapped(None, replace(shape, focal_deviation=one)) for one in (0.06, 0.01))
    assert _better_supported(first, bent) is first
    assert _better_supported(first, by_chance) is first
    assert _better_supported(first, settled) is settled
    assert _better_supported(Mapped(failure("drift", "a pattern"), shape), bent) is bent


@given(st.lists(st.sets(st.integers(0, 30)), min_size=4, max_size=8))
def test_the_weakest_seam_is_where_fewest_points_are_seen_twice_on_both_sides(seen: list[set[int]]) -> None:
    views = [SimpleNamespace(name=f"{k:03}", point_index=np.array(sorted(ids), int)) for k, ids in enumerate(seen)]
    counts = [
        sum(sum(p in ids for ids in seen[:cut]) > 1 < sum(p in ids for ids in seen[cut:]) for p in range(31))
        for cut in range(2, len(seen) - 1)
    ]
    assert weakest_seam(SimpleNamespace(views=views[::-1])) == min(counts)

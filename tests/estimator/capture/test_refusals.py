"""Captures that cannot be used, each made here and refused by its name, through the real stages."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estimator.capture.cautions import read_cautions
from estimator.capture.mapping.evidence import Evidence, ModelShape, Pair
from estimator.capture.mapping.failures import CODES
from estimator.capture.mapping.gates import UNDETERMINED, early_failure, model_failure
from estimator.command import main
from tests.made.rooms.render import NoOpenGL
from tests.made.videos import (
    Lens,
    MadeFrame,
    filmed,
    orbit,
    panning,
    room,
    still,
    straight_ahead,
    times_of,
    write_video,
)

LENS = Lens(320, 240, 250.0)
#: Two more than the fewest that are tried at all.
N = 8


def _arc(
    kind: str, seed: int, frames: int, texture: float = 1.0, blur: float = 0.0, lens: Lens = LENS
) -> Iterator[MadeFrame]:
    world = room(kind, seed, orbit(2.0, frames, seed, degrees=40.0))
    if texture == 0:
        world = replace(world, objects=())
    return filmed(world, lens, texture=texture, blur=blur)


CAPTURES = {
    "pure_rotation": lambda: filmed(room("sitting room", 7, panning(N, 60.0)), LENS),
    "static_camera": lambda: filmed(room("sitting room", 7, still(N)), LENS),
    "no_texture": lambda: _arc("sitting room", 7, N, texture=0.0),
    "too_few_frames": lambda: _arc("sitting room", 7, 3),
    "motion_blur": lambda: _arc("sitting room", 7, N, blur=36.0),
    "several_places": lambda: itertools.chain(_arc("sitting room", 7, N), _arc("bedroom", 4, N)),
    "focal_length_undetermined": lambda: filmed(room("sitting room", 7, straight_ahead(N, 0.9)), LENS),
    # a telephoto lens: 2.8 times the longer side
    "implausible_focal_length": lambda: _arc("sitting room", 7, N, lens=Lens(320, 240, 900.0)),
}


@pytest.mark.slow
@pytest.mark.parametrize("code", CAPTURES)
def test_a_capture_that_cannot_be_used_is_named(code: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        _film(CAPTURES[code](), tmp_path / "film.mp4")
    except NoOpenGL as fault:
        pytest.skip(str(fault))
    words = [str(tmp_path / "film.mp4"), "--work", str(tmp_path / "w"), "--json"]
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
    """Straight ahead no film determines it; with it, the film is used, and the result says what rests on it."""
    try:
        _film(filmed(room("sitting room", 7, straight_ahead(N, 0.9)), LENS), tmp_path / "film.mp4")
    except NoOpenGL as fault:
        pytest.skip(str(fault))
    assert main([str(tmp_path / "film.mp4"), "--work", str(tmp_path / "w"), "--focal", "250"]) == 2
    assert "--instances FILE, --detector MODEL, or --draw" in capsys.readouterr().err
    report = json.loads((tmp_path / "w" / "reconstruction.json").read_text())
    assert report["focal_held"]
    assert report["model"]["focal"] == pytest.approx(250 / 320)
    assert report["model"]["focal_deviation"] > UNDETERMINED
    (caution,) = read_cautions(tmp_path / "w")
    assert "the frames do not determine the focal length, and that of --focal is held" in caution


def _film(frames: Iterable[MadeFrame], file: Path) -> None:
    pictures = [frame.colour for frame in frames]
    write_video(file, pictures, times_of(len(pictures), rate=10.0))


def _evidence(n: int = 20) -> Evidence:
    """Frames of a walk: every frame matches the next three, with parallax."""
    generator = np.random.default_rng(0)
    pairs = [
        Pair(a, b, 300, 200, 0.4, 60.0 * (b - a), np.eye(3) + generator.normal(0, 0.02, (3, 3)))
        for a in range(n)
        for b in range(a + 1, min(a + 4, n))
    ]
    names = [f"{k:06d}.jpg" for k in range(n)]
    edges = np.tile([0.19, 0.22], (n, 1))
    return Evidence(names, np.full(n, 1500), tuple(pairs), (640, 480), edges)


def _shape(evidence: Evidence) -> ModelShape:
    n = len(evidence.names)
    return ModelShape(
        tuple(evidence.names), np.eye(n, 3), np.tile(np.eye(3), (n, 1, 1)), 4000, 9.0, 0.4, 0.8, 0.01, 0.01
    )


def test_a_good_capture_passes() -> None:
    evidence = _evidence()
    assert early_failure(evidence) is None
    assert model_failure(evidence, _shape(evidence), 0.002, focal_held=False) is None


def test_what_the_model_shows() -> None:
    evidence = _evidence()
    shape = _shape(evidence)
    refusals = {
        "pure_rotation": model_failure(evidence, replace(shape, angle_deg=0.8), 0.002, focal_held=False),
        "drift": model_failure(evidence, shape, 0.3, focal_held=False),
        "implausible_focal_length": model_failure(evidence, replace(shape, focal=2.9), 0.002, focal_held=False),
        "focal_length_changes": model_failure(evidence, replace(shape, focal_spread=0.01), 0.002, focal_held=True),
        "focal_length_undetermined": model_failure(
            evidence, replace(shape, focal_deviation=0.6), 0.002, focal_held=False
        ),
        "too_few_frames": model_failure(evidence, None, None, focal_held=False),
    }
    assert {code: refusal and refusal.code for code, refusal in refusals.items()} == {code: code for code in refusals}
    assert model_failure(evidence, replace(shape, focal=2.9, focal_deviation=0.6), 0.002, focal_held=True) is None
    assert model_failure(evidence, replace(shape, focal=2.9), 0.002, focal_held=False, stated_focal=2.8) is None
    bent = model_failure(evidence, replace(shape, lens_bend=0.4), 0.002, focal_held=True)
    assert bent is not None
    assert bent.code == "implausible_focal_length"


def test_every_code_of_the_contract_is_there() -> None:
    assert set(CODES) == {*CAPTURES, "drift", "focal_length_changes"}

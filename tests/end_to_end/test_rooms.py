"""`estimate-scale` on synthetic rooms: one reconstructed by pycolmap, the others simulated."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from metric_cli.estimate_scale.estimate import main
from tests.support.skips import skip_without
from tests.synthetic.exports import write_export
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.kinds import KINDS
from tests.synthetic.rooms.knobs import HARD, Knobs, with_knobs
from tests.synthetic.rooms.quick import quick_scene
from tests.synthetic.rooms.reconstruct import reconstruct
from tests.synthetic.rooms.render import NoOpenGL
from tests.synthetic.rooms.scene_files import write_scene

#: Maximum relative error of a scale; half of an interval is typically 20 %.
MAX_ERROR = 0.35


def estimate(scene: Path, capsys: pytest.CaptureFixture[str], *options: str) -> tuple[int, dict[str, Any]]:
    status = main([str(scene), "--json", *options])
    return status, json.loads(capsys.readouterr().out)


def true_scale(scene: Path) -> float:
    return float(json.loads((scene / "truth.json").read_text())["metres_per_unit"])


def assert_scale_is_true(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, record = estimate(scene, capsys)
    assert record["schema"] == "metric-tree/scale/1"
    assert status == {"resolved": 0, "unresolved": 3}[record["status"]]
    if status == 0:
        assert record["scale"] == pytest.approx(true_scale(scene), rel=MAX_ERROR)
        assert record["interval"]["low"] < record["scale"] < record["interval"]["high"]
    else:
        assert any(abs(mode["scale"] / true_scale(scene) - 1) < MAX_ERROR for mode in record["modes"])


@pytest.mark.slow
def test_scale_of_room_reconstructed_by_pycolmap_is_true(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with skip_without(NoOpenGL):
        truth = reconstruct(furnished_room("study", 1004, Knobs(views=12, coverage=0.6)), tmp_path, 1004, features=1500)
    assert truth.rms_m < 0.05
    assert_scale_is_true(tmp_path, capsys)


@pytest.mark.parametrize("kind", KINDS)
def test_scale_of_simulated_room_is_true(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    world = furnished_room(kind, 1005, Knobs(views=12))
    with skip_without(NoOpenGL):
        synthetic = quick_scene(world, seed=1005)
    write_scene(synthetic, world, tmp_path)
    assert_scale_is_true(tmp_path, capsys)


def test_scale_of_a_room_in_two_units_has_the_same_relative_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    world = furnished_room("sitting room", 1006, Knobs(views=10))
    ratios = []
    for seed in (1, 2):
        with skip_without(NoOpenGL):
            synthetic = quick_scene(world, Knobs(depth_noise=0.0, stray=0.0, keypoint_noise=0.0), seed=seed)
        folder = tmp_path / str(seed)
        write_scene(synthetic, world, folder)
        status, record = estimate(folder, capsys)
        assert status == 0
        ratios.append(record["scale"] / true_scale(folder))
    assert ratios[0] == pytest.approx(ratios[1], rel=0.1)


def test_scale_without_observations_equals_the_scale_with_observations(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """If all points counted as visible in all views, the scale of this room would change by 12 %."""
    knobs = with_knobs(HARD, views=16)
    world = furnished_room("study", 1100, knobs)
    with skip_without(NoOpenGL):
        synthetic = quick_scene(world, knobs, seed=1100)
    assert synthetic.scene.dense is not None
    write_scene(synthetic, world, tmp_path)
    write_export(replace(synthetic.scene, points=synthetic.scene.dense.points), "nerfstudio", tmp_path / "plain")
    _, observed = estimate(tmp_path, capsys)
    _, plain = estimate(tmp_path / "plain", capsys, "--instances", str(tmp_path / "instances.json"))
    assert plain["scale"] == pytest.approx(observed["scale"], rel=0.03)

"""Inputs with wrong results and no warning in release 1.0.0 now have right results or are unresolved."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from metric_cli.estimate_scale.estimate import main
from metric_tree.release.registry import releases

pytestmark = [
    pytest.mark.real_data,
    pytest.mark.skipif(not releases(), reason="no release is shipped yet"),
]


@pytest.fixture(scope="module")
def damaged(shared: Path) -> Path:
    folder = shared / "data" / "damaged"
    if not folder.is_dir():
        pytest.skip(f"needs {folder}")
    return folder


def estimate(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, dict[str, Any]]:
    status = main([str(argument) for argument in (*arguments, "--json")])
    return status, json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("factor", ["10000", "100000", "1e-05", "2e-05"])
def test_scale_of_objects_is_proportional_to_their_unit(
    damaged: Path, factor: str, capsys: pytest.CaptureFixture[str]
) -> None:
    _, plain = estimate(capsys, "--objects", damaged / "objects_x1.json")
    status, moved = estimate(capsys, "--objects", damaged / f"objects_x{factor}.json")
    assert status == 0
    assert moved["scale"] * float(factor) == pytest.approx(plain["scale"], rel=5e-3)
    assert moved["interval"]["low"] * float(factor) == pytest.approx(plain["interval"]["low"], rel=5e-3)
    assert moved["interval"]["high"] * float(factor) == pytest.approx(plain["interval"]["high"], rel=5e-3)


def test_interval_of_four_thousand_objects_contains_the_truth(
    damaged: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The true scale is about 1. With 4,000 objects or more, release 1.0.0 returned 1.3 with a narrow interval."""
    document = json.loads((damaged / "obj8000.json").read_text(encoding="utf-8"))
    document["objects"] = document["objects"][::2]  # all of them need 900 MB
    (tmp_path / "objects.json").write_text(json.dumps(document), encoding="utf-8")
    status, record = estimate(capsys, "--objects", tmp_path / "objects.json")
    assert status == 0
    assert record["interval"]["low"] < 1 < record["interval"]["high"]
    assert record["interval"]["high"] / record["interval"]["low"] > 1.1


@pytest.mark.parametrize("name", ["persons100_same.json", "persons100_extents.json", "five_persons_extents.json"])
def test_persons_without_a_vertical_are_unresolved(
    damaged: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """The scale depends on which side is the height, and the file does not state it."""
    status, record = estimate(capsys, "--objects", damaged / name)
    assert status == 3
    assert len(record["modes"]) > 1


@pytest.mark.parametrize(
    ("name", "code"),
    [
        ("coincident", "coincident_points"),
        ("planar_tum", "coplanar_points"),
        ("translations_zero_tum", "coincident_cameras"),
        ("collinear_tum", "collinear_points"),
    ],
)
def test_damaged_geometry_is_unresolved(
    damaged: Path, name: str, code: str, capsys: pytest.CaptureFixture[str]
) -> None:
    status = main([str(damaged / name), "--json"])
    captured = capsys.readouterr()
    result = json.loads(captured.out)
    assert (status, result["status"], result["scale"]) == (3, "unresolved", None)
    assert f"unresolved: {code}" in captured.err

"""`estimate-scale` as a user meets it: exit statuses, JSON by its schema, one line for an error."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

import pytest

from estimator.reconstructions.objects_file import SCHEMA
from metric_cli.estimate_scale.estimate import main
from tests.synthetic.small_scene import small_model

CHAIR = {"length": 1.24, "width": 1.20, "height": 2.10}  # half a metre a unit
STOOL = {"length": 0.84, "width": 0.80, "height": 1.52}


def objects_file(tmp_path: Path, *objects: dict[str, Any]) -> Path:
    path = tmp_path / "objects.json"
    path.write_text(json.dumps({"schema": SCHEMA, "objects": list(objects)}), encoding="utf-8")
    return path


def estimate(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    status = main([str(word) for word in words])
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def test_json_is_the_contract(tmp_path: Path, tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    objects = objects_file(
        tmp_path,
        {"id": "a", "category": "swivel chair", "dimensions": CHAIR, "confidence": {"length": 0.9}},
        {"id": "b", "category": "bar_stools", "dimensions": STOOL, "truncated": ["height"]},
        {"id": "c", "category": "unicorn", "dimensions": STOOL},
        {"id": "d", "category": "bar stool", "dimensions": {"height": 9.0, "length": 9.0, "width": 9.0}},
    )
    status, out, err = estimate(capsys, "--objects", objects, "--tree", tree, "--json")
    assert status == 0
    record = json.loads(out)
    assert record["schema"] == "metric-tree/scale/1"
    assert record["status"] == "resolved"
    assert record["method"] == "default"
    assert record["scale"] == pytest.approx(0.5, rel=0.05)
    assert record["interval"]["level"] == 0.9
    assert record["interval"]["low"] < record["scale"] < record["interval"]["high"]
    assert record["modes"][0]["scale"] == record["scale"]
    assert record["tree"] == {"name": "mini", "version": "0.0.1"}
    assert record["up"] is None
    assert record["assumption"] == "objects are taken as full-size, not as models or toys"
    chair, stool, unicorn, giant = record["objects"]
    assert chair["verdict"] == "used"
    assert chair["node"] == "swivel_chair.n.01"
    assert chair["used"] == ["length", "width", "height"]
    assert chair["dimensions"] == CHAIR
    assert chair["dimensions_m"]["height"] == pytest.approx(2.10 * record["scale"], rel=1e-3)
    assert chair["confidence"] == {"length": 0.9}
    assert chair["reason"] is None
    assert chair["weight"] > 0.9
    assert stool["used"] == ["length", "width"]
    assert unicorn["verdict"] == "skipped"
    assert "unicorn" in unicorn["reason"]
    assert giant["verdict"] == "outlier"
    assert giant["weight"] < 0.1
    assert "usual" in giant["reason"]
    assert any("unicorn" in line for line in record["warnings"])
    assert "unicorn" in err


def test_table_for_a_person(tmp_path: Path, tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    objects = objects_file(tmp_path, {"id": "[red]a[/red]", "category": "swivel chair", "dimensions": CHAIR})
    status, out, _ = estimate(capsys, "--objects", objects, "--tree", tree)
    assert status == 0
    assert out.startswith("scale 0.")
    assert "90% interval" in out
    assert "[red]a[/red]" in out  # an id is text, not markup
    assert "swivel chair" in out
    assert "\x1b[" not in out  # no colours into a pipe
    assert "objects are taken as full-size, not as models or toys" in " ".join(out.split())


@pytest.mark.parametrize("objects", [[], [{"category": "unicorn", "extents": [1.0]}]])
def test_unresolved_without_objects(
    tmp_path: Path, tree: Path, capsys: pytest.CaptureFixture[str], objects: list[dict[str, Any]]
) -> None:
    output = tmp_path / "result.json"
    status, out, _ = estimate(
        capsys, "--objects", objects_file(tmp_path, *objects), "--tree", tree, "--json", "--output", output
    )
    record = json.loads(out)
    assert status == 3
    assert record["status"] == "unresolved"
    assert record["scale"] is None
    assert record["interval"] is None
    assert not output.exists()


def test_unresolved_when_modes_contradict(tmp_path: Path, tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    twice = {name: 2 * value for name, value in STOOL.items()}
    objects = objects_file(
        tmp_path, {"category": "swivel chair", "dimensions": CHAIR}, {"category": "bar stool", "dimensions": twice}
    )
    status, out, err = estimate(capsys, "--objects", objects, "--tree", tree, "--json")
    record = json.loads(out)
    assert status == 3
    likely = [mode["scale"] for mode in record["modes"] if mode["mass"] > 0.25]
    assert sorted(likely) == pytest.approx([0.25, 0.5], abs=0.02)
    assert record["objects"][0]["dimensions_m"] is None
    assert "unresolved" in err


def test_output_is_the_same_json(tmp_path: Path, tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    objects = objects_file(tmp_path, {"category": "swivel chair", "dimensions": CHAIR})
    output = tmp_path / "result.json"
    status, out, _ = estimate(capsys, "--objects", objects, "--tree", tree, "--json", "--output", output)
    assert status == 0
    assert json.loads(output.read_text(encoding="utf-8")) == json.loads(out)
    assert [path.name for path in tmp_path.iterdir() if path.name.endswith(".tmp")] == []


def test_an_unresolved_scale_writes_nothing_and_says_so(
    tmp_path: Path, tree: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "objects.json"
    file.write_text(json.dumps({"schema": SCHEMA, "objects": []}))
    words = ["--objects", str(file), "--tree", str(tree), "--output", str(tmp_path / "out.json")]
    assert main([*words, "--figure", str(tmp_path / "figure.png")]) == 3
    said = capsys.readouterr().err
    assert "--output: not written: the scale is unresolved" in said
    assert "--figure: there is nothing to draw" in said
    assert [entry.name for entry in tmp_path.iterdir() if entry.is_file()] == ["objects.json"]


def test_a_crowd_of_objects_and_a_name_of_pages_are_bounded(
    tmp_path: Path, tree: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "objects.json"
    chair = {"category": "chair", "dimensions": {"height": 1.0}}
    file.write_text(json.dumps({"schema": SCHEMA, "objects": [chair] * 50_001}))
    assert main(["--objects", str(file), "--tree", str(tree)]) == 2
    assert "objects: expected at most 50,000, found 50001" in capsys.readouterr().err
    names = ["x" * 100_000, *(f"zz{row}" for row in range(60))]
    file.write_text(json.dumps({"schema": SCHEMA, "objects": [chair | {"category": name} for name in names]}))
    assert main(["--objects", str(file), "--tree", str(tree), "--quiet", "--json"]) == 3
    reasons = [item["reason"] for item in json.loads(capsys.readouterr().out)["objects"]]
    assert len(reasons[0]) < 200
    assert all("no node is called" in reason for reason in reasons)


def test_known_length_with_negative_coordinates(tmp_path: Path, tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    objects = objects_file(tmp_path, {"category": "swivel chair", "dimensions": CHAIR})
    words = ("--known-length", "0,0,0", "-1,-2,-2", "1.53")
    status, out, _ = estimate(capsys, "--objects", objects, "--tree", tree, "--json", *words)
    record = json.loads(out)
    assert status == 0
    assert record["scale"] == pytest.approx(0.51, rel=0.01)
    assert record["known_lengths"][0]["scale"] == pytest.approx(0.51)


def test_a_figure_needs_no_scene(tmp_path: Path, tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    objects = objects_file(tmp_path, {"category": "swivel chair", "dimensions": CHAIR})
    status, _, _ = estimate(capsys, "--objects", objects, "--tree", tree, "--figure", tmp_path / "f.png")
    assert status == 0
    assert (tmp_path / "f.png").read_bytes()[:4] == b"\x89PNG"


def test_leave_one_class_out(tmp_path: Path, tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    objects = objects_file(
        tmp_path, {"category": "swivel chair", "dimensions": CHAIR}, {"category": "bar stool", "dimensions": STOOL}
    )
    status, out, _ = estimate(capsys, "--objects", objects, "--tree", tree, "--json", "--leave-one-class-out")
    assert status == 0
    assert {row["name"] for row in json.loads(out)["leave_one_class_out"]} == {"swivel_chair.n.01", "mt:bar_stool"}
    _, out, _ = estimate(capsys, "--objects", objects, "--tree", tree, "--leave-one-class-out")
    assert "left out" in out


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([], "expected a SCENE or --objects FILE; found neither"),
        (["scene", "--objects", "x.json"], "found both"),
        (["--objects", "nowhere.json"], "nowhere.json: file: expected a readable file"),
        (["nowhere"], "nowhere: scene: expected a reconstruction"),
        (["--objects", "x.json", "--level", "1.5"], "--level: expected a number between 0 and 1"),
        (["--objects", "x.json", "--overlay", "f"], "--overlay: expected a SCENE"),
        (
            ["--known-length", "0,0,0", "1,1,1", "2", "scene"],
            "expected A B LENGTH, as in 0,0,0 1,0,0 37.9cm, or one FILE, with SCENE",
        ),
        (["--objects", "x.json", "--paper-lists", "d"], "--paper-lists: expected --method paper"),
        (["x", "--method", "sucar", "--known-length", "f.csv"], "--known-length: expected --method default or height"),
        (["--objects", "x.json", "--output", "no/such/folder/f.json"], "--output: expected a file in a folder"),
        (["--objects", "x.json", "--known-length", "0,0,0", "1,1,1"], "--known-length"),
        (["--objects", "x.json", "--known-length", "0,0", "1,1,1", "2"], "--known-length"),
    ],
)
def test_an_error_of_the_input_is_one_line(
    words: list[str], expected: str, tree: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, err = estimate(capsys, *words, "--tree", tree)
    assert status == 2
    assert out == ""
    assert expected in err
    assert err.count("\n") == 1
    assert "Traceback" not in err


def test_a_missing_release_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    objects = objects_file(tmp_path, {"category": "swivel chair", "dimensions": CHAIR})
    status, out, err = estimate(capsys, "--objects", objects, "--tree", tmp_path / "no-such")
    assert (status, out) == (2, "")
    assert err.count("\n") == 1


def test_an_error_of_the_program_is_one(
    tmp_path: Path, tree: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise RuntimeError("from within")

    monkeypatch.setattr("estimator.results.estimate.posterior", broken)
    objects = objects_file(tmp_path, {"category": "swivel chair", "dimensions": CHAIR})
    status, out, err = estimate(capsys, "--objects", objects, "--tree", tree)
    assert (status, out) == (1, "")
    assert "RuntimeError" in err
    assert "Traceback" not in err


def test_quiet_and_csv(tmp_path: Path, tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    formula = "=cmd|' /C calc'!A0"
    objects = objects_file(
        tmp_path,
        {"id": formula, "category": "swivel chair", "dimensions": CHAIR},
        {"id": "b", "category": "unicorn", "dimensions": CHAIR},
    )
    status, out, err = estimate(capsys, "--objects", objects, "--tree", tree, "--quiet")
    assert (status, len(out.splitlines()), err) == (0, 1, "")
    _, out, _ = estimate(capsys, "--objects", objects, "--tree", tree, "--csv")
    rows = list(csv.DictReader(io.StringIO(out)))
    assert rows[0]["id"] == f"'{formula}"
    assert float(rows[0]["height_m"]) == pytest.approx(1.05, rel=0.1)
    assert rows[1]["verdict"] == "skipped"
    assert (
        rows[0]["tier"]
        == json.loads(estimate(capsys, "--objects", objects, "--tree", tree, "--json")[1])["objects"][0]["tier"]
    )


def test_missing_pictures_are_found_out_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    small_model().write_binary(str(tmp_path))
    monkeypatch.setattr("estimator.pipeline.estimate_scene", lambda *_, **__: pytest.fail("the work was done"))
    status, _, err = estimate(capsys, tmp_path, "--overlay", tmp_path / "out")
    assert status == 2
    assert "the images of the views (specify their folder with --images)" in err


def test_a_known_length_needs_no_masks(tmp_path: Path, tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    small_model().write_binary(str(tmp_path))
    words = (tmp_path, "--tree", tree, "--json", "--known-length", "0,0,0", "0,0,2", "1.0")
    status, out, err = estimate(capsys, *words)
    assert status == 0, err
    assert json.loads(out)["scale"] == pytest.approx(0.5, rel=0.01)
    assert "no instances" in err


def test_an_input_is_never_an_output(tmp_path: Path, tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    objects = objects_file(tmp_path, {"category": "swivel chair", "dimensions": CHAIR})
    before = objects.read_bytes()
    status, out, err = estimate(capsys, "--objects", objects, "--tree", tree, "--output", objects)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert "is read in this run" in err
    status, _, err = estimate(
        capsys, "--objects", objects, "--tree", tree, "--output", tmp_path / "a.png", "--figure", tmp_path / "a.png"
    )
    assert (status, err.count("\n")) == (2, 1)
    assert objects.read_bytes() == before


@pytest.mark.parametrize(("strict", "expected"), [([], 0), (["--strict"], 3)])
def test_strict_refuses_an_uncertain_scale(
    tmp_path: Path, tree: Path, capsys: pytest.CaptureFixture[str], strict: list[str], expected: int
) -> None:
    large = {name: 3 * value for name, value in STOOL.items()}
    chair = {"category": "swivel chair", "dimensions": CHAIR}
    objects = objects_file(tmp_path, chair, chair, {"category": "bar stool", "dimensions": large})
    status, out, _ = estimate(capsys, "--objects", objects, "--tree", tree, "--json", *strict)
    assert json.loads(out)["status"] == "uncertain"
    assert status == expected

"""A region and a year, from the command line to the scale: they move it where the release knows, and only there."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import metric_tree
from estimator import EstimateOptions, MeasuredObject, ScaleEvidence, scale_of_objects
from estimator.reconstructions.objects_file import SCHEMA
from metric_cli.estimate_scale.estimate import main
from metric_cli.subcommands import main as metric_tree_main
from metric_tree.context import where_of
from tests.synthetic import minitree

MODEL = {"region": 0.4, "year": 0.2, "own": 0.1, "kin": 0.5, "years": 12.0}
#: Objects are a tenth larger in the United States; B is a third of a tenth of that.
AMERICAN = {"source": "made", "region": "US", "year": 2011.0, "offset": [0.1] * 3, "variance": [1e-4] * 3}


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    content = minitree.rows()
    (chair,) = (row for row in content["priors.parquet"] if row["node_id"] == "swivel_chair.n.01")
    chair |= {"contexts": [AMERICAN], "shared_covariance": [[0.01 * (a == b) for a in range(3)] for b in range(3)]}
    folder = tmp_path_factory.mktemp("where") / "1.0.0"
    minitree.release(folder, content, lambda manifest: manifest.update(context_model=MODEL))
    return folder


def _scale(capsys: pytest.CaptureFixture[str], tmp_path: Path, tree: Path, *words: str) -> dict[str, Any]:
    sizes = {"swivel chair": (1.24, 1.2, 2.1), "bar stool": (0.84, 0.8, 1.52)}
    objects = [
        {"category": name, "dimensions": dict(zip(("length", "width", "height"), size, strict=True))}
        for name, size in sizes.items()
    ]
    file = tmp_path / "objects.json"
    file.write_text(json.dumps({"schema": SCHEMA, "objects": objects}), encoding="utf-8")
    assert main(["--objects", str(file), "--tree", str(tree), "--json", *words]) == 0
    answer: dict[str, Any] = json.loads(capsys.readouterr().out)
    return answer


def test_the_scale_goes_where_the_objects_are_larger(tree: Path, tmp_path: Path, capsys: Any) -> None:
    plain, there, elsewhere = (
        _scale(capsys, tmp_path, tree, *words)
        for words in ([], ["--where", "region=US,year=2011"], ["--where", "region=IN"])
    )
    assert plain["scale"] < there["scale"] < 1.1 * plain["scale"]
    assert elsewhere["scale"] == pytest.approx(plain["scale"])
    assert elsewhere["interval"]["low"] == pytest.approx(plain["interval"]["low"])
    (line,) = (line for line in there["warnings"] if line.startswith("where"))
    assert "bar stool" in line
    assert "swivel chair" not in line


@pytest.mark.parametrize(("place", "where", "is_named"), [("US", None, True), ("US", "DE", False), (None, None, False)])
def test_positions_name_their_country_unless_a_place_is_given(
    tree: Path, place: str | None, where: str | None, is_named: bool
) -> None:
    chair = MeasuredObject("1", "swivel chair", np.array([1.24, 1.2, 2.1]), np.full(3, 0.03))
    gps = ScaleEvidence("gps", "exif", 0.5, 0.1, place=place)
    options = EstimateOptions(evidence=(gps,), where=None if where is None else where_of(where))
    notes = [note for note in scale_of_objects([chair], metric_tree.open(tree), options).warnings if "cameras" in note]
    assert notes == ["where: the positions of the cameras are in US: --where US applies its sizes"] * is_named


def test_a_query_says_what_the_context_changed(tree: Path, capsys: Any) -> None:
    assert metric_tree_main(["query", "swivel chair", "--tree", str(tree), "--where", "year=2011", "--json"]) == 0
    moved = json.loads(capsys.readouterr().out)
    assert "2011: length +" in moved["where"]
    assert metric_tree_main(["query", "bar stool", "--tree", str(tree), "--where", "year=2011"]) == 0
    assert "the plain prior holds" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize("words", [["--where", "region=Mars"], ["--where", "region=DE", "--method", "paper"]])
def test_a_context_that_cannot_be_used_is_one_line(tree: Path, tmp_path: Path, capsys: Any, words: list[str]) -> None:
    assert main(["--objects", str(tmp_path / "none.json"), "--tree", str(tree), *words]) == 2
    err = capsys.readouterr().err
    assert "where" in err
    assert err.count("\n") == 1

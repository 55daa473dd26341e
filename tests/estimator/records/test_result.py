"""The result as JSON and as a table."""

from __future__ import annotations

import json
import math
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estimator.records.objects import MeasuredObject
from estimator.records.options import EstimateOptions
from estimator.records.result import Alternative, Interval, ObjectReport, ScaleEvidence, ScaleResult, UpReport
from estimator.results.estimate import scale_of_objects
from estimator.results.scale_report import outlier_reason
from metric_base.errors import InputError
from metric_cli.estimate_scale.result_table import result_text
from metric_tree.tree import Tree
from tests.synthetic.priors import evidence, prior

REPORT = ObjectReport(
    id="1",
    category="chair",
    node="chair.n.01",
    points=12,
    dimensions={"length": 0.31, "width": 0.3, "height": 0.47},
    confidence={"length": 0.91, "width": math.nan},
    truncated=("height",),
    used=("length", "width"),
    scale=1.9,
    weight=0.97,
    verdict="used",
    reason=None,
)
RESULT = ScaleResult(
    status="resolved",
    method="default",
    scale=1.93,
    interval=Interval(0.9, 1.8, 2.05),
    modes=(),
    tree=("metric-tree", "1.0.0"),
    objects=(REPORT,),
    up=UpReport((0.02, -0.99, 0.05), "camera-x-axes", math.nan),
    without_support=Alternative("without_support", 2.0, 1.9, 2.1, 1),
    leave_one_class_out=(Alternative("chair.n.01", 2.2, 1.9, 2.4, 1),),
)


def test_json_has_no_nan() -> None:
    record = json.loads(RESULT.json(), parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    assert record["objects"][0]["confidence"]["width"] is None
    assert record["up"]["sigma_deg"] is None
    assert record["without_support"]["scale"] == 2.0
    assert record["objects"][0]["dimensions_m"]["length"] == pytest.approx(0.5983)


def test_save_is_whole_or_nothing(tmp_path: Path) -> None:
    RESULT.save(tmp_path / "result.json")
    assert json.loads((tmp_path / "result.json").read_text(encoding="utf-8")) == RESULT.to_json()
    with pytest.raises(FileNotFoundError):
        RESULT.save(tmp_path / "no" / "result.json")
    assert [path.name for path in tmp_path.iterdir()] == ["result.json"]


def test_table_names_everything() -> None:
    text = result_text(RESULT)
    assert text.splitlines()[0].startswith("scale 1.93 m per unit   90% interval 1.8 to 2.05")
    assert "0.60 × 0.58 × (>0.91)" in text
    assert "without support planes: 2" in text
    assert "+14.0%" in text


def test_own_scales_have_three_digits_under_one_another() -> None:
    scales = (1.0, 0.131, 0.0781, 12.3, 234.0)
    objects = tuple(replace(REPORT, id=str(place), scale=scale) for place, scale in enumerate(scales))
    lines = [line for line in result_text(replace(RESULT, objects=objects)).splitlines() if line.startswith(" chair ")][
        :5
    ]
    shown = ["1.00", "0.131", "0.0781", "12.3", "234"]
    for line, text in zip(lines, shown, strict=True):
        assert f" {text} " in line
    points = [line.index(text) + text.index(".") for line, text in zip(lines, shown, strict=True) if "." in text]
    assert len(set(points)) == 1


def test_unmeasured_objects_share_a_line() -> None:
    far = [
        replace(
            REPORT,
            id=str(n),
            dimensions={},
            used=(),
            scale=None,
            verdict="skipped",
            reason=f"{n} points, 16 needed",
            views=n,
        )
        for n in range(5)
    ]
    text = result_text(replace(RESULT, objects=(REPORT, *far)))
    assert "not measured (too few points): chair in 11 masks" in text
    assert "16 needed" not in text


def test_outlier_reason_names_the_dimension_that_is_off() -> None:
    chair = prior("chair.n.01", [(560, 540, 950)])
    low = evidence(chair, (0.56, 0.54, 0.30))
    assert outlier_reason(low.object, low.prior, 1.0, 0.7).startswith("height only 0.3 m, usual ")
    long = evidence(chair, (2.0, 0.54, 0.95))
    assert outlier_reason(long.object, long.prior, 1.0, 0.7).startswith("length 2 m, usual ")
    usual = evidence(chair, (0.56, 0.54, 0.95))
    assert "proportions" in outlier_reason(usual.object, usual.prior, 1.0, 0.7)
    stone = prior("stone.n.01", [(90, 60, 40)], dims=("extent1", "extent2", "extent3"))
    assert outlier_reason(evidence(stone, (0.06, 0.9, 0.04)).object, stone, 1.0, 0.7).startswith(
        "longest side 0.9 m, usual "
    )


def test_support_planes_are_reported_both_ways(mini: Tree) -> None:
    """A chair whose foot is unseen reaches down to the floor; without the floor it is short and the scale differs."""
    chair = MeasuredObject(
        "1",
        "swivel chair",
        np.array([1.24, 1.20, 2.1]),
        np.full(3, 0.03),
        unsupported_height=1.8,
    )
    result = scale_of_objects([chair], mini)
    assert result.scale == pytest.approx(0.5, rel=0.02)
    assert result.without_support is not None
    assert result.without_support.scale > 1.01 * 0.5
    whole = MeasuredObject("1", "swivel chair", np.array([1.24, 1.20, 2.1]), np.full(3, 0.03))
    assert scale_of_objects([whole], mini).without_support is None


def test_skipped_objects_keep_their_reason(mini: Tree) -> None:
    item = MeasuredObject("1", "bar stool", np.full(3, np.nan), np.full(3, np.nan), skipped="3 points, 16 needed")
    result = scale_of_objects([item], mini, EstimateOptions(leave_one_class_out=True))
    assert result.status == "unresolved"
    assert (result.objects[0].verdict, result.objects[0].reason) == ("skipped", "3 points, 16 needed")
    assert "unresolved: no usable object" in result.warnings


def test_names_that_may_be_meant_are_in_the_warning_and_not_in_every_row(mini: Tree) -> None:
    sizes, sigma = np.array([0.6, 0.6, 1.0]), np.full(3, 0.03)
    unknown = [MeasuredObject(str(row), "swivl chiar", sizes, sigma) for row in range(3)]
    result = scale_of_objects([MeasuredObject("9", "swivel chair", sizes, sigma), *unknown], mini)
    assert {item.reason for item in result.objects[1:]} == {"no node is called 'swivl chiar'"}
    assert sum("did you mean 'swivel chair'" in line for line in result.warnings) == 1


@pytest.mark.parametrize(
    ("changes", "is_valid"),
    [
        ({"doubt": 0.0}, True),
        ({"doubt": 0.99}, True),
        ({"doubt": 1.0}, False),
        ({"doubt": -0.01}, False),
        ({"scale": 0.0}, False),
        ({"scale": math.inf}, False),
        ({"sd_log": 0.0}, False),
        ({"sd_log": math.inf}, False),
        ({"scale": None}, False),
        ({"reason": "none"}, False),
        ({"scale": None, "sd_log": None, "reason": "none"}, True),
    ],
)
def test_evidence_has_a_positive_scale_and_error_or_a_reason(changes: dict[str, object], is_valid: bool) -> None:
    with nullcontext() if is_valid else pytest.raises(InputError, match="evidence gps"):
        ScaleEvidence(**({"kind": "gps", "id": "a", "scale": 0.5, "sd_log": 0.1} | changes))  # type: ignore[arg-type]

"""Every kind of evidence, right and wrong, alone and next to objects."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import estimator
from estimator.evidence.camera_height import CameraHeight
from estimator.evidence.depth_maps import MetricDepth
from estimator.evidence.gps import Gps
from estimator.evidence.markers import Marker
from estimator.evidence.rig_baseline import RigBaseline
from estimator.evidence.source import EvidenceSource
from estimator.pipeline import measure_objects
from estimator.records.objects import Measurements
from estimator.records.options import EstimateOptions
from estimator.records.result import ScaleEvidence
from estimator.results.estimate import scale_of_objects
from metric_base.errors import InputError
from metric_tree.tree import Tree, open_tree
from tests.synthetic import minitree
from tests.synthetic.evidence import KINDS, RIG_M, objects_of, one
from tests.synthetic.walk import Walk, synthetic_walk, with_rig


def test_every_kind_is_a_source() -> None:
    sources = (
        CameraHeight(1.5, 0.1),
        Gps("exif"),
        Marker("DICT_4X4_50", 0.1),
        MetricDepth(Path()),
        RigBaseline("", "", 1),
    )
    assert all(isinstance(source, EvidenceSource) for source in sources)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Walk:
    return with_rig(synthetic_walk(tmp_path_factory.mktemp("rig"), views=8), RIG_M)


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Tree:
    return open_tree(minitree.release(tmp_path_factory.mktemp("tree") / "mini").directory)


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_right_wrong_and_against_the_objects(kind: str, rig: Walk, tree: Tree) -> None:
    """Right it sharpens the scale, wrong by two it is believed alone, and the objects find it out."""
    shown = measure_objects(rig.scene, ())
    right, wrong = one(KINDS[kind].rows(rig, shown)), one(KINDS[kind].rows(rig, shown, factor=2.0))
    objects = objects_of(tree, ["swivel chair", "bar stool", "mouse", "trackball"], rig.scale)
    without = scale_of_objects(objects, tree)
    helped = scale_of_objects(objects, tree, EstimateOptions(evidence=(right,)))
    assert helped.scale == pytest.approx(rig.scale, rel=0.03)
    assert (helped.evidence[0].verdict, helped.evidence[0].reason) == ("used", None)
    assert _width(helped) < _width(without)

    alone = scale_of_objects((), tree, EstimateOptions(evidence=(wrong,)))
    assert alone.modes[0].scale == pytest.approx(2 * rig.scale, rel=0.06)

    against = scale_of_objects(objects, tree, EstimateOptions(evidence=(wrong,)))
    if kind == "known length":  # certain, so that the scale is unresolved
        assert (against.status, against.evidence[0].verdict) == ("unresolved", "used")
        assert any("contradict the objects" in line for line in against.warnings)
    else:
        assert against.scale == pytest.approx(rig.scale, rel=0.03)
        (row,) = against.evidence
        assert (row.verdict, row.weight < 0.1) == ("outlier", True)
        assert f"the scale by all other evidence is {against.modes[0].scale:.4g}" in str(row.reason)


def _width(result: estimator.ScaleResult) -> float:
    assert result.interval is not None
    return math.log(result.interval.high / result.interval.low)


def test_a_given_up_replaces_that_of_the_scene(walk: Walk, nothing: Measurements, mini: Tree) -> None:
    def result(up: np.ndarray) -> estimator.ScaleResult:
        return estimator.estimate_scale(walk.scene, (), mini, evidence=[CameraHeight(1.5, 0.1)], up=up)

    right, wrong = result(3 * nothing.up.vector), result(-nothing.up.vector)
    assert right.up is not None
    assert right.up.method == "given"
    assert right.up.vector == pytest.approx(nothing.up.vector)
    assert right.scale == pytest.approx(walk.scale, rel=0.02)
    assert not any("given up" in line for line in right.warnings)
    assert any("the given up points down" in line for line in wrong.warnings)


def test_an_up_that_is_no_direction(walk: Walk, mini: Tree, capsys: pytest.CaptureFixture[str]) -> None:
    from metric_cli.estimate_scale.estimate import main

    with pytest.raises(InputError, match="up: direction"):
        estimator.estimate_scale(walk.scene, (), mini, up=(0, 0, 0))
    for words in (["scene", "--up", "1,2"], ["scene", "--up", "-0,0,0"], ["--objects", "x.json", "--up", "0,0,1"]):
        assert main(words) == 2
        assert "--up: " in capsys.readouterr().err


def test_evidence_joins_a_scene(walk: Walk, mini: Tree) -> None:
    result = estimator.estimate_scale(walk.scene, (), mini, evidence=[CameraHeight(1.5, 0.05), Gps("exif")])
    assert result.scale == pytest.approx(walk.scale, rel=0.05)
    height, gps = result.evidence
    assert (height.verdict, gps.verdict) == ("used", "skipped")
    assert gps.reason == "0 views have a position, 4 needed"
    assert any("gps exif: skipped" in line for line in result.warnings)


def test_two_kinds_that_agree_are_better_than_one(walk: Walk, mini: Tree) -> None:
    def width(*evidence: ScaleEvidence) -> float:
        interval = estimator.estimate_scale(walk.scene, (), mini, evidence=evidence).interval
        assert interval is not None
        return math.log(interval.high / interval.low)

    first, second = ScaleEvidence("gps", "a", 0.40, 0.05), ScaleEvidence("marker", "b", 0.41, 0.05)
    assert width(first, second) < 0.9 * width(first)


def test_coverage_with_several_kinds() -> None:
    """Two and three kinds of evidence, one in ten wrong by a factor of two or more: the interval has its coverage."""
    from estimator.posterior.posterior import posterior

    generator = np.random.default_rng(0)
    inside = 0
    for _ in range(200):
        kinds = int(generator.integers(2, 4))
        sd = generator.uniform(0.02, 0.15, kinds)
        wrong = np.where(
            generator.random(kinds) < 0.1, generator.choice([-1, 1], kinds) * generator.uniform(0.7, 2, kinds), 0
        )
        lines = np.column_stack([generator.normal(0, sd) + wrong, sd, np.full(kinds, 0.1)])
        low, high = posterior([], lines).interval
        inside += low <= 1 <= high
    assert 0.86 * 200 <= inside <= 0.99 * 200


def test_the_options_of_the_command(walk: Walk, mini: Tree, capsys: pytest.CaptureFixture[str]) -> None:
    from metric_cli.estimate_scale.estimate import main
    from metric_cli.estimate_scale.parser import parser
    from metric_cli.estimate_scale.request import named_sources as evidence_sources

    words = ["scene", "--camera-height", "1.5+-0.1", "--gps", "exif", "--marker", "DICT_4X4_50:0.1"]
    words += ["--metric-depth", str(walk.scene.path), "--baseline", "left:right:0.12", "--images", "pictures"]
    assert evidence_sources(parser().parse_args(words)) == (
        CameraHeight(1.5, 0.1),
        Gps("exif", Path("pictures")),
        Marker("DICT_4X4_50", 0.1, images=Path("pictures")),
        MetricDepth(walk.scene.path),
        RigBaseline("left", "right", 0.12),
    )
    assert evidence_sources(parser().parse_args(["scene"])) == ()
    for wrong in (
        ["--camera-height", "tall"],
        ["--baseline", "left:right"],
        ["--marker", "x"],
        ["--gps", "no.csv"],
        ["--metric-depth", "nowhere"],
    ):
        assert main(["scene", *wrong]) == 2
        assert wrong[0] in capsys.readouterr().err
    assert main(["--objects", "file.json", "--gps", "exif"]) == 2
    assert "expected a SCENE" in capsys.readouterr().err


def test_the_printed_rows_of_evidence(walk: Walk, mini: Tree) -> None:
    from metric_cli.estimate_scale.result_table import result_text

    text = result_text(estimator.estimate_scale(walk.scene, (), mini, evidence=[CameraHeight(1.5, 0.1), Gps("exif")]))
    (height,) = (line for line in text.splitlines() if "camera" in line and "up (" not in line)
    (gps,) = (line for line in text.splitlines() if "gps" in line)
    assert "used" in height
    assert "skipped: 0 views have a position" in gps
    assert "full-size" not in text  # no object is used


def test_every_exported_source_observes() -> None:
    """The docstring of `estimate_scale` refers to `estimator.evidence`."""
    import estimator.evidence as sources

    named = {name: getattr(sources, name) for name in sources.__all__}
    assert {name for name, source in named.items() if hasattr(source, "observe")} == set(named) - {"KnownLength"}
    with pytest.raises(AttributeError, match="no attribute"):
        sources.__getattr__("Barometer")

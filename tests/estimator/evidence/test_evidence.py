"""Every kind of evidence on a made walk whose scale is known: right, wrong, mute, and beside contradicting objects."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import estimator
from estimator.evidence.alignment import align
from estimator.evidence.camera_height import PRESETS, CameraHeight
from estimator.evidence.depth_files import read_depth
from estimator.evidence.gps import Gps, local_metres
from estimator.evidence.lengths import RigBaseline, rig_baselines
from estimator.evidence.marker import Marker
from estimator.evidence.metric_depth import MetricDepth
from estimator.evidence.source import EvidenceSource
from estimator.evidence.triangulation import triangulate
from estimator.geometry.measurement import Measurements, measure_objects
from estimator.reconstructions.cameras import pixels_in_view
from estimator.records.scale_evidence import ScaleEvidence
from estimator.records.scene import Camera
from estimator.results.estimate import scale_of_objects
from estimator.results.reports import Options
from metric_base.faults import InputFault
from metric_tree.tree import Tree, open_tree
from tests.made import minitree
from tests.made.evidence import (
    KINDS,
    RIG_M,
    degrees_of,
    draw_marker,
    marker_picture,
    objects_of,
    position_table,
    write_exif,
)
from tests.made.walk import Walk, made_walk, with_rig


@pytest.fixture
def walk(tmp_path: Path) -> Walk:
    return made_walk(tmp_path)


@pytest.fixture
def nothing(walk: Walk) -> Measurements:
    return measure_objects(walk.scene, ())


def one(rows: tuple[ScaleEvidence, ...]) -> ScaleEvidence:
    (row,) = rows
    return row


def test_every_kind_is_a_source() -> None:
    sources = (
        CameraHeight(1.5, 0.1),
        Gps("exif"),
        Marker("DICT_4X4_50", 0.1),
        MetricDepth(Path()),
        RigBaseline("", "", 1),
    )
    assert all(isinstance(source, EvidenceSource) for source in sources)


# every kind, right and wrong, alone and beside objects


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Walk:
    return with_rig(made_walk(tmp_path_factory.mktemp("rig"), views=8), RIG_M)


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
    helped = scale_of_objects(objects, tree, Options(evidence=(right,)))
    assert helped.scale == pytest.approx(rig.scale, rel=0.03)
    assert (helped.evidence[0].verdict, helped.evidence[0].reason) == ("used", None)
    assert _width(helped) < _width(without)

    alone = scale_of_objects((), tree, Options(evidence=(wrong,)))
    assert alone.modes[0].scale == pytest.approx(2 * rig.scale, rel=0.06)

    against = scale_of_objects(objects, tree, Options(evidence=(wrong,)))
    if kind == "known length":  # certain, so that the scale is unresolved
        assert (against.status, against.evidence[0].verdict) == ("unresolved", "used")
        assert any("contradict the objects" in line for line in against.warnings)
    else:
        assert against.scale == pytest.approx(rig.scale, rel=0.03)
        (row,) = against.evidence
        assert (row.verdict, row.weight < 0.1) == ("outlier", True)
        assert f"all else says {against.modes[0].scale:.4g}" in str(row.reason)


def _width(result: estimator.ScaleResult) -> float:
    assert result.interval is not None
    return math.log(result.interval.high / result.interval.low)


# camera height


@pytest.mark.parametrize("scale", [0.02, 0.4, 30.0])
def test_camera_height(tmp_path: Path, scale: float) -> None:
    walk = made_walk(tmp_path, height=1.5, scale=scale)
    row = one(CameraHeight(1.5, 0.15).observe(walk.scene, measure_objects(walk.scene, ())))
    assert row.scale == pytest.approx(scale, rel=0.02)
    assert row.sd_log == pytest.approx(0.1, abs=0.02)


def test_a_camera_height_needs_a_floor(walk: Walk, nothing: Measurements) -> None:
    row = one(CameraHeight(1.5, 0.15).observe(walk.scene, replace(nothing, planes=())))
    assert (row.scale, row.reason) == (None, "no floor was found under the cameras")
    # the lowest plane is above the cameras: a table top or a ceiling, not the floor
    (floor, *_) = nothing.planes
    row = one(CameraHeight(1.5, 0.15).observe(walk.scene, replace(nothing, planes=(replace(floor, height=1e3),))))
    assert row.scale is None


def test_words_of_a_camera_height() -> None:
    assert CameraHeight.of("1.5+-0.15") == CameraHeight.of("1.5±0.15") == CameraHeight(1.5, 0.15)
    for name, (metres, sd) in PRESETS.items():
        assert CameraHeight.of(name) == CameraHeight(metres, sd)
    for word in ("", "1.5", "tall", "1.5+-0", "-1+-0.1", "nan+-1", "1+-2", "1+-inf", "1e300+-1", "1e-300+-1e-301"):
        with pytest.raises(InputFault, match=r"camera.height"):
            CameraHeight.of(word)


# GPS


def test_positions_in_metres(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    noisy = walk.metres + np.random.default_rng(1).normal(0, 0.02, walk.metres.shape)
    noisy[:3] += 40  # three positions in the next street
    row = one(Gps(position_table(tmp_path / "path.csv", walk.scene, noisy, "x y z")).observe(walk.scene, nothing))
    assert row.scale == pytest.approx(walk.scale, rel=0.01)
    assert row.sd_log == pytest.approx(0.01, abs=0.004)


def test_positions_indegrees_of(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    file = position_table(tmp_path / "path.csv", walk.scene, degrees_of(walk.metres), "lat lon alt")
    assert one(Gps(file).observe(walk.scene, nothing)).scale == pytest.approx(walk.scale, rel=0.006)


def test_positions_too_rough_for_their_path_are_mute(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    rough = walk.metres + np.random.default_rng(1).normal(0, 4.0, walk.metres.shape)
    row = one(Gps(position_table(tmp_path / "path.csv", walk.scene, rough, "x y z")).observe(walk.scene, nothing))
    assert row.scale is None
    assert row.reason is not None
    few = position_table(
        tmp_path / "few.csv", replace(walk.scene, views=walk.scene.views[:3]), walk.metres[:3], "x y z"
    )
    assert "3 views have a position" in str(one(Gps(few).observe(walk.scene, nothing)).reason)


@pytest.mark.parametrize(
    "text", ["", "name,x,y\n", "name,x,y,z\nleft/0000.png,1,2\n", "name,x,y,z\nleft/0000.png,1,2,nan\n"]
)
def test_a_damaged_table_is_one_line(walk: Walk, nothing: Measurements, tmp_path: Path, text: str) -> None:
    (tmp_path / "path.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputFault, match=r"path\.csv"):
        Gps(tmp_path / "path.csv").observe(walk.scene, nothing)


def test_pictures_in_a_folder_of_another_name(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    write_exif(walk)
    (tmp_path / "images").rename(tmp_path / "pictures")
    assert one(Gps("exif").observe(walk.scene, nothing)).scale is None
    assert one(Gps("exif", tmp_path / "pictures").observe(walk.scene, nothing)).scale is not None
    marker = Marker("DICT_4X4_50", 0.1, images=tmp_path / "pictures")
    assert one(marker.observe(walk.scene, nothing)).reason == "no marker is in two pictures or more"


def test_a_path_over_the_date_line_is_short() -> None:
    metres = local_metres(np.array([[10.0, 179.9999, 0.0], [10.0, -179.9999, 5.0]]))
    assert np.linalg.norm(metres[1]) == pytest.approx(22.4, abs=0.6)


@given(st.floats(0.01, 100), st.integers(0, 1000), st.integers(3, 30))
@settings(max_examples=40)
def test_alignment_finds_the_scale(scale: float, seed: int, count: int) -> None:
    generator = np.random.default_rng(seed)
    source = generator.standard_normal((count, 3))
    turn, _ = np.linalg.qr(generator.standard_normal((3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    alignment = align(source, scale * source @ turn.T + generator.uniform(-9, 9, 3))
    assert alignment is not None
    assert alignment.scale == pytest.approx(scale, rel=1e-6)


def test_points_at_one_place_align_with_nothing() -> None:
    assert align(np.zeros((5, 3)), np.ones((5, 3))) is None
    assert align(np.eye(3)[:2], np.eye(3)[:2]) is None


# markers


def test_a_small_marker_seen_aslant_is_not_too_large(walk: Walk, nothing: Measurements) -> None:
    """44 by 10 to 25 pixels: corners refined as a chessboard's would make it 2 to 3 % too large."""
    draw_marker(walk, marker_picture("DICT_4X4_50"), 0.3 * 520 / 400)
    row = one(Marker("DICT_4X4_50", 0.3).observe(walk.scene, nothing))
    assert row.scale == pytest.approx(walk.scale, rel=0.006)


def test_pictures_without_a_marker(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    marker = Marker("DICT_4X4_50", 0.1)
    assert one(marker.observe(walk.scene, nothing)).reason == "no picture of the scene was found"
    draw_marker(walk, np.full((50, 50), 80, dtype=np.uint8), 0.5)
    assert one(marker.observe(walk.scene, nothing)).reason == "no marker is in two pictures or more"


@pytest.mark.parametrize(
    "text",
    [
        "",
        "DICT_4X4_50",
        "NONE:0.1",
        "DICT_4X4_50:0",
        "DICT_4X4_50:x",
        "charuco:DICT_4X4_50:5:1:1",
        "charuco:DICT_4X4_50:999999x999999:.1:.05",
        "charuco:DICT_4X4_50:1x5:.1:.05",
        "charuco:DICT_4X4_50:5x7:.1:nan",
    ],
)
def test_words_of_a_marker(text: str) -> None:
    with pytest.raises(InputFault, match="--marker"):
        Marker.of(text)


def test_a_point_of_wrong_pixels_is_left_out(walk: Walk) -> None:
    views, point = walk.scene.views[:6], walk.scene.points[-1]
    pixels = np.array([pixels_in_view(view, point[None])[0][0] for view in views])
    found = triangulate(views, pixels, 0.005)
    assert found == pytest.approx(point, abs=1e-6)
    pixels[2] += 60
    assert triangulate(views, pixels, 0.005) == pytest.approx(point, abs=1e-6)
    assert triangulate(views[:1], pixels[:1], 0.005) is None
    assert triangulate([views[0], views[0]], pixels[[0, 0]], 0.005) is None, "parallel rays"


# depth maps


def test_a_folder_without_depth_maps(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    assert one(MetricDepth(tmp_path).observe(walk.scene, nothing)).scale is None
    with pytest.raises(InputFault, match="no such folder"):
        MetricDepth(tmp_path / "nowhere").observe(walk.scene, nothing)


@pytest.mark.parametrize("name", ["a.npy", "a.pfm", "a.png"])
@given(content=st.binary(max_size=300))
@example(content=b"PK\x03\x04")  # an archive's first bytes
@example(content=b"\x93NUMPY\x01\x00")
def test_damaged_depth_maps_are_one_line(tmp_path_factory: pytest.TempPathFactory, name: str, content: bytes) -> None:
    file = tmp_path_factory.mktemp("depth") / name
    file.write_bytes(content)
    with pytest.raises(InputFault, match=name):
        read_depth(file)


# a rig


def test_the_baseline_of_a_rig(walk: Walk, nothing: Measurements) -> None:
    row = one(RigBaseline("left", "right", RIG_M).observe(with_rig(walk, RIG_M).scene, nothing))
    assert row.scale == pytest.approx(walk.scale, rel=1e-6)
    assert one(RigBaseline("left", "right", RIG_M).observe(walk.scene, nothing)).scale is None


def test_the_baselines_of_colmaps_rig_configuration(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    """A file that pycolmap reads as well."""
    file = tmp_path / "rig_config.json"
    moved = {
        "image_prefix": "right/",
        "cam_from_rig_rotation": [1, 0, 0, 0],
        "cam_from_rig_translation": [-RIG_M, 0, 0],
    }
    file.write_text(json.dumps([{"cameras": [{"image_prefix": "left/", "ref_sensor": True}, moved]}]), encoding="utf-8")
    assert pycolmap.read_rig_config(file)[0].cameras[1].cam_from_rig.translation[0] == -RIG_M
    (baseline,) = rig_baselines(file)
    row = one(baseline.observe(with_rig(walk, RIG_M).scene, nothing))
    assert row.scale == pytest.approx(walk.scale, rel=1e-6)


@pytest.mark.parametrize(
    "text",
    [
        "[]",
        "{}",
        '[{"cameras": [{"image_prefix": "a/"}]}]',
        '[{"cameras": [{"image_prefix": "a/", "ref_sensor": true}, {"image_prefix": "b/"}]}]',
        '[{"cameras": [{"image_prefix": "a/", "ref_sensor": true},'
        ' {"image_prefix": "b/", "cam_from_rig_translation": [0, 0]}]}]',
    ],
)
def test_a_rig_configuration_without_a_baseline_is_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "rig_config.json").write_text(text, encoding="utf-8")
    with pytest.raises(InputFault, match=r"rig_config\.json") as fault:
        rig_baselines(tmp_path / "rig_config.json")
    assert "\n" not in str(fault.value)


# the vertical from outside


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
    from estimator.command import main

    with pytest.raises(InputFault, match="up: direction"):
        estimator.estimate_scale(walk.scene, (), mini, up=(0, 0, 0))
    for words in (["scene", "--up", "1,2"], ["scene", "--up", "-0,0,0"], ["--objects", "x.json", "--up", "0,0,1"]):
        assert main(words) == 2
        assert "--up: " in capsys.readouterr().err


# beside objects


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
    """Two and three kinds of evidence, one in ten of them wrong by a factor of two or more: the interval is honest."""
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


def test_a_distorted_camera_has_straight_rays(walk: Walk) -> None:
    from estimator.reconstructions.cameras import project, view_rays

    camera = Camera("SIMPLE_RADIAL", 640, 480, np.array([500.0, 320.0, 240.0, 0.05]))
    pixels = np.array([[100.0, 50.0], [600.0, 400.0]])
    assert project(camera, view_rays(camera, pixels)) == pytest.approx(pixels, abs=1e-3)


def test_the_options_of_the_command(walk: Walk, mini: Tree, capsys: pytest.CaptureFixture[str]) -> None:
    from estimator.command import main, parser
    from estimator.evidence.options import evidence_sources

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
    from estimator.outputs.table import result_text

    text = result_text(estimator.estimate_scale(walk.scene, (), mini, evidence=[CameraHeight(1.5, 0.1), Gps("exif")]))
    (height,) = (line for line in text.splitlines() if "camera" in line and "up (" not in line)
    (gps,) = (line for line in text.splitlines() if "gps" in line)
    assert "used" in height
    assert "skipped: 0 views have a position" in gps

"""Every kind of evidence on a made walk whose scale is known: right, wrong, mute, and beside contradicting objects."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from PIL import Image

import estimator
from estimator.evidence.alignment import align
from estimator.evidence.camera_height import PRESETS, CameraHeight
from estimator.evidence.depth_files import read_depth
from estimator.evidence.gps import Gps, local_metres
from estimator.evidence.lengths import RigBaseline
from estimator.evidence.marker import Marker
from estimator.evidence.metric_depth import NETWORK_SD, MetricDepth
from estimator.evidence.source import EvidenceSource
from estimator.evidence.triangulation import triangulate
from estimator.geometry.measurement import Measurements, measure_objects
from estimator.reconstructions.cameras import pixels_in_view
from estimator.records.scale_evidence import ScaleEvidence
from estimator.records.scene import Camera, Scene
from metric_base.faults import InputFault
from metric_tree.tree import Tree
from tests.made.walk import Walk, made_walk


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
    for word in ("", "1.5", "tall", "1.5+-0", "-1+-0.1", "nan+-1", "1+-2", "1+-inf"):
        with pytest.raises(InputFault, match=r"camera.height"):
            CameraHeight.of(word)


# GPS


def _degrees(metres: np.ndarray, lat: float = 48.2, lon: float = 16.37) -> np.ndarray:
    """Latitude, longitude, altitude about a place; the sphere of the place is enough for a test of per milles."""
    return np.column_stack(
        [
            lat + np.degrees(metres[:, 1] / 6371000.0),
            lon + np.degrees(metres[:, 0] / 6371000.0 / math.cos(math.radians(lat))),
            200 + metres[:, 2],
        ]
    )


def _table(file: Path, scene: Scene, rows: np.ndarray, columns: str) -> Path:
    with file.open("w", newline="", encoding="utf-8") as lines:
        writer = csv.writer(lines)
        writer.writerow(["name", *columns.split()])
        writer.writerows([view.name, *map(repr, map(float, row))] for view, row in zip(scene.views, rows, strict=True))
    return file


def test_positions_in_metres(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    noisy = walk.metres + np.random.default_rng(1).normal(0, 0.02, walk.metres.shape)
    noisy[:3] += 40  # three positions in the next street
    row = one(Gps(_table(tmp_path / "path.csv", walk.scene, noisy, "x y z")).observe(walk.scene, nothing))
    assert row.scale == pytest.approx(walk.scale, rel=0.01)
    assert row.sd_log == pytest.approx(0.01, abs=0.004)


def test_positions_in_degrees(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    file = _table(tmp_path / "path.csv", walk.scene, _degrees(walk.metres), "lat lon alt")
    assert one(Gps(file).observe(walk.scene, nothing)).scale == pytest.approx(walk.scale, rel=0.006)


def test_positions_too_rough_for_their_path_are_mute(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    rough = walk.metres + np.random.default_rng(1).normal(0, 4.0, walk.metres.shape)
    row = one(Gps(_table(tmp_path / "path.csv", walk.scene, rough, "x y z")).observe(walk.scene, nothing))
    assert row.scale is None
    assert row.reason is not None
    few = _table(tmp_path / "few.csv", replace(walk.scene, views=walk.scene.views[:3]), walk.metres[:3], "x y z")
    assert "3 views have a position" in str(one(Gps(few).observe(walk.scene, nothing)).reason)


def test_positions_in_the_pictures(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    (tmp_path / "images" / "left").mkdir(parents=True)
    for view, (lat, lon, alt) in zip(walk.scene.views, _degrees(walk.metres, -33.9, -70.6), strict=True):
        exif = Image.Exif()
        gps = {1: "S", 2: _sexagesimal(-lat), 3: "W", 4: _sexagesimal(-lon), 5: b"\x00", 6: float(alt)}
        exif[0x8825] = gps
        Image.new("L", (8, 6)).save(tmp_path / "images" / view.name, exif=exif)
    row = one(Gps("exif").observe(walk.scene, nothing))
    assert row.scale == pytest.approx(walk.scale, rel=0.02)


def _sexagesimal(degrees: float) -> tuple[float, float, float]:
    minutes = (degrees - int(degrees)) * 60
    return float(int(degrees)), float(int(minutes)), round((minutes - int(minutes)) * 60, 5)


@pytest.mark.parametrize(
    "text", ["", "name,x,y\n", "name,x,y,z\nleft/0000.png,1,2\n", "name,x,y,z\nleft/0000.png,1,2,nan\n"]
)
def test_a_damaged_table_is_one_line(walk: Walk, nothing: Measurements, tmp_path: Path, text: str) -> None:
    (tmp_path / "path.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputFault, match=r"path\.csv"):
        Gps(tmp_path / "path.csv").observe(walk.scene, nothing)


def test_a_path_over_the_date_line_is_short() -> None:
    metres = local_metres(np.array([[10.0, 179.9999, 0.0], [10.0, -179.9999, 5.0]]))
    assert np.linalg.norm(metres[1]) == pytest.approx(22.4, abs=0.6)


@given(st.floats(0.01, 100), st.integers(0, 1000), st.integers(3, 30))
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


def _draw_marker(walk: Walk, folder: Path, side: float, image: np.ndarray, at: float = 0.9) -> None:
    """A marker that lies flat over the middle of the hall, drawn into every picture."""
    scene, scale = walk.scene, walk.scale
    height, width = image.shape
    ratio = width / height
    corners = np.array([[-ratio, 1, 0], [ratio, 1, 0], [ratio, -1, 0], [-ratio, -1, 0]]) * side / 2 + [0, 0, at]
    metres = walk.metres
    units = np.array([view.centre for view in scene.views])
    # the similarity of the walk, from its own cameras
    a, b = metres - metres.mean(axis=0), units - units.mean(axis=0)
    left, _, right = np.linalg.svd(b.T @ a)
    turn = left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
    placed = (corners - metres.mean(axis=0)) @ turn.T / scale + units.mean(axis=0)
    edges = np.array([[0, 0], [width, 0], [width, height], [0, height]], dtype=np.float32) - 0.5
    for view in scene.views:
        pixels, _ = pixels_in_view(view, placed)
        picture = np.full((480, 640), 190, dtype=np.uint8)
        if np.isfinite(pixels).all():
            matrix = cv2.getPerspectiveTransform(edges, (pixels - 0.5).astype(np.float32))
            cv2.warpPerspective(image, matrix, (640, 480), picture, cv2.INTER_AREA, cv2.BORDER_TRANSPARENT)
        (folder / view.name).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / view.name), picture)


@pytest.mark.parametrize("name", ["DICT_4X4_50", "APRILTAG_36h11"])
def test_a_marker(walk: Walk, nothing: Measurements, tmp_path: Path, name: str) -> None:
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name.removeprefix('DICT_')}"))
    quiet = np.full((260, 260), 255, dtype=np.uint8)
    quiet[30:230, 30:230] = cv2.aruco.generateImageMarker(dictionary, 7, 200)
    _draw_marker(walk, tmp_path / "images", 0.8 * 260 / 200, quiet)
    row = one(Marker(name, 0.8).observe(walk.scene, nothing))
    assert row.id == "7"
    assert row.scale == pytest.approx(walk.scale, rel=0.02)
    wrong = one(Marker(name, 1.6).observe(walk.scene, nothing))
    assert wrong.scale == pytest.approx(2 * walk.scale, rel=0.02)


def test_a_board(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    board = cv2.aruco.CharucoBoard((5, 5), 0.3, 0.22, dictionary)
    _draw_marker(walk, tmp_path / "images", 1.5, board.generateImage((500, 500)))
    row = one(Marker.of("charuco:DICT_5X5_100:5x5:0.3:0.22").observe(walk.scene, nothing))
    assert row.id == "board"
    assert row.scale == pytest.approx(walk.scale, rel=0.01)


def test_pictures_without_a_marker(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    marker = Marker("DICT_4X4_50", 0.1)
    assert one(marker.observe(walk.scene, nothing)).reason == "no picture of the scene was found"
    _draw_marker(walk, tmp_path / "images", 0.5, np.full((50, 50), 80, dtype=np.uint8))
    assert one(marker.observe(walk.scene, nothing)).reason == "no marker is in two pictures or more"


@pytest.mark.parametrize(
    "text", ["", "DICT_4X4_50", "NONE:0.1", "DICT_4X4_50:0", "DICT_4X4_50:x", "charuco:DICT_4X4_50:5:1:1"]
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


def _write_npy(file: Path, depth: np.ndarray) -> None:
    np.save(file.with_suffix(".npy"), depth.astype(np.float32))


def _write_pfm(file: Path, depth: np.ndarray) -> None:
    header = f"Pf\n{depth.shape[1]} {depth.shape[0]}\n-1.0\n".encode()
    file.with_suffix(".pfm").write_bytes(header + depth[::-1].astype("<f4").tobytes())


def _write_png(file: Path, depth: np.ndarray) -> None:
    cv2.imwrite(str(file.with_suffix(".png")), np.round(depth * 1000).clip(0, 65535).astype(np.uint16))


@pytest.mark.parametrize("write", [_write_npy, _write_pfm, _write_png])
@pytest.mark.parametrize("factor", [1.0, 1.3])
def test_depth_maps(
    walk: Walk, nothing: Measurements, tmp_path: Path, write: Callable[[Path, np.ndarray], None], factor: float
) -> None:
    folder = tmp_path / "depth"
    folder.mkdir()
    for view in walk.scene.views[:5]:
        pixels, depths = pixels_in_view(view, walk.scene.points)
        depth = np.zeros((240, 320))  # half the resolution of the pictures
        inside = np.isfinite(pixels[:, 0])
        column, line = (pixels[inside] / 2).astype(int).T
        depth[line, column] = depths[inside] * walk.scale * factor
        write(folder / Path(view.name).name, depth)
    row = one(MetricDepth(folder).observe(walk.scene, nothing))
    assert row.scale == pytest.approx(factor * walk.scale, rel=0.02)
    assert row.sd_log == pytest.approx(NETWORK_SD, rel=0.05)


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
    shifted = []
    for view in walk.scene.views:
        beside = view.centre + 0.12 / walk.scale * view.rotation[0]
        name = view.name.replace("left", "right")
        shifted.append(replace(view, name=name, translation=-view.rotation @ beside))
    scene = replace(walk.scene, views=(*walk.scene.views, *shifted))
    row = one(RigBaseline("left", "right", 0.12).observe(scene, nothing))
    assert row.scale == pytest.approx(walk.scale, rel=1e-6)
    assert one(RigBaseline("left", "right", 0.12).observe(walk.scene, nothing)).scale is None


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
    from estimator.evidence.triangulation import view_rays
    from estimator.reconstructions.cameras import project

    camera = Camera("SIMPLE_RADIAL", 640, 480, np.array([500.0, 320.0, 240.0, 0.05]))
    pixels = np.array([[100.0, 50.0], [600.0, 400.0]])
    assert project(camera, view_rays(camera, pixels)) == pytest.approx(pixels, abs=1e-3)


def test_the_options_of_the_command(walk: Walk, mini: Tree, capsys: pytest.CaptureFixture[str]) -> None:
    from estimator.command import main, parser
    from estimator.evidence.options import evidence_sources

    words = ["scene", "--camera-height", "1.5+-0.1", "--gps", "exif", "--marker", "DICT_4X4_50:0.1"]
    words += ["--metric-depth", "depth", "--baseline", "left:right:0.12"]
    assert evidence_sources(parser().parse_args(words)) == (
        CameraHeight(1.5, 0.1),
        Gps("exif"),
        Marker("DICT_4X4_50", 0.1),
        MetricDepth(Path("depth")),
        RigBaseline("left", "right", 0.12),
    )
    assert evidence_sources(parser().parse_args(["scene"])) == ()
    for wrong in (["--camera-height", "tall"], ["--baseline", "left:right"], ["--marker", "x"]):
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

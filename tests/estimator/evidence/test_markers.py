"""Printed markers, and points triangulated from their corners."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from estimator.evidence import markers
from estimator.evidence.markers import Marker, triangulate
from estimator.projection.cameras import pixels_in_view
from estimator.records.objects import Measurements
from estimator.records.scene import Camera, View
from metric_base.errors import InputError
from tests.synthetic.evidence import draw_marker, marker_picture, one
from tests.synthetic.walk import Walk, synthetic_walk


def test_a_small_marker_seen_aslant_is_not_too_large(walk: Walk, nothing: Measurements) -> None:
    """44 by 10 to 25 pixels: corners refined as a chessboard's would make it 2 to 3 % too large."""
    draw_marker(walk, marker_picture("DICT_4X4_50"), 0.3 * 520 / 400)
    row = one(Marker("DICT_4X4_50", 0.3).observe(walk.scene, nothing))
    assert row.scale == pytest.approx(walk.scale, rel=0.006)


def test_pictures_without_a_marker(walk: Walk, nothing: Measurements, tmp_path: Path) -> None:
    marker = Marker("DICT_4X4_50", 0.1)
    assert one(marker.observe(walk.scene, nothing)).reason.startswith("no image of the scene was found")
    draw_marker(walk, np.full((50, 50), 80, dtype=np.uint8), 0.5)
    assert one(marker.observe(walk.scene, nothing)).reason == "no marker is in two or more images"


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
    with pytest.raises(InputError, match="--marker"):
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


def test_a_distorted_camera_has_straight_rays(walk: Walk) -> None:
    from estimator.projection.cameras import project, view_rays

    camera = Camera("SIMPLE_RADIAL", 640, 480, np.array([500.0, 320.0, 240.0, 0.05]))
    pixels = np.array([[100.0, 50.0], [600.0, 400.0]])
    assert project(camera, view_rays(camera, pixels)) == pytest.approx(pixels, abs=1e-3)


@pytest.mark.parametrize(("pitch", "is_used"), [(0.010, True), (0.018, False)])
def test_corners_have_reprojection_errors_of_half_a_per_cent_at_most(
    walk: Walk, nothing: Measurements, pitch: float, is_used: bool
) -> None:
    """Of two views, one is pitched after the images were drawn: half of 5 or of 9 pixels remain, of 640."""
    draw_marker(walk, marker_picture("DICT_4X4_50"), 0.6)
    still, turned = walk.scene.views[0], walk.scene.views[3]
    rotation = Rotation.from_euler("x", pitch).as_matrix() @ turned.rotation
    turned = replace(turned, rotation=rotation, translation=-rotation @ turned.centre)
    row = one(Marker("DICT_4X4_50", 0.3).observe(replace(walk.scene, views=(still, turned)), nothing))
    assert (row.scale is not None) == is_used


def test_a_charuco_board(tmp_path: Path, nothing: Measurements) -> None:
    """A board of 4 x 3 squares of half a metre, seen from a height of 2.5 m."""
    walk = synthetic_walk(tmp_path, height=2.5)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    image = cv2.aruco.CharucoBoard((4, 3), 0.5, 0.375, dictionary).generateImage((800, 600))
    draw_marker(walk, np.pad(np.asarray(image, dtype=np.uint8), 20, constant_values=255), 1.5 * 640 / 600)
    row = one(Marker.of("charuco:DICT_4X4_50:4x3:0.5:0.375").observe(walk.scene, nothing))
    assert row.id == "board"
    assert row.scale == pytest.approx(walk.scale, rel=0.01)


@pytest.mark.parametrize(("sd_log", "is_used"), [(0.99, True), (1.01, False)])
def test_a_marker_of_uncertain_size_is_not_used(
    walk: Walk, nothing: Measurements, monkeypatch: pytest.MonkeyPatch, sd_log: float, is_used: bool
) -> None:
    draw_marker(walk, marker_picture("DICT_4X4_50"), 0.3 * 520 / 400)
    align = markers.align

    def uncertain(*points: np.ndarray) -> object:
        alignment = align(*points)
        assert alignment is not None
        return replace(alignment, sd_log=sd_log)

    monkeypatch.setattr(markers, "align", uncertain)
    row = one(Marker("DICT_4X4_50", 0.3).observe(walk.scene, nothing))
    assert (row.scale is not None) is is_used


@pytest.mark.parametrize(("angle", "is_found"), [(0.0115, True), (0.0085, False)])
def test_rays_meet_at_an_angle_of_a_hundredth(angle: float, is_found: bool) -> None:
    """MIN_RAY_ANGLE, in radians, of two cameras that look the same way at a point five units ahead."""
    camera = Camera("PINHOLE", 640, 480, np.array([600.0, 600.0, 320.0, 240.0]))
    point = np.array([[0.0, 0, 5]])
    shifts = [np.zeros(3), np.array([5 * np.tan(angle), 0, 0])]
    views = [View(f"{k}", camera, np.eye(3), -shift, np.empty((0, 2)), np.empty(0)) for k, shift in enumerate(shifts)]
    pixels = np.array([pixels_in_view(view, point)[0][0] for view in views])
    found = triangulate(views, pixels, 0.005)
    assert (found is not None) == is_found
    assert found is None or found == pytest.approx(point[0])


@pytest.mark.parametrize(("sd_log", "is_used"), [(0.003, True), (0.95, True), (1.05, False)])
def test_a_marker_determines_the_scale_within_a_factor(
    sd_log: float, is_used: bool, walk: Walk, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MAX_LOG_SD of 1."""
    monkeypatch.setattr(markers, "triangulate", lambda views, *_: np.array([float(len(views)), 0, 0]))
    monkeypatch.setattr(markers, "align", lambda *_: SimpleNamespace(sd_log=sd_log, scale=2.0))
    seen = {corner: [(0, np.zeros(2)), (1, np.zeros(2))] for corner in range(4)}
    row = markers.marker_evidence("7", dict.fromkeys(range(4), np.zeros(3)), seen, walk.scene)
    assert (row is not None) == is_used
    assert row is None or row.sd_log == pytest.approx(np.hypot(sd_log, 0.005))


@pytest.mark.parametrize(("n_corners", "n_views", "is_used"), [(3, 2, True), (2, 2, False), (4, 1, False)])
def test_three_corners_of_a_marker_are_in_two_views(n_corners: int, n_views: int, is_used: bool, walk: Walk) -> None:
    place = {corner: 0.3 * markers.SQUARE[corner] for corner in range(n_corners)}
    facing = next(view for view in walk.scene.views if (view.to_camera(np.zeros((1, 3)))[:, 2] != 0).all())
    points = {corner: (place[corner] + [0, 0, 2]) @ facing.rotation + facing.centre for corner in place}
    shifted = replace(facing, translation=facing.translation + np.array([0.3, 0, 0]))
    views = (facing, shifted)
    seen = {
        corner: [(row, pixels_in_view(views[row], points[corner][None])[0][0]) for row in range(n_views)]
        for corner in place
    }
    row = markers.marker_evidence("7", place, seen, replace(walk.scene, views=views))
    assert (row is not None) == is_used
    assert row is None or row.scale == pytest.approx(1.0, rel=1e-4)


@pytest.mark.parametrize(("move", "is_found"), [(0.0, True), (9.0, True), (11.0, False)])
def test_a_corner_moves_by_a_fifth_of_the_marker(move: float, is_found: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """MAX_CORNER_MOVE of a marker of 50 pixels in a crop at its size."""
    corners = 40 + np.array([[0.0, 0], [50, 0], [50, 50], [0, 50]])
    monkeypatch.setattr(markers, "MIN_CROP_SIDE_PX", 50.0)
    found = [(7, corners - (25, 25) + (move, 0)), (8, corners)]  # the margin of the crop is 15 pixels
    monkeypatch.setattr(markers, "detect_markers", lambda *_: found)
    refined = markers.refined_corners(np.zeros((150, 150), dtype=np.uint8), None, 7, corners)
    assert (refined is not None) == is_found
    assert refined is None or refined == pytest.approx(np.add(corners, [move, 0]))


@pytest.mark.parametrize(
    ("columns", "rows", "is_valid"), [(2, 200, True), (200, 2, True), (1, 5, False), (201, 5, False), (5, 201, False)]
)
def test_a_board_has_2_to_200_squares_along_a_side(columns: int, rows: int, is_valid: bool) -> None:
    with nullcontext() if is_valid else pytest.raises(InputError, match="2 to 200 columns and rows"):
        Marker("DICT_4X4_50", 0.1, (columns, rows, 0.05))


@pytest.mark.parametrize(("side", "is_valid"), [(0.099, True), (0.1, False), (0.0, False)])
def test_a_marker_of_a_board_is_smaller_than_its_square(side: float, is_valid: bool) -> None:
    with nullcontext() if is_valid else pytest.raises(InputError, match="markers smaller than their squares"):
        Marker("DICT_4X4_50", 0.1, (5, 7, side))

"""A position on a surface without points: at the height of most points around the click."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estimator.records.objects import Up
from estimator.records.scene import Camera, Scene, View
from insertion.placement.at_pixel import placement_at_pixel
from insertion.placement.placement import PlacementError, PlacementSpace
from insertion.scene.point_cloud import ColouredPoints
from insertion.scene.supports import SupportSurfaces, support_surfaces
from metric_base.arrays import FloatArray

FOCAL, WIDTH, HEIGHT = 500.0, 640, 480
EYE = np.array([0.0, 0.0, 3.0])
#: The camera looks down: columns grow along x, rows against y.
ROTATION = np.diag([1.0, -1.0, -1.0])
CAMERA = Camera("PINHOLE", WIDTH, HEIGHT, np.array([FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2]))
VIEW = View("0.png", CAMERA, ROTATION, -ROTATION @ EYE, np.empty((0, 2)), np.empty(0, dtype=np.int64))


def _ring(height: float, count: int, turn: float = 0.0) -> FloatArray:
    """(count, 3) level points on a circle of 40 pixels around the middle of the image."""
    angle = turn + np.linspace(0, 2 * np.pi, count, endpoint=False)
    reach = 40 / FOCAL * (EYE[2] - height)
    return np.column_stack([reach * np.cos(angle), reach * np.sin(angle), np.full(count, height)])


def _space(points: FloatArray) -> PlacementSpace:
    cloud = ColouredPoints(points, np.zeros((len(points), 3), np.float32), False)
    supports = SupportSurfaces(Up(np.array([0.0, 0.0, 1.0]), "cameras", 0.0), ())
    return PlacementSpace((VIEW,), cloud, supports, (), 1.0)


@pytest.mark.parametrize("others", [0, 8])
def test_the_place_is_at_the_height_of_most_points_around_it(others: int) -> None:
    """Twelve points share a height; up to eight others have different heights."""
    heights = np.array([-0.9, -0.7, -0.5, -0.3, 1.0, 1.1, 1.2, 1.3])[:others]
    points = np.vstack([_ring(0.0, 12), *(_ring(one, 1, turn=k + 0.3) for k, one in enumerate(heights))])
    place = placement_at_pixel(_space(points), VIEW, WIDTH / 2, HEIGHT / 2, 0.1)
    assert place.support == "bare surface"
    np.testing.assert_allclose(place.position, [0, 0, 0], atol=1e-6)


def test_without_a_common_height_there_is_no_place() -> None:
    points = np.vstack([_ring(-1.0 + 0.2 * k, 1, turn=0.5 * k) for k in range(10)])
    with pytest.raises(PlacementError, match=r"no level surface was reconstructed .*--up X,Y,Z"):
        placement_at_pixel(_space(points), VIEW, WIDTH / 2, HEIGHT / 2, 0.1)


def test_what_is_nearer_at_the_click_hides_the_surface() -> None:
    points = np.vstack([_ring(0.0, 12), [[0.001 * k, 0.0, 1.5] for k in range(3)]])
    with pytest.raises(PlacementError, match=r"no level surface was reconstructed .*--up X,Y,Z"):
        placement_at_pixel(_space(points), VIEW, WIDTH / 2, HEIGHT / 2, 0.1)


@pytest.mark.parametrize(
    ("x", "y"), [(0, 0), (WIDTH, HEIGHT), (-0.1, 0), (0, -0.1), (WIDTH + 0.1, 0), (0, HEIGHT + 0.1)]
)
def test_a_position_is_in_the_image_or_on_its_border(x: float, y: float) -> None:
    is_inside = 0 <= x <= WIDTH and 0 <= y <= HEIGHT
    message = "no level surface was reconstructed" if is_inside else "expected a pixel"
    with pytest.raises(PlacementError, match=message):
        placement_at_pixel(_space(_ring(0.0, 12)), VIEW, x, y, 0.1)


def _road(points: FloatArray) -> PlacementSpace:
    """A road, seen in a patch of 2 x 2 next to the middle of the image, a wall next to it, and points elsewhere."""
    spread = np.random.default_rng(0).uniform(-1, 1, (1500, 3))
    known = np.vstack([spread * [1, 1, 0.001] - [1.5, 0, 0], spread * [0.01, 1, 1] + [-2.5, 0, 1]])
    space = _space(np.vstack([known, points]))
    scene = Scene(Path("memory"), "memory", (VIEW,), known)
    return replace(space, supports=support_surfaces(scene, space.cloud, space.supports.up))


def test_the_ground_goes_on_beside_what_was_seen_of_it() -> None:
    place = placement_at_pixel(_road(np.empty((0, 3))), VIEW, WIDTH / 2 + 20, HEIGHT / 2, 0.1)
    assert place.support == "bare surface"
    np.testing.assert_allclose(place.position, [20 / FOCAL * EYE[2], 0, 0], atol=0.02)


def test_the_ground_is_no_place_where_the_picture_shows_something_above_it() -> None:
    rising = np.vstack([_ring(0.4 + 0.05 * k, 1, turn=0.1 * k) for k in range(40)])
    with pytest.raises(PlacementError, match=r"no level surface was reconstructed .*--up X,Y,Z"):
        placement_at_pixel(_road(rising), VIEW, WIDTH / 2 + 20, HEIGHT / 2, 0.1)


def test_what_rises_a_little_beside_the_ground_does_not_take_the_place() -> None:
    """Kerbs and plants, closer than the ground by less than a tenth."""
    kerb = np.vstack([_ring(0.1 + 0.02 * k, 1, turn=0.7 * k) for k in range(10)])
    place = placement_at_pixel(_road(kerb), VIEW, WIDTH / 2 + 20, HEIGHT / 2, 0.1)
    np.testing.assert_allclose(place.position, [20 / FOCAL * EYE[2], 0, 0], atol=0.02)

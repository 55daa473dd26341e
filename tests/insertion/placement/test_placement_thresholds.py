"""Thresholds of positions, in numbers on each side: points around a pixel, level patches, free cells, tops of objects.

The camera looks down from a height of 3 with a focal length of 500 pixels, or along y.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from estimator.projection.cameras import pixels_in_view
from estimator.records.objects import SupportPlane, Up
from estimator.records.scene import Camera, Instance, View
from insertion.placement.at_pixel import level_point, placement_at_pixel
from insertion.placement.free_space import free_positions, positions_on_surface
from insertion.placement.on_category import highest_level, placement_on_category, points_of_objects
from insertion.placement.placed_object import place_objects
from insertion.placement.placement import Placement, PlacementError, PlacementSpace, heading
from insertion.request import ObjectRequest
from insertion.scene.point_cloud import ColouredPoints
from insertion.scene.supports import SupportSurfaces, Surface, free_cells, surface_of
from metric_base.arrays import BoolArray, FloatArray
from tests.synthetic.insertions import write_glb
from tests.synthetic.rooms.shapes import solid

FOCAL, WIDTH, HEIGHT, EYE_HEIGHT = 500.0, 640, 480, 3.0
X, Y = WIDTH / 2, HEIGHT / 2
UP = np.array([0.0, 0.0, 1.0])
DOWN = np.diag([1.0, -1.0, -1.0])
#: Rows of a camera that looks along y.
ALONG_Y = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])


def view(eye: Sequence[float] = (0, 0, EYE_HEIGHT), rotation: FloatArray = DOWN, focal: float = FOCAL) -> View:
    camera = Camera("PINHOLE", WIDTH, HEIGHT, np.array([focal, focal, X, Y]))
    translation = -rotation @ np.array(eye, dtype=float)
    return View("0.png", camera, rotation, translation, np.empty((0, 2)), np.empty(0, np.int64))


def surface(
    height: float = 0.0,
    shape: tuple[int, int] = (10, 10),
    cell: float = 0.1,
    centre: tuple[float, float] = (0, 0),
    sigma: float = 0.002,
    number: int = 0,
    n_points: int = 100,
    plane_cell: float = 0.5,
    obstacles: FloatArray | None = None,
) -> Surface:
    """A solid level surface; obstacles (n, 3) have heights above it."""
    origin = np.array(centre) - 0.5 * cell * np.array(shape)
    plane = SupportPlane(np.eye(3), height, sigma, n_points, origin, plane_cell, np.ones(shape, dtype=bool))
    taken = np.empty((0, 3)) if obstacles is None else obstacles
    return Surface(number, plane, origin, cell, np.ones(shape, dtype=bool), taken[:, :2], taken[:, 2])


def space(points: FloatArray, *surfaces: Surface, views: tuple[View, ...] | None = None) -> PlacementSpace:
    cloud = ColouredPoints(points, np.full((len(points), 3), 0.3, np.float32), False)
    supports = SupportSurfaces(Up(UP, "cameras", 0.0), surfaces)
    return PlacementSpace(views or (view(),), cloud, supports, (), 1.0)


def circle(n: int, radius_px: float, height: float | FloatArray) -> FloatArray:
    """(n, 3) points on a circle around the centre of the image of the camera that looks down."""
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    heights = np.broadcast_to(height, n)
    radius = radius_px / FOCAL * (EYE_HEIGHT - heights)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), heights])


def support(scene: PlacementSpace, seen: View | None = None, y: float = Y) -> str:
    """The support at a pixel, or `error`."""
    try:
        return placement_at_pixel(scene, seen or scene.views[0], X, y, 0.1).support
    except PlacementError:
        return "error"


#: Points in a corner of the image. The visibility of a cloud of many points has small cells: few points are occluded.
MANY_POINTS = np.random.default_rng(2).uniform((1.2, -1, 0), (1.7, 1, 0), (20_000, 3))


# ----------------------------------------------------------------------------------------------- points around a pixel
@pytest.mark.parametrize(
    ("n", "radius_px", "expected"),
    [(4, 13.9, "level patch"), (4, 14.1, "plane 0"), (3, 13.9, "plane 0")],
)
def test_four_points_within_14_pixels_decide_on_a_plane(n: int, radius_px: float, expected: str) -> None:
    assert support(space(circle(n, radius_px, 1.3), surface(1.0))) == expected


def test_the_nearest_40_points_decide_on_a_plane() -> None:
    """21 of 40 are on the plane, none of the first 19 and of those after the 40th."""
    points = np.vstack([circle(19, 2, 1.1), circle(21, 4, 1.0), circle(100, 6, 1.1)])
    assert support(space(points, surface(1.0))) == "plane 0"


@pytest.mark.parametrize(("depth", "expected"), [(2.19, "level patch"), (2.21, "plane 0")])
def test_points_behind_1_1_times_the_depth_are_not_on_the_front(depth: float, expected: str) -> None:
    points = np.vstack([circle(10, 5, 1.0), circle(12, 5, EYE_HEIGHT - depth)])
    assert support(space(points, surface(1.0))) == expected


@pytest.mark.parametrize(("height", "expected"), [(1.035, "plane 0"), (1.037, "bare surface")])
def test_points_are_flush_within_1_5_tolerances(height: float, expected: str) -> None:
    """The tolerance at a depth of 2 is 24 mm; a rough plane contains the points in both cases."""
    assert support(space(circle(9, 5, height), surface(1.0, sigma=0.02))) == expected


@pytest.mark.parametrize(("n_on", "n_off", "expected"), [(10, 9, "plane 0"), (9, 10, "level patch")])
def test_most_points_are_on_the_plane(n_on: int, n_off: int, expected: str) -> None:
    heights = np.concatenate([np.full(n_on, 1.0), np.full(n_off, 1.03)])
    assert support(space(circle(n_on + n_off, 5, heights), surface(1.0))) == expected


@pytest.mark.parametrize(("n_upper", "expected"), [(23, "plane 1"), (22, "plane 0")])
def test_the_nearer_plane_has_at_most_10_percent_fewer_points(n_upper: int, expected: str) -> None:
    """All 25 points are within 24 mm of the lower plane, this number of the upper one."""
    heights = np.concatenate([np.full(n_upper, 0.99), np.full(25 - n_upper, 0.975)])
    assert support(space(circle(25, 5, heights), surface(0.98), surface(1.0, number=1))) == expected


@pytest.mark.parametrize(("step", "expected"), [(0.0105, "level patch"), (0.0111, "error")])
def test_a_patch_is_level_within_0_8_percent_of_its_depth(step: float, expected: str) -> None:
    """The standard deviation of these heights is 1.48 steps, the depth 2."""
    points = circle(9, 5, np.array([1.0] + [1.0 - step, 1.0 + step] * 4))
    assert support(space(points)) == expected


def row(eye_height: float, pixel: float, focal: float = FOCAL, n: int = 9) -> FloatArray:
    """(n, 3) points on the ground, in a row of pixels below the horizon of a camera that looks along y."""
    depth = eye_height * focal / pixel
    return np.column_stack([np.linspace(-3, 3, n) / focal * depth, np.full(n, depth), np.zeros(n)])


@pytest.mark.parametrize(("slope", "expected"), [(0.049, "error"), (0.051, "level patch")])
def test_a_ray_meets_a_patch_at_a_slope_of_5_percent(slope: float, expected: str) -> None:
    level = view((0, 0, 0.1), ALONG_Y)
    assert support(space(row(0.1, FOCAL * slope)), level, Y + FOCAL * slope) == expected


@pytest.mark.parametrize(("pixel", "expected"), [(21.9, "level patch"), (22.1, "error")])
def test_a_patch_has_at_most_twice_the_depth_of_its_points(pixel: float, expected: str) -> None:
    """The ray is 11 pixels below the horizon of a wide camera."""
    level = view((0, 0, 0.1), ALONG_Y, focal=200.0)
    assert support(space(row(0.1, pixel, focal=200.0)), level, Y + 11) == expected


# ------------------------------------------------------------------------------------------------------- bare surfaces
@pytest.mark.parametrize(("n", "expected"), [(5, "error"), (6, "bare surface")])
def test_a_bare_surface_has_6_points_at_one_height(n: int, expected: str) -> None:
    assert support(space(circle(n, 40, 0.0))) == expected


@pytest.mark.parametrize(("n_below", "expected"), [(14, "bare surface"), (15, "error")])
def test_30_percent_of_the_points_that_are_not_above_share_a_height(n_below: int, expected: str) -> None:
    below = circle(n_below, 52, -0.1 * np.arange(1, n_below + 1))
    points = np.vstack([circle(6, 30, 0.0), below, MANY_POINTS])
    assert support(space(points)) == expected


@pytest.mark.parametrize(("pixel", "expected"), [(74.5, "bare surface"), (75.5, "error"), (33.8, "bare surface")])
def test_a_bare_surface_has_at_most_1_5_times_the_depth_of_its_points(pixel: float, expected: str) -> None:
    """The ray is 50 pixels below the horizon."""
    level = view((0, 0, 0.1), ALONG_Y)
    assert support(space(row(0.1, pixel)), level, Y + 50) == expected


@pytest.mark.parametrize(
    ("n", "depth", "expected"), [(3, 2.69, "error"), (3, 2.71, "bare surface"), (2, 1.5, "bare surface")]
)
def test_three_points_at_90_percent_of_the_depth_occlude_a_bare_surface(n: int, depth: float, expected: str) -> None:
    points = np.vstack([circle(40, 40, 0.0), circle(n, 1, EYE_HEIGHT - depth)])
    assert support(space(points)) == expected


@pytest.mark.parametrize(("right", "expected"), [(0.9, "bare surface"), (1.0, "error")])
def test_the_ground_is_extrapolated_by_half_its_depth(right: float, expected: str) -> None:
    """The last cell of the ground is at x = -0.55, the depth is 3."""
    scene = space(np.empty((0, 3)), surface(centre=(-1.0, 0.0)))
    try:
        found = placement_at_pixel(scene, view(), X + right / EYE_HEIGHT * FOCAL, Y, 0.1)
        assert found.surface is not None
        assert found.surface.cell == pytest.approx(0.05)  # 12 cells along six radii
        name = found.support
    except PlacementError:
        name = "error"
    assert name == expected


@pytest.mark.parametrize(("slope", "is_valid"), [(0.029, False), (0.031, True)])
def test_a_path_has_pixels_with_a_slope_of_3_percent(slope: float, is_valid: bool) -> None:
    level = view((0, 0, 0.1), ALONG_Y)
    placement = Placement(np.zeros(3), np.eye(3), np.zeros(3), "floor")
    if is_valid:
        assert level_point(placement, level, X, Y + FOCAL * slope) == pytest.approx([0, 0.1 / slope, 0])
    else:
        with pytest.raises(PlacementError, match="that show the surface"):
            level_point(placement, level, X, Y + FOCAL * slope)


# ------------------------------------------------------------------------------------------------------ free positions
def cell_at(x: float = 0.0, y: float = 0.0, cell: float = 0.01, height: float = 0.0, number: int = 0) -> Surface:
    """A surface of one cell."""
    return surface(height, (1, 1), cell, (x, y), number=number)


def n_positions(scene: PlacementSpace, height: float) -> int:
    return len(positions_on_surface(scene, scene.supports.surfaces[0], 0.002, height))


@pytest.mark.parametrize(("n_views", "n"), [(4, 1), (5, 0)])
def test_a_quarter_of_the_views_see_a_position(n_views: int, n: int) -> None:
    sees, below = view((0, -2, 0.5), ALONG_Y), view((0, -2, -0.5), ALONG_Y)
    assert n_positions(space(np.empty((0, 3)), cell_at(), views=(sees, *[below] * (n_views - 1))), 0.3) == n


@pytest.mark.parametrize(("depth", "height", "n"), [(10, 0.094, 0), (10, 0.098, 1), (1, 0.665, 1), (1, 0.68, 0)])
def test_an_object_has_1_to_70_percent_of_the_height_of_the_image(depth: float, height: float, n: int) -> None:
    """A height of 0.01 at a distance of 10 is 0.1 % of the 480 rows."""
    scene = space(np.empty((0, 3)), cell_at(), views=(view((0, -depth, 0.3), ALONG_Y),))
    assert n_positions(scene, height) == n


@pytest.mark.parametrize(("height", "planes"), [(0.393, [0]), (0.405, [0, 1])])
def test_positions_with_4_percent_of_the_height_of_the_image_are_preferred(height: float, planes: list[int]) -> None:
    """The surfaces are at distances of 10 and 10.5."""
    both = (cell_at(0.2), cell_at(-0.2, 0.5, number=1, height=-0.5))
    scene = space(np.empty((0, 3)), *both, views=(view((0, -10, 0.5), ALONG_Y),))
    assert sorted(one.plane for one in free_positions(scene, 0.002, height) if one.plane is not None) == planes


@pytest.mark.parametrize(("height", "is_left"), [(0.57, False), (0.63, True)])
def test_twice_the_height_of_an_object_is_free_above_it(height: float, is_left: bool) -> None:
    """Something is above the left 80 % of a surface, at 1.9 or 2.1 times the height of the object of 0.3."""
    x, y = np.meshgrid(np.arange(-0.95, 0.6, 0.1), np.arange(-0.95, 1, 0.1))
    over = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height)])
    one = surface(shape=(20, 20), obstacles=over)
    scene = space(np.empty((0, 3)), one, views=(view((0, -4, 2), ALONG_Y),))
    positions = [place.position[0] for _, place in positions_on_surface(scene, one, 0.1, 0.3)]
    assert (min(positions) < 0.5) == is_left


@pytest.mark.parametrize(("difference", "n"), [(0.29, 1), (0.31, 2)])
def test_planes_within_60_percent_of_a_cell_are_one_surface(difference: float, n: int) -> None:
    """Cells of the planes have a side of 0.5."""
    lower, upper = surface(shape=(3, 3), n_points=200), surface(difference, (3, 3), n_points=100, number=1)
    scene = space(np.empty((0, 3)), lower, upper, views=(view((0, -3, 1), ALONG_Y),))
    assert len({one.plane for one in free_positions(scene, 0.02, 0.3)}) == n


def test_at_most_8_positions_are_returned() -> None:
    surfaces = [surface(-0.4 * k, (6, 6), 0.2, (1.5 * k - 3, 0), number=k) for k in range(5)]
    scene = space(np.empty((0, 3)), *surfaces, views=(view((0, -8, 2), ALONG_Y),))
    assert sum(len(positions_on_surface(scene, one, 0.1, 0.4)) for one in surfaces) == 10
    assert len(free_positions(scene, 0.1, 0.4)) == 8


def test_a_position_has_60_percent_of_the_largest_clearance() -> None:
    """26 by 26 cells are free; the centre has a clearance of 13 cells, the eighth row one of 8."""
    one = surface(shape=(30, 30))
    scene = space(np.empty((0, 3)), one, views=(view((0, -9, 3), ALONG_Y),))
    first = positions_on_surface(scene, one, 0.2, 0.4)[0][1]
    assert np.round(first.position, 6).tolist() == [-0.55, -0.55, 0]


def occluders(n_front: int, n_behind: int, offset_px: float, depth_ratio: float) -> FloatArray:
    """Points around the pixel of the centre of an object of 0.3 at the origin, seen from (0, -2, 0.5)."""
    seen = view((0, -2, 0.5), ALONG_Y)
    pixels, depths = pixels_in_view(seen, np.array([[0.0, 0, 0.15]]))
    ratios = np.concatenate([np.full(n_front, depth_ratio), np.ones(n_behind)])
    x = pixels[0, 0] + offset_px * np.resize([1, -1], len(ratios))
    rays = np.column_stack([(x - X) / FOCAL, np.full(len(x), (pixels[0, 1] - Y) / FOCAL), np.ones(len(x))])
    return np.asarray(seen.centre + (rays * (ratios * depths[0])[:, None]) @ seen.rotation)


@pytest.mark.parametrize(
    ("n_front", "n_behind", "offset_px", "depth_ratio", "is_visible"),
    [
        (4, 0, 18.9, 0.84, False),
        (4, 0, 19.5, 0.84, True),  # 3 % of the width are 19.2 pixels
        (4, 0, 18.9, 0.86, True),
        (3, 0, 18.9, 0.5, True),
        (2, 2, 5.0, 0.5, False),
        (4, 5, 5.0, 0.5, True),
    ],
)
def test_half_of_four_points_in_front_occlude_a_position(
    n_front: int, n_behind: int, offset_px: float, depth_ratio: float, is_visible: bool
) -> None:
    points = occluders(n_front, n_behind, offset_px, depth_ratio)
    scene = space(points, cell_at(), views=(view((0, -2, 0.5), ALONG_Y),))
    assert n_positions(scene, 0.3) == int(is_visible)


# ----------------------------------------------------------------------------------------------------- tops of objects
def columns(index: int, first: int, last: int) -> Instance:
    """A mask over columns of pixels in a view."""
    return Instance(f"{index}-{first}", index, "box", np.ones((HEIGHT, last - first), bool), (first, 0), 1.0)


def line(n: int) -> FloatArray:
    """(n, 3) points at height 1, at pixels 200.5, 210.5, ... of the middle row."""
    x = (200.5 + 10 * np.arange(n) - X) / FOCAL * 2
    return np.column_stack([x, np.zeros(n), np.ones(n)])


@pytest.mark.parametrize(("n_views", "n_wide", "n_points"), [(5, 3, 20), (4, 2, 10)])
def test_60_percent_of_the_views_of_a_point_have_it_in_a_mask(n_views: int, n_wide: int, n_points: int) -> None:
    """The masks of some views have all 20 points, the others the first ten."""
    scene = space(line(20), views=(view(),) * n_views)
    masks = [columns(k, 195, 395 if k < n_wide else 295) for k in range(n_views)]
    assert [len(points) for points in points_of_objects(scene, masks)] == [n_points]


@pytest.mark.parametrize(("n_shared", "n_objects"), [(6, 1), (5, 2)])
def test_masks_of_one_object_share_30_percent_of_their_points(n_shared: int, n_objects: int) -> None:
    scene = space(line(40 - n_shared), views=(view(),) * 2)
    second = 195 + 10 * (20 - n_shared)
    assert len(points_of_objects(scene, [columns(0, 195, 395), columns(1, second, second + 200)])) == n_objects


def top_of_box(heights: FloatArray) -> Placement | None:
    """The placement on a box of 100 points with these heights, at pixels on the right; the support plane is at 1."""
    heights = np.random.default_rng(0).permutation(heights)
    x, y = np.meshgrid(80 + 16 * np.arange(10), 16 * np.arange(10) - 72)
    points = np.column_stack([np.array([x.ravel(), y.ravel()]).T / FOCAL * (EYE_HEIGHT - heights)[:, None], heights])
    scene = space(np.vstack([points, MANY_POINTS - [2, 0, 0]]), surface(1.0, (20, 20), plane_cell=0.1))
    try:
        return placement_on_category(scene, "box", [columns(0, 330, WIDTH)], 0.05, 0.3)
    except PlacementError:
        return None


@pytest.mark.parametrize(("n_on", "plane"), [(10, 0), (9, None)])
def test_a_top_has_10_percent_of_the_points_of_its_object(n_on: int, plane: int | None) -> None:
    found = top_of_box(np.concatenate([np.ones(n_on), np.linspace(-1, 0.9, 100 - n_on)]))
    assert (None if found is None else found.plane) == plane


@pytest.mark.parametrize(("n_above", "plane"), [(50, 0), (51, None)])
def test_half_of_the_points_of_an_object_may_be_above_its_top(n_above: int, plane: int | None) -> None:
    found = top_of_box(np.concatenate([np.ones(100 - n_above), np.linspace(1.11, 1.3, n_above)]))
    assert (None if found is None else found.plane) == plane


@pytest.mark.parametrize(("gap", "is_level"), [(0.055, True), (0.059, False)])
def test_a_level_is_6_percent_of_the_height_of_its_object_thick(gap: float, is_level: bool) -> None:
    """Two layers of 20 of 200 points; the object is 0.95 high between its 5th and 95th percentile."""
    heights = np.concatenate([np.linspace(0, 0.8, 160), np.full(20, 1.0 - gap), np.ones(20)])
    points = np.column_stack([np.random.default_rng(0).uniform(-0.3, 0.3, (200, 2)), heights])
    assert (highest_level(space(points), points, 0.1) is not None) == is_level


# ---------------------------------------------------------------------------------------- walls, extent of the surface
def wall(height: float, tilt_deg: float = 0.0) -> ColouredPoints:
    """A wall of a height at y = 0 that leans back, a floor, and a mast, which makes the scene 2 high."""
    generator = np.random.default_rng(1)
    across, rise = generator.uniform(0, 4, 800), generator.uniform(0, height, 800)
    tilt = np.radians(tilt_deg)
    on_wall = np.column_stack([across, -np.sin(tilt) * rise, np.cos(tilt) * rise])
    floor = generator.uniform((0, 0, 0), (4, 3, 0), (600, 3))
    mast = np.column_stack([np.full(60, 8.0), np.full(60, 8.0), np.linspace(1.95, 2.05, 60)])
    points = np.vstack([on_wall, floor, mast])
    return ColouredPoints(points, np.full((len(points), 3), 0.4, np.float32), True)


@pytest.mark.parametrize(
    ("height", "tilt_deg", "is_wall"), [(0.7, 0.0, False), (1.05, 0.0, True), (1.9, 9.0, True), (1.9, 14.0, False)]
)
def test_a_wall_has_40_percent_of_the_height_and_leans_by_11_5_degrees(
    height: float, tilt_deg: float, is_wall: bool
) -> None:
    place = Placement(np.array([2.0, 1.0, 0.0]), np.eye(3), np.array([2.0, 3.0, 1.5]), "floor", 0)
    if is_wall:
        assert heading(place, "wall", wall(height, tilt_deg))[0] == pytest.approx([0, 1, 0], abs=0.05)
    else:
        with pytest.raises(PlacementError, match="no tall upright surface"):
            heading(place, "wall", wall(height, tilt_deg))


@pytest.mark.parametrize(("sigma", "height", "is_obstacle"), [
    (0.1, 0.39, False), (0.1, 0.41, True), (0.002, 0.12, False), (0.002, 0.13, True),
])  # fmt: skip
def test_a_plane_is_4_standard_deviations_or_a_quarter_of_a_cell_thick(
    sigma: float, height: float, is_obstacle: bool
) -> None:
    plane = SupportPlane(np.eye(3), 0.0, sigma, 9, np.array([-2.0, -2]), 0.5, np.ones((8, 8), bool))
    found = surface_of(0, plane, space(np.array([[0.0, 0, height]])).cloud, ())
    assert len(found.obstacles) == int(is_obstacle)


def grid(low: tuple[float, float], high: tuple[float, float], step: float, height: float = 0.0) -> FloatArray:
    x, y = np.meshgrid(np.arange(low[0], high[0], step), np.arange(low[1], high[1], step))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height)])


@pytest.mark.parametrize(("depth", "is_solid"), [(0.36, True), (0.39, False)])
def test_rays_that_end_3_thicknesses_below_pass_through_a_plane(depth: float, is_solid: bool) -> None:
    """The plane is 0.125 thick; its points are at x < 0, and rays to points below cross it at x = 0.2."""
    plane = SupportPlane(np.eye(3), 0.0, 0.002, 9, np.array([-2.0, -2]), 0.5, np.ones((8, 8), bool))
    x = 0.2 * (EYE_HEIGHT + depth) / EYE_HEIGHT
    below = np.column_stack([x + 0.01 * np.arange(4), np.zeros(4), np.full(4, -depth)])
    found = surface_of(0, plane, space(np.vstack([grid((-1, -1), (0, 1), 0.1), below])).cloud, (view(),))
    assert found.contains(np.array([[-0.5, 0.0], [0.25, 0.05]])).tolist() == [True, is_solid]


def test_a_surface_ends_6_spacings_beyond_its_points() -> None:
    plane = SupportPlane(np.eye(3), 0.0, 0.002, 9, np.array([-2.0, -2]), 0.5, np.ones((8, 8), bool))
    found = surface_of(0, plane, space(grid((-1.2, -1), (0.1, 1), 0.2)).cloud, ())
    assert found.contains(np.array([[1.0, 0.0], [1.4, 0.0]])).tolist() == [True, False]


@pytest.mark.parametrize(("height", "is_free"), [(0.079, True), (0.081, False), (0.999, False), (1.0, True)])
def test_obstacles_are_8_to_100_percent_of_the_height_of_the_object(height: float, is_free: bool) -> None:
    free: BoolArray = free_cells(surface(obstacles=np.array([[0.05, 0.05, height]])), 0.01, 1.0)
    assert free[5, 5] == is_free
    assert free.sum() == (100 if is_free else 99)


# ------------------------------------------------------------------------------------------------------ placed objects
@pytest.mark.parametrize(
    ("x", "z", "n", "intersects"),
    [
        (0.0, 0.5, 3, False),  # of 10,000 points
        (0.0, 0.5, 4, True),
        (0.44, 0.5, 9, True),
        (0.46, 0.5, 9, False),
        (-0.44, 0.5, 9, True),
        (-0.46, 0.5, 9, False),
        (0.0, 0.16, 9, True),
        (0.0, 0.14, 9, False),
        (0.0, 0.94, 9, True),
        (0.0, 0.96, 9, False),
    ],
)
def test_more_than_3_of_10000_points_well_inside_an_object_are_reported(
    x: float, z: float, n: int, intersects: bool, tmp_path: Path
) -> None:
    """The object is a cube of 1 m; its foot and a margin of 5 % contain points of its support."""
    file = write_glb(solid("book", np.array([1.0, 1.0, 1.0])), tmp_path / "box.glb")
    points = np.vstack([np.tile([x, 0.0, z], (n, 1)), np.tile([0.0, 5.0, 0.0], (10_000 - n, 1))])
    scene = space(points, surface(shape=(30, 30)), views=(view((0, -5, 2), ALONG_Y),))
    (placed,) = place_objects([ObjectRequest(file, plane=0)], scene, [])
    assert placed.warnings == (("box.glb: intersects points of the scene",) if intersects else ())


@pytest.mark.parametrize(("n_views", "n_points"), [(24, 1), (25, 0)])
def test_at_most_24_views_vote_on_the_points_of_an_object(n_views: int, n_points: int) -> None:
    """Odd views and the first three others have the point in a mask; of 25 views, the odd ones are not used."""
    scene = space(line(20), views=(view(),) * n_views)
    masks = [columns(k, 195, 395 if k % 2 or k < 6 else 295) for k in range(n_views)]
    (points,) = points_of_objects(scene, masks)
    assert (len(points) - 10) // 10 == n_points

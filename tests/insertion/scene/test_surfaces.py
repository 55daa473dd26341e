"""Surfaces and places on them, in scenes of a few known planes: extents, free cells, rays, views, coordinates."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from estimator.records.objects import SupportPlane, Up
from estimator.records.scene import DenseCloud, Instance, Scene, View
from insertion.light.lamp_candidates import is_visibly_free
from insertion.placement import at_pixel, free_space, on_category
from insertion.placement.placement import Placement, PlacementError, PlacementSpace, heading, turn_about
from insertion.scene import supports as surface
from insertion.scene.frame_masks import Billboard, MaskPropagator, inverse_depth_plane, propagate_mask, static_points
from insertion.scene.pixel_box import PixelBox, labels_in_box, mask_in_box, pixels_in_mask
from insertion.scene.point_cloud import ColouredPoints, VisiblePoints, coloured_cloud, evenly_spaced
from insertion.scene.supports import SupportSurfaces, Surface
from metric_base.arrays import FloatArray
from tests.insertion.scene.test_bare_surface import CAMERA, EYE, FOCAL, HEIGHT, ROTATION, VIEW, WIDTH

UP = np.array([0.0, 0.0, 1.0])


def _plane(height: float = 0.0, cells: tuple[int, int] = (4, 4), cell: float = 0.5, points: int = 100) -> SupportPlane:
    origin = -0.5 * cell * np.array(cells)
    return SupportPlane(np.eye(3), height, 0.002, points, origin, cell, np.ones(cells, dtype=bool))


def _surface(solid: np.ndarray, cell: float = 0.1, height: float = 0.0, taken: FloatArray | None = None) -> Surface:
    taken = np.empty((0, 3)) if taken is None else taken
    origin = -0.5 * cell * np.array(solid.shape)
    return Surface(0, _plane(height), origin, cell, solid, taken[:, :2], taken[:, 2])


def _grid(low: tuple[float, float], high: tuple[float, float], height: float, step: float = 0.05) -> FloatArray:
    x, y = np.meshgrid(np.arange(low[0], high[0], step), np.arange(low[1], high[1], step))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height)])


def _space(points: FloatArray, *surfaces: Surface, views: tuple[View, ...] = (VIEW,)) -> PlacementSpace:
    cloud = ColouredPoints(points, np.full((len(points), 3), 0.3, np.float32), True)
    supports = SupportSurfaces(Up(UP, "cameras", 0.0), tuple(surfaces))
    return PlacementSpace(views, cloud, supports, (), 1.0)


def _looking(eye: tuple[float, float, float], target: tuple[float, float, float] = (0, 0, 0)) -> View:
    ahead = np.array(target, dtype=float) - eye
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, UP)
    right /= np.linalg.norm(right)
    rotation = np.array([right, np.cross(ahead, right), ahead])
    return View("look.png", CAMERA, rotation, -rotation @ np.array(eye), np.empty((0, 2)), np.empty(0, dtype=np.int64))


def test_a_surface_holds_its_solid_cells() -> None:
    solid = np.zeros((4, 6), bool)
    solid[1, 2] = solid[3, 5] = True
    one = _surface(solid, 0.5)  # from (-1, -1.5)
    at = np.array([[-0.49, -0.49], [-0.01, -0.01], [0.01, -0.3], [0.99, 1.49], [1.01, 1.4], [-1.2, 0], [np.nan, 0]])
    assert one.contains(at).tolist() == [True, True, False, True, False, False, False]
    centres = surface.cell_centres(np.array([1.0, 2.0]), 0.5, (2, 3))
    assert centres[1, 2].tolist() == [1.75, 3.25]


def test_discs_and_free_cells() -> None:
    for radius, cells in ((0.1, 5), (0.02, 1), (0.2, 13)):  # a hole of one cell takes a disc of cells
        hole = np.ones((20, 20), bool)
        hole[10, 10] = False
        taken_cells = surface.free_cells(_surface(np.ones((20, 20), bool)), radius, 1.0) & ~surface.free_cells(
            _surface(hole), radius, 1.0
        )
        assert taken_cells.sum() == cells
    solid = np.ones((20, 20), bool)
    free = surface.free_cells(_surface(solid), 0.31, 1.0)
    assert free.sum() == 14 * 14
    assert free[3:17, 3:17].all()
    taken = np.array([[0.05, 0.05, 0.5], [0.55, 0.55, 1.2], [-0.55, 0.55, 0.07]])
    rows, columns = np.indices((20, 20))
    for radius, reach in ((0.31, 3.1), (0.25, 2.5)):  # metres, cells
        around = surface.free_cells(_surface(solid, taken=taken), radius, 1.0)
        near = np.hypot(rows - 10, columns - 10) <= reach
        assert np.array_equal(around, surface.free_cells(_surface(solid), radius, 1.0) & ~near)
    assert not surface.free_cells(_surface(solid), 1.01, 1.0).any()


def test_a_surface_is_where_its_points_are_nearer_than_rays_below() -> None:
    table, floor = _grid((-0.5, -1), (0.5, 1), 1.0), _grid((-2, -2), (2, 2), 0.0)
    cloud = ColouredPoints(np.concatenate([table, floor]), np.zeros((len(table) + len(floor), 3), np.float32), True)
    views = (replace(VIEW, translation=-ROTATION @ np.array([0.0, 0.0, 4.0])),)
    plane = _plane(1.0, (8, 8), 0.5)
    one = surface.surface_of(3, plane, cloud, views)
    assert (one.number, one.cell, one.solid.shape) == (3, pytest.approx(0.5 / 3), (24, 24))
    at = np.array([[0.0, 0.0], [0.4, 0.8], [1.2, 0.0], [-1.2, 0.5]])
    assert one.contains(at).tolist() == [True, True, False, False]
    assert not len(one.obstacles)
    low = surface.surface_of(0, _plane(0.0, (8, 8), 0.5), cloud, views)
    assert len(low.obstacle_heights) == len(table)
    assert low.obstacle_heights == pytest.approx(1.0)
    none = surface.surface_of(1, _plane(2.0, (8, 8), 0.5), cloud, views)
    assert not none.solid.any()
    passing = surface._ray_crossings(plane, cloud, views, 0.3)
    inside = surface._ray_crossings(_plane(5.0), cloud, views, 0.3)
    assert len(inside) == 0
    assert np.abs(passing).max() == pytest.approx(2 * 0.75, rel=0.05)


def test_distances_are_those_of_the_third_nearest_point() -> None:
    points = np.array([[0.0, 0], [1, 0], [2, 0], [3, 0]])
    distance, spacing = surface._neighbour_distances(points, np.array([[0.0, 0.0], [1.0, 0.0]]))
    assert distance.tolist() == [2.0, 1.0]
    assert spacing == pytest.approx(2.5)


def test_a_heading_is_counted_from_the_camera_against_the_clock() -> None:
    place = Placement(np.array([1.0, 1.0, 0.0]), np.eye(3), np.array([1.0, -2.0, 5.0]), "floor", 0)
    room = ColouredPoints(np.zeros((0, 3)), np.zeros((0, 3), np.float32), True)
    assert heading(place, "camera", room)[0] == pytest.approx([0, -1, 0])
    front, angle = heading(place, 90.0, room)
    assert front == pytest.approx([1, 0, 0])
    assert angle == 90.0
    assert turn_about(np.array([1.0, 0, 0]), UP, 30.0) == pytest.approx([np.sqrt(0.75), 0.5, 0])
    above = replace(place, camera=np.array([1.0, 1.0, 5.0]))
    assert heading(above, "camera", room)[0].tolist() == [1, 0, 0]


def test_a_back_is_to_the_nearest_tall_wall() -> None:
    generator = np.random.default_rng(0)
    near, far, low = (generator.uniform(0, 1, (600, 3)) for _ in range(3))
    walls = [near * [4, 0, 2.5] + [0, 0, 0], far * [0, 4, 2.5] + [4, 0, 0], low * [4, 0, 0.4] + [0, 1.0, 0]]
    points = np.concatenate([*walls, generator.uniform(0, 4, (600, 3)) * [1, 1, 0]])
    cloud = ColouredPoints(points, np.full((len(points), 3), 0.4, np.float32), True)
    place = Placement(np.array([2.0, 1.2, 0.0]), np.eye(3), np.array([2.0, 3.0, 1.5]), "floor", 0)
    front, angle = heading(place, "wall", cloud)
    assert front == pytest.approx([0, 1, 0], abs=0.02)
    assert np.linalg.norm(front) == pytest.approx(1, abs=1e-9)
    assert angle == pytest.approx(0.0, abs=2)
    right, turned = heading(
        replace(place, position=np.array([3.5, 3.0, 0.0]), camera=np.array([3.5, 0.0, 1.5])), "wall", cloud
    )
    assert right == pytest.approx([-1, 0, 0], abs=0.02)
    assert turned == pytest.approx(-90.0, abs=2)
    flat = ColouredPoints(points[-600:], cloud.colours[-600:], True)
    with pytest.raises(PlacementError, match="no tall upright surface"):
        heading(place, "wall", flat)


def test_a_ray_meets_planes_from_above_where_they_were_seen() -> None:
    solid = np.ones((10, 10), bool)
    space = _space(np.empty((0, 3)), _surface(solid, height=1.0), _surface(solid, height=5.0))
    down = np.array([0.1, 0.0, -1.0])
    pixel = WIDTH / 2 + 0.1 * FOCAL, HEIGHT / 2  # down
    placement = at_pixel.placement_at_pixel(space, VIEW, *pixel, 0.1)
    assert (placement.plane, placement.support) == (0, "plane 0")
    assert placement.position == pytest.approx(VIEW.centre + 2.0 * down)
    beyond = WIDTH / 2 + 0.3 * FOCAL, HEIGHT / 2  # outside the solid cells: the ground is extrapolated
    assert at_pixel.placement_at_pixel(space, VIEW, *beyond, 0.1).support == "bare surface"


@pytest.mark.parametrize(("height", "plane"), [(1.0, 0), (1.02, 0), (1.03, None), (1.2, None)])
def test_the_points_around_a_pixel_decide_on_a_plane(height: float, plane: int | None) -> None:
    """At a depth of 2 m, points within 24 mm are on the plane; others are a separate level patch."""
    solid = np.ones((10, 10), bool)
    x, y = np.meshgrid(np.linspace(-0.01, 0.01, 3), np.linspace(-0.01, 0.01, 3))
    points = np.column_stack([x.ravel(), y.ravel(), np.full(9, height)])
    space = _space(points, _surface(solid, height=1.0))
    assert at_pixel.placement_at_pixel(space, VIEW, WIDTH / 2, HEIGHT / 2, 0.1).plane == plane


def test_a_place_on_a_plane_is_counted_from_its_middle() -> None:
    solid = np.zeros((20, 10), bool)
    solid[10:, :] = True  # x from 0 to 1, middle 0.5
    one = _surface(solid, height=0.7)
    space = _space(np.empty((0, 3)), one)
    place = at_pixel.placement_on_plane(space, 0, np.array([0.3, -0.2]), EYE)
    assert place.position == pytest.approx([0.8, -0.2, 0.7])
    assert (place.support, place.plane) == ("plane 0", 0)
    assert at_pixel.plane_coordinates(space, place) == pytest.approx([0.3, -0.2])
    assert at_pixel.plane_point(one, np.zeros(2)) == pytest.approx([0.5, 0.0, 0.7])
    for number, at, words in (
        (1, [0, 0], "expected 0 to 0"),
        (-1, [0, 0], "found -1"),
        (0, [-1, 0], "outside the observed part"),
    ):
        with pytest.raises(PlacementError, match=words):
            at_pixel.placement_on_plane(space, number, np.array(at, dtype=float), EYE)
    assert at_pixel.level_point(place, VIEW, WIDTH / 2 + 50, HEIGHT / 2 + 100) == pytest.approx([0.23, -0.46, 0.7])
    level = replace(VIEW, rotation=np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]))
    with pytest.raises(PlacementError, match="that show the surface"):
        at_pixel.level_point(place, level, WIDTH / 2, HEIGHT / 2)


def test_points_around_a_click_are_those_of_the_front() -> None:
    points = np.array([[0, 0, 1.0], [0.02, 0, 1.0], [0, 0.01, 1.05], [0, 0, 0.0], [0.5, 0, 1.0]])
    space = _space(points)
    near, depths = at_pixel._front_points(space, VIEW, WIDTH / 2, HEIGHT / 2)
    assert sorted(map(tuple, near.tolist())) == sorted(map(tuple, points[:3].tolist()))
    assert np.sort(depths) == pytest.approx([1.95, 2.0, 2.0])
    assert len(at_pixel._front_points(space, VIEW, 10, 10)[0]) == 0


def test_a_level_patch_is_the_top_of_a_box_and_a_slope_is_none() -> None:
    top = _grid((-0.1, -0.1), (0.1, 0.1), 0.8, 0.02)
    space = _space(top)
    place = at_pixel.placement_at_pixel(space, VIEW, WIDTH / 2, HEIGHT / 2, 0.1)
    assert place.position == pytest.approx([0, 0, 0.8])
    assert (place.support, place.plane) == ("level patch", None)
    slope = _space(np.column_stack([top[:, :2], 0.8 + top[:, 0]]))
    with pytest.raises(PlacementError, match=r"is not level; .*--up X,Y,Z"):
        at_pixel.placement_at_pixel(slope, VIEW, WIDTH / 2, HEIGHT / 2, 0.1)


def test_views_that_see_an_object_well_are_counted() -> None:
    floor = _grid((-2, -2), (2, 2), 0.0, 0.1)
    near, far, below = _looking((0, -3, 2)), _looking((0, -60, 30)), _looking((0, -3, -2))
    space = _space(floor, views=(near, far))
    points = np.array([[0.0, 0, 0], [30.0, 0, 0]])
    shares, cameras = free_space._visibility(space, points, 0.6, 0.04)
    assert shares.tolist() == [0.5, 0.0]
    assert cameras[0] == pytest.approx([0, -3, 2])
    shares, cameras = free_space._visibility(_space(floor, views=(below, near)), points, 0.6, 0.04)
    assert shares.tolist() == [0.5, 0.0]
    assert cameras[0] == pytest.approx([0, -3, 2])
    large = _space(floor, views=(near,))
    assert not free_space._visibility(large, points, 3.5, 0.04)[0].any()
    side = _looking((0.5, -3, 2), (1.5, 0, 0))
    best = free_space._visibility(_space(floor, views=(side, near)), points[:1], 0.6, 0.04)[1]
    assert best[0] == pytest.approx([0, -3, 2])
    wall = np.column_stack(
        [_grid((-1, 0), (1, 2.5), 0, 0.03)[:, 0], np.full(67 * 84, -1.0), _grid((-1, 0), (1, 2.5), 0, 0.03)[:, 1]]
    )
    hidden = _space(np.concatenate([floor, wall]), views=(near,))
    assert free_space._is_unoccluded(hidden, near, np.array([[0.0, 0.3, 0.3]])).tolist() == [False]
    assert free_space._is_unoccluded(space, near, np.array([[0.0, 0.3, 0.3]])).tolist() == [True]


def test_free_places_are_in_the_open_and_apart() -> None:
    floor = _grid((-2, -2), (2, 2), 0.0, 0.1)
    solid = np.ones((30, 30), bool)
    space = _space(floor, _surface(solid, 0.1), views=(_looking((0, -3, 3)),))
    scored = free_space.positions_on_surface(space, space.supports.surfaces[0], 0.2, 0.4)
    assert len(scored) == 2
    assert scored[0][0] == pytest.approx(np.sqrt(900) * 0.1)
    first, second = (place.position for _, place in scored)
    assert np.linalg.norm(first - second) > 3 * 0.2
    assert (first[2], second[2]) == (0, 0)
    assert np.abs(first[:2]).max() < 0.7  # in the middle of the free space
    mask = np.zeros((30, 30), bool)
    mask[20:28, 3:9] = True
    (_, place), *_ = free_space.positions_on_surface(space, space.supports.surfaces[0], 0.2, 0.4, mask)
    row, column = ((place.position[:2] + 1.5) / 0.1).astype(int)
    assert mask[row, column]
    assert place.support == "plane 0"
    assert free_space.positions_on_surface(space, _surface(np.zeros((30, 30), bool)), 0.2, 0.4) == []
    assert len(free_space.free_positions(space, 0.2, 0.4)) == 2


def test_a_top_is_within_the_outline_of_its_points() -> None:
    one = _surface(np.ones((20, 20), bool))
    mask = on_category.outline_mask(one, np.array([[-0.5, -0.3], [0.5, -0.3], [0.5, 0.3], [-0.5, 0.3]]))
    rows, columns = np.nonzero(mask)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (5, 15, 7, 13)
    assert mask.sum() == 11 * 7


def _item(view: int, origin: tuple[int, int], shape: tuple[int, int], name: str = "box") -> Instance:
    return Instance(f"{name}{view}", view, name, np.ones(shape, bool), origin, 1.0)


def test_points_of_an_object_are_in_most_of_its_masks() -> None:
    pixels = np.array([[10.5, 10.5], [12.0, 10.0], [5.0, 11.0]])
    assert pixels_in_mask(_item(0, (10, 10), (2, 2)), pixels).tolist() == [True, False, False]
    box = _grid((-0.3, -0.3), (0.3, 0.3), 0.5, 0.05)
    other = _grid((0.8, -0.3), (1.4, 0.3), 0.5, 0.05)
    views = (VIEW, replace(VIEW, name="1", translation=-ROTATION @ np.array([0.2, 0, 3.0])))
    space = _space(np.concatenate([box, other]), views=views)

    def mask(view: int, low: float, high: float) -> Instance:
        shift = 0.2 * view
        columns = [int(WIDTH / 2 + FOCAL * (x - shift) / 2.5) for x in (low, high)]
        return _item(view, (columns[0], 170), (140, columns[1] - columns[0]))

    items = [mask(v, low, high) for v in (0, 1) for low, high in ((-0.33, 0.31), (0.77, 1.41))]
    objects = on_category.points_of_objects(space, items)
    assert [len(points) for points in objects] == [len(box), len(other)]
    (alone,) = on_category.points_of_objects(space, items[:1])
    assert len(alone) == len(box), "one mask of one view is enough"
    level = on_category.highest_level(space, np.concatenate([box, box - [0, 0, 0.3]]), 0.1)
    assert level is not None
    assert level[0].plane.height == pytest.approx(0.5, abs=0.01)
    assert level[1].any()


@pytest.mark.parametrize(("n_level", "is_level"), [(28, False), (32, True)])
def test_a_level_has_15_percent_of_the_points_of_its_object(n_level: int, is_level: bool) -> None:
    heights = np.concatenate([np.linspace(0, 0.9, 200 - n_level), np.ones(n_level)])
    points = np.column_stack([np.random.default_rng(0).uniform(-0.3, 0.3, (200, 2)), heights])
    level = on_category.highest_level(_space(points), points, 0.1)
    assert (level is not None) == is_level
    if level is not None:
        assert level[0].plane.height == 1.0


def test_masks_over_boxes_of_pixels() -> None:
    box = PixelBox(10, 20, 16, 26)
    mask = mask_in_box(_item(0, (14, 18), (5, 8)), box)
    assert mask is not None
    assert np.argwhere(mask).min(axis=0).tolist() == [0, 4]
    assert mask.sum() == 3 * 2
    assert mask_in_box(_item(0, (16, 20), (5, 5)), box) is None
    labels = labels_in_box([_item(0, (14, 18), (5, 8)), _item(0, (12, 20), (2, 3))], box)
    assert labels[:, 2:].max(axis=0).tolist() == [2, 2, 2, 1]
    assert (labels[0, 4], labels[0, 0], labels[3, 4]) == (2, 0, 0)


def test_rows_are_spread_evenly() -> None:
    assert evenly_spaced(tuple(range(10, 20)), 4) == [10, 13, 16, 19]
    assert evenly_spaced((5, 7), 4) == [5, 7]
    assert evenly_spaced((5, 7, 9), 1) == [5]


def _seen(pixels: FloatArray, depths: FloatArray) -> VisiblePoints:
    return VisiblePoints(np.arange(len(pixels)), pixels, depths, True)


def test_inverse_depth_is_a_plane_over_a_mask() -> None:
    generator = np.random.default_rng(0)
    pixels = generator.uniform(0, 40, (60, 2))
    flat = (pixels - 20) / 100
    depths = 1 / (0.5 + 0.4 * flat[:, 0] - 0.2 * flat[:, 1])
    item = _item(0, (0, 0), (40, 40))
    plane = inverse_depth_plane(item, _seen(pixels, depths), flat)
    assert plane is not None
    assert plane == pytest.approx([0.5, 0.4, -0.2], abs=0.06)
    assert inverse_depth_plane(item, _seen(pixels[:5], depths[:5]), flat[:5]) is None
    strays = np.where(np.arange(60) < 6, 10.0, depths)
    robust = inverse_depth_plane(item, _seen(pixels, strays), flat)
    assert robust == pytest.approx(plane, abs=0.04)
    mixed = inverse_depth_plane(item, _seen(pixels[:8], np.array([1, 1, 1, 1, 4, 8, 16, 32.0])), flat[:8])
    assert mixed is not None
    assert mixed[1:].tolist() == [0, 0]
    beside = inverse_depth_plane(replace(item, origin=(100, 100)), _seen(pixels, depths), flat)
    assert beside is None


def test_an_outline_is_carried_over_its_plane() -> None:
    """A floor seen from straight above: the other camera is moved by 0.3, and half a metre higher."""
    other = replace(VIEW, translation=-ROTATION @ np.array([0.3, 0.0, 3.5]))
    item = _item(0, (300, 200), (60, 40))
    moved = propagate_mask(item, VIEW, other, np.array([1 / 3, 0.0, 0.0]))
    assert moved is not None
    x, y = (np.array([[300.5, 200.5], [339.5, 259.5]]) - [320, 240]).T / FOCAL * 3.0
    low, high = np.column_stack([320 + FOCAL * (x - 0.3) / 3.5, 240 + FOCAL * y / 3.5])
    assert moved.origin == tuple(np.floor(low).astype(int))
    assert moved.mask.shape[::-1] == tuple(np.ceil(high).astype(int) + 1 - np.floor(low).astype(int))
    assert propagate_mask(item, VIEW, other, np.array([-0.1, 0, 0])) is None
    floor = _grid((-1, -1), (1, 1), 0.0, 0.05)
    cloud = ColouredPoints(floor, np.zeros((len(floor), 3), np.float32), True)
    scene = Scene(Path("memory"), "memory", (VIEW,), floor)
    carrier = MaskPropagator(scene, {0: [_item(0, (300, 200), (60, 40))]}, cloud)
    assert carrier.masks(0, VIEW)[0].origin == (300, 200)
    (carried,) = carrier.masks(None, other)
    left, top = 320 + FOCAL * (-20 / FOCAL * 3 - 0.3) / 3.5, 240 + FOCAL * (-40 / FOCAL * 3) / 3.5
    assert carried.origin == pytest.approx((left, top), abs=1.6)
    assert carried.mask.shape == pytest.approx((60 * 3 / 3.5, 40 * 3 / 3.5), abs=2.6)
    assert carried.mask.mean() > 0.9
    far = replace(VIEW, translation=-ROTATION @ np.array([3.0, 0.0, 3.0]))
    assert carrier.masks(None, far) == ()


def test_a_mask_of_which_a_part_is_behind_is_not_carried() -> None:
    two = np.zeros((20, 400), bool)
    two[:, :20] = two[:, -20:] = True
    item = replace(_item(0, (120, 200), two.shape), mask=two)
    left = np.array([0.1, -0.3, 0.0])  # inverse depth 0 a third of a focal length right of the middle
    assert propagate_mask(item, VIEW, VIEW, np.array([0.5, -0.3, 0.0])) is not None
    assert propagate_mask(item, VIEW, VIEW, left) is None


def test_what_moves_hides_by_its_upright_plane() -> None:
    item = _item(0, (310, 230), (20, 20))
    upright = Billboard(item, np.array([0.0, 0.0, 1.0]), 2.0)
    box = PixelBox(300, 220, 340, 260)
    behind = np.full(box.shape, 3.0, np.float32)
    behind[:, 20:] = 1.5
    hidden = upright.occludes(box, VIEW, behind)
    assert hidden[10:30, 10:20].all()
    assert hidden.sum() == 200
    slanted = Billboard(item, np.array([10.0, 0.0, 1.0]), 2.0).occludes(box, VIEW, np.full(box.shape, 1.8, np.float32))
    assert slanted[15, 10:].tolist() == [((k + 310.5 - 320) / FOCAL * 10 + 1) * 1.8 > 2.0 and k < 20 for k in range(30)]
    front = VisiblePoints(
        np.arange(3),
        np.array([[311.0, 231.0], [309.9, 231.0], [329.9, 249.9]]),
        np.ones(3),
        False,
        np.array([True, False, True]),
    )
    beside = static_points(front, [item])
    assert (beside.rows.tolist(), beside.observed) == ([1], np.array([False]))
    assert static_points(front, []) is front


def test_a_cloud_has_the_mean_colour_of_the_stills_that_see_it() -> None:
    points = np.array([[0.0, 0, 0], [0.5, 0, 0], [9.0, 0, 0]])
    views = (VIEW, replace(VIEW, name="1", translation=-ROTATION @ np.array([0.5, 0, 3.0])))
    scene = Scene(Path("memory"), "memory", views, points)
    pictures = [np.full((HEIGHT, WIDTH, 3), level, np.uint8) for level in (0, 255)]
    pictures[1][:, : WIDTH // 2] = (255, 0, 0)
    images = SimpleNamespace(scene=scene, rows=(0, 1), image=lambda row: pictures[row])
    cloud = coloured_cloud(scene, images)  # type: ignore[arg-type]
    assert not cloud.dense
    assert cloud.colours[0] == pytest.approx([0.5, 0, 0])
    assert cloud.colours[1] == pytest.approx([0.5, 0.5, 0.5])
    assert np.isnan(cloud.colours[2]).all()


@pytest.mark.parametrize("is_complete", [False, True])
def test_stray_points_are_removed_if_it_is_known_which_views_see_all_points(is_complete: bool) -> None:
    """Three views see a floor through a point above it, which no view lists."""
    floor, stray = _grid((-1, -1), (1, 1), 0.0, 0.02), np.array([[0.0, 0.0, 1.0]])
    listed = np.arange(len(floor), dtype=np.int64)
    views = tuple(replace(VIEW, name=str(k), keypoints=np.zeros((len(floor), 2)), point_index=listed) for k in range(3))
    dense = None
    points = np.vstack([floor, stray])
    if is_complete:
        offsets = np.append(np.arange(len(floor) + 1) * 3, 3 * len(floor))
        dense = DenseCloud(points, offsets, np.tile(np.arange(3), len(floor)))
    scene = Scene(Path("memory"), "memory", views, points, dense)
    picture = np.full((HEIGHT, WIDTH, 3), 128, np.uint8)
    images = SimpleNamespace(scene=scene, rows=(0,), image=lambda row: picture)
    cloud = coloured_cloud(scene, images)  # type: ignore[arg-type]
    assert (cloud.points[:, 2] == 1).any() != is_complete


@pytest.mark.parametrize("bright", [False, True])
def test_what_a_picture_looks_through_is_empty_unless_it_is_dazzled(bright: bool) -> None:
    floor = _grid((-1, -1), (1, 1), 0.0, 0.05)
    scene = Scene(Path("memory"), "memory", (VIEW,), floor)
    picture = np.full((HEIGHT, WIDTH, 3), 244, np.uint8)
    if bright:
        picture[HEIGHT // 2 + 10, WIDTH // 2 - 10] = (0, 245, 0)
    images = SimpleNamespace(scene=scene, rows=(0,), image=lambda row: picture)
    cloud = ColouredPoints(floor, np.zeros((len(floor), 3), np.float32), True)
    high, low, beside, above = [0, 0, 1.0], [0, 0, 0.25], [0.0, 5.0, 1.0], [0, 0, 4.0]
    places = np.array([high, low, beside, above, [0.5, 0.3, 1.0]])
    assert is_visibly_free(places, cloud, images).tolist() == [not bright, False, False, False, True]  # type: ignore[arg-type]
    far = ColouredPoints(floor[np.abs(floor[:, 0]) > 0.5], cloud.colours, True)
    assert is_visibly_free(places[:1], far, images).tolist() == [False]  # type: ignore[arg-type]


@pytest.mark.parametrize(("step", "is_carried"), [(0.34, True), (0.36, False)])
def test_masks_are_carried_to_views_within_a_third_of_the_depth(step: float, is_carried: bool) -> None:
    """The camera looks down from 3 m, and the other one is moved aside by a fraction of this depth."""
    floor = _grid((-1, -1), (1, 1), 0.0)
    cloud = ColouredPoints(floor, np.zeros((len(floor), 3), np.float32), True)
    carrier = MaskPropagator(
        Scene(Path("memory"), "memory", (VIEW,), floor), {0: [_item(0, (300, 200), (60, 40))]}, cloud
    )
    aside = replace(VIEW, translation=-ROTATION @ np.array([3.0 * step, 0.0, 3.0]))
    assert len(carrier.masks(None, aside)) == is_carried

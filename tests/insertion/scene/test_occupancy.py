"""Visibility between two positions: grids of full cells with known paths, and cells of painted planes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from insertion.scene.occupancy import CELL, START_OFFSET, Occupancy, occupancy_of
from insertion.scene.plane_cells import _divide_by_hue, _normals, find_plane_cells, fit_planes
from insertion.scene.point_cloud import ColouredPoints
from metric_base.arrays import BoolArray

SIDE = 24
UP = np.array([[0.0, 0.0, 1.0]])


def _grid(full: BoolArray, colour: tuple[float, float, float] = (0.2, 0.4, 0.6)) -> Occupancy:
    """Cells of 0.5 whose first corner is at (-1, -2, -3)."""
    light = np.broadcast_to(np.array(colour, np.float32), (*full.shape, 3)).copy()
    distance = distance_transform_edt(~full) if full.any() else np.full(full.shape, float(SIDE))
    return Occupancy(distance.astype(np.float32), light, np.array([-1.0, -2.0, -3.0]), 0.5)


def _at(*cell: float) -> np.ndarray:
    """(1, 3) the place of a cell of the grid, in the scene."""
    return np.array([[-1.0, -2.0, -3.0]]) + 0.5 * np.array([cell])


def _slab(axis: int) -> BoolArray:
    full = np.zeros((SIDE,) * 3, bool)
    full[(slice(None),) * axis + (slice(12, 14),)] = True
    return full


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_wall_is_between_its_sides_and_not_beside_them(axis: int) -> None:
    grid, start, end, beside = _grid(_slab(axis)), np.full(3, 5.5), np.full(3, 5.5), np.full(3, 5.5)
    end[axis], beside[(axis + 1) % 3] = 20.5, 20.5
    assert not grid.is_unobstructed(_at(*start), 0 * UP, _at(*end)).any()
    assert not grid.is_unobstructed(_at(*end), 0 * UP, _at(*start)).any()
    assert grid.is_unobstructed(_at(*start), 0 * UP, _at(*beside)).all()


def test_a_segment_starts_above_its_own_surface_and_ends_before_the_lamp() -> None:
    floor = _slab(2)
    grid = _grid(floor)
    on_floor, lamp = _at(5.5, 5.5, 13.9), _at(15.5, 5.5, 20.5)
    assert grid.is_unobstructed(on_floor, UP, lamp).all()
    assert not grid.is_unobstructed(on_floor, -START_OFFSET * UP, lamp).any()
    ceiling = np.zeros_like(floor)
    ceiling[..., 20] = True
    assert _grid(ceiling).is_unobstructed(_at(5.5, 5.5, 5.5), UP, _at(5.5, 5.5, 21.5)).all()  # within the lamp itself
    assert not _grid(ceiling).is_unobstructed(_at(5.5, 5.5, 5.5), UP, _at(5.5, 5.5, 23.5)).any()


def test_each_end_is_asked_from_each_place() -> None:
    hole = _slab(0)
    hole[:, 4:8, 4:8] = False
    grid = _grid(hole)
    places = np.concatenate([_at(4.5, 6, 6), _at(4.5, 18, 18)])
    ends = np.concatenate([_at(21.5, 6, 6), _at(21.5, 18, 18), _at(2.5, 6, 6)])
    opened = grid.is_unobstructed(places, np.zeros((2, 3)), ends)
    assert opened.tolist() == [[True, False], [False, False], [True, True]]
    assert grid.is_unobstructed(places, np.zeros((2, 3)), np.empty((0, 3))).shape == (0, 2)


def test_a_place_outside_the_grid_is_seen_through_the_grid_s_side() -> None:
    grid = _grid(_slab(0))
    assert grid.is_unobstructed(_at(20.5, 5.5, 5.5), 0 * UP, _at(60.0, 5.5, 5.5)).all()
    assert not grid.is_unobstructed(_at(5.5, 5.5, 5.5), 0 * UP, _at(60.0, 5.5, 5.5)).any()


def test_light_gathered_in_a_closed_room_is_pi_times_its_radiance() -> None:
    walls = np.ones((SIDE,) * 3, bool)
    walls[2:-2, 2:-2, 2:-2] = False
    for normal in (UP, -UP, np.array([[0.0, 1.0, 0.0]])):
        light, missing = _grid(walls).gather_irradiance(_at(12, 12, 12), normal)
        assert light[0] == pytest.approx(np.pi * np.array([0.2, 0.4, 0.6]), rel=1e-5)
        assert missing.tolist() == [0.0]


def test_light_of_a_lower_half_reaches_what_looks_down() -> None:
    floor = np.zeros((SIDE,) * 3, bool)
    floor[..., :2] = True
    grid = _grid(floor, (1.0, 1.0, 1.0))
    for normal, share in ((-UP, 1.0), (UP, 0.0)):
        light, missing = grid.gather_irradiance(_at(12, 12, 3.5), normal)
        assert light[0] == pytest.approx(np.full(3, share * np.pi), abs=0.35)
        assert missing[0] == pytest.approx(1 - light[0, 0] / np.pi)


def _wall_points(count: int = 60) -> np.ndarray:
    """Evenly spread points of a wall at x = 0 and a floor at z = 0, 4 x 3 and 4 x 4."""
    across = (np.arange(count) + 0.5) / count
    a, b = (grid.ravel() for grid in np.meshgrid(across, across))
    return np.concatenate([np.column_stack([0 * a, 4 * a, 3 * b]), np.column_stack([4 * a, 4 * b, 0 * a])])


def test_cells_are_full_where_points_are_and_have_their_colour() -> None:
    points = _wall_points(200)
    colours = np.where(points[:, :1] > 0, [[0.5, 0.1, 0.1]], [[0.1, 0.1, 0.9]]).astype(np.float32)
    colours[::7] = np.nan
    grid = occupancy_of(ColouredPoints(points, colours, True))
    assert grid.cell == pytest.approx(CELL * np.linalg.norm([4, 4, 3]), rel=0.02)
    assert grid.light.shape == (*grid.distance.shape, 3)
    assert np.abs(np.array(grid.distance.shape) * grid.cell - [4, 4, 3]).max() < 3 * grid.cell
    inside = np.floor((np.array([2.0, 2.0, 1.5]) - grid.origin) / grid.cell).astype(int)
    assert grid.distance[tuple(inside)] * grid.cell == pytest.approx(1.5, abs=0.1)
    full = np.argwhere(grid.distance == 0) * grid.cell + grid.origin
    assert ((full[:, 0] < 0.1) | (full[:, 2] < 0.1)).all()
    floor, wall = ((np.array(at) - grid.origin) / grid.cell for at in ([3.0, 2.0, 0.0], [0.0, 2.0, 2.0]))
    assert grid.light[tuple(np.maximum(floor, 0).astype(int))] == pytest.approx([0.5, 0.1, 0.1])
    assert grid.light[tuple(np.maximum(wall, 0).astype(int))] == pytest.approx([0.1, 0.1, 0.9])
    assert grid.is_unobstructed(np.array([[2.0, 2.0, 0.0]]), UP, np.array([[1.0, 1.0, 2.5]])).all()


def test_a_stray_fills_no_cell() -> None:
    dense = np.repeat(_wall_points(), 12, axis=0)
    stray = np.array([[2.0, 2.0, 1.5]])
    cloud = ColouredPoints(np.concatenate([dense, stray]), np.ones((len(dense) + 1, 3), np.float32), True)
    grid = occupancy_of(cloud)
    at = tuple(((stray[0] - grid.origin) / grid.cell).astype(int))
    assert grid.distance[at] > 10


def test_planes_and_paints_of_a_room() -> None:
    """A floor of two paints and a wall: where their cells are, how they look, how bright they are."""
    generator = np.random.default_rng(0)
    floor = np.column_stack([generator.uniform(0, 4, (3000, 2)), generator.normal(0, 0.002, 3000)])
    wall = np.column_stack([generator.uniform(0, 4, 2000), np.full(2000, 4.0), generator.uniform(0.2, 2.5, 2000)])
    colours = np.concatenate([
        np.where(floor[:, :1] < 2, [[0.4, 0.2, 0.1]], [[0.1, 0.2, 0.4]]), np.full((2000, 3), 0.3)
    ]).astype(np.float32)  # fmt: skip
    patches = find_plane_cells(
        ColouredPoints(np.concatenate([floor, wall]), colours, True), np.array([[2.0, 1.0, 1.5]])
    )
    assert len(np.unique(patches.plane)) == 3
    on_wall = patches.positions[:, 2] > 0.1
    assert np.abs(patches.normals[on_wall] - [0, -1, 0]).max() < 0.05
    assert np.abs(patches.normals[~on_wall] - [0, 0, 1]).max() < 0.05
    assert patches.hue is not None
    for mine, colour in (
        (on_wall, [0.3, 0.3, 0.3]),
        (~on_wall & (patches.positions[:, 0] < 1.9), [0.4, 0.2, 0.1]),
        (~on_wall & (patches.positions[:, 0] > 2.1), [0.1, 0.2, 0.4]),
    ):
        bright = float(np.array(colour) @ [0.2126, 0.7152, 0.0722])
        assert len(np.unique(patches.plane[mine])) == 1
        assert patches.log_luminance[mine] == pytest.approx(np.log(bright), abs=1e-3)
        np.testing.assert_allclose(
            patches.hue[mine], np.tile(np.log(np.array(colour) / bright), (mine.sum(), 1)), atol=1e-3
        )
    assert patches.diagonal == pytest.approx(np.linalg.norm([4, 4, 2.5]) * 0.96, rel=0.05)


@pytest.mark.parametrize(("difference", "n_planes"), [(0.17, 1), (0.19, 2)])
def test_paints_differ_by_0_18_of_the_log_of_a_colour_ratio(difference: float, n_planes: int) -> None:
    generator = np.random.default_rng(0)
    floor = np.column_stack([generator.uniform(0, 4, (3000, 2)), generator.normal(0, 0.002, 3000)])
    colours = np.full((3000, 3), 0.3, np.float32)
    colours[floor[:, 0] < 1.5, 0] *= np.exp(difference)
    patches = find_plane_cells(ColouredPoints(floor, colours, True), np.array([[2.0, 1.0, 1.5]]))
    assert len(np.unique(patches.plane)) == n_planes


def test_too_few_or_too_dark_points_have_no_planes() -> None:
    points = np.random.default_rng(0).uniform(0, 1, (139, 3))
    assert not len(
        find_plane_cells(ColouredPoints(points, np.full((139, 3), 0.5, np.float32), True), np.zeros((1, 3))).plane
    )
    room = _wall_points()
    for level in (0.003, 0.95):
        dull = ColouredPoints(room, np.full((len(room), 3), level, np.float32), True)
        assert not len(find_plane_cells(dull, np.ones((1, 3))).plane)
    assert len(
        find_plane_cells(ColouredPoints(room, np.full((len(room), 3), 0.5, np.float32), True), np.ones((1, 3))).plane
    )


def test_a_surface_looks_at_the_eye_and_a_ball_of_points_is_none() -> None:
    points = _wall_points(20)
    normals, flat = _normals(points, np.array([1.0, 2.0, 1.0]))
    middle = np.abs(points - [0, 2, 0]).max(axis=1) < 1.0
    wall = middle & (points[:, 0] == 0) & (points[:, 2] > 0.5)
    assert flat[wall].all()
    np.testing.assert_allclose(normals[wall], np.tile([1.0, 0, 0], (wall.sum(), 1)), atol=1e-9)
    ball = np.random.default_rng(0).normal(size=(200, 3))
    assert _normals(ball, np.zeros(3))[1].mean() < 0.2
    planes = fit_planes(points, normals, 0.05)
    assert [len(rows) for _, rows in planes[:2]] == pytest.approx([400, 400], abs=40)
    assert sorted(int(np.abs(normal).argmax()) for normal, _ in planes[:2]) == [0, 2]


def test_paints_of_a_plane_are_told_apart_by_hue() -> None:
    hue = np.concatenate([np.full((40, 2), 0.1), np.full((30, 2), [0.5, 0.1]), np.full((20, 2), [0.1, 0.27])])
    parts = _divide_by_hue(hue, np.arange(90))
    assert [sorted(part.tolist()) for part in parts] == [[*range(40), *range(70, 90)], [*range(40, 70)]]
    assert _divide_by_hue(hue, np.arange(14)) == []


@pytest.mark.parametrize(("z", "is_open"), [(12.6, True), (12.4, False)])
def test_a_segment_starts_1_5_cells_above_its_surface(z: float, is_open: bool) -> None:
    """The slab ends at 14."""
    assert _grid(_slab(2)).is_unobstructed(_at(5.5, 5.5, z), UP, _at(5.5, 5.5, 20.5)).all() == is_open


@pytest.mark.parametrize(("lamp", "is_open"), [(21.9, True), (22.3, True), (22.6, False)])
def test_the_last_2_cells_of_a_segment_are_not_tested(lamp: float, is_open: bool) -> None:
    """A ceiling starts at 20; the segment is tested at 19.7 and at 20.4."""
    ceiling = np.zeros((SIDE,) * 3, bool)
    ceiling[..., 20] = True
    assert _grid(ceiling).is_unobstructed(_at(5.5, 5.5, 5.5), UP, _at(5.5, 5.5, lamp)).all() == is_open


@pytest.mark.parametrize(("n", "is_full"), [(6, True), (5, False)])
def test_a_full_cell_has_15_percent_of_the_median_number_of_points(n: int, is_full: bool) -> None:
    """Other cells have 40 points."""
    points = np.concatenate([np.repeat(_wall_points(), 40, axis=0), np.tile([[2.0, 2.0, 1.5]], (n, 1))])
    grid = occupancy_of(ColouredPoints(points, np.ones((len(points), 3), np.float32), True))
    cell = tuple(((np.array([2.0, 2.0, 1.5]) - grid.origin) / grid.cell).astype(int))
    assert (grid.distance[cell] == 0) == is_full


def _clusters(n: int, n_points: int) -> ColouredPoints:
    """Clusters of points on a floor of 1 by 1."""
    side = int(np.ceil(np.sqrt(n)))
    x, y = (grid.ravel()[:n] for grid in np.meshgrid(np.arange(side) / side, np.arange(side) / side))
    jitter = np.random.default_rng(0).uniform(-0.003, 0.003, (n, n_points, 2))
    flat = (np.column_stack([x, y])[:, None] + jitter).reshape(-1, 2)
    return ColouredPoints(np.column_stack([flat, 0 * flat[:, 0]]), np.full((len(flat), 3), 0.3, np.float32), True)


@pytest.mark.parametrize(("n", "n_points", "has_cells"), [(47, 3, True), (46, 3, False), (100, 2, False)])
def test_cells_have_3_points_of_at_least_140(n: int, n_points: int, has_cells: bool) -> None:
    assert bool(len(find_plane_cells(_clusters(n, n_points), UP).plane)) == has_cells


@pytest.mark.parametrize(("level", "has_cells"), [(0.0039, False), (0.0041, True), (0.89, True), (0.91, False)])
def test_points_of_planes_are_neither_dark_nor_clipped(level: float, has_cells: bool) -> None:
    room = _wall_points()
    cloud = ColouredPoints(room, np.full((len(room), 3), level, np.float32), True)
    assert bool(len(find_plane_cells(cloud, np.ones((1, 3))).plane)) == has_cells


def test_a_plane_is_divided_into_at_most_3_paints() -> None:
    floor = np.column_stack([np.random.default_rng(0).uniform(0, 4, (4000, 2)), np.zeros(4000)])
    colours = np.full((4000, 3), 0.3, np.float32)
    colours[:, 0] *= np.exp(0.4 * np.floor(floor[:, 0])).astype(np.float32)
    colours *= 0.5
    assert len(np.unique(find_plane_cells(ColouredPoints(floor, colours, True), UP).plane)) == 3


@pytest.mark.parametrize(("n_second", "n_planes"), [(16, 2), (14, 1)])
def test_a_plane_has_1_5_percent_of_the_points(n_second: int, n_planes: int) -> None:
    points = np.random.default_rng(0).uniform(0, 1, (1000, 3)) * [1, 1, 0]
    points[:n_second, 2] = 1.0
    assert len(fit_planes(points, np.repeat(UP, 1000, axis=0), 0.01)) == n_planes


@pytest.mark.parametrize(("cosine", "n_planes"), [(0.86, 1), (0.84, 2)])
def test_normals_of_a_plane_have_a_cosine_of_85_percent(cosine: float, n_planes: int) -> None:
    points = np.random.default_rng(0).uniform(0, 1, (400, 3)) * [1, 1, 0]
    normals = np.repeat(UP, 400, axis=0)
    normals[:200] = [np.sqrt(1 - cosine**2), 0, cosine]
    assert len(fit_planes(points, normals, 1.0)) == n_planes


def test_at_most_14_planes_are_found() -> None:
    points = np.random.default_rng(0).uniform(0, 1, (1600, 3)) * [1, 1, 0] + np.arange(1600)[:, None] % 16 * UP
    assert len(fit_planes(points, np.repeat(UP, 1600, axis=0), 0.01)) == 14


def test_a_grid_for_the_sun_has_small_cells_and_no_stray_points() -> None:
    """A wall of five points per cell and a stray point, in a scene that is long because of two distant places."""
    y, z = np.meshgrid(np.arange(-2.0, 2.0, 0.2), np.arange(0.0, 3.0, 0.25))
    wall = np.column_stack([np.zeros(y.size), y.ravel(), z.ravel()])
    far = np.repeat([[-60.0, -60.0, 0.0], [60.0, 60.0, 0.0]], 30, axis=0)
    points = np.concatenate([wall, [[1.5, 0.0, 2.0]], far])
    cloud = ColouredPoints(points, np.full(points.shape, 0.3, np.float32), dense=False)
    diagonal = float(np.linalg.norm([120.0, 120.0, 2.8]))
    assert occupancy_of(cloud).cell == pytest.approx(0.009 * diagonal, rel=0.01)
    fine = occupancy_of(cloud, max_cell=0.5, min_points=2)
    assert fine.cell == pytest.approx(0.5)
    assert occupancy_of(cloud, max_cell=0.1).cell == pytest.approx(0.0025 * diagonal, rel=0.01)
    sun = np.array([[-1e4, 0.0, 1e4]])
    assert not fine.is_unobstructed(np.array([[1.5, 0.0, 0.0]]), UP, sun).any()
    at = tuple(((np.array([1.5, 0.0, 2.0]) - fine.origin) / fine.cell).astype(int))
    assert fine.distance[at] > 0
    assert occupancy_of(cloud, max_cell=0.5).distance[at] == 0

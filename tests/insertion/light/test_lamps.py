"""Where lamps may be and how they light cells, against the formula; how well a field explains the cells, by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from insertion.light import lamp_fit as shading
from insertion.light.lamp_candidates import (
    GRID,
    LEVELS,
    lamp_irradiance,
    local_candidates,
    room_axes,
    room_candidates,
    visible_fraction,
)
from insertion.light.lamp_fit import (
    CELL_WIDTHS,
    PlaneShading,
    log_posterior,
    plane_shading,
)
from insertion.scene.occupancy import Occupancy
from insertion.scene.plane_cells import PlaneCells

# Published values, written out so that a changed rule fails a test.
CEILING_ALBEDO = 0.85
CEILING_CELLS = 8
CEILING_MARGIN_FRACTION = 0.2
CONTRAST_WEIGHT = 0.25
DIRECT_TO_AMBIENT_PRIOR = 16.0
DIRECT_TO_AMBIENT_SIGMA = 0.3
LIGHTEST_ALBEDO = 0.55
LIGHTEST_QUANTILE_TAIL = 0.05
LIGHTEST_SIGMA = 0.1
MAX_EFFECTIVE_CELLS = 60
MIN_DISTANCE = 0.04
MIN_HEIGHT = 0.45
MIN_HEIGHT_RATIO = 0.55
N_LOCAL_CANDIDATES = 16
PLANE_SIGMA = 0.8
STANDING_LOG_ODDS = -4.0
TYPICAL_IRRADIANCE = 10.0
UNSEEN_SIGMA = 0.3
WALL_MARGIN_FRACTION = 0.12
WALL_SIGMA = 0.35

UP = np.array([0.0, 0.0, 1.0])
DIAGONAL = 6.0


def _cells(places: list[tuple[float, float, float]], normal: tuple[float, float, float], plane: int = 0) -> PlaneCells:
    count = len(places)
    return PlaneCells(
        np.array(places, dtype=float), np.tile(np.array(normal, dtype=float), (count, 1)), np.zeros(count),
        np.full(count, plane), DIAGONAL,
    )  # fmt: skip


def _room() -> PlaneCells:
    """A floor of 4 x 3 and two walls 2 high, 25 cells each, with a known brightness."""
    steps = np.linspace(0.1, 0.9, 5)
    a, b = (grid.ravel() for grid in np.meshgrid(steps, steps))
    places = np.concatenate([
        np.column_stack([4 * a, 3 * b, 0 * a]), np.column_stack([0 * a, 3 * a, 2 * b]),
        np.column_stack([4 * a, 0 * a + 3, 2 * b]),
    ])  # fmt: skip
    normals = np.repeat(np.array([[0.0, 0, 1], [1, 0, 0], [0, -1, 0]]), 25, axis=0)
    light = np.random.default_rng(0).normal(-1.0, 0.3, 75)
    return PlaneCells(places, normals, light, np.repeat([0, 1, 2], 25), DIAGONAL)


def test_a_lamp_lights_by_both_cosines_and_the_squared_distance() -> None:
    floor = _cells([(0, 0, 0), (3, 0, 0), (0, 0, 3)], (0, 0, 1))
    bulb, down, sideways = np.zeros(3), np.array([0, 0, -1.0]), np.array([1.0, 0, 0])
    lamps = np.tile([0.0, 0.0, 2.0], (3, 1))
    light = lamp_irradiance(floor, lamps, np.array([bulb, down, sideways]), None)
    far = np.sqrt(13)
    beside = (2 / far) * DIAGONAL**2 / 13 / TYPICAL_IRRADIANCE
    above = DIAGONAL**2 / 4 / TYPICAL_IRRADIANCE
    assert light == pytest.approx(
        np.array([[above, beside, 0], [above, beside * 2 / far, 0], [0, beside * 3 / far, 0]]), rel=1e-9
    )
    touching = lamp_irradiance(floor, np.array([[0.0, 0.0, 0.01]]), np.zeros((1, 3)), None)[0, 0]
    assert touching == pytest.approx(0.01 / (MIN_DISTANCE * DIAGONAL) / MIN_DISTANCE**2 / TYPICAL_IRRADIANCE)


def _occupancy_with_wall() -> Occupancy:
    """A wall at x = 1 in a box of cells of 0.1 from (-1, -1, -1), up to z = 1."""
    full = np.zeros((40, 40, 40), bool)
    full[20:22, :, :20] = True
    light = np.full((40, 40, 40, 3), 0.5, np.float32)
    return Occupancy(distance_transform_edt(~full).astype(np.float32), light, -np.ones(3), 0.1)


def test_cells_behind_a_wall_are_in_shadow() -> None:
    floor, wall = _cells([(0, 0, 0), (2, 0, 0)], (0, 0, 1)), _occupancy_with_wall()
    low, high = np.array([[2.5, 0.0, 0.5]]), np.array([[0.3, 0.0, 1.2]])
    for spots in (1, 2):
        assert visible_fraction(floor, wall, np.concatenate([low, high]), spots).tolist() == [[0, 1], [1, 0]]
    plain = lamp_irradiance(floor, np.concatenate([low, high, low]), np.zeros((3, 3)), None)
    shaded = lamp_irradiance(floor, np.concatenate([low, high, low]), np.zeros((3, 3)), wall)
    assert shaded == pytest.approx(plain * [[0, 1], [1, 0], [0, 1]])


def test_the_candidates_of_a_room() -> None:
    room = _room()
    all_over = room_candidates(room, UP, None, None)
    local = room.positions @ all_over.basis.T
    low, high = local.min(axis=0), local.max(axis=0)
    size = high - low
    top = max(high[2] + CEILING_MARGIN_FRACTION * size[2], low[2] + MIN_HEIGHT_RATIO * size[:2].max())
    own = all_over.positions @ all_over.basis.T
    assert own.min(axis=0) == pytest.approx(
        [*(low - WALL_MARGIN_FRACTION * size)[:2], low[2] + MIN_HEIGHT * (top - low[2])]
    )
    assert own.max(axis=0) == pytest.approx([*(high + WALL_MARGIN_FRACTION * size)[:2], top])
    assert all_over.spacing == pytest.approx(size[0] * (1 + 2 * WALL_MARGIN_FRACTION) / (GRID - 1))
    bulbs = ~all_over.facing.any(axis=1)
    downward = all_over.facing @ UP < -0.99
    inward = ~bulbs & ~downward
    assert (bulbs.sum(), downward.sum()) == (GRID * GRID * LEVELS, GRID * GRID * LEVELS // 2)
    assert inward.sum() == 4 * GRID * LEVELS
    middle = own[bulbs].mean(axis=0)
    toward = ((middle - own) @ np.eye(3) * (all_over.facing @ all_over.basis.T)).sum(axis=1)
    assert (toward[inward] > 0).all()
    standing = bulbs & (own[:, 2] < low[2] + 0.8 * (top - low[2]))
    assert np.array_equal(all_over.log_prior, np.where(standing, STANDING_LOG_ODDS, 0.0))
    light = lamp_irradiance(room, all_over.positions[::97], all_over.facing[::97], None)
    assert all_over.irradiance[::97] == pytest.approx(light)


def test_visibly_free_positions_are_no_candidates() -> None:
    room = _room()
    free = room_candidates(room, UP, None, None)
    half = room_candidates(room, UP, lambda places: places[:, 0] > 2, None)
    assert (half.positions[:, 0] <= 2).all()
    assert (half.excluded[:, 0] > 2).all()
    assert len(free.excluded) == 0
    place, generator = np.array([1.9, 1.5, 1.9]), np.random.default_rng(0)
    near = local_candidates(half, place, -UP, 0.5, room, None, generator)
    assert near.positions[0].tolist() == place.tolist()
    assert near.facing[0].tolist() == [0, 0, -1]
    assert len(near.positions) == 4 * N_LOCAL_CANDIDATES
    assert near.log_prior[0] == 0
    outside = ((near.positions < half.positions.min(axis=0)) | (near.positions > half.positions.max(axis=0))).any(
        axis=1
    )
    assert outside.any()
    to_free, to_excluded = (
        np.linalg.norm(near.positions[:, None] - others, axis=-1).min(axis=1)
        for others in (half.positions, half.excluded)
    )
    assert np.array_equal(np.isinf(near.log_prior[1:]), (outside | (to_excluded < to_free))[1:])
    assert np.linalg.norm(near.facing, axis=1)[: 3 * N_LOCAL_CANDIDATES] == pytest.approx(1)
    assert not near.facing[3 * N_LOCAL_CANDIDATES :].any()
    assert (near.facing[N_LOCAL_CANDIDATES : 2 * N_LOCAL_CANDIDATES] @ -UP).mean() == pytest.approx(0.9, abs=0.1)
    assert near.positions.std(axis=0).mean() == pytest.approx(0.5, rel=0.3)


def test_axes_are_along_a_wall() -> None:
    turned = _room()
    angle = np.radians(20)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    patches = replace(turned, positions=turned.positions @ turn.T, normals=turned.normals @ turn.T)
    basis = room_axes(patches, UP)
    assert basis @ basis.T == pytest.approx(np.eye(3))
    assert np.linalg.det(basis) == pytest.approx(1)
    assert np.abs(basis[:2] @ turn[:, 0]).max() == pytest.approx(1)
    assert basis[2].tolist() == UP.tolist()
    flat = room_axes(_cells([(0, 0, 0)], (0, 0, 1)), np.array([1.0, 0, 0]))
    assert flat @ flat.T == pytest.approx(np.eye(3))


def test_the_ceiling_is_at_the_height_of_the_highest_lamp() -> None:
    room = _room()
    all_over = room_candidates(room, UP, None, None)
    above = all_over.ceiling
    assert len(above.positions) == CEILING_CELLS**2
    assert above.positions[:, 2] == pytest.approx(all_over.positions[:, 2].max())
    assert np.abs(above.normals + UP).max() == 0
    assert above.positions[:, :2].min(axis=0) == pytest.approx(room.positions[:, :2].min(axis=0))
    assert above.positions[:, :2].max(axis=0) == pytest.approx(room.positions[:, :2].max(axis=0))
    some = slice(None, None, 97)
    ceiling_irradiance = lamp_irradiance(above, all_over.positions[some], all_over.facing[some], None).mean(axis=1)
    assert all_over.ceiling_irradiance[some] == pytest.approx(ceiling_irradiance)
    assert not all_over.ceiling_irradiance[all_over.facing @ UP < -0.99].any()


def _explained(planes: PlaneShading, field: np.ndarray) -> float:
    """The log posterior by its formula, one plane after another."""
    rest = planes.cells.log_luminance - np.log(field)
    albedo = []
    for number in range(len(planes.walls)):
        own = planes.cells.plane == number
        middle = np.sort(rest[own])[own.sum() // 2]
        rest[own] -= middle
        albedo.append(middle)
    widths = [np.mean(np.log1p((rest / width) ** 2)) + np.log(width) for width in CELL_WIDTHS]
    total = -min(MAX_EFFECTIVE_CELLS, len(rest)) * min(widths)
    for some, sigma in ((np.array(albedo)[planes.walls], WALL_SIGMA), (np.array(albedo), PLANE_SIGMA)):
        if len(some) > 1:
            total -= 0.5 * float((((some - some.mean()) / sigma) ** 2).sum())
    return float(total)


def test_the_log_posterior_of_a_field_is_its_formula() -> None:
    planes = plane_shading(_room(), UP, None)
    assert planes.walls.tolist() == [False, True, True]
    assert planes.ambient(2.0) == pytest.approx(2.0)
    fields = np.exp(np.random.default_rng(1).normal(0, 0.5, (3, 75)))
    values = [_explained(planes, field) for field in fields]
    assert log_posterior(planes, fields) == pytest.approx(values, rel=1e-4)
    exact = np.exp(planes.cells.log_luminance)
    assert log_posterior(planes, exact[None])[0] > max(values)
    darker = planes.cells.log_luminance - 3.0
    assert log_posterior(planes, fields, darker) == pytest.approx(values, rel=1e-4)


def test_ambient_light_is_gathered_from_the_walls() -> None:
    walls = np.ones((30, 30, 30), bool)
    walls[1:-1, 1:-1, 1:-1] = False
    light = np.broadcast_to(np.array([0.2, 0.1, 0.05], np.float32), (30, 30, 30, 3)).copy()
    closed = Occupancy(distance_transform_edt(~walls).astype(np.float32), light, np.full(3, -2.0), 0.2)
    planes = plane_shading(_room(), UP, closed)
    bright = 0.2 * 0.2126 + 0.1 * 0.7152 + 0.05 * 0.0722
    assert planes.unit == pytest.approx(np.pi * bright, rel=1e-4)
    assert planes.seen == pytest.approx(1, rel=1e-4)
    assert planes.unseen == pytest.approx(0, abs=1e-6)
    assert planes.tint == pytest.approx(np.tile(np.array([0.2, 0.1, 0.05]) / bright, (75, 1)), rel=1e-4)
    assert planes.mean_irradiance == pytest.approx(1, rel=1e-4)
    assert replace(planes, unseen=np.full(75, 0.5)).mean_irradiance == pytest.approx(1.5, rel=1e-4)
    walls[:, :, -1:] = False
    opened = plane_shading(
        _room(), UP, Occupancy(distance_transform_edt(~walls).astype(np.float32), light, np.full(3, -2.0), 0.2)
    )
    assert (opened.seen + opened.unseen).mean() == pytest.approx(1, rel=1e-4)
    assert opened.unseen.max() > 0.05


def _fitted(planes: PlaneShading, ratio: float) -> shading._FittedLamp:
    candidates = room_candidates(planes.cells, UP, None, None)
    scores = np.zeros((len(candidates.positions), 2))
    scores[5, 1] = 50.0
    return shading._lamp_of_row(candidates, 5, ratio, scores, np.array([1.0, ratio]))


def test_a_fitted_lamp_is_the_likely_candidate_at_its_strength() -> None:
    planes = plane_shading(_room(), UP, None)
    one = _fitted(planes, 6.0)
    candidates = room_candidates(planes.cells, UP, None, None)
    assert one.lamp.positions.tolist() == [candidates.positions[5].tolist()]
    assert one.lamp.strengths == pytest.approx([6.0 / TYPICAL_IRRADIANCE])
    assert (one.score, one.lamp.weights.tolist(), one.lamp.size) == (50.0, [1.0], candidates.spacing)
    assert one.irradiance == pytest.approx(6.0 * candidates.irradiance[5])
    twice = one.scaled(2.0)
    assert (twice.ratio, twice.lamp.strengths[0]) == pytest.approx((12.0, 12.0 / TYPICAL_IRRADIANCE))
    assert twice.irradiance == pytest.approx(2 * one.irradiance)
    direct, ratio, ceiling_irradiance = shading._totals([one, twice], planes, np.array([1.0, 0.5]))
    assert direct == pytest.approx(np.outer([3.0, 1.5], one.irradiance))
    assert ratio == pytest.approx([18.0, 9.0])
    assert ceiling_irradiance == pytest.approx(np.array([18.0, 9.0]) * candidates.ceiling_irradiance[5])
    scores = np.log(np.array([[1.0, 3.0], [2.0, 2.0], [1e-3, 1e-3]]))
    some = replace(candidates, positions=candidates.positions[:3], facing=candidates.facing[:3])
    mixed = shading._lamp_of_row(some, 0, 5.0, scores, np.array([1.0, 5.0])).lamp
    assert mixed.weights == pytest.approx([0.5, 0.5])
    assert mixed.strengths == pytest.approx([4.0 / TYPICAL_IRRADIANCE, 3.0 / TYPICAL_IRRADIANCE])


def test_scores_are_the_contrast_and_the_priors_of_lamps_and_unseen_surfaces() -> None:
    planes = replace(plane_shading(_room(), UP, None), gain=2.0)
    candidates = room_candidates(planes.cells, UP, None, None)
    rows = [3, 700, 1100]
    few = replace(
        candidates, positions=candidates.positions[rows], facing=candidates.facing[rows],
        irradiance=candidates.irradiance[rows], ceiling_irradiance=candidates.ceiling_irradiance[rows],
        log_prior=np.array([0.0, -1.0, -2.0]),
    )  # fmt: skip
    other = _fitted(planes, 8.0)
    ratios = np.array([2.0, 4.0])
    scores = shading._candidate_scores(planes, few, [other], ratios)
    for row in range(3):
        for column, ratio in enumerate(ratios):
            field = 2.0 + other.irradiance + ratio * few.irradiance[row]
            ceiling = CEILING_ALBEDO * (1 + other.ceiling_irradiance + ratio * few.ceiling_irradiance[row])
            lightest = np.pi * np.exp(
                np.quantile(planes.cells.log_luminance - np.log(field), 1 - LIGHTEST_QUANTILE_TAIL)
            )
            terms = [
                np.log((ratio + 8.0) / DIRECT_TO_AMBIENT_PRIOR) / DIRECT_TO_AMBIENT_SIGMA,
                np.log(2.0 / ceiling) / UNSEEN_SIGMA,
                np.log(lightest / LIGHTEST_ALBEDO) / LIGHTEST_SIGMA,
            ]
            expected = CONTRAST_WEIGHT * _explained(planes, field) - 0.5 * np.square(terms).sum() - row
            assert scores[row, column] == pytest.approx(expected, rel=1e-4)


def test_the_colour_of_a_lamp_is_the_change_of_hue_from_shadow_to_light() -> None:
    """White planes, ambient light of one colour, and an orange lamp: each channel is lit by its own strength."""
    room = _room()
    tint, lamp_colour = np.array([1.0, 1.0, 1.0]), np.exp(np.array([0.25, 0.0, -0.4]))
    planes = replace(plane_shading(room, UP, None), tint=np.tile(tint, (75, 1)))
    fitted = _fitted(planes, 8.0)
    field = 1.0 + fitted.irradiance
    bright = np.log(field)
    hue = np.log(1.0 + fitted.irradiance[:, None] * lamp_colour) - bright[:, None]
    painted = replace(planes, cells=replace(room, log_luminance=bright, hue=hue))
    (colour,) = shading._lamp_colours(painted, [fitted])
    assert np.log(colour / colour[1]) == pytest.approx(np.log(lamp_colour), abs=0.051)
    assert colour @ [0.2126, 0.7152, 0.0722] == pytest.approx(1)
    assert shading._lamp_colours(planes, [fitted])[0].tolist() == [1, 1, 1]


def test_strengths_and_unseen_gain_are_balanced_together() -> None:
    planes = plane_shading(_room(), UP, None)
    fitted = _fitted(planes, DIRECT_TO_AMBIENT_PRIOR / 1.28)
    times = CEILING_ALBEDO * (1 + 1.28 * fitted.ceiling_irradiance)
    light = LIGHTEST_ALBEDO / np.pi * (times + 1.28 * fitted.irradiance)
    true = replace(planes, cells=replace(planes.cells, log_luminance=np.log(light)))
    (brighter,), balanced = shading.balance_lamps([fitted], true)
    assert brighter.ratio == pytest.approx(DIRECT_TO_AMBIENT_PRIOR)
    assert balanced.gain == shading.UNSEEN_GAIN_GRID[int(np.abs(np.log(shading.UNSEEN_GAIN_GRID / times)).argmin())]
    assert brighter.irradiance == pytest.approx(1.28 * fitted.irradiance)


@pytest.mark.parametrize(
    ("scores", "n_lamps"),
    [([0.0, 1.9], 1), ([0.0, 2.1, 4.0], 2), ([0.0, 2.1, 4.2, 6.3], 3), ([0.0, 9.0, 18.0, 27.0], 3)],
)
def test_another_lamp_increases_the_log_posterior_by_2_and_at_most_3_are_found(
    scores: list[float], n_lamps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refine(lamps: list[shading._FittedLamp], planes: PlaneShading, _: object) -> object:
        return [replace(lamp, score=scores[len(lamps) - 1]) for lamp in lamps], planes

    monkeypatch.setattr(shading, "_refine_lamps", refine)
    light = shading.fit_room_light(_room(), UP)
    assert light is not None
    assert len(light.lamps) == n_lamps


def test_positions_with_2_percent_of_the_largest_weight_are_kept() -> None:
    candidates = room_candidates(_room(), UP, None, None)
    some = replace(candidates, positions=candidates.positions[:3], facing=candidates.facing[:3])
    lamp = shading._lamp_of_row(some, 0, 1.0, np.log([[1.0], [0.021], [0.019]]), np.array([1.0])).lamp
    assert lamp.weights == pytest.approx(np.array([1.0, 0.021]) / 1.021)

"""Objects with 1 to 30 points are measured by their outlines, and their sigma knows how well."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from estimator.geometry import outline_measurement
from estimator.geometry.cuboid_fit import Cuboid, CuboidProblem
from estimator.geometry.mask_outlines import OutlineExtents, Outlines, mask_contour, outline_extents
from estimator.geometry.outline_measurement import (
    LEVEL_TOP,
    combine_sizes,
)
from estimator.geometry.point_noise import point_covariances
from estimator.pipeline import measure_objects
from estimator.records.objects import Box, MeasuredObject
from estimator.records.options import MeasurementOptions
from estimator.records.scene import Instance, Scene
from tests.synthetic.rooms.few_points import FewPointsWorld, few_points_world
from tests.synthetic.shapes import orbit, view_at

# Published values, written out so that a changed rule fails a test.
FEW_POINTS_SIGMA_FACTOR = 2.0
HIDDEN_TOP_SIGMA = 0.5
MIN_SUFFICIENT_POINTS = 150


@pytest.fixture(scope="module")
def world() -> FewPointsWorld:
    return few_points_world(1000, "round")


def test_heights_of_small_far_and_half_hidden_objects(world: FewPointsWorld) -> None:
    options = MeasurementOptions(standing={"car": True, "chair": True}.get)
    objects = [item for item in measure_objects(world.scene, world.instances, options).objects if item.skipped is None]
    assert len(objects) >= 8
    assert min(item.points for item in objects) < 5
    sizes = np.array([world.sizes[int(world.instances[item.members[0]].track or 0)] for item in objects])
    error = np.log(np.array([item.extents for item in objects]) / sizes)
    assert np.median(np.abs(error), axis=0) == pytest.approx([0, 0, 0], abs=0.2)
    assert abs(np.median(error[:, 2])) < 0.05
    assert (np.abs(error) < 2 * np.array([item.sigma for item in objects])).mean() > 0.8
    for item in objects:
        assert item.covariance is not None
        assert np.diag(item.covariance) == pytest.approx(item.sigma**2)


def test_masks_of_one_track_are_one_object_unless_a_view_has_two(world: FewPointsWorld) -> None:
    without = [replace(mask, track=None) for mask in world.instances]
    stated = measure_objects(world.scene, world.instances).tracks
    alone = measure_objects(world.scene, without).tracks
    assert len(stated) == len({mask.track for mask in world.instances}) < len(alone)
    twice = [*world.instances, replace(world.instances[0], origin=(0, 0), id="other")]
    assert len(measure_objects(world.scene, twice).tracks) == len(stated) + 1


def test_the_error_of_a_point_lies_along_the_view_where_the_baseline_is_short() -> None:
    place = np.array([[0.0, 0.0, 0.4]])
    for arc, least, most in ((2.0, 10.0, 100.0), (90.0, 0.5, 3.0)):
        views = [
            replace(view, keypoints=np.array([[320.0, 240.0]]), point_index=np.array([0]))
            for view in orbit(6, 5.0, 0.4, arc=arc)
        ]
        covariance = point_covariances(views, place)[0]
        assert least < np.sqrt(covariance[1, 1] / covariance[0, 0]) < most  # the first view looks along y


def test_an_edge_behind_a_nearer_mask_is_not_free(world: FewPointsWorld) -> None:
    first = world.instances[0]
    height, width = first.mask.shape
    beside = replace(
        first, id="cover", mask=np.ones((height, 20), dtype=bool), origin=(first.origin[0] + width, first.origin[1])
    )
    solid = replace(first, mask=np.ones_like(first.mask))
    contours = [mask_contour(solid), mask_contour(beside)]
    alone = outline_extents(world.scene, [solid], contours[:1], np.array([5.0]))
    for depth, free in ((4.0, False), (6.0, True)):
        covered = outline_extents(world.scene, [solid, beside], contours, np.array([5.0, depth]))
        assert covered.is_free[0, 2] == (free and alone.is_free[0, 2])
        assert covered.is_free[0, 0] == alone.is_free[0, 0]


def test_many_points_of_a_short_baseline_do_not_stretch_an_object() -> None:
    """A slow pan leaves depths open by half an object; the box of the points is up to three times too long."""
    pan = few_points_world(1001, "pan", (150, 400))
    objects = measure_objects(pan.scene, pan.instances, MeasurementOptions(standing={"car": True}.get)).objects
    sizes = np.array([pan.sizes[int(pan.instances[item.members[0]].track or 0)] for item in objects])
    error = np.log(np.array([item.extents for item in objects]) / sizes)
    assert np.median([item.points for item in objects]) > 150
    assert np.median(np.abs(error[:, 2])) < 0.06
    assert (np.abs(error) < 2 * np.array([item.sigma for item in objects])).mean() > 0.85


def test_what_lies_on_a_table_is_no_height_of_it_by_outlines() -> None:
    """Outlines of a table 60 wide and 45 high with a television on it are 110 high."""
    cuboid = Cuboid(np.zeros(3), 0.0, np.array([0.9, 0.6, 1.1]), np.diag([1e-4] * 3), 0.0)

    def sizes(height: float, sigma: float, notes: tuple[str, ...]) -> MeasuredObject:
        seen = np.array([0.8, 0.5, height])
        item = MeasuredObject("1", "table", seen, np.array([0.2, 0.3, sigma]), notes=notes)
        item = replace(item, box=Box(np.zeros(3), np.eye(3), seen))
        return combine_sizes(item, cuboid, np.eye(3), (False, False), np.zeros(3, dtype=bool), 0.001)

    level = sizes(0.45, 0.08, (LEVEL_TOP,))
    assert level.extents == pytest.approx([0.9, 0.6, 0.45])
    assert level.sigma[2] == pytest.approx(0.08)
    hidden = sizes(1.1, HIDDEN_TOP_SIGMA, ())
    assert hidden.extents == pytest.approx([0.9, 0.6, 1.1])
    assert hidden.sigma[2] == pytest.approx(HIDDEN_TOP_SIGMA, rel=0.05)
    plain = sizes(1.1, 0.1, ())
    assert plain.sigma[2] < 0.13


def test_outlines_of_an_object_with_few_points_have_twice_the_error() -> None:
    """On each side of `MIN_SUFFICIENT_POINTS`."""
    cuboid = Cuboid(np.zeros(3), 0.0, np.array([0.9, 0.6, 1.1]), np.diag([1e-2] * 3), 0.0)
    seen = np.array([0.8, 0.5, 1.0])
    sigma = [
        combine_sizes(
            MeasuredObject("1", "chair", seen, np.full(3, 0.1), points=points, box=Box(np.zeros(3), np.eye(3), seen)),
            cuboid,
            np.eye(3),
            (False, False),
            np.zeros(3, dtype=bool),
            0.001,
        ).sigma
        for points in (MIN_SUFFICIENT_POINTS - 1, MIN_SUFFICIENT_POINTS)
    ]
    assert sigma[0] == pytest.approx(FEW_POINTS_SIGMA_FACTOR * sigma[1])


def test_the_error_of_an_outline_is_that_of_the_fit_of_masks_and_of_their_borders() -> None:
    """Log errors of 0.08, 0.14 and 0.06, and the border of all masks by a pixel; twice for fewer than 150 points."""
    sides = np.array([1.0, 0.5, 2.0])
    cuboid = Cuboid(np.zeros(3), 0.0, sides, np.diag([0.01, 0.02, 0.03]), 1.0)
    item = MeasuredObject("1", "chair", sides, np.full(3, 0.1), points=200, box=Box(np.zeros(3), np.eye(3), sides))
    is_cut = np.zeros(3, dtype=bool)
    variance = np.array([0.01, 0.02, 0.03]) + np.square([0.08, 0.14, 0.06]) + (0.02 / sides) ** 2
    found = combine_sizes(item, cuboid, np.eye(3), (False, False), is_cut, 0.02)
    assert found.sigma == pytest.approx(np.sqrt(variance))
    few = combine_sizes(replace(item, points=100), cuboid, np.eye(3), (False, False), is_cut, 0.02)
    assert few.sigma == pytest.approx(2 * np.sqrt(variance))


@pytest.mark.parametrize(("sigma", "is_replaced"), [(0.19, True), (0.21, False)])
def test_a_truncated_side_is_replaced_by_an_accurate_outline(sigma: float, is_replaced: bool) -> None:
    """The height of an object with many points; the outlines have a standard deviation of at most 0.2."""
    variance = np.array([1e-4, 1e-4, sigma**2 - 0.06**2])
    cuboid = Cuboid(np.zeros(3), 0.0, np.array([0.9, 0.6, 1.5]), np.diag(variance), 1.0)
    seen = np.array([0.9, 0.6, 1.0])
    item = MeasuredObject(
        "1", "chair", seen, np.full(3, 0.1), truncated=np.array([False, False, True]), points=200,
        box=Box(np.zeros(3), np.eye(3), seen),
    )  # fmt: skip
    found = combine_sizes(item, cuboid, np.eye(3), (True, False), np.zeros(3, dtype=bool), 0.0)
    assert found.extents[2] == (1.5 if is_replaced else 1.0)


def _outlines_of(mask: Instance) -> OutlineExtents:
    """Outlines of a mask in an image of 640 x 480 with a focal length of 500 pixels."""
    view = view_at(np.zeros(3), np.array([0.0, 1.0, 0.0]), "a", size=(640, 480), focal=500.0)
    scene = Scene(Path(), "test", (view,), np.zeros((0, 3)))
    return outline_extents(scene, [mask], [mask_contour(mask)], np.array([1.0]))


def test_the_error_of_an_edge_is_in_pixels_and_relative_to_the_mask() -> None:
    mask = Instance("1", 0, "chair", np.ones((60, 100), dtype=bool), (200, 200))
    assert _outlines_of(mask).sigma[0] == pytest.approx((1.5 + 0.03 * np.hypot(100, 60)) / 500)
    box = _outlines_of(replace(mask, from_box=True)).sigma[0]
    assert box[:4] == pytest.approx((2.0 + 0.03 * np.array([100, 60, 100, 60])) / 500)


@pytest.mark.parametrize(
    ("left", "height", "is_free"),
    [
        (2, 60, True),  # BORDER_PX of 2 from the border, to the centre of a pixel
        (1, 60, False),
        (1, 10, True),  # 10 of 42 pixels: a quarter of the outermost 8 % of a width of 200
        (1, 12, False),  # 12 of 44
    ],
)
def test_an_outline_at_the_border_of_an_image_is_truncated(left: int, height: int, is_free: bool) -> None:
    mask = Instance("1", 0, "chair", np.ones((height, 200), dtype=bool), (left, 200))
    assert bool(_outlines_of(mask).is_free[0, 0]) == is_free


@pytest.mark.parametrize(("misfit", "factor"), [(0.2, 0.5), (0.8, 0.8), (2.0, 1.0)])
def test_the_error_of_boxes_is_that_of_their_fit_and_of_objects_that_are_no_cuboids(
    monkeypatch: pytest.MonkeyPatch, misfit: float, factor: float
) -> None:
    """2.2 deviations of the fit, whose covariance contains a misfit of 1 or more; a misfit is at least a half."""
    given: list[CuboidProblem] = []
    cuboid = Cuboid(np.zeros(3), 0.0, np.array([0.9, 0.6, 1.1]), np.diag([0.01, 0.02, 0.03]), misfit)

    def fit(problems: list[CuboidProblem]) -> list[Cuboid]:
        given.extend(problems)
        return [cuboid for _ in problems]

    monkeypatch.setattr(outline_measurement, "fit_cuboids", fit)
    mask = Instance("1", 0, "chair", np.ones((2, 2), dtype=bool), (0, 0), from_box=True)
    points = np.array([[0.0, 0.0, 1.0], [1.0, 2.0, 3.0], [9.0, 9.0, 9.0]])
    data = SimpleNamespace(
        instances=[mask],
        geometry=SimpleNamespace(basis=np.eye(3)),
        clouds=[SimpleNamespace(points=points)],
        outlines_of=lambda _: _outlines_from(45.0, 135.0),
    )
    seen = np.array([1.0, 0.5, 0.8])
    item = MeasuredObject(
        "1", "chair", seen, np.full(3, 0.1), members=(0,), cloud="sparse", point_rows=np.arange(3),
        box=Box(np.array([0.0, 0.0, 2.0]), np.eye(3), seen), unsupported_height=0.7,
    )  # fmt: skip
    (found,) = outline_measurement.measured_by_outlines([item], data)  # type: ignore[arg-type]
    (problem,) = given
    deviations = 2.2 * factor * np.sqrt([0.01, 0.02, 0.03])
    assert found.sigma == pytest.approx(np.hypot(deviations, [0.09, 0.13, 0.06]))
    assert problem.centre == pytest.approx([1.0, 2.0, 3.0])
    assert problem.foot == pytest.approx((1.6, 0.03 * 0.8))
    assert problem.centre_sd == pytest.approx(0.5 * np.sqrt(0.8))


def test_an_outline_that_ends_near_a_plane_is_fitted_on_it(
    world: FewPointsWorld, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cuboids of height 1 above the floor, the k-th at x = k, by 0.15 of the height, 1.5 deviations, or half of it."""
    gaps = {0.14: 0.0, 0.16: 0.0, 0.29: 0.2, 0.31: 0.2, 0.49: 0.5, 0.51: 0.5}
    rounds: list[list[CuboidProblem]] = []

    def fit(problems: list[CuboidProblem]) -> list[Cuboid]:
        rounds.append(problems)
        floor = next(problem.foot[0] for problem in rounds[0] if problem.foot is not None)
        cuboids = []
        for k, (gap, log_sd) in zip(range(len(problems)), [*gaps.items(), *[(90.0, 0.0)] * 99], strict=False):
            variance = np.diag([1e-6, 1e-6, log_sd**2 + 1e-9])
            cuboids.append(Cuboid(np.array([k, 0, floor + gap + 0.5]), 0.0, np.ones(3), variance, 1.0))
        return cuboids

    monkeypatch.setattr(outline_measurement, "fit_cuboids", fit)
    measure_objects(world.scene, world.instances)
    assert len(rounds[0]) >= len(gaps)
    assert [int(problem.centre[0]) for problem in rounds[1]] == [0, 2, 4]


def _outlines_from(*azimuths: float) -> Outlines:
    """Complete outlines from level cameras at a distance of 5 from the origin, at azimuths in degrees."""
    eyes = [5 * np.array([np.cos(angle), np.sin(angle), 0.0]) for angle in np.radians(azimuths)]
    views = [view_at(eye, np.zeros(3), "a", size=(640, 480), focal=500.0) for eye in eyes]
    n = len(views)
    rotation, translation = (np.array([getattr(view, name) for view in views]) for name in ("rotation", "translation"))
    return Outlines(np.full((n, 8), 0.1), np.full((n, 8), 0.01), np.ones((n, 8), dtype=bool), rotation, translation)


@pytest.mark.parametrize(
    ("azimuths", "truncated"),
    [
        ((16.0, 164.0), [True, False, False]),  # from both ends: a sine of 0.28, 0.3 needed
        ((16.0, 19.0), [False, False, False]),
        ((75.0, 88.0), [False, True, False]),
    ],
)
def test_boxes_show_no_end_of_a_side_along_all_lines_of_sight(
    monkeypatch: pytest.MonkeyPatch, azimuths: tuple[float, ...], truncated: list[bool]
) -> None:
    """A car from behind: its boxes are as wide as the car, and its length is a lower bound."""
    sides = np.array([4.5, 1.8, 1.5])
    monkeypatch.setattr(
        outline_measurement, "fit_cuboids", lambda given: [Cuboid(np.zeros(3), 0.0, sides, np.eye(3), 1.0)] * len(given)
    )
    data = SimpleNamespace(
        instances=[Instance("1", 0, "car", np.ones((2, 2), dtype=bool), (0, 0), from_box=True)],
        geometry=SimpleNamespace(basis=np.eye(3)),
        clouds=[SimpleNamespace(points=np.zeros((1, 3)))],
        outlines_of=lambda _: _outlines_from(*azimuths),
    )
    item = MeasuredObject(
        "1", "car", sides, np.full(3, 0.1), members=(0,), cloud="sparse", point_rows=np.zeros(1, dtype=int),
        box=Box(np.zeros(3), np.eye(3), sides),
    )  # fmt: skip
    (found,) = outline_measurement.measured_by_outlines([item], data)  # type: ignore[arg-type]
    assert found.truncated.tolist() == truncated

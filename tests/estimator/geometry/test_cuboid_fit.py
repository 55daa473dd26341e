"""The cuboid of boxes: made ones whose outlines are known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimator.geometry.cuboid_fit import Cuboid, CuboidProblem, PointRays, fit_cuboids, ray_entry_depths
from estimator.geometry.mask_outlines import Outlines, mask_contour, outline_extents
from estimator.projection.cameras import project
from estimator.records.scene import Instance, Scene, View
from metric_base.arrays import FloatArray
from tests.synthetic.shapes import orbit

SIZE = np.array([0.8, 0.5, 0.9])
MIDDLE = np.array([0.1, -0.2, 0.45])


def fit_cuboid(outlines: Outlines, centre: FloatArray, yaw: float, **data: Any) -> Cuboid:
    """Fit one cuboid."""
    (cuboid,) = fit_cuboids([CuboidProblem(outlines, centre, yaw, **data)])
    return cuboid


def _outline(view: View, size: FloatArray, yaw: float) -> tuple[int, int, int, int]:
    """Left, top, right, bottom of an upright elliptic cylinder in a view, in whole pixels inside the image."""
    angles = np.linspace(0, 2 * np.pi, 60)
    ring = np.column_stack([np.cos(angles) * size[0] / 2, np.sin(angles) * size[1] / 2])
    c, s = np.cos(yaw), np.sin(yaw)
    turned = ring @ np.array([[c, s], [-s, c]])
    points = np.vstack([np.column_stack([turned, np.full(60, z)]) for z in (-size[2] / 2, size[2] / 2)]) + MIDDLE
    pixels = project(view.camera, points @ view.rotation.T + view.translation)
    low, high = np.rint(pixels.min(axis=0)).astype(int), np.rint(pixels.max(axis=0)).astype(int)
    return (
        max(int(low[0]), 0),
        max(int(low[1]), 0),
        min(int(high[0]), view.camera.width),
        min(int(high[1]), view.camera.height),
    )


def _boxes(views: tuple[View, ...], size: FloatArray = SIZE, yaw: float = 0.3) -> list[Instance]:
    boxes = []
    for row, view in enumerate(views):
        left, top, right, bottom = _outline(view, size, yaw)
        mask = np.ones((bottom - top, right - left), dtype=bool)
        boxes.append(Instance(str(row), row, "chair", mask, (left, top), from_box=True))
    return boxes


def box_edges(boxes: list[Instance], views: tuple[View, ...], basis: FloatArray) -> Outlines:
    """The outlines of the boxes of an object, each in a different view."""
    scene = Scene(Path("memory"), "memory", tuple(views), np.empty((0, 3)))
    contours = [mask_contour(item) for item in boxes]
    extents = outline_extents(scene, boxes, contours, np.full(len(boxes), np.nan))
    return extents.of_object(range(len(boxes)), [scene.views[item.view] for item in boxes], basis)


def test_sides_of_a_cylinder_are_a_seventh_short_and_its_height_is_right() -> None:
    # the fit takes footprints for something between a rectangle and an ellipse
    views = orbit(10, 3.0, 1.4)
    edges = box_edges(_boxes(views), views, np.eye(3))
    cuboid = fit_cuboid(edges, MIDDLE, 0.0)
    sides = np.sort(cuboid.extents[:2])[::-1]
    assert np.abs(np.log(sides / SIZE[:2])).max() < 0.17
    assert abs(np.log(cuboid.extents[2] / SIZE[2])) < 0.02
    assert np.linalg.norm(cuboid.centre - MIDDLE) < 0.05


def test_one_hidden_edge_and_a_wild_one_do_not_decide() -> None:
    views = orbit(10, 3.0, 1.4)
    boxes = _boxes(views)
    plain = fit_cuboid(box_edges(boxes, views, np.eye(3)), MIDDLE, 0.0)
    hidden = boxes[3].mask[: boxes[3].mask.shape[0] // 2]
    wild = np.ones((boxes[7].mask.shape[0], boxes[7].mask.shape[1] + 60), dtype=bool)
    changed = [replace(box, mask={3: hidden, 7: wild}.get(row, box.mask)) for row, box in enumerate(boxes)]
    other = fit_cuboid(box_edges(changed, views, np.eye(3)), MIDDLE, 0.0)
    assert np.abs(np.log(np.sort(other.extents) / np.sort(plain.extents))).max() < 0.04


def test_edges_at_the_border_say_nothing() -> None:
    # so near that every image cuts the top off: the height is unknown, unlike the sides
    views = orbit(10, 1.3, 0.5, target=(0.1, -0.2, 0.0))
    edges = box_edges(_boxes(views), views, np.eye(3))
    assert not edges.is_free[:, 1].any()
    cuboid = fit_cuboid(edges, MIDDLE, 0.0, foot=(0.0, 0.02))
    sigma = np.sqrt(np.diag(cuboid.covariance))
    assert sigma[2] > 2 * sigma[:2].min()


def test_sigma_grows_where_views_are_few() -> None:
    views = orbit(12, 3.0, 1.4)
    all_round = fit_cuboid(box_edges(_boxes(views), views, np.eye(3)), MIDDLE, 0.0)
    near = views[:3]
    few = fit_cuboid(box_edges(_boxes(near), near, np.eye(3)), MIDDLE, 0.0)
    assert few.covariance.max() > 2 * all_round.covariance.max()


def test_a_ray_enters_where_the_near_face_is_and_a_miss_lies_between() -> None:
    eyes, rays = np.array([[[-5.0, 0, 0], [-5, 3, 0]]]), np.array([[[1.0, 0, 0]] * 2])
    enter, inside = ray_entry_depths(eyes, rays, np.array([[[0.0, 0, 0, 0.0, *np.log([2.0, 1.0, 1.0])]]]))
    assert enter[0, 0, 0] == pytest.approx(4.0)
    assert inside[0, 0].tolist() == pytest.approx([2.0, 0.0])


def test_one_view_and_a_point_give_a_size_and_half_the_depth_half_of_it() -> None:
    views = orbit(1, 6.0, 1.0)
    edges = box_edges(_boxes(views), views, np.eye(3))
    eye = views[0].centre
    ray = (MIDDLE - eye) / np.linalg.norm(MIDDLE - eye)
    for share in (1.0, 0.5):
        depth = share * float(np.linalg.norm(MIDDLE - eye))
        point = PointRays(eye[None], ray[None], np.array([depth]), np.array([0.01]))
        cuboid = fit_cuboid(edges, eye + depth * ray, 0.0, points=point)
        assert cuboid.extents[2] == pytest.approx(share * SIZE[2], rel=0.15)
        assert np.sqrt(cuboid.covariance[0, 0]) > 2 * np.sqrt(cuboid.covariance[2, 2])


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e4])
def test_unit_of_the_scene_has_no_part(unit: float) -> None:
    views = orbit(6, 3.0, 1.4)
    boxes = _boxes(views)
    plain = fit_cuboid(box_edges(boxes, views, np.eye(3)), MIDDLE, 0.0)
    scaled = tuple(replace(view, translation=unit * view.translation) for view in views)
    other = fit_cuboid(box_edges(boxes, scaled, np.eye(3)), unit * MIDDLE, 0.0)
    assert other.extents / unit == pytest.approx(plain.extents, rel=1e-6)


def test_problems_of_different_sizes_are_fitted_together_as_alone() -> None:
    """One view with a point, ten views on a foot, and three views: the shorter ones are padded."""
    ten = orbit(10, 3.0, 1.4)
    outlines = [box_edges(_boxes(views), views, np.eye(3)) for views in (ten[:1], ten, ten[:3])]
    offset = MIDDLE - ten[0].centre
    depth = float(np.linalg.norm(offset))
    point = PointRays(ten[0].centre[None], offset[None] / depth, np.array([depth]), np.array([0.01]))
    problems = [
        CuboidProblem(outlines[0], MIDDLE, 0.0, points=point),
        CuboidProblem(outlines[1], MIDDLE, 0.0, foot=(0.0, 0.02)),
        CuboidProblem(outlines[2], MIDDLE, 0.0, centre_sd=0.4),
    ]
    for cuboid, problem in zip(fit_cuboids(problems), problems, strict=True):
        (alone,) = fit_cuboids([problem])
        np.testing.assert_allclose(cuboid.extents, alone.extents, rtol=1e-6)
        np.testing.assert_allclose(cuboid.covariance, alone.covariance, rtol=1e-4, atol=1e-9)

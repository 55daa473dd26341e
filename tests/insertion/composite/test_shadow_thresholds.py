"""Thresholds of the surfaces that receive a shadow, in numbers on each side.

A camera 3 above a floor looks down. The object leaves 20 % of the light on the floor, and all of it elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.records.scene import Camera, Instance, View
from insertion.composite.shadow_receivers import proxy_offset, transmitted_light
from insertion.render.body import Body
from insertion.render.layers import ObjectLayers
from insertion.render.renderer import ObjectImage
from insertion.scene.pixel_box import PixelBox
from insertion.scene.point_cloud import VisiblePoints
from metric_base.arrays import FloatArray

BOX = PixelBox(0, 0, 160, 120)
HEIGHT = 3.0
ON_FLOOR, ELSEWHERE = pytest.approx(0.2, abs=0.02), pytest.approx(1.0, abs=0.02)


def looking_down(width: int = 640) -> View:
    rotation = np.diag([1.0, -1.0, -1.0])
    camera = Camera("PINHOLE", width, 480, np.array([500.0, 500, 80, 60]))
    translation = -rotation @ np.array([0, 0, HEIGHT])
    return View("0.png", camera, rotation, translation, np.empty((0, 2)), np.empty(0, np.int64))


def light(
    pixels: FloatArray,
    depths: FloatArray,
    masks: Sequence[NDArray[np.bool_]] = (),
    unit: float = 1.0,
    alpha: NDArray[np.float32] | None = None,
    view: View | None = None,
    level: float = 1.0,
) -> tuple[NDArray[np.float32], tuple[int, ...] | None]:
    """Fraction of the light in each pixel, and the number of cells along both sides if another surface is lit.

    The object leaves the fraction `level` on other surfaces.
    """
    alpha = np.zeros(BOX.shape, np.float32) if alpha is None else alpha
    image = ObjectImage(np.zeros((*BOX.shape, 3), np.float32), alpha, np.full(BOX.shape, np.nan, np.float32))
    floor = np.full(BOX.shape, HEIGHT, np.float32)
    layers = ObjectLayers(BOX, image, np.full((*BOX.shape, 3), 0.2, np.float32), floor)
    body = SimpleNamespace(position=np.zeros(3), basis=np.eye(3), unit=unit, corners=np.zeros((8, 3)))
    points = VisiblePoints(np.arange(len(pixels)), pixels, depths, True)
    instances = [Instance(str(k), 0, "a", mask, (0, 0), 1.0) for k, mask in enumerate(masks)]
    shapes: list[tuple[int, ...]] = []

    def lit(positions: NDArray[np.float32], _: NDArray[np.float32]) -> NDArray[np.float32]:
        shapes.append(positions.shape[:2])
        return np.where(positions[..., 3:] > 0, np.float32(level), np.float32(1.0)) * np.ones(3, np.float32)

    result = transmitted_light(
        layers, lit, cast(Body, body), view or looking_down(), points, instances, None, np.zeros(BOX.shape, bool)
    )
    return result[..., 0], shapes[0] if shapes else None


def grid(step: int = 4) -> FloatArray:
    """Points (n, 2) over the whole box."""
    x, y = np.meshgrid(np.arange(1.0, 160, step), np.arange(1.0, 120, step))
    return np.column_stack([x.ravel(), y.ravel()])


def masked(n_on: int, n: int, alpha: NDArray[np.float32] | None = None, first: int = 0) -> float:
    """Light on the floor in a mask that starts at a column, with `n_on` of n points on the floor, on its left."""
    mask = np.zeros(BOX.shape, bool)
    mask[60:, first:] = True
    pixels = np.vstack([
        np.column_stack([np.linspace(first + 2, first + 8, n_on), np.full(n_on, 90.0)]),
        np.column_stack([np.linspace(first + 60, 158, n - n_on), np.full(n - n_on, 90.0)]),
    ])  # fmt: skip
    depths = np.repeat([HEIGHT, 2.0], [n_on, n - n_on])
    return float(light(pixels, depths, [mask], alpha=alpha)[0][90, first + 4])


@pytest.mark.parametrize(("n_on", "expected"), [(10, ON_FLOOR), (9, ELSEWHERE)])
def test_a_rug_has_half_of_its_points_on_the_floor(n_on: int, expected: object) -> None:
    assert masked(n_on, 20) == expected


def foot(first: int, last: int) -> NDArray[np.float32]:
    """An object above row 60, between two columns."""
    alpha = np.zeros(BOX.shape, np.float32)
    alpha[40:60, first:last] = 1.0
    return alpha


@pytest.mark.parametrize(("last", "expected"), [(31, ON_FLOOR), (29, ELSEWHERE)])
def test_the_support_of_an_object_is_below_30_percent_of_its_foot(last: int, expected: object) -> None:
    """The foot is in the columns from 0 to `last`, and the mask starts at column 21."""
    assert masked(8, 40, foot(0, last), 21) == expected


@pytest.mark.parametrize(("width", "shape"), [(320, (60, 80)), (640, (60, 80)), (1280, (30, 40))])
def test_surfaces_are_computed_at_320_cells_per_width_and_not_at_each_pixel(width: int, shape: tuple[int, int]) -> None:
    pixels = grid()
    assert light(pixels, np.full(len(pixels), 2.0), view=looking_down(width))[1] == shape


def test_shadows_on_other_surfaces_end_4_sizes_from_the_object() -> None:
    """A table 1 above the foot of an object of 0.26: at 71 columns from the centre the distance is 1.04."""
    found = light(grid(), np.full(len(grid()), 2.0), unit=0.26, level=0.0)[0]
    assert found[60, [80 + 62, 80 - 62]] == pytest.approx([0, 0], abs=0.05)
    assert found[60, [80 + 78, 80 - 79]] == pytest.approx([1, 1], abs=0.05)


@pytest.mark.parametrize(("unit", "depth"), [(1.0, 3 * (1 - 1.5 * 0.045)), (3.0, 3 * (1 - 1.5 * 0.12))])
def test_the_plane_ends_at_1_to_2_tolerances(unit: float, depth: float) -> None:
    """At 1.5 tolerances, half of the shadow is on the plane: 4.5 % of the depth, or 12 % of a large object."""
    found = light(grid(), np.full(len(grid()), depth), unit=unit)[0]
    assert found[60, 80] == pytest.approx(0.6, abs=0.04)


@pytest.mark.parametrize(("n", "is_plane"), [(4, True), (5, False)])
def test_five_of_nine_points_contradict_the_plane(n: int, is_plane: bool) -> None:
    offsets = proxy_offset(np.ones((20, 20), bool), np.full((n, 2), 10.0), np.full(n, 0.1), 5.0)
    assert offsets[10, 10] == pytest.approx(0.0 if is_plane else 0.1, abs=0.01)


def test_points_within_28_pixels_contradict_the_plane() -> None:
    """Twenty points at half the depth are at column 20."""
    pixels = np.column_stack([np.full(20, 20.5), np.linspace(59, 61, 20)])
    row = light(pixels, np.full(20, 1.5))[0][60]
    assert row[44] > 0.8
    assert row[54] < 0.4

"""The outlines that a cuboid has in a camera do not know which of its ends is the front."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.outlines.reaches import Outlines
from estimator.outlines.solids import Shape, entry_depths, projected_reaches, supports

LOG = st.floats(-1.0, 1.0)


def camera(distance: float) -> Outlines:
    """One camera that looks along y from `distance`, z up in its picture."""
    rotation = np.array([[[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]])
    ones = np.ones((1, 8))
    return Outlines(ones, ones, ones > 0, rotation, np.array([[0.0, 0, distance]]))


SHAPES = st.sampled_from(["box", "round"])


@settings(max_examples=50)
@given(SHAPES, st.floats(-3.0, 3.0), LOG, LOG, LOG, st.floats(-1.0, 1.0))
def test_half_a_turn_and_an_exchange_of_sides_change_nothing(
    shape: Shape, yaw: float, length: float, width: float, height: float, aside: float
) -> None:
    one, half, quarter, mirrored = projected_reaches(
        camera(12.0),
        np.array([
            [aside, 0.3, 0.1, yaw, length, width, height],
            [aside, 0.3, 0.1, yaw + np.pi, length, width, height],
            [aside, 0.3, 0.1, yaw + np.pi / 2, width, length, height],
            [-aside, 0.3, 0.1, -yaw, length, width, height],
        ]),
        shape,
    )  # fmt: skip
    np.testing.assert_allclose(half, one, atol=1e-9)
    np.testing.assert_allclose(quarter, one, atol=1e-9)
    np.testing.assert_allclose(mirrored[:, [2, 1, 0, 3, 5, 4, 7, 6]], one, atol=1e-9)
    assert (one[:, :2] + one[:, 2:4] > 0).all()


@settings(max_examples=50)
@given(SHAPES, st.floats(-3.0, 3.0), LOG, LOG, LOG)
def test_a_ray_enters_where_the_solid_ends_towards_it(
    shape: Shape, yaw: float, length: float, width: float, height: float
) -> None:
    """The entry of a ray through the centre lies within the slab that the support bounds, on the solid's surface."""
    solid = np.array([[0.2, -0.1, 0.3, yaw, length, width, height]])
    eye, ray = np.array([0.2, -9.1, 0.3]), np.array([0.0, 1.0, 0.0])
    enter, inside = entry_depths(solid, eye[None], ray[None], shape)
    towards, away = supports(solid, np.array([-ray, ray]), shape)[0]
    assert enter[0, 0] + inside[0, 0] / 2 == pytest.approx(9.0)
    assert 9.1 - towards - 1e-9 <= enter[0, 0] + 0.1
    assert towards + away >= inside[0, 0] - 1e-9
    # straight along an axis both are half the side
    straight = solid.copy()
    straight[0, 3] = 0.0
    enter, inside = entry_depths(straight, eye[None], ray[None], shape)
    assert inside[0, 0] == pytest.approx(np.exp(width))

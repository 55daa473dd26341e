"""The outlines that a cuboid has in a camera do not know which of its ends is the front."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.geometry.cuboid_fit import cuboid_projections
from estimator.geometry.mask_outlines import Outlines

LOG = st.floats(-1.0, 1.0)


def camera(distance: float) -> Outlines:
    """One camera that looks along y from `distance`, z up in its image."""
    rotation = np.array([[[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]])
    ones = np.ones((1, 8))
    return Outlines(ones, ones, ones > 0, rotation, np.array([[0.0, 0, distance]]))


@settings(max_examples=50)
@given(st.floats(-3.0, 3.0), LOG, LOG, LOG, st.floats(-1.0, 1.0))
def test_half_a_turn_and_an_exchange_of_sides_change_nothing(
    yaw: float, length: float, width: float, height: float, aside: float
) -> None:
    view = camera(12.0)
    one, half, quarter, mirrored = cuboid_projections(
        view.rotation[None],
        view.translation[None],
        np.array([
            [aside, 0.3, 0.1, yaw, length, width, height],
            [aside, 0.3, 0.1, yaw + np.pi, length, width, height],
            [aside, 0.3, 0.1, yaw + np.pi / 2, width, length, height],
            [-aside, 0.3, 0.1, -yaw, length, width, height],
        ])[None],
    )[0]  # fmt: skip
    np.testing.assert_allclose(half, one, atol=1e-9)
    np.testing.assert_allclose(quarter, one, atol=1e-9)
    np.testing.assert_allclose(mirrored[:, [2, 1, 0, 3, 5, 4, 7, 6]], one, atol=1e-9)
    assert (one[:, :2] + one[:, 2:4] > 0).all()

"""Flatness of the surface around a point, in numbers on each side."""

from __future__ import annotations

import numpy as np
import pytest

from insertion.scene.plane_cells import _normals


def ratio(height: float) -> tuple[float, bool]:
    """Eigenvalue ratio and flatness at the centre of a square grid whose points are alternately above and below."""
    x, y = np.meshgrid(np.arange(-10.0, 11.0), np.arange(-10.0, 11.0))
    points = np.column_stack([x.ravel(), y.ravel(), height * (-1.0) ** (x + y).ravel()])
    # two points make the 14 nearest of the centre unique
    points[:, :2] += 1e-3 * np.column_stack([points[:, 1], np.zeros(len(points))])
    centre = int(np.argmin(np.abs(points[:, :2]).sum(axis=1)))
    near = points[np.argsort(np.linalg.norm(points - points[centre], axis=1), kind="stable")[:14]]
    spread = np.linalg.eigvalsh(np.cov(near.T))
    return float(spread[0] / spread[1]), bool(_normals(points, np.array([0.0, 0.0, 9.0]))[1][centre])


@pytest.mark.parametrize(("height", "is_flat"), [(0.2, True), (0.22, False)])
def test_a_flat_surface_has_4_percent_of_its_second_spread_across(height: float, is_flat: bool) -> None:
    found, flat = ratio(height)
    assert (0.03 < found < 0.04) if is_flat else (0.04 < found < 0.052)
    assert flat == is_flat

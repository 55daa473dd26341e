"""The paper's eta, by hand and by its figure of the bottle."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from estimator.geometry.box import eta, smallest_rectangle_axes
from metric_base.arrays import FloatArray
from tests.synthetic.shapes import Shape, Solid, orbit, synthetic_scene

# Published values, written out so that a changed rule fails a test.
ETA_THRESHOLD = 0.7

LOW, HIGH = np.zeros(3), np.full(3, 8.0)


def centres(cells, times=1):
    return np.repeat(np.asarray(cells, dtype=float) + 0.5, times, axis=0)


def test_even_density_is_one():
    cells = np.stack(np.meshgrid(*[np.arange(8)] * 3), axis=-1).reshape(-1, 3)
    assert np.allclose(eta(centres(cells, 3), LOW, HIGH), 1)


def test_by_hand():
    """Head layer 4 points in 1 cell, tail and middle 1 in 1 each: rho_g = 2, eta_x = sqrt(4) / 2 = 1."""
    points = np.vstack([centres([[0, 0, 0]], 4), centres([[7, 0, 0]]), centres([[3, 7, 7]])])
    found = eta(points, LOW, HIGH)
    assert found[0] == pytest.approx(np.sqrt(4 * 1) / 2)
    # y: head holds cells (0,0,0) and (7,0,0) with 5 points, tail one: sqrt(2.5) / 2
    assert found[1] == pytest.approx(np.sqrt(2.5 * 1) / 2)


def test_a_thin_end_lowers_its_dimension_only():
    cells = np.stack(np.meshgrid(*[np.arange(8)] * 3), axis=-1).reshape(-1, 3)
    thin = np.vstack([centres(cells[cells[:, 0] < 7], 8), centres(cells[cells[:, 0] == 7], 1)])
    found = eta(thin, LOW, HIGH)
    assert found[0] < ETA_THRESHOLD
    assert (found[1:] > 0.9).all()


def test_an_empty_end_is_zero_and_points_outside_do_not_count():
    inner = np.vstack([centres([[3, k, k] for k in range(8)]), [[0.5, 50.0, 0.5]]])
    found = eta(inner, LOW, HIGH)
    assert found[0] == 0
    assert found[1] == pytest.approx(1)


def test_no_points_is_zero():
    assert (eta(np.empty((0, 3)), LOW, HIGH) == 0).all()


def test_upper_faces_belong_to_the_last_cell():
    points = np.array([[0.0, 0.0, 0.0], [8.0, 8.0, 8.0]])
    assert np.allclose(eta(points, LOW, HIGH), 1)


def bottle_confidences(degrees: float, points: int = 4000, seed: int = 0) -> FloatArray:
    """(3,) eta of a synthetic bottle that leans by so many degrees, by the paper's own minimum rectangle."""
    lean = Rotation.from_euler("x", degrees, degrees=True).as_matrix()
    body, neck = np.array([0.08, 0.08, 0.22]), np.array([0.03, 0.03, 0.08])
    solids = (
        Solid("cylinder", body, lean @ np.array([0, 0, 0.0]), lean),
        Solid("cylinder", neck, lean @ np.array([0, 0, 0.15]), lean),
    )
    views = orbit(12, 0.9, 0.45, target=(0, 0, 0.03), size=(240, 180), focal=220.0)
    cloud = synthetic_scene([Shape("bottle", solids)], views, dense=points, noise=0.001, seed=seed).scene.dense
    assert cloud is not None
    axes = np.eye(3)
    axes[:2, :2] = smallest_rectangle_axes(cloud.points[:, :2])
    local = cloud.points @ axes.T
    return eta(local, local.min(axis=0), local.max(axis=0))


def test_the_papers_bottle_loses_its_height_as_it_leans():
    """Figure of the three cases: the height's eta falls with the lean against its width's (paper 0.93, 0.54, 0.29)."""
    upright, leaning, falling = (bottle_confidences(degrees) for degrees in (0, 30, 45))
    assert upright[2] > ETA_THRESHOLD
    assert upright[2] > leaning[2] > falling[2]
    assert falling[2] < 0.8 * upright[2]
    assert falling[2] / falling[0] < upright[2] / upright[0]

"""Thresholds of masks in other frames, in numbers on each side: nearest views, depth of an object, feet, motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estimator.records.objects import SupportPlane
from estimator.records.scene import Camera, Instance, Scene, View
from insertion.footage.footage import Frame
from insertion.scene.frame_masks import MaskPropagator, billboards, inverse_depth_plane, static_cloud
from insertion.scene.point_cloud import ColouredPoints, VisiblePoints
from metric_base.arrays import FloatArray

CAMERA = Camera("PINHOLE", 640, 480, np.array([500.0, 500, 320, 240]))
VIEW = View("0.png", CAMERA, np.eye(3), np.zeros(3), np.empty((0, 2)), np.empty(0, np.int64))


def cloud(points: FloatArray) -> ColouredPoints:
    return ColouredPoints(points, np.zeros((len(points), 3), np.float32), False)


def wall() -> ColouredPoints:
    """A wall at depth 10, over the whole image."""
    flat = np.random.default_rng(0).uniform((-6, -4), (6, 4), (600, 2))
    return cloud(np.column_stack([flat, np.full(600, 10.0)]))


def other_view(turn_deg: float = 0.0, step: float = 0.0) -> View:
    """A view that is rotated about the vertical, and moved to the right."""
    angle = np.radians(turn_deg)
    rotation = np.array([[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]])
    return replace(VIEW, rotation=rotation, translation=-rotation @ np.array([step, 0, 0]))


@pytest.mark.parametrize(
    ("turn_deg", "step", "is_near"), [(24.9, 0.0, True), (25.1, 0.0, False), (0.0, 3.49, True), (0.0, 3.51, False)]
)
def test_masks_are_propagated_over_25_degrees_and_35_percent_of_the_depth(
    turn_deg: float, step: float, is_near: bool
) -> None:
    mask = Instance("a", 0, "a", np.ones((480, 640), bool), (0, 0))
    propagator = MaskPropagator(Scene(Path(), "memory", (VIEW,), wall().points), {0: (mask,)}, wall())
    assert len(propagator.masks(None, other_view(turn_deg, step))) == int(is_near)


@pytest.mark.parametrize(("n", "is_known"), [(5, False), (6, True)])
def test_the_depth_of_an_object_needs_6_points(n: int, is_known: bool) -> None:
    item = Instance("a", 0, "a", np.ones((100, 100), bool), (0, 0))
    pixels = np.linspace(10, 90, n)[:, None] * [1.0, 1.0]
    plane = inverse_depth_plane(item, VisiblePoints(np.arange(n), pixels, np.full(n, 2.0), False), pixels / 500)
    assert (plane is not None) == is_known


@pytest.mark.parametrize(("inverse", "is_used"), [(0.645, True), (0.655, False), (0.355, True), (0.345, False)])
def test_points_within_30_percent_of_the_inverse_depth_are_on_the_object(inverse: float, is_used: bool) -> None:
    """Eleven points have an inverse depth of 0.5, two have this one."""
    item = Instance("a", 0, "a", np.ones((100, 100), bool), (0, 0))
    pixels = np.random.default_rng(0).uniform(5, 95, (13, 2))
    depths = 1 / np.array([0.5] * 11 + [inverse] * 2)
    plane = inverse_depth_plane(item, VisiblePoints(np.arange(13), pixels, depths, False), pixels / 500)
    assert plane is not None
    centre = plane[0] + plane[1:] @ pixels.mean(axis=0) / 500
    assert centre == pytest.approx(0.5 + 2 / 13 * (inverse - 0.5) if is_used else 0.5, abs=0.01)


@pytest.mark.parametrize(("rows", "n"), [(4, 0), (6, 1)])
def test_feet_are_on_the_ground_one_percent_below_the_horizon(rows: int, n: int) -> None:
    """The horizon is at row 240; a slope of 1 % is 5 pixels below."""
    ground = SupportPlane(
        np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]), -0.8, 0.0, 9, np.zeros(2), 1.0, np.ones((2, 2), bool)
    )
    item = Instance("a", 0, "a", np.ones((100, 20), bool), (310, 140 + rows))
    assert len(billboards([item], VIEW, ground)) == n


@pytest.mark.parametrize(("n_masks", "n_left"), [(2, 1), (3, 0)])
def test_a_point_in_the_masks_of_most_frames_moves(n_masks: int, n_left: int) -> None:
    frames = [Frame(k, f"{k}.png", None, VIEW, None) for k in range(4)]
    on, off = (Instance("a", 0, "a", np.ones((20, 20), bool), (x, 230)) for x in (310, 10))
    moving = {k: (on if k < n_masks else off,) for k in range(4)}
    assert len(static_cloud(cloud(np.array([[0.0, 0, 3]])), moving, frames).points) == n_left

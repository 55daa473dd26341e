"""Mirrors, and the sun at each point of an object, in rendered images."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from insertion.light.environment_estimate import add_lamps
from insertion.light.environment_map import HEIGHT, WIDTH, Environment, SphereLights, map_directions
from insertion.render.body import Body, BodyPart
from insertion.render.gpu import gl_context
from insertion.render.renderer import ObjectRenderer
from insertion.scene.camera_rays import Window
from insertion.scene.occupancy import Occupancy
from models3d.model import Material

WINDOW = Window(150.0, 150.0, 60.0, 50.0, 0, 0, 121, 97)
UP = np.array([0.0, -1.0, 0.0])
AXES = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], UP])
#: The camera looks along z, y down, at the middle of a body of 1 m, 3 m ahead.
VIEW = np.eye(3), np.array([0.0, 0.5, 3.0])
CHROME = Material(np.ones(4), 1.0, 0.04)
PAPER = Material(np.array([0.8, 0.8, 0.8, 1.0]), 0.0, 1.0)
SEEN = np.ones((HEIGHT, WIDTH), np.float32)


@pytest.fixture(scope="module")
def context() -> Iterator[Any]:
    made = gl_context()
    yield made
    made.release()


def _body(shape: str, material: Material) -> Body:
    import trimesh

    mesh = trimesh.creation.icosphere(4, 0.5) if shape == "ball" else trimesh.creation.box((1, 1, 1))
    if shape == "box":  # corners with the normals of their faces
        mesh.unmerge_vertices()
    count = len(mesh.vertices)
    arrays = np.zeros((count, 2)), np.ones((count, 4)), np.array(mesh.faces)
    part = BodyPart(np.asarray(mesh.vertices + 0.5 * UP), np.array(mesh.vertex_normals), *arrays, material)
    return Body((part,), np.zeros(3), AXES, 1.0)


def test_a_mirror_shows_the_support_next_to_it(context: Any) -> None:
    """A disc of the support about the foot, 0.75 m in radius, is white; a chrome box reflects it in its lower part."""
    below = map_directions()[..., 2] < -np.cos(np.arctan(0.75 / 0.5))
    radiance = np.where(below, 1.0, 0.1)[..., None] * np.ones(3, np.float32)
    renderer = ObjectRenderer(context, _body("box", CHROME), Environment(radiance.astype(np.float32), AXES, SEEN))
    window = Window(150.0, 150.0, 60.0, 50.0, 0, 90, 121, 97)
    column = renderer.image(window, np.eye(3), np.array([0.0, 2.0, 3.0])).colour[:, 60].mean(axis=-1)
    height = 2.0 - (np.arange(97) + 90.5 - 50.0) * 2.5 / 150.0  # of the front, 2.5 m ahead
    reach = height * 2.5 / (2.0 - height)  # distance from the front at which the mirrored ray meets the support
    is_front = (height > 0.03) & (height < 0.97)
    white, dark = is_front & (reach < 0.2), is_front & (reach > 0.32)
    assert white.sum() > 5
    assert column[white].min() > 2 * column[dark].max()


def test_a_lamp_behind_a_mirror_does_not_darken_its_other_reflections(context: Any) -> None:
    ambient = np.full((HEIGHT, WIDTH, 3), 0.3)
    lamp = SphereLights(np.array([[-4.0, -0.5, 3.0]]), np.full((1, 3), 40.0), np.array([0.2]), 0.5 * UP)
    lit, unlit = (
        ObjectRenderer(context, _body("ball", CHROME), light).image(WINDOW, *VIEW).colour.mean(axis=-1)
        for light in (add_lamps(ambient, SEEN, AXES, lamp), Environment(ambient.astype(np.float32), AXES, SEEN))
    )
    y, x = np.mgrid[:97, :121] + 0.5
    is_inside = np.hypot(x - 60.0, y - 50.0) < 21
    assert (lit[is_inside] > 0.85 * unlit[is_inside]).all()


def _roof() -> Occupancy:
    """A roof 2.5 m above the half of the ground with x < 0, in cells of 0.1 m."""
    full = np.zeros((80, 80, 80), bool)
    full[:40, 15] = True
    distance = distance_transform_edt(~full).astype(np.float32)
    return Occupancy(distance, np.zeros((*full.shape, 3), np.float32), np.full(3, -4.0), 0.1)


def test_the_sun_reaches_the_part_of_an_object_and_of_the_ground_that_is_not_in_shade(context: Any) -> None:
    sun = np.array([0.0, -1.0, -0.7]) / np.hypot(1.0, 0.7)  # behind the camera
    ambient = np.full((HEIGHT, WIDTH, 3), 0.2)
    lamp = SphereLights(1e4 * sun[None], np.full((1, 3), 5e8), np.array([93.0]), 0.5 * UP, _roof())
    renderer = ObjectRenderer(context, _body("box", PAPER), add_lamps(ambient, SEEN, AXES, lamp))
    image = renderer.image(WINDOW, *VIEW).colour.mean(axis=-1)
    shade, light = image[40:60, 40:50], image[40:60, 70:80]
    assert shade.max() < 0.4 * light.min()
    assert np.ptp(shade) < 0.1 * light.mean()

    def received(drawn: ObjectRenderer, x: float) -> float:
        """Return the light on the support 0.3 m behind the box."""
        column, row = ((np.array([x, 0.8]) / drawn.plane.radius + 1) / 2 * len(drawn.plane.share)).astype(int)
        return float(drawn.plane.share[row, column].mean())

    without_sun = ObjectRenderer(context, _body("box", PAPER), Environment(ambient.astype(np.float32), AXES, SEEN))
    assert received(renderer, 0.3) < 0.3
    assert received(renderer, -0.3) == pytest.approx(received(without_sun, -0.3), abs=0.1)  # the roof's shade

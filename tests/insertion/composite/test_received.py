"""The object's shadow on another object, and not on occluders of both."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from estimator.records.scene import Camera, Instance, View
from insertion.composite.shadow_receivers import transmitted_light
from insertion.light.environment_map import HEIGHT, WIDTH, Environment, SphereLights
from insertion.render.body import body_of
from insertion.render.gpu import gl_context
from insertion.render.layers import object_layers
from insertion.render.renderer import ObjectRenderer
from insertion.scene.pixel_box import PixelBox
from insertion.scene.point_cloud import VisiblePoints
from metric_base.arrays import BoolArray, FloatArray
from models3d.model import Material, Mesh, Model
from tests.synthetic.rooms.shapes import solid

SIZE = (320, 240)
LAMP = np.array([-2.0, 0.0, 1.0])
#: What else is there: a side of a box towards the lamp, beyond the object, and a small board near the camera.
SIDE_X, BOARD_Y = 0.6, -1.0
BOARD = np.array([-0.125, BOARD_Y, 0.6])


def _view() -> View:
    eye, target = np.array([-0.6, -2.0, 1.2]), np.array([0.3, 0.0, 0.2])
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.array([right, np.cross(ahead, right), ahead])
    camera = Camera("PINHOLE", *SIZE, np.array([280.0, 280.0, SIZE[0] / 2, SIZE[1] / 2]))
    return View("one", camera, rotation, -rotation @ eye, np.empty((0, 2)), np.empty(0, dtype=np.int64))


def _pixel(view: View, place: tuple[float, float, float]) -> tuple[int, int]:
    """Row and column."""
    local = view.rotation @ np.array(place) + view.translation
    at = local[:2] / local[2] * 280.0 + np.array(SIZE) / 2
    return int(at[1]), int(at[0])


def _front(view: View) -> VisiblePoints:
    """A point for each pixel, on the nearest of the floor, the side and the board."""
    x, y = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
    pixels = np.column_stack([x.ravel(), y.ravel()])
    ways = np.column_stack([(pixels - np.array(SIZE) / 2) / 280.0, np.ones(len(pixels))]) @ view.rotation
    eye = view.centre
    surfaces: tuple[tuple[int, float, Callable[[FloatArray], BoolArray]], ...] = (
        (2, 0.0, lambda p: p[:, 0] < SIDE_X),
        (0, SIDE_X, lambda p: (np.abs(p[:, 1]) < 0.5) & (p[:, 2] > 0) & (p[:, 2] < 0.6)),
        (1, BOARD_Y, lambda p: np.abs(p - BOARD).max(axis=1) < 0.06),
    )
    depths = []
    for axis, value, inside in surfaces:
        depth = (value - eye[axis]) / ways[:, axis]
        depths.append(np.where((depth > 0) & inside(eye + depth[:, None] * ways), depth, np.inf))
    nearest: FloatArray = np.min(depths, axis=0)
    kept = np.isfinite(nearest)
    return VisiblePoints(np.flatnonzero(kept), pixels[kept], nearest[kept], True)


@pytest.fixture(scope="module")
def renderer() -> Iterator[ObjectRenderer]:
    mesh = solid("book", np.array([0.3, 0.3, 0.6]))
    corners = mesh.vertices[mesh.faces].reshape(-1, 3)[:, [0, 2, 1]] * [1, 1, -1]
    normals = np.tile([0.0, 1.0, 0.0], (len(corners), 1))
    faces = np.arange(len(corners)).reshape(-1, 3)
    part = Mesh(
        corners, normals, np.zeros((len(corners), 2)), faces, Material(np.array([0.5, 0.5, 0.5, 1.0]), 0.0, 0.9)
    )
    body = body_of(Model("box", (part,), ()), np.zeros(3), np.eye(3), np.array([0.0, -1.0, 0.0]), 1.0)
    rest = np.full((HEIGHT, WIDTH, 3), 0.05, np.float32)
    middle = np.array([0.0, 0.0, 0.3])
    lamps = SphereLights(LAMP[None], np.full((1, 3), 12.0), np.array([0.1]), middle)
    context = gl_context()
    yield ObjectRenderer(context, body, Environment(rest, np.eye(3), rest[..., 0], rest, lamps))
    context.release()


def test_the_shadow_is_on_what_stands_beside_and_not_on_what_is_in_front(renderer: ObjectRenderer) -> None:
    view, whole = _view(), PixelBox(0, 0, *SIZE)
    layers = object_layers(renderer, view, full_size=True)
    assert layers is not None
    share = layers.catcher_light
    nothing = np.zeros(whole.shape, bool)
    received = transmitted_light(
        layers, renderer.irradiance_fraction, renderer.body, view, _front(view), (), None, nothing
    )
    board, floor = _pixel(view, (-0.125, BOARD_Y, 0.6)), _pixel(view, (0.5, -0.12, 0.0))
    assert share[board].max() < 0.6  # the floor behind the board is in shadow
    assert received[board].min() > 0.95
    assert received[floor].max() < 0.6
    lit = _pixel(view, (-0.4, -0.5, 0.0))
    assert share[lit].min() > 0.8
    np.testing.assert_allclose(received[lit], share[lit], atol=0.05)  # the floor next to the shadow is as it was
    assert received[_pixel(view, (SIDE_X, 0.0, 0.2))].max() < 0.6
    assert received[_pixel(view, (SIDE_X, 0.4, 0.2))].min() > 0.9


@pytest.mark.parametrize("dense", [False, True])
@pytest.mark.parametrize("spacing", [40, 6])
@pytest.mark.parametrize("slope", [0.0, 0.15])
@pytest.mark.parametrize("has_mask", [False, True])
def test_the_whole_shadow_is_drawn_where_nothing_occludes(
    renderer: ObjectRenderer, dense: bool, spacing: int, slope: float, has_mask: bool
) -> None:
    """A floor with noise, 10 % outliers and a part without points; of the shadow 37 to 100 % were drawn."""
    view, body = _view(), renderer.body
    layers = object_layers(renderer, view, full_size=True)
    assert layers is not None
    generator = np.random.default_rng(spacing)
    pixels = generator.uniform(0, SIZE, (SIZE[0] * SIZE[1] // spacing**2, 2))
    local = np.column_stack([(pixels - np.array(SIZE) / 2) / 280.0, np.ones(len(pixels))]) @ view.rotation
    normal = np.array([0.0, slope, 1.0])  # a slope under the object
    depths = -(view.centre @ normal) / (local @ normal) * generator.normal(1.0, 0.01, len(pixels))
    depths[generator.random(len(pixels)) < 0.1] *= 0.6
    kept = (depths > 0) & (np.abs(pixels - _pixel(view, (0.5, -0.12, 0.0))[::-1]).max(axis=1) > 12)
    points = VisiblePoints(np.flatnonzero(kept), pixels[kept], depths[kept], dense)
    nothing = np.zeros(layers.box.shape, bool)
    masks = [Instance("road", 0, "road", np.ones(SIZE[::-1], bool), (0, 0), 1.0)] if has_mask else []
    light = transmitted_light(layers, renderer.irradiance_fraction, body, view, points, masks, None, nothing)
    shadow = (1 - layers.catcher_light).mean(axis=-1) * (layers.image.alpha < 0.01)
    drawn = np.minimum((1 - light).mean(axis=-1), shadow)
    assert shadow.sum() > 300
    assert drawn.sum() >= 0.98 * shadow.sum()

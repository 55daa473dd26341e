"""Glass: the direction and the colour of the light behind it, its shadow, and its place in the layers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from insertion.colour import srgb_to_linear
from insertion.composite.camera_look import CameraLook
from insertion.composite.compose import ObjectComposite, composite_objects, occlude_mutually
from insertion.light.environment_map import HEIGHT, WIDTH, Environment
from insertion.render.body import Body, BodyPart
from insertion.render.gpu import gl_context
from insertion.render.layers import ObjectLayers
from insertion.render.renderer import ObjectImage, ObjectRenderer
from insertion.scene.camera_rays import Window
from insertion.scene.pixel_box import PixelBox
from models3d.model import Material

# Published values, written out so that a changed rule fails a test.
GLASS_TRANSMITTANCE = 0.78
MAX_OPEN_EDGES = 0.02

WINDOW = Window(150.0, 150.0, 60.0, 50.0, 0, 0, 121, 97)
UP = np.array([0.0, -1.0, 0.0])
AXES = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], UP])
#: The camera looks along z, y down, at the middle of a body of 1 m, 3 m ahead.
VIEW = np.eye(3), np.array([0.0, 0.5, 3.0])
TINT = np.array([0.3, 0.8, 0.5])
GREEN = Material(np.array([*TINT, 0.15]), 0.0, 0.05, blend=True, transmission=1.0, tint=TINT)
#: Light that passes two surfaces with an index of 1.5 at right angles.
TWO_SURFACES = 0.96**2


def _solid(shape: str, material: Material = GREEN) -> BodyPart:
    import trimesh

    mesh = {
        "ball": lambda: trimesh.creation.icosphere(4, 0.5),
        "box": lambda: trimesh.creation.box((1, 1, 1)),
        "sheet": lambda: trimesh.Trimesh(
            [[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]], [[0, 2, 1], [0, 3, 2]]
        ),
    }[shape]()
    if shape == "box":  # corners with the normals of their faces
        mesh.unmerge_vertices()
    count = len(mesh.vertices)
    vertices = np.asarray(mesh.vertices + np.array([0, -0.5, 0]))
    arrays = np.zeros((count, 2)), np.ones((count, 4)), np.array(mesh.faces)
    return BodyPart(vertices, np.array(mesh.vertex_normals), *arrays, material)


@pytest.fixture(scope="module")
def drawn() -> Iterator[Callable[..., ObjectRenderer]]:
    context = gl_context()
    radiance = np.ones((HEIGHT, WIDTH, 3), np.float32)
    light = Environment(radiance, AXES, radiance[..., 0])
    yield lambda *parts: ObjectRenderer(context, Body(parts, np.zeros(3), AXES, 1.0), light)
    context.release()


def test_a_ball_is_a_lens_and_a_pane_is_not(drawn: Callable[..., ObjectRenderer]) -> None:
    ball = drawn(_solid("ball")).image(WINDOW, *VIEW)
    assert ball.glass is not None
    assert ball.shift is not None
    assert not ball.alpha.any()  # clear glass has no colour of its own
    x = np.arange(121) + 0.5 - 60.0
    row = ball.shift[50, :, 0]
    is_inside = np.abs(x) < 15
    impact = x[is_inside] / 25  # 0.5 m in 3 m are 25 pixels
    cosine = np.sqrt(1 - impact**2)
    expected = -150.0 * 2 * impact * (np.sqrt(1.25 + cosine**2) - cosine)
    assert row[is_inside] == pytest.approx(expected, rel=0.15, abs=2.0)
    assert ball.glass[50, 60] == pytest.approx([*(TWO_SURFACES * TINT), 1.0], abs=0.01)
    rim = ball.glass[50, 60:86]  # reflected more and more
    assert (np.diff(rim[:23, 1]) < 2e-3).all()
    assert rim[22, 1] < 0.9 * rim[0, 1]
    for shape in ("box", "sheet"):
        flat = drawn(_solid(shape)).image(WINDOW, *VIEW)
        assert flat.glass is not None
        assert flat.shift is not None
        assert np.abs(flat.shift[45:55, 55:65]).max() < 0.5
        assert flat.glass[50, 60] == pytest.approx([*(TWO_SURFACES * TINT), 1.0], abs=0.01)
        assert np.isfinite(flat.depth[50, 60])
        assert not flat.glass[2, 2].any()


def test_an_edge_of_glass_is_as_soft_as_that_of_an_opaque_object(drawn: Callable[..., ObjectRenderer]) -> None:
    """Glass has four samples per pixel and an opaque object sixteen: a difference of 0.1 at an edge is theirs."""
    glass = drawn(_solid("ball")).image(WINDOW, *VIEW)
    opaque = drawn(_solid("ball", Material(np.ones(4), 0.0, 0.9))).image(WINDOW, *VIEW)
    difference = glass.coverage - opaque.alpha
    is_edge = (glass.coverage % 1 != 0) | (opaque.alpha % 1 != 0)
    assert np.abs(difference[~is_edge]).max() == 0
    assert np.sqrt(np.mean(difference[is_edge] ** 2)) < 0.09
    assert abs(difference[is_edge].mean()) < 0.02


def test_an_opaque_part_hides_the_glass_behind_it(drawn: Callable[..., ObjectRenderer]) -> None:
    plain = Material(np.array([0.5, 0.5, 0.5, 1.0]), 0.0, 0.9)
    front = replace(_solid("sheet", plain), vertices=0.5 * _solid("sheet").vertices + [0, -0.25, -0.8])
    image = drawn(_solid("ball"), front).image(WINDOW, *VIEW)
    assert image.glass is not None
    assert image.glass[50, 60, 3] == 0.0
    assert image.alpha[50, 60] == pytest.approx(1.0)
    assert image.glass[50, 80, 3] == pytest.approx(1.0)


def test_the_shadow_of_glass_is_weak_and_has_its_colour(drawn: Callable[..., ObjectRenderer]) -> None:
    dark = 1 - drawn(_solid("ball", replace(GREEN, blend=False, transmission=0.0))).plane.share
    tinted = 1 - drawn(_solid("ball")).plane.share
    is_shadow = dark.max(axis=-1) > 0.2
    ratio = tinted[is_shadow].mean(axis=0) / dark[is_shadow].mean(axis=0)
    assert ratio == pytest.approx(1 - GLASS_TRANSMITTANCE * TINT, abs=0.02)


@pytest.mark.parametrize(("holes", "is_closed"), [(40, True), (60, False)])
def test_a_surface_with_a_small_hole_is_closed(holes: int, is_closed: bool) -> None:
    ball = _solid("ball")
    part = replace(ball, faces=np.delete(ball.faces, np.linspace(0, len(ball.faces) - 1, holes).astype(int), axis=0))
    edges = 3 * len(ball.faces) / 2
    assert (3 * holes < MAX_OPEN_EDGES * edges) == is_closed
    assert part.is_closed == is_closed
    assert not _solid("sheet").is_closed
    assert _solid("box").is_closed


def _glass_layer(**changes: Any) -> ObjectComposite:
    box = PixelBox(10, 5, 30, 25)
    glass, shift = np.zeros((*box.shape, 4), np.float32), np.zeros((*box.shape, 2), np.float32)
    glass[5:15, 5:15], shift[5:15, 5:15] = [0.5, 0.4, 0.3, 1.0], [-12.0, 3.0]
    values: dict[str, Any] = {"glass": glass, "shift": shift} | changes
    empty = np.zeros(box.shape, np.float32)
    image = ObjectImage(np.zeros((*box.shape, 3), np.float32), empty, empty + 2.0, **values)
    light = np.full((*box.shape, 3), 0.5, np.float32)
    return ObjectComposite(ObjectLayers(box, image, light, empty), empty, light)


def test_glass_shows_the_shaded_plate_from_elsewhere_as_its_foreground() -> None:
    plate = np.random.default_rng(3).integers(0, 255, (40, 50, 3), np.uint8)
    look = CameraLook(np.full(3, 2.0), np.zeros((2, 2)), np.zeros((8, 3)), 0.0)
    item = _glass_layer()
    out = composite_objects(plate, [item], look, 0)
    light = srgb_to_linear(plate)
    light[5:25, 10:30] *= 0.5
    expected = light[13:23, 3:13] * [0.5, 0.4, 0.3]  # columns 15 to 24 less 12, rows 10 to 19 and 3
    assert out.foreground[5:15, 5:15, :3] == pytest.approx(expected, abs=1e-4)
    assert out.foreground[5:15, 5:15, 3] == pytest.approx(1.0)
    assert srgb_to_linear(out.image[10:20, 15:25]) == pytest.approx(expected, abs=0.01)
    assert item.visible == 1.0
    assert item.layers.silhouette == (15, 10, 10, 10)
    behind = replace(_glass_layer(glass=None, shift=None), occluded=np.zeros((20, 20), np.float32))
    behind.layers.image.alpha[...], behind.layers.image.depth[...] = 1.0, 4.0
    seen = occlude_mutually([item, behind])[1]
    assert not seen.occluded.any()  # through the glass
    assert composite_objects(plate, [item, behind], look, 0).foreground[..., :3] == pytest.approx(0.0)


def test_a_rim_whose_pixels_show_remote_parts_of_the_frame_has_their_mean() -> None:
    """The pixels were as light or as dark as single pixels of the frame."""
    plate = np.random.default_rng(3).integers(0, 2, (160, 200, 1), np.uint8).repeat(3, axis=-1) * 200
    look = CameraLook(np.ones(3), np.zeros((2, 2)), np.zeros((8, 3)), 0.0)
    shift = np.random.default_rng(4).uniform(20, 120, (20, 20, 2)).astype(np.float32)
    rim = composite_objects(plate, [_glass_layer(shift=shift)], look, 0).foreground[5:15, 5:15, 1]
    even = composite_objects(plate, [_glass_layer()], look, 0).foreground[5:15, 5:15, 1]
    assert even.std() > 0.08
    assert rim.std() < 0.2 * even.std()
    assert rim.mean() == pytest.approx(0.4 * srgb_to_linear(plate).mean(), rel=0.1)


def test_half_of_a_pixel_that_shows_every_4_5th_pixel_is_their_mean() -> None:
    """The fraction is (4.5 - 1) / (8 - 1)."""
    plate = np.random.default_rng(3).integers(0, 2, (160, 200, 1), np.uint8).repeat(3, axis=-1) * 200
    look = CameraLook(np.ones(3), np.zeros((2, 2)), np.zeros((8, 3)), 0.0)
    shift = np.full((20, 20, 2), 3.0, np.float32)
    shift[..., 0] = 3.5 * np.arange(20)
    part = composite_objects(plate, [_glass_layer(shift=shift)], look, 0).foreground[5:15, 5:15, 1]
    even = composite_objects(plate, [_glass_layer()], look, 0).foreground[5:15, 5:15, 1]
    assert part[1:-1, 1:-1].std() / even.std() == pytest.approx(0.5, abs=0.08)

"""Layers joined to an image: several objects, occluders of them and of their shadows, and one footage."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.records.scene import Camera, Instance, View
from insertion.colour import linear_to_srgb
from insertion.composite import compositor
from insertion.composite.camera_look import CameraLook
from insertion.composite.compose import ObjectComposite, composite_objects, composite_traced, occlude_mutually
from insertion.composite.shadow_receivers import transmitted_light
from insertion.exports.compositing import CompositingLayers
from insertion.footage.footage import Frame
from insertion.light.environment_map import HEIGHT, WIDTH, Environment
from insertion.render.body import Body, body_of, colliding, environment_with_objects
from insertion.render.gpu import gl_context
from insertion.render.layers import ObjectLayers, object_layers, through_lens, window_behind
from insertion.render.renderer import ObjectImage, ObjectRenderer
from insertion.scene.pixel_box import PixelBox
from insertion.scene.point_cloud import VisiblePoints
from models3d.model import Material, Mesh, Model
from tests.synthetic.rooms.shapes import solid

BOX = PixelBox(0, 0, 40, 30)
LOOK = CameraLook(np.ones(3), np.eye(2) * 0.35**2, np.zeros((8, 3)), 0.0)
GREY = np.full((30, 40, 3), 100, np.uint8)
SIZE = (320, 240)


def _flat(colour: float, depth: float, columns: slice, hidden: float = 0.0) -> ObjectComposite:
    """A flat object over some columns of the box; hidden : everywhere."""
    alpha = np.zeros(BOX.shape, np.float32)
    alpha[:, columns] = 1.0
    image = ObjectImage(
        np.repeat(colour * alpha[..., None], 3, axis=2), alpha, np.where(alpha > 0, depth, np.nan).astype(np.float32)
    )
    layers = ObjectLayers(BOX, image, np.ones((*BOX.shape, 3), np.float32), np.full(BOX.shape, np.nan, np.float32))
    return ObjectComposite(layers, np.full(BOX.shape, hidden, np.float32), np.ones((*BOX.shape, 3), np.float32))


def test_the_nearer_object_blocks_the_farther_one_pixel_by_pixel() -> None:
    near, far = _flat(0.9, 2.0, slice(0, 20)), _flat(0.1, 3.0, slice(10, 40))
    for order in ([near, far], [far, near]):
        out = composite_objects(GREY, occlude_mutually(order), LOOK, 0).image
        assert (out[15, :20] == round(float(linear_to_srgb(np.array(0.9))))).all()
        assert (out[15, 21:] == round(float(linear_to_srgb(np.array(0.1))))).all()
    visible = occlude_mutually([near, far])[1].visible
    assert visible == pytest.approx(2 / 3, abs=0.01)


def test_a_traced_object_before_a_hidden_one_stays() -> None:
    """One hidden object erased all that the other renderer drew before it."""
    near, far = _flat(0.9, 2.0, slice(0, 20)), _flat(0.1, 3.0, slice(10, 40), hidden=1.0)
    traced = np.zeros((*BOX.shape, 4), np.float32)
    traced[:, :20], traced[:, 20:] = (0.9, 0.9, 0.9, 1.0), (0.1, 0.1, 0.1, 1.0)
    out = composite_traced(GREY, traced, occlude_mutually([near, far]), LOOK, 0).image
    assert (out[15, :19] > 230).all()
    assert (out[15, 22:] == 100).all()


_Triple = tuple[float, float, float]


def _box_model(size: _Triple, colour: _Triple = (0.5, 0.5, 0.5), metal: bool = False) -> Model:
    mesh = solid("book", np.array(size))
    corners = mesh.vertices[mesh.faces].reshape(-1, 3)[:, [0, 2, 1]] * [1, 1, -1]
    across = np.cross(corners[1::3] - corners[::3], corners[2::3] - corners[::3])
    normals = np.repeat(across / np.linalg.norm(across, axis=1, keepdims=True), 3, axis=0)
    faces = np.arange(len(corners)).reshape(-1, 3)
    material = Material(np.array([*colour, 1.0]), *((1.0, 0.05) if metal else (0.0, 0.9)))
    return Model("box", (Mesh(corners, normals, np.zeros((len(corners), 2)), faces, material),))


def _body(x: float, size: _Triple = (0.3, 0.3, 0.6), y: float = 0.0, model: Model | None = None) -> Body:
    return body_of(model or _box_model(size), np.array([x, y, 0.0]), np.eye(3), np.array([0.0, -1.0, 0.0]), 1.0)


def _view() -> View:
    eye, target = np.array([0.0, -2.5, 1.2]), np.array([0.2, 0.0, 0.2])
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.array([right, np.cross(ahead, right), ahead])
    camera = Camera("PINHOLE", *SIZE, np.array([280.0, 280.0, SIZE[0] / 2, SIZE[1] / 2]))
    return View("one", camera, rotation, -rotation @ eye, np.empty((0, 2)), np.empty(0, dtype=np.int64))


@pytest.fixture
def context() -> Iterator[Any]:
    opened = gl_context()
    yield opened
    opened.release()


def _environment() -> Environment:
    """A strong light from the side of -x, high up."""
    radiance = np.full((HEIGHT, WIDTH, 3), 0.05, np.float32)
    radiance[18:22, 0:4] = 200.0
    return Environment(radiance, np.eye(3), np.ones((HEIGHT, WIDTH), np.float32))


def test_bodies_collide_where_their_surfaces_cross_and_not_where_they_touch() -> None:
    assert colliding(_body(0.0), _body(0.2))
    assert not colliding(_body(0.0), _body(0.32))
    assert not colliding(_body(0.0), _body(2.0))


def test_an_object_stands_in_the_shadow_of_another_and_shadows_are_not_doubled(context: Any) -> None:
    one, two, view = _body(0.0), _body(0.5, (0.3, 0.3, 0.3)), _view()
    alone = ObjectRenderer(context, two, _environment())
    shaded = ObjectRenderer(context, two, _environment(), casters=[one], earlier=[one])
    lit, dark = (object_layers(renderer, view, full_size=True) for renderer in (alone, shaded))
    assert lit is not None
    assert dark is not None
    inside = lit.image.alpha > 0.99
    assert dark.image.colour[inside].mean() < 0.7 * lit.image.colour[inside].mean()
    # the shares of both multiply to the light with both: where each alone takes the lamp, it is taken once
    first = object_layers(ObjectRenderer(context, one, _environment()), view, full_size=True)
    assert first is not None
    both = first.catcher_light < 0.3
    assert (lit.catcher_light < 0.3)[both].any()
    doubled = (first.catcher_light * lit.catcher_light)[both & (lit.catcher_light < 0.3)]
    once = (first.catcher_light * dark.catcher_light)[both & (lit.catcher_light < 0.3)]
    assert once.mean() > 1.5 * doubled.mean()


def _even_light() -> Environment:
    return Environment(np.ones((HEIGHT, WIDTH, 3), np.float32), np.eye(3), np.ones((HEIGHT, WIDTH), np.float32))


def test_what_is_mirrored_has_its_colour_and_its_place() -> None:
    """Closed form: a red box in even light sends back its colour, in the directions in which it is seen."""
    red = _body(0.9, model=_box_model((0.3, 0.3, 0.6), (0.8, 0.1, 0.1)))
    radiance = environment_with_objects(_even_light(), _body(0.0), [red]).radiance
    changed = (radiance != 1).any(axis=-1)
    np.testing.assert_allclose(radiance[changed], np.tile([0.8, 0.1, 0.1], (changed.sum(), 1)), rtol=1e-5)
    turn = (np.arange(WIDTH) + 0.5) / WIDTH * 2 * np.pi - np.pi
    half = np.arctan2(0.15, 0.75)  # of the side that faces the body
    assert changed[HEIGHT // 2, np.abs(turn) < 0.8 * half].all()
    assert not changed[:, np.abs(turn) > half + 2 * np.pi / WIDTH].any()


@pytest.mark.parametrize("first", [True, False])
def test_each_of_two_objects_mirrors_the_other(context: Any, first: bool) -> None:
    """A metal box, placed before a red one or after it: its lower front shows the red one, and is grey without it."""
    metal = _body(0.0, model=_box_model((0.3, 0.3, 0.6), (0.9, 0.9, 0.9), metal=True))
    red = _body(0.0, (0.3, 0.3, 0.3), -0.6, _box_model((0.3, 0.3, 0.3), (0.8, 0.05, 0.05)))
    bodies = [metal, red] if first else [red, metal]
    others, before = compositor.other_bodies(bodies, bodies.index(metal))
    view = _view()
    redness = []
    for shading in (others, []):
        renderer = ObjectRenderer(context, metal, _even_light(), casters=shading, earlier=before)
        layers = object_layers(renderer, view, full_size=True)
        assert layers is not None
        lower = np.flatnonzero((layers.image.alpha > 0.99).any(axis=1))[-40:-8]
        front = layers.image.colour[lower][layers.image.alpha[lower] > 0.99]
        redness.append(float(np.median(front[:, 0] / front[:, 1])))
    assert redness[0] > 3.0
    assert redness[1] == pytest.approx(1.0, abs=0.02)


def test_an_object_that_moved_is_drawn_as_one_that_stood_there(context: Any) -> None:
    """Shadow maps, the light on the floor and the shadow of the other one follow it."""
    before, there, other, view = _body(-0.4), _body(0.1, y=0.2), _body(0.5, (0.3, 0.3, 0.3)), _view()
    moved = ObjectRenderer(context, before, _environment(), casters=[other], earlier=[other], moves=True)
    fresh = ObjectRenderer(context, there, _environment(), casters=[other], earlier=[other], moves=True)
    moved.set_pose(there, [other], [other])
    one, two = (object_layers(renderer, view, full_size=True) for renderer in (moved, fresh))
    assert one is not None
    assert two is not None
    np.testing.assert_array_equal(one.image.colour, two.image.colour)
    np.testing.assert_array_equal(one.catcher_light, two.catcher_light)
    moved.set_pose(there)  # the other one has gone
    fresh = ObjectRenderer(context, there, _environment(), moves=True)
    one, two = (object_layers(renderer, view, full_size=True) for renderer in (moved, fresh))
    assert one is not None
    assert two is not None
    np.testing.assert_allclose(one.image.colour, two.image.colour, atol=1e-3)
    np.testing.assert_array_equal(one.catcher_light, two.catcher_light)


def _unshaded(positions: np.ndarray, _normals: np.ndarray) -> np.ndarray:
    return np.ones((*positions.shape[:2], 3), np.float32)


def test_no_shadow_falls_on_what_stands_in_front(context: Any) -> None:
    """A board before the floor, with an exact mask and few points: the floor's shadow was painted on it."""
    body, view = _body(0.0), _view()
    layers = object_layers(ObjectRenderer(context, body, _environment()), view, full_size=True)
    assert layers is not None
    dark = (1 - layers.catcher_light).max(axis=-1) > 0.3
    rows, columns = np.nonzero(dark & (layers.image.alpha < 0.01))
    x, y = int(np.median(columns)), int(np.median(rows))
    mask = np.ones((16, 20), bool)
    board = Instance("board", 0, "board", mask, (x - 10, y - 8), 1.0)
    floor = np.stack(np.meshgrid(np.arange(4, SIZE[0], 8.0), np.arange(4, SIZE[1], 8.0)), axis=-1).reshape(-1, 2)
    depth = layers.plane_depth[floor[:, 1].astype(int), floor[:, 0].astype(int)]
    outside = np.isfinite(depth) & ~((np.abs(floor - [x, y]) < [12, 10]).all(axis=1))
    for count in (0, 12):  # without points, and with some
        own = np.random.default_rng(0).uniform([x - 9, y - 7], [x + 9, y + 7], (count, 2))
        pixels = np.concatenate([floor[outside], own])
        depths = np.concatenate([depth[outside], np.full(count, 0.5)])
        front = VisiblePoints(np.arange(len(pixels)), pixels, depths, False)
        nothing = np.zeros(layers.box.shape, bool)
        share = transmitted_light(layers, _unshaded, body, view, front, [board], None, nothing)
        inside = np.zeros(layers.box.shape, bool)
        inside[y - 8 : y + 8, x - 10 : x + 10] = True
        assert (share[inside] == 1).all()
        assert share[dark & ~inside].mean() < 0.7
    for dense in (False, True):  # points without a mask hide the object where they are dense, and take its shadow there
        front = VisiblePoints(np.arange(len(pixels)), pixels, depths, dense)
        share = transmitted_light(layers, _unshaded, body, view, front, [], None, nothing)
        assert (share[inside & dark].mean() > 0.95) == dense


@pytest.mark.parametrize("model", ["PINHOLE", "SIMPLE_RADIAL"])
def test_a_layer_is_where_the_camera_sees_it(model: str) -> None:
    """COLMAP's first pixel has its centre at (0.5, 0.5): half a pixel more or less is seen here."""
    params = [50.0, 50.0, 20.0, 15.0] if model == "PINHOLE" else [50.0, 20.0, 15.0, 0.0]
    view = View(
        "0", Camera(model, 40, 30, np.array(params)), np.eye(3), np.zeros(3), np.empty((0, 2)), np.empty(0, np.int64)
    )
    box = PixelBox(3, 4, 33, 24)
    window = window_behind(view.camera, box)
    x = np.arange(window.width) + window.x0 + 0.5
    ramp = np.tile(x.astype(np.float32), (window.height, 1))
    bent = through_lens(ramp, view, box)
    np.testing.assert_allclose(bent, np.tile(np.arange(3, 33) + 0.5, (20, 1)), atol=1e-3)


def test_layers_joined_again_by_others_are_the_picture(tmp_path: Path) -> None:
    """FFmpeg's own decoder of OpenEXR, and the formula that the layers state."""
    import av

    noisy = CameraLook(np.ones(3), np.eye(2) * 1.5**2, np.full((8, 3), 2.0), 0.5)
    plate = np.random.default_rng(3).integers(20, 230, GREY.shape).astype(np.uint8)
    one = replace(_flat(0.6, 2.0, slice(0, 15)), transmitted=np.full((*BOX.shape, 3), 0.7, np.float32))
    joined = occlude_mutually([one, _flat(0.2, 3.0, slice(10, 30), hidden=0.4)])
    composite = composite_objects(plate, joined, noisy, 5)
    shot = Frame(0, "a/0.png", None, None, None)
    names = [SimpleNamespace(model=SimpleNamespace(name=name)) for name in ("one", "two")]
    sink = CompositingLayers(tmp_path, names, [shot], 3.0)  # type: ignore[arg-type]
    sink.plate(shot, plate)
    for number, item in enumerate(joined):
        sink.layers(shot, number, item)
    sink.composite(shot, composite)

    def read(layer: str) -> np.ndarray:
        (file,) = (tmp_path / layer).rglob("*.exr")
        with av.open(str(file)) as container:
            frame = next(container.decode(video=0))
        name = frame.format.name
        order = {"gray": (0,), "gbrp": (2, 0, 1), "gbra": (2, 0, 1, 3)}[name[:4]]
        kind = np.dtype(np.float16 if name.endswith("16le") else np.float32)
        planes = [
            np.frombuffer(bytes(plane), kind).reshape(frame.height, -1)[:, : frame.width] for plane in frame.planes
        ]
        return np.stack([planes[k] for k in order], axis=-1).astype(np.float32)

    covering = read("object")
    light = read("plate") * read("shadow") * (1 - covering[..., 3:]) + covering[..., :3]
    again = np.rint(linear_to_srgb(light))
    assert np.abs(again - composite.image).max() <= 1
    assert (again == composite.image).mean() > 0.99
    depth = read("depth")[..., 0]
    assert (depth[:, :15] == 2.0 * 3.0).all()  # metres
    assert (depth[:, 30:] == 0).all()


class _Footage:
    """Three frames without a pose."""

    start_s = 0.0
    frames = tuple(SimpleNamespace(index=k, name=str(k), time_s=None, view=None, row=None) for k in range(3))

    def __iter__(self) -> Iterator[tuple[Any, np.ndarray]]:
        for frame in self.frames:
            yield frame, GREY


NOTHING: Any = None


def test_the_context_is_released_where_a_renderer_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    released = []
    monkeypatch.setattr(compositor, "gl_context", lambda: SimpleNamespace(release=lambda: released.append(1)))

    def broken(*_: object) -> None:
        raise OSError("no shader")

    monkeypatch.setattr(compositor, "_renderer", broken)
    objects: Any = [SimpleNamespace(body=None, moves=False)]
    with pytest.raises(OSError, match="no shader"):
        compositor.Compositor(objects, NOTHING, NOTHING, 0.0)
    assert released == [1]


def test_each_result_has_its_own_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    place = SimpleNamespace(position=np.zeros(3), basis=np.eye(3), support="plane 0")
    model = SimpleNamespace(name="a", warnings=())
    placed = SimpleNamespace(
        model=model,
        size=SimpleNamespace(warnings=()),
        warnings=(),
        size_m={},
        placement=place,
        heading_deg=0.0,
        body=None,
        moves=False,
    )
    monkeypatch.setattr(compositor, "gl_context", lambda: SimpleNamespace(release=lambda: None))
    monkeypatch.setattr(compositor, "_renderer", lambda *_: SimpleNamespace(environment=None))
    objects: Any = [placed, placed]
    footage: Any = _Footage()
    drawing = compositor.Compositor(objects, NOTHING, NOTHING, 0.0)
    one, two = compositor.composite_footage(drawing, footage, NOTHING, lambda *_: None)
    one.seconds["render"] = -1.0  # type: ignore[index]
    assert two.seconds["render"] >= 0

"""Two ways to draw the same object, lit triangle by triangle and gathered first; and a machine that can do neither."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from insertion.light.environment_map import HEIGHT, WIDTH, Environment
from insertion.render import deferred
from insertion.render.body import body_of
from insertion.render.gpu import gl_context
from insertion.render.renderer import ObjectImage, ObjectRenderer
from insertion.scene.camera_rays import Window
from metric_base.arrays import FloatArray
from models3d.gltf.model_reader import read_model
from tests.synthetic.insertions import write_glb
from tests.synthetic.rooms.shapes import solid
from tests.synthetic.rooms.solids import Mesh

WINDOW = Window(150.0, 150.0, 60.0, 50.0, 0, 0, 121, 97)
UP = np.array([0.0, -1.0, 0.0])
AXES = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], UP])
#: The camera looks along z, y down; the object is 3 m ahead, turned a little.
VIEW = np.eye(3), np.array([0.0, 0.4, 3.0])


@pytest.fixture(scope="module")
def renderer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ObjectRenderer]:
    model = read_model(write_glb(solid("chair", np.array([0.5, 0.5, 1.0])), tmp_path_factory.mktemp("model") / "c.glb"))
    radiance = np.random.default_rng(1).random((HEIGHT, WIDTH, 3)).astype(np.float32)
    context = gl_context()
    body = body_of(model, np.zeros(3), AXES, np.array([0.6, 0.0, -0.8]), 1.0)
    yield ObjectRenderer(context, body, Environment(radiance, AXES, radiance[..., 0]))
    context.release()


def _forward(renderer: ObjectRenderer, rotation: FloatArray, translation: FloatArray) -> ObjectImage:
    renderer._solid = False
    image = renderer.image(WINDOW, rotation, translation)
    renderer._solid = True
    return image


def test_deferred_and_direct_shading_are_equal(renderer: ObjectRenderer) -> None:
    gathered, forward = renderer.image(WINDOW, *VIEW), _forward(renderer, *VIEW)
    inside = (gathered.alpha > 0.999) & (forward.alpha > 0.999)
    assert inside.sum() > 500
    # the forward target keeps colours as half floats and lights every triangle of a pixel
    difference = np.abs(gathered.colour - forward.colour)[inside] / forward.colour.max()
    assert np.quantile(difference, 0.95) < 2e-3
    assert difference.max() < 0.2
    assert np.abs(gathered.alpha - forward.alpha).max() < 0.3  # 16 samples and 4
    np.testing.assert_allclose(gathered.depth[inside], forward.depth[inside], rtol=1e-5)


def test_edges_have_the_coverage_of_16_samples(renderer: ObjectRenderer) -> None:
    """Against an image of 12 times the resolution; four samples differ by 0.09 (root mean square)."""
    fine = Window(*(12 * value for value in (150.0, 150.0, 60.0, 50.0)), 0, 0, 12 * 121, 12 * 97)
    true = renderer.image(fine, *VIEW).alpha.reshape(97, 12, 121, 12).mean(axis=(1, 3))
    image = renderer.image(WINDOW, *VIEW)
    is_edge = (true > 0.02) & (true < 0.98)
    assert np.sqrt(((image.alpha - true)[is_edge] ** 2).mean()) < 0.06
    is_dark = is_edge & ~(image.colour.max(axis=-1) > 0) & (image.alpha > 0)
    assert not is_dark.any()  # no black specks


def test_overlapping_triangles_remove_a_light_once(renderer: ObjectRenderer) -> None:
    body = renderer.body
    twice = replace(body, parts=(*body.parts, *body.parts))
    both = ObjectRenderer(renderer._context, twice, renderer.environment)
    assert (1 - renderer.plane.share).max() > 0.5
    np.testing.assert_allclose(both.plane.share, renderer.plane.share, atol=1e-4)


def test_the_shadow_of_a_second_object_is_that_of_both_over_that_of_the_first(renderer: ObjectRenderer) -> None:
    body = renderer.body
    same = ObjectRenderer(renderer._context, body, renderer.environment, casters=[body], earlier=[body])
    np.testing.assert_allclose(same.plane.share, 1.0, atol=1e-4)  # where the first removes all light, too


def _dome(cells: int) -> Mesh:
    """A flat dome 1 m wide of many small triangles."""
    across = np.linspace(-0.5, 0.5, cells + 1)
    y, x = (grid.ravel() for grid in np.meshgrid(across, across, indexing="ij"))
    row = np.arange(len(x)).reshape(cells + 1, cells + 1)
    quads = np.stack([row[:-1, :-1], row[:-1, 1:], row[1:, 1:], row[1:, :-1]], axis=-1).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return Mesh(np.column_stack([x, y, 0.1 - 0.2 * (x**2 + y**2)]), faces, ("wood",) * len(faces))


def test_small_triangles_are_lit_on_the_side_that_is_seen(renderer: ObjectRenderer, tmp_path: Path) -> None:
    """A pixel that a triangle covers in part has its position within the triangle, whatever its orientation."""
    above = np.ones((HEIGHT, WIDTH, 3), np.float32)
    above[HEIGHT // 2 :] = 0.0
    body = body_of(
        read_model(write_glb(_dome(40), tmp_path / "d.glb")), np.zeros(3), AXES, np.array([0.6, 0.0, -0.8]), 1.0
    )
    dome = ObjectRenderer(renderer._context, body, Environment(above, AXES, above[..., 0]))
    view = np.eye(3), np.array([0.0, 0.4, 1.2])
    for image in (dome.image(WINDOW, *view), _forward(dome, *view)):
        bright = image.colour.mean(axis=-1)[image.alpha > 0.3] / image.alpha[image.alpha > 0.3]
        assert len(bright) > 1000
        assert np.mean(bright < 0.6 * np.median(bright)) < 0.002


def test_tiles_leave_no_seam(renderer: ObjectRenderer, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = renderer.image(WINDOW, *VIEW)
    monkeypatch.setattr(deferred, "TILE", 64)
    tiled = renderer.image(WINDOW, *VIEW)
    assert np.mean(np.abs(tiled.colour - whole.colour) > 1e-3) < 1e-3
    np.testing.assert_allclose(tiled.depth, whole.depth, rtol=1e-4)


def test_an_outline_between_two_images_changes_neither(renderer: ObjectRenderer) -> None:
    before = renderer.image(WINDOW, *VIEW)
    grown = renderer.outline(WINDOW, *VIEW, 1.2)
    assert grown.sum() > 1.2 * before.alpha.sum()
    np.testing.assert_array_equal(renderer.image(WINDOW, *VIEW).colour, before.colour)


def test_without_opengl_the_message_names_the_package(tmp_path: Path) -> None:
    words = [str(tmp_path), "--model", "m.glb", "--out", str(tmp_path / "o.mp4")]
    code = "import sys; from metric_cli.insert_object.insert import main; sys.exit(main(sys.argv[1:]))"
    hidden = os.environ | {"__EGL_VENDOR_LIBRARY_FILENAMES": str(tmp_path / "no.json")}
    done = subprocess.run(
        [sys.executable, "-c", code, *words], env=hidden, capture_output=True, text=True, check=False, timeout=300
    )
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "apt-get install libegl1" in line

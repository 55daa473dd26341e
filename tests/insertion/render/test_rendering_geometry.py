"""Geometry of drawn objects, without a renderer: bodies, shadow rays, windows behind a lens, layers on the plane."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.projection.cameras import view_rays
from estimator.records.scene import Camera, View
from insertion.light.environment_map import HEIGHT, WIDTH, Environment, map_directions
from insertion.light.light_samples import LightSamples
from insertion.render import layers as boxes
from insertion.render import shadow_maps, studio
from insertion.render.body import (
    SPOTS,
    Body,
    BodyPart,
    _area,
    _mean_colour,
    _spread_over,
    body_of,
    environment_with_objects,
)
from insertion.render.layers import ObjectLayers, shadow_layer, through_lens
from insertion.render.renderer import ObjectImage
from insertion.render.shadow_maps import MAP_PIXELS, ShadowCatcher
from insertion.scene.camera_rays import Window, camera_rays, focal_lengths, pixel_grid, ray_through
from insertion.scene.pixel_box import PixelBox
from models3d.model import Material, Mesh, Model
from tests.insertion.composite.test_received import _view

# Published values, written out so that a changed rule fails a test.
CAST_SIZES = 3.0

CAMERA = Camera("PINHOLE", 320, 240, np.array([280.0, 300.0, 150.0, 130.0]))
LENS = Camera("SIMPLE_RADIAL", 320, 240, np.array([280.0, 160.0, 120.0, -0.15]))
MATERIAL = Material(np.array([0.8, 0.4, 0.2, 1.0]), 0.0, 0.9)


def _part(vertices: np.ndarray, faces: np.ndarray, **changes: Any) -> BodyPart:
    count = len(vertices)
    values = {"normals": np.zeros((count, 3)), "uv": np.zeros((count, 2)), "tint": np.ones((count, 4))} | changes
    return BodyPart(vertices, values["normals"], values["uv"], values["tint"], faces, values.get("material", MATERIAL))


def _square(side: float = 1.0, z: float = 0.0) -> BodyPart:
    corners = side * np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]]) + [0, 0, z]
    return _part(corners, np.array([[0, 1, 2], [0, 2, 3]]))


def _model(low: tuple[float, float, float], high: tuple[float, float, float]) -> Model:
    corners = np.array([low, high, (low[0], high[1], high[2])], dtype=float)
    normals = np.tile([0.0, 0.0, 1.0], (3, 1))
    return Model("m", (Mesh(corners, normals, np.zeros((3, 2)), np.array([[0, 1, 2]]), MATERIAL),))


def test_a_body_has_the_position_and_the_heading_of_its_object() -> None:
    """A model of 2 x 4 x 1 m whose front is +z, in a scene of 0.5 units a metre, looking along +x."""
    body = body_of(_model((0, 1, 0), (2, 5, 1)), np.array([7.0, 8.0, 9.0]), np.eye(3), np.array([1.0, 0, 0]), 0.5)
    scene = body.position + body.unit * body.corners
    assert body.unit == pytest.approx(2.0)
    # file x points along up x heading = +y; up is file y; +z is +x
    assert scene == pytest.approx(np.array([[6.75, 7.5, 9.0], [7.25, 8.5, 11.0], [7.25, 7.5, 11.0]]))
    assert body.parts[0].normals == pytest.approx(np.tile([1.0, 0, 0], (3, 1)))
    assert body.parts[0].tint.tolist() == np.ones((3, 4)).tolist()
    bounds = np.array([[0.0, 0, 0], [2, 8, 1]])
    other = body_of(_model((0, 1, 0), (2, 5, 1)), np.zeros(3), np.eye(3), np.array([1.0, 0, 0]), 0.5, bounds)
    assert other.unit == 4.0
    assert (other.unit * other.corners)[:, 2] == pytest.approx([0.5, 2.5, 2.5])


def test_parts_are_transformed_into_the_frame_of_another_body() -> None:
    one, two = (
        Body((_square(),), np.array(at), np.eye(3), unit) for at, unit in (((1.0, 2, 3), 2.0), ((4.0, 2, 3), 0.5))
    )
    (part,) = one.parts_of(two)
    assert part.vertices * one.unit + one.position == pytest.approx(two.corners * two.unit + two.position)
    assert one.is_near(two)
    assert not one.is_near(replace(two, position=np.array([8.6, 2, 3])))
    assert one.is_near(replace(two, position=np.array([8.4, 2, 3])))
    rotation, translation = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]), np.array([0.1, 0.2, 0.3])
    turn, offset = one.camera(rotation, translation)
    there = rotation @ (one.position + one.unit * one.corners[1]) + translation
    assert one.unit * (turn @ one.corners[1] + offset) == pytest.approx(there)


def test_sample_points_on_triangles_are_proportional_to_area() -> None:
    small, large = _square(1.0), _square(2.0, z=5.0)
    both = _part(np.concatenate([small.vertices, large.vertices]), np.concatenate([small.faces, small.faces + 4]))
    spots, normals = _spread_over(both)
    assert len(spots) == SPOTS
    assert np.abs(normals - [0, 0, 1]).max() < 1e-9
    upper = spots[:, 2] > 2.5
    assert upper.mean() == pytest.approx(0.8, abs=0.02)
    assert spots[upper, :2].mean(axis=0) == pytest.approx([0, 0], abs=0.03)
    assert spots[upper, :2].std(axis=0) == pytest.approx([2 / np.sqrt(12)] * 2, rel=0.03)
    assert _area(both) == pytest.approx(5.0)
    flat = _part(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    assert not _spread_over(flat)[0].any()


def test_the_albedo_is_base_colour_times_tint_times_texture() -> None:
    texture = np.full((32, 32, 4), 188, np.uint8)
    tint = np.tile([0.5, 1.0, 1.0, 1.0], (4, 1))
    material = replace(MATERIAL, base_texture=texture)
    painted = _part(_square().vertices, _square().faces, tint=tint, material=material)
    light = ((188 / 255 + 0.055) / 1.055) ** 2.4
    assert _mean_colour(painted) == pytest.approx(light * np.array([0.4, 0.4, 0.2]), rel=1e-5)
    body = Body((_square(1.0), replace(painted, vertices=2 * painted.vertices)), np.zeros(3), np.eye(3), 1.0)
    whole = (np.array([0.8, 0.4, 0.2]) + 4 * light * np.array([0.4, 0.4, 0.2])) / 5
    assert body.albedo == pytest.approx(whole, rel=1e-5)


def test_other_objects_are_in_the_environment_map_of_reflections() -> None:
    environment = Environment(
        np.full((HEIGHT, WIDTH, 3), 2.0, np.float32), np.eye(3), np.ones((HEIGHT, WIDTH), np.float32)
    )
    mirror = Body((_square(0.2),), np.zeros(3), np.eye(3), 1.0)
    board = _square(1.0)
    upright = replace(board, vertices=board.vertices[:, [2, 0, 1]])  # across x
    two = Body((upright,), np.array([1.0, 0, 0]), np.eye(3), 1.0)
    shown = environment_with_objects(environment, mirror, [two])
    changed = np.abs(shown.radiance - 2.0).max(axis=-1) > 1e-3
    directions = map_directions()[changed]
    assert directions[:, 0].min() > 0.75
    assert np.abs(directions[:, 1] / directions[:, 0]).max() < 0.55
    assert np.abs(directions[:, 2] / directions[:, 0]).max() < 0.55
    assert shown.radiance[changed] == pytest.approx(
        np.tile(2.0 * MATERIAL.base_color[:3], (changed.sum(), 1)), rel=0.01
    )
    assert environment_with_objects(environment, mirror, []) is environment
    nearer = replace(two, position=np.array([0.5, 0, 0]), parts=(replace(upright, tint=0 * upright.tint),))
    assert environment_with_objects(environment, mirror, [nearer, two]).radiance[HEIGHT // 2, WIDTH // 2].max() == 0


def test_the_shadow_map_of_a_light_covers_the_sphere_of_the_casters() -> None:
    directions = np.array([[0.0, 0.6, 0.8], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    near = np.array([0.0, 0.25, 0.5])
    lights = LightSamples(directions, np.ones((3, 3)), near, np.zeros(3))
    right, above = shadow_maps.light_axes(lights, 1.5)
    wide = 1.5 / np.sqrt(1 - np.minimum(1.5 * near, 0.9) ** 2)
    assert np.linalg.norm(right, axis=1) == pytest.approx(1 / wide)
    assert np.linalg.norm(above, axis=1) == pytest.approx(1 / wide)
    for one, two, way in zip(right, above, directions, strict=True):
        assert [one @ two, one @ way, two @ way] == pytest.approx([0, 0, 0], abs=1e-12)
        assert np.cross(way, one) == pytest.approx(two)


@pytest.mark.parametrize("near", [0.0, 0.2])
def test_a_shadow_is_projected_along_the_rays_of_its_light(near: float) -> None:
    turned = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # the plane's up is +y
    direction = np.array([0.48, -0.36, 0.8])
    matrix = shadow_maps._shadow_matrix(direction, near, turned, 4.0)
    point = np.array([0.3, -0.2, 0.9])  # along the plane's axes
    clip = matrix @ np.append(turned.T @ point, 1.0)
    way = direction - near * point  # towards the light from the point, in units of its distance
    meets = point - way * point[2] / way[2]
    assert 4.0 * clip[:2] / clip[3] == pytest.approx(meets[:2])
    assert clip[2] == pytest.approx(direction[2] * 0.9 / 400)
    on_plane = matrix @ np.append(turned.T @ [1.0, 2.0, 0.0], 1.0)
    assert 4.0 * on_plane[:2] / on_plane[3] == pytest.approx([1.0, 2.0])


def test_light_on_the_open_plane_falls_with_the_cube_of_the_distance() -> None:
    lights = LightSamples(np.array([[0.0, 0, 1]]), np.array([[3.0, 2.0, 1.0]]), np.array([0.5]), np.zeros(1))
    at = np.linspace(-4.0, 4.0, 65)[1::2]
    plane = np.stack([*np.meshgrid(at, at), np.zeros((32, 32))], axis=-1)
    light = shadow_maps._open_light(lights.directions, lights, plane, np.ones((32, 32)))
    half = shadow_maps._open_light(lights.directions, lights, plane, np.full((32, 32), 0.5))
    np.testing.assert_allclose(half, light / 2, rtol=1e-5)  # the scene takes half of the lamp
    assert light.shape == (MAP_PIXELS, MAP_PIXELS, 3)
    for row, column in ((MAP_PIXELS // 2, MAP_PIXELS // 2), (200, 700)):
        x, y = ((np.array([column, row]) + 0.5) / MAP_PIXELS * 2 - 1) * 4.0
        far = np.sqrt(x * x + y * y + 4.0)  # of a lamp 2 above
        assert light[row, column] == pytest.approx(np.array([3.0, 2.0, 1.0]) * (2 / far) * (2 / far) ** 2, rel=0.02)


def test_clip_space_is_the_pixels_of_the_window() -> None:
    window = Window(280.0, 300.0, 150.0, 130.0, 20, -10, 200, 120)
    rotation, translation = _view().rotation, np.array([0.1, -0.2, 0.5])
    clip = window.projection(rotation, translation, 0.5, 8.0)
    for local in ([0.0, 0.0, 2.0], [0.3, -0.2, 1.0]):
        at = clip @ np.append(rotation.T @ (np.array(local) - translation), 1.0)
        pixel = np.array([280.0, 300.0]) * local[:2] / local[2] + [150, 130]
        assert (at[:2] / at[3] + 1) / 2 * [200, 120] + [20, -10] == pytest.approx(pixel)
        assert at[3] == pytest.approx(local[2])
    for depth, end in ((0.5, -1.0), (8.0, 1.0)):
        at = clip @ np.append(rotation.T @ (np.array([0, 0, depth]) - translation), 1.0)
        assert at[2] / at[3] == pytest.approx(end)
    assert focal_lengths(CAMERA) == (280.0, 300.0, 150.0, 130.0)
    assert focal_lengths(LENS) == (280.0, 280.0, 160.0, 120.0)


def test_rays_go_through_the_centres_of_pixels() -> None:
    assert pixel_grid(3, 5, 2, 2).tolist() == [[3.5, 5.5], [4.5, 5.5], [3.5, 6.5], [4.5, 6.5]]
    rays = camera_rays(CAMERA)
    assert rays.shape == (240, 320, 2)
    assert rays[20, 30] == pytest.approx([(30.5 - 150) / 280, (20.5 - 130) / 300], rel=1e-5)
    pixel = np.array([[40.0, 60.0]])
    flat = view_rays(LENS, pixel)[0, :2]
    bent = flat * (1 - 0.15 * flat @ flat)
    assert 280 * bent + [160, 120] == pytest.approx(pixel[0], abs=1e-6)
    view = _view()
    ray = ray_through(view, 160.0 + 28, 120.0 - 14)
    assert view.rotation @ ray == pytest.approx([0.1, -0.05, 1.0])


def test_the_undistorted_window_contains_all_rays_of_a_box() -> None:
    box = PixelBox(100, 60, 180, 140)
    plain = Camera("PINHOLE", 320, 240, np.array([256.0, 512.0, 150.0, 130.0]))
    assert boxes.window_behind(plain, box) == Window(256.0, 512.0, 150.0, 130.0, 99, 59, 82, 82)
    wide = boxes.window_behind(LENS, PixelBox(0, 0, 320, 240))
    rays = camera_rays(LENS).reshape(-1, 2)
    at = rays * 280 + [160, 120] - [wide.x0, wide.y0]
    assert at.min() >= 1
    assert (at <= np.array([wide.width, wide.height]) - 1).all()
    assert wide.x0 < -3


def _at(view: View, places: np.ndarray) -> np.ndarray:
    local = places @ view.rotation.T + view.translation
    return np.asarray(local[:, :2] / local[:, 2:] * view.camera.params[:2] + view.camera.params[2:])


def _box_body() -> Body:
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0.0, 1.0)])
    return Body((_part(corners, np.array([[0, 1, 2]])),), np.array([0.2, 0.1, 0.0]), np.eye(3), 0.4)


def test_boxes_contain_the_object_and_shadows_of_up_to_3_sizes() -> None:
    view, body = _view(), _box_body()
    pixels = _at(view, body.position + body.unit * body.corners)
    margin = boxes.MARGIN_PX
    box = boxes.object_box(view, body)
    assert box == PixelBox(
        *(np.floor(pixels.min(axis=0)) - margin).astype(int), *(np.ceil(pixels.max(axis=0)) + margin).astype(int)
    )
    behind = replace(body, position=np.array([-0.6, -9.0, 1.0]))
    assert boxes.object_box(view, behind) is None
    assert boxes.object_box(view, replace(body, position=np.array([50.0, 0, 0]))) is None
    share = np.ones((64, 64, 3), np.float32)
    share[10:20, 30:50] = 1 - 0.0041
    share[40:50, 5:15] = 1 - 0.0039  # too little to be a shadow
    plane = ShadowCatcher(share, 2.0)
    places = boxes._shadow_places(plane)
    assert places.min(axis=0) == pytest.approx([(30.5 / 32 - 1) * 2, (10.5 / 32 - 1) * 2])
    assert places.max(axis=0) == pytest.approx([(49.5 / 32 - 1) * 2, (19.5 / 32 - 1) * 2])
    dark = boxes.shadow_box(view, body, plane)
    assert dark is not None
    at = _at(view, body.position + body.unit * np.column_stack([places, np.zeros(len(places))]))
    assert dark.x0 == pytest.approx(np.floor(at[:, 0].min()) - margin)
    assert dark.y1 == pytest.approx(np.ceil(at[:, 1].max()) + margin)
    below = replace(view, translation=-view.rotation @ (view.centre * [1, 1, -1]))
    assert boxes.shadow_box(below, body, plane) is None
    assert boxes.shadow_box(view, body, ShadowCatcher(np.ones_like(share), 2.0)) is None
    far = boxes.cast_box(view, body, np.array([[0.6, 0.0, 0.8]]))
    ends = np.concatenate([body.corners, body.corners - body.corners[:, 2:] / 0.8 * [0.6, 0.0, 0.8]])
    cast = _at(view, body.position + body.unit * ends)
    assert far == PixelBox(
        *(np.floor(cast.min(axis=0)) - margin).astype(int), *(np.ceil(cast.max(axis=0)) + margin).astype(int)
    )
    low = boxes.cast_box(view, body, np.array([[1.0, 0.0, 0.0]]))
    ends = np.concatenate([body.corners, body.corners - (body.corners[:, 2:] > 0) * [CAST_SIZES, 0.0, 0.0]])
    cast = _at(view, body.position + body.unit * ends)
    assert low is not None
    assert low.x0 == max(int(np.floor(cast[:, 0].min())) - margin, 0)


def test_layers_are_distorted_by_the_lens_to_half_a_pixel() -> None:
    view = replace(_view(), camera=LENS)
    box = PixelBox(20, 30, 120, 110)
    window = boxes.window_behind(LENS, box)
    x, y = np.meshgrid(np.arange(window.width) + 0.5 + window.x0, np.arange(window.height) + 0.5 + window.y0)
    ideal = np.dstack([(x - 160) / 280, (y - 120) / 280]).astype(np.float32)
    bent = through_lens(ideal, view, box)
    assert bent == pytest.approx(camera_rays(LENS)[box.slices], abs=2e-4)
    nearest = through_lens(ideal[..., 0], view, box, nearest=True)
    assert np.abs(nearest - camera_rays(LENS)[box.slices][..., 0]).max() < 0.6 / 280
    assert np.unique(nearest).size <= window.width


def test_the_shadow_of_a_pixel_is_at_the_intersection_of_its_ray_and_the_plane() -> None:
    view, body = _view(), _box_body()
    size = 64
    rows, columns = np.indices((size, size))
    share = np.dstack([columns / 100, rows / 100, 0 * rows + 0.25]).astype(np.float32)
    renderer: Any = SimpleNamespace(body=body, plane=ShadowCatcher(share, 1.0))
    box = PixelBox(0, 0, 320, 240)
    seen, depth = shadow_layer(renderer, view, box)
    for place in ([0.1, -0.2], [-0.3, 0.25]):
        scene = body.position + body.unit * np.array([*place, 0.0])
        column, row = np.floor(_at(view, scene[None])[0]).astype(int)
        assert depth[row, column] == pytest.approx(float((view.rotation @ scene + view.translation)[2]), rel=0.01)
        cell = (np.array(place) + 1) / 2 * size - 0.5
        assert seen[row, column, :2] == pytest.approx(cell / 100, abs=0.012)
    assert np.isnan(depth[0]).all() == bool(np.isnan(depth[0, 0]))
    beside = _at(view, (body.position + body.unit * np.array([1.3, 0.0, 0.0]))[None])[0].astype(int)
    assert seen[beside[1], beside[0]].tolist() == [1, 1, 1]


def test_the_silhouette_is_the_box_of_pixels_with_half_coverage() -> None:
    alpha = np.zeros((20, 30), np.float32)
    alpha[4:9, 10:13] = 0.6
    alpha[2, 2] = 0.5
    image = ObjectImage(np.zeros((20, 30, 3), np.float32), alpha, alpha)
    layers = ObjectLayers(PixelBox(100, 50, 130, 70), image, np.ones((20, 30, 3), np.float32), alpha)
    assert layers.silhouette == (110, 54, 3, 5)
    assert replace(layers, image=replace(image, alpha=0 * alpha)).silhouette is None


def test_the_window_behind_a_strong_lens_is_at_most_three_times_the_image_to_each_side() -> None:
    box = PixelBox(0, 0, 200, 200)
    fisheye = Camera("OPENCV_FISHEYE", 200, 200, np.array([94.0, 94.0, 100.0, 100.0, 0.0, 0.0, 0.0, 0.0]))
    window = boxes.window_behind(fisheye, box)
    assert 1200 <= window.width <= 1206, "the corner of the image is at 86 degrees"
    pinhole = boxes.window_behind(Camera("PINHOLE", 200, 200, np.array([94.0, 94.0, 100.0, 100.0])), box)
    assert 200 <= pinhole.width <= 205


def test_pixels_without_a_ray_are_outside_of_the_window() -> None:
    """A wide lens as `SIMPLE_RADIAL`: its distortion has a maximum within the corners of the image."""
    camera = Camera("SIMPLE_RADIAL", 848, 480, np.array([477.4, 424.0, 240.0, -0.149443]))
    view = View("v", camera, np.eye(3), np.zeros(3), np.empty((0, 2)), np.empty(0, dtype=np.int64))
    box = PixelBox(0, 0, 848, 480)
    window = boxes.window_behind(camera, box)
    assert 848 < window.width < 3 * 848
    bent = boxes.through_lens(np.ones((window.height, window.width), np.float32), view, box)
    assert bent[240, 424] == 1
    assert bent[0, 0] == 0
    assert np.isnan(boxes.through_lens(np.ones_like(bent), view, box, nearest=True)[0, 0])
    assert boxes.window_behind(camera, PixelBox(0, 0, 1, 1)).width > 0, "no pixel of the box has a ray"


def test_studio_views_are_from_above() -> None:
    axes = studio.camera_axes(30.0, 20.0)
    assert axes @ axes.T == pytest.approx(np.eye(3))
    assert np.linalg.det(axes) == pytest.approx(1)
    assert axes[2] @ [0, 1, 0] == pytest.approx(-np.sin(np.radians(20)))
    assert axes[0] @ [0, 1, 0] == pytest.approx(0)
    assert axes[1] @ [0, 1, 0] < 0  # down
    assert -axes[2][[0, 2]] == pytest.approx(np.cos(np.radians(20)) * np.array([0.5, np.sqrt(0.75)]))
    rgba = np.zeros((9, 9, 4), np.uint8)
    rgba[2:5, 3:7] = (60, 30, 10, 128)
    cropped = studio.crop_to_object(rgba)
    assert cropped.shape == (3, 4, 4)
    assert cropped[0, 0].tolist() == [120, 60, 20, 128]
    half = cropped.copy()
    half[:, :2, 3] = 127
    assert studio.StudioView(half, 1.0).foreground_share == 0.5

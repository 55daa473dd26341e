"""The light outdoors: a sun that shadows show, a sky that no image shows, and which pixels are sky."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.records.objects import SupportPlane
from estimator.records.scene import Camera, Scene, View
from insertion.colour import linear_to_srgb
from insertion.footage.footage import SceneImages
from insertion.light.direction_samples import sky_pixels
from insertion.light.environment_estimate import OutdoorLight, environment_at, looks_down, sky_light
from insertion.light.environment_map import HEIGHT, Environment, map_directions
from insertion.light.light_model import LightModel
from insertion.light.sun import sun_direction
from insertion.scene.camera_rays import camera_rays
from insertion.scene.occupancy import occupancy_of
from insertion.scene.point_cloud import ColouredPoints
from metric_base.arrays import FloatArray

# Published values, written out so that a changed rule fails a test.
GROUND_ALBEDO = 0.25

UP = np.array([0.0, 0.0, 1.0])
GROUND = SupportPlane(np.eye(3), 0.0, 0.01, 100, np.zeros(2), 1.0, np.ones((2, 2), dtype=bool))
#: Foot (n, 2) and height (n,) of posts next to a way along +y.
FEET = np.random.default_rng(3).uniform((-5, 0), (5, 26), (60, 2))
HEIGHTS = np.random.default_rng(4).uniform(0.8, 2.2, 60)


class _Drawn(SceneImages):
    """Pictures of the posts' ground; sun : (3,) the way to it; without, the ground is as dark around each foot.

    A shadow leaves the fraction `shade` of red light, 1.2 times it of green and 1.7 times it of blue.
    """

    def __init__(self, sun: FloatArray | None, shade: float = 0.18, pitch_deg: float = 20.0) -> None:
        camera = Camera("PINHOLE", 160, 120, np.array([100.0, 100.0, 80.0, 50.0]))
        down = np.radians(pitch_deg)
        ahead = np.array([0, np.cos(down), -np.sin(down)])
        rotation = np.array([[1.0, 0, 0], np.cross(ahead, [1.0, 0, 0]), ahead])
        centres = np.array([[0, 3.0 * k - 2, 1.6] for k in range(8)])
        none = (np.empty((0, 2)), np.empty(0, dtype=np.int64))
        views = tuple(View(f"{k}", camera, rotation, -rotation @ at, *none) for k, at in enumerate(centres))
        self.scene = Scene(Path("drawn"), "colmap", views, np.empty((0, 3)))
        self.rows, self._sun, self._shade = tuple(range(8)), sun, shade * np.array([1.0, 1.22, 1.67])

    def image(self, row: int) -> NDArray[np.uint8]:
        view = self.scene.views[row]
        rays = np.dstack([camera_rays(view.camera), np.ones((120, 160))]) @ view.rotation
        with np.errstate(divide="ignore"):
            depth = np.where(rays[..., 2] < 0, -view.centre[2] / rays[..., 2], 1e3)
        at = (view.centre + rays * depth[..., None])[..., :2]
        reach = np.zeros((len(FEET), 2)) if self._sun is None else -HEIGHTS[:, None] * self._sun[:2] / self._sun[2]
        away = at[:, :, None] - FEET
        along = np.clip((away * reach).sum(axis=-1) / np.maximum((reach**2).sum(axis=-1), 1e-9), 0, 1)
        dark = np.linalg.norm(away - along[..., None] * reach, axis=-1).min(axis=-1) < (
            0.4 if self._sun is None else 0.15
        )
        paint = 0.3 * np.exp(0.15 * np.sin(3.1 * at[..., 0]) + 0.15 * np.sin(1.7 * at[..., 1]))
        light = paint[..., None] * np.where(dark[..., None], self._shade, 1.0)
        return np.rint(linear_to_srgb(light.astype(np.float32))).astype(np.uint8)


def _posts() -> ColouredPoints:
    """Points on the ground and on the posts."""
    flat = np.random.default_rng(5).uniform((-8, 0), (8, 30), (3000, 2))
    posts = [
        np.column_stack([np.tile(foot, (12, 1)), np.linspace(0.1, high, 12)])
        for foot, high in zip(FEET, HEIGHTS, strict=True)
    ]
    points = np.concatenate([np.column_stack([flat, np.zeros(len(flat))]), *posts])
    return ColouredPoints(points, np.full(points.shape, np.nan, np.float32), dense=False)


@pytest.mark.parametrize(("elevation", "azimuth"), [(50, 200), (35, 310)])
def test_the_sun_is_the_direction_of_the_shadows_of_posts(elevation: float, azimuth: float) -> None:
    rise, turn = np.radians([elevation, azimuth])
    true = np.array([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)])
    sun = sun_direction(_posts(), _Drawn(true), GROUND)
    assert sun is not None
    assert sun @ true > np.cos(np.radians(12))


def test_without_shadows_of_half_the_light_there_is_no_sun() -> None:
    """The logarithm of the luminance decreases by 0.63, and by 1.04 in the shadows of the test above."""
    assert sun_direction(_posts(), _Drawn(np.array([-0.604, -0.22, 0.766]), shade=0.33), GROUND) is None


@pytest.mark.parametrize(("n", "has_sun"), [(99, False), (100, True)])
def test_a_sun_needs_100_points_that_cast_shadows(n: int, has_sun: bool) -> None:
    posts = _posts()
    heights = posts.points[:, 2]
    highest = np.argsort(-heights, kind="stable")[:n]
    kept = np.concatenate([highest, np.flatnonzero(heights < 0.16)])
    sun = np.array([-0.604, -0.22, 0.766])
    assert (sun_direction(posts.subset(kept), _Drawn(sun), GROUND) is not None) == has_sun


def test_dark_ground_around_posts_is_no_shadow() -> None:
    assert sun_direction(_posts(), _Drawn(None), GROUND) is None


def _half_seen() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Radiance, how far it is known and the share of sky: a blue sky on one side, grey ground below, no more."""
    directions = map_directions()
    seen = 1.0 * ((directions[..., 0] > 0) | (directions[..., 2] < 0))
    sky = seen * (directions[..., 2] > 0)
    shown = np.where(sky[..., None] > 0, [0.2, 0.3, 0.5], 0.3) * seen[..., None]
    return shown, seen, sky


def test_the_unseen_sky_has_the_radiance_that_the_ground_requires() -> None:
    whole, known, power = sky_light(*_half_seen(), 0.3, None)
    assert known[: HEIGHT // 2].min() == 1
    assert not power.any()
    lit = Environment(whole.astype(np.float32), np.eye(3), known.astype(np.float32)).irradiance(UP)
    assert lit == pytest.approx(np.full(3, np.pi * 0.3 / GROUND_ALBEDO), rel=0.01)


def test_the_power_of_the_sun_is_the_light_on_the_ground_minus_that_of_the_sky() -> None:
    sun = np.array([0.0, -0.6, 0.8])
    whole, known, power = sky_light(*_half_seen(), 0.3, sun)
    sky = Environment(whole.astype(np.float32), np.eye(3), known.astype(np.float32)).irradiance(UP)
    assert sky == pytest.approx(np.pi * np.array([0.2, 0.3, 0.5]), rel=0.01)
    assert sky + 0.8 * power == pytest.approx(np.full(3, np.pi * 0.3 / GROUND_ALBEDO), rel=0.01)


@pytest.mark.parametrize(("high", "fraction"), [(0.0, 1.0), (0.5, 0.5), (2.0, 0.0)])
def test_the_part_of_an_object_behind_a_wall_is_not_in_the_sun(high: float, fraction: float) -> None:
    """A wall at x = 1 and a sun at an elevation of 45 degrees: its shadow at x = 0 ends at its height minus one."""
    sun = np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5)])
    y, z = np.meshgrid(np.linspace(-4, 4, 81), np.linspace(0, 1 + high, 41))
    wall = np.column_stack([np.ones(y.size), y.ravel(), z.ravel()])
    flat = np.random.default_rng(6).uniform((-4, -4), (4, 4), (4000, 2))
    ends = np.array([[4.0, 4.0, 5.0]])
    points = np.concatenate([wall if high else wall[:0], np.column_stack([flat, np.zeros(len(flat))]), *[ends] * 30])
    cloud = ColouredPoints(points, np.full(points.shape, 0.3, np.float32), dense=True)
    occupancy = occupancy_of(cloud)
    lit = environment_at(np.zeros(3), 1.0, np.eye(3), cloud, _Drawn(sun), OutdoorLight(sun, occupancy))
    air = replace(occupancy, distance=np.full_like(occupancy.distance, 100.0))
    free = environment_at(np.zeros(3), 1.0, np.eye(3), cloud, _Drawn(sun), OutdoorLight(sun, air))
    assert lit.ambient is not None
    assert lit.lamps is not None
    assert free.lamps is not None
    in_map, complete = ((found.radiance - lit.ambient).sum() for found in (lit, free))
    assert in_map / complete == pytest.approx(fraction, abs=0.25)
    # the light itself is complete, because it is tested at each point
    assert lit.lamps.power == pytest.approx(free.lamps.power)
    assert lit.lamps.occupancy is occupancy


def test_the_sun_is_searched_if_the_cameras_look_down() -> None:
    """The upper edge of the image is 26.6 degrees above its axis; 5 % of its rows are 3 degrees."""
    sun = np.array([0.0, -0.6, 0.8])
    images = _Drawn(sun, pitch_deg=27.0)
    is_down = [looks_down(_Drawn(sun, pitch_deg=pitch), UP) for pitch in (20.0, 24.0, 27.0, 30.0)]
    assert is_down == [False, False, True, True]
    supports: Any = SimpleNamespace(up=SimpleNamespace(vector=UP), ground=lambda _: SimpleNamespace(plane=GROUND))
    source = LightModel(images.scene, images, supports, _posts()).source
    assert isinstance(source, OutdoorLight)
    assert source.sun is not None
    unknown = LightModel(images.scene, _Drawn(None, pitch_deg=27.0), supports, _posts()).source
    assert not isinstance(unknown, OutdoorLight)  # no shadow, no sky: not outdoors


def test_a_sky_that_no_image_shows_gives_a_quarter_of_the_light() -> None:
    below = 1.0 * (map_directions()[..., 2] < 0)
    sun = np.array([0.0, -0.6, 0.8])
    whole, known, power = sky_light(0.3 * below[..., None] * np.ones(3), below, 0 * below, 0.3, sun)
    sky = Environment(whole.astype(np.float32), np.eye(3), known.astype(np.float32)).irradiance(UP)
    assert sky == pytest.approx(np.full(3, 0.25 * np.pi * 0.3 / GROUND_ALBEDO), rel=0.02)
    assert sky + 0.8 * power == pytest.approx(np.full(3, np.pi * 0.3 / GROUND_ALBEDO), rel=0.01)


def test_sky_is_above_the_horizon_12_pixels_from_points_and_bright() -> None:
    colours = np.array([[0.2, 0.4, 0.8], [1, 1, 0.9], [0.6, 0.5, 0.4], [0.02, 0.03, 0.05], [1, 1, 1], [1, 1, 1]])
    rise, free = np.array([0.3, 0.3, 0.3, 0.3, -0.1, 0.3]), np.array([50, 50, 50, 50, 50, 3.0])
    assert sky_pixels(colours.astype(np.float32), rise, free).tolist() == [True, True, False, False, False, False]
    near = [
        sky_pixels(colours[0].astype(np.float32), np.array(0.3), np.array(pixels)).item() for pixels in (11.9, 12.1)
    ]
    assert near == [False, True]

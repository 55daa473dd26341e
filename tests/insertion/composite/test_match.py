"""The look of an image: its grain and its blur, as they were put in."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from insertion.colour import srgb_to_linear
from insertion.composite import camera_look
from insertion.composite.camera_look import (
    CameraLook,
    blur_layer,
    grain,
    measure_blur,
    measure_gain,
    measure_look,
)
from insertion.scene.pixel_box import PixelBox
from insertion.scene.point_cloud import ColouredPoints, VisiblePoints

SHAPE = (240, 320)
NOTHING = VisiblePoints(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0), False)
EMPTY = ColouredPoints(np.zeros((0, 3)), np.zeros((0, 3), np.float32), False)


def _patchwork(seed: int = 3) -> np.ndarray:
    """(h, w) turned squares of many greys: sharp edges in all directions, and plain parts."""
    import cv2

    generator = np.random.default_rng(seed)
    picture = np.full((SHAPE[0] * 4, SHAPE[1] * 4), 120, np.uint8)
    for _ in range(60):
        corner = cv2.boxPoints(
            (
                tuple(generator.uniform(0, [SHAPE[1] * 4, SHAPE[0] * 4])),
                tuple(generator.uniform(120, 500, 2)),
                float(generator.uniform(0, 90)),
            )
        )
        cv2.fillPoly(picture, [corner.astype(np.int32)], int(generator.integers(40, 210)))
    return np.asarray(cv2.resize(picture, SHAPE[::-1], interpolation=cv2.INTER_AREA), dtype=np.float32)


def _smear(picture: np.ndarray, length: int, down: bool) -> np.ndarray:
    import cv2

    kernel = np.full((length, 1) if down else (1, length), 1 / length, np.float32)
    return np.asarray(cv2.filter2D(picture, -1, kernel))


def _look(grey: np.ndarray) -> CameraLook:
    picture = np.repeat(np.clip(np.rint(grey), 0, 255).astype(np.uint8)[..., None], 3, axis=2)
    return measure_look(picture, NOTHING, EMPTY)


@pytest.mark.parametrize("sigma", [2.0, 5.0])
def test_an_object_gets_the_grain_of_the_picture(sigma: float) -> None:
    noise = np.random.default_rng(1).normal(0, sigma, SHAPE)
    look = _look(_patchwork() + noise)
    added = grain(look, PixelBox(0, 0, 80, 60), np.full((60, 80, 3), 120, np.float32), 7)
    assert added.std() == pytest.approx(sigma, rel=0.15)


@pytest.mark.parametrize("common", [0.0, 0.6])
@pytest.mark.parametrize("smooth", [0.0, 0.5, 0.75])
def test_grain_has_its_sigma_its_smoothness_and_what_channels_share(common: float, smooth: float) -> None:
    """Its finest differences are those of the plate, too; they were 0.4 to 0.6 of those of real frames."""
    import cv2

    generator = np.random.default_rng(1)
    own, shared = generator.normal(0, 1, (*SHAPE, 3)), generator.normal(0, 1, (*SHAPE, 1))
    noise = np.sqrt(1 - common) * own + np.sqrt(common) * shared
    noise = cv2.GaussianBlur(noise, (0, 0), smooth) if smooth else noise
    noise *= 4 / noise.std()
    look = measure_look(np.rint(122 + noise).astype(np.uint8), NOTHING, EMPTY)
    assert look.grain == pytest.approx(np.full(look.grain.shape, 4.0), rel=0.08)
    assert look.grain_px == pytest.approx(smooth, abs=0.09)
    assert look.common == pytest.approx(common, abs=0.08)
    drawn = grain(look, PixelBox(0, 0, *SHAPE[::-1]), np.full((*SHAPE, 3), 120, np.float32), 7)
    for values in (drawn - np.roll(drawn, 1, axis=1), drawn):
        true = noise - np.roll(noise, 1, axis=1) if values is not drawn else noise
        assert values.std(axis=(0, 1)) / true.std(axis=(0, 1)) == pytest.approx(np.ones(3), abs=0.1)


def test_texture_is_no_grain() -> None:
    import cv2

    texture = cv2.GaussianBlur(np.random.default_rng(2).normal(0, 60, SHAPE), (0, 0), 2.0)
    assert texture.std() > 7
    assert _look(120 + texture).grain.max() < 2.0


@pytest.mark.parametrize("down", [False, True])
def test_the_smear_of_a_moving_camera_has_a_direction(down: bool) -> None:
    covariance = measure_blur(_smear(_patchwork(), 5, down))
    along, across = (covariance[1, 1], covariance[0, 0])[:: 1 if down else -1]
    assert np.sqrt(along) == pytest.approx(5 / np.sqrt(12), rel=0.3)
    assert np.sqrt(across) < 0.6
    sharp = measure_blur(_patchwork())
    assert np.sqrt(np.linalg.eigvalsh(sharp)).max() < 0.6


def test_a_layer_is_smeared_as_the_picture_is() -> None:
    layer = np.zeros((41, 41, 4), np.float32)
    layer[20, 20] = 1
    result = blur_layer(layer, np.diag([4.0 + 0.35**2, 0.35**2]))[..., 3]
    assert result.sum() == pytest.approx(1, rel=1e-4)
    offsets = np.arange(41) - 20
    assert (result.sum(axis=0) * offsets**2).sum() == pytest.approx(4, rel=0.05)
    assert (result.sum(axis=1) * offsets**2).sum() < 0.1
    np.testing.assert_array_equal(blur_layer(layer, np.eye(2) * 0.35**2), layer)
    narrow = blur_layer(layer, np.eye(2) * (0.35**2 + 0.2**2))[..., 3]
    np.testing.assert_allclose(narrow, narrow[:, ::-1], atol=1e-6)  # along both axes equal
    assert narrow[20, 20] < 0.9999


def test_looks_of_neighbouring_frames_blend(monkeypatch: pytest.MonkeyPatch) -> None:
    old = CameraLook(np.array([1.0, 2.0, 3.0]), np.eye(2) * 1.5, np.full((8, 3), 2.0), 0.7, 0.4)
    new = CameraLook(np.array([2.0, 2.0, 4.0]), np.eye(2) * 2.5, np.full((8, 3), 4.0), 1.3, 0.8)
    looks = iter([old, old, new])
    monkeypatch.setattr(camera_look, "measure_look", lambda *_: next(looks))
    tracker = camera_look.CameraLookTracker(smooth=True)
    nothing: Any = None
    tracker.next(nothing, nothing, nothing)
    same = tracker.next(nothing, nothing, nothing)
    assert np.allclose(same.gain, old.gain)
    assert np.allclose(same.grain, old.grain)
    assert (same.grain_px, same.common) == pytest.approx((old.grain_px, old.common))
    between = tracker.next(nothing, nothing, nothing)
    assert old.grain_px < between.grain_px < new.grain_px
    assert old.common < between.common < new.common


def test_the_gain_is_that_of_the_colours_at_the_points() -> None:
    generator = np.random.default_rng(5)
    picture = np.repeat(generator.integers(80, 180, (1, SHAPE[1], 3)), SHAPE[0], axis=0).astype(np.uint8)
    at = np.stack([generator.integers(0, SHAPE[1], 400), generator.integers(0, SHAPE[0], 400)], axis=1)
    linear = srgb_to_linear(picture[at[:, 1], at[:, 0]])
    cloud = ColouredPoints(np.zeros((400, 3)), (linear / [1.2, 1.0, 0.8]).astype(np.float32), False)
    gain = measure_gain(picture, VisiblePoints(np.arange(400), at.astype(float), np.ones(400), False), cloud)
    assert gain == pytest.approx([1.2, 1.0, 0.8], rel=1e-3)

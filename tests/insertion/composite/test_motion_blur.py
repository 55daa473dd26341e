"""Motion blur by known answers: the exposure of smeared frames, the motion of poses, and smeared layers."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from estimator.records.scene import Camera, View
from insertion.composite.camera_look import CameraLook, lens_blur
from insertion.composite.compose import composite_objects, composite_traced
from insertion.composite.motion_blur import (
    MotionBlur,
    image_motion,
    motion_blur,
    smear_kernel,
    smear_layer,
    tile_spectra,
)
from insertion.footage.footage import Frame
from insertion.scene.pixel_box import PixelBox
from insertion.scene.point_cloud import ColouredPoints
from tests.insertion.composite.test_joining import GREY, LOOK, _joined

WIDTH, HEIGHT, FOCAL, DEPTH = 480, 320, 300.0, 3.0
CAMERA = Camera("PINHOLE", WIDTH, HEIGHT, np.array([FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2]))


def _frames(count: int, motion: float, angle: float = 0.0) -> list[Frame]:
    """Frames of a camera that moves past a wall, whose image moves by `motion` pixels per frame."""
    step = motion * DEPTH / FOCAL * np.array([np.cos(angle), np.sin(angle), 0.0])
    views = [
        View(f"{k}.png", CAMERA, np.eye(3), k * step, np.empty((0, 2)), np.empty(0, np.int64)) for k in range(count)
    ]
    return [Frame(k, view.name, k / 25, view, k) for k, view in enumerate(views)]


def _texture() -> np.ndarray:
    """Grey levels (h, w) with the spectrum of natural images, and some grain."""
    generator = np.random.default_rng(4)
    y, x = np.meshgrid(np.fft.fftfreq(HEIGHT), np.fft.fftfreq(WIDTH), indexing="ij")
    spectrum = np.fft.fft2(generator.normal(size=(HEIGHT, WIDTH))) / np.maximum(np.hypot(x, y), 0.01)
    texture = np.fft.ifft2(spectrum).real
    return np.asarray(125 + 30 * texture / texture.std())


def _images(frames: list[Frame], motion: np.ndarray, exposure: float) -> Any:
    """Images of a wall that are smeared by `exposure` times the motion (2,)."""
    smeared = smear_layer(_texture().astype(np.float32)[..., None], exposure * motion).reshape(HEIGHT, WIDTH)
    grain = np.random.default_rng(5).normal(0, 0.7, smeared.shape)
    image = np.repeat(np.clip(np.rint(smeared + grain), 0, 255).astype(np.uint8)[..., None], 3, axis=-1)
    return SimpleNamespace(
        rows=tuple(range(len(frames))),
        image=lambda _: image,
        scene=SimpleNamespace(views=[frame.view for frame in frames]),
    )


def _wall(step_px: float = 20.0) -> ColouredPoints:
    """Points of the wall, one every `step_px` pixels of the first image."""
    x, y = np.meshgrid(np.arange(-WIDTH, 2 * WIDTH, step_px), np.arange(-HEIGHT, 2 * HEIGHT, step_px))
    points = np.column_stack([x.ravel() - WIDTH / 2, y.ravel() - HEIGHT / 2, np.full(x.size, FOCAL)]) * DEPTH / FOCAL
    return ColouredPoints(points, np.zeros((len(points), 3), np.float32), dense=False)


@pytest.mark.parametrize("motion", [6.0, 14.0])
@pytest.mark.parametrize("exposure", [0.0, 0.4, 0.7, 1.0])
def test_the_smear_of_an_object_is_that_of_the_frames(motion: float, exposure: float) -> None:
    angle = 0.6
    frames = _frames(8, motion, angle)
    vector = motion * np.array([np.cos(angle), np.sin(angle)])
    found = motion_blur(frames, _images(frames, vector, exposure), _wall())
    assert found is not None
    smear = found.smear(frames[3], lambda _: np.array([[0.1, 0.1, DEPTH]]))
    assert np.linalg.norm(smear) == pytest.approx(exposure * motion, rel=0.3, abs=0.05 * motion)
    if exposure:
        assert abs(float(smear @ vector)) == pytest.approx(np.linalg.norm(smear) * motion, rel=1e-3)


def test_slow_frames_and_few_tiles_do_not_determine_an_exposure() -> None:
    slow, fast = _frames(8, 3.9), _frames(8, 4.1)
    assert motion_blur(slow, _images(slow, np.array([3.9, 0]), 0.5), _wall()) is None
    assert motion_blur(fast, _images(fast, np.array([4.1, 0]), 0.5), _wall()) is not None
    short = fast[:2]  # 2 frames of 15 tiles with points at every border, 1 frame has too few
    images = _images(short, np.array([4.1, 0]), 0.5)
    assert motion_blur(short, images, _wall()) is not None
    images.rows = (0,)
    assert motion_blur(short, images, _wall(100.0)) is None


def test_a_tile_needs_four_points_and_texture() -> None:
    image = np.repeat(_texture().astype(np.uint8)[..., None], 3, axis=-1)
    pixels, motion = np.array([[90.0, 90.0]] * 4), np.array([[8.0, 0.0]] * 4)
    assert len(tile_spectra(image, pixels, motion)) == 1
    assert not tile_spectra(image, pixels[:3], motion[:3])
    assert not tile_spectra(np.full_like(image, 90), pixels, motion)
    assert not tile_spectra(image, pixels, motion * 5.1)  # more than 40 pixels


def test_motion_is_from_the_poses_before_and_after() -> None:
    frames = _frames(4, 5.0)
    by_index = {frame.index: frame for frame in frames}
    still, walking = np.array([[0.0, 0.0, DEPTH]]), 2.0 * DEPTH / FOCAL
    np.testing.assert_allclose(image_motion(by_index, 1, lambda _: still), [[5.0, 0.0]])
    np.testing.assert_allclose(image_motion(by_index, 0, lambda _: still), [[5.0, 0.0]])
    own = image_motion(by_index, 2, lambda frame: still - [[walking * frame.index, 0, 0]])  # an animated object
    np.testing.assert_allclose(own, [[3.0, 0.0]])
    by_index[2] = replace(frames[2], view=None)
    assert len(image_motion({1: frames[1]}, 1, lambda _: still)) == 0
    np.testing.assert_allclose(image_motion(by_index, 1, lambda _: still), [[5.0, 0.0]])
    blur = MotionBlur(frames, 0.5)
    assert not blur.smear(frames[1], lambda _: np.array([[0.0, 0.0, -1.0]])).any()  # behind the camera
    fast = MotionBlur(_frames(4, 500.0), 0.5)
    assert np.linalg.norm(fast.smear(frames[1], lambda _: still)) == pytest.approx(60.0)


def test_a_kernel_has_the_length_and_direction_of_the_motion() -> None:
    kernel = smear_kernel(np.array([9.0, 4.0]))
    y, x = np.indices(kernel.shape) - kernel.shape[0] // 2
    assert kernel.sum() == pytest.approx(1.0)
    assert (kernel * x).sum() == pytest.approx(0.0, abs=1e-5)
    assert (kernel * x * x).sum() == pytest.approx(81 / 12, rel=0.05)
    assert (kernel * x * y).sum() == pytest.approx(36 / 12, rel=0.05)
    layer = np.ones((8, 8, 4), np.float32)
    assert smear_layer(layer, np.array([0.49, 0.0])) is layer
    assert smear_layer(layer, np.array([0.51, 0.0])) is not layer
    np.testing.assert_allclose(smear_layer(layer, np.array([0.51, 0.0])), layer, rtol=1e-5)  # the border continues


def test_a_smeared_object_and_its_shadow_leave_their_box() -> None:
    item = _joined(PixelBox(15, 10, 25, 20), 1.0, 0.9)
    dark = replace(item, transmitted=np.full((10, 10, 3), 0.5, np.float32), smear=np.array([8.0, 0.0]))
    sharp = composite_objects(GREY, [replace(dark, smear=np.zeros(2))], LOOK, 0)
    smeared = composite_objects(GREY, [dark], LOOK, 0)
    assert smeared.box == PixelBox(7, 2, 33, 28)
    alpha, shadow = np.zeros(40), np.ones(40)
    alpha[7:33], shadow[7:33] = smeared.foreground[12, :, 3], smeared.transmittance[12, :, 0]
    assert 0 < alpha[13] < alpha[17] <= 1
    assert alpha.sum() == pytest.approx(float(sharp.foreground[2, :, 3].sum()), rel=1e-3)
    assert (1 - shadow).sum() == pytest.approx(5.0, rel=1e-3)
    traced = np.zeros((30, 40, 4), np.float32)
    traced[10:20, 15:25] = 1.0
    full = replace(_joined(PixelBox(0, 0, 40, 30), 0.0, 0.0), smear=np.array([8.0, 0.0]))
    full.layers.image.depth[10:20, 12:28] = 2.0
    out = composite_traced(GREY, traced, [full], LOOK, 0)
    assert 0 < out.foreground[12, 13, 3] < 1


def test_the_lens_blurs_all_directions_as_that_across_the_motion() -> None:
    look = CameraLook(np.ones(3), np.array([[5.0, 2.0], [2.0, 3.0]]), np.zeros((8, 3)), 0.0)
    np.testing.assert_allclose(lens_blur(look.blur), np.eye(2) * np.linalg.eigvalsh(look.blur)[0])


def test_spectra_are_along_the_motion() -> None:
    stripes = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    stripes[:, np.arange(WIDTH) % 8 < 4] = 200
    pixels = np.array([[200.0, 120.0]] * 4)
    for motion, axis in (([8.0, 0.0], 1), ([0.0, 8.0], 0)):
        spectrum = tile_spectra(cv2.GaussianBlur(stripes, (0, 0), 1.0), pixels, np.array([motion] * 4))[0]
        row, column = np.unravel_index(int(spectrum.argmax()), spectrum.shape)
        assert (row, column)[1 - axis] == 0
        assert min((row, column)[axis], 96 - (row, column)[axis]) == 8  # one cycle per motion of 8 pixels


@pytest.mark.parametrize(("n_tiles", "is_known"), [(19, False), (20, True)])
def test_an_exposure_needs_20_tiles(monkeypatch: pytest.MonkeyPatch, n_tiles: int, is_known: bool) -> None:
    frames = _frames(2, 6.0)
    images = _images(frames, np.array([6.0, 0.0]), 0.5)
    images.rows = (0,)
    monkeypatch.setattr("insertion.composite.motion_blur.tile_spectra", lambda *_: [np.ones((96, 96))] * n_tiles)
    assert (motion_blur(frames, images, _wall()) is not None) == is_known


def test_the_12_fastest_frames_determine_the_exposure(monkeypatch: pytest.MonkeyPatch) -> None:
    frames = _frames(14, 6.0)
    calls: list[int] = []

    def spectra(*_: object) -> list[np.ndarray]:
        calls.append(1)
        return [np.ones((96, 96))] * 2

    monkeypatch.setattr("insertion.composite.motion_blur.tile_spectra", spectra)
    assert motion_blur(frames, _images(frames, np.array([6.0, 0.0]), 0.5), _wall()) is not None
    assert len(calls) == 12

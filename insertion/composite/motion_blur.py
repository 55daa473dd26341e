"""Motion blur of inserted objects, from the camera poses of neighbouring frames and the paths of the objects.

The shutter is open for a fraction e of the interval between two frames, so that a point whose image moves by m pixels
per frame is smeared along m over e |m| pixels. The fraction is the same in all frames of a video and is estimated from
them: a smear removes the spatial frequencies along the motion that have whole periods in its length.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from estimator.projection.cameras import project
from estimator.projection.visibility import project_unoccluded
from insertion.footage.footage import Frame, SceneImages
from insertion.scene.point_cloud import ColouredPoints
from metric_base.arrays import FloatArray

#: Number of frames with the fastest motion from which the exposure is estimated.
MAX_FRAMES = 12
#: Minimum and maximum motion in pixels per frame of a tile: a shorter smear is narrower than the blur of most lenses,
#: and a longer one leaves the image.
MIN_MOTION_PX, MAX_MOTION_PX = 4.0, 40.0
#: Distance between the centres of tiles in pixels, and minimum number of points that determine the motion of a tile.
TILE_PX, MIN_TILE_POINTS = 80, 4
#: Minimum number of tiles for an estimate.
MIN_TILES = 20
#: Number of samples per motion, and side of a tile in samples.
SAMPLES, SIDE = 12, 96
#: Spatial frequencies that are compared, in cycles per motion. Higher ones are noise at a motion of 4 pixels.
FREQUENCIES = np.arange(0.1875, 2.1, 0.125)
#: Exposure fractions that are compared.
FRACTIONS = np.arange(0.0, 1.26, 0.05)
#: Relative range of the motion within a tile, from its near to its far points; the zeros of the spectrum are not sharp.
MOTION_RANGE = 0.3
#: Power at these zeros relative to that of a sharp image: the leakage of the window, and noise.
POWER_FLOOR = 0.1
#: Maximum length of a smear in pixels; longer motion is an error of a pose.
MAX_SMEAR_PX = 60.0
#: Minimum length of a smear that is applied, in pixels.
MIN_SMEAR_PX = 0.5

_Layer = NDArray[np.float32]


class MotionBlur:
    """The smear of points in the frames of a video.

    Parameters
    ----------
    frames : sequence of Frame
        All frames of the video.
    fraction : float
        Exposure as a fraction of the interval between two frames.
    """

    def __init__(self, frames: Sequence[Frame], fraction: float) -> None:
        self._frames, self.fraction = {frame.index: frame for frame in frames}, fraction

    def smear(self, frame: Frame, positions: Callable[[Frame], FloatArray]) -> FloatArray:
        """Return the smear (2,) in pixels of the positions (n, 3) in the scene that a function gives for each frame."""
        motion = image_motion(self._frames, frame.index, positions)
        motion = motion[np.isfinite(motion).all(axis=1)]
        if not len(motion):
            return np.zeros(2)
        mean = self.fraction * motion.mean(axis=0)
        return np.asarray(mean * min(1.0, MAX_SMEAR_PX / max(float(np.linalg.norm(mean)), 1e-9)))


def image_motion(frames: dict[int, Frame], index: int, positions: Callable[[Frame], FloatArray]) -> FloatArray:
    """Return the motion (n, 2) of positions (n, 3) in pixels per frame, from the poses before and after a frame.

    It is NaN for positions that a frame does not show, and (0, 2) without a second pose.
    """
    near = [frames[k] for k in (index - 1, index, index + 1) if k in frames and frames[k].view is not None]
    if len(near) < 2:
        return np.empty((0, 2))
    first, last = near[0], near[-1]
    pixels = [
        project(frame.view.camera, frame.view.to_camera(positions(frame)))
        for frame in (first, last)
        if frame.view is not None
    ]
    return np.asarray((pixels[1] - pixels[0]) / (last.index - first.index))


def motion_blur(frames: Sequence[Frame], images: SceneImages, cloud: ColouredPoints) -> MotionBlur | None:
    """Estimate the exposure of a video from the images of its reconstruction.

    Parameters
    ----------
    frames : sequence of Frame
        All frames of the video.
    images : SceneImages
        Images of the frames that were reconstructed.
    cloud : ColouredPoints
        Points of the scene, which give the motion.

    Returns
    -------
    MotionBlur or None
        None if fewer than `MIN_TILES` tiles move by `MIN_MOTION_PX`.
    """
    by_index, rows = {frame.index: frame for frame in frames}, set(images.rows)
    moving = []
    for frame in frames:
        if frame.row not in rows or frame.row is None or frame.view is None:
            continue
        view = images.scene.views[frame.row]  # the images may be smaller than the frames of the video
        sight = project_unoccluded(view, cloud.points)
        motion = image_motion(by_index, frame.index, partial(_unmoved, cloud.points[sight.rows]))
        motion = motion * view.camera.width / frame.view.camera.width
        is_valid = np.isfinite(motion).all(axis=1)
        if is_valid.any():
            speed = float(np.median(np.linalg.norm(motion[is_valid], axis=1)))
            moving.append((speed, frame.row, sight.pixels[is_valid], motion[is_valid]))
    moving.sort(key=lambda item: -item[0])
    tiles = [
        spectrum / spectrum.sum()
        for _, row, pixels, motion in moving[:MAX_FRAMES]
        for spectrum in tile_spectra(images.image(row), pixels, motion)
    ]
    if len(tiles) < MIN_TILES:
        return None
    return MotionBlur(frames, exposure_fraction(np.sum(tiles, axis=0)))


def _unmoved(points: FloatArray, _: Frame) -> FloatArray:
    """Return the positions (n, 3) of points of the scene in any frame."""
    return points


def tile_spectra(image: NDArray[np.uint8], pixels: FloatArray, motion: FloatArray) -> list[FloatArray]:
    """Return the power spectra (SIDE, SIDE) of tiles of an image (h, w, 3) whose rows run along the motion.

    Parameters
    ----------
    pixels, motion : (m, 2) ndarray of float
        Pixels of the points in the image, and their motion in pixels per frame.
    """
    import cv2

    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32)
    window = np.outer(np.hanning(SIDE), np.hanning(SIDE))
    cells = (pixels // TILE_PX).astype(np.int64)
    spectra = []
    for cell in np.unique(cells, axis=0):
        in_tile = motion[(cells == cell).all(axis=1)]
        mean = np.median(in_tile, axis=0)
        length = float(np.linalg.norm(mean))
        if len(in_tile) < MIN_TILE_POINTS or not MIN_MOTION_PX <= length <= MAX_MOTION_PX:
            continue
        along = mean / length
        offsets = (np.arange(SIDE) - (SIDE - 1) / 2) * length / SAMPLES
        x, y = np.meshgrid(offsets, offsets)
        centre = (cell + 0.5) * TILE_PX - 0.5
        columns = (centre[0] + x * along[0] - y * along[1]).astype(np.float32)
        rows = (centre[1] + x * along[1] + y * along[0]).astype(np.float32)
        tile = cv2.remap(grey, columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
        if float(np.ptp(tile)) > 0:
            spectra.append(np.abs(np.fft.fft2((tile - tile.mean()) * window)) ** 2)
    return spectra


def exposure_fraction(spectrum: FloatArray) -> float:
    """Return the exposure fraction, 0 to 1, from the power spectrum (SIDE, SIDE) of tiles along their motion.

    A smear of e motions multiplies the power at k cycles per motion along the motion by sinc(e k)^2. The ratio of the
    power along and across the motion is compared with this function, averaged over a range of motions, times a constant
    for structures that run in one direction.
    """
    frequency = np.abs(np.fft.fftfreq(SIDE, 1 / SAMPLES))
    across, along = np.meshgrid(frequency, frequency, indexing="ij")
    ratio, near = [], (FREQUENCIES[1] - FREQUENCIES[0]) / 2
    for k in FREQUENCIES:
        power = [
            spectrum[(np.abs(one - k) <= near) & (other <= k / 2)].mean()
            for one, other in ((along, across), (across, along))
        ]
        ratio.append(np.log(power[0] / power[1]))
    motions = 1 + MOTION_RANGE * np.linspace(-1, 1, 9)
    errors = []
    for fraction in FRACTIONS:
        power = np.mean([np.sinc(fraction * motion * FREQUENCIES) ** 2 for motion in motions], axis=0)
        errors.append(np.var(ratio - np.log((1 - POWER_FLOOR) * power + POWER_FLOOR)))
    return min(float(FRACTIONS[int(np.argmin(errors))]), 1.0)


def smear_kernel(smear: FloatArray) -> _Layer:
    """Return the kernel of a uniform motion by `smear` (2,) pixels to the right and down."""
    reach = int(np.ceil(np.abs(smear).max() / 2)) + 1
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1), np.float32)
    count = 4 * reach + 1
    times = (np.arange(count) + 0.5) / count - 0.5
    for x, y in reach + times[:, None] * smear:
        column, row = int(x), int(y)
        right, down = x - column, y - row
        kernel[row : row + 2, column : column + 2] += np.outer([1 - down, down], [1 - right, right])
    return np.asarray(kernel / kernel.sum(), dtype=np.float32)


def smear_layer(layer: _Layer, smear: FloatArray) -> _Layer:
    """Return a layer (h, w, c) smeared by `smear` (2,) pixels; its border continues beyond the image."""
    import cv2

    if float(np.linalg.norm(smear)) < MIN_SMEAR_PX:
        return layer
    return np.asarray(cv2.filter2D(layer, -1, smear_kernel(smear), borderType=cv2.BORDER_REPLICATE), dtype=np.float32)

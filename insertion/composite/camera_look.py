"""Measure the look of a frame: exposure and white balance, blur, and grain, which the inserted objects receive.

The blur depends on the direction: a lens blurs all edges equally, a moving camera those across its motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from insertion.colour import Image, srgb_to_linear
from insertion.scene.pixel_box import PixelBox
from insertion.scene.point_cloud import ColouredPoints, VisiblePoints

#: Fraction of the gradients of a direction that are edges: the strongest.
EDGE_FRACTION = 0.02
#: Quantile of the widths of the edges that is the blur: the sharpest edges show it.
SHARP_EDGE_QUANTILE = 0.3
#: Number of directions of the blur over half a turn.
DIRECTIONS = 6
#: Minimum standard deviation of the blur in pixels, that of the renderer.
MIN_BLUR_PX = 0.35
#: Maximum standard deviation of the blur in pixels; larger values are measured on textures without edges.
MAX_BLUR_PX = 4.0
#: Minimum standard deviation of a blur that is applied, in pixels: a kernel of whole pixels cannot be narrower.
MIN_KERNEL_PX = 0.15
#: Minimum number of pixels with a gradient of one direction.
MIN_DIRECTION_PIXELS = 400
#: Distance between the pixels that determine the threshold of an edge.
EDGE_STEP_PX = 3
#: Maximum reach of the blur, in pixels.
MAX_BLUR_REACH_PX = 12
#: Minimum number of points for the gain.
MIN_GAIN_POINTS = 30
#: Maximum gain between the frame and the mean of the cloud, in stops.
MAX_GAIN_STOPS = 2.0
#: Range of linear values that are neither noise nor clipped.
GAIN_RANGE = (0.02, 0.9)
#: Weight of a new frame in the running look: exposure and grain change more slowly than frames.
UPDATE_WEIGHT = 0.35
#: Weight of a new frame in the running blur: the motion blur of a hand-held camera changes quickly.
BLUR_UPDATE_WEIGHT = 0.8
#: Number of levels of brightness with separate grain.
GRAIN_BINS = 8
#: Side in pixels of the squares in which grain is measured, and minimum number of squares of one level of brightness.
SQUARE_PX, MIN_BIN_SQUARES = 8, 12
#: Quantile of the standard deviations of the squares that is the grain, because the plainest squares have no texture.
PLAIN_QUANTILE = 0.15
#: Smoothness of simulated grain (standard deviation of its blur in pixels), with the ratio of diagonal differences to
#: the standard deviation (`PLAIN_QUANTILE` of the squares each), and the ratio of the latter to the standard deviation
#: of the grain, which is larger because the content of a frame is removed and squares have few independent pixels.
GRAIN_PX = np.array([0.0, 0.4, 0.5, 0.6, 0.7, 0.8, 1.0])
DIAGONAL_RATIOS = np.array([0.965, 0.90, 0.77, 0.615, 0.495, 0.415, 0.385])
PLAIN_RATIOS = np.array([0.875, 0.865, 0.835, 0.785, 0.73, 0.66, 0.50])
#: Standard deviation of the rounding to levels in the plainest squares; grain is rounded again when it is applied.
PLAIN_ROUNDING = 0.25
#: Range of grey levels with grain: the black border of a lens and clipped pixels have none.
GRAIN_LEVELS = (4, 251)
#: Maximum ratio of the grain of a square to its finest differences; smoother variation is texture.
MAX_GRAIN_RATIO = 2.6
#: Maximum ratio of the grain of a channel to that of green, relative to its median over the levels of brightness. White
#: balance determines this ratio; a level that exceeds it has texture in all of its squares (paving, foliage).
MAX_LEVEL_RATIO = 1.5
#: Standard deviation of the blur that removes the content of a frame, in pixels.
CONTENT_PX = 2.0
#: Number of frames of a video that share one measurement of the grain.
GRAIN_FRAMES = 30
_Grey = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class CameraLook:
    """The look of one frame."""

    gain: NDArray[np.float64]  #: (3,) factor on linear light of this frame over the mean of the cloud
    blur: NDArray[np.float64]  #: (2, 2) covariance in square pixels, of the lens and of the motion of the camera
    grain: NDArray[np.float64]  #: (GRAIN_BINS, 3) standard deviation in levels, by brightness and channel
    grain_px: float  #: standard deviation of the smoothness of the grain, in pixels
    common: float = 0.75  #: fraction of the grain that the channels have in common


class CameraLookTracker:
    """Looks of consecutive frames.

    Parameters
    ----------
    smooth : bool
        The frames belong to one video: gain, blur and grain are smoothed over time.
    """

    def __init__(self, smooth: bool) -> None:
        self._smooth = smooth
        self._last: CameraLook | None = None
        self._frames = 0

    def next(self, image: Image, points: VisiblePoints, cloud: ColouredPoints) -> CameraLook:
        """Return the look of the next frame (h, w, 3)."""
        same_grain = self._last if self._smooth and self._frames % GRAIN_FRAMES else None
        look = measure_look(image, points, cloud, same_grain)
        if self._smooth and self._last is not None:
            old, new, weight = self._last, look, UPDATE_WEIGHT
            look = CameraLook(
                np.exp((1 - weight) * np.log(old.gain) + weight * np.log(new.gain)),
                (1 - BLUR_UPDATE_WEIGHT) * old.blur + BLUR_UPDATE_WEIGHT * new.blur,
                (1 - weight) * old.grain + weight * new.grain,
                (1 - weight) * old.grain_px + weight * new.grain_px,
                (1 - weight) * old.common + weight * new.common,
            )
        self._last, self._frames = look, self._frames + 1
        return look


def measure_look(
    image: Image, points: VisiblePoints, cloud: ColouredPoints, same_grain: CameraLook | None = None
) -> CameraLook:
    """Measure the look of a frame.

    Parameters
    ----------
    image : (h, w, 3) ndarray of uint8
        The frame.
    points : VisiblePoints
        Visible points of the cloud.
    cloud : ColouredPoints
        Points with their mean colours.
    same_grain : CameraLook, optional
        Look whose grain is used.
    """
    import cv2

    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32)
    gain, blur = measure_gain(image, points, cloud), measure_blur(grey)
    if same_grain is not None:
        return replace(same_grain, gain=gain, blur=blur)
    return CameraLook(gain, blur, *measure_grain(image, grey))


def measure_gain(image: Image, points: VisiblePoints, cloud: ColouredPoints) -> NDArray[np.float64]:
    """Return the median ratio (3,) of the linear colours of a frame (h, w, 3) to those of the cloud.

    Dark and clipped points are not used. The gain is 1 if there are too few points.
    """
    step = max(1, len(points.rows) // 8000)
    columns, rows = points.pixels[::step].astype(np.int64).T
    colours, mean = srgb_to_linear(image[rows, columns]), cloud.colours[points.rows[::step]]
    low, high = GAIN_RANGE
    is_valid = (colours > low).all(axis=1) & (colours < high).all(axis=1)
    is_valid &= (mean > low).all(axis=1) & (mean < high).all(axis=1)
    if np.count_nonzero(is_valid) < MIN_GAIN_POINTS:
        return np.ones(3)
    ratio = np.median(np.log(colours[is_valid] / mean[is_valid]), axis=0)
    limit = MAX_GAIN_STOPS * np.log(2)
    return np.asarray(np.exp(np.clip(ratio, -limit, limit)), dtype=np.float64)


def measure_blur(grey: _Grey) -> NDArray[np.float64]:
    """Estimate the covariance (2, 2) of the blur of a grey image (h, w) in square pixels, from its strongest edges.

    A step edge blurred by s has the gradient 1 / (sqrt(2 pi) s). A second blur by s0 decreases it by the ratio
    R = sqrt(s^2 + s0^2) / s, so that s = s0 / sqrt(R^2 - 1) (Zhuo and Sim 2011). Edges with normal n have
    s^2 = n^T C n.
    """
    import cv2

    # 1. Threshold of the gradient in each direction, from a sample of the pixels.
    first, second = gradients(grey), gradients(cv2.GaussianBlur(grey, (0, 0), 1.0))
    size = cv2.magnitude(*first)
    sample = np.s_[::EDGE_STEP_PX, ::EDGE_STEP_PX]
    sample_size, direction = size[sample], direction_index(first[0][sample], first[1][sample])
    thresholds = np.full(DIRECTIONS, np.inf, np.float32)
    for index in range(DIRECTIONS):
        sizes = sample_size[direction == index]
        if len(sizes) * EDGE_STEP_PX**2 >= MIN_DIRECTION_PIXELS:
            thresholds[index] = np.quantile(sizes, 1 - EDGE_FRACTION)
    strong = np.flatnonzero(size >= thresholds.min())
    edges = [(across.ravel()[strong], down.ravel()[strong]) for across, down in (first, second)]
    direction, size = direction_index(*edges[0]), size.ravel()[strong]

    # 2. Variance of the blur across the sharpest edges of each direction.
    rows, values = [], []
    for index in map(int, np.flatnonzero(np.isfinite(thresholds))):
        angle = np.pi * index / DIRECTIONS
        is_edge = (direction == index) & (size >= thresholds[index])
        c, s = np.cos(angle), np.sin(angle)
        before, after = (np.abs(c * across[is_edge] + s * down[is_edge]) for across, down in edges)
        ratio = before / np.maximum(after, 1e-3)
        sigma = 1.0 / np.sqrt(np.maximum(ratio**2 - 1, 1e-3))
        # the area of a pixel blurs by 0.29 pixels, and the stencil of the gradient by 0.7
        values.append(float(np.quantile(sigma, SHARP_EDGE_QUANTILE)) ** 2 - 0.5)
        rows.append([c * c, 2 * c * s, s * s])
    if len(rows) < 3:
        return np.eye(2) * MIN_BLUR_PX**2
    xx, xy, yy = np.linalg.lstsq(np.array(rows), np.array(values), rcond=None)[0]
    return limit_widths(np.array([[xx, xy], [xy, yy]]), MIN_BLUR_PX, MAX_BLUR_PX)


def direction_index(across: _Grey, down: _Grey) -> NDArray[np.int64]:
    """Return the index of the nearest direction, of DIRECTIONS over half a turn, of gradients of any shape."""
    turn = np.arctan2(down, across) * np.float32(DIRECTIONS / np.pi)
    return np.asarray(np.rint(turn).astype(np.int64) % DIRECTIONS)


def blur_layer(layer: _Grey, covariance: NDArray[np.float64]) -> _Grey:
    """Blur a layer (h, w, c) by the covariance (2, 2) of a frame, without the blur of the renderer."""
    import cv2

    remaining = limit_widths(covariance - np.eye(2) * MIN_BLUR_PX**2, 0.0, MAX_BLUR_PX)
    widest = float(np.sqrt(np.linalg.eigvalsh(remaining)[1]))
    if widest < MIN_KERNEL_PX:
        return layer
    precision = np.linalg.inv(remaining + np.eye(2) * MIN_KERNEL_PX**2)
    reach = int(np.ceil(3 * widest))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    kernel = np.exp(-0.5 * (precision[0, 0] * x * x + 2 * precision[0, 1] * x * y + precision[1, 1] * y * y))
    kernel = (kernel / kernel.sum()).astype(np.float32)
    return np.asarray(cv2.filter2D(layer, -1, kernel, borderType=cv2.BORDER_REPLICATE), dtype=np.float32)


def gradients(grey: _Grey) -> tuple[_Grey, _Grey]:
    """Return the gradients (h, w) of a grey image (h, w) in levels per pixel, to the right and down."""
    import cv2

    row = np.array([[-0.5, 0, 0.5]], np.float32)
    across, down = cv2.filter2D(grey, cv2.CV_32F, row), cv2.filter2D(grey, cv2.CV_32F, row.T)
    return np.asarray(across, dtype=np.float32), np.asarray(down, dtype=np.float32)


def lens_blur(blur: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the covariance (2, 2) of the blur across the motion, which is that of the lens, for all directions."""
    return np.eye(2) * float(np.linalg.eigvalsh(blur)[0])


def limit_widths(covariance: NDArray[np.float64], min_px: float, max_px: float) -> NDArray[np.float64]:
    """Limit the standard deviations of a covariance (2, 2) along its axes, in pixels."""
    squares, axes = np.linalg.eigh(covariance)
    return np.asarray((axes * np.clip(squares, min_px**2, max_px**2)) @ axes.T)


def measure_grain(image: Image, grey: _Grey) -> tuple[NDArray[np.float64], float, float]:
    """Measure the grain of a frame in its plainest squares.

    Parameters
    ----------
    image : (h, w, 3) ndarray of uint8
        The frame.
    grey : (h, w) ndarray of float32
        Its grey levels, 0 to 255.

    Returns
    -------
    sigma : (GRAIN_BINS, 3) ndarray of float
        Standard deviation in levels, by brightness and channel.
    smoothness : float
        Standard deviation of the smoothness of the grain, in pixels.
    common : float
        Mean correlation of two channels.
    """
    import cv2

    # 1. Squares (n, SQUARE_PX, SQUARE_PX, 7) of grey level, colour, and colour without the content of the frame.
    colour = image.astype(np.float32)
    stacked = np.dstack([grey, colour, colour - cv2.GaussianBlur(colour, (0, 0), CONTENT_PX)])
    rows, columns = (side // SQUARE_PX for side in grey.shape)
    stacked = stacked[: rows * SQUARE_PX, : columns * SQUARE_PX].reshape(rows, SQUARE_PX, columns, SQUARE_PX, 7)
    squares = stacked.swapaxes(1, 2).reshape(-1, SQUARE_PX, SQUARE_PX, 7)
    low, high = squares[..., 0].min(axis=(1, 2)), squares[..., 0].max(axis=(1, 2))
    squares = squares[(low > GRAIN_LEVELS[0]) & (high < GRAIN_LEVELS[1])]
    if len(squares) < MIN_BIN_SQUARES:
        return np.zeros((GRAIN_BINS, 3)), 0.0, 0.0

    # 2. Standard deviation by brightness and channel; white grain has that of its diagonal differences.
    residuals = squares[..., 4:]
    diagonal = (residuals[:, 1:, 1:] - residuals[:, 1:, :-1] - residuals[:, :-1, 1:] + residuals[:, :-1, :-1]) / 2
    spread, fine = residuals.std(axis=(1, 2)), diagonal.std(axis=(1, 2))  # (n, 3)
    widths = np.minimum(spread, MAX_GRAIN_RATIO * fine)
    bins = np.clip(squares[..., 1:4].mean(axis=(1, 2)) / 256 * GRAIN_BINS, 0, GRAIN_BINS - 1).astype(np.int64)
    both = np.dstack([widths, fine])  # (n, 3, 2)
    plainest = np.tile(np.quantile(both, PLAIN_QUANTILE, axis=0), (GRAIN_BINS, 1, 1))
    for channel in range(3):
        for index in range(GRAIN_BINS):
            in_bin = both[bins[:, channel] == index, channel]
            if len(in_bin) >= MIN_BIN_SQUARES:
                plainest[index, channel] = np.quantile(in_bin, PLAIN_QUANTILE, axis=0)
    plainest = np.sqrt(np.maximum(plainest**2 - PLAIN_ROUNDING**2, 0.0))
    green = np.maximum(plainest[:, 1:2, 0], 1.0)  # less than a level is rounding
    limit = MAX_LEVEL_RATIO * green * np.maximum(np.median(plainest[..., 0] / green, axis=0), 1.0)
    plainest *= np.minimum(limit / np.maximum(plainest[..., 0], 1e-6), 1.0)[..., None]
    sigma = plainest[..., 0]

    # 3. Smoothness by the ratio of both, to which levels without grain (compressed skies) contribute nothing, and
    #    correlation of the channels in the plainer half.
    ratio = float(plainest[..., 1].sum()) / max(float(sigma.sum()), 1e-6)
    smoothness = float(np.interp(-ratio, -DIAGONAL_RATIOS, GRAIN_PX))
    width = spread.mean(axis=1)
    plain = residuals[width <= np.median(width)]
    scaled = plain / np.maximum(plain.std(axis=(0, 1, 2)), 1e-6)
    common = float(np.mean(scaled * np.roll(scaled, 1, axis=-1)))
    return sigma / np.interp(smoothness, GRAIN_PX, PLAIN_RATIOS), smoothness, float(np.clip(common, 0.0, 1.0))


def grain(look: CameraLook, box: PixelBox, levels: NDArray[np.float32], seed: int) -> NDArray[np.float32]:
    """Return random grain (h, w, 3) in levels for a box with sRGB values `levels` (h, w, 3), 0 to 255."""
    import cv2

    generator = np.random.default_rng([seed, 77])
    noise = generator.standard_normal((*box.shape, 4), dtype=np.float32)
    noise = np.sqrt(look.common) * noise[..., 3:] + np.sqrt(1 - look.common) * noise[..., :3]
    if look.grain_px > 0.2:
        noise = cv2.GaussianBlur(noise, (0, 0), look.grain_px)
        noise /= max(float(noise.std()), 1e-6)
    centres = (np.arange(GRAIN_BINS) + 0.5) * 256 / GRAIN_BINS
    sigma = np.stack([np.interp(levels[..., k], centres, look.grain[:, k]) for k in range(3)], axis=-1)
    return np.asarray(noise * sigma, dtype=np.float32)

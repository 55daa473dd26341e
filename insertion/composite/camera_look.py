"""What makes an object belong to a picture: the exposure, white balance, blur and grain measured in the picture.

The blur of a picture, by direction: a lens blurs all edges alike, a moving camera those across its way.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from insertion.colour import srgb_to_linear
from insertion.scene.pixel_box import PixelBox
from insertion.scene.point_cloud import Cloud, FrontPoints

#: Edges that show the blur: the strongest gradients of each direction, and of these the sharpest.
EDGE_SHARE, SHARPEST = 0.02, 0.3
#: Directions in which it is measured, over half a turn.
DIRECTIONS = 6
#: Blur is believed between these, in pixels (one sigma); the renderer's own is the first.
BLUR_PX = (0.35, 4.0)
#: Fewer pixels of a direction say nothing of it.
MIN_PIXELS = 400
#: One pixel in so many along each side says how strong the strongest edges are.
SAMPLED = 3
#: Pixels that the widest blur reaches.
REACH_PX = 12
_Grey = NDArray[np.float32]
Picture = NDArray[np.uint8]
#: Points that a gain rests on, and the widest change from picture to picture that is believed.
MIN_POINTS, MAX_STOPS = 30, 2.0
#: The share of a new picture in the running look: a camera's exposure and grain move slower than its frames, and
#: the smear of a moving hand does not.
NEW_SHARE, NEW_BLUR = 0.35, 0.8
#: Grain is at most so many times as strong as this quantile over small squares of what is finest in the picture; what
#: is smoother than that is texture.
FINEST_TIMES, FINEST_SHARE, SQUARE_PX = 2.6, 0.35, 8
#: Smoothness of such grain in pixels, one sigma.
FINEST_PX = 0.6
#: Most of the grain that is believed to be common to the three channels.
MOST_COMMON = 0.98
#: In a video, so many frames share one measurement of the grain.
GRAIN_FRAMES = 30
_BINS = 8


def blur_of(grey: _Grey) -> NDArray[np.float64]:
    """(2, 2) covariance of the blur of a grey picture (h, w) in square pixels, from its strongest edges.

    Zhuo and Sim (2011): a step edge blurred by s has the gradient 1 / (sqrt(2 pi) s); blurred again by s0 it falls by
    the ratio R = sqrt(s^2 + s0^2) / s, so s = s0 / sqrt(R^2 - 1). Edges with the normal n have s^2 = n^T C n.
    """
    import cv2

    first, second = gradients(grey), gradients(cv2.GaussianBlur(grey, (0, 0), 1.0))
    size = cv2.magnitude(*first)
    # which way an edge looks is asked of few pixels for the limit, and of the strong ones
    some = np.s_[::SAMPLED, ::SAMPLED]
    usual, direction = size[some], _direction(first[0][some], first[1][some])
    limits = np.full(DIRECTIONS, np.inf, np.float32)
    for number in range(DIRECTIONS):
        own = usual[direction == number]
        if len(own) * SAMPLED**2 >= MIN_PIXELS:
            limits[number] = np.quantile(own, 1 - EDGE_SHARE)
    strong = np.flatnonzero(size >= limits.min())
    edges = [(across.ravel()[strong], down.ravel()[strong]) for across, down in (first, second)]
    direction, size = _direction(*edges[0]), size.ravel()[strong]
    rows, values = [], []
    for number in map(int, np.flatnonzero(np.isfinite(limits))):
        angle = np.pi * number / DIRECTIONS
        own = (direction == number) & (size >= limits[number])
        c, s = np.cos(angle), np.sin(angle)
        before, after = (np.abs(c * across[own] + s * down[own]) for across, down in edges)
        ratio = before / np.maximum(after, 1e-3)
        sigma = 1.0 / np.sqrt(np.maximum(ratio**2 - 1, 1e-3))
        # a pixel's own area blurs by 0.29, and the gradient's stencil by 0.7
        values.append(float(np.quantile(sigma, SHARPEST)) ** 2 - 0.5)
        rows.append([c * c, 2 * c * s, s * s])
    if len(rows) < 3:
        return np.eye(2) * BLUR_PX[0] ** 2
    xx, xy, yy = np.linalg.lstsq(np.array(rows), np.array(values), rcond=None)[0]
    return _with_widths(np.array([[xx, xy], [xy, yy]]), *BLUR_PX)


def _direction(across: _Grey, down: _Grey) -> NDArray[np.int64]:
    """Number of the direction, of DIRECTIONS over half a turn, that each gradient is nearest to; of any shape."""
    turn = np.arctan2(down, across) * np.float32(DIRECTIONS / np.pi)
    return np.asarray(np.rint(turn).astype(np.int64) % DIRECTIONS)


def blur_layer(layer: _Grey, covariance: NDArray[np.float64]) -> _Grey:
    """A layer (h, w, c) blurred by a picture's blur (2, 2), less the renderer's own."""
    import cv2

    rest = _with_widths(covariance - np.eye(2) * BLUR_PX[0] ** 2, 0.0, BLUR_PX[1])
    widest = float(np.sqrt(np.linalg.eigvalsh(rest)[1]))
    if widest < 0.15:
        return layer
    # a kernel of whole pixels cannot be narrower than this
    sharp = np.linalg.inv(rest + np.eye(2) * 0.15**2)
    reach = int(np.ceil(3 * widest))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    kernel = np.exp(-0.5 * (sharp[0, 0] * x * x + 2 * sharp[0, 1] * x * y + sharp[1, 1] * y * y))
    kernel = (kernel / kernel.sum()).astype(np.float32)
    return np.asarray(cv2.filter2D(layer, -1, kernel, borderType=cv2.BORDER_REPLICATE), dtype=np.float32)


def gradients(grey: _Grey) -> tuple[_Grey, _Grey]:
    """Gradients (h, w) of a grey picture (h, w) in levels per pixel, to the right and down."""
    import cv2

    row = np.array([[-0.5, 0, 0.5]], np.float32)
    across, down = cv2.filter2D(grey, cv2.CV_32F, row), cv2.filter2D(grey, cv2.CV_32F, row.T)
    return np.asarray(across, dtype=np.float32), np.asarray(down, dtype=np.float32)


def _with_widths(covariance: NDArray[np.float64], least: float, most: float) -> NDArray[np.float64]:
    """A covariance (2, 2) whose widths are between two, in pixels."""
    squares, axes = np.linalg.eigh(covariance)
    return np.asarray((axes * np.clip(squares, least**2, most**2)) @ axes.T)


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """The look of one picture.

    gain : (3,) on linear light, of this picture over the cloud's mean; blur : (2, 2) covariance in square pixels, of
    the lens and of the smear of a moving camera; grain : (_BINS, 3) one sigma in levels by brightness and channel;
    grain_px : one sigma of the grain's own smoothness; common : share of the grain that the channels have in common.
    """

    gain: NDArray[np.float64]
    blur: NDArray[np.float64]
    grain: NDArray[np.float64]
    grain_px: float
    common: float = 0.75


class Looks:
    """Looks of the pictures of one video, smooth in time; a still has its own look."""

    def __init__(self, smooth: bool) -> None:
        self._smooth = smooth
        self._last: Look | None = None
        self._frames = 0

    def next(self, picture: Picture, front: FrontPoints, cloud: Cloud) -> Look:
        """The look of the next picture (h, w, 3)."""
        same_grain = self._last if self._smooth and self._frames % GRAIN_FRAMES else None
        look = look_of(picture, front, cloud, same_grain)
        if self._smooth and self._last is not None:
            look = _blend(self._last, look)
        self._last, self._frames = look, self._frames + 1
        return look


def look_of(picture: Picture, front: FrontPoints, cloud: Cloud, same_grain: Look | None = None) -> Look:
    """The look of one (h, w, 3) picture; same_grain : another look whose grain it has."""
    import cv2

    grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY).astype(np.float32)
    gain, blur = _gain(picture, front, cloud), blur_of(grey)
    if same_grain is not None:
        return replace(same_grain, gain=gain, blur=blur)
    return Look(gain, blur, *_grain_of(picture, grey))


def grain(look: Look, box: PixelBox, levels: NDArray[np.float32], seed: int) -> NDArray[np.float32]:
    """(h, w, 3) grain in levels for a box; levels : (h, w, 3) sRGB values in 0 to 255."""
    import cv2

    generator = np.random.default_rng([seed, 77])
    noise = generator.standard_normal((*box.shape, 4), dtype=np.float32)
    noise = np.sqrt(look.common) * noise[..., 3:] + np.sqrt(1 - look.common) * noise[..., :3]
    if look.grain_px > 0.2:
        noise = cv2.GaussianBlur(noise, (0, 0), look.grain_px)
        noise /= max(float(noise.std()), 1e-6)
    centres = (np.arange(_BINS) + 0.5) * 256 / _BINS
    sigma = np.stack([np.interp(levels[..., k], centres, look.grain[:, k]) for k in range(3)], axis=-1)
    return np.asarray(noise * sigma, dtype=np.float32)


def _blend(old: Look, new: Look) -> Look:
    mix = NEW_SHARE
    return Look(
        np.exp((1 - mix) * np.log(old.gain) + mix * np.log(new.gain)),
        (1 - NEW_BLUR) * old.blur + NEW_BLUR * new.blur,
        (1 - mix) * old.grain + mix * new.grain,
        (1 - mix) * old.grain_px + mix * new.grain_px,
        (1 - mix) * old.common + mix * new.common,
    )


def _gain(picture: Picture, front: FrontPoints, cloud: Cloud) -> NDArray[np.float64]:
    """(3,) median ratio of the picture's linear colours to the cloud's, of points that are not hidden or clipped."""
    step = max(1, len(front.rows) // 8000)
    rows, at = front.rows[::step], front.pixels[::step].astype(np.int64)
    here, mean = srgb_to_linear(picture[at[:, 1], at[:, 0]]), cloud.colours[rows]
    good = (here > 0.02).all(axis=1) & (here < 0.9).all(axis=1) & (mean > 0.02).all(axis=1) & (mean < 0.9).all(axis=1)
    if np.count_nonzero(good) < MIN_POINTS:
        return np.ones(3)
    ratio = np.median(np.log(here[good] / mean[good]), axis=0)
    limit = MAX_STOPS * np.log(2)
    return np.asarray(np.exp(np.clip(ratio, -limit, limit)), dtype=np.float64)


def _grain_of(picture: Picture, grey: NDArray[np.float32]) -> tuple[NDArray[np.float64], float, float]:
    """One sigma of the grain by brightness and channel, its smoothness in pixels, and what the channels share of it.

    From the flattest parts of a picture (h, w, 3) and its grey (h, w) in levels 0 to 255; the sigmas are (_BINS, 3).
    """
    import cv2

    colour = picture.astype(np.float32)
    base = cv2.GaussianBlur(grey, (0, 0), 2.0)
    rest, rests = grey - base, colour - cv2.GaussianBlur(colour, (0, 0), 2.0)
    slope = cv2.GaussianBlur(np.hypot(*gradients(base)), (0, 0), 2.0)
    flat = (grey > 4) & (grey < 251)  # the black rim of a lens and what is clipped have no grain
    if np.count_nonzero(flat) < 200:
        return np.zeros((_BINS, 3)), 0.0, 0.0
    flat &= slope <= np.quantile(slope[flat], 0.3)
    if np.count_nonzero(flat) < 200:
        return np.zeros((_BINS, 3)), 0.0, 0.0
    finest = FINEST_TIMES * _finest(grey)
    plain = rests[flat]  # (n, 3)
    overall = np.array([_sigma(plain[:, k]) for k in range(3)])
    levels = np.tile(overall, (_BINS, 1))
    # by the brightness without the grain: by that with it, a bin may have the tails of its neighbour's grain alone
    index = np.clip((colour[flat] - plain) / 256 * _BINS, 0, _BINS - 1).astype(np.int64)
    for k in range(3):
        for bin_number in range(_BINS):
            own = plain[:, k][index[:, k] == bin_number]
            if len(own) > 150:
                levels[bin_number, k] = _sigma(own)
    both = flat[:, 1:] & flat[:, :-1]
    alike = float(np.mean(rest[:, 1:][both] * rest[:, :-1][both]) / max(float(np.mean(rest[flat] ** 2)), 1e-9))
    # white noise blurred by s has the correlation exp(-1 / (4 s^2)) between neighbours
    smooth = float(np.sqrt(-0.25 / np.log(alike))) if 0.02 < alike < 0.95 else 0.0
    scaled = plain / np.maximum(plain.std(axis=0), 1e-6)
    across = np.mean(scaled * np.roll(scaled, 1, axis=1))  # the mean correlation of two channels
    textured = bool(overall.mean() > finest)
    return (
        np.minimum(levels, finest),
        min(smooth, FINEST_PX if textured else 1.2),
        float(np.clip(across, 0.0, MOST_COMMON)),
    )


def _sigma(rest: NDArray[np.float32]) -> float:
    """One sigma of levels (n,), most of which may be 0 after rounding: the wider of the middle half and two thirds."""
    low, high = np.percentile(np.abs(rest - np.median(rest)), [50, 68.27])
    return float(max(low / 0.6745, high))


def _finest(grey: NDArray[np.float32]) -> float:
    """Sigma of the diagonal differences of neighbours in the plainest squares of a grey picture (h, w).

    White grain of one sigma gives one; texture, which is smooth from pixel to pixel, gives little.
    """
    diagonal = (grey[:-1, :-1] - grey[1:, :-1] - grey[:-1, 1:] + grey[1:, 1:]) / 2
    rows, columns = (side // SQUARE_PX for side in diagonal.shape)
    if not rows * columns:
        return float("inf")
    cut = (rows, SQUARE_PX, columns, SQUARE_PX)
    squares = [part[: rows * SQUARE_PX, : columns * SQUARE_PX].reshape(cut) for part in (diagonal, grey)]
    exposed = (squares[1].min(axis=(1, 3)) > 4) & (squares[1].max(axis=(1, 3)) < 251)
    if not exposed.any():
        return float("inf")
    return float(np.quantile(np.sqrt((squares[0] ** 2).mean(axis=(1, 3)))[exposed], FINEST_SHARE))

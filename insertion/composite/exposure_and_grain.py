"""What makes an object belong to a picture: the exposure, white balance, blur and grain measured in the picture."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from insertion.colour import srgb_to_linear
from insertion.composite.blur import blur_of, gradients
from insertion.scene.pixel_box import PixelBox
from insertion.scene.point_cloud import Cloud, FrontPoints

__all__ = ["Look", "Looks", "grain", "look_of"]

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

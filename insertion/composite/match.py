"""What makes an object belong to a picture: the exposure, white balance, blur and grain measured in the picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from insertion.composite.boxes import Box
from insertion.records.encoding import srgb_to_linear
from insertion.scene.cloud import Cloud, FrontPoints
from metric_base.statistics import robust_sigma

__all__ = ["Look", "Looks", "grain", "look_of"]

Picture = NDArray[np.uint8]
#: Points that a gain rests on, and the widest change from picture to picture that is believed.
MIN_POINTS, MAX_STOPS = 30, 2.0
#: The share of a new picture in the running look: a camera's exposure and focus move slower than its frames.
NEW_SHARE = 0.35
#: Edges that show the lens's blur: the strongest gradients, and of these the sharpest.
EDGE_SHARE, SHARPEST = 0.01, 0.3
#: Blur is searched between these, in pixels (one sigma); the renderer's own is the first.
BLUR_PX = (0.35, 4.0)
#: Of the grain, this share is common to the three channels.
COMMON_GRAIN = 0.75
_BINS = 8


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """The look of one picture.

    gain : (3,) on linear light, of this picture over the cloud's mean; blur_px : one sigma; grain : (_BINS,) one sigma
    in grey levels by brightness; grain_px : one sigma of the grain's own smoothness.
    """

    gain: NDArray[np.float64]
    blur_px: float
    grain: NDArray[np.float64]
    grain_px: float


class Looks:
    """Looks of the pictures of one film, smooth in time; a still has its own look."""

    def __init__(self, smooth: bool) -> None:
        self._smooth = smooth
        self._last: Look | None = None

    def next(self, picture: Picture, front: FrontPoints, cloud: Cloud) -> Look:
        """The look of the next picture (h, w, 3)."""
        look = look_of(picture, front, cloud)
        if self._smooth and self._last is not None:
            look = _blend(self._last, look)
        self._last = look
        return look


def look_of(picture: Picture, front: FrontPoints, cloud: Cloud) -> Look:
    """The look of one (h, w, 3) picture."""
    import cv2

    grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY).astype(np.float32)
    levels, smooth = _grain_of(grey)
    return Look(_gain(picture, front, cloud), _blur(grey), levels, smooth)


def grain(look: Look, box: Box, brightness: NDArray[np.float32], seed: int) -> NDArray[np.float32]:
    """(h, w, 3) grain in grey levels for a box; brightness : (h, w) sRGB values in 0 to 255."""
    import cv2

    generator = np.random.default_rng([seed, 77])
    common = generator.standard_normal((*box.shape, 1)).astype(np.float32)
    own = generator.standard_normal((*box.shape, 3)).astype(np.float32)
    noise = np.sqrt(COMMON_GRAIN) * common + np.sqrt(1 - COMMON_GRAIN) * own
    if look.grain_px > 0.2:
        noise = cv2.GaussianBlur(noise, (0, 0), look.grain_px)
        noise /= max(float(noise.std()), 1e-6)
    centres = (np.arange(_BINS) + 0.5) * 256 / _BINS
    sigma = np.interp(brightness, centres, look.grain)
    return np.asarray(noise * sigma[..., None], dtype=np.float32)


def _blend(old: Look, new: Look) -> Look:
    mix = NEW_SHARE
    return Look(
        np.exp((1 - mix) * np.log(old.gain) + mix * np.log(new.gain)),
        (1 - mix) * old.blur_px + mix * new.blur_px,
        (1 - mix) * old.grain + mix * new.grain,
        (1 - mix) * old.grain_px + mix * new.grain_px,
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


def _blur(grey: NDArray[np.float32]) -> float:
    """One sigma of the blur of a grey picture (h, w) in pixels, from the strongest edges (Zhuo and Sim 2011).

    A step edge blurred by s has the gradient 1 / (sqrt(2 pi) s); blurred again by s0 it falls by the ratio
    R = sqrt(s^2 + s0^2) / s, so s = s0 / sqrt(R^2 - 1).
    """
    import cv2

    again = cv2.GaussianBlur(grey, (0, 0), 1.0)
    first, second = _gradient(grey), _gradient(again)
    strong = first >= np.quantile(first, 1 - EDGE_SHARE)
    ratio = first[strong] / np.maximum(second[strong], 1e-3)
    sigma = 1.0 / np.sqrt(np.maximum(ratio**2 - 1, 1e-3))
    # a pixel's own area blurs by 0.29, and the gradient's stencil by 0.7
    measured = float(np.quantile(sigma, SHARPEST))
    return float(np.clip(np.sqrt(max(measured**2 - 0.5, 0.0)), *BLUR_PX))


def _gradient(grey: NDArray[np.float32]) -> NDArray[np.float32]:
    """(h, w) size of the gradient in grey levels per pixel; grey : (h, w)."""
    import cv2

    across = cv2.filter2D(grey, cv2.CV_32F, np.array([[-0.5, 0, 0.5]], np.float32))
    down = cv2.filter2D(grey, cv2.CV_32F, np.array([[-0.5], [0], [0.5]], np.float32))
    return np.asarray(np.hypot(across, down), dtype=np.float32)


def _grain_of(grey: NDArray[np.float32]) -> tuple[NDArray[np.float64], float]:
    """One sigma of the grain by brightness, and its smoothness in pixels, from the flattest parts of the picture.

    grey : (h, w) levels 0 to 255; the sigmas are (_BINS,) in grey levels.
    """
    import cv2

    base = cv2.GaussianBlur(grey, (0, 0), 2.0)
    rest = grey - base
    slope = cv2.GaussianBlur(_gradient(base), (0, 0), 2.0)
    flat = slope <= np.quantile(slope, 0.3)
    flat &= (grey > 4) & (grey < 251)
    if np.count_nonzero(flat) < 200:
        return np.zeros(_BINS), 0.0
    overall = robust_sigma(rest[flat])
    index = np.minimum(grey[flat] / 256 * _BINS, _BINS - 1).astype(np.int64)
    levels = np.array([
        robust_sigma(rest[flat][index == k]) if np.count_nonzero(index == k) > 150 else overall for k in range(_BINS)
    ])  # fmt: skip
    both = flat[:, 1:] & flat[:, :-1]
    alike = float(np.mean(rest[:, 1:][both] * rest[:, :-1][both]) / max(float(np.mean(rest[flat] ** 2)), 1e-9))
    # white noise blurred by s has the correlation exp(-1 / (4 s^2)) between neighbours
    smooth = float(np.sqrt(-0.25 / np.log(alike))) if 0.02 < alike < 0.95 else 0.0
    return levels, min(smooth, 1.2)

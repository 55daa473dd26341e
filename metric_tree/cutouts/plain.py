"""Foregrounds of shop images without a network: the background is what the border shows.

1. A plane of colour over the image, fitted to its border (so that falling light is still plain).
2. Background is what is near that plane and hangs together with the border; a paraboloid fitted to all of it follows
   a lamp's round light further in; enclosed holes of its very colour are background too.
3. Shadow is background: darker, of the same hue, soft.
4. GrabCut (Rother et al. 2004) settles what lies between, on a small copy; the edge is read in the full image.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from metric_tree.cutouts.backend import RGB, Foreground

METHOD = "plain"

Mask = NDArray[np.bool_]
Floats = NDArray[np.float32]

#: Width of the border that is read, as a share of the shorter side.
BORDER_SHARE = 0.02

#: Lab distance within which a pixel is the background's, at least: what JPEG does to a flat area at quality 80.
MIN_LAB_DISTANCE = 5.0

#: In standard deviations of the border's own noise, beside `MIN_LAB_DISTANCE`.
NOISE_FACTOR = 4.0

#: A border is plain where this share of it follows the plane; the rest is room for an object that leaves the image.
PLAIN_SHARE = 0.75

#: And where the noise about the plane (Lab) is no more than film grain: wallpaper and wood have 5 and more.
PLAIN_NOISE = 3.0

#: Times that the paraboloid is fitted again; each follows the light a little further in.
REFITS = 2

#: Shadows keep the hue within this Lab distance and lose no more than this share of lightness.
SHADOW_HUE, SHADOW_LOSS = 5.0, 0.45

#: Lightness a pixel of the small copy within a shadow; an edge of an object is steeper.
SHADOW_STEP = 5.0

#: Longer side of the copy that grabCut works on, in pixels, and its rounds.
COPY_SIDE_PX, ROUNDS = 320, 2

#: An enclosed patch of the very background colour is a hole (a handle, between legs) from this share of the image.
HOLE_SHARE = 0.0005


@dataclass(frozen=True, slots=True, eq=False)
class Background:
    """lab : (h, w, 3) the background's colour; noise : of the border about it; share : of the border that follows."""

    lab: Floats
    noise: float
    share: float

    @property
    def is_plain(self) -> bool:
        """Return True if border statistics can tell foreground from background."""
        return self.share >= PLAIN_SHARE and self.noise <= PLAIN_NOISE

    @property
    def tolerance(self) -> float:
        """Lab distance within which a pixel is the background's."""
        return max(MIN_LAB_DISTANCE, NOISE_FACTOR * self.noise)


@dataclass(frozen=True, slots=True)
class Plain:
    """The backend; `refined` says whether grabCut settles what the border statistics leave open."""

    refined: bool = True

    def foreground(self, picture: RGB) -> Foreground:
        """The foreground of an image (h, w, 3); `not_plain` if the border says nothing about the background."""
        lab = cv2.cvtColor(picture.astype(np.float32) / 255.0, cv2.COLOR_RGB2LAB)
        ground = background(lab)
        if not ground.is_plain:
            return Foreground(np.zeros(picture.shape[:2], np.uint8), METHOD, "not_plain")
        mask = _mask(picture, lab, ground, self.refined)
        return Foreground(mask.astype(np.uint8) * 255, METHOD)


def background(lab: Floats) -> Background:
    """The plane of colour that most of the border follows; lab : (h, w, 3)."""
    height, width = lab.shape[:2]
    depth = max(2, round(BORDER_SHARE * min(height, width)))
    border = np.zeros((height, width), bool)
    border[:depth] = border[-depth:] = border[:, :depth] = border[:, -depth:] = True
    y, x = np.nonzero(border)
    step = max(1, len(y) // 4000)
    y, x = y[::step], x[::step]
    place = np.column_stack([np.ones(len(y)), x / width - 0.5, y / height - 0.5])  # (n, 3)
    colour = lab[y, x].astype(float)  # (n, 3)
    plane = _robust_plane(place, colour)
    residual = np.linalg.norm(colour - place @ plane, axis=1)
    inside = residual[residual <= np.quantile(residual, PLAIN_SHARE)]
    noise = float(np.sqrt(np.mean(inside**2) / 3))
    share = float(np.mean(residual <= max(MIN_LAB_DISTANCE, NOISE_FACTOR * noise)))
    return Background(_surface(np.vstack([plane, np.zeros((3, 3))]), (height, width)), noise, share)


def _relief(lab: Floats, ground: Background) -> Background:
    """The background as a paraboloid through all that hangs together with the border."""
    height, width = lab.shape[:2]
    for _ in range(REFITS):
        y, x = np.nonzero(_reach(np.linalg.norm(lab - ground.lab, axis=2) <= ground.tolerance))
        step = max(1, len(y) // 4000)
        y, x = y[::step], x[::step]
        if len(y) < 100:
            break
        u, v = x / width - 0.5, y / height - 0.5
        terms = np.column_stack([np.ones(len(u)), u, v, u * u, u * v, v * v])  # (n, 6)
        fitted = np.linalg.lstsq(terms, lab[y, x].astype(float), rcond=None)[0]
        ground = Background(_surface(fitted, (height, width)), ground.noise, ground.share)
    return ground


def _surface(fitted: NDArray[np.float64], shape: tuple[int, int]) -> Floats:
    """(h, w, 3) of the coefficients (6, 3) of 1, x, y, xx, xy, yy, with x and y from -1/2 to 1/2."""
    c = fitted.astype(np.float32)
    v = (np.arange(shape[0], dtype=np.float32) / shape[0] - 0.5)[:, None, None]
    u = (np.arange(shape[1], dtype=np.float32) / shape[1] - 0.5)[None, :, None]
    return np.asarray(c[0] + u * (c[1] + u * c[3]) + v * (c[2] + u * c[4] + v * c[5]))


def _robust_plane(place: NDArray[np.float64], colour: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) least squares over the border without the quarter that follows worst, from the median colour."""
    plane = np.vstack([np.median(colour, axis=0), np.zeros((2, 3))])
    for _ in range(5):
        residual = np.linalg.norm(colour - place @ plane, axis=1)
        kept = residual <= np.quantile(residual, PLAIN_SHARE)
        plane = np.linalg.lstsq(place[kept], colour[kept], rcond=None)[0]
    return plane


def _mask(picture: RGB, lab: Floats, ground: Background, refined: bool) -> Mask:
    """(h, w) foreground of an image (h, w, 3) over its background, with its edge refined if asked."""
    ground = _relief(lab, ground)
    distance = np.linalg.norm(lab - ground.lab, axis=2)
    whole = _remove_dust(~_holes(distance, _reach(distance <= ground.tolerance), ground))
    height, width = whole.shape
    factor = min(1.0, COPY_SIDE_PX / max(height, width))
    size = (max(1, round(width * factor)), max(1, round(height * factor)))
    small_lab, small_plane = (cv2.resize(a, size, interpolation=cv2.INTER_AREA) for a in (lab, ground.lab))
    small = cv2.resize(whole.astype(np.float32), size, interpolation=cv2.INTER_AREA) >= 0.5
    shadow = small & _shadow(small_lab, small_plane, ~small)
    settled = small & ~shadow
    if refined and settled.any():
        settled = _settle(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), small, shadow)
    return _full_edge(whole, settled)


def _reach(near: Mask) -> Mask:
    """The part of `near` that hangs together with the border."""
    _, labels = cv2.connectedComponents(near.astype(np.uint8), connectivity=4)
    edge = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    reached = np.zeros(labels.max() + 1, bool)
    reached[edge] = True
    reached[0] = False
    return np.asarray(reached[labels])


def _holes(distance: Floats, outside: Mask, ground: Background) -> Mask:
    """The background with the enclosed patches that have its very colour."""
    tight = max(1.5, 2 * ground.noise)
    inner = (distance <= tight) & ~outside
    _, labels, stats, _ = cv2.connectedComponentsWithStats(inner.astype(np.uint8), connectivity=4)
    large = stats[:, cv2.CC_STAT_AREA] >= HOLE_SHARE * distance.size
    large[0] = False
    grown = cv2.dilate((large[labels]).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return np.asarray(outside | large[labels] | (grown & (distance <= ground.tolerance)))


def _shadow(lab: Floats, plane: Floats, outside: Mask) -> Mask:
    """Dark, soft and without a hue of its own, and in touch with the background; on the small copy."""
    loss = (plane[..., 0] - lab[..., 0]) / np.maximum(plane[..., 0], 1.0)
    hue = np.linalg.norm(lab[..., 1:] - plane[..., 1:], axis=2)
    steps = [cv2.Sobel(lab[..., 0], cv2.CV_32F, *axis, scale=0.125) for axis in ((1, 0), (0, 1))]
    soft = np.hypot(*steps) <= SHADOW_STEP
    may_be = outside | ((loss > 0) & (loss <= SHADOW_LOSS) & (hue <= SHADOW_HUE) & soft)
    return np.asarray(_reach(may_be) & ~outside)


def _settle(picture: RGB, small: Mask, shadow: Mask) -> Mask:
    """(h, w) GrabCut from what is known: outside is background, shadow (h, w) probably, the rest perhaps the object."""
    inside = small & ~shadow
    state = np.full(small.shape, cv2.GC_BGD, np.uint8)
    near = cv2.dilate(small.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    state[near] = cv2.GC_PR_BGD
    state[inside] = cv2.GC_PR_FGD
    core = cv2.erode(inside.astype(np.uint8), np.ones((5, 5), np.uint8), borderValue=0) > 0
    state[core] = cv2.GC_FGD
    if not core.any() or near.all():
        return inside
    models = np.zeros((1, 65)), np.zeros((1, 65))
    bgr = np.ascontiguousarray(picture[..., ::-1])
    cv2.setRNGSeed(0)
    cv2.grabCut(bgr, state, None, *models, ROUNDS, cv2.GC_INIT_WITH_MASK)
    return np.asarray((state == cv2.GC_FGD) | (state == cv2.GC_PR_FGD))


def _full_edge(whole: Mask, settled: Mask) -> Mask:
    """The settled mask in full size; within a pixel of the small copy the full image's own edge is taken."""
    if whole.shape == settled.shape:
        return settled
    size, kernel, small = whole.shape[::-1], np.ones((3, 3), np.uint8), settled.astype(np.uint8)
    inner = cv2.resize(cv2.erode(small, kernel), size, interpolation=cv2.INTER_NEAREST) > 0
    outer = cv2.resize(cv2.dilate(small, kernel), size, interpolation=cv2.INTER_NEAREST) > 0
    return np.asarray(inner | (outer & whole))


def _remove_dust(mask: Mask) -> Mask:
    """The mask without specks of under a ten-thousandth of the image."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    large = stats[:, cv2.CC_STAT_AREA] >= 1e-4 * mask.size
    large[0] = False
    return np.asarray(large[labels])

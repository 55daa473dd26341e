"""Foregrounds of shop images without a network: the border of the image determines the background.

1. Fit a plane of colour over the image to its border, which tolerates a gradient of light.
2. Background are the pixels close to the plane that are connected with the border. A paraboloid fitted to all of them
   follows the light of a lamp further in. Enclosed holes with exactly its colour are background, too.
3. Shadows are background: darker than the background, of the same hue, with soft edges.
4. GrabCut (Rother et al. 2004) decides about the remaining pixels of a small copy. The edge is that of the full image.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from metric_tree.cutouts.backend import RGB, Foreground

METHOD = "plain"

Mask: TypeAlias = NDArray[np.bool_]
Floats: TypeAlias = NDArray[np.float32]

#: Width of the border as a fraction of the shorter side.
BORDER_FRACTION = 0.02

#: Minimum tolerance of the background in Lab units: the error of JPEG of quality 80 in a flat area.
MIN_LAB_DISTANCE = 5.0

#: Tolerance of the background in standard deviations of the noise of the border.
NOISE_FACTOR = 4.0

#: Minimum fraction of the border that follows the plane of a plain background; an object may cover the remainder.
MIN_PLAIN_FRACTION = 0.75

#: Maximum noise of a plain background in Lab units, that of film grain; wallpaper and wood have 5 and more.
MAX_PLAIN_NOISE = 3.0

#: Number of fits of the paraboloid; each follows the light further in.
REFITS = 2

#: Minimum number of background pixels for a fit of the paraboloid.
MIN_FIT_PIXELS = 100

#: Maximum number of pixels of a fit.
MAX_FIT_PIXELS = 4000

#: Maximum difference of the hue of a shadow from the background in Lab units, and maximum loss of lightness, 0 to 1.
SHADOW_HUE, SHADOW_LOSS = 5.0, 0.45

#: Maximum gradient of the lightness of a shadow per pixel of the small copy; the edges of objects are steeper.
SHADOW_STEP = 5.0

#: Longer side in pixels of the copy for GrabCut, and its number of rounds.
COPY_SIDE_PX, ROUNDS = 320, 2

#: Minimum area of a hole (a handle, between legs) as a fraction of the image.
MIN_HOLE_FRACTION = 0.0005

#: Minimum area of a part of the foreground as a fraction of the image; smaller parts are dust.
MIN_PART_FRACTION = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Background:
    """Colour of the background, and how well the border follows it."""

    lab: Floats  #: (h, w, 3).
    noise: float  #: Standard deviation of the border in Lab units.
    fraction: float  #: Fraction of the border that follows.

    @property
    def is_plain(self) -> bool:
        """Return True if the border separates foreground from background."""
        return self.fraction >= MIN_PLAIN_FRACTION and self.noise <= MAX_PLAIN_NOISE

    @property
    def tolerance(self) -> float:
        """Maximum Lab distance of a pixel of the background."""
        return max(MIN_LAB_DISTANCE, NOISE_FACTOR * self.noise)


@dataclass(frozen=True, slots=True)
class Plain:
    """Backend for plain backgrounds."""

    def foreground(self, image: RGB) -> Foreground:
        """Return the foreground of an image (h, w, 3); it is refused as `not_plain` if the background is not plain."""
        lab = cv2.cvtColor(image.astype(np.float32) / 255.0, cv2.COLOR_RGB2LAB)
        ground = background(lab)
        if not ground.is_plain:
            return Foreground(np.zeros(image.shape[:2], np.uint8), METHOD, "not_plain")
        ground = with_curved_light(lab, ground)
        mask = difference_mask(np.linalg.norm(lab - ground.lab, axis=2), ground)
        # Shadows are removed, and GrabCut runs, on a small copy.
        height, width = mask.shape
        factor = min(1.0, COPY_SIDE_PX / max(height, width))
        size = (max(1, round(width * factor)), max(1, round(height * factor)))
        small_lab, small_ground = (cv2.resize(a, size, interpolation=cv2.INTER_AREA) for a in (lab, ground.lab))
        small = cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA) >= 0.5
        settled = small & ~shadow_mask(small_lab, small_ground, ~small)
        if settled.any():
            settled = grabcut_mask(cv2.resize(image, size, interpolation=cv2.INTER_AREA), small, settled)
        # The edge within a pixel of the small copy is that of the full image.
        if mask.shape != settled.shape:
            kernel, copy = np.ones((3, 3), np.uint8), settled.astype(np.uint8)
            inner = cv2.resize(cv2.erode(copy, kernel), (width, height), interpolation=cv2.INTER_NEAREST) > 0
            outer = cv2.resize(cv2.dilate(copy, kernel), (width, height), interpolation=cv2.INTER_NEAREST) > 0
            settled = inner | (outer & mask)
        return Foreground(settled.astype(np.uint8) * 255, METHOD)


def background(lab: Floats) -> Background:
    """Fit a plane of colour to the border of a Lab image (h, w, 3) by trimmed least squares."""
    height, width = lab.shape[:2]
    depth = max(2, round(BORDER_FRACTION * min(height, width)))
    border = np.zeros((height, width), bool)
    border[:depth] = border[-depth:] = border[:, :depth] = border[:, -depth:] = True
    y, x = np.nonzero(border)
    step = max(1, len(y) // MAX_FIT_PIXELS)
    y, x = y[::step], x[::step]
    terms = np.column_stack([np.ones(len(y)), x / width - 0.5, y / height - 0.5])  # (n, 3)
    colour = lab[y, x].astype(float)  # (n, 3)
    plane = np.vstack([np.median(colour, axis=0), np.zeros((2, 3))])
    for _ in range(5):
        residual = np.linalg.norm(colour - terms @ plane, axis=1)
        inliers = residual <= np.quantile(residual, MIN_PLAIN_FRACTION)
        plane = np.linalg.lstsq(terms[inliers], colour[inliers], rcond=None)[0]
    residual = np.linalg.norm(colour - terms @ plane, axis=1)
    smallest = residual[residual <= np.quantile(residual, MIN_PLAIN_FRACTION)]
    noise = float(np.sqrt(np.mean(smallest**2) / 3))
    fraction = float(np.mean(residual <= max(MIN_LAB_DISTANCE, NOISE_FACTOR * noise)))
    return Background(quadratic_surface(np.vstack([plane, np.zeros((3, 3))]), (height, width)), noise, fraction)


def with_curved_light(lab: Floats, ground: Background) -> Background:
    """Fit a paraboloid to all pixels (h, w, 3) of the background that are connected with the border."""
    height, width = lab.shape[:2]
    for _ in range(REFITS):
        y, x = np.nonzero(connected_with_border(np.linalg.norm(lab - ground.lab, axis=2) <= ground.tolerance))
        step = max(1, len(y) // MAX_FIT_PIXELS)
        y, x = y[::step], x[::step]
        if len(y) < MIN_FIT_PIXELS:
            break
        u, v = x / width - 0.5, y / height - 0.5
        terms = np.column_stack([np.ones(len(u)), u, v, u * u, u * v, v * v])  # (n, 6)
        fitted = np.linalg.lstsq(terms, lab[y, x].astype(float), rcond=None)[0]
        ground = Background(quadratic_surface(fitted, (height, width)), ground.noise, ground.fraction)
    return ground


def quadratic_surface(coefficients: NDArray[np.float64], shape: tuple[int, int]) -> Floats:
    """Evaluate coefficients (6, 3) of 1, x, y, xx, xy, yy as (h, w, 3), with x and y from -1/2 to 1/2."""
    c = coefficients.astype(np.float32)
    v = (np.arange(shape[0], dtype=np.float32) / shape[0] - 0.5)[:, None, None]
    u = (np.arange(shape[1], dtype=np.float32) / shape[1] - 0.5)[None, :, None]
    return np.asarray(c[0] + u * (c[1] + u * c[3]) + v * (c[2] + u * c[4] + v * c[5]))


def connected_with_border(mask: Mask) -> Mask:
    """Return the parts of a mask (h, w) that touch the border of the image."""
    _, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)
    touches = np.zeros(labels.max() + 1, bool)
    touches[np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])] = True
    touches[0] = False
    return np.asarray(touches[labels])


def difference_mask(distance: Floats, ground: Background) -> Mask:
    """Return the foreground (h, w) by the Lab distance (h, w) from the background, without holes and dust."""
    outside = connected_with_border(distance <= ground.tolerance)
    enclosed = (distance <= max(1.5, 2 * ground.noise)) & ~outside
    _, labels, stats, _ = cv2.connectedComponentsWithStats(enclosed.astype(np.uint8), connectivity=4)
    is_hole = stats[:, cv2.CC_STAT_AREA] >= MIN_HOLE_FRACTION * distance.size
    is_hole[0] = False
    holes = is_hole[labels]
    grown = cv2.dilate(holes.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    mask = ~(outside | holes | (grown & (distance <= ground.tolerance)))
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    is_part = stats[:, cv2.CC_STAT_AREA] >= MIN_PART_FRACTION * mask.size
    is_part[0] = False
    return np.asarray(is_part[labels])


def shadow_mask(lab: Floats, ground: Floats, outside: Mask) -> Mask:
    """Return the shadows (h, w): dark, soft, without a hue, and connected with the background `outside` (h, w).

    lab, ground : (h, w, 3) Lab colours of the image and of the background.
    """
    loss = (ground[..., 0] - lab[..., 0]) / np.maximum(ground[..., 0], 1.0)
    hue = np.linalg.norm(lab[..., 1:] - ground[..., 1:], axis=2)
    steps = [cv2.Sobel(lab[..., 0], cv2.CV_32F, *axis, scale=0.125) for axis in ((1, 0), (0, 1))]
    is_soft = np.hypot(*steps) <= SHADOW_STEP
    candidates = outside | ((loss > 0) & (loss <= SHADOW_LOSS) & (hue <= SHADOW_HUE) & is_soft)
    return np.asarray(connected_with_border(candidates) & ~outside)


def grabcut_mask(image: RGB, mask: Mask, inside: Mask) -> Mask:
    """Refine the object by GrabCut.

    Parameters
    ----------
    image : (h, w, 3) ndarray of uint8
        RGB image.
    mask : (h, w) ndarray of bool
        Object with its shadow. Pixels far outside are certain background, the shadow probable background.
    inside : (h, w) ndarray of bool
        Object without its shadow, whose core is certain foreground.
    """
    state = np.full(mask.shape, cv2.GC_BGD, np.uint8)
    near = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    state[near] = cv2.GC_PR_BGD
    state[inside] = cv2.GC_PR_FGD
    core = cv2.erode(inside.astype(np.uint8), np.ones((5, 5), np.uint8), borderValue=0) > 0
    state[core] = cv2.GC_FGD
    if not core.any() or near.all():
        return inside
    models = np.zeros((1, 65)), np.zeros((1, 65))
    bgr = np.ascontiguousarray(image[..., ::-1])
    cv2.setRNGSeed(0)
    cv2.grabCut(bgr, state, None, *models, ROUNDS, cv2.GC_INIT_WITH_MASK)
    return np.asarray((state == cv2.GC_FGD) | (state == cv2.GC_PR_FGD))

"""Quality of a mask, estimated from the image and the mask, and the reasons to reject a cut-out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from metric_base.text_tables import named_texts
from metric_tree.cutouts.backend import RGB

#: Reasons to reject a cut-out (column `set_aside`).
REASONS = named_texts(Path(__file__).with_name("reasons.txt"))

#: Range of the fraction of the foreground; outside, the backend found no object or no background.
MIN_FOREGROUND_FRACTION, MAX_FOREGROUND_FRACTION = 0.005, 0.97

#: Maximum fraction of the border of the image that an object covers; with more it is truncated on several sides.
MAX_BORDER_FRACTION = 0.6

#: Minimum area of the second largest part, relative to the largest, of an image of two objects.
MIN_SECOND_FRACTION = 0.35

#: Minimum quality of a mask.
MIN_QUALITY = 0.5

#: Minimum opacity of the foreground.
MIN_ALPHA = 128

#: Range of an undecided opacity.
UNDECIDED_ALPHA = (32, 224)

#: Lab distance across a clear edge; half of it gives a quality of one half.
CLEAR_EDGE = 12.0

#: Width in pixels of the strips on both sides of the edge whose colours are compared.
EDGE_STEP_PX = 3


@dataclass(frozen=True, slots=True)
class Assessment:
    """Assessment of a mask."""

    box: tuple[int, int, int, int]  #: x, y, width, height in pixels.
    share: float  #: Fraction of the image.
    quality: float  #: 0 to 1.
    reason: str | None  #: Reason to reject the mask (`REASONS`).


def assessment(pixels: RGB, alpha: NDArray[np.uint8]) -> Assessment:
    """Assess the mask alpha (h, w) of an image (h, w, 3).

    The quality is the product of the mean contrast along the edge and the fraction of decided opacities.
    """
    mask = alpha >= MIN_ALPHA
    fraction = float(mask.mean())
    if fraction < MIN_FOREGROUND_FRACTION:
        return Assessment((0, 0, 0, 0), fraction, 0.0, "empty")
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    box = (int(columns[0]), int(rows[0]), int(np.ptp(columns)) + 1, int(np.ptp(rows)) + 1)
    border = np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]])
    if fraction > MAX_FOREGROUND_FRACTION or border.mean() > MAX_BORDER_FRACTION:
        return Assessment(box, fraction, 0.0, "full")
    low, high = UNDECIDED_ALPHA
    n_undecided, n_foreground = int(np.sum((alpha > low) & (alpha < high))), int(np.sum(alpha > low))
    quality = edge_contrast(pixels, mask) * (1.0 - n_undecided / max(1, n_foreground))
    _, _, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    areas = np.sort(stats[1:, cv2.CC_STAT_AREA].astype(np.float64))[::-1]
    second = float(areas[1]) / float(areas[0]) if len(areas) > 1 else 0.0
    reason = "several" if second >= MIN_SECOND_FRACTION else "doubtful" if quality < MIN_QUALITY else None
    return Assessment(box, fraction, round(quality, 4), reason)


def edge_contrast(pixels: RGB, mask: NDArray[np.bool_]) -> float:
    """Return the mean contrast along the edge of a mask (h, w) of an image (h, w, 3), 0 to 1.

    The contrast is the Lab distance between the mean colours on both sides, divided by `CLEAR_EDGE`, at most 1.
    """
    lab = cv2.cvtColor(pixels.astype(np.float32) / 255.0, cv2.COLOR_RGB2LAB)
    one = mask.astype(np.uint8)
    kernel = np.ones((3, 3), np.uint8)
    inner, outer = cv2.erode(one, kernel, iterations=EDGE_STEP_PX), cv2.dilate(one, kernel, iterations=EDGE_STEP_PX)
    edge = (one > 0) & (cv2.erode(one, kernel, borderValue=1) == 0)
    span = (4 * EDGE_STEP_PX + 1, 4 * EDGE_STEP_PX + 1)
    means = []
    for strip in (one * (inner == 0), (outer > 0) * (one == 0)):  # inside and outside of the edge
        weight = strip.astype(np.float32)
        total = cv2.blur(weight, span)
        means.append(cv2.blur(lab * weight[..., None], span) / np.maximum(total, 1e-6)[..., None])
    step = np.linalg.norm(means[0] - means[1], axis=2)[edge]
    return float(np.clip(step / CLEAR_EDGE, 0, 1).mean())

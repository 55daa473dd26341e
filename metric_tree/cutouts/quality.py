"""How far a mask can be trusted, judged by the image and the mask alone, and why one is set aside."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from metric_tree.cutouts.backend import RGB

#: Why a cut-out is set aside.
REASONS = {
    "empty": "less than half a per cent of the picture is foreground",
    "full": "more than 97 % of the picture is foreground, or it fills most of the picture's border",
    "several": "two or more objects of like size that do not touch",
    "doubtful": "the quality is below 0.5: a blurred edge, or no difference of colour along it",
    "not_plain": "the background is not plain, and the backend needs it to be",
    "poor": "the reviewer of its guide does not vouch for the cut",
    "no_weights": "the background is not plain, and no network's weights are available",
    "unreadable": "the file is no picture: broken, animated, too large, or not what its name says",
}

#: Foreground shares outside which nothing was found, or everything.
MIN_FOREGROUND_SHARE, MAX_FOREGROUND_SHARE = 0.005, 0.97

#: Share of the image's border that an object may cover: more is a detail, cut off on several sides.
MAX_BORDER_SHARE = 0.6

#: A second part of this share of the largest is a second object, not a loose handle.
SECOND_PART_SHARE = 0.35

#: Below it a mask is doubtful.
MIN_QUALITY = 0.5

#: Lab distance across an edge that everyone sees as an edge; half of it gives a quality of one half.
CLEAR_EDGE = 12.0

#: Pixels to each side of the edge where its colours are read.
EDGE_STEP_PX = 3


@dataclass(frozen=True, slots=True)
class Assessment:
    """Of one mask. box : x, y, width, height in pixels; share : of the image; quality : 0 to 1; reason : or None."""

    box: tuple[int, int, int, int]
    share: float
    quality: float
    reason: str | None


def assessment(picture: RGB, alpha: NDArray[np.uint8]) -> Assessment:
    """Box, share and quality of the mask alpha (h, w) of an image (h, w, 3), and why it is set aside, if so."""
    mask = alpha >= 128
    share = float(mask.mean())
    if share < MIN_FOREGROUND_SHARE:
        return Assessment((0, 0, 0, 0), share, 0.0, "empty")
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    box = (int(columns[0]), int(rows[0]), int(np.ptp(columns)) + 1, int(np.ptp(rows)) + 1)
    edge = np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]])
    if share > MAX_FOREGROUND_SHARE or edge.mean() > MAX_BORDER_SHARE:
        return Assessment(box, share, 0.0, "full")
    quality = _edge_contrast(picture, mask) * _decided_share(alpha)
    reason = "several" if _second(mask) >= SECOND_PART_SHARE else "doubtful" if quality < MIN_QUALITY else None
    return Assessment(box, share, round(quality, 4), reason)


def _edge_contrast(picture: RGB, mask: NDArray[np.bool_]) -> float:
    """0 to 1: the share of the mask's edge with a difference of colour across it; (h, w, 3) and (h, w)."""
    lab = cv2.cvtColor(picture.astype(np.float32) / 255.0, cv2.COLOR_RGB2LAB)
    one = mask.astype(np.uint8)
    kernel = np.ones((3, 3), np.uint8)
    inner, outer = cv2.erode(one, kernel, iterations=EDGE_STEP_PX), cv2.dilate(one, kernel, iterations=EDGE_STEP_PX)
    edge = (one > 0) & (cv2.erode(one, kernel, borderValue=1) == 0)
    if not edge.any():
        return 0.0
    span = (4 * EDGE_STEP_PX + 1, 4 * EDGE_STEP_PX + 1)
    means = []
    for side in (one * (inner == 0), (outer > 0) * (one == 0)):  # the strips just inside and just outside
        weight = side.astype(np.float32)
        total = cv2.blur(weight, span)
        means.append(cv2.blur(lab * weight[..., None], span) / np.maximum(total, 1e-6)[..., None])
    step = np.linalg.norm(means[0] - means[1], axis=2)[edge]
    return float(np.clip(step / CLEAR_EDGE, 0, 1).mean())


def _decided_share(alpha: NDArray[np.uint8]) -> float:
    """0 to 1: how little of the foreground, alpha (h, w), is neither on nor off."""
    soft, on = int(np.sum((alpha > 32) & (alpha < 224))), int(np.sum(alpha > 32))
    return 1.0 - soft / max(1, on)


def _second(mask: NDArray[np.bool_]) -> float:
    """Area of the second largest part of a mask (h, w) over that of the largest."""
    _, _, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    areas = np.sort(stats[1:, cv2.CC_STAT_AREA].astype(np.float64))[::-1]
    return float(areas[1]) / float(areas[0]) if len(areas) > 1 else 0.0

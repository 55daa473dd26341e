"""Foregrounds under a guide that a person drew; GrabCut finds the exact edge.

A file of guides has one JSON object per line: `picture` (SHA-256), one of `polygon` ([[x, y], ...]) and `box` ([x, y,
width, height]), and `object` and `ground` (strokes, lists of points), in pixels of the upright image. `verdict` is the
reviewer's judgement of the cut-out: `good`, or `poor` with the reason in `why`. A poor one needs no outline if no
object is complete.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from metric_base.records import json_lines
from metric_tree.cutouts.backend import RGB, Foreground, Guide

METHOD = "guided"
#: Maximum error of the edge of a guide, as a fraction of the shorter side of the object. The image decides about pixels
#: within this distance of the edge.
EDGE_TOLERANCE = 0.09
#: Width of a stroke in pixels.
STROKE_PX = 5
#: Rounds of GrabCut (Rother et al. 2004).
ROUNDS = 5
#: Standard deviation of the softened edge in pixels.
EDGE_SD_PX = 0.8


def guides(path: Path) -> dict[str, Guide]:
    """Read the guides of a file by image; a later one replaces an earlier one.

    Raises
    ------
    InputError
        A line is not a guide; the message has file, line and field.
    """
    return {guide.picture: guide for _, guide in json_lines(path, Guide)}


def guided_foreground(image: RGB, guide: Guide) -> Foreground:
    """Return the foreground of an image (h, w, 3) under a guide; it is refused as `poor` if the verdict is.

    A guide outside the image gives an empty foreground.
    """
    refused = "poor" if guide.verdict == "poor" else None
    empty = Foreground(np.zeros(image.shape[:2], np.uint8), METHOD, refused)
    if guide.undrawn:
        return empty
    state = grabcut_state(guide, image.shape[:2])
    present = set(np.unique(state).tolist())
    if not {cv2.GC_FGD, cv2.GC_PR_FGD} & present or cv2.GC_BGD not in present:
        return empty
    cv2.setRNGSeed(0)
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(image[..., ::-1].copy(), state, None, *models, ROUNDS, cv2.GC_INIT_WITH_MASK)
    mask = np.isin(state, (cv2.GC_FGD, cv2.GC_PR_FGD)).astype(np.uint8)
    # The object is the largest part, without holes.
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    if len(stats) > 1:
        largest = (labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))).astype(np.uint8)
        outlines, _ = cv2.findContours(largest, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        mask = np.asarray(cv2.drawContours(np.zeros_like(largest), outlines, -1, 1, cv2.FILLED), np.uint8)
    soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), EDGE_SD_PX)
    return Foreground(np.asarray(np.rint(soft * 255), np.uint8), METHOD, refused)


def grabcut_state(guide: Guide, shape: tuple[int, int]) -> NDArray[np.uint8]:
    """Return the initial labels of GrabCut (h, w): certain inside and outside, undecided near the edge."""
    area = np.zeros(shape, np.uint8)
    if guide.box is not None:
        x, y, width, height = guide.box
        corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]
    else:
        corners = list(guide.polygon)
    cv2.fillPoly(area, [np.rint(corners).astype(np.int32)], 1)
    points = np.asarray(corners)
    radius = max(2, round(EDGE_TOLERANCE * float((points.max(axis=0) - points.min(axis=0)).min())))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    state = np.full(shape, cv2.GC_BGD, np.uint8)
    state[cv2.dilate(area, kernel) > 0] = cv2.GC_PR_BGD
    state[area > 0] = cv2.GC_PR_FGD
    if guide.box is None:  # the object touches its box only at the sides, so that no pixel inside is certain
        state[cv2.erode(area, kernel, borderValue=0) > 0] = cv2.GC_FGD
    for strokes, label in ((guide.object, cv2.GC_FGD), (guide.ground, cv2.GC_BGD)):
        for stroke in strokes:
            points_px = [np.rint(stroke).astype(np.int32)]
            cv2.polylines(state, points_px, isClosed=False, color=int(label), thickness=STROKE_PX)
    return state

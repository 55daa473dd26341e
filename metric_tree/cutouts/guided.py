"""Foregrounds by a person's guide (`metric_tree.cutouts.guided`): GrabCut finds the edge that the guide only means.

Guides for cutting images, drawn by a person: where the object is.

A file of guides has one JSON object a line: `picture` (sha256), one of `polygon` ([[x, y], ...]) and `box` ([x, y,
width, height]), and `object` and `ground` (strokes, lists of points), in pixels of the upright image; `verdict` is
what its reviewer judges of the cut: `good`, or `poor` with `why`. A poor one needs no outline: no object is whole.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from metric_base.records import json_lines
from metric_tree.cutouts.backend import RGB, Foreground, Guide

METHOD = "guided"
#: The guide's edge is off by this share of the object's shorter side: between its shrunken and its grown outline the
#: image decides.
BAND = 0.09
#: Width of a scribble in pixels, and rounds of GrabCut (Rother et al. 2004).
STROKE, ROUNDS = 5, 5
#: Standard deviation in pixels of the softened edge.
SOFT = 0.8


def guides(path: Path) -> dict[str, Guide]:
    """The guides of a file by image; a later one replaces an earlier one.

    Raises
    ------
    InputError
        A line is no guide; the message names file, line and field.
    """
    return {guide.picture: guide for _, guide in json_lines(path, Guide)}


def guided_foreground(picture: RGB, guide: Guide) -> Foreground:
    """The foreground of an image (h, w, 3) under a guide; `refused` is `poor` if its reviewer does not vouch for it.

    A guide that lies outside the image finds nothing.
    """
    refused = "poor" if guide.verdict == "poor" else None
    if guide.undrawn:
        return Foreground(np.zeros(picture.shape[:2], np.uint8), METHOD, refused)
    state = _state(guide, picture.shape[:2])
    known = set(np.unique(state).tolist())
    if not {cv2.GC_FGD, cv2.GC_PR_FGD} & known or cv2.GC_BGD not in known:
        return Foreground(np.zeros(picture.shape[:2], np.uint8), METHOD, refused)
    cv2.setRNGSeed(0)
    cv2.grabCut(
        picture[..., ::-1].copy(), state, None, np.zeros((1, 65)), np.zeros((1, 65)), ROUNDS, cv2.GC_INIT_WITH_MASK
    )
    mask = _largest(np.isin(state, (cv2.GC_FGD, cv2.GC_PR_FGD)).astype(np.uint8))
    soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), SOFT)
    return Foreground(np.asarray(np.rint(soft * 255), np.uint8), METHOD, refused)


def _state(guide: Guide, shape: tuple[int, int]) -> NDArray[np.uint8]:
    """(h, w) of GrabCut's labels: certain inside and outside, undecided along the guide's edge."""
    area = np.zeros(shape, np.uint8)
    if guide.box is not None:
        x, y, width, height = guide.box
        corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]
    else:
        corners = list(guide.polygon)
    cv2.fillPoly(area, [np.rint(corners).astype(np.int32)], 1)
    points = np.asarray(corners)
    reach = max(2, round(BAND * float((points.max(axis=0) - points.min(axis=0)).min())))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    state = np.full(shape, cv2.GC_BGD, np.uint8)
    state[cv2.dilate(area, kernel) > 0] = cv2.GC_PR_BGD
    state[area > 0] = cv2.GC_PR_FGD
    if guide.box is None:  # a box touches the object at its sides alone: nothing inside is certain
        state[cv2.erode(area, kernel, borderValue=0) > 0] = cv2.GC_FGD
    for strokes, label in ((guide.object, cv2.GC_FGD), (guide.ground, cv2.GC_BGD)):
        for stroke in strokes:
            cv2.polylines(state, [np.rint(stroke).astype(np.int32)], isClosed=False, color=int(label), thickness=STROKE)
    return state


def _largest(mask: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The largest part of a mask (h, w), its holes filled: an object that is drawn round is one."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    if len(stats) < 2:
        return mask
    whole = (labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))).astype(np.uint8)
    outlines, _ = cv2.findContours(whole, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return np.asarray(cv2.drawContours(np.zeros_like(whole), outlines, -1, 1, cv2.FILLED), np.uint8)

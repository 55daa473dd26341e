"""Corners of square markers, to a hundredth of their side.

OpenCV refines a marker's corner as one of a chessboard, where four fields meet (`CORNER_REFINE_SUBPIX`): at the outer
corner of a black square that is outside by a part of the blur: a marker 40 pixels wide comes out 2 to 3 % too large.
Its way of AprilTag 2 fits the edges and has no such bias, but takes half a second a megapixel. So markers are found in
the picture, and their corners in a cut-out around each; those that are not found there are left out.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from metric_base.arrays import FloatArray

__all__ = ["marker_corners"]

#: A cut-out has this part of the marker's box on each side, for its white border, and at least so many pixels.
MARGIN, LEAST_MARGIN = 0.3, 6
#: A cut-out is made larger or smaller until the marker is so many pixels wide: edges are then found to a thousandth of
#: it, and a small one is found at all.
LEAST_SIDE, MOST_SIDE = 100.0, 200.0
#: Corners that move further than this share of the box belong to another marker.
MOST_MOVE = 0.2


def marker_corners(picture: Any, dictionary: Any) -> list[tuple[int, FloatArray]]:
    """The markers of an OpenCV dictionary in a grey picture: number and corners (4, 2), clockwise from the upper left.

    Pixels as OpenCV counts them: the middle of the first is (0, 0).
    """
    import cv2

    parameters = cv2.aruco.DetectorParameters()
    seen = _markers(cv2.aruco.ArucoDetector(dictionary, parameters), picture)
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_APRILTAG
    fine = cv2.aruco.ArucoDetector(dictionary, parameters)
    refined = [(number, _refine(picture, fine, number, corners)) for number, corners in seen]
    return [(number, corners) for number, corners in refined if corners is not None]


def _markers(detector: Any, picture: Any) -> list[tuple[int, FloatArray]]:
    """The markers that a detector sees in a grey picture (h, w): number and corners (4, 2) in pixels."""
    corners, numbers, _ = detector.detectMarkers(picture)
    if numbers is None:
        return []
    squares = [np.asarray(square, dtype=float).reshape(4, 2) for square in corners]
    return list(zip(np.ravel(numbers).tolist(), squares, strict=True))


def _refine(picture: Any, detector: Any, number: int, corners: FloatArray) -> FloatArray | None:
    """The corners (4, 2) as the detector finds them in a cut-out; None if it does not: coarse ones say too much."""
    import cv2

    low, high = corners.min(axis=0), corners.max(axis=0)
    extent = float((high - low).max())
    margin = max(MARGIN * extent, LEAST_MARGIN)
    left, top = np.maximum(np.floor(low - margin), 0).astype(int)
    right, bottom = np.ceil(high + margin).astype(int) + 1
    part = np.ascontiguousarray(picture[top:bottom, left:right])
    factor = float(np.clip(extent, LEAST_SIDE, MOST_SIDE)) / extent
    if factor != 1:
        part = cv2.resize(
            part, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
        )
    ratio = np.array(part.shape[1::-1]) / np.array(picture[top:bottom, left:right].shape[1::-1])
    others = [
        (square + 0.5) / ratio - 0.5 + (left, top) for marker, square in _markers(detector, part) if marker == number
    ]
    moves = [float(np.linalg.norm(square - corners, axis=1).max()) for square in others]
    if not moves or min(moves) > MOST_MOVE * extent:
        return None
    return np.asarray(others[int(np.argmin(moves))])

"""Corners of square markers, to a hundredth of their side.

OpenCV refines a marker's corner as one of a chessboard, where four fields meet (`CORNER_REFINE_SUBPIX`): at the outer
corner of a black square that is outside by a part of the blur: a marker 40 pixels wide comes out 2 to 3 % too large.
Its way of AprilTag 2 fits the edges and has no such bias, but takes half a second a megapixel. So markers are found in
the picture, and their corners in a cut-out around each; those that are not found there are left out.

Markers of a stated size in the pictures: ArUco, AprilTag, and ChArUco boards.

A point from the pixels where several views see it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from estimator.evidence.alignment import align
from estimator.evidence.source import silent
from estimator.instances.view_matching import image_file, image_folders
from estimator.projection.cameras import pixels_in_view, view_rays
from estimator.records.result import ScaleEvidence
from estimator.records.scene import Scene, View
from metric_base.arrays import FloatArray
from metric_base.errors import InputError
from metric_base.images import read_picture

if TYPE_CHECKING:
    from estimator.records.objects import Measurements

#: A cut-out has this part of the marker's box on each side, for its white border, and at least so many pixels.
MARGIN, LEAST_MARGIN = 0.3, 6
#: A cut-out is made larger or smaller until the marker is so many pixels wide: edges are then found to a thousandth of
#: it, and a small one is found at all.
LEAST_SIDE, MOST_SIDE = 100.0, 200.0
#: Corners that move further than this share of the box belong to another marker.
MOST_MOVE = 0.2
#: Rays nearer to parallel than this (radians) meet anywhere.
LEAST_ANGLE = 0.01
KIND = "marker"
#: Most columns or rows of a board: its picture would have thousands of pixels.
MAX_SQUARES = 200
#: Printers and paper stretch by half a per cent: no marker is better, natural log.
LEAST_SD = 0.005
#: Corners that project further than this share of the longer image side from where they were seen are not theirs.
MOST_ERROR = 0.005
#: Corners of one marker, in metres times its side: clockwise from the upper left, as OpenCV finds them.
SQUARE: FloatArray = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


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


def triangulate(views: Sequence[View], pixels: FloatArray, most_error: float) -> FloatArray | None:
    """The point (3,) nearest to the rays through `pixels` (n, 2), one a view.

    Least squares of the distances from the rays c + t d:  sum (I - d d') x = sum (I - d d') c.  The worst view is left
    out until all agree within `most_error` of the longer image side; None where two views or less are left, or where
    the rays are nearly parallel.
    """
    views, pixels = list(views), pixels.copy()
    while len(views) >= 2:
        point = _nearest(views, pixels)
        if point is None:
            return None
        errors = [_error(view, pixel, point) for view, pixel in zip(views, pixels, strict=True)]
        worst = int(np.argmax(errors))
        if errors[worst] <= most_error:
            return point
        views.pop(worst)
        pixels = np.delete(pixels, worst, axis=0)
    return None


def _nearest(views: Sequence[View], pixels: FloatArray) -> FloatArray | None:
    """(3,) point nearest to the rays of one pixel (2,) per view; None of nearly parallel rays."""
    directions = np.array(
        [view_rays(view.camera, pixel[None])[0] @ view.rotation for view, pixel in zip(views, pixels, strict=True)]
    )
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    if float((directions @ directions.T).min()) > np.cos(LEAST_ANGLE):
        return None
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]  # (n, 3, 3)
    centres = np.array([view.centre for view in views])
    return np.asarray(np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, centres)))


def _error(view: View, pixel: FloatArray, point: FloatArray) -> float:
    """Distance of a pixel (2,) from that of a point (3,), as a share of the longer side; infinite behind the camera."""
    projected, depths = pixels_in_view(view, point[None])
    distance = float(np.linalg.norm(projected[0] - pixel)) / max(view.camera.width, view.camera.height)
    return distance if np.isfinite(distance) and depths[0] > 0 else np.inf


@dataclass(frozen=True, slots=True)
class Marker:
    """Markers of an OpenCV dictionary (`DICT_4X4_50`, `APRILTAG_36h11`) with sides of `metres`.

    board : (columns, rows, marker side in metres) of a ChArUco board, whose squares then have sides of `metres`;
    images : the folder of the pictures, if it is not `images` beside or above the model.
    """

    dictionary: str
    metres: float
    board: tuple[int, int, float] | None = None
    images: Path | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.metres) and self.metres > 0):
            raise InputError.at("--marker", "metres", "a positive side", self.metres)
        if _dictionary_name(self.dictionary) is None:
            expected = "a dictionary of OpenCV, such as DICT_4X4_50 or APRILTAG_36h11"
            raise InputError.at("--marker", "dictionary", expected, self.dictionary)
        if self.board is not None:
            self._check_board(*self.board)

    def _check_board(self, columns: int, rows: int, side: float) -> None:
        if not (2 <= columns <= MAX_SQUARES and 2 <= rows <= MAX_SQUARES):
            raise InputError.at("--marker", "board", f"2 to {MAX_SQUARES} columns and rows", (columns, rows))
        if not 0 < side < self.metres:
            raise InputError.at("--marker", "board", "markers smaller than their squares", (self.metres, side))

    @classmethod
    def of(cls, text: str) -> Marker:
        """The markers of `DICT:METRES`, or of `charuco:DICT:COLUMNSxROWS:SQUARE:MARKER` with sides in metres.

        >>> Marker.of("DICT_4X4_50:0.10")
        Marker(dictionary='DICT_4X4_50', metres=0.1, board=None, images=None)
        """
        parts = text.split(":")
        try:
            if parts[0].lower() == "charuco" and len(parts) == 5:
                columns, rows = (int(part) for part in parts[2].lower().split("x"))
                return cls(parts[1], float(parts[3]), (columns, rows, float(parts[4])))
            if len(parts) == 2:
                return cls(parts[0], float(parts[1]))
        except ValueError as error:
            if isinstance(error, InputError):
                raise
        expected = "DICT:METRES or charuco:DICT:COLUMNSxROWS:SQUARE:MARKER"
        raise InputError.at("--marker", "value", expected, text)

    def observe(self, scene: Scene, measurements: Measurements) -> tuple[ScaleEvidence, ...]:  # noqa: ARG002
        """One row for each marker that two views or more show; its corners are triangulated."""
        seen = self._corners(scene)
        if seen is None:
            return silent(KIND, self.dictionary, "no picture of the scene was found (--images DIR names their folder)")
        measured = [_row(name, self._shape(corners), corners, scene) for name, corners in sorted(seen.items())]
        rows = [row for row in measured if row is not None]
        return tuple(rows) or silent(KIND, self.dictionary, "no marker is in two pictures or more")

    def _shape(self, corners: Mapping[int, object]) -> dict[int, FloatArray]:
        """Metres (3,) of each corner in the marker's own frame."""
        if self.board is None:
            return {number: self.metres * SQUARE[number] for number in corners}
        columns = self.board[0] - 1  # inner corners
        return {n: self.metres * np.array([n % columns, n // columns, 0.0]) for n in corners}

    def _corners(self, scene: Scene) -> dict[str, dict[int, list[tuple[int, FloatArray]]]] | None:
        """By marker and corner: (row of the view, pixel (2,)); None where there is no picture."""
        import cv2

        folders, detect = image_folders(scene, self.images), self._detector()
        seen: dict[str, dict[int, list[tuple[int, FloatArray]]]] = {}
        pictures = 0
        for row, view in enumerate(scene.views):
            file = image_file(folders, view)
            picture = None if file is None else read_picture(file, cv2.IMREAD_GRAYSCALE)
            if picture is None:
                continue
            pictures += 1
            ratio = np.array([view.camera.width / picture.shape[1], view.camera.height / picture.shape[0]])
            for name, number, pixel in detect(picture):
                # OpenCV's pixel centres are whole numbers, the scene's are halves
                seen.setdefault(name, {}).setdefault(number, []).append((row, (pixel + 0.5) * ratio))
        return seen if pictures else None

    def _detector(self) -> Callable[[Any], Sequence[tuple[str, int, FloatArray]]]:
        """What finds (marker, corner, pixel (2,)) in a grey picture."""
        import cv2

        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, str(_dictionary_name(self.dictionary))))
        if self.board is None:
            return lambda picture: _aruco_corners(dictionary, picture)
        columns, rows, side = self.board
        board = cv2.aruco.CharucoBoard((columns, rows), self.metres, side, dictionary)
        charuco = cv2.aruco.CharucoDetector(board)
        return lambda picture: _board_corners(charuco, picture)


def _dictionary_name(name: str) -> str | None:
    """OpenCV's name of a dictionary, or None."""
    import cv2

    known = {known.lower(): known for known in dir(cv2.aruco) if known.startswith("DICT_")}
    return known.get(name.lower()) or known.get(f"dict_{name.lower()}")


def _aruco_corners(dictionary: Any, picture: Any) -> list[tuple[str, int, FloatArray]]:
    """Name, corner number and pixel (2,) of every corner of a marker in a picture."""
    return [
        (str(number), place, pixel)
        for number, square in marker_corners(picture, dictionary)
        for place, pixel in enumerate(square)
    ]


def _board_corners(detector: Any, picture: Any) -> list[tuple[str, int, FloatArray]]:
    """Name, corner number and pixel (2,) of every corner of a board in a picture."""
    corners, ids, *_ = detector.detectBoard(picture)
    if ids is None:
        return []
    pixels = np.asarray(corners, dtype=float).reshape(-1, 2)
    return [("board", int(number), pixel) for number, pixel in zip(np.ravel(ids), pixels, strict=True)]


def _row(
    name: str, shape: Mapping[int, FloatArray], corners: Mapping[int, Sequence[tuple[int, FloatArray]]], scene: Scene
) -> ScaleEvidence | None:
    """The evidence of one marker, or None where too few of its corners are in two views.

    shape : (3,) metres of each corner; corners : of each, rows of the views with its pixel (2,).
    """
    places = {}
    for number, seen in corners.items():
        views = [scene.views[row] for row, _ in seen]
        point = triangulate(views, np.array([pixel for _, pixel in seen]), MOST_ERROR)
        if point is not None:
            places[number] = point
    if len(places) < 3:
        return None
    alignment = align(np.array(list(places.values())), np.array([shape[number] for number in places]))
    if alignment is None or alignment.sd_log > 1:
        return None
    return ScaleEvidence(KIND, name, alignment.scale, math.hypot(alignment.sd_log, LEAST_SD))

"""Estimate the scale from printed markers of known size in the images: ArUco, AprilTag, and ChArUco boards.

The corners of a marker are refined in a crop around it. OpenCV refines a corner like a chessboard corner, where four
fields meet (`CORNER_REFINE_SUBPIX`); at the outer corner of a black square, the result is outside by a fraction of the
blur, and a marker 40 pixels wide is 2 to 3 % too large. The method of AprilTag 2 fits the edges and has no such bias,
but takes half a second per megapixel. Markers are therefore detected in the image, and their corners in the crop;
markers that are not detected in the crop are not used. The corners are triangulated and aligned with the marker.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from estimator.evidence.alignment import align
from estimator.evidence.source import skipped_evidence
from estimator.projection.cameras import pixels_in_view, view_rays
from estimator.reconstructions.image_files import image_file, image_folders
from estimator.records.objects import Measurements
from estimator.records.result import ScaleEvidence
from estimator.records.scene import Scene, View, camera_centres
from metric_base.arrays import FloatArray
from metric_base.errors import InputError
from metric_base.images import read_image
from metric_base.length_units import metres

KIND = "marker"
#: Margin of a crop around a marker for its white border, relative to its box, and its minimum in pixels.
CROP_MARGIN = 0.3
MIN_CROP_MARGIN_PX = 6
#: Range of the width in pixels to which the marker in a crop is resized: its edges are then accurate to a thousandth of
#: it, and a small marker is detected.
MIN_CROP_SIDE_PX = 100.0
MAX_CROP_SIDE_PX = 200.0
#: Maximum movement of a corner by the refinement, relative to the box; beyond it, the corner belongs to another marker.
MAX_CORNER_MOVE = 0.2
#: Minimum number of views of a corner, and of corners of a marker: two rays meet, and three points determine a scale.
MIN_VIEWS, MIN_CORNERS = 2, 3
#: Minimum angle between rays in radians; more parallel rays have no accurate intersection.
MIN_RAY_ANGLE = 0.01
#: Maximum number of columns or rows of a board: its image would have thousands of pixels.
MAX_SQUARES = 200
#: Minimum standard deviation of the log scale: printers and paper stretch by half a per cent.
MIN_LOG_SD = 0.005
#: Maximum standard deviation of the log scale of a marker.
MAX_LOG_SD = 1.0
#: Maximum reprojection error of a corner, relative to the longer side of the image.
MAX_REPROJECTION_ERROR = 0.005
#: Corners of a marker, in multiples of its side: clockwise from the upper left, as OpenCV finds them.
SQUARE: FloatArray = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


def refined_marker_corners(image: Any, dictionary: Any) -> list[tuple[int, FloatArray]]:
    """Detect the markers of an OpenCV dictionary in a grey image (h, w).

    Returns
    -------
    list of tuple
        Id and corners (4, 2) of each marker, clockwise from the upper left. The centre of the first pixel is (0, 0), as
        in OpenCV.
    """
    parameters = cv2.aruco.DetectorParameters()
    coarse = detect_markers(cv2.aruco.ArucoDetector(dictionary, parameters), image)
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_APRILTAG
    detector = cv2.aruco.ArucoDetector(dictionary, parameters)
    refined = [(marker, refined_corners(image, detector, marker, corners)) for marker, corners in coarse]
    return [(marker, corners) for marker, corners in refined if corners is not None]


def detect_markers(detector: Any, image: Any) -> list[tuple[int, FloatArray]]:
    """Return the id and the corners (4, 2) of the markers in a grey image (h, w)."""
    corners, markers, _ = detector.detectMarkers(image)
    if markers is None:
        return []
    squares = [np.asarray(square, dtype=float).reshape(4, 2) for square in corners]
    return list(zip(np.ravel(markers).tolist(), squares, strict=True))


def refined_corners(image: Any, detector: Any, marker: int, corners: FloatArray) -> FloatArray | None:
    """Return the corners (4, 2) of a marker from a crop around it; None if the marker is not detected there."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    extent = float((high - low).max())
    margin = max(CROP_MARGIN * extent, MIN_CROP_MARGIN_PX)
    left, top = np.maximum(np.floor(low - margin), 0).astype(int)
    right, bottom = np.ceil(high + margin).astype(int) + 1
    crop = np.ascontiguousarray(image[top:bottom, left:right])
    factor = float(np.clip(extent, MIN_CROP_SIDE_PX, MAX_CROP_SIDE_PX)) / extent
    if factor != 1:
        interpolation = cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
        crop = cv2.resize(crop, None, fx=factor, fy=factor, interpolation=interpolation)
    ratio = np.array(crop.shape[1::-1]) / np.array(image[top:bottom, left:right].shape[1::-1])
    candidates = [
        (square + 0.5) / ratio - 0.5 + (left, top)
        for other, square in detect_markers(detector, crop)
        if other == marker
    ]
    moves = [float(np.linalg.norm(square - corners, axis=1).max()) for square in candidates]
    if not moves or min(moves) > MAX_CORNER_MOVE * extent:
        return None
    return np.asarray(candidates[int(np.argmin(moves))])


def triangulate(views: Sequence[View], pixels: FloatArray, max_error: float) -> FloatArray | None:
    """Return the point (3,) closest to the rays through `pixels` (n, 2), one in each view.

    It solves sum (I - d d') x = sum (I - d d') c for the rays c + t d. The view with the largest reprojection error is
    removed until all errors are at most `max_error`, relative to the longer side of the image. None if fewer than
    `MIN_VIEWS` remain, or if the rays are nearly parallel.
    """
    views, pixels = list(views), pixels.copy()
    while len(views) >= MIN_VIEWS:
        directions = np.array(
            [view_rays(view.camera, pixel[None])[0] @ view.rotation for view, pixel in zip(views, pixels, strict=True)]
        )
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        if float((directions @ directions.T).min()) > np.cos(MIN_RAY_ANGLE):
            return None
        across = np.eye(3) - directions[:, :, None] * directions[:, None, :]  # (n, 3, 3)
        centres = camera_centres(views)
        point = np.asarray(np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, centres)))
        errors = []
        for view, pixel in zip(views, pixels, strict=True):
            projected, depths = pixels_in_view(view, point[None])
            error = float(np.linalg.norm(projected[0] - pixel)) / max(view.camera.width, view.camera.height)
            errors.append(error if np.isfinite(error) and depths[0] > 0 else np.inf)
        worst = int(np.argmax(errors))
        if errors[worst] <= max_error:
            return point
        views.pop(worst)
        pixels = np.delete(pixels, worst, axis=0)
    return None


@dataclass(frozen=True, slots=True)
class Marker:
    """Markers of an OpenCV dictionary, or a ChArUco board."""

    dictionary: str  #: Such as `DICT_4X4_50` or `APRILTAG_36h11`.
    metres: float  #: Side of a marker, or of a square of the board.
    board: tuple[int, int, float] | None = None  #: Columns, rows and side of a marker in metres of a ChArUco board.
    images: Path | None = None  #: Folder of the images, if it is not `images` next to or above the model.

    def __post_init__(self) -> None:
        if not (math.isfinite(self.metres) and self.metres > 0):
            raise InputError.at("--marker", "metres", "a positive side", self.metres)
        if _dictionary_name(self.dictionary) is None:
            expected = "a dictionary of OpenCV, such as DICT_4X4_50 or APRILTAG_36h11"
            raise InputError.at("--marker", "dictionary", expected, self.dictionary)
        if self.board is None:
            return
        columns, rows, side = self.board
        if not (2 <= columns <= MAX_SQUARES and 2 <= rows <= MAX_SQUARES):
            raise InputError.at("--marker", "board", f"2 to {MAX_SQUARES} columns and rows", (columns, rows))
        if not 0 < side < self.metres:
            raise InputError.at("--marker", "board", "markers smaller than their squares", (self.metres, side))

    @classmethod
    def of(cls, text: str) -> Marker:
        """Parse `DICT:SIDE`, or `charuco:DICT:COLUMNSxROWS:SQUARE:MARKER`; sides are in metres or have a unit.

        >>> Marker.of("DICT_4X4_50:0.10")
        Marker(dictionary='DICT_4X4_50', metres=0.1, board=None, images=None)
        """
        parts = text.split(":")
        try:
            if parts[0].lower() == "charuco" and len(parts) == 5:
                columns, rows = (int(part) for part in parts[2].lower().split("x"))
                return cls(parts[1], metres(parts[3]), (columns, rows, metres(parts[4])))
            if len(parts) == 2:
                return cls(parts[0], metres(parts[1]))
        except ValueError as error:
            if isinstance(error, InputError):
                raise
        expected = "DICT:SIDE or charuco:DICT:COLUMNSxROWS:SQUARE:MARKER, as in DICT_4X4_50:10cm"
        raise InputError.at("--marker", "value", expected, text)

    def observe(self, scene: Scene, measurements: Measurements) -> tuple[ScaleEvidence, ...]:  # noqa: ARG002
        """Return the scale by each marker with `MIN_CORNERS` corners that `MIN_VIEWS` views show."""
        seen = self._corners(scene)
        if seen is None:
            missing = "no image of the scene was found (--images DIR names their folder)"
            return skipped_evidence(KIND, self.dictionary, missing)
        rows = []
        for name, corners in sorted(seen.items()):
            # Position (3,) in metres of each corner in the frame of the marker.
            shape = {number: self.metres * SQUARE[number] for number in corners} if self.board is None else {}
            if self.board is not None:
                columns = self.board[0] - 1  # inner corners
                shape = {n: self.metres * np.array([n % columns, n // columns, 0.0]) for n in corners}
            row = marker_evidence(name, shape, corners, scene)
            if row is not None:
                rows.append(row)
        return tuple(rows) or skipped_evidence(KIND, self.dictionary, "no marker is in two or more images")

    def _corners(self, scene: Scene) -> dict[str, dict[int, list[tuple[int, FloatArray]]]] | None:
        """Return, by marker and corner, the index of the view and the pixel (2,); None without images."""
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, str(_dictionary_name(self.dictionary))))
        charuco = None
        if self.board is not None:
            columns, rows, side = self.board
            charuco = cv2.aruco.CharucoDetector(cv2.aruco.CharucoBoard((columns, rows), self.metres, side, dictionary))
        folders = image_folders(scene, self.images)
        seen: dict[str, dict[int, list[tuple[int, FloatArray]]]] = {}
        n_images = 0
        for row, view in enumerate(scene.views):
            file = image_file(folders, view)
            image = None if file is None else read_image(file, cv2.IMREAD_GRAYSCALE)
            if image is None:
                continue
            n_images += 1
            ratio = np.array([view.camera.width / image.shape[1], view.camera.height / image.shape[0]])
            found: list[tuple[str, int, FloatArray]] = []  # marker, corner, pixel (2,)
            if charuco is None:
                for marker, square in refined_marker_corners(image, dictionary):
                    found += [(str(marker), corner, pixel) for corner, pixel in enumerate(square)]
            else:
                corners, ids, *_ = charuco.detectBoard(image)
                if ids is not None:
                    pixels = np.asarray(corners, dtype=float).reshape(-1, 2)
                    found = [("board", int(number), pixel) for number, pixel in zip(np.ravel(ids), pixels, strict=True)]
            for name, number, pixel in found:
                # The centre of the first pixel is (0, 0) in OpenCV and (0.5, 0.5) in the scene.
                seen.setdefault(name, {}).setdefault(number, []).append((row, (pixel + 0.5) * ratio))
        return seen if n_images else None


def _dictionary_name(name: str) -> str | None:
    """Return the name of a dictionary in OpenCV, or None."""
    known = {known.lower(): known for known in dir(cv2.aruco) if known.startswith("DICT_")}
    return known.get(name.lower()) or known.get(f"dict_{name.lower()}")


def marker_evidence(
    name: str, shape: Mapping[int, FloatArray], corners: Mapping[int, Sequence[tuple[int, FloatArray]]], scene: Scene
) -> ScaleEvidence | None:
    """Return the evidence of a marker, or None if fewer than `MIN_CORNERS` of its corners are in `MIN_VIEWS` views.

    `shape` has the position (3,) in metres of each corner, and `corners` the indices of its views with pixels (2,).
    """
    places = {}
    for number, seen in corners.items():
        views = [scene.views[row] for row, _ in seen]
        point = triangulate(views, np.array([pixel for _, pixel in seen]), MAX_REPROJECTION_ERROR)
        if point is not None:
            places[number] = point
    if len(places) < MIN_CORNERS:
        return None
    alignment = align(np.array(list(places.values())), np.array([shape[number] for number in places]))
    if alignment is None or alignment.sd_log > MAX_LOG_SD:
        return None
    return ScaleEvidence(KIND, name, alignment.scale, math.hypot(alignment.sd_log, MIN_LOG_SD))

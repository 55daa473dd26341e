"""Estimate the scale from positions of the cameras in metres: GPS of images (EXIF) or of a video, or a table.

A robust similarity aligns the cameras with their positions. It is rejected if the path is short relative to the
residual (also because most positions are wrong), or if the positions have another shape than the path: stretched in one
direction (degrees used as metres, exchanged columns) or with another vertical.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from estimator.evidence.alignment import Alignment, align, least_squares
from estimator.evidence.source import CameraPath, skipped_evidence
from estimator.geometry.vertical import MAX_TILT_SIGMAS, MAX_UP_ERROR_DEG, OBSERVED_METHODS
from estimator.instances.view_matching import ViewLookup
from estimator.reconstructions.image_files import image_file, image_folders
from estimator.records.objects import Measurements, Up
from estimator.records.result import TAKEN_AS_METRES, ScaleEvidence
from estimator.records.scene import Scene
from estimator.telemetry.gpmf import METRES_PER_DILUTION
from estimator.telemetry.records import Positions
from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, InputError, Unquoted, at_field, in_file
from metric_base.images import image_header
from metric_base.parsing import csv_rows, finite_numbers
from metric_base.rectangles import place_at

KIND, VIDEO_KIND = "gps", "gps_video"
#: Maximum time in seconds between the frames of a video without a gap in its path.
MAX_GAP_S = 1.0
#: Maximum median speed in m/s of a recording. An airliner flies at 280 m/s with the wind, and a walk at 1.4 m/s has
#: 1,400 m/s if millimetres are read as metres. A minimum is not needed, because too slow recordings have too short
#: paths.
MAX_SPEED_M_S = 350.0
#: Minimum fraction of the frames within the time range of the positions. If a log covers only half of the frames, it
#: ended early, or its times are not in seconds; then the scale of a straight path is wrong by the factor of the unit.
MIN_COVERED_FRACTION = 0.75
#: Time in seconds between the positions from which a speed is computed; within it, the errors of a receiver hardly
#: change.
SPEED_LAG_S = 1.0
#: Maximum standard deviation of the log scale; objects determine it better.
MAX_LOG_SD = 0.2
#: Maximum absolute value of a coordinate in metres or degrees, for any origin on the earth.
MAX_COORDINATE = 1e9
#: Equatorial radius of the earth in metres (WGS 84).
EARTH_RADIUS_M = 6_378_137.0
#: Maximum relative deviation of a geocentric position from this radius: 0.34 % by the flattening, and the rest for the
#: height of aeroplanes.
MAX_GEOCENTRIC_DEVIATION = 0.01
#: Maximum coordinate in metres of a local frame; beyond it, the coordinates belong to a map projection.
MAX_LOCAL_M = 1e5
#: Maximum absolute latitude in degrees.
POLE_DEG = 90.0
#: Minimum ratio of the scales in two directions of the path, for stretched positions.
MIN_STRETCH = 1.06
#: Maximum residual with a stretch, relative to the residual of the similarity, for stretched positions.
MAX_STRETCHED_RESIDUAL = 0.5
#: Minimum extent of the path in these directions, relative to its largest extent.
MIN_DIRECTION_EXTENT = 0.1
#: EXIF: tags of latitude, longitude and altitude with their references.
LAT_REF, LAT, LON_REF, LON, ALT_REF, ALT = 1, 2, 3, 4, 5, 6
#: EXIF: dilution of precision, and the horizontal error in metres.
DILUTION, POSITIONING_ERROR = 0x0B, 0x1F
#: Error of a position in metres if none is stated: typical of a phone under open sky.
TYPICAL_ACCURACY_M = 5.0
#: Fraction of the error of a receiver that changes along a recording; the remainder shifts the path.
DRIFT_FRACTION = 0.1
#: Error of the length of a path by errors at its ends, relative to its root mean square extent: sqrt(2) / sqrt(12).
END_TO_END = 0.41
#: Number of images that are searched for GPS without a request.
N_PROBED_IMAGES = 5
#: Minimum number of positions; a similarity fits fewer positions to any path.
MIN_POSITIONS = 4
#: Minimum extent of a path relative to the residual of its alignment.
MIN_EXTENT_RESIDUALS = 3.0
#: Minimum standard deviation of the log scale: the errors of a receiver along a path have a common drift.
MIN_LOG_SD = 0.01


@dataclass(frozen=True, slots=True)
class Gps:
    """Camera positions in a CSV file with a header, or in the EXIF data of the images.

    The columns of the file are `name`, and `lat`, `lon`, `alt` in degrees and metres (WGS 84), or `x`, `y`, `z` in
    metres.
    """

    source: str | Path  #: The file, or "exif".
    images: Path | None = None  #: Folder of the images, if it is not `images` next to or above the model.

    def observe(self, scene: Scene, measurements: Measurements) -> tuple[ScaleEvidence, ...]:
        """Return the scale of the similarity from the cameras to their positions; skipped if the path is too short."""
        if self.source == "exif":
            (stated, accuracy), geodetic = exif_positions(scene, self.images), True
            name = "exif"
        else:
            (stated, geodetic), accuracy = _table_positions(Path(self.source), scene), None
            name = Path(self.source).name
        if len(stated) < MIN_POSITIONS:
            return skipped_evidence(KIND, name, f"{len(stated)} views have a position, {MIN_POSITIONS} needed")
        metres = np.array(list(stated.values()))
        metres = east_north_up(metres) if geodetic else metres
        centres = np.array([scene.views[row].centre for row in stated])
        if (reason := speed_problem(*_timed(scene, self.images, dict(zip(stated, metres, strict=True))))) is not None:
            return skipped_evidence(KIND, name, reason)
        up = measurements.up if geodetic else None
        rows = position_evidence(KIND, name, centres, metres, accuracy, up)
        if geodetic:
            rows = _with_place(rows, np.array(list(stated.values())))
        if self.source == "exif":
            return rows
        assumption = "taken as decimal degrees and metres" if geodetic else taken_as_metres(metres)
        return tuple(row if row.scale is None else replace(row, assumption=assumption) for row in rows)


@dataclass(frozen=True, slots=True, eq=False)
class VideoGps:
    """Positions over time in a video or its log, and the path of the camera."""

    positions: Positions
    path: CameraPath
    name: str  #: Name of the file.

    def observe(self, scene: Scene, measurements: Measurements) -> tuple[ScaleEvidence, ...]:  # noqa: ARG002
        """Return the scale of the similarity from the path to the positions; skipped if the path is too short."""
        centres, rows = self.path.interpolate(self.positions.times_s, MAX_GAP_S)
        if len(rows) < MIN_POSITIONS:
            return skipped_evidence(
                VIDEO_KIND, self.name, f"{len(rows)} positions along the path, {MIN_POSITIONS} needed"
            )
        metres = self.positions.positions[rows]
        metres = east_north_up(metres) if self.positions.geodetic else metres
        if (reason := speed_problem(self.positions.times_s[rows], metres)) is not None:
            return skipped_evidence(VIDEO_KIND, self.name, reason)
        up = measurements.up if self.positions.geodetic else None
        accuracy = self.positions.accuracy_m or TYPICAL_ACCURACY_M
        times, frames = self.positions.times_s, self.path.times_s
        covered = float(np.mean((frames >= times[0]) & (frames <= times[-1])))
        partial = f"times taken as seconds, although the positions cover only {covered:.0%} of the frames"
        notes = [TAKEN_AS_METRES] * (not self.positions.geodetic) + [partial] * (covered < MIN_COVERED_FRACTION)
        evidence = position_evidence(VIDEO_KIND, self.name, centres, metres, accuracy, up)
        evidence = tuple(replace(row, assumption="; ".join(notes) or None) for row in evidence)
        return _with_place(evidence, self.positions.positions[rows]) if self.positions.geodetic else evidence


def speed_problem(times_s: FloatArray, metres: FloatArray) -> str | None:
    """Return the reason why a path (n, 3) at times (n,) cannot be one in metres, or None."""
    speed = path_speed(times_s, metres)
    if speed <= MAX_SPEED_M_S:
        return None
    return f"the positions move at {speed:.3g} m/s, faster than aeroplanes: wrong units or times?"


def path_speed(times_s: FloatArray, metres: FloatArray) -> float:
    """Return the median speed in m/s along a path (n, 3) at times (n,); 0 for a path shorter than the lag."""
    if not len(times_s):
        return 0.0
    later = times_s[times_s <= times_s[-1] - SPEED_LAG_S] + SPEED_LAG_S
    if not len(later):
        return 0.0
    moved = np.column_stack([np.interp(later, times_s, column) for column in metres.T]) - metres[: len(later)]
    return float(np.median(np.linalg.norm(moved, axis=1))) / SPEED_LAG_S


def images_have_gps(scene: Scene, images: Path | None) -> bool:
    """Return whether any of a few images of the scene has a position."""
    probed = scene.views[:: max(1, len(scene.views) // N_PROBED_IMAGES)][:N_PROBED_IMAGES]
    return len(exif_positions(replace(scene, views=tuple(probed)), images)[0]) > 0


def taken_as_metres(positions: FloatArray) -> str:
    """Return the assumption about positions (n, 3) of a table in metres.

    Web Mercator multiplies lengths by 1 / cos(latitude) = cosh(y / R).
    """
    x, y, z = np.median(positions, axis=0)
    is_projected = max(abs(x), abs(y)) > MAX_LOCAL_M and abs(y) <= math.pi * EARTH_RADIUS_M
    if not is_projected or abs(math.hypot(x, y, z) / EARTH_RADIUS_M - 1) < MAX_GEOCENTRIC_DEVIATION:
        return TAKEN_AS_METRES
    factor = math.cosh(y / EARTH_RADIUS_M)
    return f"{TAKEN_AS_METRES}; in Web Mercator the scale would be {factor:.3g} times too large"


def position_evidence(
    kind: str, name: str, centres: FloatArray, metres: FloatArray, accuracy_m: float | None, up: Up | None
) -> tuple[ScaleEvidence, ...]:
    """Return the scale from camera centres to positions, or the reason for its absence.

    Parameters
    ----------
    kind, name : str
        Fields of the evidence.
    centres : (n, 3) ndarray of float
        Camera centres in scene units.
    metres : (n, 3) ndarray of float
        Their positions in metres.
    accuracy_m : float or None
        Error in metres of the positions of a receiver, which drift along the path: the length of the path is then as
        wrong as its ends, for any number of positions. None for a table, whose errors are independent.
    up : Up or None
        Vertical of the scene if the third coordinate of the positions is the height, else None.
    """
    alignment = align(centres, metres)
    if alignment is None:
        return skipped_evidence(kind, name, "the positions or the cameras are at one place")
    if alignment.extent < MIN_EXTENT_RESIDUALS * alignment.residual:
        extent = f"{alignment.extent:.2g} m with an error of {alignment.residual:.2g} m"
        return skipped_evidence(kind, name, f"the path is too short for its positions: {extent}")
    damage = _distortion(alignment, centres, metres, up, accuracy_m)
    if damage is not None:
        cause = "latitude and longitude exchanged, a lost sign, or not in degrees?"
        return skipped_evidence(kind, name, f"{damage}: {cause}")
    sd = math.hypot(alignment.sd_log, MIN_LOG_SD)
    if accuracy_m is not None:
        drift = END_TO_END * math.hypot(alignment.residual, DRIFT_FRACTION * accuracy_m) / alignment.extent
        sd = math.hypot(sd, drift)
    if sd > MAX_LOG_SD:
        extent = f"{alignment.extent:.2g} m with receivers good to {accuracy_m or 0:.2g} m"
        return skipped_evidence(kind, name, f"the path is too short for its positions: {extent}")
    return (ScaleEvidence(kind, name, alignment.scale, sd),)


def _distortion(
    alignment: Alignment, centres: FloatArray, metres: FloatArray, up: Up | None, accuracy_m: float | None
) -> str | None:
    """Return the reason why positions (n, 3) are no similar copy of centres (n, 3), or None.

    A robust similarity fits a part of a stretched path well, so a stretch is also searched in all positions. A level
    path is equal to its mirror image rotated by 180 degrees, whose vertical points down.
    """
    of_all = least_squares(centres, metres, np.ones(len(centres), dtype=bool))
    for fit in (alignment, of_all):
        stretch = None if fit is None else stretch_ratio(centres[fit.inliers], metres[fit.inliers], fit.residual)
        if stretch is not None:
            return f"the positions are stretched by {stretch:.2f} in one direction against the cameras"
    if up is None or not up.method.startswith(OBSERVED_METHODS):
        return None
    tilt = float(np.degrees(np.arccos(np.clip((alignment.rotation @ up.vector)[2], -1, 1))))
    sigma_deg = tilt_sigma(centres[alignment.inliers], alignment, accuracy_m)
    limit = MAX_UP_ERROR_DEG + MAX_TILT_SIGMAS * math.hypot(up.sigma_deg, sigma_deg)
    return f"their up is {tilt:.0f}° from that of the cameras" if tilt > limit else None


def tilt_sigma(centres: FloatArray, alignment: Alignment, accuracy_m: float | None) -> float:
    """Return the standard deviation in degrees of the vertical after the alignment of centres (n, 3) with positions.

    A rotation w moves a position x by w x x, so its information is sum(|x|^2 I - x x') / error^2. The positions x are
    those of the cameras, in metres: on a straight walk, deviations of the positions from the line are noise, and any
    rotation about the line fits. The errors of a receiver drift, so many positions are one independent observation.
    """
    x = alignment.scale * (centres - centres.mean(axis=0)) @ alignment.rotation.T
    information = float((x**2).sum()) * np.eye(3) - x.T @ x
    error2 = alignment.residual**2
    if accuracy_m is not None:
        error2 = len(x) * math.hypot(alignment.residual, DRIFT_FRACTION * accuracy_m) ** 2
    covariance = np.linalg.pinv(information, rcond=1e-9, hermitian=True)
    horizontal = float(np.trace(covariance[:2, :2])) * error2
    return math.degrees(math.sqrt(max(horizontal, 0.0)))


def stretch_ratio(centres: FloatArray, metres: FloatArray, residual: float) -> float | None:
    """Return the ratio of the largest to the smallest scale from directions of the path (n, 3) to positions (n, 3).

    None if the ratio is at most `MIN_STRETCH`, if a linear map leaves about the same `residual` (in metres, per
    coordinate) as the similarity, or if the path is straight or has too few positions.
    """
    source, target = centres - centres.mean(axis=0), metres - metres.mean(axis=0)
    _, extents, axes = np.linalg.svd(source, full_matrices=False)
    is_wide = extents > MIN_DIRECTION_EXTENT * extents[0]
    freedom = 3 * len(source) - 3 * int(is_wide.sum()) - 3
    if is_wide.sum() < 2 or freedom < len(source):
        return None
    along = source @ axes[is_wide].T
    linear, *_ = np.linalg.lstsq(along, target, rcond=None)
    linear_residual = math.sqrt(float(((target - along @ linear) ** 2).sum()) / freedom)
    scales = np.linalg.svd(linear, compute_uv=False)
    ratio = float(scales[0] / max(scales[-1], 1e-12))
    return ratio if ratio > MIN_STRETCH and linear_residual < MAX_STRETCHED_RESIDUAL * residual else None


def east_north_up(degrees: FloatArray) -> FloatArray:
    """Return east, north and up (n, 3) in metres around the first of latitude, longitude (degrees) and altitude (n, 3).

    The ellipsoid is WGS 84, and altitudes are in metres.
    """
    from estimator.reconstructions.pycolmap_library import pycolmap

    latitude, longitude, altitude = degrees[0]
    return np.asarray(pycolmap.GPSTransform().ellipsoid_to_enu(degrees, latitude, longitude, altitude))


def _with_place(rows: tuple[ScaleEvidence, ...], degrees: FloatArray) -> tuple[ScaleEvidence, ...]:
    """Return evidence with the country or region of its latitudes and longitudes (n, 2 or 3), in degrees."""
    latitude, longitude = np.median(degrees[:, :2], axis=0).tolist()
    return tuple(replace(row, place=place_at(latitude, longitude)) for row in rows)


def _table_positions(file: Path, scene: Scene) -> tuple[dict[int, list[float]], bool]:
    """Read the positions of the views by their index, and whether they are in degrees; otherwise they are in metres."""
    rows = ViewLookup(scene)
    fields, records = csv_rows(file)
    names = {field.strip().lower() for field in fields}
    columns = next((kind for kind in (("lat", "lon", "alt"), ("x", "y", "z")) if {"name", *kind} <= names), None)
    if columns is None:
        expected = "columns name, lat, lon, alt, or name, x, y, z"
        raise InputError.at(file, "header", expected, Unquoted(", ".join(sorted(names)) or "none"))
    values: dict[int, list[float]] = {}
    for number, record in records:
        cells = {(key or "").strip().lower(): value for key, value in record.items()}
        row = rows.row(str(cells["name"] or "").strip())
        if row is not None:
            with in_file(file), at_field(f"line {number}"):
                values[row] = finite_numbers(
                    (cells[column] for column in columns), "three numbers after the name", MAX_COORDINATE
                )
                if columns[0] == "lat" and abs(values[row][0]) > POLE_DEG:
                    raise FieldError("lat", "degrees from -90 to 90; is it the longitude?", values[row][0])
    return values, columns[0] == "lat"


def exif_positions(scene: Scene, images: Path | None) -> tuple[dict[int, list[float]], float]:
    """Read latitude, longitude (degrees) and altitude (metres) of the views by their index, and the median error."""
    folders, values, accuracies = image_folders(scene, images), dict[int, list[float]](), list[float]()
    for row, view in enumerate(scene.views):
        file = image_file(folders, view)
        header = None if file is None else image_header(file)
        if header is None:
            continue
        with suppress(ArithmeticError, TypeError, ValueError):  # a damaged tag is no position
            position, accuracy = exif_position(header.gps_tags), exif_accuracy(header.gps_tags)
            if position is not None:
                values[row] = position
                accuracies.append(accuracy)
    return values, float(np.median(accuracies)) if accuracies else TYPICAL_ACCURACY_M


def _timed(scene: Scene, images: Path | None, positions: Mapping[int, FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Return the times (k,) by EXIF and the positions (k, 3) of the images with a time, in the order of time."""
    folders = image_folders(scene, images)
    files = {row: image_file(folders, scene.views[row]) for row in positions}
    headers = {row: image_header(file) for row, file in files.items() if file is not None}
    timed = [(header.taken_s, *positions[row]) for row, header in headers.items() if header is not None]
    table = np.array(sorted(row for row in timed if row[0] is not None), dtype=np.float64).reshape(-1, 4)
    return table[:, 0], table[:, 1:]


def exif_accuracy(tags: Mapping[int, Any]) -> float:
    """Return the error of a position in metres, from the stated error or dilution of precision."""
    for tag, metres in ((POSITIONING_ERROR, 1.0), (DILUTION, METRES_PER_DILUTION)):
        value = float(tags.get(tag, 0.0)) * metres
        if 0 < value < MAX_COORDINATE:
            return value
    return TYPICAL_ACCURACY_M


def exif_position(tags: Mapping[int, Any]) -> list[float] | None:
    """Return latitude and longitude in degrees and altitude in metres; None without the first two."""
    if LAT not in tags or LON not in tags:
        return None
    lat, lon = (sum(float(part) / 60**place for place, part in enumerate(tags[tag])) for tag in (LAT, LON))
    below = tags.get(ALT_REF) in (1, b"\x01")
    altitude = float(tags.get(ALT, 0.0)) * (-1 if below else 1)
    numbers = [-lat if tags.get(LAT_REF) == "S" else lat, -lon if tags.get(LON_REF) == "W" else lon, altitude]
    return numbers if all(abs(number) < MAX_COORDINATE for number in numbers) else None

"""Positions of the cameras in metres: GPS in the pictures (EXIF) or beside the video, or a table."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from estimator.evidence.alignment import Alignment, align, least_squares
from estimator.evidence.source import CameraPath, silent
from estimator.geometry.vertical import MAX_TILT_SIGMAS, MAX_UP_ERROR_DEG, OBSERVED_METHODS
from estimator.instances.view_matching import ViewLookup, image_file, image_folders
from estimator.records.objects import Up
from estimator.records.result import ScaleEvidence
from estimator.records.scene import Scene
from estimator.telemetry.records import Positions
from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, InputError, Unquoted, at_field, in_file
from metric_base.parsing import csv_rows

if TYPE_CHECKING:
    from estimator.records.objects import Measurements

KIND, VIDEO_KIND = "gps", "gps_video"
#: Frames further apart than this leave a gap in the path of a video.
LONGEST_GAP_S = 1.0
#: Worse than this, natural log, positions say nothing that the objects do not.
MOST_SD = 0.2
#: Metres (or degrees) beyond which no position on the earth is, whatever its origin.
FARTHEST_M = 1e9

POLE_DEG = 90.0

#: Positions are no similar copy of the cameras when a stretch of this ratio between two directions of the path leaves
#: less than this share of the residual. The path must reach this share of its extent in both directions.
STRETCH, STRETCHED_SHARE, LEAST_SPREAD = 1.06, 0.5, 0.1

#: WGS 84: semi-major axis in metres, first eccentricity squared.
AXIS_M, ECCENTRICITY_2 = 6378137.0, 6.69437999014e-3

#: EXIF: the tag of the GPS directory, and its tags of latitude, longitude and altitude with their references.
EXIF_GPS, LAT_REF, LAT, LON_REF, LON, ALT_REF, ALT = 0x8825, 1, 2, 3, 4, 5, 6
#: EXIF: dilution of precision, and the horizontal error in metres.
DILUTION, POSITIONING_ERROR = 0x0B, 0x1F
#: Metres of one position per unit of dilution, and where neither is stated, as telephones under open sky have it.
METRES_PER_DILUTION, USUAL_ACCURACY_M = 2.5, 5.0
#: Share of a receiver's error that changes along one recording, the rest moves the whole path.
DRIFT_SHARE = 0.1
#: Error of the length of a path by errors at its ends, over its root mean square extent: sqrt(2) / sqrt(12).
END_TO_END = 0.41
#: Pictures that are looked at for GPS when nobody asked for it.
PROBED = 5

#: Fewer positions align with anything.
LEAST_POSITIONS = 4

#: A path shorter than this many residuals says nothing about the scale.
LEAST_EXTENT = 3.0

#: Receivers drift together over a path: no scale from GPS is better than this, natural log.
LEAST_SD = 0.01


@dataclass(frozen=True, slots=True)
class Gps:
    """Camera positions of `source`: "exif", or a CSV file with a header.

    Its columns are `name`, and `lat`, `lon`, `alt` in degrees and metres (WGS 84), or `x`, `y`, `z` in metres.
    images : the folder of the pictures, if it is not `images` beside or above the model.
    """

    source: str | Path
    images: Path | None = None

    def observe(self, scene: Scene, measurements: Measurements) -> tuple[ScaleEvidence, ...]:
        """The scale of the similarity from the cameras to their positions; silent where the path is too short."""
        if self.source == "exif":
            (positions, accuracy), geodetic = _exif_positions(scene, self.images), True
            name = "exif"
        else:
            (positions, geodetic), accuracy = _table_positions(Path(self.source), scene), None
            name = Path(self.source).name
        if len(positions) < LEAST_POSITIONS:
            return silent(KIND, name, f"{len(positions)} views have a position, {LEAST_POSITIONS} needed")
        centres = np.array([scene.views[row].centre for row in positions])
        up = measurements.up if geodetic else None
        return _aligned_scale(KIND, name, centres, np.array(list(positions.values())), accuracy, up)


@dataclass(frozen=True, slots=True, eq=False)
class VideoGps:
    """The positions that a video, or a log of it, states over time, and the path of its camera; name : of the file."""

    positions: Positions
    path: CameraPath
    name: str

    def observe(self, scene: Scene, measurements: Measurements) -> tuple[ScaleEvidence, ...]:  # noqa: ARG002
        """The scale of the similarity from the path to the positions; silent where the path is too short."""
        centres, rows = self.path.at(self.positions.times_s, LONGEST_GAP_S)
        if len(rows) < LEAST_POSITIONS:
            return silent(VIDEO_KIND, self.name, f"{len(rows)} positions along the path, {LEAST_POSITIONS} needed")
        places = self.positions.positions[rows]
        metres = local_metres(places) if self.positions.geodetic else places
        up = measurements.up if self.positions.geodetic else None
        accuracy = self.positions.accuracy_m or USUAL_ACCURACY_M
        return _aligned_scale(VIDEO_KIND, self.name, centres, metres, accuracy, up)


def pictures_have_gps(scene: Scene, images: Path | None) -> bool:
    """Whether some of a few pictures of the scene state where they were taken."""
    some = scene.views[:: max(1, len(scene.views) // PROBED)][:PROBED]
    return len(_exif_positions(replace(scene, views=tuple(some)), images)[0]) > 0


def _aligned_scale(
    kind: str, name: str, centres: FloatArray, metres: FloatArray, accuracy_m: float | None, up: Up | None
) -> tuple[ScaleEvidence, ...]:
    """The scale from centres (n, 3) to positions (n, 3) in metres, or why there is none.

    up : of the scene, where the third coordinate of the positions is known to be the height; accuracy_m : of a
    receiver's position, None for a table, whose errors are independent. A receiver's drift along the path, and then its
    length is as wrong as its ends, however many positions there are.
    """
    alignment = align(centres, metres)
    if alignment is None:
        return silent(kind, name, "the positions or the cameras are at one place")
    if alignment.extent < LEAST_EXTENT * alignment.residual:
        extent = f"{alignment.extent:.2g} m with an error of {alignment.residual:.2g} m"
        return silent(kind, name, f"the path is too short for its positions: {extent}")
    if 2 * np.count_nonzero(alignment.inliers) <= len(metres):
        return silent(kind, name, "most positions contradict the reconstruction")
    damage = _damage(alignment, centres, metres, up, accuracy_m)
    if damage is not None:
        return silent(kind, name, f"{damage}: latitude and longitude exchanged, a lost sign, or not in degrees?")
    sd = math.hypot(alignment.sd_log, LEAST_SD)
    if accuracy_m is not None:
        drift = END_TO_END * math.hypot(alignment.residual, DRIFT_SHARE * accuracy_m) / alignment.extent
        sd = math.hypot(sd, drift)
    if sd > MOST_SD:
        extent = f"{alignment.extent:.2g} m with receivers good to {accuracy_m or 0:.2g} m"
        return silent(kind, name, f"the path is too short for its positions: {extent}")
    return (ScaleEvidence(kind, name, alignment.scale, sd),)


def _damage(
    alignment: Alignment, centres: FloatArray, metres: FloatArray, up: Up | None, accuracy_m: float | None
) -> str | None:
    """What shows that positions (n, 3) are no similar copy of centres (n, 3), though a similarity fits most of them.

    A robust similarity fits a part of a stretched path well, so that a stretch is looked for in all positions too. A
    level path without its third direction is also its mirror image turned over, and then up is down.
    """
    whole = least_squares(centres, metres, np.ones(len(centres), dtype=bool))
    for fit in (alignment, whole):
        stretch = None if fit is None else _stretch(centres[fit.inliers], metres[fit.inliers], fit.residual)
        if stretch is not None:
            return f"the positions are stretched by {stretch:.2f} in one direction against the cameras"
    if up is None or not up.method.startswith(OBSERVED_METHODS):
        return None
    tilt = float(np.degrees(np.arccos(np.clip((alignment.rotation @ up.vector)[2], -1, 1))))
    sigma_deg = _tilt_sigma(centres[alignment.inliers], alignment, accuracy_m)
    limit = MAX_UP_ERROR_DEG + MAX_TILT_SIGMAS * math.hypot(up.sigma_deg, sigma_deg)
    return f"their up is {tilt:.0f}° from that of the cameras" if tilt > limit else None


def _tilt_sigma(centres: FloatArray, alignment: Alignment, accuracy_m: float | None) -> float:
    """Standard deviation in degrees of the up of the positions, by which the cameras (n, 3) are turned onto them.

    Equation: a turn w moves a position x by w x x, so that its information is sum(|x|^2 I - x x') / error^2. The x are
    those of the cameras, in metres: on a straight walk the positions beside the line are noise, and about the line any
    turn fits. A receiver's errors drift together, so that many positions count as one.
    """
    own = alignment.scale * (centres - centres.mean(axis=0)) @ alignment.rotation.T
    information = float((own**2).sum()) * np.eye(3) - own.T @ own
    error2 = alignment.residual**2
    if accuracy_m is not None:
        error2 = len(own) * math.hypot(alignment.residual, DRIFT_SHARE * accuracy_m) ** 2
    turns = np.linalg.pinv(information, rcond=1e-9, hermitian=True)
    about_level = float(np.trace(turns[:2, :2])) * error2
    return math.degrees(math.sqrt(max(about_level, 0.0)))


def _stretch(centres: FloatArray, metres: FloatArray, residual: float) -> float | None:
    """How much more the positions (n, 3) are drawn out in one direction of the path (n, 3) than in another.

    None where a linear map that may stretch leaves about as much `residual` (metres of a coordinate) as the similarity.
    """
    own, aim = centres - centres.mean(axis=0), metres - metres.mean(axis=0)
    _, spread, axes = np.linalg.svd(own, full_matrices=False)
    wide = spread > LEAST_SPREAD * spread[0]
    count, free = len(own), 3 * len(own) - 3 * int(wide.sum()) - 3
    if wide.sum() < 2 or free < count:
        return None
    along = own @ axes[wide].T
    linear, *_ = np.linalg.lstsq(along, aim, rcond=None)
    left = math.sqrt(float(((aim - along @ linear) ** 2).sum()) / free)
    sizes = np.linalg.svd(linear, compute_uv=False)
    ratio = float(sizes[0] / max(sizes[-1], 1e-12))
    return ratio if ratio > STRETCH and left < STRETCHED_SHARE * residual else None


def local_metres(degrees: FloatArray) -> FloatArray:
    """East, north, up (n, 3) in metres about the first of latitude, longitude (degrees), altitude (metres), (n, 3).

    With N the radius of curvature in the prime vertical and M in the meridian: east = (N + h) cos(lat) d lon,
    north = (M + h) d lat. Exact to 1e-4 over ten kilometres.
    """
    lat, lon = np.radians(degrees[:, 0]), np.radians(degrees[:, 1])
    height = degrees[:, 2]
    bulge = 1 - ECCENTRICITY_2 * math.sin(lat[0]) ** 2
    prime, meridian = AXIS_M / math.sqrt(bulge), AXIS_M * (1 - ECCENTRICITY_2) / bulge**1.5
    east = (prime + height[0]) * math.cos(lat[0]) * np.remainder(lon - lon[0] + np.pi, 2 * np.pi)
    east -= (prime + height[0]) * math.cos(lat[0]) * np.pi
    return np.column_stack([east, (meridian + height[0]) * (lat - lat[0]), height - height[0]])


def _table_positions(file: Path, scene: Scene) -> tuple[dict[int, FloatArray], bool]:
    """Metres (3,) by row of the view, and whether the third of them is a height."""
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
                values[row] = _numbers([cells[column] for column in columns])
                if columns[0] == "lat" and abs(values[row][0]) > POLE_DEG:
                    raise FieldError("lat", "degrees from -90 to 90; is it the longitude?", values[row][0])
    geodetic = columns[0] == "lat"
    return _in_metres(values, geodetic), geodetic


def _numbers(cells: Iterable[Any]) -> list[float]:
    """Three finite numbers; FieldError where they are not."""
    try:
        numbers = [float(cell) for cell in cells]
    except (TypeError, ValueError):
        raise FieldError("", "three numbers after the name", list(cells)) from None
    if not all(abs(number) < FARTHEST_M for number in numbers):
        raise FieldError("", f"finite numbers below {FARTHEST_M:g}", numbers)
    return numbers


def _exif_positions(scene: Scene, images: Path | None) -> tuple[dict[int, FloatArray], float]:
    """Metres (3,) by row of the view whose picture has GPS, and the median accuracy that the pictures state."""
    from PIL import Image

    folders, values, accuracies = image_folders(scene, images), dict[int, list[float]](), list[float]()
    for row, view in enumerate(scene.views):
        file = image_file(folders, view)
        if file is None:
            continue
        try:
            with warnings.catch_warnings(action="ignore"), Image.open(file) as picture:
                tags = picture.getexif().get_ifd(EXIF_GPS)
                position, accuracy = _exif_degrees(tags), _exif_accuracy(tags)
        except (OSError, ValueError, ZeroDivisionError, TypeError):
            continue  # a picture without readable EXIF has no position
        if position is not None:
            values[row] = position
            accuracies.append(accuracy)
    return _in_metres(values, geodetic=True), float(np.median(accuracies)) if accuracies else USUAL_ACCURACY_M


def _exif_accuracy(tags: Mapping[int, Any]) -> float:
    """Metres of a position, as its error or dilution of precision state it."""
    for tag, metres in ((POSITIONING_ERROR, 1.0), (DILUTION, METRES_PER_DILUTION)):
        value = float(tags.get(tag, 0.0)) * metres
        if 0 < value < FARTHEST_M:
            return value
    return USUAL_ACCURACY_M


def _exif_degrees(tags: Mapping[int, Any]) -> list[float] | None:
    """Latitude, longitude in degrees, altitude in metres; None without the first two."""
    if LAT not in tags or LON not in tags:
        return None
    lat, lon = (sum(float(part) / 60**place for place, part in enumerate(tags[tag])) for tag in (LAT, LON))
    below = tags.get(ALT_REF) in (1, b"\x01")
    altitude = float(tags.get(ALT, 0.0)) * (-1 if below else 1)
    numbers = [-lat if tags.get(LAT_REF) == "S" else lat, -lon if tags.get(LON_REF) == "W" else lon, altitude]
    return numbers if all(abs(number) < FARTHEST_M for number in numbers) else None


def _in_metres(values: Mapping[int, list[float]], geodetic: bool) -> dict[int, FloatArray]:
    """Positions (3,) in metres by view, of degrees and metres if `geodetic` (an east-north-up frame)."""
    if not values:
        return {}
    table = np.array(list(values.values()))
    return dict(zip(values, local_metres(table) if geodetic else table, strict=True))

"""Positions of the cameras in metres: GPS in the pictures (EXIF), or a table."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from estimator.evidence.alignment import align
from estimator.evidence.source import silent
from estimator.instances.crops import ViewNames
from estimator.instances.image_files import image_file, image_folders
from estimator.reconstructions.csv_records import csv_records
from estimator.records.scale_evidence import ScaleEvidence
from estimator.records.scene import Scene
from metric_base.arrays import FloatArray
from metric_base.errors import FieldError, InputError, Unquoted, at_field, in_file

if TYPE_CHECKING:
    from estimator.geometry.measurement import Measurements

__all__ = ["Gps", "local_metres"]

KIND = "gps"
#: Metres (or degrees) beyond which no position on the earth is, whatever its origin.
FARTHEST_M = 1e9

#: WGS 84: semi-major axis in metres, first eccentricity squared.
AXIS_M, ECCENTRICITY_2 = 6378137.0, 6.69437999014e-3

#: EXIF: the tag of the GPS directory, and its tags of latitude, longitude and altitude with their references.
EXIF_GPS, LAT_REF, LAT, LON_REF, LON, ALT_REF, ALT = 0x8825, 1, 2, 3, 4, 5, 6

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

    def observe(self, scene: Scene, measurements: Measurements) -> tuple[ScaleEvidence, ...]:  # noqa: ARG002
        """The scale of the similarity from the cameras to their positions; silent where the path is too short."""
        name = str(self.source) if self.source == "exif" else Path(self.source).name
        positions = (
            _exif_positions(scene, self.images) if self.source == "exif" else _table_positions(Path(self.source), scene)
        )
        if len(positions) < LEAST_POSITIONS:
            return silent(KIND, name, f"{len(positions)} views have a position, {LEAST_POSITIONS} needed")
        centres = np.array([scene.views[row].centre for row in positions])
        alignment = align(centres, np.array(list(positions.values())))
        if alignment is None:
            return silent(KIND, name, "the positions or the cameras are at one place")
        if alignment.extent < LEAST_EXTENT * alignment.residual:
            extent = f"{alignment.extent:.2g} m with an error of {alignment.residual:.2g} m"
            return silent(KIND, name, f"the path is too short for its positions: {extent}")
        if 2 * np.count_nonzero(alignment.inliers) <= len(positions):
            return silent(KIND, name, "most positions contradict the reconstruction")
        return (ScaleEvidence(KIND, name, alignment.scale, math.hypot(alignment.sd_log, LEAST_SD)),)


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


def _table_positions(file: Path, scene: Scene) -> dict[int, FloatArray]:
    """Metres (3,) by row of the view."""
    rows = ViewNames(scene)
    fields, records = csv_records(file)
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
    return _in_metres(values, geodetic=columns[0] == "lat")


def _numbers(cells: Iterable[Any]) -> list[float]:
    """Three finite numbers; FieldError where they are not."""
    try:
        numbers = [float(cell) for cell in cells]
    except (TypeError, ValueError):
        raise FieldError("", "three numbers after the name", list(cells)) from None
    if not all(abs(number) < FARTHEST_M for number in numbers):
        raise FieldError("", f"finite numbers below {FARTHEST_M:g}", numbers)
    return numbers


def _exif_positions(scene: Scene, images: Path | None) -> dict[int, FloatArray]:
    """Metres (3,) by row of the view whose picture has GPS."""
    from PIL import Image

    folders, values = image_folders(scene, images), dict[int, list[float]]()
    for row, view in enumerate(scene.views):
        file = image_file(folders, view)
        if file is None:
            continue
        try:
            with warnings.catch_warnings(action="ignore"), Image.open(file) as picture:
                position = _exif_degrees(picture.getexif().get_ifd(EXIF_GPS))
        except (OSError, ValueError, ZeroDivisionError, TypeError):
            continue  # a picture without readable EXIF has no position
        if position is not None:
            values[row] = position
    return _in_metres(values, geodetic=True)


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

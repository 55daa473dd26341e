"""Read OpenSfM datasets as a scene: `reconstruction.json` and `tracks.csv` (opensfm/io.py and opensfm/features.py).

Coordinates of OpenSfM are relative to the centre of the image, in units of its longer side s: (u, v) is the pixel
(s u + width / 2, s v + height / 2), with the centre of the upper left pixel at (0.5, 0.5) as in COLMAP. The rotation of
a shot is an angle-axis vector from world to camera. `tracks.csv` has one tab-separated observation per line, in
versions 0 to 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import csv
from scipy.spatial.transform import Rotation

from estimator.projection.cameras import make_camera
from estimator.records.scene import MAX_COORDINATE, Camera, Scene, View, observed_views
from metric_base.arrays import FloatArray, IntArray
from metric_base.errors import FieldError, InputError, at_field, damage_as_field_error, expect, in_file
from metric_base.input_files import read_bytes, read_json
from metric_base.parsing import json_array, json_object, matrix_of, number_of

#: Bytes at the start of `tracks.csv` that contain the version and the start of the first observation.
_FIRST_BYTES = 1000
_VERSION = b"OPENSFM_TRACKS_VERSION"
#: Columns at the start of all versions; the others (scale, colour, segmentation) are not used.
_COLUMNS = {"f0": pa.dictionary(pa.int32(), pa.string()), "f1": pa.string(), "f3": pa.float64(), "f4": pa.float64()}
RECONSTRUCTION = "reconstruction.json"
TRACKS = "tracks.csv"
#: COLMAP model of each projection of OpenSfM, and the source of each of its parameters: `*` marks lengths in units of
#: the longer side, `+` the principal point, and "" a zero.
PROJECTIONS: dict[str, tuple[str, tuple[str, ...]]] = {
    "perspective": ("RADIAL", ("*focal", "+x", "+y", "k1", "k2")),
    "fisheye": ("RADIAL_FISHEYE", ("*focal", "+x", "+y", "k1", "k2")),
    "simple_radial": ("OPENCV", ("*focal_x", "*focal_y", "+c_x", "+c_y", "k1", "", "", "")),
    "radial": ("OPENCV", ("*focal_x", "*focal_y", "+c_x", "+c_y", "k1", "k2", "", "")),
    "brown": ("FULL_OPENCV", ("*focal_x", "*focal_y", "+c_x", "+c_y", "k1", "k2", "p1", "p2", "k3", "", "", "")),
    "fisheye_opencv": ("OPENCV_FISHEYE", ("*focal_x", "*focal_y", "+c_x", "+c_y", "k1", "k2", "k3", "k4")),
}
_FOCAL_NAMES = {"*focal", "*focal_x", "*focal_y"}


def read_observations(
    file: Path, images: Sequence[str], tracks: Sequence[str]
) -> tuple[IntArray, IntArray, FloatArray]:
    """Read the observations of `tracks.csv`.

    Parameters
    ----------
    file : Path
    images, tracks : sequence of str
        Names of the images and of the points; other observations are ignored.

    Returns
    -------
    image_rows, track_rows : (m,) ndarray of int
        Indices in `images` and `tracks`.
    positions : (m, 2) ndarray of float
        Normalised coordinates.

    Raises
    ------
    InputError
        The file has another format, or a position is not finite.
    """
    head = read_bytes(file, most=_FIRST_BYTES)
    has_version = head.startswith(_VERSION)
    if has_version and not head.partition(b"\n")[2].strip():
        raise InputError.at(file, "observations", "at least one line", 0)
    expected = "tab-separated image, track, feature, x, y, ..."
    damage = damage_as_field_error(expected, (pa.ArrowInvalid, KeyError), str, field="observations")
    with in_file(file), damage:  # without threads, the reader always reports the same error
        table = csv.read_csv(
            str(file),
            read_options=csv.ReadOptions(autogenerate_column_names=True, skip_rows=int(has_version), use_threads=False),
            parse_options=csv.ParseOptions(delimiter="\t", quote_char=False),
            convert_options=csv.ConvertOptions(column_types=_COLUMNS, include_columns=list(_COLUMNS), null_values=[]),
        )
    image_rows = _rows_in(table["f0"], images)
    track_rows = _rows_in(table["f1"], tracks)
    is_known = (image_rows >= 0) & (track_rows >= 0)
    positions = np.column_stack([table[column].to_numpy()[is_known] for column in ("f3", "f4")])
    is_valid = np.abs(positions) < MAX_COORDINATE  # also False for NaN
    if not is_valid.all():
        row = int((~is_valid).any(axis=1).argmax())
        expected = f"finite numbers below {MAX_COORDINATE:g}"
        raise InputError.at(file, "position", expected, positions[row].tolist())
    return image_rows[is_known], track_rows[is_known], positions


def _rows_in(column: pa.ChunkedArray, names: Sequence[str]) -> IntArray:
    """Return the index (m,) of each value of a column in `names`, or -1."""
    if pa.types.is_dictionary(column.type):
        encoded = column.combine_chunks()
        rows = _rows_in(pa.chunked_array([encoded.dictionary]), names)
        return np.asarray(rows[encoded.indices.to_numpy()])
    rows = pc.index_in(column, value_set=pa.array(names, pa.string()))
    return np.asarray(pc.fill_null(rows, -1).to_numpy(), dtype=np.int64)


def read_opensfm(folder: Path) -> Scene:
    """Read the largest reconstruction of a dataset.

    Parameters
    ----------
    folder : Path
        Folder of `reconstruction.json`, and optionally of `tracks.csv` with the observations.

    Returns
    -------
    Scene
        Its warnings mention other reconstructions, and missing observations.

    Raises
    ------
    InputError
        A file is damaged.
    """
    file = folder / RECONSTRUCTION
    document, warnings = largest_reconstruction(file)
    with in_file(file):
        cameras = {}
        for name, entry in json_object(document.get("cameras"), "cameras").items():
            with at_field(f"camera {name!r}"):
                cameras[name] = _camera(json_object(entry, ""))
        names, points = _points(json_object(document.get("points"), "points"))
        shots = json_object(document.get("shots"), "shots")
        expect(shots, "shots", "at least one", 0)
        views: list[View] = []
        for name, entry in shots.items():
            with at_field(f"shot {name!r}"):
                shot = json_object(entry, "")
                camera = shot.get("camera")
                if not isinstance(camera, str) or camera not in cameras:
                    raise FieldError("camera", "a camera of the reconstruction", camera)
                rotation, translation = (
                    matrix_of(shot.get(part), (3,), part, MAX_COORDINATE) for part in ("rotation", "translation")
                )
            matrix = Rotation.from_rotvec(rotation).as_matrix()
            views.append(View(name, cameras[camera], matrix, translation, np.empty((0, 2)), np.empty(0, np.int64)))
    tracks = folder / TRACKS
    if tracks.is_file():
        rows, point_rows, normalised = read_observations(tracks, [view.name for view in views], names)
        sizes = np.array([(view.camera.width, view.camera.height) for view in views], dtype=np.float64)[rows]
        observed = observed_views(views, rows, point_rows, normalised * sizes.max(axis=1, keepdims=True) + sizes / 2)
    else:
        observed = tuple(views)
        warnings = (*warnings, f"{folder}: no {TRACKS}")
    return Scene(folder, "opensfm", observed, points, warnings=warnings, model_path=folder)


def largest_reconstruction(file: Path) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return the reconstruction with the most shots, then points, and a warning if the file contains several."""
    with in_file(file):
        entries = json_array(read_json(file))
        expect(entries, "document", "at least one reconstruction", 0)
        documents = [json_object(entry, f"reconstruction {row}") for row, entry in enumerate(entries)]
    sizes = [(_length(document.get("shots")), _length(document.get("points"))) for document in documents]
    row = max(range(len(documents)), key=sizes.__getitem__)
    if len(documents) == 1:
        return documents[0], ()
    largest_sizes = ", ".join(str(shots) for shots, _ in sizes[:10])
    return documents[row], (f"{file}: {len(documents)} reconstructions of {largest_sizes} shots, the largest is used",)


def _length(value: object) -> int:
    return len(value) if isinstance(value, dict) else 0


def _camera(document: dict[str, Any]) -> Camera:
    projection = document.get("projection_type", "perspective")
    expected = f"one of {', '.join(PROJECTIONS)} (cut a panorama into perspective views first)"
    expect(isinstance(projection, str) and projection in PROJECTIONS, "projection_type", expected, projection)
    size = []
    for side in ("width", "height"):
        pixels = document.get(side)
        if isinstance(pixels, float) and pixels.is_integer():
            pixels = int(pixels)
        if not isinstance(pixels, int) or isinstance(pixels, bool):
            raise FieldError(side, "a whole number of pixels", pixels)
        size.append(pixels)
    width, height = size
    model, sources = PROJECTIONS[projection]
    longer, half = max(width, height), {"x": width / 2, "y": height / 2}
    params = []
    for source in sources:
        name = source.lstrip("*+")
        value = 0.0 if name == "" else number_of(document, name, None if source in _FOCAL_NAMES else 0.0)
        scaled = value * longer if source[:1] in {"*", "+"} else value
        params.append(scaled + half[name[-1]] if source.startswith("+") else scaled)
    return make_camera(model, (width, height), params)


def _points(documents: dict[str, Any]) -> tuple[list[str], FloatArray]:
    """Return names and positions (n, 3) of the points; FieldError for the first invalid one."""
    positions = [json_object(document, f"point {name!r}").get("coordinates") for name, document in documents.items()]
    try:
        return list(documents), matrix_of(positions, (len(positions), 3), "points", MAX_COORDINATE)
    except FieldError:
        for name, position in zip(documents, positions, strict=True):
            matrix_of(position, (3,), f"point {name!r} coordinates", MAX_COORDINATE)
        raise

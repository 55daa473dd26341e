"""A scene's own files again at metric scale: every length in them times the scale, everything else untouched.

The model, the dense cloud and COLMAP's transform file are written to a temporary folder beside the target, which
takes its name only when all is there.

COLMAP's files with every length scaled in place: image, frame and sensor translations, and points.
"""

from __future__ import annotations

import json
import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.reconstructions.colmap import read_colmap
from estimator.reconstructions.colmap_files import image_places, point_places
from estimator.reconstructions.opensfm import RECONSTRUCTION, TRACKS, largest_reconstruction, read_opensfm
from estimator.reconstructions.ply import ply_layout, read_visibility, visibility_bytes
from estimator.records.scene import Camera, Scene
from metric_base.arrays import IntArray
from metric_base.errors import FieldError, InputError, Unquoted, at_field, in_file
from metric_base.files import whole_folder
from metric_base.input_files import read_bytes, read_text
from metric_base.parsing import BinaryReader

_RIG = struct.Struct("<II")  # id, number of sensors
_SENSOR = struct.Struct("<iI")  # type, id
_FLAG = struct.Struct("<B")  # whether a pose follows
_POSE = struct.Struct("<7d")  # quaternion, translation
_FRAME = struct.Struct("<II7dI")  # id, rig id, pose, number of data ids
_DATA = struct.Struct("<iIQ")  # sensor type, sensor id, data id
_ROTATION_BYTES = 4 * 8
_BYTES = 3 * 8
#: Triples scaled at a time, which bounds the memory of the index that gathers them.
_CHUNK = 1 << 16
#: What `colmap model_transformer --transform_path` reads: scale qw qx qy qz tx ty tz.
TRANSFORM = "metric_transform.txt"


def write_scaled_colmap(source: Path, suffix: str, scale: float, target: Path) -> None:
    """The model's files (three, or five with rigs and frames) of one kind, `.bin` or `.txt`, in the folder `target`."""
    shutil.copyfile(source / f"cameras{suffix}", target / f"cameras{suffix}")
    for part in ("images", "points3D", "rigs", "frames"):
        file = source / f"{part}{suffix}"
        if part in {"rigs", "frames"} and not file.is_file():
            continue
        if suffix == ".bin":
            reader = BinaryReader(file)
            (target / file.name).write_bytes(_scaled_bytes(reader.data, _BINARY_PLACES[part](reader), scale))
        else:
            (target / file.name).write_text(_scaled_text(file, part, scale), encoding="utf-8")


def _scaled_bytes(data: bytes, places: IntArray, scale: float) -> bytearray:
    """The bytes with the three doubles at each place (n,) multiplied."""
    scaled = bytearray(data)
    view = np.frombuffer(scaled, dtype=np.uint8)
    for start in range(0, len(places), _CHUNK):
        index = places[start : start + _CHUNK, None] + np.arange(_BYTES)
        view[index] = (view[index].view("<f8") * scale).view(np.uint8)
    return scaled


def _image_translations(reader: BinaryReader) -> IntArray:
    """(n,) bytes at which the translations of the images begin."""
    return np.array(image_places(reader), dtype=np.int64) + 4 + _ROTATION_BYTES


def _point_coordinates(reader: BinaryReader) -> IntArray:
    """(n,) bytes at which the coordinates of the points begin."""
    return point_places(reader) + 8


def _rig_translations(reader: BinaryReader) -> IntArray:
    """(n,) bytes at which the translations of the rigs' sensors begin."""
    places = []
    for rig in range(reader.count("number of rigs", _RIG.size)):
        _, sensors = reader.take(_RIG, f"rig {rig}")
        for sensor in range(sensors):
            reader.take(_SENSOR, f"rig {rig} sensor {sensor}")
            # the first sensor is the reference and has no pose of its own
            if sensor and reader.take(_FLAG, f"rig {rig} sensor {sensor}")[0]:
                places.append(reader.place + _ROTATION_BYTES)
                reader.take(_POSE, f"rig {rig} sensor {sensor} pose")
    return np.array(places, dtype=np.int64)


def _frame_translations(reader: BinaryReader) -> IntArray:
    """(n,) bytes at which the translations of the frames begin."""
    places = []
    for frame in range(reader.count("number of frames", _FRAME.size)):
        places.append(reader.place + 2 * 4 + _ROTATION_BYTES)
        *_, data_ids = reader.take(_FRAME, f"frame {frame}")
        reader.rows(f"V{_DATA.size}", data_ids, f"frame {frame} data ids")
    return np.array(places, dtype=np.int64)


_BINARY_PLACES: dict[str, Callable[[BinaryReader], IntArray]] = {
    "images": _image_translations,
    "points3D": _point_coordinates,
    "rigs": _rig_translations,
    "frames": _frame_translations,
}


def _scaled_text(file: Path, part: str, scale: float) -> str:
    """The file with its lengths multiplied; comments and the lines of keypoints stay as they are."""
    lines, is_keypoints = read_text(file).split("\n"), False
    for row, line in enumerate(lines):
        if line.lstrip().startswith("#") or not (line.strip() or is_keypoints):
            continue
        if not is_keypoints:
            with in_file(file), at_field(f"line {row + 1}"):
                lines[row] = _scaled_line(line, part, scale)
        is_keypoints = part == "images" and not is_keypoints
    return "\n".join(lines)


def _rig_columns(words: list[str]) -> list[int]:
    """Columns of translations: RIG_ID NUM TYPE ID, then TYPE ID HAS_POSE and, with a pose, seven numbers."""
    columns, place = [], 4
    while place + 2 < len(words):
        has_pose = words[place + 2] == "1"
        if has_pose:
            columns += [place + 7, place + 8, place + 9]
        place += 10 if has_pose else 3
    return columns


#: How often a line is split (an image's name may hold blanks), and the columns of its lengths.
_TEXT_PLACES: dict[str, tuple[int, Callable[[list[str]], list[int]]]] = {
    "images": (9, lambda _: [5, 6, 7]),
    "points3D": (4, lambda _: [1, 2, 3]),
    "frames": (9, lambda _: [6, 7, 8]),
    "rigs": (-1, _rig_columns),
}


def _scaled_line(line: str, part: str, scale: float) -> str:
    splits, columns = _TEXT_PLACES[part]
    words = line.split(None, splits)
    try:
        for column in columns(words):
            words[column] = repr(float(words[column]) * scale)
    except (ValueError, IndexError):
        record = Unquoted(" ".join(words))
        raise FieldError("", "a record of COLMAP's text form", record) from None
    return " ".join(words)


def write_rescaled(scene: Scene, scale: float, folder: Path) -> None:
    """The files of `scene` in a new `folder`, laid out as in the original, at `scale` metres per scene unit.

    InputError where the folder exists, the scene has no files or others than those it was read from, or the scale is
    not a positive number.
    """
    if not (np.isfinite(scale) and scale > 0):
        raise InputError.at(folder, "scale", "a positive number", scale)
    if scene.model_path is None:
        raise InputError.at(scene.path, "model", "a scene that was read from files", None)
    with whole_folder(folder, "--write-scaled") as temporary:
        _write_all(scene, scene.model_path, scale, temporary)
        _expect_same(scene, scene.model_path)


def _expect_same(scene: Scene, model_path: Path) -> None:
    """See that the files are still those that the scene was read from; other forms are written from memory."""
    if scene.format in {"colmap-binary", "colmap-text"}:
        now = read_colmap(model_path, scene.path)
    elif scene.format == "opensfm":
        now = read_opensfm(model_path)
    else:
        return
    same = np.array_equal(now.points, scene.points) and len(now.views) == len(scene.views)
    if not same or any(np.any(a.translation != b.translation) for a, b in zip(now.views, scene.views, strict=True)):
        expected = "the reconstruction that the scale is of"
        raise InputError.at(scene.path, "model", expected, Unquoted("another, exchanged since it was read"))


def _write_all(scene: Scene, model_path: Path, scale: float, folder: Path) -> None:
    target = folder / _place(model_path, scene.path)
    target.mkdir(parents=True, exist_ok=True)
    if scene.format == "opensfm":
        _write_opensfm(model_path, scale, target)
    elif scene.format not in {"colmap-binary", "colmap-text"}:
        write_colmap_model(scene, scale, target)
    else:
        write_scaled_colmap(model_path, ".bin" if scene.format == "colmap-binary" else ".txt", scale, target)
    if scene.dense is not None and scene.dense.path is not None:
        target = folder / _place(scene.dense.path, scene.path)
        _write_cloud(scene.dense.path, scale, target)
        if scene.dense.visible_offsets is not None:
            _write_visibility(scene.dense.path, scene.dense.file_views, len(scene.views), target)
    (folder / TRANSFORM).write_text(f"{scale!r} 1 0 0 0 0 0 0\n", encoding="utf-8")


def _place(path: Path, root: Path) -> Path:
    """Where a file lies below the scene's folder; one from elsewhere goes to the top."""
    path, root = path.resolve(), root.resolve()
    return path.relative_to(root) if path.is_relative_to(root) else Path(path.name)


def _write_opensfm(source: Path, scale: float, target: Path) -> None:
    """The reconstruction that was used, alone: the others have scales of their own, which nobody knows."""
    document, _ = largest_reconstruction(source / RECONSTRUCTION)
    for part in ("shots", "pano_shots", "rig_instances", "rig_cameras"):
        _scale_member(document.get(part), "translation", scale)
    _scale_member(document.get("points"), "coordinates", scale)
    for shot in (document.get("shots") or {}).values():
        if isinstance(shot.get("vertices"), list):
            shot["vertices"] = (np.array(shot["vertices"], dtype=np.float64) * scale).tolist()
    (target / RECONSTRUCTION).write_text(json.dumps([document], indent=1), encoding="utf-8")
    if (source / TRACKS).is_file():
        shutil.copyfile(source / TRACKS, target / TRACKS)


def _scale_member(entries: Any, member: str, scale: float) -> None:
    """Multiply the (3,) list `member` of each entry in place."""
    if isinstance(entries, dict):
        for entry in entries.values():
            if isinstance(entry, dict) and isinstance(entry.get(member), list):
                entry[member] = [float(value) * scale for value in entry[member]]


def _write_cloud(source: Path, scale: float, target: Path) -> None:
    """A PLY file with its positions scaled."""
    target.parent.mkdir(parents=True, exist_ok=True)
    data = read_bytes(source)
    with in_file(source):
        layout = ply_layout(data)
    if layout.format == "ascii":
        target.write_bytes(
            _scaled_ascii(data, layout.body, layout.skipped, layout.count, layout.vertex.names or (), scale)
        )
    else:
        scaled = bytearray(data)
        rows = np.frombuffer(scaled, layout.vertex, layout.count, layout.body + layout.skipped)
        for axis in "xyz":
            rows[axis] = (rows[axis].astype(np.float64) * scale).astype(rows[axis].dtype)
        target.write_bytes(scaled)


def _write_visibility(source: Path, file_views: IntArray | None, n_views: int, target: Path) -> None:
    """The visibility beside a cloud; `file_views` (v,) are the views in the order of the written model."""
    beside, written = source.with_name(f"{source.name}.vis"), target.with_name(f"{target.name}.vis")
    if file_views is None:
        shutil.copyfile(beside, written)
        return
    with in_file(source):
        n_points = ply_layout(read_bytes(source)).count
    offsets, views = read_visibility(beside, n_points, n_views)
    written.write_bytes(visibility_bytes(offsets, file_views[views]))


def _scaled_ascii(data: bytes, body: int, skipped: int, count: int, names: tuple[str, ...], scale: float) -> bytes:
    lines = data[body:].split(b"\n")
    places = [names.index(axis) for axis in "xyz"]
    for row in range(skipped, skipped + count):
        words = lines[row].split()
        for place in places:
            words[place] = repr(float(words[place]) * scale).encode("ascii")
        lines[row] = b" ".join(words)
    return data[:body] + b"\n".join(lines)


def write_colmap_model(scene: Scene, scale: float, folder: Path) -> None:
    """cameras.txt, images.txt and points3D.txt of the scene, every length times `scale`."""
    names = (view.name for view in scene.views)
    split = next((name for name in names if not name.isprintable() or name != name.strip()), None)
    if split is not None:
        expected = "names without line breaks and control characters: COLMAP's text has a line for each picture"
        raise InputError.at(scene.path, "picture", expected, split)
    cameras: dict[int, tuple[int, Camera]] = {}
    for view in scene.views:
        cameras.setdefault(id(view.camera), (len(cameras) + 1, view.camera))
    lines = [
        " ".join([str(number), camera.model, str(camera.width), str(camera.height), *map(repr, camera.params.tolist())])
        for number, camera in cameras.values()
    ]
    (folder / "cameras.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    images, tracks = [], [list[str]() for _ in scene.points]
    for number, view in enumerate(scene.views, start=1):
        quaternion = Rotation.from_matrix(view.rotation).as_quat(scalar_first=True)
        pose = np.concatenate([quaternion, view.translation * scale]).tolist()
        images.append(" ".join([str(number), *map(repr, pose), str(cameras[id(view.camera)][0]), view.name]))
        rows = zip(view.keypoints.tolist(), view.point_index.tolist(), strict=True)
        images.append(" ".join(f"{x!r} {y!r} {point + 1}" for (x, y), point in rows))
        for row, point in enumerate(view.point_index.tolist()):
            tracks[point].append(f"{number} {row}")
    (folder / "images.txt").write_text("\n".join(images) + "\n", encoding="utf-8")
    points = [
        " ".join([str(number), *map(repr, point), "128 128 128 0", *track])
        for number, (point, track) in enumerate(zip((scene.points * scale).tolist(), tracks, strict=True), start=1)
    ]
    (folder / "points3D.txt").write_text("\n".join(points) + "\n", encoding="utf-8")

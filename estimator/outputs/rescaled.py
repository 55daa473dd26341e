"""Write the files of a scene at metric scale: all lengths times the scale, and everything else unchanged.

The model, the dense cloud and a transform file for COLMAP are written to a temporary folder, which is renamed when it
is complete. COLMAP models are rescaled by pycolmap, which writes the images in another order: the visibility lists of a
dense cloud, which contain positions of images, are renumbered.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.reconstructions.colmap import read_colmap
from estimator.reconstructions.opensfm import RECONSTRUCTION, TRACKS, largest_reconstruction, read_opensfm
from estimator.reconstructions.ply import DENSE_CLOUDS, read_visibility, visibility_bytes
from estimator.reconstructions.splats import scaled_splat
from estimator.records.result import DIGITS, ScaleResult
from estimator.records.scene import Camera, DenseCloud, Scene
from metric_base.errors import InputError, Unquoted, in_file
from metric_base.files import check_output, whole_file, whole_folder, write_whole
from metric_base.input_files import read_bytes
from metric_base.ply import ply_layout

#: File for `colmap model_transformer --transform_path`: scale qw qx qy qz tx ty tz.
TRANSFORM = "metric_transform.txt"
#: File with the scale of a model, for viewers, and its schema.
SIDECAR, SIDECAR_SCHEMA = "scale.json", "metric-tree/scale-sidecar/1"
#: Program that rescales a COLMAP model. It runs in a separate process, because COLMAP ends its process if files of rigs
#: and frames are damaged.
_RESCALE = """
import sys
import numpy, pycolmap
source, target, scale, is_binary = sys.argv[1:]
model = pycolmap.Reconstruction(source)
model.transform(pycolmap.Sim3d(float(scale), pycolmap.Rotation3d(), numpy.zeros(3)))
(model.write_binary if is_binary == "True" else model.write_text)(target)
"""


def write_rescaled(scene: Scene, scale: float, folder: Path, result: ScaleResult | None = None) -> None:
    """Write the files of a scene to a new folder, with the layout of the original.

    Parameters
    ----------
    scene : Scene
        Scene that was read from files.
    scale : float
        Metres per scene unit.
    folder : Path
        Must not exist.
    result : ScaleResult, optional
        Result with this scale, for `scale.json` in the folder.

    Raises
    ------
    InputError
        The folder exists, the scale is not positive, or the scene has no files or its files have changed.
    """
    if not (np.isfinite(scale) and scale > 0):
        raise InputError.at(folder, "scale", "a positive number", scale)
    model_path = scene.model_path
    if model_path is None:
        raise InputError.at(scene.path, "model", "a scene that was read from files", None)
    is_colmap = scene.format in {"colmap-binary", "colmap-text"}
    with whole_folder(folder, "--write-scaled") as temporary:
        target = temporary / _relative_path(model_path, scene.path)
        target.mkdir(parents=True, exist_ok=True)
        if is_colmap:
            _write_colmap(model_path, scale, target, is_binary=scene.format == "colmap-binary")
        elif scene.format == "opensfm":
            _write_opensfm(model_path, scale, target)
        else:
            write_colmap_model(scene, scale, target)
        if scene.dense is not None:
            path = scene.dense.path
            # The name of the cloud of a network is not one of those that are read with a model.
            is_named = path is not None and scene.format != "network"
            cloud = temporary / (_relative_path(path, scene.path) if path and is_named else DENSE_CLOUDS[0])
            _write_cloud(scene.dense, scale, cloud)
            offsets, rows = scene.dense.visible_offsets, scene.dense.visible_views
            if offsets is not None and rows is not None:
                if path is not None:
                    with in_file(path):
                        n_points = ply_layout(read_bytes(path)).count
                    offsets, rows = read_visibility(path.with_name(f"{path.name}.vis"), n_points, len(scene.views))
                    rows = rows if scene.dense.file_views is None else scene.dense.file_views[rows]
                if is_colmap:
                    # The visibility lists refer to the order of the images in the written model.
                    written = {view.name: index for index, view in enumerate(read_colmap(target).views)}
                    rows = np.array([written[view.name] for view in scene.views], dtype=np.int64)[rows]
                cloud.with_name(f"{cloud.name}.vis").write_bytes(visibility_bytes(offsets, rows))
        (temporary / TRANSFORM).write_text(f"{scale!r} 1 0 0 0 0 0 0\n", encoding="utf-8")
        if result is not None:
            (temporary / SIDECAR).write_text(scale_sidecar(result, scene.path, folder), encoding="utf-8")
        _check_unchanged(scene, model_path)


def write_rescaled_cloud(scene: Scene, result: ScaleResult, file: Path, option: str | None = None) -> None:
    """Write the dense cloud or the splat of a scene at metric scale, and `scale.json` with the scale of the original.

    Parameters
    ----------
    scene : Scene
        Scene with a cloud.
    result : ScaleResult
        Result with a scale.
    file : Path
        PLY file to write.
    option : str, optional
        Option that names it, for messages.

    Raises
    ------
    InputError
        The scene has no cloud, or a file cannot be written.
    """
    if scene.dense is None or result.scale is None:
        raise InputError.at(scene.path, "cloud", "a splat or a dense cloud to write", Unquoted("none"))
    sidecar = file.with_name(SIDECAR)
    check_output(sidecar, option or "sidecar", SIDECAR_SCHEMA)
    with whole_file(file, option) as temporary:
        _write_cloud(scene.dense, result.scale, temporary)
    source = scene.dense.path or scene.path
    write_whole(sidecar, scale_sidecar(result, source, file), option, SIDECAR_SCHEMA)


def scale_sidecar(result: ScaleResult, source: Path, target: Path) -> str:
    """Return the scale of the model `source` for viewers, as JSON (`metric-tree/scale-sidecar/1`).

    `units_per_meter` is the number of Brush, `metersPerUnit` that of a USD stage with the model in its original units;
    a node of glTF, which is in metres, has the factor `metres_per_unit` as its scale.
    """
    record = result.to_json()
    interval, up = record["interval"] or {}, record["up"] or {}
    fields = {
        "schema": SIDECAR_SCHEMA,
        "metres_per_unit": record["scale"],
        "units_per_meter": None if result.scale is None else float(f"{1 / result.scale:.{DIGITS}g}"),
        "metersPerUnit": record["scale"],
        "low": interval.get("low"),
        "high": interval.get("high"),
        "level": interval.get("level"),
        "up": up.get("vector"),
        "tool": record["tree"]["name"],
        "release": record["tree"]["version"],
        "model": source.resolve().name,
        "model_in_metres": target.name,
    }
    return json.dumps(fields, indent=1) + "\n"


def _check_unchanged(scene: Scene, model_path: Path) -> None:
    """Raise InputError if the files differ from the scene; formats that are written from memory are not read again."""
    if scene.format in {"colmap-binary", "colmap-text"}:
        current = read_colmap(model_path, scene.path)
    elif scene.format == "opensfm":
        current = read_opensfm(model_path)
    else:
        return
    is_same = np.array_equal(current.points, scene.points) and len(current.views) == len(scene.views)
    if not is_same or any(
        np.any(a.translation != b.translation) for a, b in zip(current.views, scene.views, strict=True)
    ):
        expected = "the reconstruction to which the scale belongs"
        raise InputError.at(scene.path, "model", expected, Unquoted("another, exchanged since it was read"))


def _relative_path(path: Path, root: Path) -> Path:
    """Return the path of a file below the folder of the scene; of a file elsewhere, its name."""
    path, root = path.resolve(), root.resolve()
    return path.relative_to(root) if path.is_relative_to(root) else Path(path.name)


def _write_colmap(source: Path, scale: float, target: Path, *, is_binary: bool) -> None:
    """Write a COLMAP model by COLMAP itself, with its rigs and frames."""
    command = [sys.executable, "-c", _RESCALE, str(source), str(target), repr(scale), str(is_binary)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode:
        lines = [line for line in result.stderr.splitlines() if "Error" in line or "Check failed" in line]
        found = Unquoted(lines[-1] if lines else f"exit status {result.returncode}")
        raise InputError.at(source, "rigs and frames", "files that COLMAP reads", found)


def _write_opensfm(source: Path, scale: float, target: Path) -> None:
    """Write the reconstruction that was used; the others of the file have unknown scales."""
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
    """Multiply the list `member` (3,) of each entry in place."""
    if isinstance(entries, dict):
        for entry in entries.values():
            if isinstance(entry, dict) and isinstance(entry.get(member), list):
                entry[member] = [float(value) * scale for value in entry[member]]


def _write_cloud(cloud: DenseCloud, scale: float, target: Path) -> None:
    """Write the PLY file of a cloud with its positions, and the sizes of its Gaussians, times the scale.

    A cloud that was not read from a PLY file has only positions.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    source = cloud.path
    if source is None:
        header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(cloud.points)}\n"
        header += "".join(f"property double {axis}\n" for axis in "xyz") + "end_header\n"
        target.write_bytes(header.encode("ascii") + (cloud.points * scale).astype("<f8").tobytes())
        return
    with in_file(source):
        target.write_bytes(scaled_splat(read_bytes(source), scale))


def write_colmap_model(scene: Scene, scale: float, folder: Path) -> None:
    """Write cameras.txt, images.txt and points3D.txt of a scene, with all lengths times `scale`.

    Raises
    ------
    InputError
        The name of an image contains a line break or a control character, which the text format cannot represent.
    """
    names = (view.name for view in scene.views)
    invalid = next((name for name in names if not name.isprintable() or name != name.strip()), None)
    if invalid is not None:
        expected = "names without line breaks and control characters: COLMAP's text format has a line for each image"
        raise InputError.at(scene.path, "image", expected, invalid)
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

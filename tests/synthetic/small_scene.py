"""A small exact scene, synthesised by pycolmap, in several formats.

colmap/   binary model of five files, with a dense cloud and its visibility, instances.json and results.json
text/     the same model as three text files, with instances.json
opensfm/  the same model as an OpenSfM dataset, with instance images
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pycolmap
from numpy.typing import NDArray

__all__ = ["FRAMES", "small_model", "write_small_scene"]

FRAMES = 4
#: Boxes of the two objects in each image: x, y, width and height as fractions of the image's size.
_BOXES = {"chair": (0.3, 0.3, 0.4, 0.4), "table": (0.05, 0.05, 0.2, 0.2)}


def small_model(
    model: str = "SIMPLE_RADIAL", params: list[float] | None = None, seed: int = 0
) -> pycolmap.Reconstruction:
    """Return four frames of a rig of two cameras with 60 points, which are in front of all cameras."""
    pycolmap.set_random_seed(seed)
    options = pycolmap.SyntheticDatasetOptions(
        num_rigs=1, num_cameras_per_rig=2, num_frames_per_rig=FRAMES, num_points3D=60, num_points2D_without_point3D=3
    )
    options.camera_width, options.camera_height = 320, 240
    options.camera_model_id = getattr(pycolmap.CameraModelId, model)
    options.camera_params = params or [300.0, 160.0, 120.0, 0.02]
    return pycolmap.synthesize_dataset(options)


def write_small_scene(folder: Path, reconstruction: pycolmap.Reconstruction | None = None) -> None:
    """Write the scene in all three formats to subfolders of `folder`."""
    reconstruction = reconstruction or small_model()
    for part in ("colmap", "text", "opensfm"):
        (folder / part).mkdir(parents=True)
    reconstruction.write_binary(str(folder / "colmap"))
    reconstruction.write_text(str(folder / "text"))
    for part in ("rigs", "frames"):  # older models have three files
        (folder / "text" / f"{part}.txt").unlink()
    _write_dense(folder / "colmap", reconstruction)
    _write_coco(folder, reconstruction)
    _write_opensfm(folder / "opensfm", reconstruction)


def _write_dense(folder: Path, reconstruction: pycolmap.Reconstruction) -> None:
    ids = sorted(reconstruction.points3D)
    rows = np.zeros(len(ids), dtype=[("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("red", "u1")])
    for axis, name in enumerate("xyz"):
        rows[name] = [reconstruction.points3D[key].xyz[axis] for key in ids]
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(ids)}"]
    lines += ["property float x", "property float y", "property float z", "property uchar red", "end_header", ""]
    (folder / "dense.ply").write_bytes("\n".join(lines).encode("ascii") + rows.tobytes())
    position = {image: row for row, image in enumerate(sorted(reconstruction.images))}
    lists = []
    for key in ids:
        views = sorted({position[element.image_id] for element in reconstruction.points3D[key].track.elements})
        lists.append(np.array([len(views), *views], dtype="<u4"))
    (folder / "dense.ply.vis").write_bytes(np.uint64(len(ids)).tobytes() + np.concatenate(lists).tobytes())


def _write_coco(folder: Path, reconstruction: pycolmap.Reconstruction) -> None:
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for number, key in enumerate(sorted(reconstruction.images)):
        image = reconstruction.images[key]
        width, height = image.camera.width, image.camera.height
        images.append({"id": 100 + number, "file_name": image.name, "width": width, "height": height})
        for category, box in enumerate(_boxes(width, height).values(), start=1):
            annotation: dict[str, Any] = {"id": len(annotations), "image_id": 100 + number, "category_id": category}
            annotations.append(annotation | {"bbox": box, "score": 0.9, "track_id": category})
    categories = [{"id": number, "name": name} for number, name in enumerate(_BOXES, start=1)]
    frame = {"images": images, "categories": categories}
    masked = [
        annotation | {"segmentation": _segmentation(annotation["bbox"], images[0], row % 2 == 0)}
        for row, annotation in enumerate(annotations)
    ]
    for part in ("colmap", "text"):
        _dump(folder / part / "instances.json", frame | {"annotations": masked})
    _dump(folder / "colmap" / "results.json", annotations)
    _dump(folder / "colmap" / "results_categories.json", frame)


def _segmentation(box: list[float], image: dict[str, Any], as_polygon: bool) -> Any:
    x, y, width, height = box
    if as_polygon:
        return [[x, y, x + width, y, x + width, y + height, x, y + height]]
    mask = np.zeros((image["height"], image["width"]), dtype=np.uint8)
    mask[int(y) : int(y + height), int(x) : int(x + width)] = 1
    edges = np.flatnonzero(np.diff(mask.T.ravel(), prepend=0, append=0)).tolist()
    return {"size": [image["height"], image["width"]], "counts": np.diff([0, *edges, mask.size]).tolist()}


def _boxes(width: int, height: int) -> dict[str, list[float]]:
    return {name: [x * width, y * height, w * width, h * height] for name, (x, y, w, h) in _BOXES.items()}


def _write_opensfm(folder: Path, reconstruction: pycolmap.Reconstruction) -> None:
    cameras, shots, lines = {}, {}, ["OPENSFM_TRACKS_VERSION_v2"]
    for camera in reconstruction.cameras.values():
        side = max(camera.width, camera.height)
        cameras[f"camera {camera.camera_id}"] = {
            "projection_type": "perspective",
            "width": camera.width,
            "height": camera.height,
            "focal": camera.params[0] / side,
            "k1": camera.params[3],
            "k2": 0.0,
        }
    for key in sorted(reconstruction.images):
        image = reconstruction.images[key]
        pose = image.cam_from_world()
        rotation: NDArray[np.float64] = cv2.Rodrigues(pose.rotation.matrix())[0].ravel()
        shots[image.name] = {
            "rotation": rotation.tolist(),
            "translation": pose.translation.tolist(),
            "camera": f"camera {image.camera_id}",
        }
        size = np.array([image.camera.width, image.camera.height])
        for row, point in enumerate(image.points2D):
            if point.has_point3D():
                u, v = (point.xy - size / 2) / size.max()
                lines.append(f"{image.name}\t{point.point3D_id}\t{row}\t{u:.9f}\t{v:.9f}\t0.004\t9\t9\t9\t-1\t-1")
        _write_instance_image(folder / "instances" / f"{image.name}.png", size)
    points = {
        str(key): {"color": [9, 9, 9], "coordinates": reconstruction.points3D[key].xyz.tolist()}
        for key in sorted(reconstruction.points3D)
    }
    _dump(folder / "reconstruction.json", [{"cameras": cameras, "shots": shots, "points": points}])
    (folder / "tracks.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    _dump(folder / "instances" / "categories.json", {"1": "chair", "2": "table", "3": "chair"})


def _write_instance_image(file: Path, size: NDArray[np.int64]) -> None:
    width, height = size.tolist()
    image = np.zeros((height, width), dtype=np.uint8)
    for value, (x, y, w, h) in enumerate(_boxes(width, height).values(), start=1):
        image[int(y) : int(y + h), int(x) : int(x + w)] = value
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(cv2.imencode(".png", image)[1].tobytes())


def _dump(file: Path, document: object) -> None:
    file.write_text(json.dumps(document), encoding="utf-8")

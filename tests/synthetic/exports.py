"""Write a scene in the formats of other programs (nerfstudio, Bundler, Metashape, ...), as in their documentation."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from estimator.projection.cameras import project
from estimator.records.scene import Scene, View

__all__ = ["EXPORTS", "OBSERVED", "largest_difference", "write_export", "write_points"]

EXPORTS = ("nerfstudio", "bundler", "metashape", "realitycapture", "meshroom")
#: Programs whose files state observations.
OBSERVED = ("bundler", "meshroom")
FLIP = np.diag([1.0, -1.0, -1.0])
#: Transform from COLMAP's world to nerfstudio's.
APPLIED = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [-0.0, -1, 0, 0]])


def write_export(scene: Scene, program: str, folder: Path) -> Path:
    """Write the scene in the format of a program, with a separate file of points if the format has no points."""
    folder.mkdir(parents=True, exist_ok=True)
    return {
        "nerfstudio": _nerfstudio,
        "bundler": _bundler,
        "metashape": _metashape,
        "realitycapture": _realitycapture,
        "meshroom": _meshroom,
    }[program](scene, folder)


def largest_difference(colmap: Scene, other: Scene, observed: bool) -> float:
    """Return the largest difference of two scenes.

    Differences of points and centres are relative to the scene's extent, differences of pixels to the image width.
    Cameras are compared by the projections of a set of rays. Infinite if the views, their sizes or (with `observed`)
    their observed points differ.
    """
    names = {Path(view.name).name: view for view in other.views}
    extent = float(np.ptp(colmap.points, axis=0).max())
    if len(names) != len(colmap.views) or other.points.shape != colmap.points.shape:
        return float("inf")
    differences = [np.abs(other.points - colmap.points).max() / extent]
    for view in colmap.views:
        same, width = names[Path(view.name).name], view.camera.width
        if (same.camera.width, same.camera.height) != (width, view.camera.height):
            return float("inf")
        differences.append(np.abs(same.rotation - view.rotation).max())
        differences.append(np.abs(same.centre - view.centre).max() / extent)
        differences.append(np.abs(_rays(same) - _rays(view)).max() / width)
        if observed:
            same_order, order = np.argsort(same.point_index), np.argsort(view.point_index)
            if not np.array_equal(same.point_index[same_order], view.point_index[order]):
                return float("inf")
            differences.append(np.abs(same.keypoints[same_order] - view.keypoints[order]).max() / width)
    return float(max(differences))


def _rays(view: View) -> np.ndarray[Any, Any]:
    """Return the pixels (n, 2) of a set of rays, which are equal for equivalent camera models."""
    grid = np.stack(np.meshgrid(np.linspace(-0.4, 0.4, 7), np.linspace(-0.3, 0.3, 5)), axis=-1).reshape(-1, 2)
    return project(view.camera, np.column_stack([grid, np.ones(len(grid))]))


def _opencv(view: View) -> dict[str, float]:
    """Return the OpenCV parameters of a PINHOLE, SIMPLE_RADIAL or OPENCV camera."""
    params = view.camera.params.tolist()
    if view.camera.model == "PINHOLE":
        return {**dict(zip(("fx", "fy", "cx", "cy"), params, strict=True)), "k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0}
    if view.camera.model == "SIMPLE_RADIAL":
        focal, cx, cy, k1 = params
        return {"fx": focal, "fy": focal, "cx": cx, "cy": cy, "k1": k1, "k2": 0.0, "p1": 0.0, "p2": 0.0}
    assert view.camera.model == "OPENCV"
    return dict(zip(("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"), params, strict=True))


def _camera_to_world(view: View) -> np.ndarray[Any, Any]:
    """Return the pose (4, 4) of the camera in the world, with the axes right, down, forward."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = view.rotation.T, view.centre
    return pose


def write_points(file: Path, points: np.ndarray[Any, Any]) -> None:
    """Write points (n, 3) as an ASCII PLY file."""
    lines = ["ply", "format ascii 1.0", f"element vertex {len(points)}"]
    lines += [f"property double {axis}" for axis in "xyz"] + ["end_header"]
    file.write_text("\n".join([*lines, *(" ".join(map(repr, row)) for row in points.tolist()), ""]), encoding="ascii")


def _write_images(scene: Scene, folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    for view in scene.views:
        image = np.zeros((view.camera.height, view.camera.width), dtype=np.uint8)
        (folder / view.name).parent.mkdir(parents=True, exist_ok=True)
        (folder / view.name).write_bytes(cv2.imencode(".png", image)[1].tobytes())


def _nerfstudio(scene: Scene, folder: Path) -> Path:
    frames = []
    for view in scene.views:
        camera = _opencv(view)
        numbers = {"fl_x": camera["fx"], "fl_y": camera["fy"], "w": view.camera.width, "h": view.camera.height}
        numbers |= {name: camera[name] for name in ("cx", "cy", "k1", "k2", "p1", "p2")}
        pose = _camera_to_world(view)
        pose[:3, :3] = pose[:3, :3] @ FLIP
        pose[:3] = APPLIED[:, :3] @ pose[:3]
        frames.append({"file_path": f"images/{view.name}", "transform_matrix": pose.tolist(), **numbers})
    document = {
        "camera_model": "OPENCV",
        "frames": frames,
        "applied_transform": APPLIED.tolist(),
        "ply_file_path": "sparse_pc.ply",
    }
    (folder / "transforms.json").write_text(json.dumps(document), encoding="utf-8")
    write_points(folder / "sparse_pc.ply", scene.points @ APPLIED[:, :3].T)
    return folder / "transforms.json"


def _bundler(scene: Scene, folder: Path) -> Path:
    lines = ["# Bundle file v0.3", f"{len(scene.views)} {len(scene.points)}"]
    seen: list[list[str]] = [[] for _ in scene.points]
    for row, view in enumerate(scene.views):
        camera = _opencv(view)
        rotation, translation = FLIP @ view.rotation, FLIP @ view.translation
        lines += [f"{camera['fx']!r} {camera['k1']!r} {camera['k2']!r}"]
        lines += [" ".join(map(repr, part)) for part in [*rotation.tolist(), translation.tolist()]]
        half = np.array([view.camera.width, view.camera.height]) / 2
        for key, (point, pixel) in enumerate(zip(view.point_index.tolist(), view.keypoints, strict=True)):
            x, y = (pixel - half).tolist()
            seen[point].append(f"{row} {key} {x!r} {-y!r}")
    for point, views in zip(scene.points.tolist(), seen, strict=True):
        lines += [" ".join(map(repr, point)), "128 128 128", " ".join([str(len(views)), *views])]
    (folder / "bundle.out").write_text("\n".join(lines) + "\n", encoding="ascii")
    (folder / "bundle.list.txt").write_text("".join(f"{view.name} 0 500\n" for view in scene.views), encoding="utf-8")
    _write_images(scene, folder / "images")
    return folder / "bundle.out"


def _metashape(scene: Scene, folder: Path) -> Path:
    turn, shift, scale = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix(), np.array([1.0, 2.0, -3.0]), 2.5
    component = np.eye(4)
    component[:3, :3], component[:3, 3] = turn * scale, shift
    sensors, cameras = [], []
    for row, view in enumerate(scene.views):
        camera, (width, height) = _opencv(view), (view.camera.width, view.camera.height)
        numbers = {"f": camera["fy"], "b1": camera["fx"] - camera["fy"], "cx": camera["cx"] - width / 2}
        numbers |= {
            "cy": camera["cy"] - height / 2,
            "k1": camera["k1"],
            "k2": camera["k2"],
            "p1": camera["p2"],
            "p2": camera["p1"],
        }
        text = "".join(f"<{name}>{value!r}</{name}>" for name, value in numbers.items())
        resolution = f'<resolution width="{width}" height="{height}"/>'
        sensors.append(
            f'<sensor id="{row}" type="frame">{resolution}'
            f'<calibration type="frame" class="adjusted">{text}</calibration></sensor>'
        )
        pose = _camera_to_world(view)
        inner = np.eye(4)  # component @ inner is the pose, except for the component's scale in the rotation
        inner[:3, :3] = turn.T @ pose[:3, :3]
        inner[:3, 3] = turn.T @ (pose[:3, 3] - shift) / scale
        transform = " ".join(map(repr, inner.ravel().tolist()))
        cameras.append(
            f'<camera id="{row}" sensor_id="{row}" component_id="0" label="{view.name}">'
            f"<transform>{transform}</transform></camera>"
        )
    matrix = " ".join(map(repr, turn.ravel().tolist()))
    moved = " ".join(map(repr, shift.tolist()))
    placed = f"<rotation>{matrix}</rotation><translation>{moved}</translation><scale>{scale}</scale>"
    cameras.append('<camera id="99" sensor_id="0" label="not aligned"/>')
    (folder / "cameras.xml").write_text(
        '<?xml version="1.0" encoding="UTF-8"?>\n<document version="2.0.0"><chunk label="Chunk 1">'
        f"<sensors>{''.join(sensors)}</sensors>"
        f'<components><component id="0"><transform>{placed}</transform></component></components>'
        f"<cameras>{''.join(cameras)}</cameras></chunk></document>\n",
        encoding="utf-8",
    )
    write_points(folder / "points.ply", scene.points)
    return folder / "cameras.xml"


def _realitycapture(scene: Scene, folder: Path) -> Path:
    lines = ["#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2"]
    for view in scene.views:
        camera, (width, height) = _opencv(view), (view.camera.width, view.camera.height)
        pixels = max(width, height) / 36
        yaw, pitch, roll = Rotation.from_matrix(view.rotation.T @ FLIP).as_euler("ZXY", degrees=True)
        offsets = [(camera["cx"] - width / 2) / pixels, (camera["cy"] - height / 2) / pixels]
        numbers = [*view.centre.tolist(), -float(yaw), float(pitch), float(roll), camera["fx"] / pixels, *offsets]
        numbers += [camera["k1"], camera["k2"], 0.0, 0.0, camera["p1"], camera["p2"]]
        lines.append(",".join([view.name, *map(repr, numbers)]))
    (folder / "registration.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    write_points(folder / "points.ply", scene.points)
    _write_images(scene, folder / "images")
    return folder / "registration.csv"


def _meshroom(scene: Scene, folder: Path) -> Path:
    views, intrinsics, poses = [], [], []
    structure: list[dict[str, Any]] = [
        {
            "landmarkId": str(row),
            "descType": "dspsift",
            "color": ["9", "9", "9"],
            "X": [repr(value) for value in point],
            "observations": [],
        }
        for row, point in enumerate(scene.points.tolist())
    ]
    for row, view in enumerate(scene.views):
        camera, (width, height) = _opencv(view), (view.camera.width, view.camera.height)
        centre = [repr(camera["cx"] - width / 2), repr(camera["cy"] - height / 2)]
        params = [repr(camera[name]) if name in camera else "0" for name in ("k1", "k2", "k3", "p1", "p2")]
        intrinsic = {
            "intrinsicId": str(row),
            "width": str(width),
            "height": str(height),
            "sensorWidth": "36",
            "type": "brown",
        }
        focal = {"focalLength": repr(camera["fx"] * 36 / width), "pixelRatio": repr(camera["fy"] / camera["fx"])}
        intrinsics.append(intrinsic | focal | {"principalPoint": centre, "distortionParams": params})
        views.append(
            {
                "viewId": str(1000 + row),
                "poseId": str(1000 + row),
                "intrinsicId": str(row),
                "path": f"/data/{view.name}",
            }
        )
        rotation = [repr(value) for value in view.rotation.T.ravel().tolist()]  # column by column
        transform = {"rotation": rotation, "center": [repr(value) for value in view.centre.tolist()]}
        poses.append({"poseId": str(1000 + row), "pose": {"transform": transform, "locked": "0"}})
        for key, (point, pixel) in enumerate(zip(view.point_index.tolist(), view.keypoints.tolist(), strict=True)):
            observation = {
                "observationId": str(1000 + row),
                "featureId": str(key),
                "x": [repr(value) for value in pixel],
            }
            structure[point]["observations"].append(observation)
    views.append({"viewId": "1", "poseId": "1", "intrinsicId": "0", "path": "/data/not_posed.jpg"})
    document = {
        "version": ["1", "2", "6"],
        "views": views,
        "intrinsics": intrinsics,
        "poses": poses,
        "structure": structure,
    }
    (folder / "cameras.sfm").write_text(json.dumps(document, indent=1), encoding="utf-8")
    return folder / "cameras.sfm"

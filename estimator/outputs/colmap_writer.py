"""A scene as a COLMAP model in text form, for scenes that other programs reconstructed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.records.scene import Camera, Scene

__all__ = ["write_colmap_model"]


def write_colmap_model(scene: Scene, scale: float, folder: Path) -> None:
    """cameras.txt, images.txt and points3D.txt of the scene, every length times `scale`."""
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

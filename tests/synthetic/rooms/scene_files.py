"""Write a simulated scene as files of `estimate-scale`: COLMAP text model, dense.ply, visibility, masks and truth."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from estimator.records.scene import DenseCloud, Scene
from tests.synthetic.rooms.masks import coco_dataset
from tests.synthetic.rooms.quick import SyntheticScene
from tests.synthetic.rooms.world import World

__all__ = ["write_scene"]


def write_scene(synthetic: SyntheticScene, world: World, folder: Path) -> None:
    """Write `sparse/0/*.txt`, `instances.json`, `truth.json` and, for dense clouds, `dense.ply` and its `.vis`."""
    model = folder / "sparse" / "0"
    model.mkdir(parents=True, exist_ok=True)
    (model / "cameras.txt").write_text(_cameras(synthetic.scene))
    (model / "images.txt").write_text("".join(_image(synthetic.scene, k) for k in range(len(synthetic.scene.views))))
    (model / "points3D.txt").write_text(_points(synthetic.scene))
    if synthetic.scene.dense is not None:
        _write_dense(synthetic.scene.dense, folder / "dense.ply")
    names = [view.name for view in synthetic.scene.views]
    (folder / "instances.json").write_text(json.dumps(coco_dataset(world, synthetic.ids, names)) + "\n")
    (folder / "truth.json").write_text(json.dumps(synthetic.truth.json(), indent=1) + "\n")


def _cameras(scene: Scene) -> str:
    camera = scene.views[0].camera
    return f"1 {camera.model} {camera.width} {camera.height} {' '.join(repr(float(v)) for v in camera.params)}\n"


def _image(scene: Scene, index: int) -> str:
    """Return the two lines of an image: pose and name, and the observations as x, y and point id (from 1)."""
    from scipy.spatial.transform import Rotation

    view = scene.views[index]
    pose = [*Rotation.from_matrix(view.rotation).as_quat(scalar_first=True), *view.translation]
    observed = [f"{x:.3f} {y:.3f} {row + 1}" for (x, y), row in zip(view.keypoints, view.point_index, strict=True)]
    return f"{index + 1} {' '.join(repr(float(v)) for v in pose)} 1 {view.name}\n{' '.join(observed)}\n"


def _points(scene: Scene) -> str:
    """Return the lines of the points: id, position, colour, error, and the track as (image, observation)."""
    tracks: list[list[str]] = [[] for _ in scene.points]
    for index, view in enumerate(scene.views):
        for position, row in enumerate(view.point_index):
            tracks[row].append(f"{index + 1} {position}")
    lines = [
        f"{row + 1} {point[0]:.9g} {point[1]:.9g} {point[2]:.9g} 128 128 128 0.5 {' '.join(track)}\n"
        for row, (point, track) in enumerate(zip(scene.points, tracks, strict=True))
    ]
    return "".join(lines)


def _write_dense(cloud: DenseCloud, path: Path) -> None:
    """Write a binary PLY file, and COLMAP's `fused.ply.vis`: uint64 n, and for each point uint32 k and k uint32."""
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(cloud.points)}\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    path.write_bytes(header.encode() + cloud.points.astype("<f4").tobytes())
    if cloud.visible_offsets is None or cloud.visible_views is None:
        return
    counts = np.diff(cloud.visible_offsets)
    words = np.insert(cloud.visible_views, cloud.visible_offsets[:-1], counts).astype("<u4")
    vis = np.array([len(cloud.points)], dtype="<u8").tobytes() + words.tobytes()
    path.with_name(path.name + ".vis").write_bytes(vis)

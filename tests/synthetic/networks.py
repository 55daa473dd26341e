"""Write a rendered room as the networks of `estimator.records.network_outputs` write their output, after their code."""

from __future__ import annotations

import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.records.scene import Instance
from tests.synthetic.rooms.masks import coco_dataset, instances_of
from tests.synthetic.rooms.render import Renderer
from tests.synthetic.rooms.world import World

__all__ = ["WRITERS", "RenderedViews", "exr_bytes", "rendered_views", "write_output"]

Array = NDArray[Any]
#: Depth of pixels without a surface.
SKY_M = 200.0


@dataclass(frozen=True, slots=True, eq=False)
class RenderedViews:
    """Rendered depth maps (n, h, w) and poses, in units of `scale` metres.

    rotation, centre : (n, 3, 3) from world to camera, and (n, 3).
    intrinsics : (n, 3, 3) in pixels of the maps.
    points : (n, h, w, 3) in the world.
    """

    names: tuple[str, ...]
    depth: Array
    rotation: Array
    centre: Array
    intrinsics: Array
    scale: float
    instances: tuple[Instance, ...]
    dataset: dict[str, Any]

    @property
    def points(self) -> Array:
        rows, columns = np.indices(self.depth.shape[1:]) + 0.5
        focal, middle = self.intrinsics[0, 0, 0], self.intrinsics[0, :2, 2]
        rays = np.stack([(columns - middle[0]) / focal, (rows - middle[1]) / focal, np.ones_like(rows)], axis=-1)
        local = rays * self.depth[..., None]
        return np.asarray(np.einsum("nij,nhwi->nhwj", self.rotation, local) + self.centre[:, None, None])

    def matrices(self, *, to_camera: bool) -> Array:
        """Return poses (n, 4, 4)."""
        matrices = np.tile(np.eye(4), (len(self.names), 1, 1))
        matrices[:, :3, :3] = self.rotation.transpose(0, 2, 1)
        matrices[:, :3, 3] = self.centre
        return np.linalg.inv(matrices) if to_camera else matrices


def rendered_views(world: World, scale: float = 0.4, views: int = 8, reduction: int = 2) -> RenderedViews:
    """Render evenly spaced views of a world, with maps of a fraction of the resolution of the images."""
    first = 0 if views > 1 else len(world.poses) // 2
    chosen = np.linspace(first, len(world.poses) - 1, views).round().astype(int)
    with Renderer(world) as renderer:
        frames = [renderer.frame(int(index), colour=False) for index in chosen]
    depth = np.stack([frame.depth[reduction // 2 :: reduction, reduction // 2 :: reduction] for frame in frames])
    poses = [world.poses[index] for index in chosen]
    camera = world.camera
    size = (camera.width / reduction, camera.height / reduction)
    matrix = np.array(
        [[camera.focal / reduction, 0, size[0] / 2], [0, camera.focal / reduction, size[1] / 2], [0, 0, 1]]
    )
    names = tuple(f"frame{index:03d}.png" for index in chosen)
    ids = tuple(frame.ids for frame in frames)
    return RenderedViews(
        names,
        np.where(np.isfinite(depth), depth, SKY_M) / scale,
        np.stack([pose.rotation for pose in poses]),
        np.stack([pose.centre for pose in poses]) / scale,
        np.tile(matrix, (views, 1, 1)),
        scale,
        instances_of(world, ids),
        coco_dataset(world, ids, list(names)),
    )


def write_output(network: str, views: RenderedViews, folder: Path, poses: Array | None = None) -> Path:
    """Write the output of a network with its images and masks, perhaps with other poses (n, 4, 4); return the scene."""
    images = folder / "images"
    images.mkdir(parents=True)
    height, width = views.dataset["images"][0]["height"], views.dataset["images"][0]["width"]
    for name in views.names:
        cv2.imwrite(str(images / name), np.zeros((height, width), dtype=np.uint8))
    (folder / "instances.json").write_text(json.dumps(views.dataset))
    writer, to_camera = WRITERS[network]
    return writer(views, views.matrices(to_camera=to_camera) if poses is None else poses, folder)


def _vggt(views: RenderedViews, poses: Array, folder: Path) -> Path:
    """facebookresearch/vggt(-omega), demo_gradio.py: float arrays of the model, without the batch axis."""
    arrays = {
        "extrinsic": poses[:, :3],
        "intrinsic": views.intrinsics,
        "depth": views.depth[..., None],
        "depth_conf": _confidence(views),
        "world_points_from_depth": views.points,
        "images": np.zeros((len(views.names), 3, *views.depth.shape[1:])),
    }
    _save(folder / "predictions.npz", arrays)
    return folder


def _pi3(views: RenderedViews, poses: Array, folder: Path) -> Path:
    """yyfz/Pi3, demo_gradio.py: `conf` after the sigmoid, 0 at depth edges; `local_points` is deleted."""
    arrays = {"points": views.points, "camera_poses": poses, "conf": _confidence(views)[..., None] / 10}
    _save(folder / "predictions.npz", arrays)
    return folder


def _depth_anything_3(views: RenderedViews, poses: Array, folder: Path) -> Path:
    """ByteDance-Seed/Depth-Anything-3, utils/export/npz.py."""
    (folder / "exports" / "npz").mkdir(parents=True)
    np.savez_compressed(
        folder / "exports" / "npz" / "results.npz",
        image=np.zeros((*views.depth.shape, 3), dtype=np.uint8),
        depth=np.round(views.depth, 6).astype(np.float32),
        conf=_confidence(views).astype(np.float32),
        extrinsics=poses[:, :3].astype(np.float32),
        intrinsics=views.intrinsics.astype(np.float32),
    )
    return folder


def _streaming(views: RenderedViews, poses: Array, folder: Path) -> Path:
    """da3_streaming.py: flattened 4 x 4 matrices, fx fy cx cy, and an archive for each frame."""
    (folder / "results_output").mkdir()
    (folder / "camera_poses.txt").write_text("".join(" ".join(map(str, pose.ravel())) + "\n" for pose in poses))
    lines = [f"{matrix[0, 0]} {matrix[1, 1]} {matrix[0, 2]} {matrix[1, 2]}\n" for matrix in views.intrinsics]
    (folder / "intrinsic.txt").write_text("".join(lines))
    for row, depth in enumerate(views.depth):
        np.savez_compressed(folder / "results_output" / f"frame_{row}.npz", depth=depth, conf=_confidence(views)[row])
    return folder


def _cut3r(views: RenderedViews, poses: Array, folder: Path) -> Path:
    """CUT3R/CUT3R, demo.py: the coloured images are those of the network."""
    for name in ("depth", "conf", "camera", "color"):
        (folder / name).mkdir()
    for row, depth in enumerate(views.depth):
        np.save(folder / "depth" / f"{row:06d}.npy", depth.astype(np.float32))
        np.save(folder / "conf" / f"{row:06d}.npy", _confidence(views)[row].astype(np.float32))
        camera = {"pose": poses[row].astype(np.float32), "intrinsics": views.intrinsics[row].astype(np.float32)}
        np.savez(folder / "camera" / f"{row:06d}.npz", **camera)
    return folder


def _vipe(views: RenderedViews, poses: Array, folder: Path) -> Path:
    """nv-tlabs/vipe, vipe/utils/io.py: `data` and `inds`, and zipped half-float EXR files."""
    for name in ("pose", "intrinsics", "depth"):
        (folder / name).mkdir()
    rows = np.arange(len(poses))
    numbers = views.intrinsics[:, [0, 1, 0, 1], [0, 1, 2, 2]]
    np.savez(folder / "pose" / "walk.npz", data=poses.astype(np.float32), inds=rows)
    np.savez(folder / "intrinsics" / "walk.npz", data=numbers.astype(np.float32), inds=rows)
    with zipfile.ZipFile(folder / "depth" / "walk.zip", "w", zipfile.ZIP_STORED) as archive:
        for row, depth in enumerate(views.depth):
            archive.writestr(f"{row:05d}.exr", exr_bytes({"Z": depth}))
    return folder


def _megasam(views: RenderedViews, poses: Array, folder: Path) -> Path:
    """mega-sam/mega-sam, cvd_opt/cvd_opt.py: one matrix of intrinsics, depths as half floats from 1e-3 to 1e2."""
    np.savez(
        folder / "walk_sgd_cvd_hr.npz",
        images=np.zeros((*views.depth.shape, 3), dtype=np.uint8),
        depths=np.clip(views.depth.astype(np.float16), 1e-3, 1e2),
        intrinsic=views.intrinsics[0],
        cam_c2w=poses,
    )
    return folder


#: Writer of each network, and whether its poses are from world to camera.
WRITERS: dict[str, tuple[Callable[[RenderedViews, Array, Path], Path], bool]] = {
    "VGGT": (_vggt, True),
    "Pi3": (_pi3, False),
    "Depth Anything 3": (_depth_anything_3, True),
    "Depth Anything 3 streaming": (_streaming, False),
    "CUT3R": (_cut3r, False),
    "ViPE": (_vipe, False),
    "MegaSaM": (_megasam, False),
}


def _save(file: Path, arrays: dict[str, Array]) -> None:
    single: dict[str, Any] = {name: array.astype(np.float32) for name, array in arrays.items()}
    np.savez(file, **single)


def _confidence(views: RenderedViews) -> Array:
    """Return confidences (n, h, w) that decrease with the depth."""
    return np.asarray(10 / (1 + views.depth * views.scale))


def exr_bytes(channels: dict[str, Array], kind: type[np.generic] = np.float16) -> bytes:
    """Return an OpenEXR file with ZIP compression of channels (h, w)."""
    height, width = next(iter(channels.values())).shape
    number, names = 1 if kind is np.float16 else 2, sorted(channels)
    table = b"".join(name.encode() + b"\0" + struct.pack("<iB3xii", number, 0, 1, 1) for name in names) + b"\0"
    box = struct.pack("<4i", 0, 0, width - 1, height - 1)
    fields = (
        (b"channels", b"chlist", table),
        (b"compression", b"compression", b"\x03"),
        (b"dataWindow", b"box2i", box),
        (b"displayWindow", b"box2i", box),
        (b"lineOrder", b"lineOrder", b"\0"),
        (b"pixelAspectRatio", b"float", struct.pack("<f", 1)),
        (b"screenWindowCenter", b"v2f", struct.pack("<2f", 0, 0)),
        (b"screenWindowWidth", b"float", struct.pack("<f", 1)),
    )
    head = struct.pack("<II", 20000630, 2)
    head += b"".join(name + b"\0" + kind_ + b"\0" + struct.pack("<i", len(data)) + data for name, kind_, data in fields)
    head += b"\0"
    blocks = []
    for first in range(0, height, 16):
        lines = range(first, min(first + 16, height))
        raw = b"".join(channels[name][line].astype(kind).tobytes() for line in lines for name in names)
        halves = np.frombuffer(raw[0::2] + raw[1::2], dtype=np.uint8).astype(np.int64)
        steps = halves.copy()
        steps[1:] = halves[1:] - halves[:-1] + 128
        packed = zlib.compress(steps.astype(np.uint8).tobytes())
        blocks.append((first, packed if len(packed) < len(raw) else raw))
    out, position = io.BytesIO(), len(head) + 8 * len(blocks)
    out.write(head)
    for _, data in blocks:
        out.write(struct.pack("<Q", position))
        position += 8 + len(data)
    for first, data in blocks:
        out.write(struct.pack("<ii", first, len(data)) + data)
    return out.getvalue()

"""`--layers DIR`: what each picture was joined from, as OpenEXR files for a compositing program.

In linear light: picture = plate * shadow * (1 - A) + RGB, with A and RGB of `object`; encoded as sRGB.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.projection.cameras import project
from estimator.records.scene import Camera
from insertion.colour import srgb_to_linear
from insertion.composite.camera_look import REACH_PX
from insertion.composite.compose import Composite, Joined
from insertion.footage.footage import Shot
from insertion.insertion_scene import PreparedScene
from insertion.placement.placed_object import Placed
from insertion.render.layers import window_behind
from insertion.scene.camera_rays import camera_rays
from insertion.scene.pixel_box import PixelBox
from metric_base.arrays import FloatArray
from metric_base.images import write_picture

SCHEMA = "metric-tree/layers/1"
#: FFmpeg's pixel formats by the number of channels, and the order of the channels in their planes.
_FORMATS = {1: ("grayf32le", (0,)), 3: ("gbrpf32le", (1, 2, 0)), 4: ("gbrapf32le", (1, 2, 0, 3))}
#: Coverage counts beside an object, where its blur reaches, so much of what it counts on it.
BESIDE = 1e-3
#: What is in each folder, as `layers.json` says it.
LAYERS = {
    "plate": "the picture without objects, linear RGB",
    "object": "all objects as they are seen, linear RGB premultiplied by A, with blur and grain; half",
    "object_N": "what is of object N in `object`, where there are several: they add up to it; half",
    "shadow": "share of the plate's light that is left, RGB; half",
    "occlusion": "share in which something hides the nearest object; half",
    "depth": "depth of the nearest object along the optical axis in metres, 0 without one; float",
    "normal": "geometric normal of the nearest object in the camera (x right, y down, z ahead); half",
    "id": "number of the nearest object from 1, 0 without one; 8 bits",
    "undistorted": "the plate without the lens; half",
    "matte": "occlusion without the lens; half",
    "distortion": "for each pixel of the picture, x and y in the undistorted plate (first pixel 0.5), 0; float",
}


class CompositingLayers:
    """Writes the layers of each picture into an existing folder; a picture without objects has a plate alone."""

    def __init__(self, folder: Path, prepared: PreparedScene, objects: Sequence[Placed]) -> None:
        self._folder, self._metres = folder, prepared.scale.metres_per_unit
        # numbered from 1 without gaps, as programs read a sequence
        self._names = {shot.name: Path(f"{shot.index + 1:06d}.exr") for shot in prepared.footage.shots}
        self._joined: dict[int, Joined] = {}
        self._several = len(objects) > 1
        self._cameras: dict[bytes, tuple[str, NDArray[np.float32]]] = {}
        self._plate: NDArray[np.uint8] = np.zeros((0, 0, 3), np.uint8)
        record = {
            "schema": SCHEMA,
            "formula": "linear(picture) = plate * shadow * (1 - object.A) + object.RGB; sRGB encoding (IEC 61966-2-1)",
            "layers": LAYERS,
            "objects": {number: item.model.name for number, item in enumerate(objects, start=1)},
            "pictures": {shot.name: self._names[shot.name].as_posix() for shot in prepared.footage.shots},
        }
        (folder / "layers.json").write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")

    def picture(self, shot: Shot, picture: NDArray[np.uint8]) -> None:
        """Write the plate (h, w, 3), with and without its lens."""
        self._plate, self._joined = picture, {}
        light = srgb_to_linear(picture)
        self._write("plate", shot, light, half=False)
        if shot.view is not None:
            self._write("undistorted", shot, self._straight(shot.view.camera, light))

    def layers(self, shot: Shot, number: int, joined: Joined) -> None:
        """Keep the layers of one object until the picture is whole."""
        assert shot.name in self._names
        self._joined[number] = joined

    def composite(self, shot: Shot, composite: Composite) -> None:
        """Write what the picture was joined from."""
        shape = self._plate.shape[:2]
        whole = np.zeros((*shape, 4), np.float32)
        shadow = np.ones((*shape, 3), np.float32)
        whole[..., :3], whole[composite.box.slices][..., 3] = 0.0, composite.covering[..., 3]
        shadow[composite.box.slices] = composite.share
        # what the eight bits of the picture hold beyond the plate: object, blur and grain in one
        rest = srgb_to_linear(self._plate) * shadow * (1 - whole[..., 3:])
        seen = whole[..., 3] > 0
        whole[seen, :3] = (srgb_to_linear(composite.picture) - rest)[seen]
        self._write("object", shot, whole)
        for own, share in self._shares(shape).items() if self._several else ():
            self._write(f"object_{own}", shot, whole * share[..., None])
        self._write("shadow", shot, shadow)
        depth, hidden, number = self._nearest(shape)
        self._write("depth", shot, np.nan_to_num(depth * self._metres, posinf=0.0), half=False)
        self._write("occlusion", shot, hidden)
        if shot.view is not None:
            self._write("matte", shot, self._straight(shot.view.camera, hidden))
            self._write("normal", shot, _normals(depth, camera_rays(shot.view.camera)))
        name = self._names[shot.name].with_suffix(".png")
        write_picture(self._folder / "id" / name, number)

    def _shares(self, shape: tuple[int, ...]) -> dict[int, NDArray[np.float32]]:
        """By its number from 1, the (h, w) share of each object in what is seen: by coverage, or by what is near."""
        import cv2

        covers = {number + 1: joined.whole(shape)[0] for number, joined in self._joined.items()}
        covers = {number: own + BESIDE * cv2.GaussianBlur(own, (0, 0), REACH_PX / 3) for number, own in covers.items()}
        total = np.maximum(sum(covers.values(), np.zeros(shape, np.float32)), 1e-12)
        return {number: np.asarray(own / total, dtype=np.float32) for number, own in covers.items()}

    def _nearest(self, shape: tuple[int, ...]) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]:
        """(h, w) depth in scene units (infinite without), hidden share and number of the nearest object."""
        depth = np.full(shape, np.inf, np.float32)
        hidden, number = np.zeros(shape, np.float32), np.zeros(shape, np.uint8)
        for own, joined in self._joined.items():
            part = joined.layers.box.slices
            nearer = np.nan_to_num(joined.layers.image.depth, nan=np.inf) < depth[part]
            depth[part][nearer] = joined.layers.image.depth[nearer]
            hidden[part][nearer] = joined.hidden[nearer]
            number[part][nearer] = own + 1
        return depth, hidden, number

    def _straight(self, camera: Camera, layer: NDArray[np.float32]) -> NDArray[np.float32]:
        """A layer (h, w) or (h, w, 3) without the lens; the map of a camera is written once."""
        import cv2

        key = camera.model.encode() + camera.params.tobytes()
        if key not in self._cameras:
            there, back = _lens_maps(camera)
            self._cameras[key] = f"distortion/{len(self._cameras)}.exr", back
            _save(self._folder / self._cameras[key][0], exr_bytes(there, half=False))
        back = self._cameras[key][1]
        return np.asarray(cv2.remap(layer, back[..., 0], back[..., 1], cv2.INTER_LINEAR), dtype=np.float32)

    def _write(self, layer: str, shot: Shot, pixels: NDArray[np.float32], half: bool = True) -> None:
        """Write a layer (h, w) or (h, w, c) of a picture."""
        _save(self._folder / layer / self._names[shot.name], exr_bytes(pixels, half=half))


def _lens_maps(camera: Camera) -> tuple[FloatArray, NDArray[np.float32]]:
    """(h, w, 3) where each pixel of the picture is in the straight one, and (a, b, 2) the way back, for OpenCV."""
    window = window_behind(camera, PixelBox(0, 0, camera.width, camera.height))
    rays = camera_rays(camera)
    there = np.dstack([
        rays[..., 0] * window.fx + (window.cx - window.x0),
        rays[..., 1] * window.fy + (window.cy - window.y0),
        np.zeros(rays.shape[:2]),
    ])  # fmt: skip
    x, y = np.meshgrid(np.arange(window.width) + 0.5, np.arange(window.height) + 0.5)
    flat = np.stack([(x + window.x0 - window.cx) / window.fx, (y + window.y0 - window.cy) / window.fy, 0 * x + 1], -1)
    at = project(camera, flat.reshape(-1, 3)).reshape(*x.shape, 2)
    return there, np.nan_to_num(at - 0.5, nan=-9.0).astype(np.float32)


def exr_bytes(pixels: NDArray[np.floating], half: bool = True) -> bytes:
    """(h, w), (h, w, 3) or (h, w, 4) pixels as an OpenEXR file, of half floats or whole ones."""
    import av

    stacked = pixels[..., None] if pixels.ndim == 2 else pixels
    height, width, channels = stacked.shape
    name, order = _FORMATS[channels]
    context: Any = av.codec.CodecContext.create("exr", "w")
    context.width, context.height, context.pix_fmt, context.time_base = width, height, name, Fraction(1, 25)
    context.options = {"format": "half" if half else "float", "compression": "zip16"}
    frame = av.VideoFrame(width, height, name)
    for plane, channel in zip(frame.planes, order, strict=True):
        rows = np.frombuffer(memoryview(plane), np.uint8).reshape(height, -1)
        rows[:, : 4 * width] = np.ascontiguousarray(stacked[..., channel], np.float32).view(np.uint8)
    frame.pts = 0
    return b"".join(bytes(packet) for packet in [*context.encode(frame), *context.encode(None)])


def _save(file: Path, data: bytes) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(data)


def _normals(depth: NDArray[np.float32], rays: NDArray[np.float32]) -> NDArray[np.float32]:
    """(h, w, 3) unit normals towards the camera of a depth (h, w) on rays (h, w, 2); 0 where nothing is known."""
    places = (
        np.dstack([rays, np.ones(depth.shape, np.float32)]) * np.where(np.isfinite(depth), depth, np.nan)[..., None]
    )
    down, across = np.gradient(places, axis=0), np.gradient(places, axis=1)
    normal = np.cross(down, across)
    with np.errstate(invalid="ignore", divide="ignore"):
        normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
        normal = np.where((normal * places).sum(axis=-1, keepdims=True) > 0, -normal, normal)
    return np.asarray(np.nan_to_num(normal), dtype=np.float32)

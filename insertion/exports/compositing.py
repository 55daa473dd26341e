"""`--layers DIR`: the layers of each frame as OpenEXR files for compositing programs.

In linear light, image = plate * shadow * (1 - A) + RGB with A and RGB of `object`; the image is encoded as sRGB.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.projection.cameras import project
from estimator.records.scene import Camera
from insertion.colour import srgb_to_linear
from insertion.composite.camera_look import MAX_BLUR_REACH_PX
from insertion.composite.compose import Composite, ObjectComposite
from insertion.footage.footage import Frame
from insertion.placement.placed_object import PlacedObject
from insertion.render.layers import window_behind
from insertion.scene.camera_rays import camera_rays, surface_normals
from insertion.scene.pixel_box import PixelBox
from metric_base.arrays import FloatArray
from metric_base.images import write_image
from metric_base.text_tables import named_texts

SCHEMA = "metric-tree/layers/1"
#: Pixel format of FFmpeg and order of the channels in its planes, by the number of channels.
_FORMATS = {1: ("grayf32le", (0,)), 3: ("gbrpf32le", (1, 2, 0)), 4: ("gbrapf32le", (1, 2, 0, 3))}
#: Weight of the blurred coverage of an object relative to its sharp coverage.
BLUR_WEIGHT = 1e-3
#: Content of each folder, for `layers.json`.
LAYERS = named_texts(Path(__file__).with_name("layers.txt"))


class CompositingLayers:
    """Writes the layers of each frame to an existing folder; a frame without objects has only a plate."""

    def __init__(
        self, folder: Path, objects: Sequence[PlacedObject], frames: Sequence[Frame], metres_per_unit: float
    ) -> None:
        self._folder, self._metres = folder, metres_per_unit
        self._names = {frame.name: Path(f"{frame.index:06d}.exr") for frame in frames}
        self._layered: dict[int, ObjectComposite] = {}
        self._several = len(objects) > 1
        self._cameras: dict[bytes, tuple[str, NDArray[np.float32]]] = {}
        self._plate: NDArray[np.uint8] = np.zeros((0, 0, 3), np.uint8)
        record = {
            "schema": SCHEMA,
            "formula": "linear(picture) = plate * shadow * (1 - object.A) + object.RGB; sRGB encoding (IEC 61966-2-1)",
            "layers": LAYERS,
            "objects": {number: item.model.name for number, item in enumerate(objects, start=1)},
            "pictures": {frame.name: self._names[frame.name].as_posix() for frame in frames},
        }
        (folder / "layers.json").write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")

    def plate(self, frame: Frame, image: NDArray[np.uint8]) -> None:
        """Write the plate (h, w, 3), with and without lens distortion."""
        self._plate, self._layered = image, {}
        light = srgb_to_linear(image)
        self._write("plate", frame, light, half=False)
        if frame.view is not None:
            self._write("undistorted", frame, self._straight(frame.view.camera, light))

    def layers(self, frame: Frame, index: int, item: ObjectComposite) -> None:
        """Store the layers of an object until the frame is composited."""
        assert frame.name in self._names
        self._layered[index] = item

    def composite(self, frame: Frame, composite: Composite) -> None:
        """Write the layers of the composited frame."""
        shape = self._plate.shape[:2]
        whole = np.zeros((*shape, 4), np.float32)
        shadow = np.ones((*shape, 3), np.float32)
        whole[..., :3], whole[composite.box.slices][..., 3] = 0.0, composite.visible_foreground[..., 3]
        shadow[composite.box.slices] = composite.visible_transmittance
        # difference of the 8-bit image from the shadowed plate: object, blur and grain
        rest = srgb_to_linear(self._plate) * shadow * (1 - whole[..., 3:])
        seen = whole[..., 3] > 0
        whole[seen, :3] = (srgb_to_linear(composite.image) - rest)[seen]
        self._write("object", frame, whole)
        for own, share in self._shares(shape).items() if self._several else ():
            self._write(f"object_{own}", frame, whole * share[..., None])
        self._write("shadow", frame, shadow)
        depth, hidden, number = self._nearest(shape)
        self._write("depth", frame, np.nan_to_num(depth * self._metres, posinf=0.0), half=False)
        self._write("occlusion", frame, hidden)
        if frame.view is not None:
            self._write("matte", frame, self._straight(frame.view.camera, hidden))
            self._write("normal", frame, surface_normals(depth, camera_rays(frame.view.camera)))
        name = self._names[frame.name].with_suffix(".png")
        write_image(self._folder / "id" / name, number)

    def _shares(self, shape: tuple[int, ...]) -> dict[int, NDArray[np.float32]]:
        """Return the fraction (h, w) of each object in the visible foreground, by its number from 1."""
        covers = {number + 1: item.full_size(shape)[0] for number, item in self._layered.items()}
        covers = {
            number: own + BLUR_WEIGHT * cv2.GaussianBlur(own, (0, 0), MAX_BLUR_REACH_PX / 3)
            for number, own in covers.items()
        }
        total = np.maximum(sum(covers.values(), np.zeros(shape, np.float32)), 1e-12)
        return {number: np.asarray(own / total, dtype=np.float32) for number, own in covers.items()}

    def _nearest(self, shape: tuple[int, ...]) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]:
        """Return depth in scene units, occluded fraction and number of the nearest object, (h, w) each."""
        depth = np.full(shape, np.inf, np.float32)
        hidden, number = np.zeros(shape, np.float32), np.zeros(shape, np.uint8)
        for own, item in self._layered.items():
            part = item.layers.box.slices
            nearer = np.nan_to_num(item.layers.image.depth, nan=np.inf) < depth[part]
            depth[part][nearer] = item.layers.image.depth[nearer]
            hidden[part][nearer] = item.occluded[nearer]
            number[part][nearer] = own + 1
        return depth, hidden, number

    def _straight(self, camera: Camera, layer: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return a layer (h, w) or (h, w, 3) without lens distortion; the map of each camera is written once."""
        key = camera.model.encode() + camera.params.tobytes()
        if key not in self._cameras:
            there, back = lens_maps(camera)
            self._cameras[key] = f"distortion/{len(self._cameras)}.exr", back
            _save(self._folder / self._cameras[key][0], exr_bytes(there, half=False))
        back = self._cameras[key][1]
        return np.asarray(cv2.remap(layer, back[..., 0], back[..., 1], cv2.INTER_LINEAR), dtype=np.float32)

    def _write(self, layer: str, frame: Frame, pixels: NDArray[np.float32], half: bool = True) -> None:
        """Write a layer (h, w) or (h, w, c) of a frame."""
        _save(self._folder / layer / self._names[frame.name], exr_bytes(pixels, half=half))


def lens_maps(camera: Camera) -> tuple[FloatArray, NDArray[np.float32]]:
    """Return the map from an image to the undistorted image, and its inverse.

    Returns
    -------
    there : (h, w, 3) ndarray of float
        Position x, y of each pixel in the undistorted image (centre of the first pixel 0.5), and 0.
    back : (a, b, 2) ndarray of float32
        Source position x, y of each undistorted pixel in the image (OpenCV: centre of the first pixel 0).
    """
    window = window_behind(camera, PixelBox(0, 0, camera.width, camera.height))
    rays = camera_rays(camera)
    there = np.dstack([
        rays[..., 0] * window.fx + (window.cx - window.x0),
        rays[..., 1] * window.fy + (window.cy - window.y0),
        np.zeros(rays.shape[:2]),
    ])  # fmt: skip
    x, y = np.meshgrid(np.arange(window.width) + 0.5, np.arange(window.height) + 0.5)
    flat = np.stack([(x + window.x0 - window.cx) / window.fx, (y + window.y0 - window.cy) / window.fy, 0 * x + 1], -1)
    pixels = project(camera, flat.reshape(-1, 3)).reshape(*x.shape, 2)
    return there, np.nan_to_num(pixels - 0.5, nan=-9.0).astype(np.float32)


def exr_bytes(pixels: NDArray[np.floating], half: bool = True) -> bytes:
    """Return pixels (h, w), (h, w, 3) or (h, w, 4) as an OpenEXR file of half or single precision."""
    import av

    stacked = pixels[..., None] if pixels.ndim == 2 else pixels
    height, width, channels = stacked.shape
    name, order = _FORMATS[channels]
    context: Any = av.codec.CodecContext.create("exr", "w")
    context.width, context.height, context.pix_fmt, context.time_base = width, height, name, Fraction(1, 25)
    context.options = {"format": "half" if half else "float", "compression": "zip16"}
    transform = av.VideoFrame(width, height, name)
    for plane, channel in zip(transform.planes, order, strict=True):
        rows = np.frombuffer(memoryview(plane), np.uint8).reshape(height, -1)
        rows[:, : 4 * width] = np.ascontiguousarray(stacked[..., channel], np.float32).view(np.uint8)
    transform.pts = 0
    return b"".join(bytes(packet) for packet in [*context.encode(transform), *context.encode(None)])


def _save(file: Path, data: bytes) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(data)

"""Compare the exported layers of real footage with the composited frames.

    insert-object SCENE --scale S --model A.glb ... --frames F:L --out OUT --layers LAYERS
    python -m benchmarks.insertion.real_frames OUT LAYERS SCENE

Prints for each frame: the fraction of pixels that a recomposition of the layers by FFmpeg's decoder and NumPy
reproduces, the number of changed pixels inside masks of occluders, and the grain of the frame and of the objects.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from estimator.instances.instance_reader import read_instances
from estimator.reconstructions.scene_reader import read_scene
from estimator.records.scene import Instance
from insertion.colour import linear_to_srgb
from insertion.composite.camera_look import measure_look
from insertion.insertion_scene import open_scene
from insertion.request import SceneSource
from insertion.scene.pixel_box import PixelBox, mask_in_box
from insertion.scene.point_cloud import ColouredPoints, VisiblePoints
from insertion.scene.scale import read_scale

#: Minimum occluded fraction of the object's pixels in the mask of an occluder.
MIN_OCCLUDED_FRACTION = 0.97
_NO_POINTS = VisiblePoints(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0), False)
_EMPTY_CLOUD = ColouredPoints(np.zeros((0, 3)), np.zeros((0, 3), np.float32), False)


def read_exr(file: Path) -> np.ndarray:
    """Read an OpenEXR file (h, w, c) with FFmpeg."""
    import av

    with av.open(str(file)) as container:
        frame = next(container.decode(video=0))
    name = frame.format.name
    kind = np.dtype(np.float16 if name.endswith("16le") else np.float32)
    order = {"gray": (0,), "gbrp": (2, 0, 1), "gbra": (2, 0, 1, 3)}[name[:4]]
    planes = [np.frombuffer(bytes(p), kind).reshape(frame.height, -1)[:, : frame.width] for p in frame.planes]
    return np.stack([planes[k] for k in order], axis=-1).astype(np.float32)


def main() -> None:
    """Compare the frames and print one line of JSON for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("layers", type=Path)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--moving", type=Path, help="masks of moving objects, as passed to insert-object")
    options = parser.parse_args()
    masks = _masks_by_frame(options.scene, options.moving)
    for name, layer in json.loads((options.layers / "layers.json").read_text())["pictures"].items():
        print(name, json.dumps(_frame(options, name, layer, masks.get(name, []))))


def _masks_by_frame(folder: Path, moving: Path | None) -> dict[str, list[Instance]]:
    """Return the masks of each frame: of moving objects if their file is given, otherwise the masks of the scene."""
    if moving is not None:
        prepared = open_scene(SceneSource(folder=folder, scale=read_scale(folder, None), moving=moving))
        return {shot.name: list(prepared.content.moving.get(shot.index, ())) for shot in prepared.footage.frames}
    scene = read_scene(folder)
    has_masks = any((folder / name).exists() for name in ("instances.json", "instances"))
    instances = read_instances(None, scene) if has_masks else ()
    return {view.name: [i for i in instances if i.view == row] for row, view in enumerate(scene.views)}


def _frame(options: argparse.Namespace, name: str, layer: str, masks: list[Instance]) -> dict[str, float]:
    import cv2

    frame = np.asarray(cv2.imread(str(options.out / f"{Path(name).stem}.png")))[..., ::-1]
    covering, plate = (read_exr(options.layers / kind / layer) for kind in ("object", "plate"))
    before = np.rint(linear_to_srgb(plate)).astype(np.uint8)
    light = plate * read_exr(options.layers / "shadow" / layer) * (1 - covering[..., 3:]) + covering[..., :3]
    again = np.rint(linear_to_srgb(light))
    changed = (frame != before).any(axis=-1)
    is_object = read_exr(options.layers / "depth" / layer)[..., 0] > 0
    occluded = read_exr(options.layers / "occlusion" / layer)[..., 0]
    full = PixelBox(0, 0, frame.shape[1], frame.shape[0])
    inside = occluders = 0
    for item in masks:
        mask = mask_in_box(item, full)
        if mask is None or not (mask & is_object).any() or occluded[mask & is_object].mean() < MIN_OCCLUDED_FRACTION:
            continue
        eroded = cv2.erode(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
        inside, occluders = inside + int((changed & eroded).sum()), occluders + 1
    opaque = cv2.erode((covering[..., 3] > 0.99).astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    levels = measure_look(before, _NO_POINTS, _EMPTY_CLOUD).grain.mean()
    detail = frame.astype(np.float32) - cv2.GaussianBlur(frame, (0, 0), 2.0)
    texture = cv2.GaussianBlur(np.abs(detail).mean(axis=-1), (0, 0), 3.0)
    flat = opaque & (texture < np.quantile(np.abs(detail)[opaque], 0.5))
    return {
        "recomposed_within_one": round(float((np.abs(again - frame) <= 1).mean()), 5),
        "recomposed_same": round(float((again == frame).mean()), 4),
        "changed_pixels": int(changed.sum()),
        "masks_in_front": occluders,
        "changed_in_front": inside,
        "grain_frame": round(float(levels), 2),
        "grain_object": round(float(detail[flat].std()) if flat.any() else 0.0, 2),
    }


if __name__ == "__main__":
    main()

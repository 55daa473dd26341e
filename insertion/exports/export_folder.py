"""`--export DIR`: the insertion for other programs, in metres."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimator.outputs.rescaled import write_rescaled
from estimator.records.scene import Scene
from insertion.composite.compose import Composite, ObjectComposite
from insertion.exports.gltf_scene import write_gltf_scene
from insertion.exports.metric_frame import camera_keyframes, frame_rate, metric_transform
from insertion.exports.nerfstudio import write_transforms
from insertion.footage.footage import Frame
from insertion.placement.placed_object import PlacedObject
from insertion.result import InsertionResult
from metric_base.files import OutputNames, output_names
from metric_base.images import IMAGE_SUFFIXES, write_image

#: Maximum depth of a 16-bit image in millimetres.
MAX_DEPTH_MM = 65_535


def write_exports(
    folder: Path,
    scene: Scene,
    objects: Sequence[PlacedObject],
    frames: Sequence[Frame],
    results: Sequence[InsertionResult],
) -> list[str]:
    """Write the exports to an existing folder and return a line for each file that was not written.

    The files are `scene.glb`, `scene.usda` with `textures/`, `transforms.json` with `sparse_pc.ply`, `colmap/`, and
    `insertion.json` with the output of `--json`.
    """
    transform = metric_transform(objects)
    names = image_names(frames)
    keys = [replace(key, name=names[key.name].as_posix()) for key in camera_keyframes(frames, transform)]
    write_gltf_scene(folder / "scene.glb", objects, keys, transform)
    write_transforms(folder / "transforms.json", keys, "pictures", transform(scene.points))
    write_rescaled(scene, transform.scale, folder / "colmap")
    records = [result.to_json() for result in results]
    (folder / "insertion.json").write_text(json.dumps(records, indent=1) + "\n", encoding="utf-8")
    try:
        from insertion.exports.usd_scene import write_usd_scene

        write_usd_scene(folder / "scene.usda", objects, keys, transform, frame_rate(frames))
    except ModuleNotFoundError:
        return ["scene.usda is not written: pip install 'metric-tree[usd]'"]
    return []


def image_names(frames: Sequence[Frame]) -> dict[str, Path]:
    """Return the path of each image in the folder of images; names from a model file cannot lead out of this folder."""
    paths = output_names(
        frame.name if Path(frame.name).suffix.lower() in IMAGE_SUFFIXES else f"{frame.name}.png" for frame in frames
    )
    return dict(zip((frame.name for frame in frames), paths.values(), strict=True))


class LayerWriter:
    """Writes the plates, and the depth in millimetres and the mask of each object in each frame."""

    def __init__(self, folder: Path, frames: Sequence[Frame], metres_per_unit: float) -> None:
        self._folder, self._millimetres = folder, 1000 * metres_per_unit
        self._names, free = image_names(frames), OutputNames(Path())
        self._layers = {frame.name: free.path(f"{Path(frame.name).with_suffix('')}.png") for frame in frames}
        self._shape: tuple[int, ...] = (0, 0)
        for name in ("pictures", "depth", "mask"):
            (folder / name).mkdir()

    def plate(self, frame: Frame, image: NDArray[np.uint8]) -> None:
        """Write the unchanged image (h, w, 3) with its name in `transforms.json`."""
        self._shape = image.shape
        write_image(self._folder / "pictures" / self._names[frame.name], image[..., ::-1])

    def layers(self, frame: Frame, index: int, item: ObjectComposite) -> None:
        """Write the visible coverage (h, w) of an object, 0 to 255, and its depth (h, w) in 16 bits.

        The depth is 0 outside the object and beyond `MAX_DEPTH_MM`.
        """
        alpha, depth = item.full_size(self._shape)
        name = self._layers[frame.name]
        file = name.with_name(f"{name.stem}_{index + 1}.png")
        write_image(self._folder / "mask" / file, np.rint(255 * alpha).astype(np.uint8))
        deep = np.rint(np.nan_to_num(depth * self._millimetres, nan=0.0))
        write_image(self._folder / "depth" / file, np.where(deep <= MAX_DEPTH_MM, deep, 0).astype(np.uint16))

    def composite(self, frame: Frame, composite: Composite) -> None:
        """Do nothing, because masks and depth are written already."""

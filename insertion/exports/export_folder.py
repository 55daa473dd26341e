"""`--export DIR`: the insertion for other programs, everything at 1 unit = 1 m."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture.sources.image_folder import PICTURE_SUFFIXES
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
from metric_base.images import write_picture

#: The largest depth that 16 bits hold in millimetres.
FARTHEST_MM = 65_535


def write_exports(
    folder: Path,
    scene: Scene,
    objects: Sequence[PlacedObject],
    frames: Sequence[Frame],
    metres_per_unit: float,
    results: Sequence[InsertionResult],
) -> list[str]:
    """Write into an existing folder; what could not be written, one line each.

    `scene.glb`, `scene.usda` with `textures/`, `transforms.json` with `sparse_pc.ply`, `colmap/`, and `insertion.json`,
    which has what `--json` prints.
    """
    transform = metric_transform(objects, metres_per_unit)
    names = _picture_names(frames)
    keys = [replace(key, name=names[key.name].as_posix()) for key in camera_keyframes(frames, transform)]
    write_gltf_scene(folder / "scene.glb", objects, keys, transform)
    write_transforms(folder / "transforms.json", keys, "pictures", transform(scene.points))
    write_rescaled(scene, metres_per_unit, folder / "colmap")
    records = [result.to_json() for result in results]
    (folder / "insertion.json").write_text(json.dumps(records, indent=1) + "\n", encoding="utf-8")
    try:
        from insertion.exports.usd_scene import write_usd_scene

        write_usd_scene(folder / "scene.usda", objects, keys, transform, frame_rate(frames))
    except ModuleNotFoundError:
        return ["scene.usda is not written: pip install 'metric-tree[usd]'"]
    return []


def _picture_names(frames: Sequence[Frame]) -> dict[str, Path]:
    """Where each shot's picture is in the folder of pictures; a name of a model never leads out of it."""
    paths = output_names(
        frame.name if Path(frame.name).suffix.lower() in PICTURE_SUFFIXES else f"{frame.name}.png" for frame in frames
    )
    return dict(zip((frame.name for frame in frames), paths.values(), strict=True))


class LayerWriter:
    """The pictures that the object was drawn on, and of every frame its depth in millimetres and its masks."""

    def __init__(self, folder: Path, frames: Sequence[Frame], metres_per_unit: float) -> None:
        self._folder, self._millimetres = folder, 1000 * metres_per_unit
        self._names, free = _picture_names(frames), OutputNames(Path())
        self._layers = {frame.name: free.path(f"{Path(frame.name).with_suffix('')}.png") for frame in frames}
        self._shape: tuple[int, ...] = (0, 0)
        for name in ("pictures", "depth", "mask"):
            (folder / name).mkdir()

    def plate(self, frame: Frame, image: NDArray[np.uint8]) -> None:
        """Keep the picture (h, w, 3) as it was, under the name that `transforms.json` gives it."""
        self._shape = image.shape
        write_picture(self._folder / "pictures" / self._names[frame.name], image[..., ::-1])

    def layers(self, frame: Frame, index: int, item: ObjectComposite) -> None:
        """Write one object's visible coverage (h, w), 0 to 255, and its depth (h, w), 16 bits.

        The depth is 0 where the object is not, and where it is beyond what 16 bits hold.
        """
        alpha, depth = item.full_size(self._shape)
        name = self._layers[frame.name]
        file = name.with_name(f"{name.stem}_{index}.png")
        write_picture(self._folder / "mask" / file, np.rint(255 * alpha).astype(np.uint8))
        deep = np.rint(np.nan_to_num(depth * self._millimetres, nan=0.0))
        write_picture(self._folder / "depth" / file, np.where(deep <= FARTHEST_MM, deep, 0).astype(np.uint16))

    def composite(self, frame: Frame, composite: Composite) -> None:
        """Nothing more: masks and depth are written."""

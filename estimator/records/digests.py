"""Digests of the inputs of a result, as they were read: independent of later changes of the files."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from estimator.records.objects import MeasuredObject
from estimator.records.scene import Instance, InstanceSet, Scene


def scene_digests(scene: Scene, masks: InstanceSet) -> dict[str, str | None]:
    """Return the digests of model, cloud and masks, and whether the masks are those in the folder of the scene."""
    return {
        "model": model_digest(scene),
        "cloud": None if scene.dense is None else _digest([scene.dense.points]),
        "masks": masks_digest(scene, masks.instances),
        "masks_from": "scene" if masks.is_default else None,
    }


def model_digest(scene: Scene) -> str:
    """Return the SHA-256 of the cameras, poses, observations and sparse points of a scene."""
    parts: list[Any] = []
    for view in scene.views:
        camera = view.camera
        parts.append(f"{view.name}\0{camera.model} {camera.width} {camera.height}")
        parts += (camera.params, view.rotation, view.translation, view.keypoints, view.point_index)
    return _digest([*parts, scene.points])


def masks_digest(scene: Scene, instances: Sequence[Instance]) -> str | None:
    """Return the SHA-256 of the masks with their categories and views; None without masks."""
    if not instances:
        return None
    parts = (
        part
        for one in instances
        for words in [(scene.views[one.view].name, one.category, one.track, one.origin, one.mask.shape, one.from_box)]
        for part in (f"{words} {one.score:.6g}", np.packbits(one.mask))
    )
    return _digest(parts)


def objects_digest(objects: Sequence[MeasuredObject]) -> str:
    """Return the SHA-256 of objects that another program measured."""
    parts = [part for one in objects for part in (f"{one.id}\0{one.category}", one.extents, one.sigma, one.truncated)]
    return _digest(parts)


def options_digest(options: object) -> str:
    """Return the SHA-256 of a tuple of numbers and strings."""
    return _digest([repr(options)])


def _digest(parts: Iterable[Any]) -> str:
    state = hashlib.sha256()
    for part in parts:
        data = part.encode("utf-8", "surrogatepass") if isinstance(part, str) else np.ascontiguousarray(part).tobytes()
        state.update(len(data).to_bytes(8, "little") + data)
    return state.hexdigest()

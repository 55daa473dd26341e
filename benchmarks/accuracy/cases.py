"""Scenes of the accuracy report: synthetic rooms and streets, and scenes on disk of known scale."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.accuracy.methods import Case
from estimator.instances.instance_reader import read_instances
from estimator.outputs.ground_truth import read_truth
from estimator.reconstructions.scene_reader import read_scene
from estimator.records.objects import MeasuredObject
from tests.synthetic.rooms.detections import detections_of
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.kinds import KINDS
from tests.synthetic.rooms.knobs import CLUTTERED
from tests.synthetic.rooms.quick import SyntheticScene, quick_scene
from tests.synthetic.rooms.sizes import Sizes
from tests.synthetic.rooms.street import street

__all__ = ["scenes_on_disk", "synthetic_rooms", "synthetic_streets"]

#: Standard deviation of the log of a true extent, about the accuracy of a careful measurement.
TRUE_SIGMA = 0.02


def synthetic_rooms(seeds: Sequence[int], sizes: Sizes) -> Iterator[Case]:
    """Yield cluttered rooms of every kind: with masks and dense points, masks and sparse points, or detected boxes."""
    for kind in KINDS:
        for seed in seeds:
            synthetic = quick_scene(furnished_room(kind, seed, CLUTTERED, sizes), CLUTTERED, seed)
            case = _case("synthetic rooms, masks", f"{kind} {seed}", synthetic)
            yield case
            yield replace(case, group="synthetic rooms, sparse points", scene=replace(case.scene, dense=None))
            camera = case.scene.views[0].camera
            boxes = detections_of(case.instances, (camera.width, camera.height), seed)
            yield replace(case, group="synthetic rooms, boxes", instances=boxes)


def synthetic_streets(seeds: Sequence[int], sizes: Sizes) -> Iterator[Case]:
    """Yield drives past parked and moving cars."""
    for seed in seeds:
        yield _case("synthetic streets", f"street {seed}", quick_scene(street(seed, sizes=sizes), seed=seed))


def scenes_on_disk(folder: Path) -> Iterator[Case]:
    """Yield the scenes of a folder whose `truth.json` states the scale: with masks, with sparse points, with boxes.

    Boxes are COCO results `detections*.json` with a file `detections*_categories.json` in the same folder.
    """
    for path in sorted({file.parent for file in folder.glob("*/truth.json")}):
        truth = read_truth(path)
        if truth.scale is None:
            continue
        scene = read_scene(path)
        heights = {track: sizes["height"] for track, sizes in truth.sizes.items() if "height" in sizes}
        masks = tuple(read_instances(None, scene))
        case = Case(f"{path.name}, masks", path.name, scene, masks, truth.scale, heights)
        yield case
        if scene.dense is not None:
            yield replace(case, group=f"{path.name}, sparse points", scene=replace(scene, dense=None))
        for boxes in sorted(path.glob("detections*.json")):
            categories = boxes.with_name(f"{boxes.stem}_categories.json")
            if categories.exists():
                found = tuple(read_instances(boxes, scene, categories))
                yield replace(case, group=f"{path.name}, boxes", instances=found)


def _case(group: str, name: str, synthetic: SyntheticScene) -> Case:
    """Return a synthetic scene as a case. Tilted and moving objects have no true height."""
    entries = synthetic.truth.objects.items()
    scale = synthetic.truth.metres_per_unit
    exact = [MeasuredObject(track, item.category, item.size / scale, np.full(3, TRUE_SIGMA)) for track, item in entries]
    upright = {track: float(item.size[2]) for track, item in entries if not (item.tilt_deg or np.any(item.velocity))}
    return Case(group, name, synthetic.scene, synthetic.instances, scale, upright, tuple(exact))

"""`--layers DIR`: `DIR/blender/scene.py`, which the user's Blender runs to get `DIR/scene.blend`. Nothing runs here."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

from insertion.blender.job import full_window, insertion_job
from insertion.exports.gltf_scene import write_gltf_model
from insertion.exports.metric_frame import camera_keys, frame_rate, metric_frame
from insertion.insertion_scene import PreparedScene
from insertion.light.environment_estimate import environment_at
from insertion.placement.placed_object import Placed

__all__ = ["write_layer_scene"]

_SCRIPTS = {"scene.py": "layer_script.py", "script.py": "script.py"}


def write_layer_scene(folder: Path, prepared: PreparedScene, objects: Sequence[Placed]) -> None:
    """Write the script with all that it needs into `folder / "blender"`; pictures without a pose have no camera key."""
    own = folder / "blender"
    own.mkdir()
    for name, source in _SCRIPTS.items():
        shutil.copyfile(Path(__file__).with_name(source), own / name)
    frame = metric_frame(objects, prepared.scale.metres_per_unit)
    posed = [shot for shot in prepared.footage.shots if shot.view is not None]
    first = objects[0]
    height = float(first.model.extents[1]) * first.size.factor / prepared.scale.metres_per_unit
    environment = environment_at(first.place, height, prepared.cloud, prepared.stills, prepared.shading())
    job = insertion_job(objects, camera_keys(posed, frame), frame, environment, own, full_window)
    for number, (item, entry) in enumerate(zip(objects, job["objects"], strict=True), start=1):
        entry["file"] = f"model{number}.glb"
        if item.request.model.suffix.lower() == ".glb" and not item.model.motions:
            shutil.copyfile(item.request.model, own / entry["file"])
        else:
            write_gltf_model(own / entry["file"], item.model)
    for shot, key in zip(posed, job["keys"], strict=True):
        key["frame"] = shot.index + 1
    shots, camera = prepared.footage.shots, posed[0].view
    assert camera is not None  # these have one
    job |= {
        "environment": "environment.hdr",
        "size": [camera.camera.width, camera.camera.height],
        "first": shots[0].index + 1,
        "last": shots[-1].index + 1,
        "rate": frame_rate(shots),
    }
    (own / "job.json").write_text(json.dumps(job, indent=1) + "\n", encoding="utf-8")

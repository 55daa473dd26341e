"""Script for the Python of Blender: render the job of `traced_scene`, a furnished room under area lights."""

import json
import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "insertion" / "blender"))
import script  # type: ignore[import-not-found]


def main(job: dict[str, Any]) -> None:
    """Build the scene and render it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    for item in job["objects"]:
        script.add_model(item)
    for light in job["lights"]:
        add_light(light)
    script.render(scene, script.add_camera(scene, job), job)


def add_light(light: dict[str, Any]) -> None:
    """Add a square area light with a power in watts, which shines along -z of its matrix."""
    data = bpy.data.lights.new("lamp", "AREA")
    data.shape, data.size, data.energy = "SQUARE", light["size"], light["power"]
    data.color = light["colour"]
    entry = bpy.data.objects.new("lamp", data)
    entry.matrix_world = Matrix((script.TURN @ np.array(light["matrix"])).tolist())
    bpy.context.scene.collection.objects.link(entry)


if __name__ == "__main__":
    main(json.loads(Path(sys.argv[-1]).read_text(encoding="utf-8")))

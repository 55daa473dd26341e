"""Run by Blender's own Python, never imported: where an exported scene's vertices are in the pictures.

`python reopen_in_blender.py FILE WIDTH HEIGHT SECONDS...` opens a .glb, a .usda or a .blend and prints, for each time,
the vertices of the objects as Blender's own camera sees them: shares of the picture from its lower left corner.
"""

import json
import re
import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy_extras.object_utils import world_to_camera_view


def main(file: Path, size: tuple[int, int], times: list[float]) -> None:
    """Open, go to each time, project; size : of the pictures, which a person states in Blender."""
    scene, first_frame, rate = open_scene(file)
    scene.render.resolution_x, scene.render.resolution_y = size
    camera = next(thing for thing in scene.objects if thing.type == "CAMERA")
    scene.camera = camera
    lens = {"lens_mm": camera.data.lens, "sensor_mm": camera.data.sensor_width, "rate": rate}
    seen = []
    for time_s in times:
        frame = first_frame + time_s * rate
        scene.frame_set(int(frame), subframe=frame - int(frame))
        bpy.context.view_layer.update()
        seen.append(projected(scene, camera).tolist())
    extents = np.ptp(vertices(scene), axis=0).tolist()
    print("SAW" + json.dumps({"pixels": seen, "extents_m": extents, **lens}))


def open_scene(file: Path) -> tuple[Any, float, float]:
    """The scene, its frame at the time 0, and its frames a second."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if file.suffix == ".blend":
        bpy.ops.wm.open_mainfile(filepath=str(file))
        render = bpy.context.scene.render
        return bpy.context.scene, 1.0, render.fps / render.fps_base
    if file.suffix == ".glb":
        bpy.ops.import_scene.gltf(filepath=str(file))
        return bpy.context.scene, 0.0, float(bpy.context.scene.render.fps)
    bpy.ops.wm.usd_import(filepath=str(file))
    # a frame of Blender is a time code of the stage
    stated = re.search(r"timeCodesPerSecond = ([0-9.e+-]+)", file.read_text(encoding="utf-8"))
    return bpy.context.scene, 0.0, float(stated[1]) if stated else 24.0


def meshes(scene: Any) -> list[Any]:
    """The objects' meshes, without what only catches shadows."""
    return [thing for thing in scene.objects if thing.type == "MESH" and not thing.is_shadow_catcher]


def vertices(scene: Any) -> np.ndarray:
    """(n, 3) vertices of all objects in the world."""
    return np.array([thing.matrix_world @ vertex.co for thing in meshes(scene) for vertex in thing.data.vertices])


def projected(scene: Any, camera: Any) -> np.ndarray:
    """(n, 3) shares of the picture, and depths."""
    from mathutils import Vector

    return np.array([world_to_camera_view(scene, camera, Vector(point)) for point in vertices(scene)])


if __name__ == "__main__":
    main(Path(sys.argv[1]), (int(sys.argv[2]), int(sys.argv[3])), [float(word) for word in sys.argv[4:]])

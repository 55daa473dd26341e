"""Steps of a user of the add-on, run in Blender's Python: three objects in centimetres become metres.

`PYTHON blender_session.py ADDON_FOLDER PROGRAM OUT.json [PICTURE.png]`
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import bpy

folder, program, out, *picture = sys.argv[1:]
sys.path.insert(0, folder)
import metric_tree_size as addon  # noqa: E402

bpy.ops.wm.read_factory_settings(use_empty=True)
addon.register()
OBJECTS = {
    "Chair.001": ((0, 0, 45), (48, 52, 90)),
    "Table": ((150, 0, 37.5), (160, 90, 75)),
    "Mug": ((150, 0, 80), (9, 12, 10)),
}
for name, (place, size) in OBJECTS.items():
    bpy.ops.mesh.primitive_cube_add(size=1, location=place)
    bpy.context.object.name = name
    bpy.context.object.scale = size
bpy.context.view_layer.update()
bpy.ops.object.select_all(action="SELECT")
addon.run_program = lambda _, table, run=addon.run_program: run(program, table)
assert bpy.ops.metric_tree.find_size() == {"FINISHED"}
settings = bpy.context.scene.metric_tree
assert bpy.ops.metric_tree.apply_size() == {"FINISHED"}
bpy.context.view_layer.update()
heights = {one.name: one.dimensions.z for one in bpy.data.objects}
answer = {"factor": settings.factor, "low": settings.low, "high": settings.high, "words": settings.reason}
Path(out).write_text(json.dumps({**answer, "heights": heights}), encoding="utf-8")

if picture:
    bpy.ops.object.light_add(type="SUN", rotation=(0.6, 0.3, 0))
    bpy.ops.object.camera_add(location=(4, -5, 3), rotation=(1.15, 0, 0.62))
    scene = bpy.context.scene
    scene.camera = bpy.context.object
    scene.world = bpy.data.worlds.new("w")
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.render.resolution_x, scene.render.resolution_y = 16, 640, 480
    scene.render.filepath = picture[0]
    bpy.ops.render.render(write_still=True)
addon.unregister()

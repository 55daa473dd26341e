"""Metric-Tree for Blender: the true size of the selected objects, by the program `metric-tree`.

Install this file (Edit, Preferences, Add-ons, Install from Disk). It runs the program named in its preferences, in a
separate Python environment (`pip install "metric-tree[assets]"`). The panel is in the sidebar of the 3D view. Several
selected objects are one scene: a common factor converts them to metres.
"""

from __future__ import annotations

import csv
import json
import subprocess
import tempfile
from pathlib import Path

import bpy
from mathutils import Matrix, Vector

bl_info = {
    "name": "Metric-Tree: true size",
    "author": "Metric-Tree",
    "version": (1, 0, 0),
    "blender": (4, 2, 0),
    "location": "3D view > Sidebar > Metric-Tree",
    "description": "The true size of objects from their categories",
    "category": "Object",
}

#: Maximum duration of a run of the program in seconds.
TIMEOUT_S = 60


class Preferences(bpy.types.AddonPreferences):
    """Path of the program."""

    bl_idname = __name__
    program: bpy.props.StringProperty(name="Program", default="metric-tree", subtype="FILE_PATH")

    def draw(self, _context):
        """Draw the setting."""
        self.layout.prop(self, "program")


class Settings(bpy.types.PropertyGroup):
    """Fields of the panel: the category, and the result of the program."""

    category: bpy.props.StringProperty(
        name="Category", description="Empty: the categories are the names of the objects"
    )
    low: bpy.props.FloatProperty()
    factor: bpy.props.FloatProperty(name="Factor", default=1.0, min=1e-9)
    high: bpy.props.FloatProperty()
    reason: bpy.props.StringProperty()


def selected_roots(context):
    """Return the selected objects without a selected parent or other ancestor."""
    chosen = set(context.selected_objects)
    return [root for root in context.selected_objects if not chosen & set(_ancestors(root))]


def world_extents(root):
    """Return the extents (3,) of an object and its descendants in Blender units, None without geometry."""
    corners = [
        part.matrix_world @ Vector(corner)
        for part in (root, *root.children_recursive)
        if part.type in {"MESH", "CURVE", "SURFACE", "FONT", "META"}
        for corner in part.bound_box
    ]
    if not corners:
        return None
    return [max(c[axis] for c in corners) - min(c[axis] for c in corners) for axis in range(3)]


def write_boxes(path, roots, category, metres):
    """Write a table of the boxes of objects in metres, z up; `metres` is the length of a Blender unit."""
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["name", "x", "y", "z", "up", "category"])
        for root in roots:
            extents = world_extents(root)
            if extents is not None and max(extents) > 0:
                name = root.name.rstrip("0123456789.") or root.name
                rows.writerow([name, *(side * metres for side in extents), "z", category or name])


def run_program(program, table):
    """Return the result of `metric-tree true-size --batch`. Raises RuntimeError with the message of a failed run."""
    argv = [program, "true-size", "--batch", str(table), "--json"]
    try:
        done = subprocess.run(argv, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise RuntimeError(f"{program}: {error}; name the program in the add-on's preferences") from None
    if done.returncode != 0:
        raise RuntimeError(done.stderr.strip().splitlines()[-1] if done.stderr.strip() else "no result")
    return json.loads(done.stdout)


def scale_roots(roots, factor, centre):
    """Scale objects with their descendants about a point."""
    about = Matrix.Translation(centre) @ Matrix.Diagonal((factor, factor, factor, 1.0)) @ Matrix.Translation(-centre)
    for root in roots:
        root.matrix_world = about @ root.matrix_world


class FindSize(bpy.types.Operator):
    """Estimate the true size of the selected objects."""

    bl_idname = "metric_tree.find_size"
    bl_label = "Find true size"

    def execute(self, context):
        """Write the boxes, run the program and store its result."""
        settings, roots = context.scene.metric_tree, selected_roots(context)
        addon = context.preferences.addons.get(__name__)
        program = addon.preferences.program if addon else "metric-tree"
        with tempfile.TemporaryDirectory() as folder:
            table = Path(folder) / "boxes.csv"
            write_boxes(table, roots, settings.category.strip(), context.scene.unit_settings.scale_length)
            try:
                result = run_program(program, table)
            except RuntimeError as error:
                self.report({"ERROR"}, str(error))
                return {"CANCELLED"}
        settings.low, settings.factor, settings.high = (result["factor"][part] for part in ("low", "median", "high"))
        settings.reason = result["reason"]
        self.report({"INFO"}, f"x {settings.factor:.4g} ({settings.low:.4g} to {settings.high:.4g})")
        return {"FINISHED"}


class ApplySize(bpy.types.Operator):
    """Scale the selected objects by the factor, about the 3D cursor."""

    bl_idname = "metric_tree.apply_size"
    bl_label = "Apply"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender's own form

    def execute(self, context):
        """Scale the objects."""
        scale_roots(selected_roots(context), context.scene.metric_tree.factor, context.scene.cursor.location.copy())
        return {"FINISHED"}


class Panel(bpy.types.Panel):
    """The panel in the sidebar."""

    bl_idname = "VIEW3D_PT_metric_tree"
    bl_label = "True size"
    bl_space_type, bl_region_type, bl_category = "VIEW_3D", "UI", "Metric-Tree"

    def draw(self, context):
        """Draw the category, the result and the buttons."""
        settings = context.scene.metric_tree
        self.layout.prop(settings, "category")
        self.layout.operator(FindSize.bl_idname)
        if settings.reason:
            self.layout.label(text=settings.reason)
            self.layout.label(text=f"90 %: x {settings.low:.4g} to {settings.high:.4g}")
            self.layout.prop(settings, "factor")
            self.layout.operator(ApplySize.bl_idname)


CLASSES = (Preferences, Settings, FindSize, ApplySize, Panel)


def register():
    """Add the add-on to Blender."""
    for kind in CLASSES:
        bpy.utils.register_class(kind)
    bpy.types.Scene.metric_tree = bpy.props.PointerProperty(type=Settings)


def unregister():
    """Remove the add-on from Blender."""
    del bpy.types.Scene.metric_tree
    for kind in reversed(CLASSES):
        bpy.utils.unregister_class(kind)


def _ancestors(child):
    while child.parent is not None:
        child = child.parent
        yield child


if __name__ == "__main__":
    register()

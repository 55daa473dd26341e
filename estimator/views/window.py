"""The view in a window of Open3D: turn, move, and click on a box for what it says."""

from __future__ import annotations

import os
import sys
from typing import Any

import numpy as np

from estimator.records.objects import EDGES
from estimator.views.scene_view import COLOURS, BoxView, SceneView, box_on_ray
from metric_base.errors import InputError

WIDTH, HEIGHT = 1280, 860

#: Pixels that the pointer may move between press and release of a click.
CLICK_PX = 4


def check_display() -> None:
    """InputError where there is no display, before any work is done."""
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise InputError("--view: expected a display; found none (--view-png and --view-glb need none)")


def show(view: SceneView) -> None:
    """Open the window, and return when it is closed; it needs the extra `view`."""
    from open3d.visualization import gui

    application = gui.Application.instance
    application.initialize()
    _Window(view)
    application.run()


def words_of(box: BoxView | None) -> str:
    """What the panel shows of a box, or of none."""
    if box is None:
        return "Click on a box for what it says."
    said = box.said
    lines = [box.title, f"category: {said['node'] or 'not known'} ({said['tier'] or 'no size'})", *said["sizes"]]
    lines.append(f"{said['verdict']}, weight {said['weight']:g}" + (f": {said['reason']}" if said["reason"] else ""))
    return "\n".join(lines)


class _Window:
    """Open3D's scene beside a panel of words."""

    def __init__(self, view: SceneView) -> None:
        from open3d.visualization import gui, rendering

        self._view, self._pressed = view, (0, 0)
        self.window = gui.Application.instance.create_window(f"Scale: {view.headline}", WIDTH, HEIGHT)
        self._widget = gui.SceneWidget()
        self._widget.scene = rendering.Open3DScene(self.window.renderer)
        self._widget.scene.set_background([0.98, 0.98, 0.97, 1])
        self._label = gui.Label(f"{view.headline}\n\n{words_of(None)}")
        self._panel = gui.Vert(0, gui.Margins(12, 12, 12, 12))
        self._panel.add_child(self._label)
        self.window.add_child(self._widget)
        self.window.add_child(self._panel)
        self.window.set_on_layout(self._lay_out)
        self._widget.set_on_mouse(self._on_mouse)
        self._fill()

    def _fill(self) -> None:
        import open3d as o3d

        view, scene = self._view, self._widget.scene
        if len(view.points):
            cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(view.points))
            cloud.colors = o3d.utility.Vector3dVector(_linear(view.point_colours))
            scene.add_geometry("points", cloud, _material("defaultUnlit", point_size=3))
        for name, lines in (("camera", view.cameras), ("up", view.up)):
            if len(lines):
                scene.add_geometry(name, _lines(lines, COLOURS[name]), _material("unlitLine", line_width=1.5))
        for number, plane in enumerate(view.planes):
            around = np.stack([plane, np.roll(plane, -1, axis=0)], axis=1)
            scene.add_geometry(
                f"plane {number}", _lines(around, COLOURS["plane"]), _material("unlitLine", line_width=2)
            )
        for box in view.boxes:
            lines = _lines(box.corners[EDGES], COLOURS[box.verdict])
            scene.add_geometry(f"box {box.id}", lines, _material("unlitLine", line_width=3))
            self._widget.add_3d_label(box.corners.mean(axis=0), f"{box.title}\n{box.sizes}")
        low, high = view.bounds()
        bounds = o3d.geometry.AxisAlignedBoundingBox(low, high)
        self._widget.setup_camera(55, bounds, (low + high) / 2)
        size = float(np.linalg.norm(high - low))
        eye = (low + high) / 2 + size * np.array([0.6, 0.55, 0.9])
        self._widget.look_at((low + high) / 2, eye, [0, 1, 0])

    def _lay_out(self, _context: Any) -> None:
        from open3d.visualization import gui

        whole = self.window.content_rect
        wide = 22 * self.window.theme.font_size
        self._widget.frame = gui.Rect(whole.x, whole.y, whole.width - wide, whole.height)
        self._panel.frame = gui.Rect(whole.get_right() - wide, whole.y, wide, whole.height)

    def _on_mouse(self, event: Any) -> Any:
        from open3d.visualization import gui

        if event.type == gui.MouseEvent.Type.BUTTON_DOWN:
            self._pressed = (event.x, event.y)
        elif event.type == gui.MouseEvent.Type.BUTTON_UP:
            moved = max(abs(event.x - self._pressed[0]), abs(event.y - self._pressed[1]))
            if moved <= CLICK_PX:
                box = self.box_at(event.x - self._widget.frame.x, event.y - self._widget.frame.y)
                self._label.text = f"{self._view.headline}\n\n{words_of(box)}"
        return gui.Widget.EventCallbackResult.IGNORED

    def box_at(self, x: float, y: float) -> BoxView | None:
        """The box under a pixel of the scene."""
        camera, frame = self._widget.scene.camera, self._widget.frame
        near, far = (np.array(camera.unproject(x, y, depth, frame.width, frame.height)) for depth in (0.0, 0.9))
        return box_on_ray(self._view, near, far - near)


def _material(shader: str, **values: Any) -> Any:
    from open3d.visualization import rendering

    material = rendering.MaterialRecord()
    material.shader = shader
    for name, value in values.items():
        setattr(material, name, value)
    return material


def _linear(colour: Any) -> Any:
    """A colour as light, 0 to 1: the renderer's own measure."""
    return (np.asarray(colour) / 255) ** 2.2


def _lines(ends: Any, colour: tuple[int, int, int]) -> Any:
    import open3d as o3d

    places = ends.reshape(-1, 3)
    pairs = np.arange(len(places)).reshape(-1, 2)
    lines = o3d.geometry.LineSet(o3d.utility.Vector3dVector(places), o3d.utility.Vector2iVector(pairs))
    lines.paint_uniform_color(_linear(colour))
    return lines

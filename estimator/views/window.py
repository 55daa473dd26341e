"""Show the 3-D view of an estimate in an Open3D window; a click on a box shows its report."""

from __future__ import annotations

import os
import sys
from typing import Any

import numpy as np

from estimator.records.objects import EDGES
from estimator.views.scene_view import COLOURS, BoxView, SceneView, box_on_ray

#: Initial size of the window in pixels.
WIDTH, HEIGHT = 1280, 860
#: Maximum movement of the pointer between press and release of a click, in pixels.
MAX_CLICK_PX = 4
#: Exponent from sRGB values (0 to 1) to the linear light that the renderer uses, approximately.
GAMMA = 2.2


def has_display() -> bool:
    """Return whether a window can be opened."""
    is_linux = sys.platform.startswith("linux")
    return not is_linux or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def show(view: SceneView) -> None:
    """Open the window, and return when it is closed. Open3D is part of the extra `view`."""
    from open3d.visualization import gui

    application = gui.Application.instance
    application.initialize()
    _Window(view)
    application.run()


def report_text(box: BoxView | None) -> str:
    """Return the report of a box, or an instruction if no box is selected."""
    if box is None:
        return "Click on a box to see its report."
    report = box.report
    lines = [box.title, f"category: {report['node'] or 'not known'} ({report['tier'] or 'no size'})", *report["sizes"]]
    lines.append(
        f"{report['verdict']}, weight {report['weight']:g}" + (f": {report['reason']}" if report["reason"] else "")
    )
    return "\n".join(lines)


class _Window:
    """The scene, and a panel with the report."""

    def __init__(self, view: SceneView) -> None:
        from open3d.visualization import gui, rendering

        self._view, self._pressed = view, (0, 0)
        self.window = gui.Application.instance.create_window(f"Scale: {view.headline}", WIDTH, HEIGHT)
        self._widget = gui.SceneWidget()
        self._widget.scene = rendering.Open3DScene(self.window.renderer)
        self._widget.scene.set_background([0.98, 0.98, 0.97, 1])
        self._label = gui.Label(f"{view.headline}\n\n{report_text(None)}")
        self._panel = gui.Vert(0, gui.Margins(12, 12, 12, 12))
        self._panel.add_child(self._label)
        self.window.add_child(self._widget)
        self.window.add_child(self._panel)
        self.window.set_on_layout(self._lay_out)
        self._widget.set_on_mouse(self._on_mouse)
        self._fill()

    def _fill(self) -> None:
        """Add the content of the view and place the camera."""
        import open3d as o3d

        view, scene = self._view, self._widget.scene
        if len(view.points):
            cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(view.points))
            cloud.colors = o3d.utility.Vector3dVector((view.point_colours / 255) ** GAMMA)
            scene.add_geometry("points", cloud, _material("defaultUnlit", point_size=3))
        for name, lines in (("camera", view.cameras), ("up", view.up)):
            if len(lines):
                scene.add_geometry(name, _lines(lines, COLOURS[name]), _material("unlitLine", line_width=1.5))
        for number, plane in enumerate(view.planes):
            outline = np.stack([plane, np.roll(plane, -1, axis=0)], axis=1)
            scene.add_geometry(
                f"plane {number}", _lines(outline, COLOURS["plane"]), _material("unlitLine", line_width=2)
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
        """Divide the window between the scene and the panel."""
        from open3d.visualization import gui

        area = self.window.content_rect
        panel_width = 22 * self.window.theme.font_size
        self._widget.frame = gui.Rect(area.x, area.y, area.width - panel_width, area.height)
        self._panel.frame = gui.Rect(area.get_right() - panel_width, area.y, panel_width, area.height)

    def _on_mouse(self, event: Any) -> Any:
        """Show the report of the box under a click; other events move the camera."""
        from open3d.visualization import gui

        if event.type == gui.MouseEvent.Type.BUTTON_DOWN:
            self._pressed = (event.x, event.y)
        elif event.type == gui.MouseEvent.Type.BUTTON_UP:
            moved = max(abs(event.x - self._pressed[0]), abs(event.y - self._pressed[1]))
            if moved <= MAX_CLICK_PX:
                box = self.box_at(event.x - self._widget.frame.x, event.y - self._widget.frame.y)
                self._label.text = f"{self._view.headline}\n\n{report_text(box)}"
        return gui.Widget.EventCallbackResult.IGNORED

    def box_at(self, x: float, y: float) -> BoxView | None:
        """Return the box at a pixel of the scene, or None."""
        camera, frame = self._widget.scene.camera, self._widget.frame
        near, far = (np.array(camera.unproject(x, y, depth, frame.width, frame.height)) for depth in (0.0, 0.9))
        return box_on_ray(self._view, near, far - near)


def _material(shader: str, **values: Any) -> Any:
    """Return a material of the renderer."""
    from open3d.visualization import rendering

    material = rendering.MaterialRecord()
    material.shader = shader
    for name, value in values.items():
        setattr(material, name, value)
    return material


def _lines(ends: Any, colour: tuple[int, int, int]) -> Any:
    """Return lines between pairs of points (n, 2, 3)."""
    import open3d as o3d

    points = ends.reshape(-1, 3)
    pairs = np.arange(len(points)).reshape(-1, 2)
    lines = o3d.geometry.LineSet(o3d.utility.Vector3dVector(points), o3d.utility.Vector2iVector(pairs))
    lines.paint_uniform_color((np.asarray(colour) / 255) ** GAMMA)
    return lines

"""Draw the 3-D view of an estimate as an image, without a display or a graphics card: distant elements first."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.outputs.label_placement import place_labels
from estimator.records.objects import EDGES
from estimator.views.glb import FACES
from estimator.views.scene_view import COLOURS, BoxView, SceneView
from metric_base.arrays import FloatArray
from metric_base.files import whole_file
from metric_base.images import write_image

#: Size of the image in pixels.
WIDTH, HEIGHT = 1600, 1000
#: Rotation of the scene about the vertical, in degrees.
AZIMUTH_DEG = 35.0
#: Angle of the camera below the horizontal, in degrees.
TILT_DEG = 28.0
#: Fraction of the image that the scene fills.
FILLED_FRACTION = 0.9
#: Distance of the camera from the centre of the scene, relative to its diagonal.
EYE_DISTANCE = 2.2
#: Margin of the text of a label, in pixels.
LABEL_MARGIN_PX = 4

_BACKGROUND = (250, 250, 248)


def write_view(view: SceneView, path: Path, option: str = "--view-png") -> None:
    """Write the image of a view; InputError if the file cannot be written."""
    with whole_file(path, option) as work:
        image = work.with_name(work.name + path.suffix)
        write_image(image, render_view(view)[..., ::-1])
        image.replace(work)


def render_view(view: SceneView, width: int = WIDTH, height: int = HEIGHT) -> Any:
    """Return the image (height, width, 3) of a view, uint8 RGB."""
    import cv2

    canvas = np.full((height, width, 3), _BACKGROUND, dtype=np.uint8)
    project = _Projection(view, width, height)
    for plane in view.planes:
        _fill(canvas, project(plane)[0], COLOURS["plane"], 0.18)
    pixels, depth = project(view.points)
    order = np.argsort(-depth)
    pixels, colours = pixels[order], view.point_colours[order]
    inside = ((pixels >= 1) & (pixels < np.array(canvas.shape[1::-1]) - 1)).all(axis=1)
    columns, rows = pixels[inside].astype(int).T
    for right, down in ((0, 0), (1, 0), (0, 1), (1, 1)):
        canvas[rows + down, columns + right] = colours[inside]
    for line in project(view.cameras.reshape(-1, 3))[0].reshape(-1, 2, 2):
        cv2.line(canvas, *_ends(line), COLOURS["camera"], 1, cv2.LINE_AA)
    boxes = sorted(view.boxes, key=lambda box: -float(project(box.corners)[1].mean()))
    for box in boxes:
        colour = COLOURS[box.verdict]
        corners = project(box.corners)[0]
        for face in FACES:
            _fill(canvas, corners[face], colour, 0.05)
        for a, b in EDGES:
            cv2.line(canvas, *_ends(corners[[a, b]]), colour, 2, cv2.LINE_AA)
    (foot, head), _ = project(view.up.reshape(-1, 3))
    cv2.arrowedLine(canvas, *_ends(np.stack([foot, head])), COLOURS["up"], 2, cv2.LINE_AA, tipLength=0.1)
    return with_labels(canvas, view, [(box, project(box.corners)[0]) for box in boxes], head)


class _Projection:
    """A perspective camera that shows the complete view from above."""

    def __init__(self, view: SceneView, width: int, height: int) -> None:
        low, high = view.bounds()
        self._rotation = Rotation.from_euler("yx", [-AZIMUTH_DEG, TILT_DEG], degrees=True).as_matrix()
        self._centre = (low + high) / 2
        self._eye = EYE_DISTANCE * float(np.linalg.norm(high - low))
        ends = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
        plane, _ = self._to_plane(ends)
        span = np.maximum(np.ptp(plane, axis=0), 1e-9)
        self._zoom = FILLED_FRACTION * float(min(width / span[0], height / span[1]))
        self._offset = np.array([width, height]) / 2 - self._zoom * (plane.min(axis=0) + plane.max(axis=0)) / 2

    def _to_plane(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Project points (n, 3) to the image plane through the centre of the scene: positions (n, 2), depths (n,)."""
        rotated = (points - self._centre) @ self._rotation.T
        depth = np.maximum(self._eye - rotated[:, 2], 1e-3 * self._eye)
        return np.column_stack([rotated[:, 0], -rotated[:, 1]]) / depth[:, None] * self._eye, depth

    def __call__(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return pixels (n, 2) and depths (n,) of points (n, 3)."""
        plane, depth = self._to_plane(points)
        return plane * self._zoom + self._offset, depth


def _fill(canvas: Any, polygon: FloatArray, colour: tuple[int, int, int], alpha: float) -> None:
    """Blend a polygon of pixels (n, 2) over the canvas."""
    import cv2

    low = np.clip(np.floor(polygon.min(axis=0)).astype(int), 0, np.array(canvas.shape[1::-1]) - 1)
    high = np.clip(np.ceil(polygon.max(axis=0)).astype(int) + 1, 0, np.array(canvas.shape[1::-1]))
    part = canvas[low[1] : high[1], low[0] : high[0]]
    if part.size:
        filled = part.copy()
        cv2.fillPoly(filled, [np.round(polygon - low).astype(np.int32)], colour, cv2.LINE_AA)
        part[:] = np.round(alpha * filled.astype(float) + (1 - alpha) * part).astype(np.uint8)


def _ends(line: FloatArray) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the ends (2, 2) of a line as integer pixels, within the range that OpenCV draws."""
    (a, b), (c, d) = np.clip(np.round(line), -32_000, 32_000).astype(int).tolist()
    return (a, b), (c, d)


def with_labels(canvas: Any, view: SceneView, boxes: list[tuple[BoxView, FloatArray]], head: FloatArray) -> Any:
    """Return the canvas with the headline and with the labels of the boxes, at positions without overlap.

    Parameters
    ----------
    canvas : (h, w, 3) ndarray of uint8
    view : SceneView
    boxes : list of (BoxView, (8, 2) ndarray of float)
        Boxes and the pixels of their corners, the nearest box last.
    head : (2,) ndarray of float
        Pixel of the tip of the vertical.
    """
    from PIL import Image, ImageDraw, ImageFont

    image = Image.fromarray(canvas)
    draw, font, large = ImageDraw.Draw(image), ImageFont.load_default(15), ImageFont.load_default(22)
    draw.text((20, 16), view.headline, (20, 30, 30), large)
    draw.text((float(head[0]) + 6, float(head[1]) - 10), "up", COLOURS["up"], font)
    texts = [f"{box.title}\n{box.sizes}" for box, _ in boxes]
    extents = [draw.multiline_textbbox((0, 0), text, font)[2:] for text in texts]
    sizes = np.array(extents, dtype=np.float64).reshape(-1, 2) + 2 * LABEL_MARGIN_PX
    bounds = [np.concatenate([corners.min(axis=0), corners.max(axis=0)]) for _, corners in boxes]
    places = place_labels(np.array(bounds).reshape(-1, 4), sizes, image.size)
    for (box, corners), text, size, place in zip(boxes, texts, sizes, places, strict=True):
        draw.line([*(place + size / 2), *corners.mean(axis=0)], COLOURS[box.verdict])
        draw.rectangle([*place, *(place + size)], (255, 255, 255), COLOURS[box.verdict])
        draw.multiline_text(tuple((place + LABEL_MARGIN_PX).tolist()), text, (20, 30, 30), font)
    return np.array(image)

"""The view as a picture, drawn without a display or a graphics card: from in front and above, far objects first."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from estimator.records.objects import EDGES
from estimator.views.glb import FACES
from estimator.views.scene_view import COLOURS, BoxView, SceneView
from metric_base.arrays import FloatArray
from metric_base.files import whole_file
from metric_base.images import write_picture

WIDTH, HEIGHT = 1600, 1000

#: Degrees about the vertical and downward.
TURN_DEG, TILT_DEG = 35.0, 28.0

#: Share of the picture that the scene fills, and the least distance of the eye in sizes of the scene.
FILLED, EYE = 0.9, 2.2

_GROUND = (250, 250, 248)


def write_view(view: SceneView, path: Path, option: str = "--view-png") -> None:
    """Write the picture whole or not at all; InputError where it cannot be written."""
    with whole_file(path, option) as work:
        picture = work.with_name(work.name + path.suffix)
        write_picture(picture, render_view(view)[..., ::-1])
        picture.replace(work)


def render_view(view: SceneView, width: int = WIDTH, height: int = HEIGHT) -> Any:
    """(height, width, 3) uint8, red green blue."""
    import cv2

    canvas = np.full((height, width, 3), _GROUND, dtype=np.uint8)
    place = _Lens(view, width, height)
    for plane in view.planes:
        _fill(canvas, place(plane)[0], COLOURS["plane"], 0.18)
    pixels, depth = place(view.points)
    order = np.argsort(-depth)
    _draw_points(canvas, pixels[order], view.point_colours[order])
    for line in place(view.cameras.reshape(-1, 3))[0].reshape(-1, 2, 2):
        cv2.line(canvas, *_ends(line), COLOURS["camera"], 1, cv2.LINE_AA)
    boxes = sorted(view.boxes, key=lambda box: -float(place(box.corners)[1].mean()))
    for box in boxes:
        colour = COLOURS[box.verdict]
        ends = place(box.corners)[0]
        for face in FACES:
            _fill(canvas, ends[face], colour, 0.05)
        for a, b in EDGES:
            cv2.line(canvas, *_ends(ends[[a, b]]), colour, 2, cv2.LINE_AA)
    (foot, head), _ = place(view.up.reshape(-1, 3))
    cv2.arrowedLine(canvas, *_ends(np.stack([foot, head])), COLOURS["up"], 2, cv2.LINE_AA, tipLength=0.1)
    return _with_texts(canvas, view, [(box, place(box.corners)[0]) for box in boxes], head)


class _Lens:
    """Places in the view's frame to pixels and depths, so that all of the view is in the picture."""

    def __init__(self, view: SceneView, width: int, height: int) -> None:
        low, high = view.bounds()
        turn, tilt = np.radians(TURN_DEG), np.radians(TILT_DEG)
        about = np.array([[np.cos(turn), 0, -np.sin(turn)], [0, 1, 0], [np.sin(turn), 0, np.cos(turn)]])
        down = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
        self._rotation, self._centre = down @ about, (low + high) / 2
        self._eye = EYE * float(np.linalg.norm(high - low))
        ends = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
        flat, _ = self._flat(ends)
        span = np.maximum(np.ptp(flat, axis=0), 1e-9)
        self._zoom = FILLED * float(min(width / span[0], height / span[1]))
        self._middle = np.array([width, height]) / 2 - self._zoom * (flat.min(axis=0) + flat.max(axis=0)) / 2

    def _flat(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n, 2) places in the plane of the picture through the middle of the scene, and (n,) depths, of (n, 3)."""
        turned = (places - self._centre) @ self._rotation.T
        depth = np.maximum(self._eye - turned[:, 2], 1e-3 * self._eye)
        return np.column_stack([turned[:, 0], -turned[:, 1]]) / depth[:, None] * self._eye, depth

    def __call__(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n, 2) pixels and (n,) depths of places (n, 3)."""
        flat, depth = self._flat(places)
        return flat * self._zoom + self._middle, depth


def _draw_points(canvas: Any, pixels: FloatArray, colours: Any) -> None:
    """Draw points of (n, 2) pixels with (n, 3) colours, the later over the earlier."""
    inside = ((pixels >= 1) & (pixels < np.array(canvas.shape[1::-1]) - 1)).all(axis=1)
    columns, rows = pixels[inside].astype(int).T
    for right, down in ((0, 0), (1, 0), (0, 1), (1, 1)):
        canvas[rows + down, columns + right] = colours[inside]


def _fill(canvas: Any, ends: FloatArray, colour: tuple[int, int, int], alpha: float) -> None:
    """A polygon of (n, 2) pixels, laid over what is there."""
    import cv2

    low = np.clip(np.floor(ends.min(axis=0)).astype(int), 0, np.array(canvas.shape[1::-1]) - 1)
    high = np.clip(np.ceil(ends.max(axis=0)).astype(int) + 1, 0, np.array(canvas.shape[1::-1]))
    part = canvas[low[1] : high[1], low[0] : high[0]]
    if part.size:
        over = part.copy()
        cv2.fillPoly(over, [np.round(ends - low).astype(np.int32)], colour, cv2.LINE_AA)
        part[:] = np.round(alpha * over.astype(float) + (1 - alpha) * part).astype(np.uint8)


def _ends(line: FloatArray) -> tuple[tuple[int, int], tuple[int, int]]:
    """The whole pixels of a line's two ends, (2, 2)."""
    (a, b), (c, d) = np.clip(np.round(line), -32_000, 32_000).astype(int).tolist()
    return (a, b), (c, d)


def _with_texts(canvas: Any, view: SceneView, boxes: list[tuple[BoxView, FloatArray]], head: FloatArray) -> Any:
    """The picture with the boxes' names and sizes where there is room for them, and the headline.

    boxes : each with the (8, 2) pixels of its corners, the nearest last; head : (2,) the pixel of the end of up
    """
    from PIL import Image, ImageDraw, ImageFont

    image = Image.fromarray(canvas)
    draw, font, large = ImageDraw.Draw(image), ImageFont.load_default(15), ImageFont.load_default(22)
    draw.text((20, 16), view.headline, (20, 30, 30), large)
    draw.text((float(head[0]) + 6, float(head[1]) - 10), "up", COLOURS["up"], font)
    taken: list[tuple[float, float, float, float]] = []
    for box, ends in reversed(boxes):  # the nearest first
        text = f"{box.title}\n{box.sizes}"
        left, top, right, bottom = draw.multiline_textbbox((0, 0), text, font)
        x, y = float(ends[:, 0].mean() - (right - left) / 2), float(ends[:, 1].min() - (bottom - top) - 8)
        spot = (x, max(y, 50.0), x + right - left, max(y, 50.0) + bottom - top)
        while any(_meet(spot, other) for other in taken) and spot[3] < canvas.shape[0]:
            spot = (spot[0], spot[1] + 8, spot[2], spot[3] + 8)
        taken.append(spot)
        middle = ends.mean(axis=0)
        draw.line(((spot[0] + spot[2]) / 2, spot[3], float(middle[0]), float(middle[1])), COLOURS[box.verdict])
        draw.rectangle((spot[0] - 4, spot[1] - 2, spot[2] + 4, spot[3] + 6), (255, 255, 255), COLOURS[box.verdict])
        draw.multiline_text((spot[0] - left, spot[1] - top), text, (20, 30, 30), font)
    return np.array(image)


def _meet(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    return one[0] < other[2] + 9 and other[0] < one[2] + 9 and one[1] < other[3] + 9 and other[1] < one[3] + 9

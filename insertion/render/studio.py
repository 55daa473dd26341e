"""Pictures of a model alone: orthographic views with exact foreground, at a known number of pixels per metre."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insertion.render.body import body_of
from insertion.render.gpu import load_part, shader
from metric_base.arrays import FloatArray
from models3d.model import Model

#: Four views, a quarter turn apart, none of them straight at a side.
AZIMUTHS_DEG = (30.0, 120.0, 210.0, 300.0)
#: As one looks at an object on a table: the top is seen, and the height is shortened by 6 % only.
ELEVATION_DEG = 20.0
#: Free pixels around the object before it is cropped.
MARGIN_PX = 2
SAMPLES = 4
#: The axes of a model that stands at the origin: two horizontal ones and up, which is glTF's +y.
_BASIS = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True, slots=True, eq=False)
class StudioView:
    """rgba : (h, w, 4) uint8 sRGB, alpha is the foreground, cropped to it; pixels_per_metre : of the view's plane."""

    rgba: NDArray[np.uint8]
    pixels_per_metre: float

    @property
    def foreground_share(self) -> float:
        """Share of the picture that the object covers."""
        return float((self.rgba[..., 3] >= 128).mean())


def studio_views(context: Any, model: Model, pixels: int) -> Iterator[StudioView]:
    """Views of a model whose largest diagonal is `pixels` long.

    context : of `insertion.render.gpu.gl_context`. The projection is orthographic, so that one number of pixels
    per metre holds all over a picture.
    """
    program = context.program(vertex_shader=shader("studio.vert"), fragment_shader=shader("studio.frag"))
    body = body_of(model, np.zeros(3), _BASIS, np.array([0.0, 0.0, 1.0]), 1.0)
    parts = [load_part(context, program, program, part) for part in body.parts]
    corners = body.corners
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    radius = float(np.linalg.norm(corners - middle, axis=1).max())
    side = pixels + 2 * MARGIN_PX
    make = context.renderbuffer
    deep = context.depth_renderbuffer((side, side), samples=SAMPLES)
    smooth = context.framebuffer([make((side, side), 4, samples=SAMPLES)], deep)
    plain = context.framebuffer([make((side, side), 4)])
    for azimuth in AZIMUTHS_DEG:
        turn = _camera_axes(azimuth, ELEVATION_DEG)
        program["clip"].write(_clip(turn, middle, radius * side / pixels).T.astype("f4").tobytes())
        program["towards_eye"].value = tuple(float(v) for v in -turn[2])
        _draw(context, smooth, program, parts)
        context.copy_framebuffer(plain, smooth)
        rgba = np.frombuffer(plain.read(components=4), "u1").reshape(side, side, 4)
        yield StudioView(_crop(rgba), pixels / (2 * radius * body.unit))
    for item in (smooth, plain):
        item.release()


def _camera_axes(azimuth_deg: float, elevation_deg: float) -> FloatArray:
    """(3, 3) rows right, down, forward of a camera that looks at the origin."""
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    away = np.array([np.cos(elevation) * np.sin(azimuth), np.sin(elevation), np.cos(elevation) * np.cos(azimuth)])
    right = np.cross(-away, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(-away, right), -away])


def _clip(turn: FloatArray, middle: FloatArray, reach: float) -> FloatArray:
    """(4, 4) model to clip space: a cube of half side `reach` about the middle; y points down the picture."""
    clip = np.eye(4)
    clip[:3, :3] = turn / reach
    clip[:3, 3] = -turn @ middle / reach
    return clip


def _draw(context: Any, target: Any, program: Any, parts: list[Any]) -> None:
    """Draw the solid parts, then the clear ones over them; colours are premultiplied by alpha."""
    target.use()
    target.clear()
    context.enable(context.DEPTH_TEST | context.BLEND)
    context.blend_func = context.ONE, context.ONE_MINUS_SRC_ALPHA
    for clear in (False, True):
        target.depth_mask = not clear
        for part in parts:
            if part.material.blend == clear:
                program["clear"].value = clear
                part.bind(program)
                part.drawn.render()
    target.depth_mask = True
    context.disable(context.BLEND)


def _crop(rgba: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(h, w, 4) the box of the foreground; colours without the premultiplied alpha."""
    rows, columns = np.nonzero(rgba[..., 3])
    box = rgba[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1].astype(np.float64)
    alpha = np.maximum(box[..., 3:], 1) / 255
    return np.concatenate([np.clip(box[..., :3] / alpha, 0, 255), box[..., 3:]], axis=-1).round().astype(np.uint8)

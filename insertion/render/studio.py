"""Orthographic images of a model with exact masks and a known number of pixels per metre."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insertion.render.body import body_of
from insertion.render.gpu import load_part, release
from insertion.render.gpu import program as program_of
from metric_base.arrays import FloatArray
from models3d.model import Model

#: Azimuths of the views in degrees, a quarter turn apart and oblique to the sides of the model.
AZIMUTHS_DEG = (30.0, 120.0, 210.0, 300.0)
#: Elevation of the camera in degrees: the top is visible, and the height is shortened by only 6 %.
ELEVATION_DEG = 20.0
#: Margin around the object in pixels before the image is cropped.
MARGIN_PX = 2
SAMPLES = 4
#: Axes of a model at the origin: two horizontal ones and up (+y of glTF).
_BASIS = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True, slots=True, eq=False)
class StudioView:
    """An image of a model.

    Attributes
    ----------
    rgba : (h, w, 4) ndarray of uint8
        sRGB with the mask as alpha, cropped to the object.
    pixels_per_metre : float
        Scale of the image.
    """

    rgba: NDArray[np.uint8]
    pixels_per_metre: float

    @property
    def foreground_share(self) -> float:
        """Fraction of the image that the object covers."""
        return float((self.rgba[..., 3] >= 128).mean())


def studio_views(
    context: Any, model: Model, pixels: int, azimuths_deg: Sequence[float] = AZIMUTHS_DEG
) -> Iterator[StudioView]:
    """Yield orthographic views of a model whose largest diagonal has a length of `pixels` pixels.

    Parameters
    ----------
    context : moderngl.Context
        Context of `insertion.render.gpu.gl_context`.
    """
    program = program_of(context, "studio.vert", "studio.frag")
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
    for azimuth in azimuths_deg:
        turn = camera_axes(azimuth, ELEVATION_DEG)
        reach = radius * side / pixels  # half the side of the visible cube
        clip = np.eye(4)
        clip[:3, :3] = turn / reach
        clip[:3, 3] = -turn @ middle / reach
        program["clip"].write(clip.T.astype("f4").tobytes())
        program["towards_eye"].value = tuple(float(v) for v in -turn[2])
        # Opaque parts, then transparent ones over them; colours are premultiplied by alpha
        smooth.use()
        smooth.clear()
        context.enable(context.DEPTH_TEST | context.BLEND)
        context.blend_func = context.ONE, context.ONE_MINUS_SRC_ALPHA
        for is_clear in (False, True):
            smooth.depth_mask = not is_clear
            for part in parts:
                if part.material.blend == is_clear:
                    program["clear"].value = is_clear
                    part.bind(program)
                    part.drawn.render()
        smooth.depth_mask = True
        context.disable(context.BLEND)
        context.copy_framebuffer(plain, smooth)
        rgba = np.frombuffer(plain.read(components=4), "u1").reshape(side, side, 4)
        yield StudioView(crop_to_object(rgba), pixels / (2 * radius * body.unit))
    release(smooth, plain)


def camera_axes(azimuth_deg: float, elevation_deg: float) -> FloatArray:
    """Return the axes (3, 3) of a camera that looks at the origin: rows right, down, forward."""
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    away = np.array([np.cos(elevation) * np.sin(azimuth), np.sin(elevation), np.cos(elevation) * np.cos(azimuth)])
    right = np.cross(-away, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(-away, right), -away])


def crop_to_object(rgba: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Crop an image (h, w, 4) to its pixels with alpha, and divide the premultiplied colours by alpha."""
    rows, columns = np.nonzero(rgba[..., 3])
    box = rgba[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1].astype(np.float64)
    alpha = np.maximum(box[..., 3:], 1) / 255
    return np.concatenate([np.clip(box[..., :3] / alpha, 0, 255), box[..., 3:]], axis=-1).round().astype(np.uint8)

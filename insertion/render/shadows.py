"""What the object takes from the light: a shadow map for each light, and the map of light that reaches the plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insertion.light.lights import Lights
from insertion.render.buffers import LoadedPart
from insertion.render.context import shader
from metric_base.arrays import FloatArray

__all__ = ["Caster", "PlaneMap", "light_axes", "plane_map", "shadow_atlas"]

#: Pixels along one light's shadow map.
TILE = 320
#: Pixels along the map of light on the plane, and how far it reaches, in heights of the object over its foot.
MAP_PIXELS = 512
MAP_HEIGHTS = 3.0
#: A part with alpha blending casts a shadow if it hides at least half.
CASTING_ALPHA = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Caster:
    """The sphere about what casts shadows: centre (3,) and radius in the local frame."""

    centre: FloatArray
    radius: float


@dataclass(frozen=True, slots=True, eq=False)
class PlaneMap:
    """share : (MAP_PIXELS, MAP_PIXELS, 3) of the light that still reaches the support plane; radius : half its side.

    Columns go along the plane's first axis, rows along its second, from -radius to radius about the object's foot.
    """

    share: NDArray[np.float32]
    radius: float


def light_axes(lights: Lights, radius: float) -> tuple[FloatArray, FloatArray]:
    """(n, 3) right and up axes of each light's shadow map, divided by the radius of what casts."""
    seed = np.where(np.abs(lights.directions[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    right = np.cross(seed, lights.directions)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return right / radius, np.cross(lights.directions, right) / radius


def shadow_atlas(context: Any, program: Any, parts: Sequence[LoadedPart], lights: Lights, caster: Caster) -> Any:
    """A depth texture of tiles, one for each light."""
    tiles = int(np.ceil(np.sqrt(len(lights.directions))))
    atlas = context.depth_texture((tiles * TILE, tiles * TILE))
    atlas.compare_func = "<="
    target = context.framebuffer(depth_attachment=atlas)
    target.use()
    context.enable(context.DEPTH_TEST)
    target.clear(depth=1.0)
    right, above = light_axes(lights, caster.radius)
    for row, direction in enumerate(lights.directions):
        clip = np.eye(4)
        clip[:3, :3] = [right[row], above[row], -direction / (2 * caster.radius)]
        clip[:3, 3] = -clip[:3, :3] @ caster.centre
        target.viewport = (row % tiles * TILE, row // tiles * TILE, TILE, TILE)
        _cast(program, parts, clip)
    target.release()
    return atlas


def plane_map(
    context: Any, program: Any, parts: Sequence[LoadedPart], lights: Lights, basis: FloatArray, corners: FloatArray
) -> PlaneMap:
    """The light on the support plane with the object over it without: sum of w_i v_i / sum of w_i.

    lights : above the horizon; w_i = power_i cos(theta_i); v_i is 0 where the object stands between light i and the
    plane. Each light draws the object flattened onto the plane along its own direction.
    basis : (3, 3), its last row the normal of the plane; corners : (n, 3) vertices of the object in its local frame.
    """
    reach = float(np.abs(corners @ basis[:2].T).max() + MAP_HEIGHTS * max((corners @ basis[2]).max(), 0.05))
    cosine = lights.directions @ basis[2]
    weights = lights.power * cosine[:, None]  # (n, 3)
    blocked = context.texture((MAP_PIXELS, MAP_PIXELS), 1, dtype="f1")
    total = context.texture((MAP_PIXELS, MAP_PIXELS), 4, dtype="f4")
    flat, sums = context.framebuffer([blocked]), context.framebuffer([total])
    weigh = context.program(vertex_shader=shader("full.vert"), fragment_shader=shader("weigh.frag"))
    quad = context.buffer(np.array([-1, -1, 1, -1, -1, 1, 1, 1], "f4").tobytes())
    cover = context.vertex_array(weigh, [(quad, "2f", "corner")])
    sums.clear()
    for direction, weight in zip(lights.directions, weights, strict=True):
        flat.use()
        context.disable(context.DEPTH_TEST | context.BLEND)
        flat.clear()
        _cast(program, parts, _shadow_matrix(direction, basis, reach))
        sums.use()
        context.enable(context.BLEND)
        context.blend_func = context.ONE, context.ONE
        blocked.use(0)
        weigh["weight"].value = tuple(float(v) for v in weight)
        cover.render(mode=context.TRIANGLE_STRIP)
    context.disable(context.BLEND)
    lost = np.frombuffer(sums.read(components=3, dtype="f4"), "f4").reshape(MAP_PIXELS, MAP_PIXELS, 3)
    share = 1 - lost / np.maximum(weights.sum(axis=0), 1e-12)
    for thing in (cover, quad, weigh, flat, sums, blocked, total):
        thing.release()
    return PlaneMap(np.clip(share, 0.0, 1.0).astype(np.float32), reach)


def _shadow_matrix(direction: FloatArray, basis: FloatArray, reach: float) -> FloatArray:
    """(4, 4) from the local frame along a light onto the plane, -1 to 1 over the map; what is below is clipped."""
    rise = float(direction @ basis[2])
    clip = np.zeros((4, 4))
    for row in range(2):
        slope = float(direction @ basis[row]) / rise
        clip[row, :3] = (basis[row] - slope * basis[2]) / reach
    # depth: 0 on the plane, a little below it is still drawn
    clip[2, :3] = basis[2] / (100.0 * reach)
    clip[3, 3] = 1.0
    return clip


def _cast(program: Any, parts: Sequence[LoadedPart], clip: FloatArray) -> None:
    """Draw the parts that cast a shadow through `clip` (4, 4)."""
    program["clip"].write(clip.T.astype("f4").tobytes())
    for part in parts:
        if part.material.blend and part.material.base_color[3] < CASTING_ALPHA:
            continue
        part.bind(program)
        part.cast.render()

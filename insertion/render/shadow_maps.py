"""What the object takes from the light: a shadow map for each light, and the map of light that reaches the plane.

Each map has hard edges; a shadow is soft because a lamp is many lights (`insertion/light/light_samples.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insertion.light.light_samples import LightSamples
from insertion.render.gpu import GpuPart, shader
from metric_base.arrays import FloatArray

#: Pixels along one light's shadow map.
TILE = 320
#: Pixels along the map of light on the plane, and how far it reaches, in heights of the object over its foot.
MAP_PIXELS = 768
MAP_HEIGHTS = 3.0
#: Pixels along the same map of the light without the object, which changes slowly.
OPEN_PIXELS = 32
#: A part with alpha blending casts a shadow if it hides at least half.
CASTING_ALPHA = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Caster:
    """The sphere about what casts shadows: centre (3,) and radius in the local frame."""

    centre: FloatArray
    radius: float


@dataclass(frozen=True, slots=True, eq=False)
class ShadowCatcher:
    """share : (MAP_PIXELS, MAP_PIXELS, 3) of the light that still reaches the support plane; radius : half its side.

    Columns go along the plane's first axis, rows along its second, from -radius to radius about the object's foot.
    """

    share: NDArray[np.float32]
    radius: float


def light_axes(lights: LightSamples, radius: float) -> tuple[FloatArray, FloatArray]:
    """(n, 3) right and up axes of each light's shadow map, divided by the radius of what casts.

    A light at the distance d sees the sphere of radius r under the tangent r / sqrt(d^2 - r^2).
    """
    seed = np.where(np.abs(lights.directions[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    right = np.cross(seed, lights.directions)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    wide = (radius / np.sqrt(1 - np.minimum(radius * lights.near, 0.9) ** 2))[:, None]
    return right / wide, np.cross(lights.directions, right) / wide


def shadow_atlas(context: Any, program: Any, parts: Sequence[GpuPart], lights: LightSamples, caster: Caster) -> Any:
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
        clip[3, :3] = -lights.near[row] * direction  # a light at a finite distance sees in perspective
        clip[:, 3] = -clip[:, :3] @ caster.centre + [0, 0, 0, 1]
        target.viewport = (row % tiles * TILE, row // tiles * TILE, TILE, TILE)
        _cast(program, parts, clip)
    target.release()
    return atlas


def shadow_catcher(
    context: Any,
    program: Any,
    parts: Sequence[GpuPart],
    lights: LightSamples,
    returned: FloatArray,
    basis: FloatArray,
    corners: FloatArray,
    others: Sequence[GpuPart] = (),
    all_corners: FloatArray | None = None,
) -> ShadowCatcher:
    """The light on the support plane with the object over it without: 1 - sum of (w_i - b_i) h_i / sum of w_i.

    Beside `others`, which are inserted already, it is the light with all objects over the light with the others alone,
    so that the shares of several objects multiply to the light with all; all_corners : (n, 3) the vertices of all.

    lights : above the horizon, about the object's foot; w_i = power_i cos(theta_i) d_i^2 / r_i^2 at each place of the
    plane; h_i is 1 where the object stands between light i and the plane, which then gets b_i = returned_i (n, 3)
    cos(theta_i) from the object. Each light draws the object flattened onto the plane along its own rays.
    basis : (3, 3), its last row the normal of the plane; corners : (n, 3) vertices of the object in its local frame.
    """
    reach = float(np.abs(corners @ basis[:2].T).max() + MAP_HEIGHTS * max((corners @ basis[2]).max(), 0.05))
    local = lights.directions @ basis.T  # (n, 3) along the plane's axes
    arguments = (context, program, lights, local, returned, basis, reach)
    ends = corners if all_corners is None else all_corners
    missing = _missing_light(*arguments, [*parts, *others], ends)
    before = np.zeros_like(missing) if not others else _missing_light(*arguments, others, ends)
    left = _open_light(local, lights, reach) - before
    share = 1 - np.maximum(missing - before, 0.0) / np.maximum(left, 1e-12)
    return ShadowCatcher(np.clip(share, 0.0, 1.0).astype(np.float32), reach)


def _missing_light(
    context: Any,
    program: Any,
    lights: LightSamples,
    local: FloatArray,
    returned: FloatArray,
    basis: FloatArray,
    reach: float,
    parts: Sequence[GpuPart],
    corners: FloatArray,
) -> NDArray[np.float32]:
    """(MAP_PIXELS, MAP_PIXELS, 3) irradiance that parts with vertices `corners` (n, 3) take from the plane.

    local : (n, 3) the lights' directions along the plane's axes; the other arguments are those of `plane_map`.
    """
    blocked = context.texture((MAP_PIXELS, MAP_PIXELS), 1, dtype="f1")
    lost = context.texture((MAP_PIXELS, MAP_PIXELS), 4, dtype="f4")
    flat, sums = context.framebuffer([blocked]), context.framebuffer([lost])
    weigh = context.program(vertex_shader=shader("full.vert"), fragment_shader=shader("accumulate.frag"))
    weigh["reach"].value = reach
    quad = context.buffer(np.array([-1, -1, 1, -1, -1, 1, 1, 1], "f4").tobytes())
    cover = context.vertex_array(weigh, [(quad, "2f", "corner")])
    sums.clear()
    ends = np.stack(np.meshgrid(*zip(corners.min(axis=0), corners.max(axis=0), strict=True)), axis=-1).reshape(-1, 3)
    for number, (direction, near, power, back) in enumerate(
        zip(local, lights.near, lights.power, returned, strict=True)
    ):
        matrix = _shadow_matrix(direction, float(near), basis, reach)
        matrix[:2] += _shift(number)[:, None] * matrix[3]
        flat.scissor = sums.scissor = _part_of_map(matrix, ends)
        flat.use()
        context.disable(context.DEPTH_TEST | context.BLEND)
        flat.clear()
        _cast(program, parts, matrix)
        sums.use()
        context.enable(context.BLEND)
        context.blend_func = context.ONE, context.ONE
        blocked.use(0)
        weigh["direction"].value, weigh["near"].value = tuple(float(v) for v in direction), float(near)
        weigh["power"].value, weigh["returned"].value = tuple(map(float, power)), tuple(map(float, back))
        cover.render(mode=context.TRIANGLE_STRIP)
    context.disable(context.BLEND)
    missing = np.frombuffer(sums.read(components=3, dtype="f4"), "f4").reshape(MAP_PIXELS, MAP_PIXELS, 3).copy()
    for resource in (cover, quad, weigh, flat, sums, blocked, lost):
        resource.release()
    return missing


def _open_light(directions: FloatArray, lights: LightSamples, reach: float) -> NDArray[np.float32]:
    """(MAP_PIXELS, MAP_PIXELS, 3) irradiance of the plane without the object; directions : (n, 3) on its own axes."""
    import cv2

    at = ((np.arange(OPEN_PIXELS) + 0.5) / OPEN_PIXELS * 2 - 1) * reach
    y, x = np.meshgrid(at, at, indexing="ij")
    plane = np.stack([x, y, np.zeros_like(x)], axis=-1)[..., None, :]  # (p, p, 1, 3)
    far = np.linalg.norm(directions - plane * lights.near[:, None], axis=-1)  # (p, p, n)
    light = (directions[:, 2] / far**3) @ lights.power
    return np.asarray(cv2.resize(light.astype(np.float32), (MAP_PIXELS, MAP_PIXELS), interpolation=cv2.INTER_LINEAR))


def _shift(number: int) -> FloatArray:
    """(2,) part of a pixel by which the shadow of a light is moved: the sum of all then has smooth edges."""
    return np.asarray(np.mod(number * np.array([0.7548777, 0.5698403]), 1.0) * 2 - 1) / MAP_PIXELS


def _part_of_map(matrix: FloatArray, ends: FloatArray) -> tuple[int, int, int, int]:
    """Pixels (x, y, width, height) of the map that `matrix` (4, 4) may darken; ends : (8, 3) of a box of what casts."""
    clip = np.column_stack([ends, np.ones(len(ends))]) @ matrix.T
    if (clip[:, 3] < 1e-3 * matrix[3, 3]).any():
        return 0, 0, MAP_PIXELS, MAP_PIXELS
    at = (clip[:, :2] / clip[:, 3:] * 0.5 + 0.5) * MAP_PIXELS
    low = np.clip(np.floor(at.min(axis=0)) - 2, 0, MAP_PIXELS).astype(int)
    high = np.clip(np.ceil(at.max(axis=0)) + 2, low, MAP_PIXELS).astype(int)
    return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])


def _shadow_matrix(direction: FloatArray, near: float, basis: FloatArray, reach: float) -> FloatArray:
    """(4, 4) from the local frame along a light's rays onto the plane, -1 to 1 over the map.

    direction : (3,) along the plane's axes, of a light at the distance 1 / near. A point at (x, y, z) meets the plane
    at ((d_z x - d_x z) / w, (d_z y - d_y z) / w) with w = d_z - near z; what is as high as the light is clipped.
    """
    clip = np.zeros((4, 4))
    for row in range(2):
        clip[row, :3] = (direction[2] * basis[row] - direction[row] * basis[2]) / reach
    # depth: 0 on the plane, a little below it is still drawn
    clip[2, :3] = direction[2] * basis[2] / (100.0 * reach)
    clip[3, :3], clip[3, 3] = -near * basis[2], direction[2]
    return clip


def _cast(program: Any, parts: Sequence[GpuPart], clip: FloatArray) -> None:
    """Draw the parts that cast a shadow through `clip` (4, 4)."""
    program["clip"].write(clip.T.astype("f4").tobytes())
    for part in parts:
        if part.material.blend and part.material.base_color[3] < CASTING_ALPHA:
            continue
        part.bind(program)
        part.cast.render()

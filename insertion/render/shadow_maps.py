"""Shadow maps of an object, one per light, and the fraction of the light that reaches the support plane.

The edges in each map are hard; shadows are soft because a lamp consists of many lights (`light/light_samples.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insertion.light.light_samples import LightSamples
from insertion.render.gpu import CAST_LAYOUT, GpuPart, read_layer, release
from insertion.render.gpu import program as program_of
from metric_base.arrays import FloatArray

#: Side of the shadow map of one light, in pixels.
TILE = 320
#: Side of the map of the light on the support plane, in pixels.
MAP_PIXELS = 768
#: Maximum length of a shadow on the plane, in heights of the object.
MAP_HEIGHTS = 3.0
#: Side of the map of the light without the object, in pixels: this light changes slowly over the plane.
OPEN_PIXELS = 32
#: Minimum alpha of a blended part that casts a shadow.
CASTING_ALPHA = 0.5
#: Fraction of the light that passes through an object of clear glass: the mean over a hollow cylinder lit from the
#: side, with the reflections of four surfaces with an index of refraction of 1.5.
GLASS_TRANSMITTANCE = 0.78


@dataclass(frozen=True, slots=True, eq=False)
class Caster:
    """Bounding sphere of the objects that cast shadows: centre (3,) and radius in the local frame."""

    centre: FloatArray
    radius: float

    @classmethod
    def around(cls, corners: FloatArray) -> Caster:
        """Return the bounding sphere of vertices (n, 3), enlarged by 2 %."""
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        return cls(middle, float(np.linalg.norm(corners - middle, axis=1).max()) * 1.02)


@dataclass(frozen=True, slots=True, eq=False)
class ShadowCatcher:
    """Fraction of the light that reaches the support plane around the foot of an object.

    Attributes
    ----------
    share : (MAP_PIXELS, MAP_PIXELS, 3) ndarray of float32
        The fraction; columns are along the first axis of the plane and rows along the second, from -radius to radius.
    radius : float
        Half the side of the map.
    """

    share: NDArray[np.float32]
    radius: float


def light_axes(lights: LightSamples, radius: float) -> tuple[FloatArray, FloatArray]:
    """Return the right and up axes (n, 3) of the shadow map of each light, divided by the radius of the caster.

    A light at the distance d sees a sphere of radius r at an angle with the tangent r / sqrt(d^2 - r^2).
    """
    seed = np.where(np.abs(lights.directions[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    right = np.cross(seed, lights.directions)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    wide = (radius / np.sqrt(1 - np.minimum(radius * lights.near, 0.9) ** 2))[:, None]
    return right / wide, np.cross(lights.directions, right) / wide


def shadow_atlas(context: Any, program: Any, parts: Sequence[GpuPart], lights: LightSamples, caster: Caster) -> Any:
    """Return a depth texture with a tile per light."""
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
        program["clip"].write(clip.T.astype("f4").tobytes())
        for part in parts:
            if _is_opaque(part):
                part.bind(program)
                part.cast.render()
    target.release()
    return atlas


def shadow_catcher(
    context: Any,
    parts: Sequence[GpuPart],
    lights: LightSamples,
    returned: FloatArray,
    basis: FloatArray,
    corners: FloatArray,
    others: Sequence[GpuPart] = (),
    sunlit: Callable[[FloatArray], FloatArray] | None = None,
) -> ShadowCatcher:
    """Compute the ratio of the light on the support plane with and without the object.

    The ratio is::

        1 - sum_i (w_i - b_i) h_i / sum_i w_i

    with w_i = power_i cos(theta_i) d_i^2 / r_i^2, h_i = 1 if the object occludes light i, and the bounce light
    b_i = returned_i cos(theta_i). Each light projects the object onto the plane along its rays.

    Parameters
    ----------
    parts : sequence of GpuPart
        The object.
    lights : LightSamples
        Lights above the horizon, relative to the foot of the object.
    returned : (n, 3) ndarray of float
        Bounce light of the object for each light.
    basis : (3, 3) ndarray of float
        Axes of the plane; the last row is its normal.
    corners : (n, 3) ndarray of float
        Vertices of the object in its local frame.
    others : sequence of GpuPart
        Objects that are already inserted. The result is then the light with all objects divided by the light with
        `others`, so that the product of the results of several objects is the light with all of them.
    sunlit : callable, optional
        Returns the fraction (...) of the sun that the scene lets through at positions (..., 3) in the local frame.
    """
    reach = float(np.abs(corners @ basis[:2].T).max() + MAP_HEIGHTS * max((corners @ basis[2]).max(), 0.05))
    local = lights.directions @ basis.T  # (n, 3) along the plane's axes
    at = ((np.arange(OPEN_PIXELS) + 0.5) / OPEN_PIXELS * 2 - 1) * reach
    plane = np.stack([*np.meshgrid(at, at), np.zeros((OPEN_PIXELS, OPEN_PIXELS))], axis=-1)  # (p, p, 3)
    reaching = np.ones(plane.shape[:2]) if sunlit is None else sunlit(plane @ basis)
    missing, before = _missing_light(context, lights, local, returned, basis, reach, reaching, parts, others)
    share = 1 - missing / np.maximum(_open_light(local, lights, plane, reaching) - before, 1e-12)
    return ShadowCatcher(np.clip(share, 0.0, 1.0).astype(np.float32), reach)


def _missing_light(
    context: Any,
    lights: LightSamples,
    local: FloatArray,
    returned: FloatArray,
    basis: FloatArray,
    reach: float,
    reaching: FloatArray,
    parts: Sequence[GpuPart],
    others: Sequence[GpuPart],
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the irradiance (MAP_PIXELS, MAP_PIXELS, 3) that only parts occlude on the plane, and that of the others.

    `local` (n, 3) are the directions of the lights along the axes of the plane, `reaching` (p, p) is the fraction of
    the lamps that the scene lets through. Each light has a depth closer than that of the previous one, so that the
    depth test passes one triangle per pixel and light: the others before the parts, and glass, which removes less
    light, last.
    """
    size = (MAP_PIXELS, MAP_PIXELS)
    lost = [context.texture(size, 4, dtype="f4") for _ in range(2)]
    sums = context.framebuffer(lost, context.depth_renderbuffer(size))
    masks = [
        context.texture(values.shape[::-1], 1, values.astype("f4").tobytes(), dtype="f4")
        for values in (np.ones((1, 1)), reaching)
    ]
    program = program_of(context, "depth_only.vert", "catcher.frag", SIDE=MAP_PIXELS)
    program["reach"].value, program["reaching"].value = reach, 1
    casters = [part for part in (*others, *parts) if _is_opaque(part) or part.material.transmission > 0]
    casters.sort(key=lambda part: part.material.transmission)
    are_others = [any(part is other for other in others) for part in casters]
    arrays = [context.vertex_array(program, [(part.buffers[0], *CAST_LAYOUT)], part.buffers[1]) for part in casters]
    removed = [1 - part.material.transmission * GLASS_TRANSMITTANCE * part.material.tint for part in casters]
    sums.use()
    sums.clear(depth=1.0)
    context.enable(context.DEPTH_TEST | context.BLEND)
    context.blend_func = context.ONE, context.ONE
    for number, (direction, near, power, back) in enumerate(
        zip(local, lights.near, lights.power, returned, strict=True)
    ):
        matrix = _shadow_matrix(direction, float(near), basis, reach)
        # shifted by a fraction of a pixel, so that the sum has smooth edges
        shift = np.mod(number * np.array([0.7548777, 0.5698403]), 1.0) * 2 - 1
        matrix[:2] += shift[:, None] / MAP_PIXELS * matrix[3]
        program["clip"].write(matrix.T.astype("f4").tobytes())
        program["depth"].value = 1 - (number + 1) / (len(local) + 1)
        masks[int(near > 0)].use(1)
        program["direction"].value, program["near"].value = tuple(float(v) for v in direction), float(near)
        program["power"].value, program["returned"].value = tuple(map(float, power)), tuple(map(float, back))
        for part, array, loss, is_other in zip(casters, arrays, removed, are_others, strict=True):
            part.bind(program)
            program["removed"].value, program["is_other"].value = tuple(map(float, loss)), is_other
            array.render()
    context.disable(context.DEPTH_TEST | context.BLEND)
    missing, before = (read_layer(sums, size, row, 3).copy() for row in range(2))
    release(*arrays, program, sums, *lost, *masks)
    return missing, before


def _open_light(
    directions: FloatArray, lights: LightSamples, plane: FloatArray, reaching: FloatArray
) -> NDArray[np.float32]:
    """Return the irradiance (MAP_PIXELS, MAP_PIXELS, 3) of positions (p, p, 3) on the plane without objects.

    Parameters
    ----------
    directions : (n, 3) ndarray of float
        Directions of the lights along the axes of the plane.
    reaching : (p, p) ndarray of float
        Fraction of the lamps that the scene lets through.
    """
    import cv2

    far = np.linalg.norm(directions - plane[..., None, :] * lights.near[:, None], axis=-1)  # (p, p, n)
    light = (np.where(lights.near > 0, reaching[..., None], 1.0) * directions[:, 2] / far**3) @ lights.power
    return np.asarray(cv2.resize(light.astype(np.float32), (MAP_PIXELS, MAP_PIXELS), interpolation=cv2.INTER_LINEAR))


def _shadow_matrix(direction: FloatArray, near: float, basis: FloatArray, reach: float) -> FloatArray:
    """Return the projection (4, 4) from the local frame along the rays of a light onto the plane, -1 to 1 over the map.

    `direction` (3,) is that of a light at the distance 1 / near, in the axes of the plane. A point (x, y, z) is
    projected to ((d_z x - d_x z) / w, (d_z y - d_y z) / w) with w = d_z - near z; points above the light are clipped.
    """
    clip = np.zeros((4, 4))
    for row in range(2):
        clip[row, :3] = (direction[2] * basis[row] - direction[row] * basis[2]) / reach
    # depth: 0 on the plane; points slightly below it are drawn
    clip[2, :3] = direction[2] * basis[2] / (100.0 * reach)
    clip[3, :3], clip[3, 3] = -near * basis[2], direction[2]
    return clip


def _is_opaque(part: GpuPart) -> bool:
    return not part.material.blend or part.material.base_color[3] >= CASTING_ALPHA

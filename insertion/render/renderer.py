"""Render an object under the light at its position through any camera.

Shadow maps, light on the support plane and reflections do not depend on the camera; they are computed once for each
pose of the object.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insertion.colour import luminance
from insertion.light.environment_map import LEVELS, Environment, prefiltered_environment
from insertion.light.light_samples import LightSamples, sample_lights
from insertion.render.body import Body, BodyPart, environment_with_objects
from insertion.render.deferred import STEP_PX, DeferredTargets
from insertion.render.gpu import GpuPart, load_part, program, read_layer, release
from insertion.render.shadow_maps import Caster, ShadowCatcher, light_axes, shadow_atlas, shadow_catcher
from insertion.scene.camera_rays import Window
from metric_base.arrays import FloatArray

#: Divisions of the environment into 2 ** cuts lights, for objects and for the support plane (computed only once).
OBJECT_CUTS, PLANE_CUTS = 6, 7
SAMPLES = 4
#: Minimum component of a refracted ray along the optical axis; rays that turn further show the edge of the image.
MIN_AHEAD = 0.3
#: Texture units; materials and geometry buffers use the ones between them.
_ATLAS, _PLANE, _ENVIRONMENT, _OTHERS, _SUNLIT = 0, 1, 2, 12, 13
#: Side of the grid about the object on which the visibility of the sun is tested, in cells.
SUNLIT_CELLS = 16
#: Standard deviation of its smoothing, in cells: the edges of occupied cells are steps.
SUNLIT_SIGMA = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class ObjectImage:
    """Image of an object without background.

    Attributes
    ----------
    colour : (h, w, 3) ndarray of float32
        Linear radiance times coverage.
    alpha : (h, w) ndarray of float32
        Coverage.
    depth : (h, w) ndarray of float32
        Depth along the optical axis in scene units, NaN outside of the object.
    glass : (h, w, 4) ndarray of float32, optional
        Light of the background that glass transmits, times the coverage of the glass, and this coverage. The background
        is replaced by it; None without glass.
    shift : (h, w, 2) ndarray of float32, optional
        Distance in pixels to the part of an infinitely far background that the glass shows.
    """

    colour: NDArray[np.float32]
    alpha: NDArray[np.float32]
    depth: NDArray[np.float32]
    glass: NDArray[np.float32] | None = None
    shift: NDArray[np.float32] | None = None

    @property
    def coverage(self) -> NDArray[np.float32]:
        """(h, w) coverage with the glass."""
        return self.alpha if self.glass is None else self.alpha + (1 - self.alpha) * self.glass[..., 3]


class ObjectRenderer:
    """Renderer of a body in an OpenGL context (`gl_context`), which several renderers may share."""

    def __init__(
        self,
        context: Any,
        body: Body,
        environment: Environment,
        ground: Environment | None = None,
        *,
        casters: Sequence[Body] = (),
        earlier: Sequence[Body] = (),
        moves: bool = False,
    ) -> None:
        """Prepare the shaders and the first pose.

        Parameters
        ----------
        environment : Environment
            Environment at the centre of the body.
        ground : Environment, optional
            Environment at the foot of the body, if it differs.
        casters : sequence of Body
            Other inserted bodies, which cast shadows on this one and are reflected in it.
        earlier : sequence of Body
            Casters whose shadow on the support is already in the image.
        moves : bool, default False
            Whether `set_pose` will be called again.
        """
        self.environment, self._ground = environment, environment if ground is None else ground
        self._context, self._moves = context, moves
        number = len(_local_lights(environment, body, OBJECT_CUTS, Caster.around(body.corners).centre, 0.0).power)
        lit = {"N_LIGHTS": number, "TILES": int(np.ceil(np.sqrt(number)))}
        self._has_sun = environment.lamps is not None and environment.lamps.occupancy is not None
        if self._has_sun:
            lit["SUNLIT"] = 1
        others = {"OTHERS": 1} if any(moves or body.is_near(other) for other in casters) else {}
        self._program = program(context, "surface.vert", "surface.frag", **lit, **others)
        self._receive = program(context, "full.vert", "receive.frag", **lit)
        self._gather = program(context, "surface.vert", "gbuffer.frag")
        self._glass = program(context, "surface.vert", "glass.frag")
        self._light = program(context, "full.vert", "lighting.frag", SAMPLES=SAMPLES, **lit, **others)
        self._cast = program(context, "depth_only.vert", "depth_only.frag")
        self._parts: list[GpuPart] = []
        self._textures: dict[int, Any] = {}  # of the light, by texture unit
        self._mirrors = False
        self.set_pose(body, casters, earlier)
        self._solid = not any(part.material.blend for part in self._parts)
        self._deferred = DeferredTargets(self._context, SAMPLES)
        self._target_size: tuple[int, int] | None = None
        self._targets: tuple[Any, Any] = None, None
        quad = self._context.buffer(np.array([-1, -1, 1, -1, -1, 1, 1, 1], "f4").tobytes())
        self._cover = self._context.vertex_array(self._receive, [(quad, "2f", "corner")])
        self._light_cover = self._context.vertex_array(self._light, [(quad, "2f", "corner")])

    def set_pose(self, body: Body, casters: Sequence[Body] = (), earlier: Sequence[Body] = ()) -> None:
        """Set the pose of the body, which keeps its parts, and of the other bodies; the light is unchanged.

        Shadow maps, light on the support plane and reflections are computed again.
        """
        self.body = body
        caster = Caster.around(body.corners)
        lights = _local_lights(self.environment, body, OBJECT_CUTS, caster.centre, caster.radius)
        #: (n, 3) towards the lights that cast the shadow
        self.shadow_directions = _strongest(lights)
        first = not self._parts
        if first:
            gather, glass = self._gather, self._glass
            self._parts = [self._load(part, glass if part.material.transmission else gather) for part in body.parts]
        else:
            self._parts = [old.at_vertices(part) for old, part in zip(self._parts, body.parts, strict=True)]
        self._set_texture(_ATLAS, shadow_atlas(self._context, self._cast, self._parts, lights, caster))
        # a moving body is computed again for each frame
        cuts = OBJECT_CUTS if self._moves else PLANE_CUTS
        above = _local_lights(self._ground, body, cuts, np.zeros(3), 0.0).above_horizon(body.basis[2])
        returned = _bounce_light(self._ground, body, above)
        loaded = [self._load(part) for other in earlier if body.is_near(other) for part in body.parts_of(other)]
        sunlit = self._sunlit_fraction if self._has_sun else None
        self.plane: ShadowCatcher = shadow_catcher(
            self._context, self._parts, above, returned, body.basis, body.corners, loaded, sunlit
        )
        release(*loaded)
        for shaded in (self._program, self._light, self._receive):
            _set_lights(shaded, lights, _bounce_light(self.environment, body, lights), caster)
            shaded["shadow_atlas"].value = _ATLAS
        if self._has_sun:
            self._set_sunlit()
        near = [other for other in casters if body.is_near(other)]
        if "other_atlas" in self._program:
            self._set_others(near)
        share = self.plane.share
        self._set_texture(_PLANE, self._context.texture(share.shape[1::-1], 3, share.tobytes(), dtype="f4"))
        for surface in (self._program, self._light):
            surface["map_radius"].value = self.plane.radius
            surface["map_centre"].value = tuple(0.5 * float((body.corners @ body.basis[2]).max()) * body.basis[2])
        if first or near or self._mirrors:
            self._set_surroundings(environment_with_objects(self.environment, body, near))
        self._mirrors = bool(near)

    def _load(self, part: BodyPart, facts: Any = None) -> GpuPart:
        return load_part(self._context, self._program, self._cast, part, facts)

    def _set_others(self, others: Sequence[Body]) -> None:
        """Compute the shadow maps of the other bodies; they are empty without bodies."""
        parts = [part for other in others for part in self.body.parts_of(other)]
        caster = Caster.around(np.concatenate([part.vertices for part in parts]) if parts else self.body.corners)
        lights = _local_lights(self.environment, self.body, OBJECT_CUTS, caster.centre, caster.radius)
        loaded = [self._load(part) for part in parts]
        self._set_texture(_OTHERS, shadow_atlas(self._context, self._cast, loaded, lights, caster))
        release(*loaded)
        for surface in (self._program, self._light):
            _set_lights(surface, lights, None, caster, "other")
            surface["other_atlas"].value = _OTHERS

    def _sunlit_fraction(self, local: FloatArray) -> FloatArray:
        """Return the fraction (a, b, ...) of the sun that the scene lets through at local positions (a, b, ..., 3)."""
        from scipy.ndimage import gaussian_filter

        lamps, up = self.environment.lamps, self.body.basis[2]
        assert lamps is not None
        assert lamps.occupancy is not None
        places = (self.body.position + self.body.unit * local).reshape(-1, 3)
        is_open = lamps.occupancy.is_unobstructed(places, np.broadcast_to(up, places.shape), lamps.positions)
        return np.asarray(gaussian_filter(is_open.mean(axis=0).reshape(local.shape[:-1]), SUNLIT_SIGMA, mode="nearest"))

    def _set_sunlit(self) -> None:
        """Compute the visibility of the sun on a grid about the body."""
        low, high = self.body.corners.min(axis=0), self.body.corners.max(axis=0)
        size = np.maximum(high - low, 1e-3)
        steps = (np.arange(SUNLIT_CELLS) + 0.5) / SUNLIT_CELLS
        z, y, x = np.meshgrid(steps, steps, steps, indexing="ij")
        fraction = self._sunlit_fraction(low + size * np.stack([x, y, z], axis=-1)).astype("f4")
        grid = self._context.texture3d((SUNLIT_CELLS,) * 3, 1, fraction.tobytes(), dtype="f4")
        grid.repeat_x = grid.repeat_y = grid.repeat_z = False
        self._set_texture(_SUNLIT, grid)
        for lit in (self._program, self._light, self._receive):
            lit["sunlit"].value, lit["sunlit_low"].value, lit["sunlit_size"].value = _SUNLIT, tuple(low), tuple(size)

    def outline(
        self, window: Window, rotation: FloatArray, translation: FloatArray, times: float
    ) -> NDArray[np.float32]:
        """Return the coverage (h, w) of the object scaled by `times` about its foot."""
        body, self.body = self.body, replace(self.body, unit=self.body.unit * times)
        coverage = self.image(window, rotation, translation).coverage
        self.body = body
        return coverage

    def image(self, window: Window, rotation: FloatArray, translation: FloatArray) -> ObjectImage:
        """Return the image of the object in a window; rotation (3, 3) and translation (3,) are world to camera."""
        offset = self._set_camera(self.body, window, rotation, translation)
        if self._solid:
            self._use_light()
            colour, seen = self._deferred.draw(self._parts, self._gather, self._light_cover, self._cast, window)
        else:
            colour, seen = self._forward(window, -rotation.T @ offset)
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = np.where(seen[..., 1] > 0.01, seen[..., 0] / seen[..., 1], np.nan) * self.body.unit
        image = ObjectImage(colour[..., :3].copy(), np.clip(colour[..., 3], 0, 1), depth.astype(np.float32))
        if not any(part.material.transmission > 0 for part in self._parts):
            return image
        glass, shift = self._glass_layers(window, rotation)
        return replace(image, glass=glass, shift=shift)

    def _glass_layers(self, window: Window, rotation: FloatArray) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return `glass` (h, w, 4) and `shift` (h, w, 2) of `ObjectImage`, after `_forward` has drawn the same window.

        A surface with the outward normal N adds -(sqrt(n^2 - 1 + c^2) - c) N to the direction of a ray times the index
        of refraction, with the index n of the glass and the cosine c of the angle outside. The direction behind the
        object is the sum over all surfaces, with the angles of the straight ray.
        """
        import cv2

        context, (smooth, plain) = self._context, self._target(window.width, window.height)
        smooth.use()
        smooth.depth_mask = False  # opaque parts hide the glass behind them
        smooth.clear()
        context.enable(context.DEPTH_TEST | context.BLEND)  # sums of the colours, and coverage
        context.blend_func = context.ONE, context.ONE, context.ONE, context.ONE_MINUS_SRC_ALPHA
        for part in self._parts:
            if part.material.transmission > 0:
                part.bind(self._glass)
                part.gathered.render()
        smooth.depth_mask = True
        context.disable(context.BLEND)
        context.copy_framebuffer(plain, smooth)
        size = window.width, window.height
        coverage = read_layer(plain, size, 1, 4)[..., 3:]
        # a rim one pixel wide would show single pixels of remote parts of the frame
        passed, bend = (
            cv2.medianBlur(read_layer(plain, size, row, 3) / np.maximum(coverage, 1e-6), 3) for row in range(2)
        )
        x = (np.arange(window.width) + window.x0 + 0.5 - window.cx) / window.fx
        y = (np.arange(window.height) + window.y0 + 0.5 - window.cy) / window.fy
        ray = np.dstack([*np.meshgrid(x, y), np.ones((window.height, window.width))])
        behind = ray / np.linalg.norm(ray, axis=-1, keepdims=True) + bend @ rotation.T
        shift = (behind[..., :2] / np.maximum(behind[..., 2:], MIN_AHEAD) - ray[..., :2]) * [window.fx, window.fy]
        glass = np.dstack([coverage * np.exp(passed), coverage])
        return glass.astype(np.float32), shift.astype(np.float32)

    def _set_camera(self, body: Body, window: Window, rotation: FloatArray, translation: FloatArray) -> FloatArray:
        """Set the camera (world to camera) in the shaders and return its translation (3,) in the local frame."""
        rotation, offset = body.camera(rotation, translation)
        depths = self.body.corners @ rotation[2] + offset[2]
        near = max(float(depths.min()) * 0.8, 1e-3)
        clip = window.projection(rotation, offset, near, max(float(depths.max()) * 1.2, near * 2))
        eye = tuple(float(v) for v in -rotation.T @ offset)
        for surface in (self._program, self._gather, self._glass):
            surface["clip"].write(clip.T.astype("f4").tobytes())
            if "depth_row" in surface:
                surface["depth_row"].value = (*(float(v) for v in rotation[2]), float(offset[2]))
            surface["eye"].value = eye
        self._cast["clip"].write(clip.T.astype("f4").tobytes())
        self._light["eye"].value = eye
        return offset

    def _forward(self, window: Window, eye: FloatArray) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Render by forward shading; return colour and coverage (h, w, 4), and depth times coverage and coverage.

        `eye` (3,) is the camera centre in the local frame.
        """
        context, (smooth, plain) = self._context, self._target(window.width, window.height)
        size = window.width, window.height
        smooth.use()
        smooth.viewport = (0, 0, *size)
        context.enable(context.DEPTH_TEST)
        context.disable(context.BLEND)
        smooth.clear()
        self._use_light()
        solid = [part for part in self._parts if not part.material.blend]
        clear = sorted((p for p in self._parts if p.material.blend), key=lambda p: -np.linalg.norm(p.middle - eye))
        for part in solid:
            part.bind(self._program)
            part.drawn.render()
        context.enable(context.BLEND)
        context.blend_func = context.ONE, context.ONE_MINUS_SRC_ALPHA
        smooth.depth_mask = False
        for part in clear:
            part.bind(self._program)
            part.drawn.render()
        smooth.depth_mask = True
        context.disable(context.BLEND)
        context.copy_framebuffer(plain, smooth)
        return read_layer(plain, size, 0, 4), read_layer(plain, size, 1, 2)

    def irradiance_fraction(self, places: NDArray[np.float32], normals: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the fraction (h, w, 3) of the light that reaches the surfaces of other objects.

        Parameters
        ----------
        places : (h, w, 4) ndarray of float32
            Positions in the local frame; the fourth component is 1 if the position is known.
        normals : (h, w, 3) ndarray of float32
            Unit normals.
        """
        height, width = places.shape[:2]
        textures = [
            self._context.texture((width, height), 4, np.ascontiguousarray(places, "f4").tobytes(), dtype="f4"),
            self._context.texture((width, height), 3, np.ascontiguousarray(normals, "f4").tobytes(), dtype="f4"),
        ]
        result = self._context.texture((width, height), 4, dtype="f4")
        target = self._context.framebuffer([result])
        target.use()
        self._context.disable(self._context.DEPTH_TEST | self._context.BLEND)
        for unit, texture in enumerate(textures, start=3):
            texture.filter = (self._context.NEAREST, self._context.NEAREST)
            texture.use(unit)
        self._receive["places"].value, self._receive["normals"].value = 3, 4
        self._use_light()
        self._cover.render(mode=self._context.TRIANGLE_STRIP)
        share = np.frombuffer(target.read(components=3, dtype="f4"), "f4").reshape(height, width, 3).copy()
        release(*textures, target, result)
        return share

    def _set_surroundings(self, environment: Environment) -> None:
        basis = self.body.basis
        levels = prefiltered_environment(environment)
        texture = self._context.texture(levels[0].shape[1::-1], 3, levels[0].tobytes(), dtype="f4")
        texture.build_mipmaps(0, LEVELS)
        for level, image in enumerate(levels):
            texture.write(np.ascontiguousarray(image).tobytes(), level=level)
        texture.filter = (self._context.LINEAR_MIPMAP_LINEAR, self._context.LINEAR)
        texture.repeat_y = False
        self._set_texture(_ENVIRONMENT, texture)
        for surface in (self._program, self._light):
            for name, row in (("plane_one", 0), ("plane_two", 1), ("plane_up", 2)):
                surface[name].value = tuple(float(v) for v in basis[row])
            surface["catcher_map"].value, surface["environment"].value = _PLANE, _ENVIRONMENT
            surface["blurriest_level"].value = float(LEVELS)

    def _set_texture(self, unit: int, texture: Any) -> None:
        """Store a texture of the light and release the previous one."""
        release(self._textures.get(unit))
        self._textures[unit] = texture

    def _use_light(self) -> None:
        """Bind the textures of the light; all renderers of a context share the texture units."""
        for unit, texture in self._textures.items():
            texture.use(unit)

    def _target(self, width: int, height: int) -> tuple[Any, Any]:
        """Return framebuffers of at least this size, with and without multisampling; the previous pair is released."""
        size = (-(-width // STEP_PX) * STEP_PX, -(-height // STEP_PX) * STEP_PX)
        if size != self._target_size:
            release(*self._targets)
            make = self._context.renderbuffer
            smooth = self._context.framebuffer(
                [make(size, 4, samples=SAMPLES, dtype="f2"), make(size, 4, samples=SAMPLES, dtype="f4")],
                self._context.depth_renderbuffer(size, samples=SAMPLES),
            )
            plain = self._context.framebuffer([make(size, 4, dtype="f2"), make(size, 4, dtype="f4")])
            self._target_size, self._targets = size, (smooth, plain)
        return self._targets


def _local_lights(environment: Environment, body: Body, cuts: int, place: FloatArray, radius: float) -> LightSamples:
    """Return the lights for a sphere at `place` (3,) in the frame of the body, with a radius of `radius`."""
    lights = sample_lights(environment, cuts).scaled(body.unit)
    if environment.lamps is None:
        return lights
    middle = (environment.lamps.centre - body.position) / body.unit
    return lights.seen_from(place - middle, radius)


def _strongest(lights: LightSamples) -> FloatArray:
    """Return directions (n, 3) towards the lamps, or without lamps towards the lights with half of the power."""
    if lights.near.any():
        return lights.directions[lights.near > 0]
    order = np.argsort(-luminance(lights.power))
    share = np.cumsum(luminance(lights.power)[order]) / max(float(luminance(lights.power).sum()), 1e-12)
    return lights.directions[order[: int(np.searchsorted(share, 0.5)) + 1]]


def _bounce_light(environment: Environment, body: Body, lights: LightSamples) -> FloatArray:
    """Return the light (n, 3) that the body reflects onto a surface instead of each light that it occludes.

    The surface of the body is assumed to face along the direction of the occluded light, with a Lambertian reflection
    and a uniform colour: solid angle times albedo / pi times the irradiance of the environment.
    """
    back = np.array([environment.irradiance(-direction) for direction in lights.directions])  # (n, 3)
    return np.asarray(lights.angle[:, None] * body.albedo / np.pi * back)


def _set_lights(
    program: Any, lights: LightSamples, returned: FloatArray | None, caster: Caster, prefix: str = "light"
) -> None:
    """Set the lights of a program; `returned` (n, 3) is the bounce light of each (`_bounce_light`)."""
    right, above = light_axes(lights, caster.radius)
    rows = {
        "direction": lights.directions,
        "power": lights.power,
        "near": lights.near,
        "returned": returned,
        "angle": lights.angle,
        "right": right,
        "up": above,
    }
    for name, values in rows.items():
        if f"{prefix}_{name}" in program:
            program[f"{prefix}_{name}"].write(np.ascontiguousarray(values, "f4").tobytes())
    owner = "caster" if prefix == "light" else prefix
    program[f"{owner}_centre"].value = tuple(float(v) for v in caster.centre)
    program[f"{owner}_radius"].value = caster.radius

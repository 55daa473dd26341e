"""Render frames of a synthetic world with OpenGL (EGL): colour, exact depth, and object number at every pixel."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import FloatArray, IntArray
from tests.synthetic.rooms.materials import look_of
from tests.synthetic.rooms.solids import Mesh
from tests.synthetic.rooms.world import Pinhole, Pose, World

__all__ = ["Frame", "NoOpenGL", "Renderer"]

NEAR, FAR = 0.05, 300.0
SKY = (0.75, 0.82, 0.9)
_SHADERS = Path(__file__).parent / "shaders"
#: Colour samples per pixel, for antialiased edges.
_SAMPLES = 4


class NoOpenGL(RuntimeError):
    """No OpenGL context can be created; the message names the missing packages."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """Rendered images of a view.

    colour : (h, w, 3) uint8, or None if it was not rendered.
    depth : (h, w) in metres along the optical axis; inf in the sky.
    ids : (h, w) number of the object; 0 for other surfaces and the sky.
    """

    colour: NDArray[np.uint8] | None
    depth: NDArray[np.float32]
    ids: IntArray


class Renderer:
    """An OpenGL context with the buffers of a world; a context manager."""

    def __init__(self, world: World, texture: float = 1.0) -> None:
        self._world = world
        self._context = _context()
        self._program = self._context.program(
            vertex_shader=(_SHADERS / "surface.vert").read_text(),
            fragment_shader=(_SHADERS / "surface.frag").read_text(),
        )
        rows = [_rows(world.surfaces, 0, world.seed, texture)]
        rows += [_rows(item.mesh, k + 1, world.seed, texture) for k, item in enumerate(world.objects)]
        self._rows = np.concatenate(rows)
        self._buffer = self._context.buffer(self._rows.astype("f4").tobytes(), dynamic=True)
        self._vertices = self._context.vertex_array(
            self._program,
            [(self._buffer, "3f 3f 3f 3f 3f 3f 1f", "place", "grain", "normal", "first", "second", "style", "number")],
        )
        size = (world.camera.width, world.camera.height)
        self._plain = self._context.framebuffer(
            [self._context.renderbuffer(size, 4), self._context.texture(size, 2, dtype="f4")],
            self._context.depth_renderbuffer(size),
        )
        self._smooth = self._context.framebuffer(
            [
                self._context.renderbuffer(size, 4, samples=_SAMPLES),
                self._context.renderbuffer(size, 2, samples=_SAMPLES, dtype="f4"),
            ],
            self._context.depth_renderbuffer(size, samples=_SAMPLES),
        )

    def __enter__(self) -> Renderer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._context.release()

    def frame(self, index: int, colour: bool = True) -> Frame:
        """Render frame `index` of the world's path; without `colour` it takes a fifth of the time."""
        camera, pose = self._world.camera, self._world.poses[index]
        self._move(index)
        self._program["clip"].write(_clip(camera, pose).T.astype("f4").tobytes())
        self._program["eye"].write(np.append(pose.rotation[2], pose.translation[2]).astype("f4").tobytes())
        self._program["focal"].value = camera.focal
        self._program["shaded"].value = False
        self._draw(self._plain)
        shape = (camera.height, camera.width)
        values = np.frombuffer(self._plain.read(components=2, attachment=1, dtype="f4"), "f4").reshape(*shape, 2)
        depth = np.where(values[..., 1] > 0, values[..., 1], np.inf).astype(np.float32)
        return Frame(self._colour(shape) if colour else None, depth, np.rint(values[..., 0]).astype(np.int64))

    def _colour(self, shape: tuple[int, int]) -> NDArray[np.uint8]:
        self._program["shaded"].value = True
        self._draw(self._smooth)
        self._context.copy_framebuffer(self._plain, self._smooth)
        flat = np.frombuffer(self._plain.read(components=3, attachment=0), np.uint8)
        return flat.reshape(*shape, 3).copy()

    def _draw(self, target: Any) -> None:
        target.use()
        self._context.enable(self._context.DEPTH_TEST)
        # clearing fills all attachments; in the plain target the sky's colour would be an object number and a depth
        target.clear(*(SKY if target is self._smooth else (0.0, 0.0, 0.0)), 0.0)
        self._vertices.render()

    def _move(self, index: int) -> None:
        """Move the moving objects to their positions at this frame, with their textures."""
        moving = [(k + 1, item.velocity) for k, item in enumerate(self._world.objects) if np.any(item.velocity)]
        if not moving:
            return
        rows = self._rows.copy()
        for number, velocity in moving:
            rows[rows[:, 18] == number, :3] += velocity * index
        self._buffer.write(rows.astype("f4").tobytes())


def _context() -> Any:
    try:
        import moderngl

        settings: Any = {"backend": "egl"}  # the stub of moderngl has a mapping as type
        return moderngl.create_context(standalone=True, require=330, **settings)
    except Exception as error:
        message = (
            f"no OpenGL context: {error}; install moderngl and libegl1 libgl1-mesa-dri (software rendering is enough)"
        )
        raise NoOpenGL(message) from error


def _clip(camera: Pinhole, pose: Pose) -> FloatArray:
    """Return the transform (4, 4) from world to clip space, with y down, so that the first row read is the top row."""
    x, y = 2 * camera.focal / camera.width, 2 * camera.focal / camera.height
    a, b = (FAR + NEAR) / (FAR - NEAR), -2 * FAR * NEAR / (FAR - NEAR)
    projection = np.array([[x, 0, 0, 0], [0, y, 0, 0], [0, 0, a, b], [0, 0, 1, 0]])
    view = np.eye(4)
    view[:3, :3], view[:3, 3] = pose.rotation, pose.translation
    return np.asarray(projection @ view)


def _rows(mesh: Mesh, number: int, seed: int, texture: float) -> FloatArray:
    """Return vertex data (3 m, 19): position, grain coordinates, normal, two colours, style (3), object number."""
    corners = mesh.vertices[mesh.faces]  # (m, 3, 3)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    names = sorted(set(mesh.material))
    looks = np.array([look_of(name, number, seed, texture) for name in names])  # (k, 12)
    look = looks[np.searchsorted(names, mesh.material)]  # (m, 12)
    grain = corners + look[:, None, 9:12]
    per_face = np.concatenate([normal, look[:, :9], np.full((len(look), 1), float(number))], axis=1)
    return np.concatenate([corners.reshape(-1, 3), grain.reshape(-1, 3), np.repeat(per_face, 3, axis=0)], axis=1)

"""OpenGL context by EGL, which needs no display (llvmpipe suffices), and vertex buffers and textures of a body."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insertion.render.body import BodyPart
from metric_base.errors import InputError
from metric_base.operating_system import gl_settings
from models3d.model import Material

#: Texture unit of each texture of the material, by its name in the shader.
_UNITS = {"base_texture": 3, "surface_texture": 4, "normal_texture": 5, "emissive_texture": 6}
_LAYOUT = "3f 3f 2f 4f"
#: Layout and attributes of the vertices that cast a shadow.
CAST_LAYOUT = "3f 12x 2f 16x", "place", "uv"
_SHADERS = Path(__file__).parent / "shaders"


@dataclass(frozen=True, slots=True, eq=False)
class GpuPart:
    """A part on the graphics card.

    `drawn`, `gathered` and `cast` are its vertex arrays for the image, the geometry buffers and the shadows, and
    `buffers` the buffers of its vertices and faces. `textures` are keyed by name, `middle` (3,) is the mean vertex.
    Glass that `is_solid` refracts; a sheet without a thickness does not.
    """

    drawn: Any
    gathered: Any
    cast: Any
    textures: dict[str, Any]
    material: Material
    middle: NDArray[np.float64]
    buffers: tuple[Any, Any]
    is_solid: bool = False

    def at_vertices(self, part: BodyPart) -> GpuPart:
        """Write the vertices of a body part to the buffer, and return the updated part, which replaces this one."""
        self.buffers[0].write(_rows(part))
        return replace(self, middle=part.vertices.mean(axis=0))

    def release(self) -> None:
        """Release the memory of the graphics card."""
        release(self.drawn, self.gathered, self.cast, *self.textures.values(), *self.buffers)

    def bind(self, program: Any) -> None:
        """Set the uniforms of the material that the shader uses."""
        for name, unit in _UNITS.items():
            flag = "has_" + name.split("_", 1)[0]
            if name in self.textures:
                self.textures[name].use(unit)
            _set(program, flag, name in self.textures)
            _set(program, name, unit)
        cutoff = self.material.alpha_cutoff
        _set(program, "alpha_cutoff", -1.0 if cutoff is None else cutoff)
        _set(program, "base_color", tuple(float(v) for v in self.material.base_color))
        _set(program, "emissive", tuple(float(v) for v in self.material.emissive))
        _set(program, "metallic", self.material.metallic)
        _set(program, "roughness", self.material.roughness)
        _set(program, "transmission", self.material.transmission)
        _set(program, "tint", tuple(float(v) for v in self.material.tint))
        _set(program, "is_solid", self.is_solid)


def load_part(
    context: Any, surface_program: Any, shadow_program: Any, part: BodyPart, geometry_program: Any = None
) -> GpuPart:
    """Upload a part to the graphics card; without a program for geometry buffers, `gathered` is None."""
    vertices = context.buffer(_rows(part))
    index = context.buffer(np.ascontiguousarray(part.faces, dtype="i4").tobytes())
    names = ("place", "normal", "uv", "tint")
    drawn = context.vertex_array(surface_program, [(vertices, _LAYOUT, *names)], index)
    gathered = geometry_program and context.vertex_array(geometry_program, [(vertices, _LAYOUT, *names)], index)
    cast = context.vertex_array(shadow_program, [(vertices, *CAST_LAYOUT)], index)
    material = part.material
    stored = {name: getattr(material, name) for name in _UNITS}
    textures = {name: _texture(context, pixels) for name, pixels in stored.items() if pixels is not None}
    is_solid = material.transmission > 0 and part.is_closed
    middle, buffers = part.vertices.mean(axis=0), (vertices, index)
    return GpuPart(drawn, gathered, cast, textures, material, middle, buffers, is_solid)


def _rows(part: BodyPart) -> bytes:
    """Return the vertices in the layout of the buffer."""
    return np.hstack([part.vertices, part.normals, part.uv, part.tint]).astype("f4").tobytes()


def _texture(context: Any, pixels: NDArray[np.uint8]) -> Any:
    """Return a repeating texture (h, w, c) with mipmaps; the first row is v = 0 in glTF and in OpenGL.

    There is no anisotropic filter, because llvmpipe needs minutes for a pixel with degenerate texture coordinates.
    """
    texture = context.texture((pixels.shape[1], pixels.shape[0]), 4, np.ascontiguousarray(pixels).tobytes())
    texture.build_mipmaps()
    texture.filter = (context.LINEAR_MIPMAP_LINEAR, context.LINEAR)
    return texture


def _set(program: Any, name: str, value: object) -> None:
    uniform = program.get(name, None)  # a test by `in` iterates over all uniforms
    if uniform is not None:
        uniform.value = value


class NoRenderer(InputError):
    """No OpenGL context can be created; the message names the package to install."""


def gl_context() -> Any:
    """Return a moderngl context without a window. Raises NoRenderer with the package to install."""
    try:
        import moderngl
    except ImportError:
        raise NoRenderer("moderngl is not installed; run: pip install 'metric-tree[insert]'") from None
    os.environ.setdefault("EGL_LOG_LEVEL", "fatal")  # otherwise Mesa writes warnings
    try:
        return moderngl.create_context(standalone=True, require=330, **gl_settings())
    except Exception as error:
        reason = " ".join(str(error).split())
        message = f"no OpenGL without a display ({reason}); run: apt-get install libegl1 libgl1-mesa-dri"
        raise NoRenderer(message) from error


def check_renderer() -> None:
    """Raise NoRenderer if there is no OpenGL context, before any work starts."""
    gl_context().release()


def release(*resources: Any) -> None:
    """Release the memory of the graphics card; None is ignored."""
    for resource in resources:
        if resource is not None:
            resource.release()


def program(context: Any, vertex: str, fragment: str, **constants: int) -> Any:
    """Return the program of two shaders with `constants` in the fragment shader."""
    return context.program(vertex_shader=shader(vertex), fragment_shader=shader(fragment, **constants))


def read_layer(target: Any, size: tuple[int, int], attachment: int, components: int) -> NDArray[np.float32]:
    """Return an attachment (h, w, c) of a framebuffer; `size` is w and h."""
    box = (0, 0, *size)
    flat = np.frombuffer(target.read(viewport=box, components=components, attachment=attachment, dtype="f4"), "f4")
    return flat.reshape(*size[::-1], components)


def shader(name: str, **constants: int) -> str:
    """Return the text of a shader with `constants` as `#define`s; lines `//!part` are replaced by part.glsl."""
    version, _, body = (_SHADERS / name).read_text(encoding="utf-8").partition("\n")
    body = re.sub(r"^//!(\w+)$", lambda part: (_SHADERS / f"{part[1]}.glsl").read_text("utf-8"), body, flags=re.M)
    defines = "".join(f"#define {key} {value}\n" for key, value in constants.items())
    return f"{version}\n{defines}{body}"

"""The OpenGL context: EGL, so that no display is needed; software rendering (Mesa's llvmpipe) is enough."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from metric_base.errors import InputError

__all__ = ["NoRenderer", "check_renderer", "gl_context", "shader"]

_SHADERS = Path(__file__).parent / "shaders"


class NoRenderer(InputError):
    """No OpenGL context can be made on this machine; the message says what to install."""


def gl_context() -> Any:
    """A moderngl context on EGL. Raises NoRenderer with the package to install."""
    try:
        import moderngl
    except ImportError:
        raise NoRenderer("moderngl is not installed; run: pip install 'metric-tree[insert]'") from None
    os.environ.setdefault("EGL_LOG_LEVEL", "fatal")  # or Mesa adds lines of its own
    try:
        settings: Any = {"backend": "egl"}  # moderngl's stub types this word as a mapping
        return moderngl.create_context(standalone=True, require=330, **settings)
    except Exception as error:
        reason = " ".join(str(error).split())
        message = f"no OpenGL without a display ({reason}); run: apt-get install libegl1 libgl1-mesa-dri"
        raise NoRenderer(message) from error


def check_renderer() -> None:
    """Raise NoRenderer where no context can be made, before any work is done."""
    gl_context().release()


def shader(name: str, **constants: int) -> str:
    """The text of a shader file; `constants` become `#define`s after its version line, `//!part` the file part.glsl."""
    version, _, body = (_SHADERS / name).read_text(encoding="utf-8").partition("\n")
    body = re.sub(r"^//!(\w+)$", lambda part: (_SHADERS / f"{part[1]}.glsl").read_text("utf-8"), body, flags=re.M)
    defines = "".join(f"#define {key} {value}\n" for key, value in constants.items())
    return f"{version}\n{defines}{body}"

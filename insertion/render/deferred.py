"""Solid parts drawn in two steps: what each sample of a pixel is made of, then its light.

Small triangles are dear: a software renderer lights every pixel of the blocks that a triangle touches, on hidden sides
too. Gathered first, a pixel is lit once for each different sample of it, however many triangles the model has.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insertion.render.gpu import GpuPart
from insertion.scene.camera_rays import Window

#: Names of the facts in the shader that lights them, in the order of the outputs that gather them.
GBUFFER = ("place_rough", "normal_metal", "geometric_depth", "base_alpha", "glow_covered")
#: Texture units of the facts; those below are taken by the light.
_FIRST_UNIT = 7
#: The facts of a pixel take 320 bytes, so a large window is drawn in tiles of this side.
TILE = 512
#: Tiles are made in steps of this many pixels, so that a window that grows slowly does not make one each frame.
_STEP = 64


class DeferredTargets:
    """The buffers of one tile in an OpenGL context; kept from frame to frame."""

    def __init__(self, context: Any, samples: int) -> None:
        self._context, self._samples = context, samples
        self._size: tuple[int, int] | None = None
        self._facts: list[Any] = []
        self._gathered: Any = None
        self._lit: Any = None

    def draw(
        self, parts: Sequence[GpuPart], gather: Any, cover: Any, window: Window
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(h, w, 4) linear radiance and coverage, and (h, w, 2) depth times coverage and coverage.

        gather : the program of the parts' `gathered` arrays; cover : a quad over the target with the program that
        lights the facts. The uniforms of both are set.
        """
        colour = np.empty((window.height, window.width, 4), np.float32)
        seen = np.empty((window.height, window.width, 2), np.float32)
        for x, y, width, height in _tiles(window.width, window.height):
            self._resize(min(window.width, TILE), min(window.height, TILE))
            self._gather(parts, gather, (-x, -y, window.width, window.height))
            self._light(cover, width, height)
            rows, columns = slice(y, y + height), slice(x, x + width)
            colour[rows, columns] = _read(self._lit, width, height, 0, 4)
            seen[rows, columns] = _read(self._lit, width, height, 1, 2)
        return colour, seen

    def _gather(self, parts: Sequence[GpuPart], program: Any, viewport: tuple[int, int, int, int]) -> None:
        context, target = self._context, self._gathered
        target.use()
        target.viewport = viewport
        context.enable(context.DEPTH_TEST)
        context.disable(context.BLEND)
        target.clear()
        for part in parts:
            part.bind(program)
            part.gathered.render()

    def _light(self, cover: Any, width: int, height: int) -> None:
        context = self._context
        self._lit.use()
        self._lit.viewport = (0, 0, width, height)
        context.disable(context.DEPTH_TEST | context.BLEND)
        for unit, (name, texture) in enumerate(zip(GBUFFER, self._facts, strict=True), start=_FIRST_UNIT):
            texture.use(unit)
            cover.program[name].value = unit
        cover.render(mode=context.TRIANGLE_STRIP)

    def _resize(self, width: int, height: int) -> None:
        """Buffers of at least this size; only the last are kept."""
        size = (-(-width // _STEP) * _STEP, -(-height // _STEP) * _STEP)
        if size == self._size:
            return
        for old in (*self._facts, self._gathered, self._lit):
            if old is not None:
                old.release()
        make = self._context
        self._facts = [make.texture(size, 4, samples=self._samples, dtype="f4") for _ in GBUFFER]
        self._gathered = make.framebuffer(self._facts, make.depth_renderbuffer(size, samples=self._samples))
        self._lit = make.framebuffer([make.renderbuffer(size, 4, dtype="f4") for _ in range(2)])
        self._size = size


def _tiles(width: int, height: int) -> Iterator[tuple[int, int, int, int]]:
    """x, y, width and height of the tiles of a window."""
    for y in range(0, height, TILE):
        for x in range(0, width, TILE):
            yield x, y, min(TILE, width - x), min(TILE, height - y)


def _read(target: Any, width: int, height: int, attachment: int, components: int) -> NDArray[np.float32]:
    """(h, w, c) an attachment of a target."""
    box = (0, 0, width, height)
    flat = np.frombuffer(target.read(viewport=box, components=components, attachment=attachment, dtype="f4"), "f4")
    return flat.reshape(height, width, components)

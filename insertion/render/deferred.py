"""Deferred shading of opaque parts: a geometry buffer per sample of a pixel, then one evaluation of the light.

A software renderer shades all pixels of the blocks that a triangle touches, also on occluded sides, which is expensive
for small triangles. With deferred shading, the cost does not depend on the number of triangles.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insertion.render.gpu import GpuPart, read_layer, release
from insertion.scene.camera_rays import Window

#: Names of the geometry buffers in the lighting shader, in the order of the outputs of the geometry shader.
GBUFFER = ("place_rough", "normal_metal", "geometric_depth", "base_alpha", "glow_covered")
#: First texture unit of the geometry buffers; the light uses the lower ones.
_FIRST_UNIT = 7
#: Side of a tile in pixels; a pixel needs 320 bytes, so large windows are rendered in tiles.
TILE = 512
#: Granularity of the size of buffers in pixels, so that a slowly growing window does not allocate one per frame.
STEP_PX = 64


class DeferredTargets:
    """The buffers of a tile in an OpenGL context, which all frames use."""

    def __init__(self, context: Any, samples: int) -> None:
        self._context, self._samples = context, samples
        self._size: tuple[int, int] | None = None
        self._buffers: list[Any] = []
        self._gathered: Any = None
        self._lit: Any = None
        self._quarters: tuple[Any, Any] = None, None

    def draw(
        self, parts: Sequence[GpuPart], gather: Any, cover: Any, outline: Any, window: Window
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return linear radiance and coverage (h, w, 4), and depth times coverage and coverage (h, w, 2).

        Parameters
        ----------
        parts : sequence of GpuPart
            Opaque parts.
        gather : moderngl.Program
            Program of the geometry buffers, with its uniforms.
        cover : moderngl.VertexArray
            Quad over the target with the lighting program.
        outline : moderngl.Program
            Program of the vertex arrays `cast`, for the coverage.
        """
        import cv2

        context = self._context
        layers = np.empty((window.height, window.width, 6), np.float32)
        coverage = np.empty((window.height, window.width), np.float32)
        self._resize(min(window.width, TILE), min(window.height, TILE))
        for y, x in itertools.product(range(0, window.height, TILE), range(0, window.width, TILE)):
            # 1. The geometry buffers of a tile.
            width, height = min(TILE, window.width - x), min(TILE, window.height - y)
            self._gathered.use()
            self._gathered.viewport = (-x, -y, window.width, window.height)
            context.enable(context.DEPTH_TEST)
            context.disable(context.BLEND)
            self._gathered.clear()
            for part in parts:
                part.bind(gather)
                part.gathered.render()

            # 2. Its light.
            self._lit.use()
            self._lit.viewport = (0, 0, width, height)
            context.disable(context.DEPTH_TEST | context.BLEND)
            for unit, (name, texture) in enumerate(zip(GBUFFER, self._buffers, strict=True), start=_FIRST_UNIT):
                texture.use(unit)
                cover.program[name].value = unit
            cover.render(mode=context.TRIANGLE_STRIP)
            rows, columns = slice(y, y + height), slice(x, x + width)
            layers[rows, columns, :4] = read_layer(self._lit, (width, height), 0, 4)
            layers[rows, columns, 4:] = read_layer(self._lit, (width, height), 1, 2)

            # 3. Its coverage by the samples of four quarters of each pixel.
            smooth, plain = self._quarters
            smooth.use()
            smooth.viewport = (-2 * x, -2 * y, 2 * window.width, 2 * window.height)
            smooth.clear()
            for part in parts:
                part.bind(outline)
                part.cast.render()
            context.copy_framebuffer(plain, smooth)
            quarters = read_layer(plain, (2 * width, 2 * height), 0, 1)
            coverage[rows, columns] = cv2.resize(quarters, (width, height), interpolation=cv2.INTER_AREA)

        # 4. The colour of an edge is that of its samples, or of its neighbours if it has none.
        is_edge = (coverage > 0) & ((coverage < 1) | (layers[..., 3] < 1))
        source = np.where(layers[..., 3:4] > 0, layers, cv2.blur(layers, (3, 3)))[is_edge]
        layers[is_edge] = source * (coverage[is_edge] / np.maximum(source[:, 3], 1e-6))[:, None]
        return layers[..., :4], layers[..., 4:]

    def _resize(self, width: int, height: int) -> None:
        """Allocate buffers of at least this size, and release the previous ones."""
        size = (-(-width // STEP_PX) * STEP_PX, -(-height // STEP_PX) * STEP_PX)
        if size == self._size:
            return
        release(*self._buffers, self._gathered, self._lit, *self._quarters)
        make = self._context
        self._buffers = [make.texture(size, 4, samples=self._samples, dtype="f4") for _ in GBUFFER]
        self._gathered = make.framebuffer(self._buffers, make.depth_renderbuffer(size, samples=self._samples))
        self._lit = make.framebuffer([make.renderbuffer(size, 4, dtype="f4") for _ in range(2)])
        twice = size[0] * 2, size[1] * 2
        self._quarters = (
            make.framebuffer([make.renderbuffer(twice, 1, samples=self._samples)]),
            make.framebuffer([make.renderbuffer(twice, 1)]),
        )
        self._size = size

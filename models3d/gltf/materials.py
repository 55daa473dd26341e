"""The materials of a glTF file with their textures (glTF 2.0, 3.9), and the extensions of them that are drawn.

A part has one set of texture coordinates. It is that of the first texture, of the colour if there is one; a texture
that asks for another set, or another transform of it, is left out with a word.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from metric_base.arrays import FloatArray
from models3d.model import Material, Pixels

#: What is seen of glass itself, its own colour, where all light goes through.
PANE = 0.15


@dataclass(frozen=True, slots=True)
class Coordinates:
    """Which coordinates a texture asks for: the set, and KHR_texture_transform's offset, rotation and scale."""

    number: int = 0
    offset: tuple[float, float] = (0.0, 0.0)
    rotation: float = 0.0
    scale: tuple[float, float] = (1.0, 1.0)

    def __call__(self, uv: FloatArray) -> FloatArray:
        """(n, 2) coordinates of the texture from those of the set, (n, 2)."""
        cosine, sine = np.cos(self.rotation), np.sin(self.rotation)
        turned = np.array([[cosine, sine], [-sine, cosine]])
        return np.asarray((uv * self.scale) @ turned.T + self.offset)


class Materials:
    """The materials of a document, each read once; image : the encoded bytes of an image by its number."""

    def __init__(self, header: dict[str, Any], image: Callable[[int], bytes]) -> None:
        self._header, self._image = header, image
        self._pixels: dict[int, Pixels] = {}
        self._read: dict[int, tuple[Material, Coordinates]] = {}
        self.warnings: list[str] = []

    def material(self, number: object) -> tuple[Material, Coordinates]:
        """A material and its coordinates; without a number, plain white (glTF's own default is white metal)."""
        rows = self._header.get("materials", [])
        if not (isinstance(number, int) and 0 <= number < len(rows)):
            return Material(np.ones(4), metallic=0.0, roughness=0.8), Coordinates()
        if number not in self._read:
            self._read[number] = self._material(rows[number])
        return self._read[number]

    def _material(self, stated: dict[str, Any]) -> tuple[Material, Coordinates]:
        surface = stated.get("pbrMetallicRoughness", {})
        extensions = stated.get("extensions", {})
        glossy = extensions.get("KHR_materials_pbrSpecularGlossiness")
        if glossy is not None and not surface:
            surface = {
                "baseColorFactor": glossy.get("diffuseFactor", [1, 1, 1, 1]),
                "metallicFactor": 0.0,
                "roughnessFactor": 1.0 - glossy.get("glossinessFactor", 1.0),
            }
            if "diffuseTexture" in glossy:
                surface["baseColorTexture"] = glossy["diffuseTexture"]
        textures = [surface.get("baseColorTexture"), surface.get("metallicRoughnessTexture"),
                    stated.get("normalTexture"), stated.get("emissiveTexture")]  # fmt: skip
        first = next((_coordinates(texture) for texture in textures if texture is not None), Coordinates())
        base, rough, normal, glow = (self._texture(texture, first) for texture in textures)
        mode = stated.get("alphaMode", "OPAQUE")
        colour = np.asarray(surface.get("baseColorFactor", [1, 1, 1, 1]), dtype=np.float64)
        through = float(extensions.get("KHR_materials_transmission", {}).get("transmissionFactor", 0.0))
        if through > 0 and colour.shape == (4,):
            colour = colour * [1, 1, 1, max(1 - through, PANE)]
            mode = "BLEND" if mode == "OPAQUE" else mode
            self._warn("glass is drawn as a thin pane: what is behind it is not bent")
        strength = float(extensions.get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0))
        material = Material(
            colour,
            float(surface.get("metallicFactor", 1.0)),
            float(surface.get("roughnessFactor", 1.0)),
            strength * np.asarray(stated.get("emissiveFactor", [0, 0, 0]), dtype=np.float64),
            base,
            rough,
            normal,
            glow,
            float(stated.get("alphaCutoff", 0.5)) if mode == "MASK" else None,
            mode == "BLEND",
        )
        return material, first

    def _texture(self, texture: dict[str, Any] | None, first: Coordinates) -> Pixels | None:
        """The pixels (h, w, 4) of a texture; None where there is none, or it asks for other coordinates."""
        if texture is None:
            return None
        if _coordinates(texture) != first:
            self._warn("a texture with coordinates of its own is left out")
            return None
        record = self._header["textures"][texture["index"]]
        webp = record.get("extensions", {}).get("EXT_texture_webp", {})
        source = webp.get("source", record.get("source"))
        if source is None:
            self._warn("a texture without a PNG, JPEG or WebP picture is left out")
            return None
        if source not in self._pixels:
            self._pixels[source] = _decode(self._image(source))
        return self._pixels[source]

    def _warn(self, line: str) -> None:
        if line not in self.warnings:
            self.warnings.append(line)


def _coordinates(texture: dict[str, Any]) -> Coordinates:
    moved = texture.get("extensions", {}).get("KHR_texture_transform", {})
    offset, scale = moved.get("offset", [0, 0]), moved.get("scale", [1, 1])
    return Coordinates(
        int(moved.get("texCoord", texture.get("texCoord", 0))),
        (float(offset[0]), float(offset[1])),
        float(moved.get("rotation", 0.0)),
        (float(scale[0]), float(scale[1])),
    )


def _decode(data: bytes) -> Pixels:
    """(h, w, 4) uint8 of an encoded picture; 16 bits become 8."""
    from PIL import Image

    with Image.open(io.BytesIO(data)) as image:
        if image.mode.startswith("I"):
            grey = (np.asarray(image, dtype=np.int64) >> 8).astype(np.uint8)
            return np.dstack([grey, grey, grey, np.full_like(grey, 255)])
        return np.asarray(image.convert("RGBA"), dtype=np.uint8)

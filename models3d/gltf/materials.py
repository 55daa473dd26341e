"""Read the materials of a glTF file with their textures (glTF 2.0, section 3.9) and the supported extensions.

A mesh has one set of texture coordinates: that of its first texture, which is the colour texture if there is one. A
texture with other coordinates, or with another transform of them, is ignored with a warning.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from metric_base.arrays import FloatArray
from models3d.model import Material, Pixels

#: Minimum opacity of glass in renderers without refraction, so that a pane that transmits all light is visible.
MIN_GLASS_OPACITY = 0.15
#: Maximum alpha of a material without a texture that represents glass, in files without a transmission.
MAX_GLASS_ALPHA = 0.5
#: Maximum roughness of such glass: what is behind it is sharp.
MAX_GLASS_ROUGHNESS = 0.1


@dataclass(frozen=True, slots=True)
class Coordinates:
    """Texture coordinates of a texture: their set, and the transform of KHR_texture_transform."""

    number: int = 0
    offset: tuple[float, float] = (0.0, 0.0)
    rotation: float = 0.0
    scale: tuple[float, float] = (1.0, 1.0)

    def __call__(self, uv: FloatArray) -> FloatArray:
        """Transform the coordinates (n, 2) of the set to those of the texture (n, 2)."""
        cosine, sine = np.cos(self.rotation), np.sin(self.rotation)
        rotation = np.array([[cosine, sine], [-sine, cosine]])
        return np.asarray((uv * self.scale) @ rotation.T + self.offset)


class Materials:
    """Materials of a document, each read once; `image` returns the encoded bytes of an image by its index."""

    def __init__(self, header: dict[str, Any], image: Callable[[int], bytes]) -> None:
        self._header, self._image = header, image
        self._pixels: dict[int, Pixels] = {}
        self._materials: dict[int, tuple[Material, Coordinates]] = {}
        self.warnings: list[str] = []

    def material(self, index: object) -> tuple[Material, Coordinates]:
        """Return a material and its coordinates; without a valid index, matt white, unlike the default of glTF."""
        records = self._header.get("materials", [])
        if not (isinstance(index, int) and 0 <= index < len(records)):
            return Material(np.ones(4), metallic=0.0, roughness=0.8), Coordinates()
        if index not in self._materials:
            record = records[index]
            surface = record.get("pbrMetallicRoughness", {})
            extensions = record.get("extensions", {})
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
                        record.get("normalTexture"), record.get("emissiveTexture")]  # fmt: skip
            first = next((_coordinates(texture) for texture in textures if texture is not None), Coordinates())
            base, rough, normal, glow = (self._texture(texture, first) for texture in textures)
            mode = record.get("alphaMode", "OPAQUE")
            colour = np.asarray(surface.get("baseColorFactor", [1, 1, 1, 1]), dtype=np.float64)
            transmission = float(extensions.get("KHR_materials_transmission", {}).get("transmissionFactor", 0.0))
            roughness, tint = float(surface.get("roughnessFactor", 1.0)), colour[:3]
            if transmission > 0 and colour.shape == (4,):
                colour = colour * [1, 1, 1, max(1 - transmission, MIN_GLASS_OPACITY)]
                mode = "BLEND" if mode == "OPAQUE" else mode
            elif mode == "BLEND" and base is None and colour.shape == (4,) and colour[3] < MAX_GLASS_ALPHA:
                transmission, roughness = 1.0, min(roughness, MAX_GLASS_ROUGHNESS)
                tint = (1 - colour[3]) * (colour[:3] / colour[:3].max() if colour[:3].any() else np.ones(3))
            strength = float(extensions.get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0))
            material = Material(
                colour,
                float(surface.get("metallicFactor", 1.0)),
                roughness,
                strength * np.asarray(record.get("emissiveFactor", [0, 0, 0]), dtype=np.float64),
                base,
                rough,
                normal,
                glow,
                float(record.get("alphaCutoff", 0.5)) if mode == "MASK" else None,
                mode == "BLEND",
                transmission if mode == "BLEND" else 0.0,
                tint,
            )
            self._materials[index] = material, first
        return self._materials[index]

    def _texture(self, texture: dict[str, Any] | None, first: Coordinates) -> Pixels | None:
        """Return the pixels (h, w, 4) of a texture, or None with a warning if it cannot be used."""
        from PIL import Image

        if texture is None:
            return None
        if _coordinates(texture) != first:
            self._warn("a texture with other coordinates than the first one is ignored")
            return None
        record = self._header["textures"][texture["index"]]
        webp = record.get("extensions", {}).get("EXT_texture_webp", {})
        source = webp.get("source", record.get("source"))
        if source is None:
            self._warn("a texture without a PNG, JPEG or WebP image is ignored")
            return None
        if source not in self._pixels:
            with Image.open(io.BytesIO(self._image(source))) as image:
                if image.mode.startswith("I"):  # 16 bits are reduced to 8
                    grey = (np.asarray(image, dtype=np.int64) >> 8).astype(np.uint8)
                    self._pixels[source] = np.dstack([grey, grey, grey, np.full_like(grey, 255)])
                else:
                    self._pixels[source] = np.asarray(image.convert("RGBA"), dtype=np.uint8)
        return self._pixels[source]

    def _warn(self, warning: str) -> None:
        """Add a warning unless it is already listed."""
        if warning not in self.warnings:
            self.warnings.append(warning)


def _coordinates(texture: dict[str, Any]) -> Coordinates:
    """Return the texture coordinates of a texture of a material."""
    transform = texture.get("extensions", {}).get("KHR_texture_transform", {})
    offset, scale = transform.get("offset", [0, 0]), transform.get("scale", [1, 1])
    return Coordinates(
        int(transform.get("texCoord", texture.get("texCoord", 0))),
        (float(offset[0]), float(offset[1])),
        float(transform.get("rotation", 0.0)),
        (float(scale[0]), float(scale[1])),
    )

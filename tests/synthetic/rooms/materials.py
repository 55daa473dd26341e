"""Appearance of surfaces: colours, contrast and grain of each material, with a variation for each object."""

from __future__ import annotations

import zlib

import numpy as np

from metric_base.arrays import FloatArray

__all__ = ["MATERIALS", "look_of"]

_Colour = tuple[float, float, float]

#: By material: two colours (r, g, b), contrast of the grain, fraction of large patches of the second colour, and size
#: of the coarsest grain in metres.
MATERIALS: dict[str, tuple[_Colour, _Colour, float, float, float]] = {
    "floor": ((0.62, 0.48, 0.34), (0.54, 0.41, 0.28), 0.55, 0.5, 0.20),
    "ceiling": ((0.9, 0.9, 0.88), (0.85, 0.85, 0.84), 0.25, 0.1, 0.3),
    "wall": ((0.82, 0.78, 0.70), (0.76, 0.73, 0.66), 0.4, 0.3, 0.2),
    "plaster": ((0.82, 0.80, 0.76), (0.80, 0.78, 0.74), 0.05, 0.0, 0.2),
    "rug": ((0.52, 0.28, 0.26), (0.62, 0.55, 0.42), 0.6, 0.7, 0.16),
    "wood": ((0.60, 0.42, 0.26), (0.47, 0.31, 0.18), 0.7, 0.6, 0.12),
    "wood_dark": ((0.36, 0.25, 0.17), (0.28, 0.18, 0.12), 0.7, 0.5, 0.12),
    "fabric": ((0.42, 0.46, 0.55), (0.30, 0.33, 0.42), 0.8, 0.7, 0.12),
    "linen": ((0.86, 0.85, 0.82), (0.75, 0.75, 0.8), 0.45, 0.4, 0.15),
    "white": ((0.88, 0.88, 0.88), (0.78, 0.79, 0.81), 0.45, 0.3, 0.15),
    "ceramic": ((0.92, 0.92, 0.90), (0.84, 0.85, 0.86), 0.4, 0.3, 0.12),
    "metal": ((0.62, 0.63, 0.66), (0.48, 0.49, 0.52), 0.5, 0.4, 0.08),
    "dark": ((0.20, 0.20, 0.22), (0.32, 0.32, 0.35), 0.7, 0.5, 0.08),
    "glass": ((0.25, 0.42, 0.33), (0.35, 0.52, 0.45), 0.6, 0.5, 0.06),
    "print": ((0.75, 0.45, 0.30), (0.25, 0.35, 0.6), 0.7, 1.0, 0.07),
    "picture": ((0.3, 0.45, 0.6), (0.8, 0.7, 0.4), 0.8, 1.0, 0.2),
    "paper": ((0.9, 0.88, 0.8), (0.8, 0.78, 0.7), 0.4, 0.3, 0.02),
    "keys": ((0.15, 0.15, 0.17), (0.6, 0.6, 0.62), 0.5, 1.0, 0.03),
    "leaves": ((0.2, 0.42, 0.16), (0.36, 0.55, 0.22), 0.9, 1.0, 0.09),
    "fur": ((0.55, 0.38, 0.22), (0.45, 0.3, 0.17), 0.9, 0.6, 0.06),
    "skin": ((0.8, 0.6, 0.5), (0.7, 0.5, 0.42), 0.4, 0.4, 0.06),
    "paint": ((0.5, 0.5, 0.5), (0.42, 0.42, 0.42), 0.5, 0.4, 0.3),
    "sign": ((0.75, 0.1, 0.1), (0.95, 0.95, 0.95), 0.3, 0.8, 0.25),
    "road": ((0.36, 0.36, 0.37), (0.28, 0.28, 0.3), 0.8, 0.6, 0.6),
    "pavement": ((0.6, 0.58, 0.55), (0.5, 0.48, 0.46), 0.7, 0.5, 0.5),
    "facade": ((0.68, 0.55, 0.45), (0.35, 0.35, 0.4), 0.7, 1.0, 1.6),
    "line": ((0.9, 0.9, 0.88), (0.8, 0.8, 0.8), 0.5, 0.4, 0.2),
    "book0": ((0.55, 0.2, 0.2), (0.8, 0.75, 0.6), 0.6, 0.9, 0.04),
    "book1": ((0.2, 0.3, 0.5), (0.8, 0.75, 0.6), 0.6, 0.9, 0.04),
    "book2": ((0.22, 0.4, 0.3), (0.8, 0.75, 0.6), 0.6, 0.9, 0.04),
    "book3": ((0.7, 0.6, 0.35), (0.3, 0.2, 0.2), 0.6, 0.9, 0.04),
    "book4": ((0.35, 0.3, 0.38), (0.8, 0.75, 0.6), 0.6, 0.9, 0.04),
}


def look_of(name: str, number: int, seed: int, texture: float) -> FloatArray:
    """Return the variation (12,) of a material for an object: two colours, contrast, patches, grain, noise offset."""
    first, second, contrast, patches, coarse = MATERIALS[name]
    generator = np.random.default_rng([seed, number, zlib.crc32(name.encode())])
    tint = generator.uniform(0.75, 1.2, 3) if number else np.ones(3)
    if number and name in ("fabric", "print", "paint", "picture"):
        tint = generator.uniform(0.5, 1.6, 3) if name == "paint" else generator.uniform(0.65, 1.45, 3)
    colours = np.clip(np.concatenate([np.array(first) * tint, np.array(second) * tint[::-1]]), 0.05, 0.97)
    return np.array([*colours, contrast * texture, patches * min(texture, 1.0), coarse, *generator.uniform(0, 50, 3)])

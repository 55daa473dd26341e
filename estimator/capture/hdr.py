"""High dynamic range video brought to an ordinary screen's range."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["CURVES", "standard_range"]

#: FFmpeg's numbers of transfer curves (ITU-T H.273) that are HDR.
CURVES = {16: "PQ", 18: "HLG"}
#: Luminance of diffuse white: 203 cd/m2 (ITU-R BT.2408); in HLG's scene light of 1 at the peak it is 0.265.
WHITE_PQ, WHITE_HLG = 203.0, 0.265
#: BT.2020 to BT.709 primaries, linear light (ITU-R BT.2087).
TO_709 = np.array([[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]])


def standard_range(colour: NDArray[np.uint16], curve: str) -> NDArray[np.uint8]:
    """(h, w, 3) sRGB of 16-bit BT.2020 pictures: linear light, BT.709 primaries, highlights rolled off (Reinhard)."""
    table = _linear(np.arange(0, 65536, 16) / 65535.0, curve)  # 4,096 levels are finer than the 10 bits of a video
    linear = table[colour >> 4].astype(np.float32) @ TO_709.T.astype(np.float32)
    linear = np.maximum(linear, 0)
    # x (1 + x / w^2) / (1 + x): 1 at w, four times diffuse white; middle tones are darkened and are lifted again
    bright = linear * (1 + linear / 16) / (1 + linear) * 1.6
    encoded = np.where(bright <= 0.0031308, 12.92 * bright, 1.055 * np.maximum(bright, 1e-6) ** (1 / 2.4) - 0.055)
    return np.asarray(np.clip(np.rint(encoded * 255), 0, 255), dtype=np.uint8)


def _linear(signal: NDArray[np.float64], curve: str) -> NDArray[np.float64]:
    """Linear light in units of diffuse white (ITU-R BT.2100), an array of any shape."""
    if curve == "PQ":
        power = signal ** (32 / 2523)
        light = (np.maximum(power - 0.8359375, 0) / (18.8515625 - 18.6875 * power)) ** (8192 / 1305)
        return np.asarray(light * 10_000.0 / WHITE_PQ)
    a, b, c = 0.17883277, 0.28466892, 0.55991073
    light = np.where(signal <= 0.5, signal**2 / 3, (np.exp((signal - c) / a) + b) / 12)
    return np.asarray(light / WHITE_HLG)

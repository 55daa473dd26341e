"""Conversion between sRGB images (IEC 61966-2-1) and linear light."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Weights of linear red, green and blue in luminance (Rec. 709).
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)

#: An (h, w, 3) sRGB image.
Image = NDArray[np.uint8]
Linear = NDArray[np.float32]

_srgb = np.arange(256, dtype=np.float64) / 255
#: (256,) linear light of each value of sRGB.
_CURVE = np.where(_srgb <= 0.04045, _srgb / 12.92, ((_srgb + 0.055) / 1.055) ** 2.4).astype(np.float32)


def srgb_to_linear(image: NDArray[np.uint8]) -> Linear:
    """Return linear light, 0 to 1, of an 8-bit sRGB array of any shape."""
    return np.asarray(_CURVE[image])


def linear_to_srgb(linear: NDArray[np.floating]) -> Linear:
    """Return sRGB values, 0 to 255 and not rounded, of linear light, an array of any shape. Values are clipped."""
    import cv2

    light = np.clip(np.asarray(linear, dtype=np.float32), 0.0, 1.0).reshape(-1, 1)
    if not light.size:
        return np.zeros(np.shape(linear), np.float32)
    # OpenCV's power is ten times as fast as NumPy's
    curved = cv2.pow(light, 1 / 2.4) * np.float32(1.055 * 255) - np.float32(0.055 * 255)
    return np.where(light <= 0.0031308, light * np.float32(12.92 * 255), curved).reshape(np.shape(linear))


def luminance(linear: NDArray[np.floating]) -> Linear:
    """Return the luminance of (..., 3) linear colours."""
    return np.asarray(linear @ LUMINANCE, dtype=np.float32)

"""A changed picture in the colours of its video: only the samples that changed are written anew.

A frame keeps its own matrix, range, primaries, transfer and depth. The change of the picture, in red, green and blue,
becomes a change of luma and chroma by the frame's own matrix; every other sample stays what it was, to the bit.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["ChromaMatrix", "changed_frame", "matrix_of"]

Picture = NDArray[np.uint8]
#: Weights of red and blue in luma by the matrix's number in ITU-T H.273.
_WEIGHTS = {1: (0.2126, 0.0722), 4: (0.30, 0.11), 7: (0.212, 0.087), 9: (0.2627, 0.0593), 10: (0.2627, 0.0593)}
#: What FFmpeg takes for a frame that states no matrix, BT.601.
_DEFAULT = (0.299, 0.114)
#: Pixel formats whose planes are Y, U, V of 8 bits, or of more in two bytes.
_PLANAR = ("yuv420p", "yuv422p", "yuv444p", "yuvj420p", "yuvj422p", "yuvj444p")
#: FFmpeg's number of the full range.
_FULL_RANGE = 2

ChromaMatrix = NDArray[np.float64]


def matrix_of(number: int) -> ChromaMatrix:
    """(3, 3) from red, green and blue to luma and the two chroma, all of range 1; number : of H.273."""
    red, blue = _WEIGHTS.get(number, _DEFAULT)
    luma = np.array([red, 1 - red - blue, blue])
    by_blue = (np.array([0.0, 0.0, 1.0]) - luma) / (2 * (1 - blue))
    by_red = (np.array([1.0, 0.0, 0.0]) - luma) / (2 * (1 - red))
    return np.stack([luma, by_blue, by_red])


def changed_frame(frame: Any, before: Picture, after: Picture) -> Any:
    """The frame (PyAV's) with what a picture changed from `before` to `after`, (h, w, 3), both as stored, not turned.

    The frame itself where nothing did. Another pixel format than planar Y, U, V becomes one of 4:4:4 first.
    """
    import cv2

    delta = after.astype(np.float32) - before
    if not delta.any():
        return frame
    deep = frame.format.name.removesuffix("le")
    base, bits = (deep[:-2], int(deep[-2:])) if deep[-2:] in ("10", "12") else (deep, 8)
    if base not in _PLANAR:
        frame, bits = frame.reformat(format="yuv444p"), 8
    out = _copy(frame)
    if int(frame.color_trc) in (16, 18):
        delta = _hdr_change(frame, before, after)
    if delta.shape[:2] != (frame.height, frame.width):  # pixels that are not square
        delta = cv2.resize(delta, (frame.width, frame.height), interpolation=cv2.INTER_AREA)
    full = int(frame.color_range) == _FULL_RANGE or frame.format.name.startswith("yuvj")
    ranges = np.array([255.0, 255.0, 255.0] if full else [219.0, 224.0, 224.0]) * 2 ** (bits - 8)
    change = (delta / 255) @ matrix_of(int(frame.colorspace)).T.astype(np.float32) * ranges.astype(np.float32)
    kind, top = (np.uint8, 255) if bits == 8 else (np.uint16, 2**bits - 1)
    for number, plane in enumerate(out.planes[:3]):
        samples = np.frombuffer(memoryview(plane), kind).reshape(plane.height, -1)[:, : plane.width]
        own = change[..., number]
        if own.shape != samples.shape:
            own = cv2.resize(own, samples.shape[::-1], interpolation=cv2.INTER_AREA)
        samples[...] = np.clip(np.rint(samples + own), 0, top)
    return out


def _copy(frame: Any) -> Any:
    """A frame of its own with the same samples and tags."""
    import av

    out = av.VideoFrame(frame.width, frame.height, frame.format.name)
    for target, source in zip(out.planes, frame.planes, strict=True):
        wide = min(target.line_size, source.line_size)
        rows = np.frombuffer(memoryview(target), np.uint8).reshape(-1, target.line_size)
        rows[:, :wide] = np.frombuffer(memoryview(source), np.uint8).reshape(-1, source.line_size)[:, :wide]
    for tag in ("colorspace", "color_range", "color_primaries", "color_trc"):
        setattr(out, tag, getattr(frame, tag))
    return out


def _hdr_change(frame: Any, before: Picture, after: Picture) -> NDArray[np.float32]:
    """(h, w, 3) change of the HDR signal, 0 to 255, for a change of the picture in standard range, (h, w, 3) each.

    What signal a level stands for is read from the frame itself: the median over the pixels that have the level.
    """
    signal = frame.to_ndarray(format="rgb48le").astype(np.float32) / 257
    if signal.shape != before.shape:
        return after.astype(np.float32) - before
    change = np.zeros(before.shape, np.float32)
    for channel in range(3):
        old, new, own = before[..., channel], after[..., channel], signal[..., channel]
        total = np.bincount(old.ravel(), own.ravel(), 256)
        count = np.bincount(old.ravel(), minlength=256)
        levels = np.flatnonzero(count)
        curve = np.maximum.accumulate(total[levels] / count[levels])
        table = np.interp(np.arange(256), levels, curve).astype(np.float32)
        change[..., channel] = table[new] - table[old]
    return change

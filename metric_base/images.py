"""Images that strangers made, decoded by OpenCV: of bounded size, and a refusal is an answer, not an error."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Most pixels of an image, twice those of the largest cameras.
MAX_PIXELS = 1 << 28
#: Most bytes of an image's file.
MAX_BYTES = 1 << 30

# OpenCV reads these when it is first loaded: the size that it may take, and that it says nothing of damaged files.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(MAX_PIXELS))
os.environ.setdefault("OPENCV_LOG_LEVEL", "OFF")


def read_picture(file: Path, flags: int) -> NDArray[Any] | None:
    """(h, w) or (h, w, c) pixels of a file, as `cv2.imread` gives them; None if it is no image or too large."""
    if not file.is_file() or file.stat().st_size > MAX_BYTES:
        return None
    return decode_picture(np.fromfile(file, dtype=np.uint8), flags)


def decode_picture(data: bytes | NDArray[np.uint8], flags: int) -> NDArray[Any] | None:
    """(h, w) or (h, w, c) pixels of a file's bytes, as `cv2.imdecode` gives them; None if they are no image."""
    import cv2

    array = np.frombuffer(data, dtype=np.uint8) if isinstance(data, bytes) else data
    if not len(array):
        return None
    try:
        pixels = cv2.imdecode(array, flags)
    except cv2.error:  # more pixels than it takes, or a size that is none
        return None
    return None if pixels is None else np.asarray(pixels)


def write_picture(file: Path, pixels: NDArray[Any], flags: Sequence[int] = ()) -> None:
    """Write (h, w) or (h, w, c) pixels, as `cv2.imwrite` does, in the form of the file's ending.

    Encoded first, then written: OpenCV's own writer does not say why it failed.

    Raises
    ------
    OSError
        The disk is full, or the file cannot be written.
    """
    import cv2

    whole, encoded = cv2.imencode(file.suffix, pixels, flags)
    assert whole, file.suffix  # an image in memory always encodes
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(encoded.tobytes())

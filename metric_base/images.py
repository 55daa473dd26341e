"""Decode untrusted images of bounded size with OpenCV; the result is None if an image cannot be decoded."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from metric_base.errors import InputError, Unquoted

#: Suffixes of images that OpenCV and COLMAP read.
IMAGE_SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp"})
#: Maximum number of pixels of an image: twice the largest cameras.
MAX_PIXELS = 1 << 28
#: Maximum size of a file in bytes.
MAX_BYTES = 1 << 30
#: EXIF: the tags of the directories of the photograph and of GPS, of the equivalent focal length and of the time.
_PHOTO_TAGS, _GPS_TAGS, _FOCAL_35MM, _TAKEN = 0x8769, 0x8825, 0xA405, 0x9003
#: Diagonal in millimetres of the 35 mm frame that the equivalent focal length refers to (CIPA DCG-001).
DIAGONAL_35MM = 43.2666
#: Range in millimetres of equivalent focal lengths that are used.
FOCAL_RANGE_35MM = (5.0, 1000.0)

# OpenCV reads these variables when it is loaded: the maximum size, and no messages about damaged files
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(MAX_PIXELS))
os.environ.setdefault("OPENCV_LOG_LEVEL", "OFF")


def read_image(file: Path, flags: int) -> NDArray[Any] | None:
    """Return the pixels (h, w) or (h, w, c) of a file as `cv2.imread`; None if it is not an image or too large."""
    if not file.is_file() or file.stat().st_size > MAX_BYTES:
        return None
    return decode_image(np.fromfile(file, dtype=np.uint8), flags)


def checked_image(file: Path, flags: int) -> NDArray[Any]:
    """Return the pixels (h, w) or (h, w, c) of an image file; InputError if it is not an image or too large."""
    pixels = read_image(file, flags)
    if pixels is None:
        raise InputError.at(file, "image", "an image that OpenCV reads", Unquoted("something else"))
    return pixels


def decode_image(data: bytes | NDArray[np.uint8], flags: int) -> NDArray[Any] | None:
    """Return the pixels (h, w) or (h, w, c) of an encoded image as `cv2.imdecode`; None if it is not an image."""
    import cv2

    array = np.frombuffer(data, dtype=np.uint8) if isinstance(data, bytes) else data
    if not len(array):
        return None
    try:
        pixels = cv2.imdecode(array, flags)
    except cv2.error:  # too many pixels, or an invalid size
        return None
    return None if pixels is None else np.asarray(pixels)


class ImageHeader(NamedTuple):
    """Format and size of an image file, and the tags of its EXIF directories by their numbers."""

    format: str  #: Name in Pillow, such as "JPEG".
    width: int
    height: int
    tags: dict[int, Any]
    photo_tags: dict[int, Any]
    gps_tags: dict[int, Any]

    @property
    def focal_px(self) -> float | None:
        """Focal length in pixels by the equivalent focal length of EXIF; None if it is not stated."""
        with suppress(TypeError, ValueError):
            millimetres = float(self.photo_tags.get(_FOCAL_35MM, ""))
            if FOCAL_RANGE_35MM[0] < millimetres < FOCAL_RANGE_35MM[1]:
                return millimetres / DIAGONAL_35MM * float(np.hypot(self.width, self.height))
        return None

    @property
    def taken_s(self) -> float | None:
        """Time of the photograph in seconds from a fixed one by EXIF, in the zone of the camera; None without it."""
        with suppress(KeyError, ValueError):
            stamp = datetime.strptime(str(self.photo_tags[_TAKEN]).strip(), "%Y:%m:%d %H:%M:%S")
            return (stamp - datetime.min).total_seconds()
        return None


def image_header(file: Path) -> ImageHeader | None:
    """Return format, size and EXIF tags of an image, without its pixels; None if it is no image or has too many pixels.

    Tags that cannot be read are omitted. The values are those of Pillow, and may be of any type and length.
    """
    from PIL import Image

    Image.MAX_IMAGE_PIXELS = MAX_PIXELS // 2  # Pillow refuses images of more than twice this number
    tags, photo_tags, gps_tags = dict[int, Any](), dict[int, Any](), dict[int, Any]()
    try:
        with warnings.catch_warnings(action="ignore"), Image.open(file) as image:
            with suppress(Exception):
                exif = image.getexif()
                tags |= exif
                photo_tags |= exif.get_ifd(_PHOTO_TAGS)
                gps_tags |= exif.get_ifd(_GPS_TAGS)
            return ImageHeader(image.format or "", image.width, image.height, tags, photo_tags, gps_tags)
    except Exception:  # noqa: BLE001 - Pillow raises unrelated types for damaged files
        return None


def image_size(file: Path) -> tuple[int, int]:
    """Return width and height of an image file.

    Raises
    ------
    InputError
        The file is no image, or has too many pixels.
    """
    header = image_header(file)
    if header is None:
        raise InputError.at(file, "image", f"an image of at most {MAX_PIXELS:,} pixels", Unquoted("something else"))
    return header.width, header.height


def write_image(file: Path, pixels: NDArray[Any], flags: Sequence[int] = ()) -> None:
    """Write pixels (h, w) or (h, w, c) in the format of the suffix, as `cv2.imwrite`, with errors of the system.

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

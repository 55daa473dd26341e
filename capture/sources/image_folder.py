"""A folder of pictures as a source of frames: upright, in the order of their names, with the lens that EXIF states."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture.sources.video import VideoFrame
from metric_base.errors import InputError, Unquoted
from metric_base.images import read_picture
from metric_base.input_files import folder_entries

#: Pictures that OpenCV and COLMAP both read.
PICTURE_SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp"})
#: Pictures that neither reads.
FOREIGN_SUFFIXES = frozenset({".heic", ".heif", ".dng", ".cr2", ".nef", ".arw", ".avif", ".jxl"})
#: Diagonal in millimetres of the 35 mm frame that EXIF's equivalent focal length refers to (CIPA DCG-001).
DIAGONAL_35MM = 43.2666
_EXIF_IFD, _FOCAL_35MM, _ORIENTATION = 0x8769, 0xA405, 0x0112


def picture_files(folder: Path) -> list[Path]:
    """The pictures right in a folder, in the order of the numbers in their names."""
    files = [file for file in folder_entries(folder) if file.suffix.lower() in PICTURE_SUFFIXES and file.is_file()]
    return sorted((file for file in files if not file.name.startswith(".")), key=_natural)


def foreign_files(folder: Path) -> list[str]:
    """Names of the pictures in a folder that cannot be read."""
    return sorted(file.name for file in folder.iterdir() if file.suffix.lower() in FOREIGN_SUFFIXES)


class PictureFolder:
    """The pictures of a folder.

    width, height : of the first picture, upright; focals_px : the focal length that EXIF states of each picture, in its
    own pixels, None where it states none.

    Raises
    ------
    InputError
        No picture in it can be read.
    """

    turned_deg = 0
    hdr: str | None = None
    rate = 0.0

    def __init__(self, path: Path) -> None:
        self.path = path
        self.files = picture_files(path)
        if not self.files:
            foreign = foreign_files(path)
            words = f"{foreign[0]}; convert it to JPEG" if foreign else "none"
            raise InputError.at(path, "pictures", ", ".join(sorted(PICTURE_SUFFIXES)), Unquoted(words))
        self.n_frames = len(self.files)
        described = [_described(file) for file in self.files]
        self.width, self.height, _, _ = described[0]
        self.focals_px = [focal for _, _, focal, _ in described]
        #: Whether COLMAP reads each image as it is shown: a JPEG that EXIF does not turn.
        self.is_plain_jpeg = [is_upright for _, _, _, is_upright in described]

    def frames(self) -> Iterator[VideoFrame]:
        """The pictures, upright; their times are their positions, for they have none."""
        for index, file in enumerate(self.files):
            yield VideoFrame(index, float(index), _colour(file))

    def name_of(self, index: int) -> str:
        """The file name of a picture."""
        return self.files[index].name


def _natural(file: Path) -> list[tuple[int, str]]:
    """`IMG_9` before `IMG_10`."""
    words = re.split(r"(\d+)", file.name.lower())
    return [(int(word), "") if word.isdecimal() else (-1, word) for word in words]


def _described(file: Path) -> tuple[int, int, float | None, bool]:
    """Return width, height and focal length in pixels of an upright image, and whether it is a JPEG that is upright."""
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(file) as picture:
            exif = picture.getexif()
            width, height = picture.size
            is_jpeg = picture.format == "JPEG"
    except (UnidentifiedImageError, OSError, ValueError, Image.DecompressionBombError) as error:
        raise InputError.at(file, "picture", "a picture that can be read", Unquoted(type(error).__name__)) from None
    orientation = exif.get(_ORIENTATION, 1)
    if orientation in (5, 6, 7, 8):
        width, height = height, width
    focal_px = None
    with contextlib.suppress(TypeError, ValueError):
        millimetres = float(exif.get_ifd(_EXIF_IFD).get(_FOCAL_35MM, ""))
        if 5 < millimetres < 1000:
            focal_px = millimetres / DIAGONAL_35MM * float(np.hypot(width, height))
    return width, height, focal_px, is_jpeg and orientation == 1


def _colour(file: Path) -> NDArray[np.uint8]:
    """(h, w, 3) RGB; OpenCV turns it as EXIF asks."""
    import cv2

    picture = read_picture(file, cv2.IMREAD_COLOR)
    if picture is None:
        raise InputError.at(file, "picture", "a picture that OpenCV reads", Unquoted("something else"))
    return np.ascontiguousarray(picture[:, :, ::-1])

"""Read a folder of images as frames: upright, in the order of their names, with the focal length of EXIF."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from capture.sources.video import VideoFrame
from metric_base.errors import InputError, Unquoted
from metric_base.images import IMAGE_SUFFIXES, checked_image, image_header
from metric_base.input_files import folder_entries

#: Suffixes of images that neither reads.
FOREIGN_SUFFIXES = frozenset({".heic", ".heif", ".dng", ".cr2", ".nef", ".arw", ".avif", ".jxl"})
_ORIENTATION = 0x0112


def image_files(folder: Path) -> list[Path]:
    """Return the images in a folder, in the order of the numbers in their names: `IMG_9` before `IMG_10`."""

    def natural(file: Path) -> list[tuple[int, str]]:
        words = re.split(r"(\d+)", file.name.lower())
        return [(int(word), "") if word.isdecimal() else (-1, word) for word in words]

    files = [file for file in folder_entries(folder) if file.suffix.lower() in IMAGE_SUFFIXES and file.is_file()]
    return sorted((file for file in files if not file.name.startswith(".")), key=natural)


def foreign_files(folder: Path) -> list[str]:
    """Return the names of the images in a folder that cannot be read."""
    return sorted(file.name for file in folder.iterdir() if file.suffix.lower() in FOREIGN_SUFFIXES)


class ImageFolder:
    """The images of a folder.

    Attributes
    ----------
    files : list of Path
    n_frames : int
    width, height : int
        Of the first image, upright.
    focals_px : list of float or None
        Focal length by EXIF of each image, in its pixels.
    is_plain_jpeg : list of bool
        Whether COLMAP reads the image as it is shown: a JPEG that EXIF does not rotate.

    Raises
    ------
    InputError
        There is no image, or one cannot be read.
    """

    turned_deg = 0
    hdr: str | None = None

    def __init__(self, path: Path) -> None:
        self.path = path
        self.files = image_files(path)
        if not self.files:
            foreign = foreign_files(path)
            found = f"{foreign[0]}; convert it to JPEG" if foreign else "none"
            raise InputError.at(path, "images", ", ".join(sorted(IMAGE_SUFFIXES)), Unquoted(found))
        self.n_frames = len(self.files)
        headers = [image_header(file) for file in self.files]
        if None in headers:
            file = self.files[headers.index(None)]
            raise InputError.at(file, "image", "an image that can be read", Unquoted("something else"))
        known = [(header, header.tags.get(_ORIENTATION, 1)) for header in headers if header is not None]
        self.focals_px = [header.focal_px for header, _ in known]
        self.is_plain_jpeg = [header.format == "JPEG" and orientation == 1 for header, orientation in known]
        first, orientation = known[0]
        size = (first.width, first.height)
        self.width, self.height = size[::-1] if orientation in (5, 6, 7, 8) else size

    def frames(self) -> Iterator[VideoFrame]:
        """Yield the upright images; their times are their positions."""
        import cv2

        for index, file in enumerate(self.files):
            image = checked_image(file, cv2.IMREAD_COLOR)  # OpenCV rotates as EXIF requires
            yield VideoFrame(index, float(index), np.ascontiguousarray(image[:, :, ::-1]))

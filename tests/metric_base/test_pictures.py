"""Untrusted images: files that are not images, or too large, are reported without an error."""

from __future__ import annotations

import io
import os
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from estimator.evidence.markers import refined_marker_corners
from metric_base.errors import InputError
from metric_base.images import ImageHeader, checked_image, decode_image, image_header, image_size, read_image


def bomb(width: int, height: int) -> bytes:
    """A small PNG that states that it is large."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    pixels = zlib.compress(b"\0" * 100_000)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")


@pytest.mark.parametrize("data", [b"", b"GIF89a", b"\xff\xd8\xff\xe0", bomb(60_000, 60_000), bomb(0, 5)])
def test_what_is_no_picture_is_none(data: bytes, tmp_path: Path) -> None:
    assert decode_image(data, cv2.IMREAD_COLOR) is None
    (tmp_path / "a.png").write_bytes(data)
    assert read_image(tmp_path / "a.png", cv2.IMREAD_COLOR) is None


def test_what_is_no_file_is_none(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for name in ("pipe", "nothing", "."):
        assert read_image(tmp_path / name, cv2.IMREAD_COLOR) is None
    assert read_image(Path("/dev/zero"), cv2.IMREAD_COLOR) is None


def test_a_picture_is_what_opencv_reads(tmp_path: Path) -> None:
    pixels = np.arange(60, dtype=np.uint8).reshape(4, 5, 3)
    file = tmp_path / "a.png"
    file.write_bytes(cv2.imencode(".png", pixels)[1].tobytes())
    read = read_image(file, cv2.IMREAD_COLOR)
    assert read is not None
    np.testing.assert_array_equal(read, pixels)


@settings(max_examples=100)
@given(st.data())
def test_a_damaged_picture_never_raises(data: st.DataObject) -> None:
    whole = bytearray(cv2.imencode(".png", np.full((6, 7, 3), 9, dtype=np.uint8))[1].tobytes())
    for place, value in data.draw(st.lists(st.tuples(st.integers(0, len(whole) - 1), st.integers(0, 255)), max_size=5)):
        whole[place] = value
    decoded = decode_image(bytes(whole), cv2.IMREAD_COLOR)
    assert decoded is None or decoded.ndim == 3


@pytest.mark.parametrize("compression", [None, "tiff_lzw", "tiff_deflate", "packbits", "jpeg"])
def test_a_damaged_tiff_has_markers_or_none(compression: str | None) -> None:
    """Bytes of the header, of the directory or of the pixels are replaced."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    pixels = np.pad(cv2.aruco.generateImageMarker(dictionary, 3, 60), 40, constant_values=255)
    buffer, generator = io.BytesIO(), np.random.default_rng(0)
    Image.fromarray(pixels).save(buffer, "TIFF", compression=compression)
    whole = buffer.getvalue()
    image = decode_image(whole, cv2.IMREAD_GRAYSCALE)
    assert [marker for marker, _ in refined_marker_corners(image, dictionary)] == [3]
    for _ in range(100):
        data = np.frombuffer(whole, dtype=np.uint8).copy()
        places = np.concatenate([generator.integers(0, 200, 2), len(data) - generator.integers(1, 300, 2)])
        data[places % len(data)] = generator.integers(0, 256, 4)
        decoded = decode_image(data, cv2.IMREAD_GRAYSCALE)
        if decoded is not None:
            assert len(refined_marker_corners(decoded, dictionary)) <= 1


@pytest.mark.parametrize(
    ("millimetres", "is_used"), [(5.0, False), (5.5, True), (999.0, True), (1000.0, False), ("x", False), (None, False)]
)
def test_an_equivalent_focal_length_is_used_if_it_is_of_a_camera(millimetres: object, is_used: bool) -> None:
    focal_px = ImageHeader("JPEG", 300, 400, {}, {0xA405: millimetres}, {}).focal_px
    assert (focal_px is not None) is is_used
    if focal_px is not None:
        assert focal_px == pytest.approx(float(str(millimetres)) / 43.2666 * 500)


@pytest.mark.parametrize(("stamp", "seconds"), [("2020:01:01 00:00:01 ", 63713433601), ("0000:00:00 00:00:00", None)])
def test_the_time_of_a_photograph(stamp: str, seconds: float | None) -> None:
    assert ImageHeader("JPEG", 3, 4, {}, {0x9003: stamp}, {}).taken_s == seconds
    assert ImageHeader("JPEG", 3, 4, {}, {}, {}).taken_s is None


def test_the_size_of_what_is_no_image_is_an_error(tmp_path: Path) -> None:
    Image.new("L", (3, 4)).save(tmp_path / "a.png")
    assert image_size(tmp_path / "a.png") == (3, 4)
    (tmp_path / "b.png").write_bytes(b"x")
    for read in (image_size, lambda path: checked_image(path, cv2.IMREAD_COLOR)):
        with pytest.raises(InputError, match=r"b\.png: image: expected an image .*, found something else"):
            read(tmp_path / "b.png")


@pytest.mark.parametrize(("height", "is_read"), [(1 << 14, True), ((1 << 14) + 1, False)])
def test_an_image_has_at_most_268_million_pixels(height: int, is_read: bool, tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(bomb(1 << 14, height))
    assert (image_header(tmp_path / "a.png") is not None) == is_read

"""Files of depth maps: the shapes and layouts that are read, and one line for every other."""

from __future__ import annotations

import struct
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.scene_formats.depth_files import map_stack, read_depth
from metric_base.errors import InputError
from tests.synthetic.networks import exr_bytes

DEPTH = np.arange(12.0).reshape(3, 4)


@pytest.mark.parametrize(
    ("shape", "stack"),
    [
        ((3, 4), (1, 3, 4)),
        ((2, 3, 4), (2, 3, 4)),
        ((3, 4, 1), (1, 3, 4)),
        ((3, 1, 1), (3, 1, 1)),
        ((2, 1, 3, 4), (2, 3, 4)),
        ((2, 3, 4, 1), (2, 3, 4)),
        ((2, 3, 4, 2), None),
        ((4,), None),
        ((0, 4), None),
        ((1, 1 << 14, 1 << 13), (1, 1 << 14, 1 << 13)),
        ((1, (1 << 14) + 1, 1 << 13), None),
    ],
)
def test_maps_of_one_channel_are_a_stack(shape: tuple[int, ...], stack: tuple[int, ...] | None) -> None:
    values = np.broadcast_to(np.array(1.0), shape)  # of any size in the memory of one number
    with nullcontext() if stack is not None else pytest.raises(InputError, match="one channel"):
        assert map_stack(Path("a.npy"), values).shape == stack


def _changed(data: bytes, before: bytes, after: bytes) -> bytes:
    assert data.count(before) == 1
    return data.replace(before, after)


def _window(width: int, height: int) -> bytes:
    return b"dataWindow\0box2i\0" + struct.pack("<5i", 16, 0, 0, width - 1, height - 1)


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        (b"compression\0\1\0\0\0\3", b"compression\0\1\0\0\0\4", "compression number 4"),
        (_window(4, 3), _window(0, 3), "a size of 0 x 3"),
        (_window(4, 3), _window(4, 0), "a size of 4 x 0"),
        (_window(4, 3), _window(1 << 14, (1 << 13) + 1), "a size of 16384 x 8193"),
        (struct.pack("<iB3xii", 2, 0, 1, 1), struct.pack("<iB3xii", 2, 0, 2, 1), "channel Z has a coarser grid"),
        (struct.pack("<iB3xii", 2, 0, 1, 1), struct.pack("<iB3xii", 2, 0, 1, 2), "channel Z has a coarser grid"),
    ],
)
def test_a_layout_that_is_not_read_is_named(before: bytes, after: bytes, message: str, tmp_path: Path) -> None:
    data = exr_bytes({"Z": DEPTH}, np.float32)
    (tmp_path / "a.exr").write_bytes(data)
    assert np.array_equal(read_depth(tmp_path / "a.exr"), DEPTH)
    (tmp_path / "a.exr").write_bytes(_changed(data, before, after))
    with pytest.raises(InputError, match=message):
        read_depth(tmp_path / "a.exr")


@pytest.mark.parametrize(("n_pixels", "is_read"), [(1 << 27, True), ((1 << 27) + 1, False)])
def test_a_picture_has_at_most_2_to_the_27_pixels(n_pixels: int, is_read: bool, tmp_path: Path) -> None:
    """Of one line; the compression, which is checked after the size, is another one."""
    data = _changed(exr_bytes({"Z": DEPTH}, np.float32), _window(4, 3), _window(n_pixels, 1))
    (tmp_path / "a.exr").write_bytes(_changed(data, b"compression\0\1\0\0\0\3", b"compression\0\1\0\0\0\4"))
    with pytest.raises(InputError, match="compression number 4" if is_read else f"a size of {n_pixels} x 1"):
        read_depth(tmp_path / "a.exr")


@pytest.mark.parametrize(("names", "channel"), [("ABZ", "Z"), ("AY", "Y"), ("BGR", "R"), ("A", "A"), ("AB", None)])
def test_the_depth_is_in_the_channel_of_its_name_or_in_the_only_one(
    names: str, channel: str | None, tmp_path: Path
) -> None:
    channels = {name: DEPTH + ord(name) for name in names}
    (tmp_path / "a.exr").write_bytes(exr_bytes(channels, np.float32))
    with nullcontext() if channel is not None else pytest.raises(InputError, match="channels A, B"):
        assert np.array_equal(read_depth(tmp_path / "a.exr"), DEPTH + ord(channel or ""))


@pytest.mark.parametrize(
    ("head", "order", "message"),
    [
        (b"Pf\n4 3\n-1.0\n", "<f4", None),
        (b"Pf\n4 3\n1.0\n", ">f4", None),
        (b"Pf\n4 3\n-0.003922\n", "<f4", None),
        (b"PF\n4 1\n-1.0\n", "<f4", "PFM of one channel"),
        (b"Pf\n0 3\n-1.0\n", "<f4", "PFM of one channel"),
        (b"Pf\n4 4\n-1.0\n", "<f4", "PFM of one channel"),
        (b"Pf\n4\n", "<f4", "PFM of one channel"),
    ],
)
def test_a_float_map_has_its_size_and_byte_order(head: bytes, order: str, message: str | None, tmp_path: Path) -> None:
    (tmp_path / "a.pfm").write_bytes(head + DEPTH[::-1].astype(order).tobytes())
    with nullcontext() if message is None else pytest.raises(InputError, match=message):
        assert read_depth(tmp_path / "a.pfm") == pytest.approx(DEPTH, rel=1e-6)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"depth": DEPTH}, None),
        ({"other": DEPTH}, None),
        ({"depth": np.stack([DEPTH, DEPTH])}, r"shape: expected \(h, w\), one channel"),
        ({"a": DEPTH, "b": DEPTH}, "archive: expected a NumPy archive with one of .*found arrays a, b"),
    ],
)
def test_an_archive_names_its_depth_or_has_one_array(
    arrays: dict[str, NDArray[np.float64]], message: str | None, tmp_path: Path
) -> None:
    np.savez(tmp_path / "a.npz", **arrays)
    with nullcontext() if message is None else pytest.raises(InputError, match=message):
        assert np.array_equal(read_depth(tmp_path / "a.npz"), DEPTH)


@pytest.mark.parametrize(("size", "is_refused"), [(1 << 30, False), ((1 << 30) + 1, True)])
def test_an_archive_of_more_than_a_gibibyte_is_no_depth_map(size: int, is_refused: bool, tmp_path: Path) -> None:
    """The size is that of the directory of the archive."""
    np.savez(tmp_path / "a.npz", depth=DEPTH)
    data = bytearray((tmp_path / "a.npz").read_bytes())
    entry = data.index(b"PK\x01\x02")
    data[entry + 24 : entry + 28] = size.to_bytes(4, "little")
    (tmp_path / "a.npz").write_bytes(data)
    with pytest.raises(InputError, match="more than any depth map") if is_refused else nullcontext():
        assert np.array_equal(read_depth(tmp_path / "a.npz"), DEPTH)

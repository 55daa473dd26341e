"""The focal length in a video's metadata: as PyAV writes it, and as a telephone does, in the video track."""

from __future__ import annotations

import struct
from pathlib import Path

import av
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from capture.sources.lens_metadata import KEY, stated_fisheye_deg, stated_focal_35mm
from capture.sources.video import Video
from tests.synthetic.telemetry import gpmf_key
from tests.synthetic.videos import times_of, write_video


def _film(file: Path) -> bytes:
    write_video(file, [np.full((48, 64, 3), 90 + k, dtype=np.uint8) for k in range(3)], times_of(3))
    return file.read_bytes()


def _atom(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I4s", 8 + len(content), kind) + content


def _metadata(value: bytes, number: int) -> bytes:
    """An atom `meta` with another key before the one for the focal length; number : of the value's type."""
    keys = b"".join(struct.pack(">I4s", 8 + len(key), b"mdta") + key for key in (b"com.apple.quicktime.make", KEY))
    item = _atom(b"\0\0\0\2", _atom(b"data", struct.pack(">II", number, 0) + value))
    handler = _atom(b"hdlr", bytes(8) + b"mdta" + bytes(13))
    return _atom(b"meta", handler + _atom(b"keys", struct.pack(">II", 0, 2) + keys) + _atom(b"ilst", item))


def _with_track_metadata(video: bytes, meta: bytes) -> bytes:
    """The video with an atom at the end of its first track; its table of contents is the last atom of the file."""
    moov, trak = video.index(b"moov") - 4, video.index(b"trak") - 4
    end = trak + int.from_bytes(video[trak : trak + 4], "big")
    data = bytearray(video[:end] + meta + video[end:])
    for place in (moov, trak):
        data[place : place + 4] = struct.pack(">I", int.from_bytes(data[place : place + 4], "big") + len(meta))
    return bytes(data)


@pytest.mark.parametrize(
    ("value", "number", "millimetres"),
    [
        (struct.pack(">i", 26), 21, 26.0),
        (b"\x1a", 22, 26.0),
        (struct.pack(">f", 13.5), 23, 13.5),
        (struct.pack(">d", 77.0), 24, 77.0),
        (b"50.00mm", 1, 50.0),
        (b"wide", 1, None),
        (struct.pack(">i", -3), 21, None),
        (b"", 21, None),
    ],
)
def test_a_telephones_entry_is_read(tmp_path: Path, value: bytes, number: int, millimetres: float | None) -> None:
    file = tmp_path / "a.mov"
    file.write_bytes(_with_track_metadata(_film(file), _metadata(value, number)))
    assert stated_focal_35mm(file) == millimetres
    video = Video(file)
    assert len(list(video.frames())) == 3
    # 35 mm film has a diagonal of 43.27 mm, of a width of 34.6 mm in an image of 4:3
    assert video.focal_px == (None if millimetres is None else pytest.approx(millimetres / 34.61 * 64))


def test_an_entry_of_the_film_is_read(tmp_path: Path) -> None:
    _film(tmp_path / "a.mp4")
    options = {"movflags": "use_metadata_tags"}
    with av.open(str(tmp_path / "a.mp4")) as source, av.open(str(tmp_path / "b.mp4"), "w", options=options) as copy:
        copy.metadata[KEY.decode()] = "27"
        stream = copy.add_stream_from_template(source.streams.video[0])
        for packet in source.demux(video=0):
            if packet.dts is not None:
                packet.stream = stream
                copy.mux(packet)
    assert stated_focal_35mm(tmp_path / "b.mp4") == 27.0
    assert stated_focal_35mm(tmp_path / "a.mp4") is None
    assert stated_focal_35mm(tmp_path / "none.mp4") is None


@settings(max_examples=60)
@given(place=st.integers(0, 3000), byte=st.integers(0, 255), kept=st.integers(0, 3000))
def test_damage_is_no_error(tmp_path_factory: pytest.TempPathFactory, place: int, byte: int, kept: int) -> None:
    folder = tmp_path_factory.getbasetemp()
    whole = folder / "whole.mov"
    if not whole.is_file():
        whole.write_bytes(_with_track_metadata(_film(whole), _metadata(struct.pack(">i", 26), 21)))
    data = bytearray(whole.read_bytes())
    data[place % len(data)] = byte
    (folder / "damaged.mov").write_bytes(bytes(data[: len(data) - kept % 900]))
    value = stated_focal_35mm(folder / "damaged.mov")
    assert value is None or 5 < value < 1000


@pytest.mark.parametrize(
    ("setting", "projection", "degrees", "stated"),
    [("W", "GPRO", 137.4, 137.4), ("L", "GPRO", 92.0, None), ("W", "EACO", 137.4, None), ("W", "GPRO", 400.0, None)],
)
def test_a_wide_lens_that_is_not_corrected_is_read(
    tmp_path: Path, setting: str, projection: str, degrees: float, stated: float | None
) -> None:
    lens = gpmf_key("VFOV", "c", setting.encode()) + gpmf_key("ZFOV", "f", [[degrees]])
    device = gpmf_key("DEVC", "\0", lens + gpmf_key("PRJT", "F", projection.encode()))
    file = tmp_path / "a.mp4"
    file.write_bytes(_atom(b"ftyp", b"mp41") + _atom(b"moov", _atom(b"udta", _atom(b"GPMF", device))))
    assert stated_fisheye_deg(file) == (None if stated is None else pytest.approx(stated))
    file.write_bytes(file.read_bytes()[:-30])  # cut off
    assert stated_fisheye_deg(file) is None


def _lens(degrees: float) -> bytes:
    """The settings of an uncorrected lens in the table of contents."""
    lens = gpmf_key("VFOV", "c", b"W") + gpmf_key("ZFOV", "f", [[degrees]])
    return _atom(b"udta", _atom(b"GPMF", gpmf_key("DEVC", "\0", lens + gpmf_key("PRJT", "F", b"GPRO"))))


@pytest.mark.parametrize(("degrees", "is_used"), [(60.5, True), (59.5, False), (199.5, True), (200.5, False)])
def test_a_field_of_view_from_60_to_200_degrees_is_used(tmp_path: Path, degrees: float, is_used: bool) -> None:
    (tmp_path / "a.mp4").write_bytes(_atom(b"moov", _lens(degrees)))
    assert (stated_fisheye_deg(tmp_path / "a.mp4") is not None) == is_used


@pytest.mark.parametrize(("excess", "stated"), [(0, 120.0), (1, None)])
def test_an_atom_that_does_not_fit_into_its_parent_is_ignored(
    tmp_path: Path, excess: int, stated: float | None
) -> None:
    lens = bytearray(_lens(120.0))
    lens[8:12] = struct.pack(">I", len(lens) - 8 + excess)  # the size of `GPMF` in `udta`
    (tmp_path / "a.mp4").write_bytes(_atom(b"moov", bytes(lens)))
    assert stated_fisheye_deg(tmp_path / "a.mp4") == stated


@pytest.mark.parametrize(("excess", "stated"), [(0, 120.0), (1, None)])
def test_a_table_of_contents_has_at_most_64_mebibytes(tmp_path: Path, excess: int, stated: float | None) -> None:
    lens, length = _lens(120.0), (1 << 26) + excess
    (file := tmp_path / "a.mp4").write_bytes(
        struct.pack(">I4s", 8 + length, b"moov") + lens + struct.pack(">I4s", length - len(lens), b"free")
    )
    with file.open("ab") as end:
        end.truncate(8 + length)
    assert stated_fisheye_deg(file) == stated


@pytest.mark.parametrize(
    ("value", "number", "millimetres"),
    [(struct.pack(">d", 26.0), 23, None), (struct.pack(">f", 26.0), 24, None), (bytes(8) + b"\x1a", 22, None)],
)
def test_a_number_of_another_length_than_its_type_is_ignored(
    tmp_path: Path, value: bytes, number: int, millimetres: float | None
) -> None:
    file = tmp_path / "a.mov"
    file.write_bytes(_with_track_metadata(_film(file), _metadata(value, number)))
    assert stated_focal_35mm(file) == millimetres

"""The colours of a video that is written again: its matrix, range, transfer and depth, and the samples themselves."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from capture.sources.video import Video
from insertion.footage.video_writer import VideoWriter, changed_frame, matrix_of

TAGS = ("colorspace", "color_range", "color_primaries", "color_trc")
#: pixel format, then matrix, range, primaries and transfer by their numbers: six kinds of video.
KINDS = {
    "untagged": ("yuv420p", (2, 0, 2, 2)),
    "BT.601": ("yuv420p", (6, 1, 6, 6)),
    "BT.709": ("yuv420p", (1, 1, 1, 1)),
    "full range": ("yuv420p", (1, 2, 1, 1)),
    "10 bits": ("yuv422p10le", (1, 1, 1, 1)),
    "HLG": ("yuv420p10le", (9, 1, 9, 18)),
    "PQ": ("yuv420p10le", (9, 1, 9, 16)),
}


def _write_source(file: Path, pixel_format: str, tags: tuple[int, ...]) -> None:
    """Two frames of noise within the colours that a screen has, lossless."""
    import av

    generator = np.random.default_rng(0)
    with av.open(str(file), "w") as container:
        stream: Any = container.add_stream("ffv1", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, pixel_format
        for name, value in zip(TAGS, tags, strict=True):
            setattr(stream.codec_context, name, value)
        for number in range(2):
            frame = av.VideoFrame(64, 48, pixel_format)
            for plane, (low, high) in zip(frame.planes, ((90, 180), (110, 146), (110, 146)), strict=True):
                kind, times = (np.uint16, 4) if pixel_format.endswith("10le") else (np.uint8, 1)
                samples = np.frombuffer(memoryview(plane), kind)
                samples[...] = generator.integers(low * times, high * times, samples.shape)
            for name, value in zip(TAGS, tags, strict=True):
                setattr(frame, name, value)
            frame.pts, frame.time_base = number, Fraction(1, 25)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def _frames(file: Path) -> list[Any]:
    import av

    with av.open(str(file)) as container:
        return list(container.decode(video=0))


def _samples(frame: Any) -> list[np.ndarray]:
    deep = frame.format.name.endswith("10le")
    return [
        np.frombuffer(bytes(plane), np.uint16 if deep else np.uint8).reshape(plane.height, -1)[:, : plane.width]
        for plane in frame.planes
    ]


@pytest.mark.parametrize("name", KINDS)
def test_unchanged_samples_equal_the_source_bit_by_bit(name: str, tmp_path: Path) -> None:
    pixel_format, tags = KINDS[name]
    source, out = tmp_path / "source.mkv", tmp_path / "out.mkv"
    _write_source(source, pixel_format, tags)
    with VideoWriter(out, ".mkv", source, codec="lossless") as writer:
        for frame in Video(source).frames():
            picture = frame.colour.copy()
            picture[16:32, 16:40] = (180, 60, 40)
            writer.write(picture, frame.time_s, frame.index)
    for before, after in zip(_frames(source), _frames(out), strict=True):
        assert after.format.name.replace("yuvj", "yuv") == pixel_format
        assert tuple(int(getattr(after, tag)) for tag in TAGS) == tags
        for one, two in zip(_samples(before), _samples(after), strict=True):
            down, across = 48 // one.shape[0], 64 // one.shape[1]
            apart = np.ones(one.shape, bool)
            apart[16 // down : 32 // down, 16 // across : 40 // across] = False
            np.testing.assert_array_equal(one[apart], two[apart])
            assert (one != two)[~apart].mean() > 0.5
    shown = next(Video(out).frames()).colour[20:28, 20:36].astype(int)
    if name not in ("HLG", "PQ"):  # noise has no colour of that level there, from which the curve is read
        assert np.abs(np.median(shown, axis=(0, 1)) - (180, 60, 40)).max() <= 3


@pytest.mark.parametrize("number", [1, 5, 9])
def test_the_matrix_is_that_of_the_decoder(number: int) -> None:
    """A grey has no chroma, white has all luma, and red and blue are at the ends of theirs."""
    matrix = matrix_of(number)
    np.testing.assert_allclose(matrix @ np.ones(3), [1, 0, 0], atol=1e-12)
    assert matrix[1] @ [0, 0, 1] == pytest.approx(0.5)
    assert matrix[2] @ [1, 0, 0] == pytest.approx(0.5)


def test_an_unchanged_image_is_the_frame_itself() -> None:
    import av

    frame = av.VideoFrame(16, 16, "yuv420p")
    picture = np.zeros((16, 16, 3), np.uint8)
    assert changed_frame(frame, picture, picture) is frame


@pytest.mark.parametrize(
    ("codec", "suffix", "name"),
    [(None, ".mp4", "hevc"), ("hevc", ".mp4", "hevc"), ("prores", ".mov", "prores")],
    ids=["default", "hevc", "prores"],
)
def test_codecs_of_ten_bits_keep_the_tags(codec: str | None, suffix: str, name: str, tmp_path: Path) -> None:
    import av

    source, out = tmp_path / "source.mkv", tmp_path / f"out{suffix}"
    _write_source(source, *KINDS["10 bits"])
    with VideoWriter(out, suffix, source, codec=codec) as writer:
        for frame in Video(source).frames():
            writer.write(frame.colour, frame.time_s, frame.index)
    (first, _) = _frames(out)
    with av.open(str(out)) as container:
        assert container.streams.video[0].codec_context.name == name
    assert tuple(int(getattr(first, tag)) for tag in TAGS) == KINDS["10 bits"][1]
    assert first.format.name == "yuv422p10le"
    before, after = _samples(_frames(source)[0])[0].astype(int), _samples(first)[0].astype(int)
    assert np.corrcoef(before.ravel(), after.ravel())[0, 1] > 0.9  # noise is hard for a codec


@pytest.mark.parametrize("suffix", [".mp4", ".mkv", ".webm"])
def test_images_of_odd_sides_lose_one_row_and_one_column(suffix: str, tmp_path: Path) -> None:
    rows, columns = np.mgrid[:51, :77]
    picture = np.dstack([4 * rows, 2 * columns, np.full(rows.shape, 90)]).astype(np.uint8)
    with VideoWriter(tmp_path / f"out{suffix}", suffix) as writer:
        writer.write(picture, 0.0)
    shown = next(Video(tmp_path / f"out{suffix}").frames()).colour
    assert shown.shape == (50, 76, 3)
    assert np.abs(shown.astype(int) - picture[:50, :76]).mean() < 4

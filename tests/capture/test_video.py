"""Videos written here by PyAV and read back: rotation, times, HDR, damage."""

from __future__ import annotations

import json
from contextlib import nullcontext
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from capture.sources import video
from capture.sources.frames import make_frames
from capture.sources.video import Video
from metric_base.errors import InputError
from tests.synthetic.videos import times_of, write_video

HEIGHT, WIDTH = 96, 160


def _pictures(n: int) -> list[NDArray[np.uint8]]:
    """Flat images with a red upper left and a blue lower right corner; the grey level grows with the index."""
    pictures = []
    for k in range(n):
        picture = np.full((HEIGHT, WIDTH, 3), 60 + 8 * k, dtype=np.uint8)
        picture[:32, :48] = (220, 20, 20)
        picture[-32:, -48:] = (20, 20, 220)
        pictures.append(picture)
    return pictures


def _upright(colour: NDArray[np.uint8]) -> bool:
    red, blue = colour[8, 8].astype(int), colour[-8, -8].astype(int)
    return bool(red[0] > 150 > red[2] and blue[2] > 150 > blue[0])


@pytest.mark.parametrize("turned", [0, 90, 180, 270])
def test_rotation_is_applied(tmp_path: Path, turned: int) -> None:
    file = tmp_path / "video.mp4"
    write_video(file, _pictures(5), times_of(5), turned_deg=turned)
    video = Video(file)
    frames = list(video.frames())
    assert (video.turned_deg, video.width, video.height, video.n_frames) == (turned, WIDTH, HEIGHT, 5)
    assert all(frame.colour.shape == (HEIGHT, WIDTH, 3) and _upright(frame.colour) for frame in frames)
    levels = [int(frame.colour[HEIGHT // 2, WIDTH // 2, 1]) for frame in frames]
    np.testing.assert_allclose(levels, [60 + 8 * k for k in range(5)], atol=3)


def test_opencv_agrees_on_what_is_upright(tmp_path: Path) -> None:
    import cv2

    file = tmp_path / "video.mp4"
    write_video(file, _pictures(2), times_of(2), turned_deg=90)
    good, picture = cv2.VideoCapture(str(file)).read()  # OpenCV applies the rotation silently
    assert good
    ours = next(iter(Video(file).frames())).colour
    np.testing.assert_allclose(picture[:, :, ::-1].astype(int), ours.astype(int), atol=6)


def test_presentation_times_are_kept(tmp_path: Path) -> None:
    file = tmp_path / "video.mp4"
    times = times_of(12, variable=True)
    assert np.diff(times).max() > 1.5 * np.diff(times).min()
    write_video(file, _pictures(12), times)
    read = [frame.time_s for frame in Video(file).frames()]
    np.testing.assert_allclose(read, times, atol=1e-4)


@pytest.mark.parametrize(("trc", "name"), [(16, "PQ"), (18, "HLG")])
def test_hdr_is_named_and_tone_mapped(tmp_path: Path, trc: int, name: str) -> None:
    file = tmp_path / "video.mp4"
    colour = {"color_trc": trc, "color_primaries": 9, "colorspace": 9}
    write_video(file, _pictures(3), times_of(3), colour=colour, codec="libx265", pixels="yuv420p10le")
    video = Video(file)
    assert video.hdr == name
    levels = [int(frame.colour[HEIGHT // 2, WIDTH // 2, 1]) for frame in video.frames()]
    assert levels == sorted(levels)  # brighter stays brighter
    assert levels[0] < levels[-1]


def test_a_truncated_video_gives_its_readable_frames(tmp_path: Path) -> None:
    whole, cut = tmp_path / "whole.mkv", tmp_path / "cut.mkv"
    generator = np.random.default_rng(0)
    noise = [generator.integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8) for _ in range(30)]
    write_video(whole, noise, times_of(30))
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    assert 5 < len(list(Video(cut).frames())) < 30


PLAYLISTS = (
    b"#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nother.mp4\n#EXT-X-ENDLIST\n",
    b"ffconcat version 1.0\nfile 'other.mp4'\n",
)


@pytest.mark.parametrize("content", [b"", b"not a video at all" * 50, *PLAYLISTS])
def test_what_is_no_video_is_named(tmp_path: Path, content: bytes) -> None:
    write_video(tmp_path / "other.mp4", [np.zeros((48, 64, 3), dtype=np.uint8)] * 3, times_of(3))
    file = tmp_path / "video.mp4"
    file.write_bytes(content)
    with pytest.raises(InputError, match=r"video\.mp4: video: expected a video that FFmpeg reads"):
        Video(file)
    with pytest.raises(InputError, match="no such file"):
        Video(tmp_path / "none.mp4")


def test_sound_alone_is_no_video(tmp_path: Path) -> None:
    import av

    file = tmp_path / "sound.mp4"
    with av.open(str(file), "w") as container:
        stream = container.add_stream("aac", rate=44100)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 4096), dtype=np.float32), format="fltp", layout="mono")
        frame.rate = 44100
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    with pytest.raises(InputError, match="a video stream"):
        Video(file)


@pytest.mark.parametrize(
    ("shape", "width"),
    [("1", 160), ("4/3", 213), ("8", 1280), ("1/8", 20), ("9", None), ("1/9", None)],
)
def test_pixels_of_a_video_may_be_eight_times_as_wide_as_high(tmp_path: Path, shape: str, width: int | None) -> None:
    file = tmp_path / "a.mp4"
    write_video(file, _pictures(2), times_of(2), colour={"sample_aspect_ratio": Fraction(shape)})
    with nullcontext() if width is not None else pytest.raises(InputError, match="pixels of a shape below 8:1"):
        film = Video(file)
        assert (film.width, film.height) == (width, HEIGHT)
        assert next(iter(film.frames())).colour.shape == (HEIGHT, width, 3)


@pytest.mark.parametrize(("pixels", "is_read"), [(WIDTH * HEIGHT, True), (WIDTH * HEIGHT - 1, False)])
def test_frames_of_a_video_have_a_maximum_of_pixels(
    tmp_path: Path, pixels: int, is_read: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As many as the frames of this video have, because an encoder takes seconds for 64 megapixels."""
    write_video(tmp_path / "a.mp4", _pictures(1), times_of(1))
    monkeypatch.setattr(video, "MAX_PIXELS", pixels)
    with nullcontext() if is_read else pytest.raises(InputError, match=f"frames of at most {pixels:,} pixels"):
        assert Video(tmp_path / "a.mp4").width == WIDTH


@pytest.mark.parametrize(("n_stated", "is_remarked"), [(22, False), (23, True)])
def test_a_tenth_of_the_stated_frames_may_be_missing(tmp_path: Path, n_stated: int, is_remarked: bool) -> None:
    write_video(tmp_path / "a.mp4", _pictures(20), times_of(20))
    film = Video(tmp_path / "a.mp4")
    film.n_frames = n_stated
    (tmp_path / "part").mkdir()
    make_frames(tmp_path / "part", film, wanted=3)
    (written,) = tmp_path.glob("part/frames.json")
    remarks = json.loads(written.read_text(encoding="utf-8"))["remarks"]
    message = f"the file states {n_stated} frames, and 20 could be read: the others are damaged or missing"
    assert remarks == ([message] if is_remarked else [])

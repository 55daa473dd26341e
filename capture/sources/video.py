"""Decode a video: upright RGB frames with their presentation times, tone-mapped if it is HDR."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture.sources.lens_metadata import stated_fisheye_deg, stated_focal_35mm
from estimator.telemetry.readers import READ_ALONE
from metric_base.errors import InputError, Unquoted

RgbImage = NDArray[np.uint8]

#: Suffixes of files that are opened as videos; files with other content are rejected.
VIDEO_SUFFIXES = frozenset({".mp4", ".mov", ".m4v", ".mkv", ".webm", ".avi", ".mts", ".m2ts", ".3gp", ".mpg", ".mpeg"})
#: Maximum number of pixels of a frame, and maximum ratio of the sides of a pixel.
MAX_PIXELS, MAX_ASPECT = 1 << 26, 8
#: Width in millimetres of a 4:3 image whose diagonal is that of 35 mm film. Phones state the focal lengths of their
#: photographs, which have this shape, and their videos are as wide.
WIDTH_35MM = 34.61
#: Threads of the decoder; the reference machine has two cores.
N_THREADS = 2
#: FFmpeg's numbers of transfer curves (ITU-T H.273) that are HDR.
CURVES = {16: "PQ", 18: "HLG"}
#: Luminance of diffuse white: 203 cd/m2 (ITU-R BT.2408); in HLG's scene light of 1 at the peak it is 0.265.
WHITE_PQ, WHITE_HLG = 203.0, 0.265
#: BT.2020 to BT.709 primaries, linear light (ITU-R BT.2087).
TO_709 = np.array([[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]])


@dataclass(frozen=True, slots=True, eq=False)
class VideoFrame:
    """A decoded frame."""

    index: int  #: From 0 in presentation order.
    time_s: float  #: Presentation time.
    colour: RgbImage  #: (h, w, 3) upright RGB.


class Video:
    """A video file.

    Attributes
    ----------
    width, height : int
        Size of the upright frames in pixels.
    turned_deg : int
        Clockwise rotation that the container requests, applied to every frame.
    n_frames : int
        Number of frames that the container states, otherwise its duration times the rate; 0 if neither is known.
    rate : float
        Frames per second, 0 if unknown.
    hdr : str or None
        Name of its HDR curve; None for standard range.
    focal_px : float or None
        Focal length in pixels that the container states; stabilisation crops a video by about a tenth.
    fisheye_deg : float or None
        Field of view from corner to corner that the container states of an uncorrected wide lens.

    Raises
    ------
    InputError
        The file is missing or is not a video.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with _opened(path) as (container, stream):
            first = next(_decode(path, container, stream), None)
            if first is None:
                raise InputError.at(path, "video", "at least one frame that can be decoded", Unquoted("none"))
            rate = stream.average_rate or stream.guessed_rate
            seconds = 0.0
            if stream.duration and stream.time_base:
                seconds = float(stream.duration * stream.time_base)
            elif container.duration:
                seconds = container.duration / 1e6
            self.rate = float(rate) if rate else 0.0
            self.n_frames = int(stream.frames) or round(seconds * self.rate)  # some containers do not count frames
            self.turned_deg = -round(first.rotation / 90) * 90 % 360
            self.hdr = CURVES.get(int(first.color_trc))
            self._aspect = float(stream.sample_aspect_ratio or Fraction(1))
            if not 1 / MAX_ASPECT <= self._aspect <= MAX_ASPECT:
                raise InputError.at(path, "video", f"pixels of a shape below {MAX_ASPECT}:1", self._aspect)
            self.height, self.width = self._upright(first).shape[:2]
        stated = stated_focal_35mm(path)
        self.fisheye_deg = stated_fisheye_deg(path)
        self.focal_px = None if stated is None else stated / WIDTH_35MM * max(self.width, self.height)

    def frames(self) -> Iterator[VideoFrame]:
        """Yield all frames up to the first damaged one."""
        last = -np.inf
        for index, frame, colour in self.stored_frames():
            time_s = frame.time if frame.time is not None else index / (self.rate or 30.0)
            last = max(float(time_s), float(np.nextafter(last, np.inf)))  # times ascend, also if the file repeats one
            yield VideoFrame(index, last, colour)

    def stored_frames(self) -> Iterator[tuple[int, Any, RgbImage]]:
        """Yield the index, the PyAV frame with samples and tags, and the upright image (h, w, 3) of each frame."""
        with _opened(self.path) as (container, stream):
            for index, frame in enumerate(_decode(self.path, container, stream)):
                yield index, frame, self._upright(frame)

    def _upright(self, frame: Any) -> RgbImage:
        """Return the image of a frame: standard range, square pixels, upright."""
        if self.hdr is None:
            colour = frame.to_ndarray(format="rgb24")
        else:
            colour = standard_range(frame.to_ndarray(format="rgb48le"), self.hdr)
        if abs(self._aspect - 1) > 1e-3:
            import cv2

            height, width = colour.shape[:2]
            size = (max(round(width * self._aspect), 1), height)
            colour = np.asarray(cv2.resize(colour, size, interpolation=cv2.INTER_AREA))
        return np.ascontiguousarray(np.rot90(colour, -self.turned_deg // 90))


@contextmanager
def _opened(path: Path) -> Iterator[tuple[Any, Any]]:
    """Open a video; yield its container and its first video stream that is not a cover image."""
    import av

    if not path.is_file():
        found = "a folder or a device" if path.exists() else "no such file"
        raise InputError.at(path, "video", "a file", Unquoted(found))
    try:
        # with the prefix, FFmpeg does not read a colon in the name as a protocol; READ_ALONE rejects playlists
        container = av.open(f"file:{path}", metadata_errors="replace", container_options=READ_ALONE)
    except (av.error.FFmpegError, OSError) as error:
        words = getattr(error, "strerror", None) or str(error)
        raise InputError.at(path, "video", "a video that FFmpeg reads", Unquoted(words)) from None
    with container:
        cover = av.stream.Disposition.attached_pic
        stream = next((stream for stream in container.streams.video if not stream.disposition & cover), None)
        if stream is None:
            raise InputError.at(path, "video", "a video stream", Unquoted("none"))
        if stream.codec_context is None:
            raise InputError.at(path, "video", "a codec that FFmpeg decodes", Unquoted("another"))
        if stream.width * stream.height > MAX_PIXELS:
            size = Unquoted(f"{stream.width} x {stream.height}")
            raise InputError.at(path, "video", f"frames of at most {MAX_PIXELS:,} pixels", size)
        stream.thread_type, stream.thread_count = "AUTO", N_THREADS
        yield container, stream


def _decode(path: Path, container: Any, stream: Any) -> Iterator[Any]:
    """Yield the frames up to the first that cannot be decoded."""
    import av

    size = None
    with suppress(av.error.FFmpegError):
        for frame in container.decode(stream):
            size = size or (frame.width, frame.height)
            if (frame.width, frame.height) != size:
                raise InputError.at(path, "video", f"frames of one size, {size}", (frame.width, frame.height))
            yield frame


def standard_range(colour: NDArray[np.uint16], curve: str) -> NDArray[np.uint8]:
    """Return sRGB (h, w, 3) of a 16-bit BT.2020 image: linear light, BT.709 primaries, Reinhard's tone curve."""
    signal = np.arange(0, 65536, 16) / 65535.0  # 4,096 levels are finer than the 10 bits of a video
    if curve == "PQ":  # linear light in units of diffuse white (ITU-R BT.2100)
        power = signal ** (32 / 2523)
        light = (np.maximum(power - 0.8359375, 0) / (18.8515625 - 18.6875 * power)) ** (8192 / 1305)
        light *= 10_000.0 / WHITE_PQ
    else:
        a, b, c = 0.17883277, 0.28466892, 0.55991073
        light = np.where(signal <= 0.5, signal**2 / 3, (np.exp((signal - c) / a) + b) / 12) / WHITE_HLG
    linear = light[colour >> 4].astype(np.float32) @ TO_709.T.astype(np.float32)
    linear = np.maximum(linear, 0)
    # x (1 + x / w^2) / (1 + x): 1 at w, four times diffuse white; middle tones are darkened and are lifted again
    bright = linear * (1 + linear / 16) / (1 + linear) * 1.6
    encoded = np.where(bright <= 0.0031308, 12.92 * bright, 1.055 * np.maximum(bright, 1e-6) ** (1 / 2.4) - 0.055)
    return np.asarray(np.clip(np.rint(encoded * 255), 0, 255), dtype=np.uint8)

"""Write a video by PyAV with the times, sound, rotation, colour tags and time code of its source.

A frame of the source keeps its matrix, range, primaries, transfer function and bit depth. A change of the image in RGB
is converted to a change of luma and chroma by the matrix of the frame; all other samples are unchanged bit by bit.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

from capture.sources.video import Video

RgbImage = NDArray[np.uint8]
#: Weights of red and blue in luma, by the code of the matrix in ITU-T H.273.
_WEIGHTS = {1: (0.2126, 0.0722), 4: (0.30, 0.11), 7: (0.212, 0.087), 9: (0.2627, 0.0593), 10: (0.2627, 0.0593)}
#: Weights for a frame without a matrix, as in FFmpeg (BT.601).
_DEFAULT = (0.299, 0.114)
#: Pixel formats with planes Y, U, V of 8 bits, or of more bits in two bytes.
_PLANAR = ("yuv420p", "yuv422p", "yuv444p", "yuvj420p", "yuvj422p", "yuvj444p")
#: Value of `color_range` in FFmpeg for samples from 0 to 255 (full range).
_FULL_RANGE = 2
ChromaMatrix = NDArray[np.float64]
_CODE = re.compile(r"(\d\d):(\d\d):(\d\d)([:;.])(\d\d)")
#: Time base of the frames, a multiple of all common rates.
TIME_BASE = Fraction(1, 90_000)
#: Maximum denominator of a frame rate (30,000 / 1001).
MAX_RATE_DENOMINATOR = 1001
#: Constant quality of x264 without a visible loss, a few Mbit/s.
QUALITY = "17"
_FORMATS = {".mkv": "matroska", ".webm": "webm", ".mov": "mov", ".avi": "avi"}
#: Encoder of FFmpeg, its options, and its only pixel format or None, by the value of `--codec`. The default is h264, or
#: hevc for a source of more than 8 bits.
CODECS: dict[str, tuple[str, dict[str, str], str | None]] = {
    "h264": ("libx264", {"crf": QUALITY, "preset": "fast"}, None),
    "hevc": ("libx265", {"crf": QUALITY, "preset": "fast", "x265-params": "log-level=error:bframes=0"}, None),
    "prores": ("prores_ks", {"profile": "3"}, "yuv422p10le"),
    "lossless": ("libx264", {"qp": "0", "preset": "fast"}, None),
    "vp9": ("libvpx-vp9", {"crf": QUALITY, "b": "0"}, None),
}
#: Pixel formats of 8 and of 10 bits that all encoders support. Other formats are converted to the first one.
_PLAIN, _DEEP = ("yuv420p", "yuv422p", "yuv444p"), ("yuv420p10le", "yuv422p10le", "yuv444p10le")
_TAGS = ("colorspace", "color_range", "color_primaries", "color_trc")
#: Tags of a video of images: BT.709, limited range.
_IMAGE_SEQUENCE_TAGS = (1, 1, 1, 1)


def matrix_of(number: int) -> ChromaMatrix:
    """Return the matrix (3, 3) from RGB to luma and chroma, all with a range of 1, for a code of H.273."""
    red, blue = _WEIGHTS.get(number, _DEFAULT)
    luma = np.array([red, 1 - red - blue, blue])
    by_blue = (np.array([0.0, 0.0, 1.0]) - luma) / (2 * (1 - blue))
    by_red = (np.array([1.0, 0.0, 0.0]) - luma) / (2 * (1 - red))
    return np.stack([luma, by_blue, by_red])


def changed_frame(frame: Any, before: RgbImage, after: RgbImage) -> Any:
    """Return a frame of PyAV with the change of an image from `before` to `after`, (h, w, 3) in stored orientation.

    Without a change, the frame itself is returned. Formats other than planar Y, U, V are converted to 4:4:4.
    """
    import cv2

    delta = after.astype(np.float32) - before
    if not delta.any():
        return frame
    deep = frame.format.name.removesuffix("le")
    base, bits = (deep[:-2], int(deep[-2:])) if deep[-2:] in ("10", "12") else (deep, 8)
    if base not in _PLANAR:
        frame, bits = frame.reformat(format="yuv444p"), 8
    out = _copy(frame)
    if int(frame.color_trc) in (16, 18):
        delta = _hdr_change(frame, before, after)
    if delta.shape[:2] != (frame.height, frame.width):  # non-square pixels
        delta = cv2.resize(delta, (frame.width, frame.height), interpolation=cv2.INTER_AREA)
    full = int(frame.color_range) == _FULL_RANGE or frame.format.name.startswith("yuvj")
    ranges = np.array([255.0, 255.0, 255.0] if full else [219.0, 224.0, 224.0]) * 2 ** (bits - 8)
    change = (delta / 255) @ matrix_of(int(frame.colorspace)).T.astype(np.float32) * ranges.astype(np.float32)
    kind, top = (np.uint8, 255) if bits == 8 else (np.uint16, 2**bits - 1)
    for number, plane in enumerate(out.planes[:3]):
        samples = np.frombuffer(memoryview(plane), kind).reshape(plane.height, -1)[:, : plane.width]
        own = change[..., number]
        if own.shape != samples.shape:
            own = cv2.resize(own, samples.shape[::-1], interpolation=cv2.INTER_AREA)
        samples[...] = np.clip(np.rint(samples + own), 0, top)
    return out


def _copy(frame: Any) -> Any:
    """Return a copy of a frame with the same samples and tags."""
    out = av.VideoFrame(frame.width, frame.height, frame.format.name)
    for target, source in zip(out.planes, frame.planes, strict=True):
        wide = min(target.line_size, source.line_size)
        rows = np.frombuffer(memoryview(target), np.uint8).reshape(-1, target.line_size)
        rows[:, :wide] = np.frombuffer(memoryview(source), np.uint8).reshape(-1, source.line_size)[:, :wide]
    for tag in _TAGS:
        setattr(out, tag, getattr(frame, tag))
    return out


def _hdr_change(frame: Any, before: RgbImage, after: RgbImage) -> NDArray[np.float32]:
    """Return the change (h, w, 3) of an HDR signal, 0 to 255, for a change of the image in standard range.

    The signal of each level is estimated from the frame: the mean over the pixels with this level.
    """
    signal = frame.to_ndarray(format="rgb48le").astype(np.float32) / 257
    if signal.shape != before.shape:
        return after.astype(np.float32) - before
    change = np.zeros(before.shape, np.float32)
    for channel in range(3):
        old, new, own = before[..., channel], after[..., channel], signal[..., channel]
        total = np.bincount(old.ravel(), own.ravel(), 256)
        count = np.bincount(old.ravel(), minlength=256)
        levels = np.flatnonzero(count)
        curve = np.maximum.accumulate(total[levels] / count[levels])
        table = np.interp(np.arange(256), levels, curve).astype(np.float32)
        change[..., channel] = table[new] - table[old]
    return change


def time_code_after(code: str, frames: int, rate: float) -> str:
    """Return the time code (HH:MM:SS:FF) `frames` frames after `code` at a rate in frames per second.

    With `;` or `.` before the frames, two numbers are skipped in each minute except every tenth (four at 60 frames per
    second). Other texts are returned unchanged.
    """
    match = _CODE.fullmatch(code)
    whole = round(rate)
    if match is None or whole < 1:
        return code
    hours, minutes, seconds, number = (int(match[k]) for k in (1, 2, 3, 5))
    dropped = whole // 15 if match[4] in ";." else 0
    past = 60 * hours + minutes
    count = (60 * past + seconds) * whole + number - dropped * (past - past // 10) + frames
    in_ten, in_minute = 600 * whole - 9 * dropped, 60 * whole - dropped
    tens, rest = divmod(count, in_ten)
    count += dropped * (9 * tens + max(rest - dropped, 0) // in_minute)
    seconds, number = divmod(count, whole)
    return f"{seconds // 3600 % 24:02}:{seconds // 60 % 60:02}:{seconds % 60:02}{match[4]}{number:02}"


class VideoWriter:
    """Context manager that writes a video. Sound packets of the source are copied, not encoded again.

    Parameters
    ----------
    file : Path
        File to write.
    suffix : str
        Suffix that determines the container.
    source : Path, optional
        Video of the frames; unchanged samples are copied from it.
    turned_deg : int, default 0
        Rotation of the source in degrees.
    codec : str, optional
        Key of `CODECS`; by default H.264, or HEVC for a source of more than 8 bits.
    """

    def __init__(
        self, file: Path, suffix: str, source: Path | None = None, turned_deg: int = 0, codec: str | None = None
    ) -> None:
        self._file, self._suffix, self._source, self._turned = file, suffix.lower(), source, turned_deg
        self._codec = codec or ("vp9" if self._suffix == ".webm" else None)
        self._video = None if source is None else Video(source)
        self._frames: Iterator[tuple[int, Any, NDArray[np.uint8]]] | None = None
        self._container: Any = None
        self._stream: Any = None
        self._first_s: float | None = None
        self._first = 0
        self._last_s = 0.0

    def __enter__(self) -> VideoWriter:
        self._container = av.open(f"file:{self._file}", "w", format=_FORMATS.get(self._suffix, "mp4"))
        if self._video is not None:
            self._frames = self._video.stored_frames()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None and self._stream is not None:
                self._container.mux(self._stream.encode())
                self._copy_sound()
        finally:
            self._container.close()

    def write(self, image: NDArray[np.uint8], time_s: float, index: int = 0) -> None:
        """Add an upright RGB image (h, w, 3) shown from `time_s` on; `index` is that of the frame of the source."""
        if self._first_s is None:
            self._first, self._first_s = index, time_s if index else 0.0  # a range of frames starts at 0
        frame = self._frame(image, index)
        if self._stream is None:
            self._open(frame)
        if frame.format.name != self._stream.pix_fmt:
            tags = [getattr(frame, tag) for tag in _TAGS]
            frame = frame.reformat(format=self._stream.pix_fmt)
            for tag, value in zip(_TAGS, tags, strict=True):
                setattr(frame, tag, value)
        frame.pts, frame.time_base = round((time_s - self._first_s) / TIME_BASE), TIME_BASE
        frame.pict_type = 0  # the encoder decides
        self._last_s = time_s
        self._container.mux(self._stream.encode(frame))

    def _frame(self, image: NDArray[np.uint8], index: int) -> Any:
        """Return an image (h, w, 3) as a frame of PyAV: a changed frame of the source, or a new one of BT.709."""
        stored = np.ascontiguousarray(np.rot90(image, self._turned // 90))
        for number, frame, upright in self._frames or ():
            if number == index:
                return changed_frame(frame, np.rot90(upright, self._turned // 90), stored)
        stored = stored[: stored.shape[0] // 2 * 2, : stored.shape[1] // 2 * 2]  # 4:2:0 needs even sides
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(stored), format="rgb24")
        frame = frame.reformat(format="yuv420p", dst_colorspace="ITU709")
        for tag, value in zip(_TAGS, _IMAGE_SEQUENCE_TAGS, strict=True):
            setattr(frame, tag, value)
        return frame

    def _open(self, frame: Any) -> None:
        deep = frame.format.name.endswith(("10le", "12le"))
        encoder, options, only = CODECS[self._codec or ("hevc" if deep else "h264")]
        rate = Fraction(0.0 if self._video is None else self._video.rate).limit_denominator(MAX_RATE_DENOMINATOR)
        stream = self._container.add_stream(encoder, rate=rate or 30, options=dict(options))
        usual = _DEEP if deep else _PLAIN
        own = frame.format.name.replace("yuvj", "yuv")
        stream.width, stream.height = frame.width, frame.height
        stream.pix_fmt = only or (own if own in usual else usual[0])
        stream.codec_context.time_base = TIME_BASE
        for tag in _TAGS:
            setattr(stream.codec_context, tag, int(getattr(frame, tag)))
        if self._turned:
            stream.set_display_rotation(-self._turned)
        self._stream = stream
        self._sound: list[Any] = []
        if self._source is not None:
            with av.open(f"file:{self._source}", metadata_errors="replace") as source:
                self._sound = [self._container.add_stream_from_template(one) for one in source.streams.audio]
                own_words = source.streams.video[0].metadata
                words = {key: own_words[key] for key in ("timecode", "reel_name") if key in own_words}
                words |= {key: source.metadata[key] for key in ("timecode", "creation_time") if key in source.metadata}
                if "timecode" in words:
                    words["timecode"] = time_code_after(words["timecode"], self._first, float(rate))
                self._container.metadata.update(words)
                stream.metadata.update(words)

    def _copy_sound(self) -> None:
        """Copy the packets of sound during the written frames."""
        if not self._sound or self._source is None:
            return
        start = self._first_s or 0.0
        with av.open(f"file:{self._source}", metadata_errors="replace") as source:
            streams = dict(zip((one.index for one in source.streams.audio), self._sound, strict=True))
            for packet in source.demux(*source.streams.audio):
                if packet.dts is None:
                    continue
                time_s = float(packet.pts * packet.time_base)
                if start and not start <= time_s <= self._last_s:
                    continue
                shift = round(start / packet.time_base)
                packet.pts, packet.dts = packet.pts - shift, packet.dts - shift
                packet.stream = streams[packet.stream.index]
                self._container.mux(packet)

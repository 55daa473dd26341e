"""A video file by PyAV: times, sound, rotation, colour tags and time code of the source are kept."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture.sources.video import Video
from insertion.colour.source_frame import changed_frame
from insertion.footage.time_code import time_code_after

__all__ = ["CODECS", "VideoWriter"]

#: Time base of the pictures: a multiple of all usual rates.
TIME_BASE = Fraction(1, 90_000)
#: Rates are fractions of seconds in at most so many parts (30,000 / 1001).
MOST_PARTS = 1001
#: x264's constant quality: no loss that one sees, a few Mbit/s.
QUALITY = "17"
_FORMATS = {".mkv": "matroska", ".webm": "webm", ".mov": "mov", ".avi": "avi"}
#: What `--codec` names: FFmpeg's encoder with its options, and the pixel format it wants where it has only one.
CODECS: dict[str, tuple[str, dict[str, str], str | None]] = {
    "h264": ("libx264", {"crf": QUALITY, "preset": "fast"}, None),
    "hevc": ("libx265", {"crf": QUALITY, "preset": "fast", "x265-params": "log-level=error:bframes=0"}, None),
    "prores": ("prores_ks", {"profile": "3"}, "yuv422p10le"),
    "lossless": ("libx264", {"qp": "0", "preset": "fast"}, None),
    "vp9": ("libvpx-vp9", {"crf": QUALITY, "b": "0"}, None),
}
#: Formats that each encoder takes as they are; another source is converted to the first of its depth.
_PLAIN, _DEEP = ("yuv420p", "yuv422p", "yuv444p"), ("yuv420p10le", "yuv422p10le", "yuv444p10le")
_TAGS = ("colorspace", "color_range", "color_primaries", "color_trc")
#: BT.709, limited range: the tags of a video that is made of stills.
_STILLS_TAGS = (1, 1, 1, 1)


class VideoWriter:
    """A context manager. Sound packets of the source are copied, not encoded again.

    source : the video that the pictures are frames of; every sample that a picture does not change is the source's own.
    codec : one of CODECS; None takes H.264, and HEVC for a source of more than 8 bits.
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
        import av

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

    def write(self, picture: NDArray[np.uint8], time_s: float, index: int = 0) -> None:
        """Add an upright (h, w, 3) RGB picture that is shown from `time_s` on; index : of the source's frame."""
        if self._first_s is None:
            self._first, self._first_s = index, time_s if index else 0.0  # a range of frames begins at 0
        frame = self._frame(picture, index)
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

    def _frame(self, picture: NDArray[np.uint8], index: int) -> Any:
        """PyAV's frame of a picture (h, w, 3): the source's with what changed, or one of BT.709."""
        import av

        stored = np.ascontiguousarray(np.rot90(picture, self._turned // 90))
        for number, frame, upright in self._frames or ():
            if number == index:
                return changed_frame(frame, np.rot90(upright, self._turned // 90), stored)
        stored = stored[: stored.shape[0] // 2 * 2, : stored.shape[1] // 2 * 2]  # 4:2:0 needs even sides
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(stored), format="rgb24")
        frame = frame.reformat(format="yuv420p", dst_colorspace="ITU709")
        for tag, value in zip(_TAGS, _STILLS_TAGS, strict=True):
            setattr(frame, tag, value)
        return frame

    def _open(self, frame: Any) -> None:
        import av

        deep = frame.format.name.endswith(("10le", "12le"))
        encoder, options, only = CODECS[self._codec or ("hevc" if deep else "h264")]
        rate = Fraction(0.0 if self._video is None else self._video.rate).limit_denominator(MOST_PARTS)
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
        """Copy the packets of sound that belong to the frames that were written."""
        import av

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

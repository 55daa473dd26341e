"""A video file by PyAV: presentation times, sound and rotation of the source are kept."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["VideoWriter"]

#: Time base of the pictures: a multiple of all usual rates.
TIME_BASE = Fraction(1, 90_000)
#: x264's constant quality: no loss that one sees, a few Mbit/s.
QUALITY = 17
_FORMATS = {".mkv": "matroska", ".webm": "webm", ".mov": "mov", ".avi": "avi"}
_CODECS = {".webm": "libvpx-vp9"}


class VideoWriter:
    """A context manager. Sound packets of the source are copied, not encoded again."""

    def __init__(self, file: Path, suffix: str, source: Path | None = None, turned_deg: int = 0) -> None:
        self._file, self._suffix, self._source, self._turned = file, suffix.lower(), source, turned_deg
        self._container: Any = None
        self._stream: Any = None

    def __enter__(self) -> VideoWriter:
        import av

        self._container = av.open(f"file:{self._file}", "w", format=_FORMATS.get(self._suffix, "mp4"))
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

    def write(self, picture: NDArray[np.uint8], time_s: float) -> None:
        """Add an upright (h, w, 3) RGB picture that is shown from `time_s` on."""
        import av

        stored = np.ascontiguousarray(np.rot90(picture, self._turned // 90))
        stored = stored[: stored.shape[0] // 2 * 2, : stored.shape[1] // 2 * 2]  # 4:2:0 needs even sides
        if self._stream is None:
            self._open(stored.shape[1], stored.shape[0])
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(stored), format="rgb24")
        frame.pts, frame.time_base = round(time_s / TIME_BASE), TIME_BASE
        self._container.mux(self._stream.encode(frame))

    def _open(self, width: int, height: int) -> None:
        import av

        options = {"crf": str(QUALITY), "preset": "fast"}
        stream = self._container.add_stream(_CODECS.get(self._suffix, "libx264"), rate=30, options=options)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.codec_context.time_base = TIME_BASE
        if self._turned:
            stream.set_display_rotation(-self._turned)
        self._stream = stream
        self._sound: Any = None
        if self._source is not None:
            with av.open(f"file:{self._source}", metadata_errors="replace") as source:
                if source.streams.audio:
                    self._sound = self._container.add_stream_from_template(source.streams.audio[0])

    def _copy_sound(self) -> None:
        import av

        if self._sound is None or self._source is None:
            return
        with av.open(f"file:{self._source}", metadata_errors="replace") as source:
            for packet in source.demux(source.streams.audio[0]):
                if packet.dts is not None:
                    packet.stream = self._sound
                    self._container.mux(packet)

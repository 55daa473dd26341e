"""The time code of a part of a video is that of its first frame."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from insertion.footage.video_writer import VideoWriter, time_code_after


@pytest.mark.parametrize(
    ("code", "frames", "rate", "after"),
    [
        ("01:00:00:10", 20, 25.0, "01:00:01:05"),
        ("23:59:59:24", 1, 25.0, "00:00:00:00"),
        ("00:00:59:29", 1, 30000 / 1001, "00:01:00:00"),
        ("00:00:59;29", 1, 30000 / 1001, "00:01:00;02"),
        ("00:09:59;29", 1, 30000 / 1001, "00:10:00;00"),
        ("00:00:59;59", 1, 60000 / 1001, "00:01:00;04"),
        ("00:00:00;00", 107892, 30000 / 1001, "01:00:00;00"),  # an hour of drop frames
        ("00:00:00;00", 138 * 17982 + 1799, 30000 / 1001, "23:00:59;29"),
        ("no time code", 20, 25.0, "no time code"),
        ("01:00:00:10", 20, 0.0, "01:00:00:10"),
    ],
)
def test_a_time_code_counts_frames(code: str, frames: int, rate: float, after: str) -> None:
    assert time_code_after(code, frames, rate) == after


def test_a_range_of_frames_has_the_time_code_of_its_first(tmp_path: Path) -> None:
    import av

    picture = np.zeros((48, 64, 3), np.uint8)
    with av.open(str(tmp_path / "source.mov"), "w") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        stream.metadata["timecode"] = "01:00:00:10"
        for number in range(23):
            frame = av.VideoFrame.from_ndarray(picture + np.uint8(number), format="rgb24")
            frame.pts, frame.time_base = number, Fraction(1, 25)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    with VideoWriter(tmp_path / "out.mov", ".mov", tmp_path / "source.mov") as writer:
        for number in (20, 21, 22):
            writer.write(picture, number / 25, number)
    with av.open(str(tmp_path / "out.mov")) as container:
        stream = container.streams.video[0]
        assert stream.metadata["timecode"] == "01:00:01:05"
        assert float(stream.duration * stream.time_base) == pytest.approx(3 / 25)  # the last frame lasts as long

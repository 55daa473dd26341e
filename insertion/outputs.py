"""Where the pictures go: a folder of PNG files, or a video."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimator.capture.video import VIDEO_SUFFIXES
from insertion.scene.footage import Shot
from metric_base.faults import InputFault
from metric_base.files import whole_file, whole_folder

__all__ = ["output_kind", "picture_writer"]

Picture = NDArray[np.uint8]
Writer = Callable[[Shot, Picture], None]
#: Rate of a video made from stills, which have no times.
STILLS_RATE = 6.0


def output_kind(out: Path) -> str:
    """`video` or `folder`. Raises InputFault for a place that cannot be written, before any work is done."""
    if out.suffix.lower() in VIDEO_SUFFIXES:
        if not out.absolute().parent.is_dir():
            raise InputFault(f"--out: expected a file in an existing folder; found no folder {out.parent}")
        return "video"
    if out.suffix:
        kinds = ", ".join(sorted(VIDEO_SUFFIXES))
        raise InputFault(f"--out: expected a folder or a video ({kinds}); found {out.name!r}")
    if out.exists():
        raise InputFault(f"--out: expected a folder that is not there yet; found {out}")
    return "folder"


@contextmanager
def picture_writer(out: Path, source: Path | None = None, turned_deg: int = 0) -> Iterator[Writer]:
    """A function that writes one picture after another; `out` appears when all are written.

    source : the video whose sound is kept; turned_deg : the clockwise rotation its player applies, kept as well.
    """
    if output_kind(out) == "folder":
        with whole_folder(out, "--out") as folder:
            yield lambda shot, picture: _write_png(folder, shot, picture)
        return
    from insertion.video.writer import VideoWriter

    with whole_file(out, "--out") as file, VideoWriter(file, out.suffix, source, turned_deg) as video:

        def write(shot: Shot, picture: Picture) -> None:
            video.write(picture, shot.index / STILLS_RATE if shot.time_s is None else shot.time_s)

        yield write


def _write_png(folder: Path, shot: Shot, picture: Picture) -> None:
    import cv2

    file = (folder / shot.name).with_suffix(".png")
    file.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(file), picture[..., ::-1])

"""Where the pictures go: a folder of PNG files, or a video."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture.sources.video import VIDEO_SUFFIXES
from insertion.footage.footage import Shot
from metric_base.errors import InputError
from metric_base.files import OutputNames, output_file, whole_file, whole_folder
from metric_base.images import write_picture

Picture = NDArray[np.uint8]
Writer = Callable[[Shot, Picture], None]
#: What a preview may be written as.
PREVIEWS = (".png", ".jpg", ".jpeg", ".webp")


def output_kind(out: Path) -> str:
    """`video` or `folder`. Raises InputError for a place that cannot be written, before any work is done."""
    if out.suffix.lower() in VIDEO_SUFFIXES:
        if not out.absolute().parent.is_dir():
            raise InputError(f"--out: expected a file in an existing folder; found no folder {out.parent}")
        return "video"
    if out.suffix:
        kinds = ", ".join(sorted(VIDEO_SUFFIXES))
        raise InputError(f"--out: expected a folder or a video ({kinds}); found {out.name!r}")
    if out.exists():
        raise InputError(f"--out: expected a folder that is not there yet; found {out}")
    return "folder"


def preview_place(file: Path) -> None:
    """InputError for a place that no picture can be written to, before any work is done."""
    if file.suffix.lower() not in PREVIEWS:
        raise InputError(f"--preview: expected a picture ({', '.join(PREVIEWS)}); found {file.name!r}")
    output_file(file, "--preview")


@contextmanager
def picture_writer(
    out: Path, source: Path | None = None, turned_deg: int = 0, codec: str | None = None
) -> Iterator[Writer]:
    """A function that writes one picture after another; `out` appears when all are written.

    source : the video whose sound and colours are kept; turned_deg : the clockwise rotation its player applies, kept as
    well; codec : what `--codec` names, for a video.
    """
    if output_kind(out) == "folder":
        with whole_folder(out, "--out") as folder:
            names = OutputNames(folder)

            def write_png(shot: Shot, picture: Picture) -> None:
                stem = shot.name.removesuffix(Path(shot.name).suffix)
                write_picture(names.path(f"{stem}.png"), picture[..., ::-1])

            yield write_png
        return
    from insertion.footage.video_writer import VideoWriter

    with whole_file(out, "--out") as file, VideoWriter(file, out.suffix, source, turned_deg, codec) as video:

        def write(shot: Shot, picture: Picture) -> None:
            video.write(picture, shot.clock_s, shot.index)

        yield write

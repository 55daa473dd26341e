"""Output of an insertion: a folder of PNG files, or a video."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from capture.sources.video import VIDEO_SUFFIXES
from insertion.colour import Image
from insertion.footage.footage import Frame
from metric_base.errors import InputError
from metric_base.files import OutputNames, check_folder, output_file, whole_file, whole_folder
from metric_base.images import write_image

Writer = Callable[[Frame, Image], None]
#: File suffixes of a preview.
PREVIEWS = (".png", ".jpg", ".jpeg", ".webp")
#: Suffix of the frames in a folder.
FRAME_SUFFIX = ".png"


def output_kind(out: Path) -> str:
    """Return `video` or `folder`. Raises InputError for a path that cannot be written."""
    if out.suffix.lower() in VIDEO_SUFFIXES:
        if not out.absolute().parent.is_dir():
            raise InputError(f"--out: expected a file in an existing folder; found no folder {out.parent}")
        return "video"
    if out.suffix:
        kinds = ", ".join(sorted(VIDEO_SUFFIXES))
        raise InputError(f"--out: expected a folder or a video ({kinds}); found {out.name!r}")
    check_folder(out, "--out", FRAME_SUFFIX)
    return "folder"


def check_preview_path(file: Path) -> None:
    """Raise InputError for a path that no image can be written to."""
    if file.suffix.lower() not in PREVIEWS:
        raise InputError(f"--preview: expected an image file ({', '.join(PREVIEWS)}); found {file.name!r}")
    output_file(file, "--preview")


@contextmanager
def frame_writer(
    out: Path, source: Path | None = None, turned_deg: int = 0, codec: str | None = None
) -> Iterator[Writer]:
    """Yield a function that writes one frame after another. `out` appears when all are written.

    Parameters
    ----------
    out : Path
        A video, or a new folder.
    source : Path, optional
        Video whose sound and colour encoding are kept.
    turned_deg : int
        Clockwise rotation that the container of the source requests; the output requests it too.
    codec : str, optional
        Key of `insertion.footage.video_writer.CODECS`, for a video.
    """
    if output_kind(out) == "folder":
        with whole_folder(out, "--out", FRAME_SUFFIX) as folder:
            names = OutputNames(folder)

            def write_png(frame: Frame, image: Image) -> None:
                stem = frame.name.removesuffix(Path(frame.name).suffix)
                write_image(names.path(f"{stem}{FRAME_SUFFIX}"), image[..., ::-1])

            yield write_png
        return
    from insertion.footage.video_writer import VideoWriter

    with whole_file(out, "--out") as file, VideoWriter(file, out.suffix, source, turned_deg, codec) as video:

        def write_frame(frame: Frame, image: Image) -> None:
            video.write(image, frame.clock_s, frame.index)

        yield write_frame

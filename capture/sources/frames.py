"""Choose the frames to reconstruct from and write them upright to `frames/`, with `frames.json` about them."""

from __future__ import annotations

import itertools
import json
import shutil
from pathlib import Path

import msgspec
import numpy as np

from capture.sources.frame_selection import chosen_frames, edge_sharpness, motion_of
from capture.sources.image_folder import ImageFolder, foreign_files, image_files
from capture.sources.video import VIDEO_SUFFIXES, Video, VideoFrame
from metric_base.arrays import FloatArray, grouped
from metric_base.errors import InputError, Unquoted
from metric_base.images import IMAGE_SUFFIXES, write_image
from metric_base.input_files import read_json
from metric_base.progress import ProgressCallback, silent, with_progress

FRAMES_FILE = "frames.json"
SCHEMA = "metric-tree/frames/1"
#: Maximum longer side in pixels of a frame that is written; larger ones are reduced.
MAX_SIDE = 1920
JPEG_QUALITY = 95
#: Minimum fraction of the stated frames that are read of an undamaged video; many containers state only a duration.
MIN_READ_FRACTION = 0.9
#: Folders of images in folders of other programs without a reconstruction: COLMAP, 3D Gaussian splatting, Polycam.
IMAGE_SUBFOLDERS = ("images", "input", "keyframes/corrected_images", "keyframes/images")
#: Minimum number of images that make a folder a capture.
MIN_IMAGES = 2

Source = Video | ImageFolder


class ChosenFrame(msgspec.Struct):
    """A frame in `frames/`."""

    index: int  #: Number in the source, from 0.
    name: str  #: File in `frames/`.
    time_s: float | None  #: Presentation time; None for images.
    width: int  #: Of the file, in pixels.
    height: int
    focal_px: float | None  #: Focal length by EXIF or the container, in pixels of the file.
    edges: tuple[float | None, float | None]  #: `edge_sharpness`.


class Frames(msgspec.Struct, kw_only=True):
    """Content of `frames.json`."""

    schema: str = SCHEMA
    source: str  #: Absolute path of the video or folder.
    size: tuple[int, int]  #: Width and height of the upright source, in pixels.
    turned_deg: int  #: Clockwise rotation that the container requests and that is applied.
    hdr: str | None  #: Transfer curve of an HDR video.
    remarks: list[str]  #: Parts of the source that are not used.
    fisheye_deg: float | None = None  #: Field of view from corner to corner of an uncorrected wide lens.
    times_s: list[float] | None  #: Presentation times of all frames of a video.
    chosen: list[ChosenFrame]

    @property
    def names(self) -> list[str]:
        """Files of the chosen frames."""
        return [frame.name for frame in self.chosen]

    @property
    def edges(self) -> FloatArray:
        """(n, 2) `edge_sharpness` of the chosen frames, NaN without edges."""
        return np.array([frame.edges for frame in self.chosen], dtype=np.float64)

    @property
    def file_size(self) -> tuple[int, int]:
        """Width and height of the first chosen frame, in pixels."""
        return self.chosen[0].width, self.chosen[0].height

    def cameras(self) -> dict[tuple[int, int, float | None], list[str]]:
        """Return the names of the chosen frames by width, height and focal length, which identify a camera."""
        return grouped(((frame.width, frame.height, frame.focal_px), frame.name) for frame in self.chosen)

    @property
    def one_camera(self) -> bool:
        """Whether all chosen frames are from one camera."""
        return len(self.cameras()) == 1


def is_capture(path: Path) -> bool:
    """Return whether a path is a video or a folder of images, and no reconstruction."""
    if not path.is_dir():
        return path.suffix.lower() in VIDEO_SUFFIXES
    return not _is_reconstruction(path) and len(image_files(path)) + len(foreign_files(path)) >= MIN_IMAGES


def capture_folder(path: Path) -> Path:
    """Return the folder of images in the folder of another program that has no reconstruction; else the path itself."""
    if not path.is_dir() or _is_reconstruction(path) or is_capture(path):
        return path
    return next((path / name for name in IMAGE_SUBFOLDERS if (path / name).is_dir() and is_capture(path / name)), path)


def _is_reconstruction(path: Path) -> bool:
    """Return whether a folder contains a reconstruction, or is a work folder."""
    from estimator.reconstructions.colmap import colmap_folder
    from estimator.scene_formats.detection import export_file

    is_known = colmap_folder(path) is not None or export_file(path) is not None
    return is_known or (path / "reconstruction.json").is_file() or (path / FRAMES_FILE).is_file()


def source_of(path: Path) -> Source:
    """Open the video or the folder of images; raises InputError if it cannot be read."""
    return ImageFolder(path) if path.is_dir() else Video(path)


def make_frames(part: Path, source: Source, wanted: int | None, progress: ProgressCallback = silent) -> None:
    """Write `frames/` and `frames.json` to a folder.

    Parameters
    ----------
    part : Path
        Existing folder.
    source : Video or ImageFolder
    wanted : int or None
        Number of frames, by default as many as the motion requires.
    progress : callable
        Called with the step, the number of frames read and their total.

    Raises
    ------
    InputError
        No frame can be decoded.
    """
    remarks, times_s = [], None
    if isinstance(source, Video):
        frames = with_progress(source.frames(), "reading the video", progress, source.n_frames or None)
        motion = motion_of((frame.time_s, frame.colour) for frame in frames)
        n, times_s = len(motion.step), motion.times_s.tolist()
        if not n:
            raise InputError.at(source.path, "video", "at least one frame that can be decoded", Unquoted("none"))
        indices = chosen_frames(motion, wanted)
        if n < MIN_READ_FRACTION * source.n_frames:
            stated = f"the file states {source.n_frames} frames, and {n} could be read"
            remarks.append(f"{stated}: the others are damaged or missing")
    else:
        n = source.n_frames
        indices = np.unique(np.linspace(0, n - 1, min(wanted or n, n)).astype(np.int64))
        unread = foreign_files(source.path)
        if unread:
            names = ", ".join([*unread[:3], *(["..."] if len(unread) > 3 else [])])
            remarks.append(f"not used: {names}; convert to JPEG")
    (part / "frames").mkdir()
    read = with_progress(itertools.islice(source.frames(), int(indices[-1]) + 1), "writing frames", progress, n)
    chosen = [write_frame(part / "frames", frame, source) for frame in read if frame.index in indices]
    document = Frames(
        source=str(source.path.resolve()),
        size=(source.width, source.height),
        turned_deg=source.turned_deg,
        hdr=source.hdr,
        remarks=remarks,
        fisheye_deg=source.fisheye_deg if isinstance(source, Video) else None,
        times_s=times_s,
        chosen=chosen,
    )
    text = json.dumps(msgspec.to_builtins(document), allow_nan=False)
    (part / FRAMES_FILE).write_text(text + "\n", encoding="utf-8")


def read_frames(folder: Path) -> Frames:
    """Return the content of `frames.json` in a work folder."""
    return msgspec.convert(read_json(folder / FRAMES_FILE), Frames)


def write_frame(folder: Path, frame: VideoFrame, source: Source) -> ChosenFrame:
    """Write a frame, reduced to MAX_SIDE; an upright JPEG is copied with its EXIF, which COLMAP reads."""
    import cv2

    colour = frame.colour
    factor = min(MAX_SIDE / max(colour.shape[:2]), 1.0)
    if factor < 1:
        size = (round(colour.shape[1] * factor), round(colour.shape[0] * factor))
        colour = np.asarray(cv2.resize(colour, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    if isinstance(source, ImageFolder):
        file, time_s, focal_px = source.files[frame.index], None, source.focals_px[frame.index]
        name, is_copied = file.name, factor == 1 and source.is_plain_jpeg[frame.index]
    else:
        file, time_s, focal_px = source.path, frame.time_s, source.focal_px
        name, is_copied = f"{frame.index:06d}.jpg", False
    assert Path(name).suffix.lower() in IMAGE_SUFFIXES
    if is_copied:
        shutil.copyfile(file, folder / name)
    else:
        write_image(folder / name, colour[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    low, high = (None if np.isnan(value) else value for value in edge_sharpness(colour))
    focal_px = None if focal_px is None else focal_px * factor
    return ChosenFrame(frame.index, name, time_s, colour.shape[1], colour.shape[0], focal_px, (low, high))

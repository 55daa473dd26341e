"""The frames stage: which frames of the source are used, written upright to `frames/`, and when each was shown."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture.sources.frame_selection import Motion, chosen_frames, motion_of
from capture.sources.image_folder import PICTURE_SUFFIXES, PictureFolder, foreign_files, picture_files
from capture.sources.video import VIDEO_SUFFIXES, Video, VideoFrame
from metric_base.arrays import FloatArray
from metric_base.errors import InputError, Unquoted
from metric_base.images import write_picture
from metric_base.input_files import read_json
from metric_base.progress import ProgressCallback, silent

FRAMES_FILE = "frames.json"
SCHEMA = "metric-tree/frames/1"
#: Longer side of the frames that are kept; features are looked for at half of it.
MAX_SIDE = 1920
JPEG_QUALITY = 95
#: Share of a video's frames that is read of a whole file; many state their number by duration and rate alone.
READ_SHARE = 0.9
#: Fewest pictures that make a folder one of pictures.
LEAST_PICTURES = 2

Source = Video | PictureFolder


#: Longer side in pixels at which edges are looked at.
SIDE = 640
#: An edge is a step of at least so many grey levels within a window of so many pixels.
LEAST_STEP, WINDOW = 24, 13
#: Directions that edges are sorted into, and the fewest edges that say something of a direction.
DIRECTIONS, LEAST_EDGES = 4, 30


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """What the stage wrote.

    names, indices : file in `frames/` and number in the source of each chosen frame; times_s : of all frames of the
    source, None for pictures; edges : (n, 2) `edge_sharpness` of the chosen frames; sizes : (width, height) of each in
    `frames/`; focals_px : what EXIF, or the video, states of each, in pixels of `frames/`; source_size : of the
    source, upright; remarks : what of the source is not used; fisheye_deg : the field of view from corner to corner
    that the video states of an uncorrected wide lens.
    """

    names: list[str]
    indices: list[int]
    times_s: list[float] | None
    edges: FloatArray
    sizes: list[tuple[int, int]]
    focals_px: list[float | None]
    source_size: tuple[int, int]
    turned_deg: int
    hdr: str | None
    remarks: list[str]
    fisheye_deg: float | None = None

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the first chosen frame."""
        return self.sizes[0]

    def cameras(self) -> dict[tuple[int, int, float | None], list[str]]:
        """The chosen frames by camera: those of one size and one stated focal length share it."""
        groups: dict[tuple[int, int, float | None], list[str]] = {}
        for name, (width, height), focal in zip(self.names, self.sizes, self.focals_px, strict=True):
            groups.setdefault((width, height, focal), []).append(name)
        return groups

    @property
    def one_camera(self) -> bool:
        """Whether all chosen frames share a camera."""
        return len(self.cameras()) == 1


def is_capture(path: Path) -> bool:
    """Whether a path is a video or a folder of pictures, rather than a reconstruction."""
    if path.is_file():
        return path.suffix.lower() in VIDEO_SUFFIXES
    if not path.is_dir():
        return path.suffix.lower() in VIDEO_SUFFIXES
    from estimator.reconstructions.colmap import colmap_folder

    if colmap_folder(path) is not None or (path / "reconstruction.json").is_file() or (path / FRAMES_FILE).is_file():
        return False
    from estimator.scene_formats.detection import export_file

    pictures = len(picture_files(path)) + len(foreign_files(path))
    return export_file(path) is None and pictures >= LEAST_PICTURES


def source_of(path: Path) -> Source:
    """The video or the folder of pictures.

    Raises
    ------
    InputError
        It cannot be read.
    """
    return PictureFolder(path) if path.is_dir() else Video(path)


def make_frames(
    part: Path, source: Source, wanted: int | None, progress: ProgressCallback = silent, times: int = 1
) -> None:
    """`frames/` and `frames.json` in the part folder; wanted, times : as `chosen_frames` takes them."""
    (part / "frames").mkdir()
    motion = _motion(source, progress) if isinstance(source, Video) else None
    n = len(motion.step) if motion is not None else source.n_frames
    chosen = chosen_frames(motion, wanted, times) if motion is not None else _even(n, wanted)
    rows = []
    for frame in source.frames():
        progress("writing frames", frame.index + 1, n)
        if frame.index in set(chosen.tolist()):
            rows.append(_write_frame(part / "frames", frame, source))
    document = {
        "schema": SCHEMA,
        "source": str(source.path.resolve()),
        "size": [source.width, source.height],
        "turned_deg": source.turned_deg,
        "hdr": source.hdr,
        "remarks": _remarks(source, n),
        "fisheye_deg": source.fisheye_deg if isinstance(source, Video) else None,
        "times_s": None if motion is None else motion.times_s.tolist(),
        "chosen": rows,
    }
    (part / FRAMES_FILE).write_text(json.dumps(document, allow_nan=False) + "\n", encoding="utf-8")


def read_frames(folder: Path) -> Frames:
    """What `make_frames` wrote."""
    document: dict[str, Any] = read_json(folder / FRAMES_FILE)
    rows = document["chosen"]
    return Frames(
        [row["name"] for row in rows],
        [row["index"] for row in rows],
        document["times_s"],
        np.array([row["edges"] for row in rows], dtype=np.float64),
        [(row["width"], row["height"]) for row in rows],
        [row["focal_px"] for row in rows],
        (document["size"][0], document["size"][1]),
        document["turned_deg"],
        document["hdr"],
        document["remarks"],
        document.get("fisheye_deg"),
    )


def _motion(video: Video, progress: ProgressCallback) -> Motion:
    def pictures() -> Iterator[tuple[float, NDArray[np.uint8]]]:
        for frame in video.frames():
            progress("reading the video", frame.index + 1, video.n_frames or None)
            yield frame.time_s, frame.colour

    motion = motion_of(pictures())
    if not len(motion.step):
        raise InputError.at(video.path, "video", "at least one frame that can be decoded", Unquoted("none"))
    return motion


def _remarks(source: Source, n: int) -> list[str]:
    """What of the source is not used, where n frames of it could be read."""
    if isinstance(source, Video):
        if n >= READ_SHARE * source.n_frames:
            return []
        return [f"the file states {source.n_frames} frames, and {n} could be read: the others are damaged or missing"]
    left_out = foreign_files(source.path)
    names = ", ".join([*left_out[:3], *(["..."] if len(left_out) > 3 else [])])
    return [f"not used: {names}; convert to JPEG"] if left_out else []


def _even(n: int, wanted: int | None) -> NDArray[np.int64]:
    """(k,) numbers of at most `wanted` of n frames, evenly spaced."""
    return np.unique(np.linspace(0, n - 1, min(wanted or n, n)).astype(np.int64))


def _write_frame(folder: Path, frame: VideoFrame, source: Source) -> dict[str, Any]:
    """Write one frame, not larger than MAX_SIDE, and describe it."""
    import cv2

    colour = frame.colour
    factor = MAX_SIDE / max(colour.shape[:2])
    if factor < 1:
        size = (round(colour.shape[1] * factor), round(colour.shape[0] * factor))
        colour = np.asarray(cv2.resize(colour, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    name = source.name_of(frame.index) if isinstance(source, PictureFolder) else f"{frame.index:06d}.jpg"
    file = folder / name
    assert file.suffix.lower() in PICTURE_SUFFIXES
    if isinstance(source, PictureFolder) and factor >= 1 and source.is_plain_jpeg[frame.index]:
        shutil.copyfile(source.files[frame.index], file)  # with its EXIF, which COLMAP reads
    else:
        write_picture(file, colour[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    stated = source.focals_px[frame.index] if isinstance(source, PictureFolder) else source.focal_px
    return {
        "index": frame.index,
        "name": name,
        "time_s": None if isinstance(source, PictureFolder) else frame.time_s,
        "width": colour.shape[1],
        "height": colour.shape[0],
        "focal_px": None if stated is None else stated * min(factor, 1.0),
        "edges": [None if np.isnan(value) else value for value in edge_sharpness(colour)],
    }


def edge_sharpness(colour: NDArray[np.uint8]) -> tuple[float, float]:
    """Steepness of the edges in the least and the most steep of four directions; NaN without edges.

    colour : (h, w, 3) red, green, blue.

    The steepness of an edge is its slope per pixel over the step of grey levels about it: about 0.35 for an ideal
    edge, 0.2 in a sharp textured picture, 0.1 where it is smeared over ten pixels. A smear leaves edges along its
    own direction alone, hence the directions.
    """
    import cv2

    grey = cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY)
    factor = min(1.0, SIDE / max(grey.shape))
    if factor < 1:
        grey = cv2.resize(grey, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    smooth = cv2.GaussianBlur(grey, (0, 0), 0.8).astype(np.float32)  # the sensor's noise is no edge
    along_x = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3) / 8
    along_y = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3) / 8
    slope = np.hypot(along_x, along_y)
    window = np.ones((WINDOW, WINDOW), np.uint8)
    step = cv2.dilate(smooth, window) - cv2.erode(smooth, window)
    edges = (slope >= cv2.dilate(slope, np.ones((3, 3), np.uint8))) & (step > LEAST_STEP)
    steepness = slope[edges] / step[edges]
    angle = np.mod(np.arctan2(along_y[edges], along_x[edges]), np.pi)
    direction = np.rint(angle / np.pi * DIRECTIONS).astype(np.int64) % DIRECTIONS
    groups = [steepness[direction == number] for number in range(DIRECTIONS)]
    values = [float(np.quantile(group, 0.75)) for group in groups if len(group) >= LEAST_EDGES]
    return (min(values), max(values)) if values else (float("nan"), float("nan"))

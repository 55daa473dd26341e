"""Input frames of an insertion with pose and time (`Footage`), and the images of the reconstruction (`SceneImages`)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from capture.frame_poses import FILE_NAME, FramePoses, read_frame_poses
from capture.sources.video import VIDEO_SUFFIXES, Video
from estimator.reconstructions.image_files import image_file, image_folders
from estimator.records.scene import Scene, View
from insertion.colour import Image
from metric_base.errors import InputError
from metric_base.images import read_image

#: Frame rate of images without times, in frames per second: for animated objects and for a video made of images.
IMAGE_SEQUENCE_RATE = 6.0
#: Maximum size of the decoded images that are kept: cloud, light and motion blur read the same images.
MAX_DECODED_BYTES = 1 << 28


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One frame of the footage."""

    index: int  #: from 0
    name: str  #: file name
    time_s: float | None  #: presentation time; None for images without times
    view: View | None  #: camera and pose; None if the pose is not known
    row: int | None  #: index in `Scene.views`; None if the frame was not reconstructed

    @property
    def clock_s(self) -> float:
        """Presentation time in seconds, that of a sequence at `IMAGE_SEQUENCE_RATE` for images without times."""
        return self.index / IMAGE_SEQUENCE_RATE if self.time_s is None else self.time_s


class Footage(ABC):
    """Frames in order of time. Iteration yields each frame with its image, decoded one at a time."""

    frames: tuple[Frame, ...]

    @abstractmethod
    def __iter__(self) -> Iterator[tuple[Frame, Image]]:
        """Yield every frame with its upright image (h, w, 3)."""

    @property
    def start_s(self) -> float:
        """Presentation time of the first frame of the complete footage."""
        return self.frames[0].clock_s if self.frames else 0.0

    def between(self, first: int, last: int) -> FrameRange:
        """Return the frames with an index from `first` to `last`. Raises InputError if there are none."""
        part = FrameRange(self, first, last)
        if not part.frames:
            end = len(self.frames) - 1
            raise InputError(f"--frames: expected numbers from 0 to {end}; found {first}:{last}")
        return part


class FrameRange(Footage):
    """A range of the frames of other footage."""

    def __init__(self, complete: Footage, first: int, last: int) -> None:
        self._complete = complete
        self.frames = tuple(frame for frame in complete.frames if first <= frame.index <= last)

    @property
    def start_s(self) -> float:
        """Presentation time of the first frame of the complete footage: animations do not depend on the range."""
        return self._complete.start_s

    def __iter__(self) -> Iterator[tuple[Frame, Image]]:
        """Yield every frame of the range with its image (h, w, 3)."""
        for frame, image in self._complete:
            if frame.index > self.frames[-1].index:
                return
            if frame.index >= self.frames[0].index:
                yield frame, image


class SceneImages:
    """Images of the views of a reconstruction, read on demand; the first `MAX_DECODED_BYTES` are kept.

    Attributes
    ----------
    scene : Scene
        The reconstruction.
    rows : tuple of int
        Indices of the views that have an image.

    Raises
    ------
    InputError
        No view has an image.
    """

    def __init__(self, scene: Scene, folder: Path | None = None) -> None:
        self.scene = scene
        folders = image_folders(scene) if folder is None else (folder.resolve(),)
        self._files = [image_file(folders, view) for view in scene.views]
        self._decoded: dict[int, Image] = {}
        self.rows = tuple(row for row, file in enumerate(self._files) if file is not None)
        if not self.rows:
            found = ", ".join(str(folder) for folder in folders) or "no folder `images` next to or above the model"
            raise InputError(
                f"{scene.path}: images: expected the images of its views (--images DIR); found none in {found}"
            )

    def image(self, row: int) -> Image:
        """Return the image (h, w, 3) of a view. Raises InputError if it cannot be decoded or has another size."""
        import cv2

        if row in self._decoded:
            return self._decoded[row]
        file, camera = self._files[row], self.scene.views[row].camera
        pixels = None if file is None else read_image(file, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        if pixels is None:
            raise InputError(f"{file}: not an image that OpenCV can decode")
        if pixels.shape[:2] != (camera.height, camera.width):
            size = f"{pixels.shape[1]} x {pixels.shape[0]}"
            raise InputError(f"{file}: size: expected {camera.width} x {camera.height}, as its camera; found {size}")
        image = np.ascontiguousarray(pixels[..., ::-1])
        image.flags.writeable = False  # callers share it
        if image.nbytes * (len(self._decoded) + 1) <= MAX_DECODED_BYTES:
            self._decoded[row] = image
        return image


class ImageSequence(Footage):
    """The images of a reconstruction as footage, in the order of their names."""

    def __init__(self, images: SceneImages) -> None:
        views = images.scene.views
        rows = sorted(images.rows, key=lambda row: views[row].name)
        self._images = images
        self.frames = tuple(Frame(index, views[row].name, None, views[row], row) for index, row in enumerate(rows))

    def __iter__(self) -> Iterator[tuple[Frame, Image]]:
        """Yield every frame with its image (h, w, 3)."""
        for frame in self.frames:
            assert frame.row is not None  # every frame is a view of the reconstruction
            yield frame, self._images.image(frame.row)


class VideoFootage(Footage):
    """Frames of a video.

    Attributes
    ----------
    source : Path
        The video.
    turned_deg : int
        Clockwise rotation that its container requests, applied to the frames.
    """

    def __init__(self, video: Video, poses: FramePoses, scene: Scene) -> None:
        self._video = video
        self.source, self.turned_deg = video.path, video.turned_deg
        rows = {Path(view.name).stem: row for row, view in enumerate(scene.views)}
        frames = []
        for pose in poses.frames:
            name, view = f"{pose.index:06d}.png", None
            if pose.rotation is not None and pose.translation is not None and poses.camera is not None:
                no_points = np.empty((0, 2)), np.empty(0, dtype=np.int64)
                view = View(name, poses.camera, pose.rotation, pose.translation, *no_points)
            row = None if pose.name is None else rows.get(Path(pose.name).stem)
            frames.append(Frame(pose.index, name, pose.time_s, view, row))
        self.frames = tuple(frames)

    def __iter__(self) -> Iterator[tuple[Frame, Image]]:
        """Yield every frame with its upright image (h, w, 3)."""
        frames = {frame.index: frame for frame in self.frames}
        for decoded in self._video.frames():
            if decoded.index in frames:
                yield frames[decoded.index], decoded.colour


def video_footage(work: Path, scene: Scene) -> VideoFootage | None:
    """Return the footage of a work folder made from a video; None for another folder.

    Raises
    ------
    InputError
        The video does not exist any more.
    """
    if not (work / FILE_NAME).is_file():
        return None
    poses = read_frame_poses(work)
    if poses.source.suffix.lower() not in VIDEO_SUFFIXES:
        return None
    if not poses.source.is_file():
        raise InputError(f"{work / FILE_NAME}: source: expected the video {poses.source}; the file does not exist")
    return VideoFootage(Video(poses.source), poses, scene)

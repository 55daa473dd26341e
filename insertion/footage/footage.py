"""The pictures that are drawn on, each with its pose and time; and the stills that the reconstruction was made of.

A video with the pose of every frame, as a work folder of `estimate-scale VIDEO` keeps it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from capture.frame_poses import FILE_NAME, FramePose, FramePoses, read_frame_poses
from capture.sources.video import VIDEO_SUFFIXES, Video
from estimator.instances.view_matching import image_file, image_folders
from estimator.records.scene import Camera, Scene, View
from metric_base.errors import InputError
from metric_base.images import read_picture

Picture = NDArray[np.uint8]
#: Pictures without times count as so many a second, in a video that is made of them and for what moves.
STILLS_RATE = 6.0


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """One picture of the output.

    index : its number, from 0; name : the picture's file name; time_s : presentation time, None for stills; view : its
    camera and pose, None where none is known; row : its row in `Scene.views`, None if it was not reconstructed.
    """

    index: int
    name: str
    time_s: float | None
    view: View | None
    row: int | None

    @property
    def clock_s(self) -> float:
        """When the picture is shown, seconds."""
        return self.index / STILLS_RATE if self.time_s is None else self.time_s


class Footage(Protocol):
    """What is drawn on, in order."""

    @property
    def shots(self) -> tuple[Shot, ...]:
        """All pictures in order."""
        ...

    def pictures(self) -> Iterator[tuple[Shot, Picture]]:
        """Every shot with its (h, w, 3) uint8 RGB picture, upright; one at a time."""
        ...


class Stills:
    """The pictures of a reconstruction's own views, read when they are asked for."""

    def __init__(self, scene: Scene, folder: Path | None = None) -> None:
        self.scene = scene
        folders = image_folders(scene) if folder is None else (folder.resolve(),)
        self._files = [image_file(folders, view) for view in scene.views]
        self.rows = tuple(row for row, file in enumerate(self._files) if file is not None)
        if not self.rows:
            places = ", ".join(str(place) for place in folders) or "no folder `images` beside or above the model"
            raise InputError(
                f"{scene.path}: pictures: expected the pictures of its views (--images DIR); found none in {places}"
            )

    def picture(self, row: int) -> Picture:
        """(h, w, 3) uint8 RGB of a view. Raises InputError for a file that is no picture or has another shape."""
        import cv2

        file, camera = self._files[row], self.scene.views[row].camera
        pixels = None if file is None else read_picture(file, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        if pixels is None:
            raise InputError(f"{file}: picture: expected one that OpenCV reads; found none")
        if pixels.shape[:2] != (camera.height, camera.width):
            size = f"{pixels.shape[1]} x {pixels.shape[0]}"
            raise InputError(f"{file}: size: expected {camera.width} x {camera.height}, as its camera; found {size}")
        return np.ascontiguousarray(pixels[..., ::-1])


class PictureFootage:
    """A scene whose own pictures are drawn on, in the order of their names."""

    def __init__(self, stills: Stills) -> None:
        views = stills.scene.views
        rows = sorted(stills.rows, key=lambda row: views[row].name)
        self._stills = stills
        self.shots: tuple[Shot, ...] = tuple(
            Shot(index, views[row].name, None, views[row], row) for index, row in enumerate(rows)
        )

    def pictures(self) -> Iterator[tuple[Shot, Picture]]:
        """Every shot with its picture (h, w, 3)."""
        for shot in self.shots:
            assert shot.row is not None  # every shot is a view here
            yield shot, self._stills.picture(shot.row)


class FrameRange:
    """Footage of which only some shots are drawn on; `whole` is all of it."""

    def __init__(self, whole: Footage, first: int, last: int) -> None:
        self.whole = whole
        self.shots: tuple[Shot, ...] = tuple(shot for shot in whole.shots if first <= shot.index <= last)

    def pictures(self) -> Iterator[tuple[Shot, Picture]]:
        """Every shot of the range with its picture (h, w, 3)."""
        for shot, picture in self.whole.pictures():
            if shot.index > self.shots[-1].index:
                return
            if shot.index >= self.shots[0].index:
                yield shot, picture


class VideoFootage:
    """The frames of a video, decoded one at a time.

    source : the video; turned_deg : the clockwise rotation that its container asks for, applied to the frames.
    """

    def __init__(self, video: Video, poses: FramePoses, scene: Scene) -> None:
        self._video = video
        self.source, self.turned_deg = video.path, video.turned_deg
        rows = {Path(view.name).stem: row for row, view in enumerate(scene.views)}
        self.shots: tuple[Shot, ...] = tuple(
            Shot(
                pose.index,
                f"{pose.index:06d}.png",
                pose.time_s,
                _view(pose, poses.camera),
                None if pose.name is None else rows.get(Path(pose.name).stem),
            )
            for pose in poses.frames
        )

    def pictures(self) -> Iterator[tuple[Shot, NDArray[np.uint8]]]:
        """Every shot with its upright picture (h, w, 3)."""
        shots = {shot.index: shot for shot in self.shots}
        for frame in self._video.frames():
            if frame.index in shots:
                yield shots[frame.index], frame.colour


def video_footage(work: Path, scene: Scene) -> VideoFootage | None:
    """The footage of a work folder that was made from a video; None for another folder."""
    if not (work / FILE_NAME).is_file():
        return None
    poses = read_frame_poses(work)
    if poses.source.suffix.lower() not in VIDEO_SUFFIXES:
        return None
    if not poses.source.is_file():
        raise InputError(f"{work / FILE_NAME}: source: expected the video {poses.source}; it is not there any more")
    return VideoFootage(Video(poses.source), poses, scene)


def _view(pose: FramePose, camera: Camera | None) -> View | None:
    if pose.rotation is None or pose.translation is None or camera is None:
        return None
    nothing = np.empty((0, 2)), np.empty(0, dtype=np.int64)
    return View(f"{pose.index:06d}.png", camera, pose.rotation, pose.translation, *nothing)

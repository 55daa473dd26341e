"""A video with the pose of every frame, as a work folder of `estimate-scale VIDEO` keeps it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture.frame_poses import FILE_NAME, FramePose, FramePoses, read_frame_poses
from capture.sources.video import VIDEO_SUFFIXES, Video
from estimator.records.scene import Camera, Scene, View
from insertion.footage.footage import Shot
from metric_base.errors import InputError

__all__ = ["VideoFootage", "video_footage"]


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

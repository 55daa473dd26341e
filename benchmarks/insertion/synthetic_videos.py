"""Synthetic videos for the proof: a room through a lens, with smear, noise, rotation and uneven times."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimator.capture.capture import CaptureOptions, reconstruct
from estimator.capture.frame_poses import FramePoses, read_frame_poses
from estimator.capture.video import Video
from estimator.capture.work_folder import WorkFolder
from metric_base.arrays import BoolArray, FloatArray, IntArray
from tests.synthetic.rooms.furnish import turn_about_z
from tests.synthetic.rooms.kinds import KINDS
from tests.synthetic.rooms.masks import coco_dataset
from tests.synthetic.rooms.similarity import Similarity, similarity_between
from tests.synthetic.rooms.solids import Mesh, rotate
from tests.synthetic.rooms.world import Pinhole, Placed, World
from tests.synthetic.videos import Lens, orbit, recorded, room, times_of, write_video

__all__ = ["CONDITIONS", "Condition", "Standing", "SyntheticVideo", "standing", "synthetic_video", "true_video"]

Picture = NDArray[np.uint8]
#: Degrees of the arc that the camera walks.
ARC_DEG = 60.0


@dataclass(frozen=True, slots=True)
class Condition:
    """How a video is synthetic. turned_deg : the rotation in its container; blur : length of the smear in pixels.

    noise : one sigma in grey levels; hidden : the object stands where furniture hides a part of it.
    """

    name: str
    lens: Lens = field(default_factory=Lens)
    variable: bool = False
    turned_deg: int = 0
    blur: float = 0.0
    noise: float = 2.0
    hidden: bool = False


CONDITIONS = (
    Condition("plain"),
    Condition("barrel lens, k = -0.12", Lens(k=-0.12)),
    Condition("pincushion lens, k = +0.08", Lens(k=0.08)),
    Condition("uneven times, hidden in part", variable=True, hidden=True),
    Condition("upright phone, turned by 90", Lens(480, 640), turned_deg=90),
    Condition("smeared by 5 px", blur=5.0),
)


@dataclass(frozen=True, slots=True, eq=False)
class SyntheticVideo:
    """A video on disk with its truth. ids : the object numbers (h, w) of every frame."""

    world: World
    condition: Condition
    file: Path
    times: FloatArray
    ids: tuple[IntArray, ...]

    def reconstruction(self, folder: Path, frames: int) -> tuple[FramePoses, Similarity]:
        """A work folder as `estimate-scale VIDEO --work` makes it, of so many frames; with the masks of all frames.

        The similarity leads from the room into the reconstruction, by the camera's centres.
        """
        work = WorkFolder(folder)
        with work.lock():
            reconstruct(self.file, work, CaptureOptions(frames=frames))
        names = [f"{index:06d}.jpg" for index in range(len(self.ids))]
        seen = replace(self.world, camera=_pinhole(self.condition.lens))
        (folder / "instances.json").write_text(json.dumps(coco_dataset(seen, self.ids, names)) + "\n")
        poses = read_frame_poses(folder)
        posed = [pose for pose in poses.frames if pose.rotation is not None]
        true = np.array([self.world.poses[pose.index].centre for pose in posed])
        return poses, similarity_between(true, np.array([pose.centre for pose in posed]))


def synthetic_video(kind: str, seed: int, frames: int, condition: Condition, file: Path) -> SyntheticVideo:
    """A room recorded along an arc; the file is written anew."""
    world = room(kind, seed, orbit(KINDS[kind].radius, frames, seed, ARC_DEG))
    times = times_of(frames, 20.0, condition.variable, seed)
    synthetic = list(recorded(world, condition.lens, condition.noise, blur=condition.blur))
    write_video(file, [frame.colour for frame in synthetic], times, condition.turned_deg)
    return SyntheticVideo(world, condition, file, times, tuple(frame.ids for frame in synthetic))


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """The video in which the mesh really stands: pictures as a decoder gives them.

    whole, seen, faces : of every frame the outline without and with what hides it, and the faces' numbers, each (h, w).
    """

    pictures: tuple[Picture, ...]
    whole: tuple[BoolArray, ...]
    seen: tuple[BoolArray, ...]
    faces: tuple[IntArray, ...]


def standing(world: World, mesh: Mesh, position: FloatArray, front: FloatArray) -> World:
    """The room with the mesh at a place (3,) of the room, its front along (3,); it is the last object."""
    yaw = float(np.arctan2(front[1], front[0]) + np.pi / 2)
    placed = rotate(mesh, turn_about_z(yaw), position)
    item = Placed("inserted", "stool", "stool", np.ptp(mesh.vertices, axis=0), placed)
    return replace(world, objects=(*world.objects, item))


def true_video(video: SyntheticVideo, world: World, file: Path) -> Standing:
    """The same video of `world`, which is the video's with one object more."""
    alone = replace(world, objects=_faces(world.objects[-1]))
    number, condition = len(world.objects), video.condition
    synthetic = list(recorded(world, condition.lens, condition.noise, blur=condition.blur))
    write_video(file, [frame.colour for frame in synthetic], video.times, condition.turned_deg)
    faces = tuple(frame.ids for frame in recorded(alone, condition.lens, 0.0))
    whole = tuple(ids > 0 for ids in faces)
    return Standing(pictures_of(file), whole, tuple(frame.ids == number for frame in synthetic), faces)


def _faces(item: Placed) -> tuple[Placed, ...]:
    """Every two triangles of an object as an object of their own: a side of a box."""
    mesh = item.mesh
    rows = range(0, len(mesh.faces), 2)
    return tuple(replace(item, mesh=Mesh(mesh.vertices, mesh.faces[k : k + 2], mesh.material[k : k + 2])) for k in rows)


def pictures_of(file: Path) -> tuple[Picture, ...]:
    """The upright frames of a video."""
    return tuple(frame.colour for frame in Video(file).frames())


def _pinhole(lens: Lens) -> Pinhole:
    return Pinhole(lens.width, lens.height, lens.focal)

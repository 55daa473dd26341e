"""Small, noisy and short videos that are refused, one for each code of a refusal."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from tests.synthetic.rooms.world import Pose, World, pose_towards
from tests.synthetic.videos import Lens, SyntheticFrame, orbit, panning, recorded, room, still, straight_ahead

__all__ = ["FRAMES", "LENS", "RARE_VIDEOS", "REFUSED_VIDEOS", "zoomed"]

LENS = Lens(320, 240, 250.0)
#: Number of frames, two more than the minimum of a reconstruction.
FRAMES = 8


def _walk(kind: str, seed: int, frames: int = FRAMES) -> World:
    return room(kind, seed, orbit(2.0, frames, seed, degrees=40.0))


def _bare_room() -> Iterator[SyntheticFrame]:
    return recorded(replace(_walk("sitting room", 7), objects=()), LENS, texture=0.0)


def _cut_together() -> Iterator[SyntheticFrame]:
    return itertools.chain(recorded(_walk("sitting room", 7), LENS), recorded(_walk("bedroom", 4), LENS))


def zoomed(world: World, increase: float) -> Iterator[SyntheticFrame]:
    """Record the world while the focal length increases by the fraction `increase`."""
    for index, factor in enumerate(np.geomspace(1, 1 + increase, len(world.poses)) / np.sqrt(1 + increase)):
        lens = Lens(LENS.width, LENS.height, LENS.focal * float(factor))
        yield from recorded(replace(world, poses=(world.poses[index],)), lens, seed=index)


def _turning_with_a_step(frames: int, degrees: float, metres: float) -> tuple[Pose, ...]:
    """Return the poses of a camera that rotates while it moves sideways."""
    angles = np.radians(90 + degrees * np.linspace(-0.5, 0.5, frames))
    eyes = np.array([0.1, -1.6, 1.5]) + np.linspace(0, metres, frames)[:, None] * np.array([1.0, 0.0, 0.0])
    ahead = np.column_stack([np.cos(angles), np.sin(angles), np.full(frames, -0.25)])
    return tuple(pose_towards(eye, eye + direction) for eye, direction in zip(eyes, ahead, strict=True))


#: Videos by the code of the refusal.
REFUSED_VIDEOS: dict[str, Callable[[], Iterator[SyntheticFrame]]] = {
    "pure_rotation": lambda: recorded(room("sitting room", 7, panning(FRAMES, 60.0)), LENS),
    "static_camera": lambda: recorded(room("sitting room", 7, still(FRAMES)), LENS),
    "no_texture": _bare_room,
    "too_few_frames": lambda: recorded(_walk("sitting room", 7, 3), LENS),
    "motion_blur": lambda: recorded(_walk("sitting room", 7), LENS, blur=36.0),
    "several_places": _cut_together,
    "focal_length_undetermined": lambda: recorded(room("sitting room", 7, straight_ahead(FRAMES, 0.9)), LENS),
}
#: Videos whose outcome depends on the noise, or that are slow to render.
RARE_VIDEOS: dict[str, Callable[[], Iterator[SyntheticFrame]]] = {
    "focal_length_changes": lambda: zoomed(_walk("sitting room", 7, 14), 0.3),
    # a telescope: 12 times the longer side
    "implausible_focal_length": lambda: recorded(_walk("sitting room", 7), Lens(320, 240, 3840.0)),
    "drift": lambda: recorded(room("sitting room", 7, _turning_with_a_step(10, 60.0, 0.2)), LENS, noise=6.0),
}

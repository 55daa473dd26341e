"""Rendered captures with exact cameras: rooms, streets, aerial views, and captures with constructed errors.

The twenty captures of `CAPTURES` are split once: options of the reconstruction may be tuned on `CHOOSING`; the others
are reported. `ERRORS` has constructed errors of the camera's motion, the scene and the lens. `write_capture` writes
`images/` and `truth.json`: camera centres by image in metres, and the focal length.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from tests.synthetic.refused_videos import zoomed
from tests.synthetic.rooms.kinds import KINDS
from tests.synthetic.rooms.materials import MATERIALS
from tests.synthetic.rooms.solids import box, join
from tests.synthetic.rooms.street import street
from tests.synthetic.rooms.world import Pose, World, pose_towards
from tests.synthetic.videos import Lens, SyntheticFrame, orbit, panning, recorded, room, still, straight_ahead

__all__ = ["CAPTURES", "CHOOSING", "ERRORS", "RenderedCapture", "rolling_shutter", "write_capture"]

#: Number of frames of a capture, and of a constructed error.
FRAMES, ERROR_FRAMES = 20, 12
#: Number of bands of an image that are exposed one after another.
BANDS = 4
#: Camera of the constructed errors.
SMALL = Lens(320, 240, 250.0)


@dataclass(frozen=True, slots=True)
class RenderedCapture:
    """Frames of a capture and its constructed error, if any.

    lens : true lens; None if the focal length changes.
    error : kind of the constructed error.
    unusable : whether every model of the frames is wrong, because there is no camera path or no common scene.
    camera_model : camera model that the user forces.
    """

    frames: Callable[[], Iterator[SyntheticFrame]]
    lens: Lens | None
    error: str = ""
    unusable: bool = False
    camera_model: str | None = None


def write_capture(capture: RenderedCapture, folder: Path) -> None:
    """Write `images/` (JPEG, quality 92, without EXIF) and `truth.json` to a folder."""
    import cv2

    (folder / "images").mkdir(parents=True, exist_ok=True)
    centres = {}
    for index, frame in enumerate(capture.frames()):
        name = f"{index:06d}.jpg"
        cv2.imwrite(str(folder / "images" / name), frame.colour[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, 92])
        centres[name] = frame.pose.centre.tolist()
    focal = None if capture.lens is None else capture.lens.focal / max(capture.lens.width, capture.lens.height)
    (folder / "truth.json").write_text(json.dumps({"centres": centres, "focal": focal}) + "\n", encoding="utf-8")


def rolling_shutter(world: World, lens: Lens, readout: float, noise: float, gain: float) -> Iterator[SyntheticFrame]:
    """Record a world with a shutter that reads the rows one after another, and an exposure that follows the light.

    Parameters
    ----------
    world : World
        Its poses are the poses at the middle rows.
    lens : Lens
    readout : float
        Time from the first to the last row, relative to the time between two frames. It is made of `BANDS` bands.
    noise : float
        Standard deviation of the sensor's noise in grey levels.
    gain : float
        Amplitude of the relative change of exposure from frame to frame.
    """
    n = len(world.poses)
    centres = np.array([pose.centre for pose in world.poses])
    turns = Slerp(np.arange(n), Rotation.from_matrix([pose.rotation for pose in world.poses]))
    times = np.arange(n)[:, None] + readout * ((np.arange(BANDS) + 0.5) / BANDS - 0.5)  # (n, bands)
    poses = []
    for time in times.clip(0, n - 1).ravel():
        rotation = turns(time).as_matrix()
        centre = np.array([np.interp(time, np.arange(n), axis) for axis in centres.T])
        poses.append(Pose(rotation, -rotation @ centre))
    objects = tuple(replace(item, velocity=item.velocity / BANDS) for item in world.objects)
    bands = recorded(replace(world, poses=tuple(poses), objects=objects), lens, noise)
    edges = np.linspace(0, lens.height, BANDS + 1).astype(int)
    phase = np.random.default_rng([world.seed, 41]).uniform(0, 2 * np.pi)
    for index, frames in enumerate(zip(*[iter(bands)] * BANDS, strict=True)):
        colour = np.concatenate([one.colour[a:b] for one, a, b in zip(frames, edges, edges[1:], strict=False)])
        factor = 1 + gain * np.sin(phase + 4.0 * index / n)
        exposed = np.clip(np.rint(colour * factor), 0, 255).astype(np.uint8)
        yield replace(frames[BANDS // 2], colour=exposed, pose=world.poses[index])


def _street_walk(seed: int) -> World:
    """Return a street with the path of a pedestrian who looks at the houses on the other side and turns the head."""
    time = np.linspace(0, 1, FRAMES)
    eye = np.column_stack([-6.3 + 0.3 * np.sin(5 * time), 3 + 9 * time, 1.6 + 0.04 * np.sin(23 * time)])
    heading = np.radians(38 + 22 * np.sin(2 * np.pi * time + seed))
    gaze = eye + np.column_stack([np.cos(heading), np.sin(heading), 0.05 * np.sin(3 * time + seed)])
    return replace(street(seed), poses=tuple(pose_towards(a, b) for a, b in zip(eye, gaze, strict=True)))


def _aerial_view(seed: int, oblique: bool) -> World:
    """Return blocks of houses between roads and trees, with two parallel nadir strips or half an oblique orbit."""
    generator = np.random.default_rng([seed, 77])
    parts = [box((-90, 90), (-90, 90), (-0.1, 0), "pavement")]
    for x, y in itertools.product(np.arange(-70, 71, 20.0), repeat=2):
        parts.append(
            box((x - 9, x + 9), (y - 9, y + 9), (-0.1, 0.02), str(generator.choice(["leaves", "road", "floor"])))
        )
        for _ in range(int(generator.integers(1, 4))):
            (a, b), half = np.array([x, y]) + generator.uniform(-6, 6, 2), generator.uniform(1.5, 4, 2)
            tall, roof = generator.uniform(2, 14), str(generator.choice(["wood_dark", "rug", "facade", "print"]))
            parts.append(box((a - half[0], a + half[0]), (b - half[1], b + half[1]), (0, tall), "facade"))
            parts.append(box((a - half[0], a + half[0]), (b - half[1], b + half[1]), (tall, tall + 0.3), roof))
    time = np.linspace(0, 1, FRAMES)
    sway = generator.normal(0, 1.5, (FRAMES, 3))
    if oblique:
        angle = np.radians(180 * time + 40 * seed)
        eye = np.column_stack([60 * np.cos(angle), 60 * np.sin(angle), 42 + 6 * np.sin(4 * time)]) + sway
        gaze = 0.15 * eye * [1, 1, 0] + sway
    else:
        back = time >= 0.5
        along = np.where(back, 2 - 2 * time, 2 * time) * 80 - 40
        eye = np.column_stack([along, np.where(back, 11.0, -11.0), np.full(FRAMES, 62.0)]) + sway
        gaze = eye * [1, 1, 0] + [0, 6.0, 0] + generator.normal(0, 1.5, (FRAMES, 3))  # 5 degrees from the vertical
    poses = tuple(pose_towards(a, b) for a, b in zip(eye, gaze, strict=True))
    return World("aerial view", seed, (), join(parts), poses)


def _recorded_room(kind: str, seed: int, plain: bool) -> World:
    """Return a room with a camera path on an arc; with `plain`, walls and ceiling have no texture."""
    world = room(kind, seed, orbit(KINDS[kind].radius, FRAMES, seed, degrees=100.0))
    if not plain:
        return world
    material = tuple("plaster" if name in ("wall", "ceiling") else name for name in world.surfaces.material)
    return replace(world, surfaces=replace(world.surfaces, material=material))


def _captures() -> dict[str, RenderedCapture]:
    """Return ten rooms, five streets and five aerial views, through different lenses, noise and shutters."""
    worlds: dict[str, Callable[[], World]] = {}
    for number, (kind, seed) in enumerate(itertools.product(KINDS, (2000, 2001))):
        plain = number % 4 in (0, 3)  # one room of each kind, and half of the reported rooms
        name = f"{kind.replace(' ', '_')}_{'plain_walls_' if plain else ''}{seed}"
        worlds[name] = partial(_recorded_room, kind, seed, plain)
    for seed in range(2000, 2005):
        worlds[f"street_{seed}"] = partial(_street_walk, seed)
    for seed, oblique in ((2000, True), (2001, True), (2002, False), (2003, False), (2004, True)):
        worlds[f"aerial_{'oblique' if oblique else 'down'}_{seed}"] = partial(_aerial_view, seed, oblique)
    captures = {}
    for number, (name, world) in enumerate(worlds.items()):
        lens = Lens(640, 480, (470.0, 520.0, 560.0)[number % 3], (-0.1, -0.04, 0.02, 0.0)[number % 4])
        readout, noise, gain = (0.0, 0.3, 0.0)[number % 3], (2.0, 4.0)[number % 2], (0.15, 0.15, 0.0)[number % 3]
        captures[name] = RenderedCapture(partial(_frames, world, lens, readout, noise, gain), lens)
    return captures


def _frames(
    make: Callable[[], World], lens: Lens, readout: float, noise: float, gain: float
) -> Iterator[SyntheticFrame]:
    return rolling_shutter(make(), lens, readout, noise, gain)


def _moving_scene(seed: int) -> World:
    """Return a room whose furniture moves by 5 cm per frame, each piece in a different direction."""
    world = room("sitting room", seed, orbit(2.0, ERROR_FRAMES, seed, degrees=60.0))
    angles = np.random.default_rng([seed, 12]).uniform(0, 2 * np.pi, len(world.objects))
    return replace(
        world,
        objects=tuple(
            replace(item, velocity=0.05 * np.array([np.cos(angle), np.sin(angle), 0.0]))
            for item, angle in zip(world.objects, angles, strict=True)
        ),
    )


def _repeated_bays(seed: int) -> World:
    """Return a wall of six equal bays of 2 m, each with the same sixty panels, to be rendered without texture noise."""
    generator = np.random.default_rng([seed, 13])
    materials = sorted(MATERIALS)
    parts = [box((-8, 20), (0.4, 0.5), (-2, 5), "wall")]
    for _ in range(60):
        x, z = generator.uniform(0, 1.8), generator.uniform(-0.5, 3)
        width, tall, deep = generator.uniform(0.05, 0.3), generator.uniform(0.05, 0.3), generator.uniform(0.02, 0.4)
        name = str(generator.choice(materials))
        parts += [box((x + bay, x + bay + width), (0.4 - deep, 0.4), (z, z + tall), name) for bay in range(0, 12, 2)]
    time = np.linspace(0, 1, 2 * ERROR_FRAMES)
    eye = np.column_stack([1 + 10 * time, np.full(len(time), -2.0), 1.3 + 0.1 * np.sin(9 * time)])
    gaze = eye + np.column_stack([0.25 * np.sin(11 * time + seed), np.ones(len(time)), np.full(len(time), -0.02)])
    return World("bays", seed, (), join(parts), tuple(pose_towards(a, b) for a, b in zip(eye, gaze, strict=True)))


def _errors() -> dict[str, RenderedCapture]:
    """Return two captures of each constructed error."""
    errors: dict[str, RenderedCapture] = {}
    for seed in (7, 8):
        walk = partial(room, "sitting room", seed, orbit(2.0, ERROR_FRAMES, seed, degrees=60.0))
        # another seed, because the walls of rooms with the same seed have the same texture
        other = partial(room, "bedroom", seed + 10, orbit(2.0, ERROR_FRAMES, seed, degrees=60.0))
        turn = partial(room, "sitting room", seed, panning(ERROR_FRAMES, 70.0))
        tripod = partial(room, "sitting room", seed, still(ERROR_FRAMES))
        drive = partial(room, "sitting room", seed, straight_ahead(ERROR_FRAMES, 0.9))
        strong, fisheye = replace(SMALL, k=-0.15), replace(SMALL, focal=150.0, fisheye=(0.02, -0.01, 0.0, 0.0))

        def film(world: Callable[[], World], lens: Lens = SMALL, texture: float = 1.0) -> Iterator[SyntheticFrame]:
            return recorded(world(), lens, texture=texture)

        def cut(first: Callable[[], World], second: Callable[[], World]) -> Iterator[SyntheticFrame]:
            return itertools.chain(film(first), film(second))

        def zoom(world: Callable[[], World]) -> Iterator[SyntheticFrame]:
            return zoomed(world(), 0.3)

        rows = {
            "pure rotation": RenderedCapture(partial(film, turn), SMALL, unusable=True),
            "tripod": RenderedCapture(partial(film, tripod), SMALL, unusable=True),
            "cut": RenderedCapture(partial(cut, walk, other), SMALL, unusable=True),
            "zoom while walking": RenderedCapture(partial(zoom, walk), SMALL),
            "straight drive": RenderedCapture(partial(film, drive), SMALL),
            "moving scene": RenderedCapture(partial(film, partial(_moving_scene, seed)), SMALL),
            "repeated bays": RenderedCapture(partial(film, partial(_repeated_bays, seed), SMALL, 0.0), SMALL),
            "wrong lens": RenderedCapture(partial(film, walk, strong), strong, camera_model="SIMPLE_PINHOLE"),
            "fisheye as SIMPLE_RADIAL": RenderedCapture(
                partial(film, walk, fisheye), fisheye, camera_model="SIMPLE_RADIAL"
            ),
        }
        errors |= {f"{kind.replace(' ', '_')}_{seed}": replace(row, error=kind) for kind, row in rows.items()}
    return errors


CAPTURES: dict[str, RenderedCapture] = _captures()
#: Captures for tuning options: every second one.
CHOOSING = frozenset(list(CAPTURES)[::2])
ERRORS: dict[str, RenderedCapture] = _errors()

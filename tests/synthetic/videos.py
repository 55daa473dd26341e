"""Synthetic videos: a room recorded by a moving camera, with the exact pose, time and masks of every frame.

`python -m tests.synthetic.videos "sitting room" --seed 7 --out DIR` writes `video.mp4`, `instances.json` and
`truth.json`.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import FloatArray, IntArray
from tests.synthetic.rooms.furnish import furnished_room
from tests.synthetic.rooms.kinds import KINDS
from tests.synthetic.rooms.knobs import Knobs
from tests.synthetic.rooms.masks import coco_dataset
from tests.synthetic.rooms.render import Renderer
from tests.synthetic.rooms.similarity import Similarity
from tests.synthetic.rooms.truth import truth_of
from tests.synthetic.rooms.world import Pinhole, Pose, World, pose_towards

__all__ = [
    "Lens",
    "SyntheticFrame",
    "orbit",
    "panning",
    "recorded",
    "room",
    "still",
    "straight_ahead",
    "synthetic_video",
    "times_of",
    "write_video",
]

Picture = NDArray[np.uint8]
#: Denominator of the presentation times that are written: a common time base of MP4 files.
TIME_BASE = Fraction(1, 90_000)


@dataclass(frozen=True, slots=True)
class Lens:
    """A camera with COLMAP's SIMPLE_RADIAL distortion: focal length in pixels and k.

    fisheye : k1 to k4 of a lens of COLMAP's OPENCV_FISHEYE in its place.
    """

    width: int = 640
    height: int = 480
    focal: float = 500.0
    k: float = 0.0
    fisheye: tuple[float, float, float, float] | None = None

    @property
    def params(self) -> tuple[str, list[float]]:
        """COLMAP's camera model and parameters."""
        middle = [self.width / 2, self.height / 2]
        if self.fisheye is not None:
            return "OPENCV_FISHEYE", [self.focal, self.focal, *middle, *self.fisheye]
        return "SIMPLE_RADIAL", [self.focal, *middle, self.k]


@dataclass(frozen=True, slots=True, eq=False)
class SyntheticFrame:
    """One frame: colour (h, w, 3) RGB, ids (h, w) of objects, depth (h, w) in metres, and the true pose."""

    colour: Picture
    ids: IntArray
    depth: NDArray[np.float32]
    pose: Pose = field(repr=False)


def room(kind: str, seed: int, poses: Sequence[Pose] | None = None, frames: int = 60) -> World:
    """A furnished room recorded along `poses`, by default an orbit of `frames` frames."""
    world = furnished_room(kind, seed, Knobs())
    return replace(world, poses=tuple(poses if poses is not None else orbit(KINDS[kind].radius, frames, seed)))


def orbit(radius: float, frames: int, seed: int = 0, degrees: float = 110.0) -> tuple[Pose, ...]:
    """A smooth walk on an arc about the room's middle; the hand sways slowly, never from frame to frame."""
    generator = np.random.default_rng([seed, 5])
    phase = generator.random(4) * 2 * np.pi
    time = np.linspace(0, 1, frames)
    angle = np.radians(-90 + degrees * (time - 0.5))
    reach = radius * (1 - 0.08 * np.sin(3 * np.pi * time))
    height = 1.45 + 0.18 * np.sin(7 * time + phase[0])
    eye = np.column_stack([reach * np.cos(angle), 0.2 + reach * np.sin(angle), height])
    wander = 0.2 * np.sin(2 * np.pi * time + phase[1])
    gaze = np.column_stack([wander, np.full(frames, 0.5), 0.55 + 0.12 * np.cos(5 * time + phase[2])])
    roll = np.radians(2.0) * np.sin(9 * time + phase[3])
    return tuple(pose_towards(a, b, c) for a, b, c in zip(eye, gaze, roll, strict=True))


def panning(frames: int, degrees: float = 120.0, height: float = 1.5) -> tuple[Pose, ...]:
    """A camera that turns on the spot."""
    eye = np.array([0.1, -1.6, height])
    angles = np.radians(90 + degrees * np.linspace(-0.5, 0.5, frames))
    return tuple(pose_towards(eye, eye + np.array([np.cos(a), np.sin(a), -0.25])) for a in angles)


def straight_ahead(frames: int, metres: float) -> tuple[Pose, ...]:
    """A camera that moves along its view, a little downwards, without turning."""
    start, ahead = np.array([0.0, -2.0, 1.45]), np.array([0.0, 1.0, -0.35])
    centres = start + np.linspace(0, metres, frames)[:, None] * np.array([0.0, 1.0, 0.0])
    return tuple(pose_towards(centre, centre + ahead) for centre in centres)


def still(frames: int) -> tuple[Pose, ...]:
    """A camera on a tripod."""
    return panning(1, 0.0) * frames


def recorded(
    world: World,
    lens: Lens | None = None,
    noise: float = 2.0,
    texture: float = 1.0,
    blur: float = 0.0,
    seed: int = 0,
) -> Iterator[SyntheticFrame]:
    """The frames of a world through a lens.

    noise : one sigma of the sensor in grey levels; texture : contrast of all textures; blur : length in pixels of a
    smear in a direction that turns from frame to frame.
    """
    lens = lens or Lens()
    generator = np.random.default_rng([seed, world.seed, 31])
    wide, across = _ideal_pixels(lens)
    with Renderer(replace(world, camera=wide), texture) as renderer:
        for index, pose in enumerate(world.poses):
            frame = renderer.frame(index)
            assert frame.colour is not None
            colour, ids, depth = frame.colour, frame.ids, frame.depth
            if across is not None:
                colour, ids, depth = _remapped(across, colour, ids, depth)
            noisy = _smeared(colour, blur, 0.7 * index) + generator.normal(0, noise, colour.shape)
            yield SyntheticFrame(np.clip(np.rint(noisy), 0, 255).astype(np.uint8), ids, depth, pose)


def times_of(frames: int, rate: float = 30.0, variable: bool = False, seed: int = 0) -> FloatArray:
    """(n,) presentation times in seconds; variable ones differ from frame to frame by up to a half, as a phone's do."""
    steps = np.full(frames, 1 / rate)
    if variable:
        steps *= np.random.default_rng([seed, 3]).uniform(0.6, 1.6, frames)
    times: FloatArray = np.concatenate([[0.0], np.cumsum(steps)[:-1]])
    return times


def write_video(
    file: Path,
    pictures: Iterable[Picture],
    times: Sequence[float] | FloatArray,
    turned_deg: int = 0,
    codec: str = "libx264",
    quality: int = 18,
    colour: dict[str, int] | None = None,
    pixels: str = "yuv420p",
) -> None:
    """A real video file by PyAV.

    turned_deg : the pictures are stored turned by so much counter-clockwise, and the container asks a player to turn
    them back, as a telephone held upright does. colour : `color_trc` and the like, to mark a video as HDR.
    """
    import av

    with av.open(str(file), "w") as container:
        stream: Any = None
        for picture, time in zip(pictures, times, strict=True):
            stored = np.ascontiguousarray(np.rot90(picture, turned_deg // 90))
            if stream is None:
                stream = container.add_stream(codec, rate=30, options={"crf": str(quality), "preset": "fast"})
                stream.height, stream.width = stored.shape[:2]
                stream.pix_fmt, stream.time_base = pixels, TIME_BASE
                stream.codec_context.time_base = TIME_BASE
                for name, value in (colour or {}).items():
                    setattr(stream.codec_context, name, value)
                if turned_deg:
                    stream.set_display_rotation(-turned_deg)
            frame = av.VideoFrame.from_ndarray(stored, format="rgb24")
            frame.pts, frame.time_base = round(time / TIME_BASE), TIME_BASE
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def synthetic_video(
    world: World, lens: Lens, folder: Path, rate: float = 20.0, variable: bool = False, turned_deg: int = 0
) -> None:
    """`video.mp4`, `instances.json` with the masks of every frame, and `truth.json` in a folder.

    variable : the frame rate, as of `times_of`; turned_deg : as of `write_video`.

    The truth is in metres with z up: camera, pose and time of every frame, and each object's size.
    """
    folder.mkdir(parents=True, exist_ok=True)
    frames = list(recorded(world, lens))
    times = times_of(len(frames), rate, variable)
    write_video(folder / "video.mp4", [frame.colour for frame in frames], times, turned_deg, quality=20)
    seen = replace(world, camera=Pinhole(lens.width, lens.height, lens.focal))
    names = [f"{index:06d}.jpg" for index in range(len(frames))]
    dataset = coco_dataset(seen, [frame.ids for frame in frames], names)
    (folder / "instances.json").write_text(json.dumps(dataset) + "\n")
    truth = {
        "camera": {
            "model": lens.params[0],
            "width": lens.width,
            "height": lens.height,
            "params": lens.params[1],
        },
        "frames": [
            {
                "index": index,
                "time_s": float(time),
                "rotation": frame.pose.rotation.tolist(),
                "translation": frame.pose.translation.tolist(),
            }
            for index, (time, frame) in enumerate(zip(times, frames, strict=True))
        ],
        "objects": truth_of(world, Similarity(1.0, np.eye(3), np.zeros(3))).json()["objects"],
    }
    (folder / "truth.json").write_text(json.dumps(truth, indent=1) + "\n")


def _ideal_pixels(lens: Lens) -> tuple[Pinhole, NDArray[np.float32] | None]:
    """A camera without distortion that sees all that the lens does, and (h, w, 2) where the lens's pixels are in it.

    The pixels are None where the lens does not distort.
    """
    if lens.k == 0 and lens.fisheye is None:
        return Pinhole(lens.width, lens.height, lens.focal), None
    import zlib  # noqa: F401 - pycolmap breaks a zlib that is loaded after it

    import pycolmap

    model, params = lens.params
    camera = pycolmap.Camera(model=model, width=lens.width, height=lens.height, params=params)
    x, y = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
    ideal = lens.focal * np.asarray(camera.cam_from_img(np.column_stack([x.ravel(), y.ravel()])))[:, :2]
    half = np.ceil(np.abs(ideal).max(axis=0)).astype(int) + 4
    wide = Pinhole(int(2 * half[0]), int(2 * half[1]), lens.focal)
    pixels = ideal + half - 0.5  # OpenCV's pixel centres are whole numbers
    return wide, pixels.reshape(lens.height, lens.width, 2).astype(np.float32)


def _remapped(
    across: NDArray[np.float32], colour: Picture, ids: IntArray, depth: NDArray[np.float32]
) -> tuple[Picture, IntArray, NDArray[np.float32]]:
    import cv2

    nearest = np.rint(across).astype(np.int64)
    x = np.clip(nearest[..., 0], 0, ids.shape[1] - 1)
    y = np.clip(nearest[..., 1], 0, ids.shape[0] - 1)
    return np.asarray(cv2.remap(colour, across, None, cv2.INTER_CUBIC), dtype=np.uint8), ids[y, x], depth[y, x]


def _smeared(colour: Picture, length: float, angle: float) -> NDArray[np.float64]:
    import cv2

    if length <= 0:
        return colour.astype(np.float64)
    half = int(np.ceil(length / 2))
    kernel = np.zeros((2 * half + 1, 2 * half + 1))
    along = np.linspace(-length / 2, length / 2, 8 * half + 1)
    columns, rows = np.rint(half + along * np.cos(angle)), np.rint(half + along * np.sin(angle))
    np.add.at(kernel, (rows.astype(int), columns.astype(int)), 1.0)
    return np.asarray(cv2.filter2D(colour.astype(np.float64), -1, kernel / kernel.sum()))


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m tests.synthetic.videos", description=__doc__)
    parser.add_argument("kind", choices=list(KINDS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    synthetic_video(room(arguments.kind, arguments.seed, frames=arguments.frames), Lens(), arguments.out)
    print(f"{arguments.out}: {arguments.frames} frames")


if __name__ == "__main__":
    main()

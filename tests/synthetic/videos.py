"""Render videos of a room from a moving camera, with the exact pose, time and masks of every frame.

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

Image = NDArray[np.uint8]
#: Time base of the presentation times, common in MP4 files.
TIME_BASE = Fraction(1, 90_000)


@dataclass(frozen=True, slots=True)
class Lens:
    """A camera with COLMAP's model SIMPLE_RADIAL: focal length in pixels and distortion k.

    fisheye : k1 to k4 of COLMAP's model OPENCV_FISHEYE, which is used instead if given.
    """

    width: int = 640
    height: int = 480
    focal: float = 500.0
    k: float = 0.0
    fisheye: tuple[float, float, float, float] | None = None

    @property
    def params(self) -> tuple[str, list[float]]:
        """COLMAP's camera model and parameters."""
        centre = [self.width / 2, self.height / 2]
        if self.fisheye is not None:
            return "OPENCV_FISHEYE", [self.focal, self.focal, *centre, *self.fisheye]
        return "SIMPLE_RADIAL", [self.focal, *centre, self.k]


@dataclass(frozen=True, slots=True, eq=False)
class SyntheticFrame:
    """One frame: colour (h, w, 3) RGB, ids (h, w) of objects, depth (h, w) in metres, and the true pose."""

    colour: Image
    ids: IntArray
    depth: NDArray[np.float32]
    pose: Pose = field(repr=False)


def room(kind: str, seed: int, poses: Sequence[Pose] | None = None, frames: int = 60) -> World:
    """Return a furnished room with camera poses; by default an orbit of `frames` frames."""
    world = furnished_room(kind, seed, Knobs())
    return replace(world, poses=tuple(poses if poses is not None else orbit(KINDS[kind].radius, frames, seed)))


def orbit(radius: float, frames: int, seed: int = 0, degrees: float = 110.0) -> tuple[Pose, ...]:
    """Return the poses of a smooth walk on an arc around the centre of the room, with slow sway of the hand."""
    generator = np.random.default_rng([seed, 5])
    phase = generator.random(4) * 2 * np.pi
    time = np.linspace(0, 1, frames)
    angle = np.radians(-90 + degrees * (time - 0.5))
    distance = radius * (1 - 0.08 * np.sin(3 * np.pi * time))
    height = 1.45 + 0.18 * np.sin(7 * time + phase[0])
    eye = np.column_stack([distance * np.cos(angle), 0.2 + distance * np.sin(angle), height])
    wander = 0.2 * np.sin(2 * np.pi * time + phase[1])
    gaze = np.column_stack([wander, np.full(frames, 0.5), 0.55 + 0.12 * np.cos(5 * time + phase[2])])
    roll = np.radians(2.0) * np.sin(9 * time + phase[3])
    return tuple(pose_towards(a, b, c) for a, b, c in zip(eye, gaze, roll, strict=True))


def panning(frames: int, degrees: float = 120.0, height: float = 1.5) -> tuple[Pose, ...]:
    """Return the poses of a camera that only rotates."""
    eye = np.array([0.1, -1.6, height])
    angles = np.radians(90 + degrees * np.linspace(-0.5, 0.5, frames))
    return tuple(pose_towards(eye, eye + np.array([np.cos(a), np.sin(a), -0.25])) for a in angles)


def straight_ahead(frames: int, metres: float) -> tuple[Pose, ...]:
    """Return the poses of a camera that moves forwards without rotation and is pitched down slightly."""
    start, ahead = np.array([0.0, -2.0, 1.45]), np.array([0.0, 1.0, -0.35])
    centres = start + np.linspace(0, metres, frames)[:, None] * np.array([0.0, 1.0, 0.0])
    return tuple(pose_towards(centre, centre + ahead) for centre in centres)


def still(frames: int) -> tuple[Pose, ...]:
    """Return equal poses, as on a tripod."""
    return panning(1, 0.0) * frames


def recorded(
    world: World,
    lens: Lens | None = None,
    noise: float = 2.0,
    texture: float = 1.0,
    blur: float = 0.0,
    seed: int = 0,
) -> Iterator[SyntheticFrame]:
    """Render the frames of a world through a lens.

    noise : standard deviation of the sensor noise in grey levels.
    texture : contrast of all textures.
    blur : length in pixels of a motion blur whose direction changes from frame to frame.
    """
    lens = lens or Lens()
    generator = np.random.default_rng([seed, world.seed, 31])
    wide, undistorted = _undistorted_pixels(lens)
    with Renderer(replace(world, camera=wide), texture) as renderer:
        for index, pose in enumerate(world.poses):
            frame = renderer.frame(index)
            assert frame.colour is not None
            colour, ids, depth = frame.colour, frame.ids, frame.depth
            if undistorted is not None:
                colour, ids, depth = _remapped(undistorted, colour, ids, depth)
            noisy = _blurred(colour, blur, 0.7 * index) + generator.normal(0, noise, colour.shape)
            yield SyntheticFrame(np.clip(np.rint(noisy), 0, 255).astype(np.uint8), ids, depth, pose)


def times_of(frames: int, rate: float = 30.0, variable: bool = False, seed: int = 0) -> FloatArray:
    """Return presentation times (n,) in seconds. Variable intervals are 0.6 to 1.6 times the nominal interval."""
    steps = np.full(frames, 1 / rate)
    if variable:
        steps *= np.random.default_rng([seed, 3]).uniform(0.6, 1.6, frames)
    times: FloatArray = np.concatenate([[0.0], np.cumsum(steps)[:-1]])
    return times


def write_video(
    file: Path,
    images: Iterable[Image],
    times: Sequence[float] | FloatArray,
    turned_deg: int = 0,
    codec: str = "libx264",
    quality: int = 18,
    colour: dict[str, int] | None = None,
    pixels: str = "yuv420p",
) -> None:
    """Encode a video file with PyAV.

    turned_deg : counter-clockwise rotation of the stored images in degrees. The container has a display matrix with
        the inverse rotation, as in portrait videos of phones.
    colour : attributes of the codec context, such as `color_trc` to mark a video as HDR.
    """
    import av

    with av.open(str(file), "w") as container:
        stream: Any = None
        for image, time in zip(images, times, strict=True):
            stored = np.ascontiguousarray(np.rot90(image, turned_deg // 90))
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
    """Write `video.mp4`, `instances.json` with the masks of every frame, and `truth.json` to a folder.

    The truth is in metres with z up: camera, pose and time of every frame, and the size of each object.

    variable : variable frame rate (`times_of`).
    turned_deg : rotation of the stored images (`write_video`).
    """
    folder.mkdir(parents=True, exist_ok=True)
    frames = list(recorded(world, lens))
    times = times_of(len(frames), rate, variable)
    write_video(folder / "video.mp4", [frame.colour for frame in frames], times, turned_deg, quality=20)
    pinhole_world = replace(world, camera=Pinhole(lens.width, lens.height, lens.focal))
    names = [f"{index:06d}.jpg" for index in range(len(frames))]
    dataset = coco_dataset(pinhole_world, [frame.ids for frame in frames], names)
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


def _undistorted_pixels(lens: Lens) -> tuple[Pinhole, NDArray[np.float32] | None]:
    """Return a pinhole camera with the field of view of the lens, and the lens's pixels (h, w, 2) in its image.

    The pixels are None if the lens has no distortion.
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
    pixels = ideal + half - 0.5  # OpenCV's pixel centres are integers
    return wide, pixels.reshape(lens.height, lens.width, 2).astype(np.float32)


def _remapped(
    pixels: NDArray[np.float32], colour: Image, ids: IntArray, depth: NDArray[np.float32]
) -> tuple[Image, IntArray, NDArray[np.float32]]:
    import cv2

    nearest = np.rint(pixels).astype(np.int64)
    x = np.clip(nearest[..., 0], 0, ids.shape[1] - 1)
    y = np.clip(nearest[..., 1], 0, ids.shape[0] - 1)
    return np.asarray(cv2.remap(colour, pixels, None, cv2.INTER_CUBIC), dtype=np.uint8), ids[y, x], depth[y, x]


def _blurred(colour: Image, length: float, angle: float) -> NDArray[np.float64]:
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
    """Render a video of a room to a folder."""
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

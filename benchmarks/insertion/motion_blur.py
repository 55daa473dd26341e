"""Compare the exposure that is estimated from smeared frames with the true one.

    python -m benchmarks.insertion.motion_blur WORK [WORK ...] [--groups 4 8]

Each WORK is a work folder of a video with poses. The frames of the video are divided into groups of n; the mean of the
first k frames of a group is a frame of a slower video that is smeared along the motion of n frames. The smear of k
equal images at equal distances has the standard deviation of a uniform smear over sqrt(k^2 - 1) distances, so that the
true exposure is sqrt(k^2 - 1) / n. For k = 1 the true exposure is that of the camera divided by n.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from estimator.reconstructions.scene_reader import read_scene
from estimator.records.scene import Scene, View
from insertion.colour import Image
from insertion.composite.motion_blur import motion_blur
from insertion.footage.footage import Frame, SceneImages, video_footage
from insertion.scene.point_cloud import ColouredPoints


@dataclass(frozen=True, slots=True, eq=False)
class SmearedVideo:
    """Frames of a slower video, as images of a reconstruction with the same points."""

    frames: list[Frame]
    scene: Scene
    images: list[Image]

    @property
    def rows(self) -> tuple[int, ...]:
        """Indices of the images."""
        return tuple(range(len(self.images)))

    def image(self, row: int) -> Image:
        """Return the image (h, w, 3) of a frame."""
        return self.images[row]


def smeared_video(scene: Scene, footage: list[tuple[Frame, Image]], group: int, count: int) -> SmearedVideo:
    """Return the means of the first `count` of every `group` frames, with the poses of their middle."""
    frames: list[Frame] = []
    images: list[Image] = []
    views: list[View] = []
    for start in range(0, len(footage) - group + 1, group):
        part = footage[start : start + count]
        view = part[len(part) // 2][0].view
        if view is None:
            continue
        mean = np.mean([image.astype(np.float32) for _, image in part], axis=0)
        frames.append(Frame(len(frames), f"{len(frames):06d}.png", None, view, len(views)))
        images.append(np.rint(mean).astype(np.uint8))
        views.append(view)
    return SmearedVideo(frames, replace(scene, views=tuple(views)), images)


def main() -> None:
    """Print a table of true and estimated exposures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("work", type=Path, nargs="+")
    parser.add_argument("--groups", type=int, nargs="+", default=[4, 8])
    parser.add_argument("--frames", type=int, default=240, help="maximum number of frames of the video")
    options = parser.parse_args()
    print("| video | n | k | true exposure | estimated | ratio |\n|---|---|---|---|---|---|")
    for work in options.work:
        scene = read_scene(work)
        video = video_footage(work, scene)
        if video is None:
            raise SystemExit(f"{work}: expected the work folder of a video")
        footage = [item for item, _ in zip(video, range(options.frames), strict=False)]
        nothing = np.zeros((len(scene.points), 3), np.float32)
        cloud = ColouredPoints(scene.points, nothing, dense=False)
        for group in options.groups:
            for count in sorted({1, group // 2, 3 * group // 4, group}):
                made: Any = smeared_video(scene, footage, group, count)
                blur = motion_blur(made.frames, cast(SceneImages, made), cloud)
                truth = np.sqrt(count**2 - 1) / group
                found = "none" if blur is None else f"{blur.fraction:.2f}"
                ratio = "" if blur is None or not truth else f"{blur.fraction / truth:.2f}"
                print(f"| {work.name} | {group} | {count} | {truth:.2f} | {found} | {ratio} |", flush=True)


if __name__ == "__main__":
    main()

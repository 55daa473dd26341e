"""An object inserted into a video: `python -m benchmarks.insertion.video_proof --out DIR [CONDITION ...]`.

A synthetic room is recorded, the video reconstructed from some of its frames, an object inserted by what
`insert-object` calls, and the video that comes out compared with the same video of the room in which the mesh really
stands. One line of JSON a condition, in DIR/videos.jsonl.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.insertion.hiding_places import hiding_place
from benchmarks.insertion.likeness import LEAST_PIXELS, flicker, height_inside, inner
from benchmarks.insertion.pose_errors import pose_errors
from benchmarks.insertion.synthetic_videos import (
    CONDITIONS,
    Condition,
    Standing,
    SyntheticVideo,
    pictures_of,
    standing,
    synthetic_video,
    true_video,
)
from estimator.reading import read_instances, read_scene
from insertion.composite.compose import Composite, Joined
from insertion.footage.footage import Shot, Stills
from insertion.footage.picture_writer import picture_writer
from insertion.footage.video_footage import VideoFootage, video_footage
from insertion.models.gltf import read_model
from insertion.pipeline.frames import insert_objects
from insertion.pipeline.objects import Placed, place_objects, resize
from insertion.pipeline.prepared_scene import PreparedScene, prepare_scene
from insertion.pipeline.request import ObjectRequest
from insertion.pipeline.result import FrameReport
from insertion.render.body import body_of
from insertion.scene.scale import ScaleUsed
from metric_base.arrays import BoolArray
from tests.synthetic.insertions import write_glb
from tests.synthetic.painted import write_painted_glb
from tests.synthetic.rooms.shapes import solid
from tests.synthetic.rooms.similarity import Similarity

__all__ = ["main"]

#: The room, and what is inserted with its size in metres.
KIND, SEED, WHAT, SIZE = "sitting room", 1003, "chair", (0.42, 0.38, 0.75)
FRAMES, RECONSTRUCTED = 16, 10
SCALE_ERRORS = (0.9, 1.1)


@dataclass(eq=False)
class Layers:
    """Takes the visible coverage of every frame."""

    visible: dict[int, BoolArray] = field(default_factory=dict)
    _shape: tuple[int, ...] = ()

    def picture(self, shot: Shot, picture: NDArray[np.uint8]) -> None:
        """The frame without objects: its size alone is kept."""
        del shot
        self._shape = picture.shape

    def layers(self, shot: Shot, number: int, joined: Joined) -> None:
        """Visible coverage of the one object."""
        del number
        alpha, _ = joined.whole(self._shape)
        self.visible[shot.index] = alpha > 0.5

    def composite(self, shot: Shot, composite: Composite) -> None:
        """The picture with the object is not kept."""


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("conditions", nargs="*", help="first words of their names; all by default")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    chosen = [c for c in CONDITIONS if not options.conditions or c.name.split()[0] in options.conditions]
    with (options.out / "videos.jsonl").open("a") as rows:
        for condition in chosen:
            row = video_row(condition, options.out / condition.name.split()[0])
            print(json.dumps(row), flush=True)
            rows.write(json.dumps(row) + "\n")
            rows.flush()


def video_row(condition: Condition, folder: Path) -> dict[str, Any]:
    """One video, its insertion and its figures; the videos stay in the folder as bare.mp4, ours.mp4, true.mp4."""
    folder.mkdir(parents=True, exist_ok=True)
    video = synthetic_video(KIND, SEED, FRAMES, condition, folder / "bare.mp4")
    poses, to_scene = video.reconstruction(folder / "work", RECONSTRUCTED)
    prepared = stage_of_work(folder / "work", 1 / to_scene.scale)
    placed, truth = painted_twin(video, prepared, to_scene, folder)
    layers = Layers()
    with picture_writer(folder / "ours.mp4", video.file, condition.turned_deg) as write:
        (result,) = insert_objects(prepared, [placed], write, video=True, layers=[layers])
    ratios = {1.0: _height_ratio(result.frames, truth)}
    for error in SCALE_ERRORS:
        (wrong,) = insert_objects(_thinned(prepared, 4), [resize(placed, 1 / error)], lambda *_: None)
        ratios[error] = _height_ratio(wrong.frames, truth)
    return {
        "condition": condition.name,
        "height_ratio": {str(error): round(ratio, 4) for error, ratio in sorted(ratios.items())},
        **_figures(pictures_of(folder / "ours.mp4"), truth, layers),
        "poses": pose_errors(poses, video.world.poses, condition.lens),
    }


def stage_of_work(work: Path, scale: float) -> PreparedScene:
    """The prepared scene of a work folder at a scale in metres per unit, as `insert-object WORK --scale` makes it."""
    scene = read_scene(work)
    footage = video_footage(work, scene)
    assert footage is not None  # the folder was made from a video
    return prepare_scene(
        scene,
        Stills(scene, work / "frames"),
        footage,
        read_instances(None, scene),
        ScaleUsed(scale, None, None, "option"),
    )


def painted_twin(
    video: SyntheticVideo, prepared: PreparedScene, to_scene: Similarity, folder: Path
) -> tuple[Placed, Standing]:
    """The object at its place, painted as the room's renderer paints it there, and the video with it really there.

    The place is one that is free, or where furniture hides a part of the object, as the video's condition says.
    """
    mesh = solid(WHAT, np.array(SIZE))
    (plain,) = place_objects(prepared, [ObjectRequest(write_glb(mesh, folder / "plain.glb"))])
    position, front = plain.place.position, plain.front
    if video.condition.hidden:
        place, toward, _ = hiding_place(replace(video.world, poses=video.world.poses[::3]), mesh)
        position, front = to_scene(place[None])[0], to_scene.rotation @ toward
    floor = prepared.supports.surfaces[plain.place.plane or 0].plane
    position = position + (floor.height - position @ floor.basis[2]) * floor.basis[2]
    front = front - (front @ floor.basis[2]) * floor.basis[2]
    place = to_scene.inverse(position[None])[0] * [1, 1, 0]  # the true object stands on the floor itself
    world = standing(video.world, mesh, place, to_scene.rotation.T @ front)
    painted = write_painted_glb(
        mesh, world.objects[-1].mesh, folder / "painted.glb", len(world.objects), video.world.seed
    )
    model, front = read_model(painted), front / np.linalg.norm(front)
    body = body_of(model, position, floor.basis, front, 1 / prepared.scale.metres_per_unit)
    placed = replace(plain, model=model, place=replace(plain.place, position=position), front=front, body=body)
    return placed, true_video(video, world, folder / "true.mp4")


def _thinned(prepared: PreparedScene, step: int) -> PreparedScene:
    """The prepared scene with every so manieth frame of its video."""
    footage = prepared.footage
    assert isinstance(footage, VideoFootage)
    thin = VideoFootage.__new__(VideoFootage)
    thin.__dict__.update(footage.__dict__)
    thin.shots = footage.shots[::step]
    return replace(prepared, footage=thin)


def _height_ratio(frames: Sequence[FrameReport], truth: Standing) -> float:
    """Mean of our outline's height over the true one's, over the frames that show it whole."""
    ratios = []
    for frame in frames:
        height = height_inside(truth.whole[int(Path(frame.image).stem)])
        if height is not None and frame.silhouette is not None:
            ratios.append(frame.silhouette[3] / height)
    return float(np.mean(ratios)) if ratios else float("nan")


def _figures(ours: Sequence[NDArray[np.uint8]], truth: Standing, layers: Layers) -> dict[str, Any]:
    both = [inner(seen & layers.visible[k]) for k, seen in enumerate(truth.seen)]
    whole, faces = flicker(ours, truth.pictures, truth.faces, both)
    return {
        "frames": sum(int(mask.sum()) > LEAST_PIXELS for mask in both),
        "whole": sum(height_inside(mask) is not None for mask in truth.whole),
        "flicker": round(whole, 2),
        "flicker_faces": round(faces, 2),
    }


if __name__ == "__main__":
    main()

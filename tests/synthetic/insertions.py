"""Synthetic rooms for tests of insertion: rendered frames, a scene, and a mesh as a model file or in the room."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from estimator.records.scene import DenseCloud, Instance, Scene
from insertion.composite.compositor import Compositor, composite_footage
from insertion.footage.footage import Footage, ImageSequence, SceneImages
from insertion.footage.image_writer import Writer
from insertion.insertion_scene import InsertionScene, build_scene
from insertion.placement.placed_object import PlacedObject, place_objects
from insertion.request import ObjectRequest
from insertion.result import InsertionResult
from insertion.scene.scale import MetricScale
from metric_base.arrays import FloatArray
from tests.synthetic.rooms.furnish import furnished_room, turn_about_z
from tests.synthetic.rooms.knobs import Knobs
from tests.synthetic.rooms.quick import quick_scene
from tests.synthetic.rooms.render import Renderer
from tests.synthetic.rooms.similarity import Similarity, similarity_between
from tests.synthetic.rooms.solids import Mesh, rotate
from tests.synthetic.rooms.world import Placed, World
from tests.synthetic.same_scene import moved_scene

if TYPE_CHECKING:
    from metric_tree.tree import Tree

__all__ = [
    "RecordedRoom",
    "added",
    "composite_into",
    "first_views",
    "in_unit",
    "place_in",
    "prepared_scene_of",
    "standing",
    "video_room",
    "write_glb",
]

TRACK = "inserted"


@dataclass(frozen=True, slots=True, eq=False)
class RecordedRoom:
    """A synthetic room with its frames on disk, its scene, its masks, and the transform from metres to the scene."""

    world: World
    scene: Scene
    instances: tuple[Instance, ...]
    folder: Path
    to_scene: Similarity


def first_views(scene: Path, n_views: int, folder: Path) -> Path:
    """Copy a scene with a COLMAP model of its first views only, in which an insertion is quick; return the folder."""
    import pycolmap

    shutil.copytree(scene, folder)
    (model,) = {path.parent for path in folder.rglob("images.bin")}
    reconstruction = pycolmap.Reconstruction(str(model))
    for image in sorted(reconstruction.images.values(), key=lambda image: image.name)[n_views:]:
        reconstruction.deregister_frame(image.frame_id)
    reconstruction.write(str(model))
    return folder


def video_room(kind: str, seed: int, folder: Path, views: int = 6, noise: float = 0.0) -> RecordedRoom:
    """Write frames as PNG files to `folder/images`, and return the room with a scene of low noise."""
    import cv2

    world = furnished_room(kind, seed, Knobs(views=views, coverage=0.6))
    synthetic = quick_scene(world, Knobs(depth_noise=noise, stray=0.0), seed)
    images = folder / "images"
    images.mkdir(parents=True, exist_ok=True)
    with Renderer(world) as renderer:
        for index, view in enumerate(synthetic.scene.views):
            colour = renderer.frame(index).colour
            assert colour is not None
            cv2.imwrite(str((images / view.name).with_suffix(".png")), colour[..., ::-1])
    named = tuple(replace(view, name=f"{Path(view.name).stem}.png") for view in synthetic.scene.views)
    scene = replace(synthetic.scene, path=folder, views=named)
    true = np.array([pose.centre for pose in world.poses])
    return RecordedRoom(
        world, scene, synthetic.instances, folder, similarity_between(true, np.array([v.centre for v in named]))
    )


def in_unit(room: RecordedRoom, factor: float) -> RecordedRoom:
    """Return the room with a reconstruction that has `factor` times more units per metre."""
    scale, translation = factor * room.to_scene.scale, factor * room.to_scene.translation
    scene = moved_scene(room.scene, factor, np.eye(3), np.zeros(3))
    return replace(room, scene=scene, to_scene=replace(room.to_scene, scale=scale, translation=translation))


def prepared_scene_of(room: RecordedRoom, scale_error: float = 1.0, dense: bool = True) -> InsertionScene:
    """Return the prepared scene with the true scale multiplied by `scale_error`."""
    scene = room.scene
    if not dense:
        scene = replace(scene, dense=None)
    assert dense is False or isinstance(scene.dense, DenseCloud)
    scene_images = SceneImages(scene)
    scale = MetricScale(scale_error / room.to_scene.scale, None, None, "option")
    return build_scene(scene, scene_images, ImageSequence(scene_images), room.instances, scale)


def place_in(scene: InsertionScene, requests: Sequence[ObjectRequest], tree: Tree | None = None) -> list[PlacedObject]:
    """Return the objects at their positions in a scene."""
    return place_objects(requests, scene.space, scene.footage.frames, tree)


def composite_into(
    scene: InsertionScene, objects: Sequence[PlacedObject], write: Writer, footage: Footage | None = None
) -> list[InsertionResult]:
    """Composite objects into the footage of a scene, or into `footage`."""
    frames = footage or scene.footage
    with closing(Compositor(objects, scene.light, scene.content, frames.start_s)) as compositor:
        return composite_footage(compositor, frames, scene.scale, write)


def write_glb(mesh: Mesh, file: Path, colour: tuple[float, float, float] = (0.5, 0.3, 0.2)) -> Path:
    """Write a mesh (z up, front towards -y) as a GLB file (y up, front towards +z)."""
    import trimesh

    vertices = mesh.vertices[:, [0, 2, 1]] * [1, 1, -1]
    material = trimesh.visual.material.PBRMaterial(
        baseColorFactor=[*(round(255 * c) for c in colour), 255], metallicFactor=0.0, roughnessFactor=0.9
    )
    solid = trimesh.Trimesh(
        vertices, mesh.faces, process=False, visual=trimesh.visual.TextureVisuals(material=material)
    )
    file.write_bytes(trimesh.Scene(solid).export(file_type="glb"))
    return file


def added(room: RecordedRoom, mesh: Mesh, position: FloatArray, heading: FloatArray, alone: bool = False) -> World:
    """Return the world with the mesh at a position of the scene and its front along `heading`.

    alone : remove the other objects.
    """
    in_world, front = room.to_scene.inverse(position[None])[0], room.to_scene.rotation.T @ heading
    return standing(replace(room.world, objects=()) if alone else room.world, mesh, in_world, front)


def standing(world: World, mesh: Mesh, position: FloatArray, front: FloatArray) -> World:
    """Return the world with the mesh as last object, at a position (3,) with its front along a direction (3,)."""
    yaw = float(np.arctan2(front[1], front[0]) + np.pi / 2)
    placed = rotate(mesh, turn_about_z(yaw), position)
    item = Placed(TRACK, "stool", "stool", np.ptp(mesh.vertices, axis=0), placed)
    return replace(world, objects=(*world.objects, item))

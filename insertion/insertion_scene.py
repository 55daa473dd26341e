"""A scene opened for insertion: everything that does not depend on the objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from capture.work_folder import WORK_SUFFIX
from estimator.instances.instance_reader import INSTANCES_FILE, default_instances, read_instances
from estimator.reconstructions.scene_reader import read_scene
from estimator.records.objects import Up
from estimator.records.scene import Instance, Scene
from insertion.footage.footage import Footage, ImageSequence, SceneImages, video_footage
from insertion.light.light_model import LightModel
from insertion.placement.placement import PlacementSpace
from insertion.request import SceneSource
from insertion.scene.frame_masks import FrameContent, MaskPropagator, moving_masks, static_cloud
from insertion.scene.point_cloud import coloured_cloud
from insertion.scene.scale import MetricScale
from insertion.scene.supports import support_surfaces
from metric_base.arrays import grouped


@dataclass(frozen=True, slots=True, eq=False)
class InsertionScene:
    """A scene, divided into what each stage of an insertion reads."""

    scene: Scene  #: the reconstruction
    images: SceneImages  #: its images
    footage: Footage  #: frames to write
    space: PlacementSpace
    content: FrameContent
    light: LightModel  #: estimated on first use
    scale: MetricScale


def open_scene(source: SceneSource) -> InsertionScene:
    """Read a scene for insertion.

    Raises
    ------
    InputError
        A file cannot be read, or the scale was computed from another scene.
    """
    folder = source.folder
    scene = read_scene(folder, source.dense)
    frames = folder / "frames"
    images = SceneImages(scene, source.images or (frames if frames.is_dir() else None))
    footage = video_footage(folder, scene) or ImageSequence(images)
    default = default_instances(scene) if source.instances is None else None
    drawn = folder.resolve().with_name(f"{folder.resolve().name}{WORK_SUFFIX}") / INSTANCES_FILE
    file = source.instances or default or (drawn if drawn.is_file() else None)
    masks = () if file is None else read_instances(file, scene)
    source.scale.check(scene, masks if file is None or file == default else None)
    moving = {} if source.moving is None else moving_masks(source.moving, scene, footage.frames)
    return build_scene(scene, images, footage, masks, source.scale, source.up, moving)


def build_scene(
    scene: Scene,
    images: SceneImages,
    footage: Footage,
    instances: Sequence[Instance],
    scale: MetricScale,
    up: Up | None = None,
    moving: Mapping[int, tuple[Instance, ...]] | None = None,
) -> InsertionScene:
    """Build a scene for insertion. The images are read once for the colours of the cloud.

    Parameters
    ----------
    scene : Scene
        The reconstruction.
    images : SceneImages
        Its images.
    footage : Footage
        Frames to write.
    instances : sequence of Instance
        Masks of possible occluders and of objects to stand on.
    scale : MetricScale
        Metres per unit.
    up : Up, optional
        The vertical, if it is known.
    moving : mapping of int to tuple of Instance, optional
        Masks of moving objects, by the index of the frame.
    """
    by_view = grouped((item.view, item) for item in instances if not item.from_box)  # a box has no outline
    cloud = coloured_cloud(scene, images)
    supports = support_surfaces(scene, cloud, up)
    static = static_cloud(cloud, moving, footage.frames) if moving else cloud
    return InsertionScene(
        scene,
        images,
        footage,
        PlacementSpace(scene.views, static, supports, tuple(instances), scale.metres_per_unit),
        FrameContent(scene, static, supports, MaskPropagator(scene, by_view, cloud), moving or {}),
        LightModel(scene, images, supports, cloud, static),
        scale,
    )

"""Insert virtual objects into the images of a scene: `insertion.insert_objects`, and the order of the stages."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from estimator.records.result import ScaleResult
from insertion.request import InsertionRequest, ObjectRequest, SceneSource
from insertion.result import InsertionResult
from insertion.scene.scale import read_scale, scale_of_result
from metric_base.errors import InputError
from metric_base.progress import ProgressCallback, silent

if TYPE_CHECKING:
    from estimator.records.objects import Up
    from insertion.composite.compositor import LayerSink
    from insertion.insertion_scene import InsertionScene
    from metric_tree.tree import Tree


@dataclass(frozen=True, slots=True, eq=False)
class Insertion:
    """Results and files of an insertion."""

    objects: tuple[InsertionResult, ...]  #: one per object, with its position and its silhouette in each frame
    out: Path  #: the video, or the folder of images
    warnings: tuple[str, ...] = ()  #: checks that could not be made, and files that could not be written


def insert_objects(
    scene: Path | str,
    objects: Sequence[ObjectRequest | Path | str],
    scale: float | Path | ScaleResult | None,
    out: Path | str,
    *,
    images: Path | None = None,
    instances: Path | None = None,
    moving: Path | None = None,
    dense: str | None = None,
    up: Up | None = None,
    tree: Tree | None = None,
    show_interval: bool = False,
    renderer: Literal["embedded", "blender"] = "embedded",
    export: Path | None = None,
    layers: Path | None = None,
    frames: tuple[int, int] | None = None,
    codec: str | None = None,
    progress: ProgressCallback = silent,
) -> Insertion:
    """Insert glTF models into the images of a reconstruction, or into its video, at their true size.

    Parameters
    ----------
    scene : Path or str
        COLMAP model folder with its images, or work folder of `capture_video`.
    objects : sequence of ObjectRequest, Path or str
        Models in metres (glTF or GLB), each in free space, or requests with a position and a size.
    scale : float, Path, ScaleResult or None
        Metres per scene unit, a result of `estimate_scale`, its file, or None for `result.json` in the folder.
    out : Path or str
        Video (`out.mp4`), or new folder for one PNG per frame.
    images : Path, optional
        Folder of the images; next to or above the model by default.
    instances : Path, optional
        Masks of possible occluders.
    moving : Path, optional
        Masks of moving people and objects in every frame.
    dense : str, optional
        Dense cloud, or "none".
    up : Up, optional
        The vertical, if it is known.
    tree : Tree, optional
        Release for sizes by the prior and for categories.
    show_interval : bool
        Draw the outlines of the objects at both ends of the scale interval.
    renderer : {"embedded", "blender"}
        The embedded renderer, or Blender's Cycles.
    export : Path, optional
        New folder for the scene in metres.
    layers : Path, optional
        New folder for the layers of each frame.
    frames : tuple of int, optional
        First and last index of the frames to write, inclusive.
    codec : str, optional
        Codec of the video, a key of `insertion.footage.video_writer.CODECS`.
    progress : callable
        Receives the name of a step, its completed part, and its total or None.

    Returns
    -------
    Insertion
        Results of the objects, and warnings.

    Raises
    ------
    InputError
        A file cannot be read or written, or there is no position for an object.

    Examples
    --------
    >>> import insertion, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     made = insertion.insert_objects(
    ...         "data/scenes/demo_room", ["data/models/rocking_horse.glb"], 0.4, f"{folder}/out", frames=(0, 1)
    ...     )
    >>> sorted(made.objects[0].size_m)
    ['height', 'length', 'width']
    """
    from insertion.insertion_scene import open_scene

    used = scale_of_result(scale) if isinstance(scale, ScaleResult) else read_scale(Path(scene), scale)
    request = InsertionRequest(
        scene=SceneSource(
            folder=Path(scene), scale=used, images=images, instances=instances, moving=moving, dense=dense, up=up
        ),
        objects=tuple(item if isinstance(item, ObjectRequest) else ObjectRequest(Path(item)) for item in objects),
        tree=tree,
        out=Path(out),
        codec=codec,
        frames=frames,
        renderer=renderer,
        show_interval=show_interval,
        layers=layers,
        export=export,
    )
    return insert(request, open_scene(request.scene), progress)


def insert(request: InsertionRequest, scene: InsertionScene, progress: ProgressCallback = silent) -> Insertion:
    """Run an insertion into an opened scene.

    Raises
    ------
    InputError
        A file cannot be read or written, or there is no position for an object.
    """
    from insertion.blender.run import export_blend, traced_layers, write_layer_scene
    from insertion.composite.compositor import Compositor, composite_footage
    from insertion.composite.motion_blur import motion_blur
    from insertion.exports.compositing import CompositingLayers
    from insertion.exports.export_folder import LayerWriter, write_exports
    from insertion.footage.footage import VideoFootage
    from insertion.footage.image_writer import frame_writer
    from insertion.placement.placed_object import place_objects
    from metric_base.files import whole_folder

    # 1. Objects at their positions, and the frames to write.
    if request.out is None:
        raise InputError("--out: expected a video or a folder; found none")
    video = scene.footage if isinstance(scene.footage, VideoFootage) else None
    objects = place_objects(request.objects, scene.space, scene.footage.frames, request.tree)
    moving = next((item.model.name for item in objects if item.moves), None)
    if request.renderer == "blender" and moving is not None:
        how = "objects that stand still (--at-time SECONDS or --clip none stops an animation)"
        raise InputError(f"--renderer blender: expected {how}; found {moving}, which moves")
    footage = scene.footage if request.frames is None else scene.footage.between(*request.frames)
    frames, metres_per_unit = footage.frames, scene.scale.metres_per_unit

    # 2. The composited frames, with their layers.
    warnings = list(scene.scale.warnings())
    with ExitStack() as stack:
        source, turned_deg = (video.source, video.turned_deg) if video is not None else (None, 0)
        write = stack.enter_context(frame_writer(request.out, source, turned_deg, request.codec))
        export = request.export and stack.enter_context(whole_folder(request.export, "--export"))
        layers = request.layers and stack.enter_context(whole_folder(request.layers, "--layers"))
        sinks: list[LayerSink] = []
        if export is not None:
            sinks.append(LayerWriter(export, frames, metres_per_unit))
        if layers is not None:
            sinks.append(CompositingLayers(layers, objects, frames, metres_per_unit))
        compositor = Compositor(
            objects,
            scene.light,
            scene.content,
            footage.start_s,
            smooth_look=video is not None,
            interval=scene.scale if request.show_interval else None,
            sinks=sinks,
            motion=None if video is None else motion_blur(video.frames, scene.images, scene.content.cloud),
        )
        stack.enter_context(closing(compositor))
        environment, tracing = compositor.renderers[0].environment, None
        if request.renderer == "blender":
            tracing = traced_layers(objects, footage, scene.content, environment, progress)
        results = composite_footage(compositor, footage, scene.scale, write, tracing=tracing, progress=progress)

        # 3. Files for other programs.
        if layers is not None and any(frame.view is not None for frame in frames):
            write_layer_scene(layers, objects, frames, environment)
        if export is not None:
            warnings += write_exports(export, scene.scene, objects, frames, results)
            warnings += export_blend(export, objects, frames, environment)
            moving_names = [item.model.name for item in objects if item.moves]
            warnings += [f"{name}: is exported in the pose of the first frame" for name in moving_names]
    return Insertion(tuple(results), request.out, tuple(warnings))

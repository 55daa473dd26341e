"""Objects into the pictures of a scene, by one call: `insertion.insert_objects`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
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
    from insertion.insertion_scene import PreparedScene
    from metric_tree.tree import Tree


@dataclass(frozen=True, slots=True, eq=False)
class Insertion:
    """What was inserted.

    objects : one result for each object, with its place and its silhouette in each frame; out : the video or the
    folder that was written; warnings : what could not be checked or written.
    """

    objects: tuple[InsertionResult, ...]
    out: Path
    warnings: tuple[str, ...] = ()


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
    """Draw glTF models into the pictures of a reconstruction, or into its video, at their true size.

    Parameters
    ----------
    scene : a COLMAP model folder with its pictures, or a work folder of `capture_video`
    objects : glTF or GLB files in metres, at a free place each, or `ObjectRequest`s with a place and a size
    scale : metres per scene unit, a result of `estimate_scale`, its file, or None for `result.json` in the folder
    out : a video (`out.mp4`), or a new folder for one PNG a frame
    images : the pictures, by default beside or above the model; instances : masks of what may hide the objects
    moving : masks of people and objects that move, of every frame
    dense : dense cloud, or `none`; up : the vertical, if it is known; tree : for sizes by the prior
    show_interval : whether to draw the outline at both ends of the scale's interval
    renderer : the embedded one, or Blender's Cycles; export : a new folder for the scene in metres
    layers : a new folder for the layers of each picture; frames : the first and the last picture that are drawn
    codec : of the video, one of `insertion.footage.video_writer.CODECS`
    progress : is called with the name of a step, how much of it is done, and of how much or None

    Raises
    ------
    InputError
        A file cannot be read or written, or there is no place for an object.

    Examples
    --------
    >>> import insertion, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     made = insertion.insert_objects(
    ...         "data/scenes/demo_room", ["data/models/rocking_horse.glb"], 0.4, f"{folder}/out"
    ...     )
    >>> sorted(made.objects[0].size_m)
    ['height', 'length', 'width']
    """
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


def open_scene(source: SceneSource) -> PreparedScene:
    """Read a scene for insertion. Raises InputError if a file cannot be read, or the scale is of another scene."""
    from estimator.instances.instance_reader import read_instances
    from estimator.reconstructions.scene_reader import read_scene
    from insertion.footage.footage import PictureFootage, Stills, video_footage
    from insertion.insertion_scene import prepare_scene
    from insertion.scene.frame_masks import cloud_beside, moving_masks

    folder = source.folder
    scene = read_scene(folder, source.dense)
    frames = folder / "frames"
    stills = Stills(scene, source.images or (frames if frames.is_dir() else None))
    footage = video_footage(folder, scene) or PictureFootage(stills)
    default = any((folder / name).exists() for name in ("instances.json", "instances"))
    masks = read_instances(source.instances, scene) if source.instances or default else ()
    source.scale.check(scene, masks if source.instances is None else None)
    prepared = prepare_scene(scene, stills, footage, masks, source.scale, source.up)
    if source.moving is None:
        return prepared
    masks_of = moving_masks(source.moving, scene, footage.shots)
    return replace(prepared, moving=masks_of, cloud=cloud_beside(prepared.cloud, masks_of, footage.shots))


def insert(request: InsertionRequest, prepared: PreparedScene, progress: ProgressCallback = silent) -> Insertion:
    """Run an insertion into an opened scene, which may be of an earlier request.

    Raises
    ------
    InputError
        A file cannot be read or written, or there is no position for an object.
    """
    from insertion.blender.run import export_blend, traced_layers, write_layer_scene
    from insertion.composite import compositor as drawing
    from insertion.exports.compositing import CompositingLayers
    from insertion.exports.export_folder import LayerWriter, write_exports
    from insertion.footage.footage import VideoFootage
    from insertion.footage.image_writer import picture_writer
    from insertion.placement.placed_object import place_objects

    if request.out is None:
        raise InputError("--out: expected a video or a folder; found none")
    video = prepared.footage if isinstance(prepared.footage, VideoFootage) else None
    source, turned = (video.source, video.turned_deg) if video is not None else (None, 0)
    placed = place_objects(prepared, request.objects, request.tree)
    moving = next((item.model.name for item in placed if item.moves), None)
    if request.renderer == "blender" and moving is not None:
        how = "objects that stand still (--at-time SECONDS or --clip none stops an animation)"
        raise InputError(f"--renderer blender: expected {how}; found {moving}, which moves")
    prepared = prepared if request.frames is None else prepared.with_frames(request.frames)
    with (
        picture_writer(request.out, source, turned, request.codec) as write,
        _whole(request.export, "--export") as folder,
        _whole(request.layers, "--layers") as compositing,
    ):
        sinks: list[drawing.LayerSink] = []
        if folder is not None:
            sinks.append(LayerWriter(folder, prepared.footage.shots, prepared.scale.metres_per_unit))
        if compositing is not None:
            sinks.append(CompositingLayers(compositing, prepared, placed))
        results = drawing.insert_objects(
            prepared,
            placed,
            write,
            show_interval=request.show_interval,
            video=video is not None,
            layers=sinks,
            tracer=traced_layers if request.renderer == "blender" else None,
            progress=progress,
        )
        warnings = list(prepared.scale.doubts())
        if compositing is not None and any(shot.view is not None for shot in prepared.footage.shots):
            write_layer_scene(compositing, prepared, placed)
        if folder is not None:
            warnings += [*write_exports(folder, prepared, placed, results), *export_blend(folder, prepared, placed)]
            warnings += [f"{item.model.name}: stands in the export as at first" for item in placed if item.moves]
    return Insertion(tuple(results), request.out, tuple(warnings))


@contextmanager
def _whole(folder: Path | None, option: str) -> Iterator[Path | None]:
    """The folder that an option names, which appears whole; None where nothing is to be written."""
    if folder is None:
        yield None
        return
    from metric_base.files import whole_folder

    with whole_folder(folder, option) as temporary:
        yield temporary

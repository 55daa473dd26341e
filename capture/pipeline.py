"""Reconstruct a video or a folder of images into a work folder, stage by stage."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from capture.caution_files import read_cautions, write_cautions
from capture.frame_poses import FILE_NAME, FramePose, FramePoses, scaled_camera, write_frame_poses
from capture.localisation import localised_frames
from capture.mapping.camera_prior import Lens
from capture.mapping.mapper import ModelReport
from capture.mapping.search import MODEL_STAGES, REPORT, ModelSearch
from capture.mapping.worker import limit_of
from capture.quality_warnings import capture_cautions
from capture.sources.frames import FRAMES_FILE, Frames, Source, make_frames, read_frames, source_of
from capture.sources.video import Video
from capture.work_folder import WorkFolder, content_digest
from estimator.projection.cameras import CAMERA_MODELS
from estimator.reconstructions.colmap import read_colmap
from estimator.records.scene import Scene
from metric_base.errors import InputError
from metric_base.input_files import read_json
from metric_base.progress import NoticeCallback, ProgressCallback, no_notice, silent, with_progress

#: Camera model of the first reconstruction.
FIRST_MODEL = "SIMPLE_RADIAL"
DENSE = ("dense.ply", "dense.ply.vis")
#: Outputs of each stage.
STAGES: dict[str, tuple[str, ...]] = {
    "frames": ("frames", FRAMES_FILE),
    **MODEL_STAGES,
    "poses": (FILE_NAME,),
    "dense": DENSE,
}


@dataclass(frozen=True, slots=True)
class CaptureOptions:
    """Options of a capture."""

    frames: int | None = None  #: Number of frames; None for as many as the motion requires.
    focal_px: float | None = None  #: Focal length in pixels of the source.
    camera_model: str | None = None  #: COLMAP's name; None for the one that fits best.
    dense: bool = False  #: Whether to make `dense.ply`.
    max_time_s: float | None = None  #: Wall time of the reconstruction; None for the processor time of `limit_of`.

    def __post_init__(self) -> None:
        if self.frames is not None and self.frames < 2:
            raise InputError.at("--frames", "number", "2 or more", self.frames)
        if self.focal_px is not None and not 1 < self.focal_px < 1e6:
            raise InputError.at("--focal", "focal length", "pixels of the source, more than 1", self.focal_px)
        if self.camera_model is not None and self.camera_model not in CAMERA_MODELS:
            raise InputError.at("--camera-model", "model", "one of COLMAP's, such as SIMPLE_RADIAL", self.camera_model)
        if self.max_time_s is not None and not 1 <= self.max_time_s < 1e6:
            raise InputError.at("--max-time", "seconds", "1 or more", self.max_time_s)


@dataclass(frozen=True, slots=True, eq=False)
class Capture:
    """Reconstruction of a video or of images."""

    scene: Scene  #: Cameras and points.
    folder: Path  #: Work folder, which `read_scene` and `insert_objects` accept, too.
    cautions: tuple[str, ...]  #: Warnings about every scale of this reconstruction.
    seconds: Mapping[str, float]  #: Wall time of the stages of this run.


def capture_video(
    source: Path | str,
    work: Path | str,
    *,
    frames: int | None = None,
    focal_px: float | None = None,
    camera_model: str | None = None,
    dense: bool = False,
    max_time_s: float | None = None,
    progress: ProgressCallback = silent,
    notice: NoticeCallback = no_notice,
) -> Capture:
    """Reconstruct a scene from a video or a folder of images.

    Parameters
    ----------
    source : Path or str
        The video, or the folder of images.
    work : Path or str
        Folder of all stages. A second call with the same arguments repeats nothing, and files that another program
        wrote are never replaced.
    frames : int, optional
        Number of frames, by default as many as the motion requires.
    focal_px : float, optional
        Focal length in pixels of the source, which is then not refined.
    camera_model : str, optional
        COLMAP's name, by default the one that fits best.
    dense : bool
        Whether to compute dense points, too.
    max_time_s : float, optional
        Wall time of the reconstruction, by default 900 s of processor time, or 6 s per frame if that is more.
    progress : callable
        Called with the name of a step, the number of items done, and their total or None.
    notice : callable
        Called with a sentence about how the dense points are computed.

    Returns
    -------
    Capture

    Raises
    ------
    CaptureFailure
        The capture cannot be used; `failure.code` is the reason, `failure.message` contains advice.
    InputError
        The video or the images cannot be read, or the work folder contains files of other programs.

    Examples
    --------
    >>> import capture, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     result = capture.capture_video("data/scenes/demo_video/video.mp4", folder, frames=8)
    >>> len(result.scene.views)
    8
    """
    folder = WorkFolder(Path(work))
    options = CaptureOptions(frames, focal_px, camera_model, dense, max_time_s)
    with folder.lock():
        reconstruct(Path(source), folder, options, progress, notice)
        scene = read_colmap(folder.path / "sparse" / "0", folder.path)
        return Capture(scene, folder.path, read_cautions(folder.path), dict(folder.seconds))


def reconstruct(
    path: Path,
    work: WorkFolder,
    options: CaptureOptions,
    progress: ProgressCallback = silent,
    notice: NoticeCallback = no_notice,
) -> None:
    """Write frames, `sparse/0`, `frame_poses.json` and `cautions.json` to the work folder, which the caller has locked.

    Stages whose outputs exist and are made from the same inputs are not repeated.

    Raises
    ------
    CaptureFailure
        The capture cannot be used.
    InputError
        The video or the images cannot be read.
    """
    work.check_ownership(STAGES)  # before an hour of work
    source = source_of(path)
    search = _model_search(source, work, options, progress)
    frames, model_digest = search.frames, search.make_sparse()

    def make_poses(part: Path) -> None:
        scene = read_colmap(work.path / "sparse" / "0")
        names = {frame.index: frame.name for frame in frames.chosen}
        if isinstance(source, Video):
            localised = localised_frames(source.frames(), scene, names, source.width)
            poses = list(with_progress(localised, "poses of all frames", progress, len(frames.times_s or ())))
        else:
            views = {view.name: view for view in scene.views}
            poses = []
            for index, name in names.items():
                pose = FramePose(index, None, name, "none")
                if (view := views.get(name)) is not None:
                    n = len(view.point_index)
                    pose = FramePose(index, None, name, "reconstructed", view.rotation, view.translation, n_points=n)
                poses.append(pose)
        camera = scaled_camera(scene.views[0].camera, *frames.size) if frames.one_camera else None
        write_frame_poses(FramePoses(source.path.resolve(), camera, frames.turned_deg, tuple(poses)), part / FILE_NAME)

    def make_dense(part: Path) -> None:
        from capture.dense.patch_match import make_dense_points

        make_dense_points(work.path / "sparse" / "0", work.path / "frames", part / "dense.ply", progress, notice)

    inputs = {"model": model_digest, "frames": search.frames_digest}
    work.stage("poses", inputs, STAGES["poses"], make_poses)
    if options.dense:
        work.stage("dense", inputs, DENSE, make_dense)
    else:
        work.discard_stale("dense", inputs, DENSE)
    report = msgspec.convert(read_json(work.path / REPORT), ModelReport)
    write_cautions(capture_cautions(path, frames, report, options.focal_px is not None), work.path)


def _model_search(source: Source, work: WorkFolder, options: CaptureOptions, progress: ProgressCallback) -> ModelSearch:
    """Choose the frames of a source, and return the search over them."""
    digest: Any
    if isinstance(source, Video):
        digest = content_digest(source.path)
    else:
        digest = [f"{file.name}:{content_digest(file)}" for file in source.files]
    frames_digest = work.stage(
        "frames",
        {"source": digest, "frames": options.frames},
        STAGES["frames"],
        lambda part: make_frames(part, source, options.frames, progress),
    )
    frames = read_frames(work.path)
    limit = limit_of(len(frames.names), options.max_time_s)
    return ModelSearch(work, frames_digest, frames, _lens(frames, options), limit, options.max_time_s, progress)


def _lens(frames: Frames, options: CaptureOptions) -> Lens:
    """Return the knowledge about the camera, in pixels of `frames/`."""
    width, height = frames.file_size
    model, free = options.camera_model or FIRST_MODEL, options.camera_model is None
    if not frames.one_camera:  # the parameters of one camera fit no other
        return Lens(model, None, False, width, height)
    if options.focal_px is not None:
        return Lens(model, options.focal_px * width / frames.size[0], True, width, height)
    wide_px = None
    if frames.fisheye_deg is not None:  # an ideal fisheye lens has so many pixels per radian
        wide_px = math.hypot(width, height) / math.radians(frames.fisheye_deg)
    return Lens(model, frames.chosen[0].focal_px, False, width, height, free, wide_px)

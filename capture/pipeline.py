"""From a video or a folder of pictures to a work folder with a reconstruction, stage by stage."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from capture.frame_poses import FILE_NAME, FramePose, FramePoses, write_frame_poses
from capture.localisation import localised_frames
from capture.mapping.camera_prior import Lens
from capture.mapping.mapper import ModelReport
from capture.mapping.search import MODEL_STAGES, MORE_FRAMES, REPORT, ModelSearch
from capture.mapping.worker import TimeLimit, limit_of
from capture.quality_warnings import capture_cautions, read_cautions, write_cautions
from capture.sources.frames import FRAMES_FILE, Frames, Source, make_frames, read_frames, source_of
from capture.sources.video import Video
from capture.work_folder import WorkFolder, content_digest
from estimator.projection.cameras import CAMERA_MODELS
from estimator.reconstructions.colmap import read_colmap
from estimator.records.scene import Camera, Scene
from metric_base.errors import InputError
from metric_base.input_files import read_json
from metric_base.progress import NoticeCallback, ProgressCallback, no_notice, silent, with_progress

#: The camera model that is tried first.
SIMPLEST = "SIMPLE_RADIAL"
DENSE = ("dense.ply", "dense.ply.vis")
#: What each stage writes.
STAGES: dict[str, tuple[str, ...]] = {
    "frames": ("frames", FRAMES_FILE),
    **MODEL_STAGES,
    "poses": (FILE_NAME,),
    "dense": DENSE,
}


@dataclass(frozen=True, slots=True)
class CaptureOptions:
    """What the user asks for.

    frames : how many to choose, None for as many as the motion asks for; focal_px : in pixels of the source;
    camera_model : COLMAP's name, None for the one that fits; dense : whether to make `dense.ply`; max_time_s : wall
    time for the reconstruction of the frames, None for as much processor time as `limit_of` has it.
    """

    frames: int | None = None
    focal_px: float | None = None
    camera_model: str | None = None
    dense: bool = False
    max_time_s: float | None = None

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
    """A reconstruction of a video or of pictures.

    scene : its cameras and points; folder : the work folder, which `read_scene` and `insert_objects` take, too;
    cautions : what to know about every scale that rests on it; seconds : wall time of the stages that were made.
    """

    scene: Scene
    folder: Path
    cautions: tuple[str, ...]
    seconds: Mapping[str, float]


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
    """A scene from a video or a folder of pictures.

    Parameters
    ----------
    source : the video, or the folder of pictures
    work : folder that keeps every stage: a second call with the same arguments makes nothing again, and nothing is
        replaced in it that another program wrote
    frames : how many frames to use, by default as many as the motion asks for
    focal_px : focal length in pixels of the source, which is then not refined
    camera_model : COLMAP's name, by default the one that fits
    dense : whether to make dense points, too
    max_time_s : wall time for the reconstruction, by default 900 s of processor time, or 6 s a frame if that is more
    progress : is called with the name of a step, how much of it is done, and of how much or None
    notice : is called with a sentence on how the dense points are made

    Raises
    ------
    CaptureFailure
        The capture cannot be used: `failure.code` says why, `failure.message` what to record instead.
    InputError
        The video or the pictures cannot be read, or the work folder holds files of others.

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
    """Frames, `sparse/0`, `frame_poses.json` and `cautions.json` in the work folder, which the caller has locked.

    Stages whose outputs are there, made from the same inputs, are not made again.

    Raises
    ------
    CaptureFailure
        The capture cannot be used, with a code and what to record instead.
    InputError
        The video or the pictures cannot be read.
    """
    work.check_ownership(STAGES)  # before an hour of work, not after
    source = source_of(path)
    search = _model_search(path, source, work, options, progress)
    frames, frames_digest, model_digest = search.frames, search.frames_digest, search.make_sparse()
    work.stage(
        "poses",
        {"model": model_digest, "frames": frames_digest},
        STAGES["poses"],
        lambda part: _make_poses(part, source, frames, read_colmap(work.path / "sparse" / "0"), progress),
    )
    dense_inputs = {"model": model_digest, "frames": frames_digest}
    if options.dense:
        work.stage("dense", dense_inputs, DENSE, lambda part: _make_dense(part, work.path, progress, notice))
    else:
        work.discard_stale("dense", dense_inputs, DENSE)
    report = msgspec.convert(read_json(work.path / REPORT), ModelReport)
    write_cautions(capture_cautions(path, frames, report, options.focal_px is not None), work.path)


def _model_search(
    path: Path, source: Source, work: WorkFolder, options: CaptureOptions, progress: ProgressCallback
) -> ModelSearch:
    """The ladder over the frames of a source; of a video whose frames show too little in common, over more of them."""
    digest = content_digest(path) if path.is_file() else _folder_digest(source)
    by_default: dict[str, Any] = {"source": digest, "frames": options.frames}
    more = by_default | {"times": MORE_FRAMES}

    def over(inputs: dict[str, Any], limit: TimeLimit | None) -> ModelSearch:
        times = inputs.get("times", 1)
        frames_digest = work.stage(
            "frames", inputs, STAGES["frames"], lambda part: make_frames(part, source, options.frames, progress, times)
        )
        frames = read_frames(work.path)
        limit = limit or limit_of(len(frames.names), options.max_time_s)
        is_video = isinstance(source, Video)
        return ModelSearch(
            work, frames_digest, frames, _lens(frames, options), is_video, options.max_time_s, limit, progress
        )

    if work.is_made("frames", more):
        return over(more, None)
    first = over(by_default, None)
    if options.frames is not None or not first.lacks_frames():
        return first
    return over(more, None if options.max_time_s is None else first.limit)


def _folder_digest(source: Source) -> list[str]:
    assert not isinstance(source, Video)
    return [f"{file.name}:{content_digest(file)}" for file in source.files]


def _lens(frames: Frames, options: CaptureOptions) -> Lens:
    """The focal length is given in pixels of the source; the frames may be smaller."""
    width, height = frames.size
    model, free = options.camera_model or SIMPLEST, options.camera_model is None
    if not frames.one_camera:  # the parameters of one fit no other
        return Lens(model, None, False, width, height)
    if options.focal_px is None:
        rough = frames.times_s is not None
        return Lens(model, frames.focals_px[0], False, width, height, rough, free, wide_px=_fisheye_focal_px(frames))
    return Lens(model, options.focal_px * width / frames.source_size[0], True, width, height)


def _fisheye_focal_px(frames: Frames) -> float | None:
    """Focal length of an ideal fisheye lens with the stated field of view, in pixels for a radian from the axis."""
    if frames.fisheye_deg is None:
        return None
    return math.hypot(*frames.size) / math.radians(frames.fisheye_deg)


def _make_poses(part: Path, source: Source, frames: Frames, scene: Scene, progress: ProgressCallback) -> None:
    names = dict(zip(frames.indices, frames.names, strict=True))
    if isinstance(source, Video):
        localised = localised_frames(source.frames(), scene, names, source.width)
        poses = list(with_progress(localised, "poses of all frames", progress, len(frames.times_s or ())))
    else:
        views = {view.name: view for view in scene.views}
        poses = [_picture_pose(index, name, views.get(name)) for index, name in names.items()]
    camera = _source_camera(scene.views[0].camera, frames) if frames.one_camera else None
    write_frame_poses(FramePoses(source.path.resolve(), camera, frames.turned_deg, tuple(poses)), part / FILE_NAME)


def _make_dense(part: Path, work: Path, progress: ProgressCallback, notice: NoticeCallback) -> None:
    from capture.dense.patch_match import make_dense_points

    make_dense_points(work / "sparse" / "0", work / "frames", part / "dense.ply", progress, notice)


def _picture_pose(index: int, name: str, view: Any) -> FramePose:
    if view is None:
        return FramePose(index, None, name, "none")
    return FramePose(
        index, None, name, "reconstructed", view.rotation, view.translation, n_points=len(view.point_index)
    )


def _source_camera(camera: Camera, frames: Frames) -> Camera:
    """The camera at the source's full size: lengths in pixels grow with it, distortion stays."""
    width, height = frames.source_size
    factors = {"f": width / camera.width, "fx": width / camera.width, "fy": height / camera.height}
    factors |= {"cx": width / camera.width, "cy": height / camera.height}
    names = CAMERA_MODELS[camera.model][1]
    params = np.array([value * factors.get(name, 1.0) for name, value in zip(names, camera.params, strict=True)])
    return Camera(camera.model, width, height, params)

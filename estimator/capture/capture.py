"""From a video or a folder of pictures to a work folder with a reconstruction, stage by stage."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from estimator.capture.cameras.lens import Lens
from estimator.capture.cautions import capture_cautions, read_cautions, write_cautions
from estimator.capture.frame_poses import FILE_NAME, FramePose, FramePoses, write_frame_poses
from estimator.capture.frames import FRAMES_FILE, Frames, Source, make_frames, read_frames, source_of
from estimator.capture.localisation import localised_frames
from estimator.capture.mapping.evidence import CaptureEvidence, Pair
from estimator.capture.mapping.failures import CaptureFailure, Failure, after_all, failure
from estimator.capture.mapping.gates import is_disputed
from estimator.capture.mapping.reconstruction import make_features, make_matches, make_model
from estimator.capture.mapping.rungs import RUNGS, Rung, model_rank, next_rungs, predicted_s
from estimator.capture.mapping.time_limit import OutOfTime, TimeLimit, limit_of
from estimator.capture.video import Video
from estimator.capture.work_folder import WorkFolder, content_digest
from estimator.reconstructions.cameras import CAMERA_MODELS
from estimator.reconstructions.colmap import read_colmap
from estimator.records.scene import Camera, Scene
from metric_base.errors import InputError
from metric_base.input_files import read_json
from metric_base.progress import NoticeCallback, ProgressCallback, no_notice, silent, with_progress

__all__ = ["Capture", "CaptureOptions", "capture_video", "reconstruct"]

REPORT = "reconstruction.json"
#: Features and matches, kept so that a later stage can be made again.
DATABASES = "databases"
#: The camera model that is tried first.
SIMPLEST = "SIMPLE_RADIAL"
DENSE = ("dense.ply", "dense.ply.vis")
#: What each stage writes.
STAGES: dict[str, tuple[str, ...]] = {
    "frames": ("frames", FRAMES_FILE),
    "model": ("sparse", REPORT),
    "poses": (FILE_NAME,),
    "dense": DENSE,
}
for _rung in RUNGS:
    for _stage in ("features", "matches"):
        STAGES[_stage + _rung.suffix] = tuple(f"{DATABASES}/{_stage}{_rung.suffix}.{end}" for end in ("db", "json"))
    STAGES[f"mapping{_rung.suffix}"] = (f"{DATABASES}/model{_rung.suffix}", f"{DATABASES}/model{_rung.suffix}.json")


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
    >>> import estimator, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     capture = estimator.capture_video("data/scenes/demo_video/video.mp4", folder, frames=8)
    >>> len(capture.scene.views)
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
    inputs = {"source": content_digest(path) if path.is_file() else _folder_digest(source), "frames": options.frames}
    frames_digest = work.stage(
        "frames", inputs, STAGES["frames"], lambda part: make_frames(part, source, options.frames, progress)
    )
    frames = read_frames(work.path)
    lens = _lens(frames, options)
    climb = _Climb(work, frames_digest, frames, lens, isinstance(source, Video), options.max_time_s, progress)
    model_digest = climb.make_sparse()
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
    report = read_json(work.path / REPORT)
    write_cautions(capture_cautions(path, frames, report, options.focal_px is not None), work.path)


@dataclass(frozen=True, slots=True, eq=False)
class _Climb:
    """The ladder from frames to a model: what every rung starts from."""

    work: WorkFolder
    frames_digest: str
    frames: Frames
    lens: Lens
    in_order: bool
    max_time_s: float | None
    progress: ProgressCallback

    def make_sparse(self) -> str:
        """`sparse/0` by the first rung of the ladder that places nearly all frames, or the one that places most.

        Where the path of the global mapper is disputed, the next rung is tried too. Returns the digest of the stage.

        Raises
        ------
        CaptureFailure
            None of the rungs that may help, and for which there is time, gives a model that can be used; the failure is
            that of the rung that placed most frames.
        """
        limit = limit_of(len(self.frames.names), self.max_time_s)
        tried: list[tuple[Rung, str, dict[str, Any]]] = []
        above: tuple[Rung, ...] = RUNGS
        left = list[str]()
        while above:
            rung, *others = above
            if tried and self._predicted_s(rung, tried[-1][0], limit) > limit.left_s:
                left, above = [*left, rung.name], tuple(others)
                continue
            try:
                digest = self._rung_digest(rung, limit)
            except OutOfTime:
                left += [row.name for row in above]
                break
            report = read_json(self.work.path / DATABASES / f"model{rung.suffix}.json")
            tried.append((rung, digest, report))
            seen = None if report["failure"] is None else Failure(**report["failure"])
            above = next_rungs(rung, seen, _placed_count(report), self._evidence(rung), _is_disputed(report))
        return self._chosen(tried, left)

    def _predicted_s(self, rung: Rung, done: Rung, limit: TimeLimit) -> float:
        spent = self.work.processor_s if limit.of_processor else self.work.seconds
        return predicted_s(rung, done, spent, len(self.frames.names), self.in_order)

    def _chosen(self, tried: list[tuple[Rung, str, dict[str, Any]]], left: list[str]) -> str:
        """The stage `model` of the best of the rungs, rows of rung, digest and report; left : for lack of time."""
        if not tried:
            raise CaptureFailure(after_all(failure("out_of_time", "the frames could not be placed in time"), [], left))
        rung, digest, report = max(tried, key=lambda row: self._rank(row[2]))
        ended = [{"rung": row.name, "code": _code(result), "placed": _placed_count(result)} for row, _, result in tried]
        report |= {"rung": rung.name if report["failure"] is None else None, "tried": ended, "left": left}
        digest = self.work.stage(
            "model",
            {"rung": digest, "tried": ended},
            STAGES["model"],
            lambda part: _make_chosen(part, self.work.path / DATABASES / f"model{rung.suffix}", report),
        )
        if report["failure"] is not None:
            raise CaptureFailure(after_all(Failure(**report["failure"]), [row.name for row, _, _ in tried], left))
        return digest

    def _rank(self, report: dict[str, Any]) -> tuple[bool, bool, int, float]:
        failed, dispute = report["failure"] is not None, report["disagreement"] if _is_disputed(report) else 0.0
        return model_rank(failed, _placed_count(report), len(self.frames.names), dispute)

    def _rung_digest(self, rung: Rung, limit: TimeLimit) -> str:
        """The stages of one rung: features, matches and, if they can be used, a model; the digest of the last."""
        work, frames, lens = self.work, self.frames, self.lens
        pictures, databases, end = work.path / "frames", work.path / DATABASES, rung.suffix
        said: Any = {"limit": limit, "progress": self.progress}
        features_digest = work.stage(
            f"features{end}",
            {"frames": self.frames_digest, "lens": [lens.model, lens.focal_px]},
            STAGES[f"features{end}"],
            lambda part: make_features(_make_folder(part / DATABASES), pictures, _cameras(frames, lens), rung, **said),
        )
        matches_digest = work.stage(
            f"matches{end}",
            {"features": features_digest},
            STAGES[f"matches{end}"],
            lambda part: make_matches(
                _make_folder(part / DATABASES), databases, frames.names, self.in_order, rung, **said
            ),
        )
        evidence, model = self._evidence(rung), f"{DATABASES}/model{end}"

        def make(part: Path) -> None:
            _make_folder(part / DATABASES)
            make_model(part / model, databases / f"matches{end}.db", pictures, evidence, lens, **said)

        inputs = {"matches": matches_digest, "fixed": lens.fixed, "free": lens.free, "wide": lens.wide_px}
        inputs["time"] = self.max_time_s  # with more of it other lenses may come to an end
        return work.stage(f"mapping{end}", inputs, STAGES[f"mapping{end}"], make)

    def _evidence(self, rung: Rung) -> CaptureEvidence:
        databases, frames = self.work.path / DATABASES, self.frames
        keypoints = read_json(databases / f"features{rung.suffix}.json")["keypoints"]
        pairs = tuple(_pair(row) for row in read_json(databases / f"matches{rung.suffix}.json")["pairs"])
        counts = np.array([keypoints.get(name, 0) for name in frames.names], dtype=np.int64)
        return CaptureEvidence(frames.names, counts, pairs, frames.size, frames.edges)


def _placed_count(report: dict[str, Any]) -> int:
    return 0 if report["model"] is None else int(report["model"]["registered"])


def _is_disputed(report: dict[str, Any]) -> bool:
    return is_disputed(report.get("mapper", ""), report.get("disagreement"))


def _code(report: dict[str, Any]) -> str | None:
    return None if report["failure"] is None else str(report["failure"]["code"])


def _make_chosen(part: Path, model: Path, report: dict[str, Any]) -> None:
    """`sparse/0` and `reconstruction.json`, of the rung that counts."""
    if report["failure"] is None:
        shutil.copytree(model, part / "sparse" / "0")
    (part / REPORT).write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")


def _make_folder(folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    return folder


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


def _cameras(frames: Frames, lens: Lens) -> list[tuple[Lens, list[str]]]:
    """The lens of each camera, as it is stated, and its frames."""
    if frames.one_camera:
        return [(lens, frames.names)]
    return [
        (Lens(lens.model, focal, False, width, height), names)
        for (width, height, focal), names in frames.cameras().items()
    ]


def _pair(row: list[Any]) -> Pair:
    first, second, matches, inliers, _, planar, moved, homography = row
    matrix = None if homography is None else np.asarray(homography, dtype=np.float64)
    return Pair(first, second, matches, inliers, planar, moved, matrix)


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
    from estimator.capture.dense.dense_points import make_dense_points

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

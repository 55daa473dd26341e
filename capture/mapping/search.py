"""The search for a model of frames: each rung of the ladder has its features, matches and mapping as stages."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from capture.mapping.camera_prior import Lens
from capture.mapping.features import (
    STRATEGIES,
    FeatureStrategy,
    make_features,
    make_matches,
    model_rank,
    next_strategies,
    predicted_s,
)
from capture.mapping.mapper import make_model
from capture.mapping.match_graph import CaptureEvidence, Pair
from capture.mapping.refusals import CaptureFailure, Failure, after_all, failure, is_disputed, most_are_linked
from capture.mapping.worker import OutOfTime, TimeLimit
from capture.sources.frames import Frames
from capture.work_folder import WorkFolder
from metric_base.input_files import read_json
from metric_base.progress import ProgressCallback

REPORT = "reconstruction.json"
#: Features and matches, kept so that a later stage can be made again.
DATABASES = "databases"
#: A video whose frames show too little in common is searched again with so many times as many: of a walk over snow
#: (`snow_walk` as a video of ten frames a second) 49 frames fall into groups of 20, 9 and less; 90 are all placed.
MORE_FRAMES = 2
#: Failures of frames that are too far apart.
OF_THE_LINKS = frozenset({"several_places", "too_few_frames"})
#: What each stage writes.
MODEL_STAGES: dict[str, tuple[str, ...]] = {"model": ("sparse", REPORT)}
for _rung in STRATEGIES:
    _end = _rung.suffix
    for _stage in ("features", "matches"):
        MODEL_STAGES[_stage + _end] = tuple(f"{DATABASES}/{_stage}{_end}.{kind}" for kind in ("db", "json"))
    MODEL_STAGES[f"mapping{_end}"] = (f"{DATABASES}/model{_end}", f"{DATABASES}/model{_end}.json")


@dataclass(frozen=True, slots=True, eq=False)
class ModelSearch:
    """The ladder from frames to a model: what every rung starts from."""

    work: WorkFolder
    frames_digest: str
    frames: Frames
    lens: Lens
    in_order: bool
    max_time_s: float | None
    limit: TimeLimit
    progress: ProgressCallback

    def lacks_frames(self) -> bool:
        """Whether a video has more frames, and the first rung, which this makes, links too few of these."""
        n, times_s = len(self.frames.names), self.frames.times_s
        if times_s is None or len(times_s) < MORE_FRAMES * n:
            return False
        try:
            self._rung_digest(STRATEGIES[0], self.limit)
        except OutOfTime:
            return False
        code = _code(read_json(self.work.path / DATABASES / f"model{STRATEGIES[0].suffix}.json"))
        return code in OF_THE_LINKS and not most_are_linked(self._evidence(STRATEGIES[0]))

    def make_sparse(self) -> str:
        """`sparse/0` by the first rung of the ladder that places nearly all frames, or the one that places most.

        Where the path of the global mapper is disputed, the next rung is tried too. Returns the digest of the stage.

        Raises
        ------
        CaptureFailure
            None of the rungs that may help, and for which there is time, gives a model that can be used; the failure is
            that of the rung that placed most frames.
        """
        limit = self.limit
        tried: list[tuple[FeatureStrategy, str, dict[str, Any]]] = []
        above: tuple[FeatureStrategy, ...] = STRATEGIES
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
            above = next_strategies(rung, seen, _placed_count(report), self._evidence(rung), is_disputed(report))
        return self._chosen(tried, left)

    def _predicted_s(self, rung: FeatureStrategy, done: FeatureStrategy, limit: TimeLimit) -> float:
        spent = self.work.processor_s if limit.of_processor else self.work.seconds
        return predicted_s(rung, done, spent, len(self.frames.names), self.in_order)

    def _chosen(self, tried: list[tuple[FeatureStrategy, str, dict[str, Any]]], left: list[str]) -> str:
        """The stage `model` of the best of the rungs, rows of rung, digest and report; left : for lack of time."""
        if not tried:
            raise CaptureFailure(after_all(failure("out_of_time", "the frames could not be placed in time"), [], left))
        rung, digest, report = max(tried, key=lambda row: self._rank(row[2]))
        n = len(self.frames.names)
        ended = [
            {"rung": row.name, "code": _code(result), "placed": _placed_count(result), "frames": n}
            for row, _, result in tried
        ]
        report |= {"rung": rung.name if report["failure"] is None else None, "tried": ended, "left": left}
        digest = self.work.stage(
            "model",
            {"rung": digest, "tried": ended},
            MODEL_STAGES["model"],
            lambda part: _make_chosen(part, self.work.path / DATABASES / f"model{rung.suffix}", report),
        )
        if report["failure"] is not None:
            raise CaptureFailure(after_all(Failure(**report["failure"]), [row.name for row, _, _ in tried], left))
        return digest

    def _rank(self, report: dict[str, Any]) -> tuple[bool, bool, int, float]:
        failed, dispute = report["failure"] is not None, report["disagreement"] if is_disputed(report) else 0.0
        return model_rank(failed, _placed_count(report), len(self.frames.names), dispute)

    def _rung_digest(self, rung: FeatureStrategy, limit: TimeLimit) -> str:
        """The stages of one rung: features, matches and, if they can be used, a model; the digest of the last."""
        work, frames, lens = self.work, self.frames, self.lens
        pictures, databases, end = work.path / "frames", work.path / DATABASES, rung.suffix
        said: Any = {"limit": limit, "progress": self.progress}
        features_digest = work.stage(
            f"features{end}",
            {"frames": self.frames_digest, "lens": [lens.model, lens.focal_px]},
            MODEL_STAGES[f"features{end}"],
            lambda part: make_features(_make_folder(part / DATABASES), pictures, _cameras(frames, lens), rung, **said),
        )
        matches_digest = work.stage(
            f"matches{end}",
            {"features": features_digest},
            MODEL_STAGES[f"matches{end}"],
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
        return work.stage(f"mapping{end}", inputs, MODEL_STAGES[f"mapping{end}"], make)

    def _evidence(self, rung: FeatureStrategy) -> CaptureEvidence:
        databases, frames = self.work.path / DATABASES, self.frames
        keypoints = read_json(databases / f"features{rung.suffix}.json")["keypoints"]
        pairs = tuple(_pair(row) for row in read_json(databases / f"matches{rung.suffix}.json")["pairs"])
        counts = np.array([keypoints.get(name, 0) for name in frames.names], dtype=np.int64)
        return CaptureEvidence(frames.names, counts, pairs, frames.size, frames.edges)


def _placed_count(report: dict[str, Any]) -> int:
    return 0 if report["model"] is None else int(report["model"]["registered"])


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

"""Search for a model of the frames: each strategy has its features, matches and mapping as stages."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import msgspec

from capture.mapping.camera_prior import Lens
from capture.mapping.features import MAIN, POOLED, QUICK, STRATEGIES, FeatureStrategy
from capture.mapping.mapper import ModelReport, make_model
from capture.mapping.match_graph import MatchGraph
from capture.mapping.refusals import (
    MIN_FRAMES,
    MIN_WARNED_FOCAL_STD,
    MIN_WARNED_PATTERN,
    MIN_WHOLE_RATIO,
    CaptureFailure,
    refusal,
)
from capture.mapping.worker import OutOfTime, TimeLimit, run_worker
from capture.sources.frames import Frames
from capture.work_folder import WorkFolder
from metric_base.input_files import read_json
from metric_base.progress import ProgressCallback

REPORT = "reconstruction.json"
#: File that lists each strategy with its seconds and outcome.
SUMMARY = "capture.json"
SUMMARY_SCHEMA = "metric-tree/capture/1"
#: Features and matches, kept so that a later stage can be repeated.
DATABASES = "databases"
#: Minimum longer side in pixels for the quick strategy: of images, where it costs a tenth of the main one, and of
#: frames of videos, where it rarely fails because they overlap. `demo_video` took 144 s of processor time without it.
MIN_QUICK_SIDE, MIN_QUICK_VIDEO_SIDE = 1500, 600
#: Failures due to the motion of the camera, which other features do not change.
MOTION_FAILURES = frozenset({"static_camera", "pure_rotation"})
#: Processor time of pooled features of 1,000 pixels, relative to the main strategy at the same number of pixels,
#: and of guided matching relative to its matching.
POOLED_FEATURE_COST, POOLED_MATCH_COST = 5.0, 2.0
#: Maximum predicted processor time of the pooled strategy in seconds, a minute on two cores.
MAX_POOLED_S = 120.0
#: Outputs of each stage.
MODEL_STAGES: dict[str, tuple[str, ...]] = {"model": ("sparse", REPORT, SUMMARY)}
for _strategy in STRATEGIES:
    _end = _strategy.suffix
    for _stage in ("features", "matches"):
        MODEL_STAGES[_stage + _end] = tuple(f"{DATABASES}/{_stage}{_end}.{kind}" for kind in ("db", "json"))
    MODEL_STAGES[f"mapping{_end}"] = (f"{DATABASES}/model{_end}", f"{DATABASES}/model{_end}.json")


#: Inputs of a stage, or a request of the worker, as JSON.
Inputs = dict[str, Any]
#: A strategy, the digest of its last stage and its report.
Run = tuple[FeatureStrategy, str, ModelReport]


@dataclass(frozen=True, slots=True, eq=False)
class ModelSearch:
    """Search for a model of given frames."""

    work: WorkFolder
    frames_digest: str  #: Digest of the stage that made the frames.
    frames: Frames
    lens: Lens
    limit: TimeLimit
    max_time_s: float | None  #: Wall time given by the user.
    progress: ProgressCallback

    @property
    def is_video(self) -> bool:
        """Whether the frames are from a video, in order."""
        return self.frames.times_s is not None

    def make_sparse(self) -> str:
        """Make `sparse/0` of the best model, and return the digest of the stage.

        The quick strategy is tried on large images, and used if its model has all frames and no warning, or more frames
        than that of the main one; the pooled one is tried if the main one placed too few frames. The best model is
        kept, also if the time ends a later strategy.

        Raises
        ------
        CaptureFailure
            No strategy found a model that can be used; the failure is that of the best model.
        """
        runs: list[Run] = []
        out_of_time: list[str] = []
        for strategy in STRATEGIES:
            if not self.is_worthwhile(strategy, [report for _, _, report in runs]):
                continue
            try:
                runs.append((strategy, *self._run(strategy)))
            except OutOfTime:
                out_of_time.append(strategy.name)
        left = f" (left for lack of time, see --max-time: {'; '.join(out_of_time)})" if out_of_time else ""
        if not runs:
            raise CaptureFailure(refusal("out_of_time", f"the frames could not be placed in time{left}"))
        strategy, digest, best = best_run(runs)
        rows = [
            {
                "strategy": tried.name,
                "code": None if report.failure is None else report.failure.code,
                "placed": report.n_placed,
                "frames": len(self.frames.chosen),
                "processor_s": round(sum(self._seconds(tried).values()), 1),
                "model": msgspec.to_builtins(report.model),
            }
            for tried, _, report in runs
        ]
        summary = {"schema": SUMMARY_SCHEMA, "strategy": strategy.name, "strategies": rows}

        def make(part: Path) -> None:
            if best.failure is None:
                shutil.copytree(self.work.path / DATABASES / f"model{strategy.suffix}", part / "sparse" / "0")
            for name, document in ((REPORT, msgspec.to_builtins(best)), (SUMMARY, summary)):
                (part / name).write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")

        inputs = {"strategy": digest, "tried": [tried.name for tried, _, _ in runs]}
        digest = self.work.stage("model", inputs, MODEL_STAGES["model"], make)
        if best.failure is not None:
            raise CaptureFailure(replace(best.failure, message=best.failure.message + left))
        return digest

    def is_worthwhile(self, strategy: FeatureStrategy, reports: list[ModelReport]) -> bool:
        """Return whether a strategy may improve on the strategies before it."""
        n = len(self.frames.chosen)
        if strategy is QUICK:
            min_side = MIN_QUICK_VIDEO_SIDE if self.is_video else MIN_QUICK_SIDE
            return max(self.frames.file_size) >= min_side and n >= MIN_FRAMES
        if strategy is MAIN:
            return not reports or not is_certain(reports[-1], n)
        if not reports or n < MIN_FRAMES or reports[-1].n_placed >= MIN_WHOLE_RATIO * n:
            return False
        if reports[-1].failure is not None and reports[-1].failure.code in MOTION_FAILURES:
            return False
        spent = self._seconds(MAIN)
        pixels = min(1.0, POOLED.max_side / max(self.frames.file_size)) ** 2
        predicted_s = spent["features"] * POOLED_FEATURE_COST * pixels + spent["matches"] * POOLED_MATCH_COST * pixels
        return predicted_s <= MAX_POOLED_S

    def _seconds(self, strategy: FeatureStrategy) -> dict[str, float]:
        """Return the processor time of each stage of a strategy."""
        stages = ("features", "matches", "mapping")
        return {stage: self.work.processor_s.get(stage + strategy.suffix, 0.0) for stage in stages}

    def _run(self, strategy: FeatureStrategy) -> tuple[str, ModelReport]:
        """Make the features, matches and model of a strategy; return the digest of the last stage and its report."""
        frames, lens, end = self.frames, self.lens, strategy.suffix
        images, databases = self.work.path / "frames", self.work.path / DATABASES
        cameras = [(lens, frames.names)]
        if not frames.one_camera:
            cameras = [
                (Lens(lens.model, focal_px, False, width, height), names)
                for (width, height, focal_px), names in frames.cameras().items()
            ]
        inputs: Inputs = {"frames": self.frames_digest, "lens": [lens.model, lens.focal_px]}
        options: Inputs = {"strategy": asdict(strategy)}
        request = options | {
            "images": str(images),
            "camera_model": lens.model,
            "cameras": [
                {"params": "" if one.focal_px is None else ",".join(map(repr, one.params)), "names": names}
                for one, names in cameras
            ],
        }
        digest = self._worker_stage(f"features{end}", inputs, "features", request)
        request = options | {"names": frames.names, "in_order": self.is_video}
        features = databases / f"features{end}.db"
        digest = self._worker_stage(f"matches{end}", {"features": digest}, "matches", request, features)
        graph = MatchGraph.read(databases, end, frames.names, frames.file_size, frames.edges)
        inputs = {"matches": digest, "fixed": lens.fixed, "free": lens.free, "wide": lens.wide_px}
        inputs["time"] = self.max_time_s  # with more time the model may be better
        matches = databases / f"matches{end}.db"

        def make(part: Path) -> None:
            make_model(part / f"model{end}", matches, images, graph, lens, limit=self.limit, progress=self.progress)

        digest = self._stage(f"mapping{end}", inputs, make)
        return digest, msgspec.convert(read_json(databases / f"model{end}.json"), ModelReport)

    def _worker_stage(self, name: str, inputs: Inputs, step: str, request: Inputs, source: Path | None = None) -> str:
        """Make the database of a step of the worker, which begins as a copy of `source`, and its result as JSON."""

        def make(part: Path) -> None:
            database = part / f"{name}.db"
            if source is not None:
                shutil.copyfile(source, database)
            complete = request | {"database": str(database)}
            result = run_worker(step, complete, part, progress=self.progress, limit=self.limit)
            (part / f"{name}.json").write_text(json.dumps(result), encoding="utf-8")

        return self._stage(name, inputs, make)

    def _stage(self, name: str, inputs: Inputs, make: Callable[[Path], None]) -> str:
        """Make a stage in the folder `databases` of its part, and return its digest."""

        def make_in_databases(part: Path) -> None:
            (part / DATABASES).mkdir()
            make(part / DATABASES)

        return self.work.stage(name, inputs, MODEL_STAGES[name], make_in_databases)


def best_run(runs: list[Run]) -> Run:
    """Return the run of the best model: usable models first, then the most frames, then the largest images.

    A quick model that raised a doubt is used only if it has more frames than that of the main strategy. On a straight
    drive (`carnd_highway`) the quick model has a focal length of 0.58 with a standard deviation of 8 %, and the main
    model of the same frames 1.43 with 20 %, which is refused.
    """
    main_placed = max((report.n_placed for strategy, _, report in runs if strategy is MAIN), default=-1)
    counted = [run for run in runs if run[0] is not QUICK or run[2].n_placed > main_placed]
    return max(counted, key=lambda run: (run[2].failure is None, run[2].n_placed, run[0].max_side))


def is_certain(report: ModelReport, n_frames: int) -> bool:
    """Return whether a model has all frames, a determined focal length and residuals with almost no pattern."""
    model = report.model
    if report.failure is not None or model is None or model.registered < n_frames:
        return False
    is_determined = report.focal_held or (model.focal_deviation or 1.0) < MIN_WARNED_FOCAL_STD
    return is_determined and model.pattern < MIN_WARNED_PATTERN

"""The two mappers, which must agree, run on the matches through one lens."""

from __future__ import annotations

import shutil
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from estimator.capture.mapping.evidence import CaptureEvidence, ModelShape, model_disagreement, model_shape
from estimator.capture.mapping.failures import Failure
from estimator.capture.mapping.gates import model_failure
from estimator.capture.mapping.lens import Lens
from estimator.capture.mapping.time_limit import TimeLimit
from estimator.capture.mapping.worker_process import start_worker, wait_for_worker
from metric_base.progress import ProgressCallback

__all__ = ["Mapped", "MappingTask", "mapped_frames"]

#: Threads of each of the two mappers, which run at once. With one the same matches give the same model; with more the
#: sums of the adjustment are added in another order each time, which moves a focal length by up to 1 %.
MAPPING_THREADS = 1
#: Frames that the global mapper checks the incremental one on; it takes twice as long for as many.
CHECKED = 50


@dataclass(frozen=True, slots=True, eq=False)
class Mapped:
    """What the two mappers made.

    A failure that it shows, its shape and folder, whether the focal length was held; params : of its camera;
    seconds : that it took; lens_choice : the scores of camera models and the one that was chosen, where several were
    compared.
    """

    failure: Failure | None = None
    shape: ModelShape | None = None
    disagreement: float | None = None
    model: Path | None = None
    focal_held: bool = False
    params: tuple[float, ...] = ()
    seconds: float = 0.0
    lens_choice: dict[str, Any] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class MappingTask:
    """What every mapping of one rung starts from.

    part : folder to work in; matches : database of the matches; pictures; evidence : what frames and matches show;
    progress; limit : when it must have ended.
    """

    part: Path
    matches: Path
    pictures: Path
    evidence: CaptureEvidence
    progress: ProgressCallback
    limit: TimeLimit

    def below(self, name: str, seconds: float) -> MappingTask:
        """The same in a folder of its own, within so many seconds."""
        folder = self.part / name
        folder.mkdir()
        return replace(self, part=folder, limit=self.limit.within(seconds))


def mapped_frames(task: MappingTask, lens: Lens, focal_last: bool = False) -> Mapped:
    """Both mappers at once, and whether what they made can be used.

    focal_last : the focal length is held until all frames have a place. A lens that differs from the one that the
    matches were verified with verifies them again: what an uncalibrated fisheye picture shows at its border fits no
    fundamental matrix.

    Raises
    ------
    OutOfTime
        They had not ended at the task's limit.
    """
    part, evidence, started = task.part, task.evidence, time.monotonic()
    matches = task.matches
    if lens.start is not None:
        matches = part / "verified.db"
        shutil.copyfile(task.matches, matches)
        process = start_worker("verification", {"database": str(matches), "lens": _lens_request(lens)}, part)
        wait_for_worker(process, "verification", part / "verification.log", limit=task.limit)
    requests = {
        step: _request(task, step, lens, matches) | {"focal_last": focal_last} for step in ("incremental", "global")
    }
    requests["global"]["names"] = evidence.names[:: max(1, len(evidence.names) // CHECKED)]
    processes = {step: start_worker(step, request, part) for step, request in requests.items()}
    try:
        log, n = part / "incremental.log", len(evidence.names)
        result = wait_for_worker(processes["incremental"], "incremental", log, task.progress, n, task.limit)
        model = part / "incremental" / "0"
        shape = model_shape(model, result["focal_deviation"])
        wait_for_worker(processes["global"], "global", part / "global.log", limit=task.limit)
    finally:
        for process in processes.values():
            if process.poll() is None:
                process.kill()
    stated = None if lens.focal_px is None else lens.focal_px / max(lens.width, lens.height)
    failure = model_failure(evidence, shape, None, lens.fixed, stated)
    disagreement = None
    if failure is None and shape is not None:
        disagreement = model_disagreement(shape, model_shape(part / "global" / "0"))
        failure = model_failure(evidence, shape, disagreement, lens.fixed, stated)
    seconds = time.monotonic() - started
    return Mapped(failure, shape, disagreement, model, lens.fixed, tuple(result["camera"]), seconds)


def _request(task: MappingTask, step: str, lens: Lens, matches: Path) -> dict[str, Any]:
    part = task.part
    scratch, output, database = part / f"{step}.scratch", part / step, part / f"{step}.db"
    scratch.mkdir()
    output.mkdir()
    shutil.copyfile(matches, database)  # each mapper writes to its own
    return {
        "database": str(database),
        "pictures": str(task.pictures),
        "scratch": str(scratch),
        "output": str(output),
        "names": task.evidence.names,
        "threads": MAPPING_THREADS,
        "seed": 0,
        "refine_focal": not lens.fixed,
        "held": lens.held,
        "colours": step == "incremental",
    }


def _lens_request(lens: Lens) -> dict[str, Any]:
    assert lens.start is not None
    return {"model": lens.model, "params": list(lens.start), "held": lens.held}

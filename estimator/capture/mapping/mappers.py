"""The mapper, and another one that checks it where its model is doubtful, run on the matches through one lens."""

from __future__ import annotations

import contextlib
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from estimator.capture.cameras.lens import Lens
from estimator.capture.mapping.evidence import (
    CaptureEvidence,
    ModelShape,
    agreement_of,
    model_disagreement,
    model_shape,
)
from estimator.capture.mapping.failures import Failure
from estimator.capture.mapping.gates import (
    MOST_DISAGREEMENT,
    can_answer,
    contradiction,
    drift,
    is_usable,
    is_whole,
    model_failure,
    needs_check,
)
from estimator.capture.mapping.time_limit import OutOfTime, TimeLimit, processor_s
from estimator.capture.mapping.worker_process import WorkerError, start_worker, wait_for_worker
from metric_base.progress import ProgressCallback

__all__ = ["Mapped", "MappingTask", "mapped_frames"]

#: Threads of a mapper. With one the same matches give the same model; with more the
#: sums of the adjustment are added in another order each time, which moves a focal length by up to 1 %.
MAPPING_THREADS = 1
#: Frames that the global mapper checks a usable model on; it takes twice as long for as many.
CHECKED = 50
#: A model of the global mapper is preferred where it places so many times as many frames.
MORE_FRAMES = 1.2


@dataclass(frozen=True, slots=True, eq=False)
class Mapped:
    """What a mapper made.

    A failure that it shows, its shape and folder, whether the focal length was held; params : of its camera;
    seconds : of processor that it took; mapper : `incremental` or `global`; model_choice : the scores of camera models
    and the one that was chosen, where several were compared.
    """

    failure: Failure | None = None
    shape: ModelShape | None = None
    disagreement: float | None = None
    model: Path | None = None
    focal_held: bool = False
    params: tuple[float, ...] = ()
    seconds: float = 0.0
    mapper: str = "incremental"
    model_choice: dict[str, Any] | None = None


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
    """What the incremental mapper makes, checked by the global one where its model is doubtful; the better of the two.

    focal_last : the focal length is held until all frames have a place. A lens that differs from the one that the
    matches were verified with verifies them again: what an uncalibrated fisheye picture shows at its border fits no
    fundamental matrix.

    Raises
    ------
    OutOfTime
        The incremental mapper had not ended at the task's limit.
    """
    started = processor_s()
    matches = task.matches
    if lens.start is not None:
        matches = task.part / "verified.db"
        shutil.copyfile(task.matches, matches)
        request = {"database": str(matches), "lens": _lens_request(lens)}
        process = start_worker("verification", request, task.part, limit=task.limit)
        wait_for_worker(process, "verification", task.part / "verification.log", limit=task.limit)
    one = _mapped_by("incremental", task, lens, matches, focal_last)
    if needs_check(task.evidence, one.shape, one.failure):
        with contextlib.suppress(OutOfTime, WorkerError):  # what there is counts
            one = _better_of_both(one, task, lens, matches)
    return replace(one, failure=one.failure or contradiction(one.shape), seconds=processor_s() - started)


def _better_of_both(one: Mapped, task: MappingTask, lens: Lens, matches: Path) -> Mapped:
    """The better of what the incremental mapper made and what the global one makes of the same matches.

    A model that can be used is checked on some of the frames alone.
    """
    names = task.evidence.names
    thinned = is_usable(one.shape, one.failure) and len(names) > CHECKED
    two = _mapped_by("global", task, lens, matches, names=names[:: len(names) // CHECKED] if thinned else names)
    disagreement = None if one.shape is None else model_disagreement(one.shape, two.shape)
    one, two = replace(one, disagreement=disagreement), replace(two, disagreement=disagreement)
    if not is_usable(one.shape, one.failure):
        return two if can_answer(two.shape, two.failure) else one
    if disagreement is None or disagreement <= MOST_DISAGREEMENT:
        more = not thinned and can_answer(two.shape, two.failure) and _n_placed(two) > MORE_FRAMES * _n_placed(one)
        return two if more else one
    return replace(one, failure=drift(disagreement)) if two.shape is not None and is_whole(two.shape) else one


def _n_placed(mapped: Mapped) -> int:
    return 0 if mapped.shape is None else len(mapped.shape.names)


def _mapped_by(
    step: str, task: MappingTask, lens: Lens, matches: Path, focal_last: bool = False, names: list[str] | None = None
) -> Mapped:
    """What one mapper makes of the named frames, or of all."""
    request = _request(task, step, lens, matches) | {"focal_last": focal_last}
    request["names"] = names or task.evidence.names
    process = start_worker(step, request, task.part, limit=task.limit)
    log = task.part / f"{step}.log"
    result = wait_for_worker(process, step, log, task.progress, len(request["names"]), task.limit)
    model = task.part / step / "0"
    shape = model_shape(model, result["focal_deviation"], agreement_of(result["agreement"]))
    stated = None if lens.focal_px is None else lens.focal_px / max(lens.width, lens.height)
    failure = model_failure(task.evidence, shape, lens.fixed, stated)
    return Mapped(failure, shape, None, model, lens.fixed, tuple(result["camera"]), mapper=step)


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
        "threads": MAPPING_THREADS,
        "seed": 0,
        "refine_focal": not lens.fixed,
        "held": lens.held,
        "colours": True,
    }


def _lens_request(lens: Lens) -> dict[str, Any]:
    assert lens.start is not None
    return {"model": lens.model, "params": list(lens.start), "held": lens.held}

"""Compute one model from verified matches: incremental mapping, checked by global mapping, over several camera models.

`make_model` is the stage. Its steps, each of which ends the search if the model can be used:

1. Refuse frames whose matches already show that there is no model (`early_failure`).
2. Map with the assumed camera model (`Mapper.map`): COLMAP's incremental mapper, and its global mapper if that model
   is refused, incomplete, or may have drifted.
3. Map with other camera models, if the residuals or the failure indicate a wrong one (`Mapper.map_other_lenses`).
4. If most frames could not be placed, map again and adjust the focal length at the end.
5. If the focal length is undetermined, map again with the stated or a typical focal length held.

Every run of COLMAP is a worker process with a time limit. At the limit, the best model so far is used.
"""

from __future__ import annotations

import contextlib
import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from capture.mapping.camera_prior import Lens, is_fisheye
from capture.mapping.match_graph import CaptureEvidence
from capture.mapping.model_metrics import ModelShape, agreement_of, model_disagreement, model_shape
from capture.mapping.refusals import (
    LEAST_FRAMES,
    MENDABLE,
    MOST_DISAGREEMENT,
    Failure,
    can_answer,
    contradiction,
    drift,
    early_failure,
    focal_is_determined,
    focal_undetermined,
    is_usable,
    is_whole,
    lens_is_doubtful,
    model_failure,
    most_are_linked,
    needs_check,
)
from capture.mapping.worker import OutOfTime, TimeLimit, WorkerError, processor_s, run_worker
from metric_base.progress import ProgressCallback, silent

#: Threads of a mapper. With one thread the result is deterministic; with more, the order of summation in the bundle
#: adjustment varies, which changes a focal length by up to 1 %.
N_MAPPING_THREADS = 1
#: Maximum number of frames on which the global mapper checks a usable model; its time grows faster than linearly.
MAX_CHECKED_FRAMES = 50
#: Minimum ratio of placed frames at which the model of the global mapper replaces a usable incremental one.
MIN_PLACED_RATIO = 1.2
#: Failures that may disappear if the focal length is held: a free one may stop the mapper after two frames.
FOCAL_FAILURES = frozenset({"focal_length_undetermined", "too_few_frames"})
FISHEYE = "OPENCV_FISHEYE"
#: Camera models and focal lengths, as a fraction of the longer side, of usual wide lenses: the second camera of a
#: phone, which corrects its distortion, and two action cameras. The mapping converges from a fisheye focal length
#: within 20 % of the true one.
WIDE_STARTS = (("SIMPLE_RADIAL", 0.4), (FISHEYE, 0.48), (FISHEYE, 0.34))
#: Maximum time of another mapping of the same matches, as a multiple of the first, ...
MAX_TIME_RATIO = 3.0
#: ... and in additional seconds, for verifying the matches. The adjustment of a wrong camera model may not end.
EXTRA_TIME_S = 30.0
#: Maximum relative change of the focal length of a fisheye model that has converged.
FOCAL_TOLERANCE = 0.01
#: Maximum number of repeated mappings with a fisheye model.
MAX_FISHEYE_ROUNDS = 2


@dataclass(frozen=True, slots=True, eq=False)
class MappingResult:
    """Result of a mapping."""

    failure: Failure | None = None  #: Why the model cannot be used.
    shape: ModelShape | None = None  #: Figures of the model; None if there is no model.
    disagreement: float | None = None  #: Distance of both mappers' camera paths, as a fraction of their extent.
    model: Path | None = None  #: Folder of the model.
    focal_held: bool = False  #: Whether the focal length was not refined.
    params: tuple[float, ...] = ()  #: Parameters of the first camera, in the order of COLMAP's camera model.
    seconds: float = 0.0  #: Processor time of the mapping.
    mapper: str = "incremental"  #: `incremental` or `global`.
    model_choice: dict[str, Any] | None = None  #: Scores of the camera models and the best one, if compared.

    @property
    def code(self) -> str | None:
        """Code of the failure."""
        return None if self.failure is None else self.failure.code

    @property
    def n_placed(self) -> int:
        """Number of frames in the model."""
        return 0 if self.shape is None else len(self.shape.names)

    @property
    def retry_s(self) -> float:
        """Maximum time of another mapping of the same matches, in seconds on the clock of the time limit."""
        return MAX_TIME_RATIO * self.seconds + EXTRA_TIME_S


def make_model(
    output: Path,
    matches: Path,
    images: Path,
    evidence: CaptureEvidence,
    lens: Lens,
    *,
    limit: TimeLimit,
    progress: ProgressCallback = silent,
) -> None:
    """Write a model as the folder `output`, and its report as `output` with the suffix `.json`.

    After a failure only the report is written.

    Parameters
    ----------
    output : Path
        Folder of the model, which does not exist yet.
    matches, images : Path
        Database of the verified matches, and folder of the frames.
    evidence : CaptureEvidence
        Frames and matched pairs.
    lens : Lens
        Assumed camera model, and the focal length if it is known.

    Raises
    ------
    OutOfTime
        The first mapping was ended at the limit. Later mappings that do not end in time are ignored.
    """
    early = early_failure(evidence)
    folder = output.with_name(f"{output.name}.made")
    folder.mkdir()
    if early is None:
        result = Mapper(folder, matches, images, evidence, progress, limit).best_mapping(lens)
    else:
        result = MappingResult(failure=early)
    if result.failure is None and result.model is not None:
        result.model.rename(output)
    shape = result.shape
    placed = set() if shape is None else set(shape.names)
    left_out = [name for name in evidence.names if name not in placed]
    report = {
        "failure": None if result.failure is None else result.failure.json(),
        "pairs": evidence.summary(),
        "model": None if shape is None else shape.summary() | {"left_out": left_out},
        "mapper": result.mapper,
        "disagreement": result.disagreement,
        "focal_held": result.focal_held,
        "lenses": result.model_choice,
    }
    output.with_name(f"{output.name}.json").write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")


@dataclass(frozen=True, slots=True, eq=False)
class Mapper:
    """Runs COLMAP's mappers on the verified matches of a set of frames."""

    folder: Path  #: Empty folder for requests, logs and models.
    matches: Path  #: Database of the verified matches.
    images: Path  #: Folder of the frames.
    evidence: CaptureEvidence
    progress: ProgressCallback
    limit: TimeLimit

    def within(self, name: str, seconds: float) -> Mapper:
        """Return a mapper for the same matches in a new subfolder, with at most `seconds` of time."""
        folder = self.folder / name
        folder.mkdir()
        return replace(self, folder=folder, limit=self.limit.within(seconds))

    def best_mapping(self, lens: Lens) -> MappingResult:
        """Map with the assumed lens, and with other lenses and focal lengths where they may explain the frames better.

        Raises
        ------
        OutOfTime
            The first mapping was ended at the limit.
        """
        result = self.map(lens)
        if lens.fixed or (result.code == "too_few_frames" and not most_are_linked(self.evidence)):
            return result
        if lens.free and lens_is_doubtful(result.shape, result.failure):
            result = more_reliable(result, self.map_other_lenses(lens, result))
        with contextlib.suppress(OutOfTime):
            if result.code == "too_few_frames":
                # The first two frames of a straight drive hardly constrain the focal length: in one case it became 4
                # times the width (true: 0.78), and only 6 of 32 frames fitted. Hold it until all frames are placed.
                last = self.within("focal_last", result.retry_s).map(lens, focal_last=True)
                result = last if last.failure is None else result
            # A stated focal length replaces an undetermined one. A typical one only shows why frames are missing.
            is_stated = lens.focal_px is not None and not lens.rough
            if result.code in FOCAL_FAILURES and (is_stated or result.code != "focal_length_undetermined"):
                held = self.within("held", result.retry_s).map(replace(lens, fixed=True))
                if held.failure is None and held.shape is not None and not focal_is_determined(held.shape):
                    result = held if is_stated else replace(result, failure=focal_undetermined())
        return result

    def map(self, lens: Lens, focal_last: bool = False) -> MappingResult:
        """Map all frames incrementally, and check a doubtful model with the global mapper.

        Parameters
        ----------
        lens : Lens
            If it has start parameters, the matches are verified again with them: matches at the border of an
            uncalibrated fisheye image do not fit a fundamental matrix.
        focal_last : bool
            Hold the focal length until all frames are placed.

        Raises
        ------
        OutOfTime
            The incremental mapper was ended at the limit.
        """
        started = processor_s()
        matches = self.matches
        if lens.start is not None:
            matches = self.folder / "verified.db"
            shutil.copyfile(self.matches, matches)
            camera = {"model": lens.model, "params": list(lens.start), "held": lens.held}
            run_worker("verification", {"database": str(matches), "lens": camera}, self.folder, limit=self.limit)
        result = self._run("incremental", lens, matches, self.evidence.names, focal_last)
        if needs_check(self.evidence, result.shape, result.failure):
            with contextlib.suppress(OutOfTime, WorkerError):  # without a check the incremental model is used
                result = self._check_by_global_mapper(result, lens, matches)
        return replace(result, failure=result.failure or contradiction(result.shape), seconds=processor_s() - started)

    def map_other_lenses(self, lens: Lens, first: MappingResult) -> MappingResult:
        """Return the best mapping with other camera models, or `first` if none is better.

        If `first` can be used, other camera models are tried only if one of them explains held-out observations better.
        Otherwise they are tried in any case: few frames hardly constrain the lens, and a mapping that starts far from
        a wide lens may converge to a strongly distorted one.
        """
        choice = None
        if first.shape is not None and first.n_placed >= LEAST_FRAMES and first.model is not None:
            worker = self.within("lenses", first.retry_s)
            with contextlib.suppress(OutOfTime):
                choice = run_worker("lenses", {"model": str(first.model)}, worker.folder, limit=worker.limit)
        best = first
        if first.failure is not None or (choice is not None and choice["chosen"] != lens.model):
            for number, other in enumerate(_other_lenses(lens, choice)):
                try:
                    result = self.within(f"lens_{number}", first.retry_s).map(other)
                except (OutOfTime, WorkerError):  # COLMAP may abort with a camera model that does not fit
                    continue
                if better_model(result, best) is result:
                    best = result
                    if is_fisheye(other.model):
                        best = self._converge(other, result, number, first.retry_s)
                if best.failure is None and best is not first:
                    break
        return replace(best, model_choice=choice)

    def _converge(self, lens: Lens, result: MappingResult, number: int, seconds: float) -> MappingResult:
        """Repeat a fisheye mapping from its own parameters until the focal length has converged."""
        for turn in range(MAX_FISHEYE_ROUNDS):
            focal = result.params[0]
            try:
                repeated = self.within(f"lens_{number}_again_{turn}", seconds).map(replace(lens, start=result.params))
            except (OutOfTime, WorkerError):
                break
            result = better_model(repeated, result)
            if abs(result.params[0] / focal - 1) < FOCAL_TOLERANCE:
                break
        return result

    def _check_by_global_mapper(self, first: MappingResult, lens: Lens, matches: Path) -> MappingResult:
        """Return the better of an incremental model and the global one, or the former with the failure `drift`."""
        names = self.evidence.names
        usable = is_usable(first.shape, first.failure)
        thinned = usable and len(names) > MAX_CHECKED_FRAMES  # a usable model is checked on some of the frames
        if thinned:
            names = names[:: len(names) // MAX_CHECKED_FRAMES]
        other = self._run("global", lens, matches, names)
        disagreement = None if first.shape is None else model_disagreement(first.shape, other.shape)
        first, other = replace(first, disagreement=disagreement), replace(other, disagreement=disagreement)
        if not usable:
            return other if can_answer(other.shape, other.failure) else first
        if disagreement is None or disagreement <= MOST_DISAGREEMENT:
            places_more = not thinned and other.n_placed > MIN_PLACED_RATIO * first.n_placed
            return other if places_more and can_answer(other.shape, other.failure) else first
        has_drifted = other.shape is not None and is_whole(other.shape)
        return replace(first, failure=drift(disagreement)) if has_drifted else first

    def _run(self, mapper: str, lens: Lens, matches: Path, names: list[str], focal_last: bool = False) -> MappingResult:
        """Run the `incremental` or the `global` mapper on the named frames, and test its model by itself."""
        scratch, output, database = (self.folder / name for name in (f"{mapper}.scratch", mapper, f"{mapper}.db"))
        scratch.mkdir()
        output.mkdir()
        shutil.copyfile(matches, database)  # the mappers write to their database
        request = {
            "database": str(database),
            "pictures": str(self.images),
            "scratch": str(scratch),
            "output": str(output),
            "threads": N_MAPPING_THREADS,
            "seed": 0,
            "refine_focal": not lens.fixed,
            "held": lens.held,
            "colours": True,
            "focal_last": focal_last,
            "names": names,
        }
        result = run_worker(mapper, request, self.folder, progress=self.progress, total=len(names), limit=self.limit)
        shape = model_shape(output / "0", result["focal_deviation"], agreement_of(result["agreement"]))
        stated_focal = None if lens.focal_px is None else lens.focal_px / max(lens.width, lens.height)
        failure = model_failure(self.evidence, shape, lens.fixed, stated_focal)
        params = tuple(result["camera"])
        return MappingResult(failure, shape, None, output / "0", lens.fixed, params, mapper=mapper)


def better_model(one: MappingResult, two: MappingResult) -> MappingResult:
    """Return the model that is usable, has more frames, or as many and smaller residuals; `two` if they are equal."""
    if one.shape is None or (one.failure is not None and two.failure is None):
        return two
    if two.shape is None or (one.failure is None and two.failure is not None):
        return one
    difference = one.n_placed - two.n_placed
    return one if difference > 0 or (difference == 0 and one.shape.error_px < two.shape.error_px) else two


def more_reliable(first: MappingResult, other: MappingResult) -> MappingResult:
    """Return `other`, unless `first` failed due to the motion and `other` hardly determines its focal length.

    The motion leaves the focal length undetermined with any camera model; one of several may pass by chance.
    """
    if first.code != "focal_length_undetermined":
        return other
    if other.failure is not None or other.shape is None:
        return first
    deviation = other.shape.focal_deviation
    return first if deviation is None or deviation > MENDABLE else other


def _other_lenses(lens: Lens, choice: dict[str, Any] | None) -> Iterator[Lens]:
    """Yield lenses with start parameters: the best of `choice`, the stated field of view, then usual wide lenses."""
    if choice is not None:
        name = choice["chosen"]
        yield replace(lens, model=name, start=tuple(choice["scores"][name]["params"]))
    starts = [] if lens.wide_px is None else [(FISHEYE, lens.wide_px)]
    starts += [(model, fraction * max(lens.width, lens.height)) for model, fraction in WIDE_STARTS]
    for model, focal_px in starts:
        other = replace(lens, model=model)
        yield replace(other, start=replace(other, focal_px=focal_px).values)

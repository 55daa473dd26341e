"""Structure from motion over the chosen frames: features, matches, and a mapper that another one may check."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

from estimator.capture.cameras.lens import Lens
from estimator.capture.mapping.camera_model_search import other_mapping_s, with_other_camera_model
from estimator.capture.mapping.evidence import CaptureEvidence
from estimator.capture.mapping.failures import TYPICAL_FOCAL
from estimator.capture.mapping.feature_search import RUNGS, Rung
from estimator.capture.mapping.gates import (
    MENDABLE,
    early_failure,
    focal_is_determined,
    focal_undetermined,
    lens_is_doubtful,
    most_are_linked,
)
from estimator.capture.mapping.mappers import Mapped, MappingTask, mapped_frames
from estimator.capture.mapping.time_limit import OutOfTime, TimeLimit
from estimator.capture.mapping.worker_process import start_worker, wait_for_worker
from metric_base.progress import ProgressCallback, silent

__all__ = ["make_features", "make_matches", "make_model"]

THREADS = 2

#: Failures that go away if the focal length is held: with an open one the mapper may not get beyond two frames.
OF_THE_FOCAL = frozenset({"focal_length_undetermined", "too_few_frames"})


def make_features(
    part: Path,
    pictures: Path,
    cameras: list[tuple[Lens, list[str]]],
    rung: Rung = RUNGS[0],
    *,
    limit: TimeLimit,
    progress: ProgressCallback = silent,
) -> None:
    """`features.db` and `features.json` in the part folder, with the rung's suffix.

    cameras : the lens of each, and the names of its frames; limit : when the search must have ended, or OutOfTime.
    """
    n = sum(len(names) for _, names in cameras)
    request = {
        "database": str(part / f"features{rung.suffix}.db"),
        "pictures": str(pictures),
        "camera_model": cameras[0][0].model,
        "cameras": [{"params": lens.params, "names": names} for lens, names in cameras],
        "focal_factor": TYPICAL_FOCAL,
        "sift": rung.sift,
        "max_side": rung.max_side,
        "threads": THREADS,
    }
    process = start_worker("features", request, part, limit=limit)
    result = wait_for_worker(process, "features", part / "features.log", progress, n, limit)
    (part / f"features{rung.suffix}.json").write_text(json.dumps(result), encoding="utf-8")


def make_matches(
    part: Path,
    features: Path,
    names: list[str],
    in_order: bool,
    rung: Rung = RUNGS[0],
    *,
    limit: TimeLimit,
    progress: ProgressCallback = silent,
) -> None:
    """`matches.db` and `matches.json` in the part folder, with the rung's suffix.

    features : the folder of the features; limit : when the matching must have ended, or OutOfTime.
    """
    database = part / f"matches{rung.suffix}.db"
    shutil.copyfile(features / f"features{rung.suffix}.db", database)
    request = {"database": str(database), "names": names, "in_order": in_order, "threads": THREADS, **rung.matching}
    process = start_worker("matches", request, part, limit=limit)
    result = wait_for_worker(process, "matches", part / "matches.log", progress, limit=limit)
    (part / f"matches{rung.suffix}.json").write_text(json.dumps(result), encoding="utf-8")


def make_model(
    output: Path,
    matches: Path,
    pictures: Path,
    evidence: CaptureEvidence,
    lens: Lens,
    *,
    limit: TimeLimit,
    progress: ProgressCallback = silent,
) -> None:
    """A model as the folder `output`, and its report beside it, of the same name; of a failure only the latter.

    matches : the database of the matches; limit : when all must have ended. Where the lens is
    doubtful, other lenses are tried. Where most frames cannot be placed, the mappers run again and adjust the focal
    length last. Where the frames leave the focal length open, one that is stated is held and the mappers run again.

    Raises
    ------
    OutOfTime
        The first mapping had not ended at the limit; of later ones what there is by then counts.
    """
    early = early_failure(evidence)
    part = output.with_name(f"{output.name}.made")
    part.mkdir()
    task = MappingTask(part, matches, pictures, evidence, progress, limit)
    if early is not None:
        mapped = Mapped(failure=early)
    else:
        mapped = mapped_frames(task, lens)
        if not lens.fixed:
            mapped = _mended_mapping(task, lens, mapped)
    if mapped.failure is None and mapped.model is not None:
        mapped.model.rename(output)
    _write_report(output.with_name(f"{output.name}.json"), mapped, evidence)


def _mended_mapping(task: MappingTask, lens: Lens, mapped: Mapped) -> Mapped:
    """What other lenses and focal lengths make of frames that one lens explains badly; what there is at the limit."""
    if mapped.failure is not None and mapped.failure.code == "too_few_frames" and not most_are_linked(task.evidence):
        return mapped  # no lens links them
    if lens.free and lens_is_doubtful(mapped.shape, mapped.failure):
        mapped = _better_supported(mapped, with_other_camera_model(task, lens, mapped))
    try:
        if mapped.failure is not None and mapped.failure.code == "too_few_frames":
            mapped = _map_with_focal_last(task, lens, mapped)
        if mapped.failure is not None and mapped.failure.code in OF_THE_FOCAL:
            mapped = _map_with_held_focal(task, lens, mapped)
    except OutOfTime:
        pass
    return mapped


def _better_supported(first: Mapped, other: Mapped) -> Mapped:
    """The mapping through another lens, unless the first was refused because of the motion and this one hardly passes.

    The motion leaves the focal length as open through any lens: of several mappings one may pass by chance.
    """
    if first.failure is None or first.failure.code != "focal_length_undetermined":
        return other
    if other.failure is not None or other.shape is None:
        return first
    deviation = other.shape.focal_deviation
    return first if deviation is None or deviation > MENDABLE else other


def _map_with_focal_last(task: MappingTask, lens: Lens, mapped: Mapped) -> Mapped:
    """The mapping again with the focal length adjusted at the end, if that places the frames; else as it was.

    On a straight drive the first two frames say next to nothing about the focal length: one of 4 times the width came
    out where 0.78 was true, and 6 of 32 frames fitted it.
    """
    last = mapped_frames(task.below("focal_last", other_mapping_s(mapped)), lens, focal_last=True)
    return last if last.failure is None else mapped


def _map_with_held_focal(task: MappingTask, lens: Lens, mapped: Mapped) -> Mapped:
    """The mapping again with the stated or, to find out what was wrong, a typical focal length."""
    assert mapped.failure is not None
    stated = lens.focal_px is not None and not lens.rough
    if not stated and mapped.failure.code == "focal_length_undetermined":
        return mapped
    held = mapped_frames(task.below("held", other_mapping_s(mapped)), replace(lens, fixed=True))
    if held.failure is not None or held.shape is None or focal_is_determined(held.shape):
        return mapped
    return held if stated else replace(mapped, failure=focal_undetermined())


def _write_report(file: Path, mapped: Mapped, evidence: CaptureEvidence) -> None:
    shape = mapped.shape
    left_out = [] if shape is None else [name for name in evidence.names if name not in set(shape.names)]
    report = {
        "failure": None if mapped.failure is None else mapped.failure.json(),
        "pairs": evidence.summary(),
        "model": None if shape is None else shape.summary() | {"left_out": left_out},
        "mapper": mapped.mapper,
        "disagreement": mapped.disagreement,
        "focal_held": mapped.focal_held,
        "lenses": mapped.model_choice,
    }
    file.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")

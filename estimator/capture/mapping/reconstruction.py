"""Structure from motion over the chosen frames: features, matches, and two mappers that must agree."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from estimator.capture.mapping.evidence import Evidence, ModelShape, model_disagreement, model_shape
from estimator.capture.mapping.failures import TYPICAL_FOCAL, Failure
from estimator.capture.mapping.gates import (
    LEAST_FRAMES,
    early_failure,
    focal_is_determined,
    focal_undetermined,
    lens_is_doubtful,
    model_failure,
)
from estimator.capture.mapping.rungs import RUNGS, Rung
from estimator.capture.mapping.worker_process import start_worker, wait_for_worker
from metric_base.progress import ProgressCallback, silent

__all__ = ["Lens", "make_features", "make_matches", "make_model"]

THREADS = 2

#: Threads of each of the two mappers, which run at once. With one the same matches give the same model; with more the
#: sums of the adjustment are added in another order each time, which moves a focal length by up to 1 %.
MAPPING_THREADS = 1
#: Frames that the global mapper checks the incremental one on; it takes twice as long for as many.
CHECKED = 50


#: Wide lenses by camera model and usual focal length over the longer side: a telephone's second camera, which corrects
#: its distortion, and an action camera's.
WIDE_STARTS = (("SIMPLE_RADIAL", 0.4), ("OPENCV_FISHEYE", 0.45))

#: Failures that go away if the focal length is held: with an open one the mapper may not get beyond two frames.
OF_THE_FOCAL = frozenset({"focal_length_undetermined", "too_few_frames"})


@dataclass(frozen=True, slots=True, eq=False)
class _Mapped:
    """What the two mappers made.

    A failure that it shows, its shape and folder, whether the focal length was held; lens_scores : per camera model,
    where several were tried.
    """

    failure: Failure | None = None
    shape: ModelShape | None = None
    disagreement: float | None = None
    model: Path | None = None
    focal_held: bool = False
    lens_scores: dict[str, Any] | None = None


@dataclass(frozen=True, slots=True)
class Lens:
    """What is known of the camera: COLMAP's model, and the focal length in pixels of the frames or None.

    fixed : the focal length is given by the user and not refined; width, height : of the frames; rough : the focal
    length is that of the camera's photographs, and its videos may be cropped: a start that is never held; free : the
    frames share a camera whose model the user leaves open; start : parameters that the mapper begins with, if they are
    not those of the features' database; held : they are held until all frames have a place. A free fisheye lens of
    eight parameters ends anywhere with two or three frames.
    """

    model: str
    focal_px: float | None
    fixed: bool
    width: int
    height: int
    rough: bool = False
    free: bool = False
    start: tuple[float, ...] | None = None
    held: bool = False

    @property
    def params(self) -> str:
        """COLMAP's `camera_params`, empty where the focal length is not known."""
        if self.focal_px is None:
            return ""
        return ",".join(repr(value) for value in self.values)

    @property
    def values(self) -> tuple[float, ...]:
        """The camera's parameters by the focal length alone, which has to be known."""
        from estimator.reconstructions.cameras import CAMERA_MODELS

        assert self.focal_px is not None
        known = {"cx": self.width / 2, "cy": self.height / 2} | dict.fromkeys(("f", "fx", "fy"), self.focal_px)
        return tuple(float(known.get(name, 0.0)) for name in CAMERA_MODELS[self.model][1])


def make_features(
    part: Path,
    pictures: Path,
    cameras: list[tuple[Lens, list[str]]],
    rung: Rung = RUNGS[0],
    progress: ProgressCallback = silent,
) -> None:
    """`features.db` and `features.json` in the part folder, with the rung's suffix.

    cameras : the lens of each, and the names of its frames.
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
    process = start_worker("features", request, part)
    result = wait_for_worker(process, "features", part / "features.log", progress, n)
    (part / f"features{rung.suffix}.json").write_text(json.dumps(result), encoding="utf-8")


def make_matches(
    part: Path,
    features: Path,
    names: list[str],
    in_order: bool,
    rung: Rung = RUNGS[0],
    progress: ProgressCallback = silent,
) -> None:
    """`matches.db` and `matches.json` in the part folder, with the rung's suffix; `features` has the features."""
    database = part / f"matches{rung.suffix}.db"
    shutil.copyfile(features / f"features{rung.suffix}.db", database)
    request = {"database": str(database), "names": names, "in_order": in_order, "threads": THREADS, **rung.matching}
    process = start_worker("matches", request, part)
    result = wait_for_worker(process, "matches", part / "matches.log", progress)
    (part / f"matches{rung.suffix}.json").write_text(json.dumps(result), encoding="utf-8")


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """What every mapping of one rung starts from: folder to work in, database of matches, pictures, what they show."""

    part: Path
    matches: Path
    pictures: Path
    evidence: Evidence
    progress: ProgressCallback

    def below(self, name: str) -> _Task:
        """The same in a folder of its own."""
        folder = self.part / name
        folder.mkdir()
        return replace(self, part=folder)


def make_model(
    output: Path, matches: Path, pictures: Path, evidence: Evidence, lens: Lens, progress: ProgressCallback = silent
) -> None:
    """A model as the folder `output`, and its report beside it, of the same name; of a failure only the latter.

    matches : the database of the matches. The incremental mapper makes the model; the global one, which turns pure
    rotation into a convincing false model, only checks its shape. Where most frames cannot be placed, the mappers run
    again and adjust the focal length last. Where the lens is doubtful, other camera models are tried. Where the frames
    leave the focal length open, one that is stated is held and the mappers run again.
    """
    early = early_failure(evidence)
    part = output.with_name(f"{output.name}.made")
    part.mkdir()
    task = _Task(part, matches, pictures, evidence, progress)
    mapped = _Mapped(failure=early) if early is not None else _map(task, lens)
    if early is None and lens.free and not lens.fixed and lens_is_doubtful(mapped.shape, mapped.failure):
        mapped = _map_with_other_lens(task, lens, mapped)
    if early is None and mapped.failure is not None and mapped.failure.code == "too_few_frames" and not lens.fixed:
        mapped = _map_with_focal_last(task, lens, mapped)
    if early is None and mapped.failure is not None and not lens.fixed and mapped.failure.code in OF_THE_FOCAL:
        mapped = _map_with_held_focal(task, lens, mapped)
    if mapped.failure is None and mapped.model is not None:
        mapped.model.rename(output)
    _write_report(output.with_name(f"{output.name}.json"), mapped, evidence)


def _map_with_other_lens(task: _Task, lens: Lens, mapped: _Mapped) -> _Mapped:
    """The mapping again with the camera model that does best on held out observations, if that is better.

    A model of few frames says too little about its lens, and one that began far from a wide lens may end in a bent one:
    wide lenses are tried from their usual focal lengths.
    """
    scores = None
    if mapped.shape is not None and len(mapped.shape.names) >= LEAST_FRAMES and mapped.model is not None:
        folder = task.below("lenses").part
        process = start_worker("lenses", {"model": str(mapped.model)}, folder)
        choice = wait_for_worker(process, "lenses", folder / "lenses.log")
        scores, name = choice["scores"], choice["chosen"]
        starts = [(name, tuple(scores[name]["params"]), True)]
    else:
        starts = []
    side = max(lens.width, lens.height)
    starts += [
        (name, replace(lens, model=name, focal_px=focal * side).values, "FISHEYE" in name)
        for name, focal in WIDE_STARTS
    ]
    best = mapped
    for number, (name, start, held) in enumerate(starts):
        other = _map(task.below(f"other_lens_{number}"), replace(lens, model=name, start=start, held=held))
        best = other if _is_better(other, best) else best
        if best.failure is None:
            break
    return replace(best, lens_scores=scores)


def _is_better(one: _Mapped, two: _Mapped) -> bool:
    """Whether one can be used and the other cannot, or it places more frames, or as many with smaller residuals."""
    if one.shape is None or (one.failure is not None and two.failure is None):
        return False
    if two.shape is None or (one.failure is None and two.failure is not None):
        return True
    placed = len(one.shape.names) - len(two.shape.names)
    return placed > 0 or (placed == 0 and one.shape.error_px < two.shape.error_px)


def _map_with_focal_last(task: _Task, lens: Lens, mapped: _Mapped) -> _Mapped:
    """The mapping again with the focal length adjusted at the end, if that places the frames; else as it was.

    On a straight drive the first two frames say next to nothing about the focal length: one of 4 times the width came
    out where 0.78 was true, and 6 of 32 frames fitted it.
    """
    last = _map(task.below("focal_last"), lens, focal_last=True)
    return last if last.failure is None else mapped


def _map_with_held_focal(task: _Task, lens: Lens, mapped: _Mapped) -> _Mapped:
    """The mapping again with the stated or, to find out what was wrong, a typical focal length."""
    assert mapped.failure is not None
    stated = lens.focal_px is not None and not lens.rough
    if not stated and mapped.failure.code == "focal_length_undetermined":
        return mapped
    held = _map(task.below("held"), replace(lens, fixed=True))
    if held.failure is not None or held.shape is None or focal_is_determined(held.shape):
        return mapped
    return held if stated else replace(mapped, failure=focal_undetermined())


def _map(task: _Task, lens: Lens, focal_last: bool = False) -> _Mapped:
    """Both mappers at once, and whether what they made can be used; `focal_last` : see `_map_with_focal_last`."""
    part, evidence = task.part, task.evidence
    requests = {
        step: _request(task, step, lens, seed=0) | {"focal_last": focal_last} for step in ("incremental", "global")
    }
    requests["global"]["names"] = evidence.names[:: max(1, len(evidence.names) // CHECKED)]
    processes = {step: start_worker(step, request, part) for step, request in requests.items()}
    try:
        result = wait_for_worker(
            processes["incremental"], "incremental", part / "incremental.log", task.progress, len(evidence.names)
        )
        model = part / "incremental" / "0"
        shape = model_shape(model, result["focal_deviation"])
        wait_for_worker(processes["global"], "global", part / "global.log")
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
    return _Mapped(failure, shape, disagreement, model, lens.fixed)


def _request(task: _Task, step: str, lens: Lens, seed: int) -> dict[str, Any]:
    part = task.part
    scratch, output, database = part / f"{step}.scratch", part / step, part / f"{step}.db"
    scratch.mkdir()
    output.mkdir()
    shutil.copyfile(task.matches, database)  # each mapper writes to its own
    return {
        "database": str(database),
        "pictures": str(task.pictures),
        "scratch": str(scratch),
        "output": str(output),
        "names": task.evidence.names,
        "threads": MAPPING_THREADS,
        "seed": seed,
        "refine_focal": not lens.fixed,
        "lens": None if lens.start is None else {"model": lens.model, "params": list(lens.start), "held": lens.held},
        "colours": step == "incremental",
    }


def _write_report(file: Path, mapped: _Mapped, evidence: Evidence) -> None:
    shape = mapped.shape
    left_out = [] if shape is None else [name for name in evidence.names if name not in set(shape.names)]
    report = {
        "failure": None if mapped.failure is None else mapped.failure.json(),
        "pairs": evidence.summary(),
        "model": None if shape is None else shape.summary() | {"left_out": left_out},
        "disagreement": mapped.disagreement,
        "focal_held": mapped.focal_held,
        "lenses": mapped.lens_scores,
    }
    file.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")

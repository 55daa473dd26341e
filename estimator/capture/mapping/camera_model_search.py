"""Other camera models for frames that one explains badly: by held out observations, by the file, usual wide ones."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from estimator.capture.cameras.lens import Lens, is_fisheye
from estimator.capture.mapping.gates import LEAST_FRAMES
from estimator.capture.mapping.mappers import Mapped, MappingTask, mapped_frames
from estimator.capture.mapping.time_limit import OutOfTime
from estimator.capture.mapping.worker_process import WorkerError, start_worker, wait_for_worker

__all__ = ["better_mapping", "other_mapping_s", "with_other_camera_model"]

FISHEYE = "OPENCV_FISHEYE"
#: Wide lenses by camera model and usual focal length over the longer side: a telephone's second camera, which corrects
#: its distortion, and an action camera's. From a fisheye focal length within a fifth of the true one the mapping
#: settles.
WIDE_STARTS = (("SIMPLE_RADIAL", 0.4), (FISHEYE, 0.48), (FISHEYE, 0.34))
#: A mapping with another camera model may take so many times as long as the first, and so many seconds more: it also
#: verifies the matches; the adjustment of a wrong one may take for ever.
TIMES_THE_FIRST, SECONDS_MORE = 3.0, 30.0
#: A fisheye model is mapped with again until its focal length changes by less than this share, so many times at most.
SETTLED, MOST_ROUNDS = 0.01, 2


def with_other_camera_model(task: MappingTask, lens: Lens, mapped: Mapped) -> Mapped:
    """The best mapping with other camera models, or the first where none is better.

    lens : of the first mapping, `mapped`. Where that can be used, other camera models are tried only if they explain
    held out observations better. Where it cannot be used, they are tried all the same: few frames say too little about
    their lens, and a mapping that began far from a wide lens may end in a bent one.
    """
    choice = _choice(task, mapped)
    if mapped.failure is None and (choice is None or choice["chosen"] == lens.model):
        return replace(mapped, model_choice=choice)
    best, seconds = mapped, other_mapping_s(mapped)
    for number, other in enumerate(_other_starts(lens, choice)):
        try:
            other_mapped = mapped_frames(task.below(f"lens_{number}", seconds), other)
        except (OutOfTime, WorkerError):  # a model that fits nothing may also break the mapper
            continue
        if better_mapping(other_mapped, best) is other_mapped:
            best = (
                _settled_mapping(task, other, other_mapped, number, seconds)
                if is_fisheye(other.model)
                else other_mapped
            )
        if best.failure is None and best is not mapped:
            break
    return replace(best, model_choice=choice)


def other_mapping_s(mapped: Mapped) -> float:
    """Seconds, on the clock of the limit, that another mapping of the same matches may take."""
    return TIMES_THE_FIRST * mapped.seconds + SECONDS_MORE


def better_mapping(one: Mapped, two: Mapped) -> Mapped:
    """The one that can be used, or that places more frames, or as many with smaller residuals; else the second."""
    if one.shape is None or (one.failure is not None and two.failure is None):
        return two
    if two.shape is None or (one.failure is None and two.failure is not None):
        return one
    placed = len(one.shape.names) - len(two.shape.names)
    return one if placed > 0 or (placed == 0 and one.shape.error_px < two.shape.error_px) else two


def _settled_mapping(task: MappingTask, lens: Lens, mapped: Mapped, number: int, seconds: float) -> Mapped:
    """The mapping again from the parameters that it ended with, until that stays."""
    for turn in range(MOST_ROUNDS):
        before = mapped.params[0]
        again = task.below(f"lens_{number}_again_{turn}", seconds)
        try:
            mapped = better_mapping(mapped_frames(again, replace(lens, start=mapped.params)), mapped)
        except (OutOfTime, WorkerError):
            break
        if abs(mapped.params[0] / before - 1) < SETTLED:
            break
    return mapped


def _choice(task: MappingTask, mapped: Mapped) -> dict[str, Any] | None:
    """What each camera model leaves of held out observations, and the best; None of a mapping with too few frames."""
    if mapped.shape is None or len(mapped.shape.names) < LEAST_FRAMES or mapped.model is None:
        return None
    below = task.below("lenses", other_mapping_s(mapped))
    process = start_worker("lenses", {"model": str(mapped.model)}, below.part, limit=below.limit)
    try:
        choice: dict[str, Any] = wait_for_worker(process, "lenses", below.part / "lenses.log", limit=below.limit)
    except OutOfTime:
        return None
    return choice


def _other_starts(lens: Lens, choice: dict[str, Any] | None) -> Iterator[Lens]:
    """Camera models and their parameters to begin with, most likely first."""
    side = max(lens.width, lens.height)
    if choice is not None:
        name = choice["chosen"]
        yield replace(lens, model=name, start=tuple(choice["scores"][name]["params"]))
    if lens.wide_px is not None:
        yield _beginning(lens, FISHEYE, lens.wide_px)
    for name, focal in WIDE_STARTS:
        yield _beginning(lens, name, focal * side)


def _beginning(lens: Lens, model: str, focal_px: float) -> Lens:
    other = replace(lens, model=model)
    return replace(other, start=replace(other, focal_px=focal_px).values)

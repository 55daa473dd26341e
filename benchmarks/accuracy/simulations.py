"""Simulated scenes: the paper's figure of N objects with noise R, one kind of error at a time, and similar objects."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, product

import numpy as np

from benchmarks.accuracy.outcomes import Outcome
from benchmarks.estimator.simulation import SAMENESS_FRACTIONS, SAMENESS_NOISE, SAMENESS_SCENES, Knobs, World, estimates
from estimator.posterior.posterior import Estimate

__all__ = ["COUNTS", "FAULTS", "NOISES", "error_outcomes", "sameness_outcomes", "structured_outcomes"]

#: Axes of the paper's figure of the simulation (section 5): numbers of objects, and maximum relative size errors.
COUNTS = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 20, 50)
NOISES = (0.0, 0.03, 0.06, 0.09, 0.12, 0.15)

_PLAIN = Knobs(cut=0.0, wrong=0.0, off=0.0)
#: The paper's method runs on the first 1/50 of the scenes, because it is thirty times slower than ours.
PAPER_DIVISOR = 50

#: Settings with one kind of error each; the defaults are eight objects and 6 % noise.
FAULTS: Mapping[str, tuple[tuple[str, Knobs], ...]] = {
    "truncated": tuple((f"{fraction:.0%}", replace(_PLAIN, cut=fraction)) for fraction in (0.0, 0.2, 0.4)),
    "mislabelled": tuple((f"{fraction:.0%}", replace(_PLAIN, wrong=fraction)) for fraction in (0.0, 0.2, 0.4)),
    "size noise": tuple((f"{noise:.0%}", replace(_PLAIN, noise=noise)) for noise in (0.0, 0.06, 0.15)),
    "objects": tuple((str(count), replace(_PLAIN, objects=count)) for count in (1, 2, 3, 5, 10, 50)),
    "classes of 10 objects": tuple((str(count), replace(_PLAIN, objects=10, classes=count)) for count in (1, 3, 10)),
}


def structured_outcomes(
    world: World, scenes: int, seed: int, counts: Sequence[int] = COUNTS, noises: Sequence[float] = NOISES
) -> Iterator[Outcome]:
    """Yield outcomes for scenes of N objects with sizes drawn from the priors and a relative error of at most R."""
    for count in counts:
        for noise in noises:
            knobs = replace(_PLAIN, objects=count, noise=noise)
            yield from _outcomes("structured", f"{count}/{noise:.0%}", world, knobs, scenes, seed)


def sameness_outcomes(world: World, scenes: int, seed: int) -> Iterator[Outcome]:
    """Yield outcomes for scenes with similar objects, in the groups `objects/classes/shared fraction`."""
    for (objects, classes), fraction in product(SAMENESS_SCENES, SAMENESS_FRACTIONS):
        knobs = replace(_PLAIN, objects=objects, classes=classes, shared=fraction, noise=SAMENESS_NOISE)
        group = f"{objects}/{classes}/{'as modelled' if fraction is None else f'{fraction:.0%}'}"
        yield from _of_method("sameness", group, estimates(world, knobs, scenes, seed, ("default",)))


def error_outcomes(world: World, scenes: int, seed: int) -> Iterator[Outcome]:
    """Yield outcomes for every setting of `FAULTS`, in the groups `error: value`."""
    for error, settings in FAULTS.items():
        for value, knobs in settings:
            yield from _outcomes("errors", f"{error}: {value}", world, knobs, scenes, seed)


def _outcomes(part: str, group: str, world: World, knobs: Knobs, scenes: int, seed: int) -> Iterator[Outcome]:
    fewer = max(scenes // PAPER_DIVISOR, 1)
    runs = (estimates(world, knobs, scenes, seed, ("default",)), estimates(world, knobs, fewer, seed, ("paper",)))
    yield from _of_method(part, group, chain(*runs))


def _of_method(part: str, group: str, runs: Iterable[tuple[int, str, float, Estimate]]) -> Iterator[Outcome]:
    for index, method, truth, estimate in runs:
        low, high = np.log(estimate.interval) - truth
        error, refused = float(np.log(estimate.modes[0].scale) - truth), estimate.status == "unresolved"
        yield Outcome(part, group, str(index), method, error, refused, float(low), float(high))

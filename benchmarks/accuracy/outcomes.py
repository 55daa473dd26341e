"""What one method made of one scene, and what many such outcomes say together."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from estimator.records.result import Curve, ScaleResult
from metric_base.arrays import FloatArray

__all__ = [
    "LEVEL",
    "Outcome",
    "Summary",
    "crps_of",
    "difference",
    "outcome_of",
    "read_outcomes",
    "select",
    "summary",
    "write_outcomes",
]

#: Mass of the intervals.
LEVEL = 0.9
#: Resamples of the scenes for the interval of a difference, and their seed.
RESAMPLES, SEED = 2000, 0


@dataclass(frozen=True, slots=True)
class Outcome:
    """One method on one scene.

    part, group : which experiment and setting; error : ln(scale / true) of the highest mode, also where the answer is
    refused, NaN without any; low, high : the interval's ends as ln(end / true), NaN where none is stated; heights :
    mean relative error of the objects' heights (the paper's measure), NaN where unknown; dimensions : that were used;
    crps : of the posterior, NaN if the method gives no posterior.
    """

    part: str
    group: str
    scene: str
    method: str
    error: float
    refused: bool
    low: float = float("nan")
    high: float = float("nan")
    heights: float = float("nan")
    dimensions: int = 0
    crps: float = float("nan")


@dataclass(frozen=True, slots=True)
class Summary:
    """Over n scenes; errors are |scale / true - 1| of those not refused, `bias` the median of ln(scale / true).

    score, crps : mean interval score and CRPS in log scale (Gneiting and Raftery 2007); ratio : median high over low.
    """

    n: int
    refused: float
    median: float
    mean: float
    p90: float
    bias: float
    heights: float
    heights_sd: float
    coverage: float
    ratio: float
    score: float
    crps: float


def crps_of(curve: Curve, truth: float) -> float:
    """The integral of (F(u) - 1[u >= truth])^2 over log scale u, over the grid and out to the truth.

    The continuous ranked probability score (Gneiting and Raftery 2007).
    """
    u, step = curve.log_scale, curve.log_scale[1] - curve.log_scale[0]
    below = curve.below + np.cumsum(curve.density) * step
    beyond = max(float(u[0]) - truth, truth - float(u[-1]), 0.0)
    return float(((below - (u >= truth)) ** 2).sum() * step) + beyond


def outcome_of(
    part: str, group: str, scene: str, method: str, result: ScaleResult, true: float, heights: float = float("nan")
) -> Outcome:
    """The outcome of a result on a scene of so many metres per unit."""
    error = float(np.log(result.modes[0].scale / true)) if result.modes else float("nan")
    refused = result.interval is None or result.scale is None
    ends = (float("nan"),) * 2
    if result.interval is not None and not refused:
        ends = (float(np.log(result.interval.low / true)), float(np.log(result.interval.high / true)))
    used = sum(len(item.used) for item in result.objects)
    crps = float("nan") if result.curve is None else crps_of(result.curve, float(np.log(true)))
    return Outcome(part, group, scene, method, error, refused, *ends, heights=heights, dimensions=used, crps=crps)


def select(outcomes: Iterable[Outcome], **wanted: str) -> list[Outcome]:
    """The outcomes whose fields are as wanted."""
    return [one for one in outcomes if all(getattr(one, name) == value for name, value in wanted.items())]


def summary(outcomes: Sequence[Outcome]) -> Summary:
    """The figures of one method in one setting."""
    answered = [one for one in outcomes if not one.refused and np.isfinite(one.error)]
    signed = np.array([one.error for one in answered])
    errors = np.abs(np.exp(signed) - 1)
    stated = [one for one in answered if np.isfinite(one.low)]
    low, high = np.array([one.low for one in stated]), np.array([one.high for one in stated])
    heights = np.array([one.heights for one in answered])
    heights = heights[np.isfinite(heights)]
    crps = np.array([one.crps for one in answered])
    outside = np.maximum(np.maximum(low, -high), 0.0)

    def of(values: FloatArray, statistic: Callable[[FloatArray], object]) -> float:
        return float(statistic(values)) if len(values) else float("nan")  # type: ignore[arg-type]

    return Summary(
        n=len(outcomes),
        refused=1 - len(answered) / max(len(outcomes), 1),
        median=of(errors, np.median),
        mean=of(errors, np.mean),
        p90=of(errors, lambda values: np.quantile(values, 0.9)),
        bias=of(signed, np.median),
        heights=of(heights, np.mean),
        heights_sd=of(heights, np.std),
        coverage=of(((low <= 0) & (high >= 0)).astype(float), np.mean),
        ratio=of(np.exp(high - low), np.median),
        score=of(high - low + 2 / (1 - LEVEL) * outside, np.mean),
        crps=of(crps[np.isfinite(crps)], np.mean),
    )


def difference(ours: Sequence[Outcome], theirs: Sequence[Outcome]) -> tuple[float, float, float, int]:
    """Mean of |error of ours| - |error of theirs| over the scenes of both, its 95 % interval, and how many they are.

    The highest mode counts, refused or not. The scenes are resampled in pairs.
    """
    by_scene = {(one.group, one.scene): abs(np.expm1(one.error)) for one in theirs}
    apart = np.array(
        [
            abs(np.expm1(one.error)) - by_scene[one.group, one.scene]
            for one in ours
            if (one.group, one.scene) in by_scene
        ]
    )
    apart = apart[np.isfinite(apart)]
    if not len(apart):
        return float("nan"), float("nan"), float("nan"), 0
    drawn = np.random.default_rng(SEED).choice(apart, (RESAMPLES, len(apart))).mean(axis=1)
    low, high = np.quantile(drawn, [0.025, 0.975])
    return float(apart.mean()), float(low), float(high), len(apart)


def write_outcomes(outcomes: Sequence[Outcome], file: Path) -> None:
    """One JSON line for each."""
    file.write_text("".join(json.dumps(asdict(one)) + "\n" for one in outcomes), encoding="utf-8")


def read_outcomes(file: Path) -> list[Outcome]:
    """What `write_outcomes` wrote."""
    return [Outcome(**json.loads(line)) for line in file.read_text(encoding="utf-8").splitlines()]

"""Outcomes of methods on scenes, and summary statistics over them."""

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
    "interval_scores",
    "outcome_of",
    "read_outcomes",
    "select",
    "summary",
    "write_outcomes",
]

#: Probability mass of the intervals.
LEVEL = 0.9
#: Number of bootstrap resamples of the scenes for the interval of a difference.
N_RESAMPLES = 2000
#: Seed of the bootstrap.
SEED = 0


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of a method on one scene, compared with the truth.

    part, group : experiment and setting.
    error : ln(scale / true) of the highest mode, also if the estimate is refused; NaN without a mode.
    low, high : ends of the interval as ln(end / true); NaN without an interval.
    heights : mean relative error of the objects' heights (the paper's measure); NaN if unknown.
    dimensions : number of dimensions used.
    median : ln(median of the posterior / true); NaN without a posterior.
    pit : posterior probability of scales below the true one (probability integral transform); NaN without a posterior.
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
    median: float = float("nan")
    pit: float = float("nan")


@dataclass(frozen=True, slots=True)
class Summary:
    """Statistics over n scenes. Errors are |scale / true - 1| of the scenes that are not refused.

    bias : median of ln(scale / true).
    ratio : median of the upper over the lower end of the interval.
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


def crps_of(curve: Curve, truth: float) -> float:
    """Return the continuous ranked probability score of a posterior (Gneiting and Raftery 2007).

    It is the integral of (F(u) - 1[u >= truth])^2 over log scale u, over the grid and from its end to the truth.
    """
    u, step = curve.log_scale, curve.log_scale[1] - curve.log_scale[0]
    below = curve.below + np.cumsum(curve.density) * step
    beyond = max(float(u[0]) - truth, truth - float(u[-1]), 0.0)
    return float(((below - (u >= truth)) ** 2).sum() * step) + beyond


def outcome_of(
    part: str, group: str, scene: str, method: str, result: ScaleResult, true: float, heights: float = float("nan")
) -> Outcome:
    """Return the outcome of a result on a scene of `true` metres per unit."""
    error = float(np.log(result.modes[0].scale / true)) if result.modes else float("nan")
    refused = result.interval is None or result.scale is None
    ends = (float("nan"),) * 2
    if result.interval is not None and not refused:
        ends = (float(np.log(result.interval.low / true)), float(np.log(result.interval.high / true)))
    used = sum(len(item.used) for item in result.objects)
    median, pit = (float("nan"),) * 2
    if result.curve is not None:
        u = result.curve.log_scale
        below = result.curve.below + np.cumsum(result.curve.density) * (u[1] - u[0])
        median = float(np.interp(0.5, below, u) - np.log(true))
        pit = float(np.interp(np.log(true), u, below))
    return Outcome(part, group, scene, method, error, refused, *ends, heights, used, median, pit)


def interval_scores(outcomes: Sequence[Outcome], width: float = 1.0) -> FloatArray:
    """Return the interval score of each outcome for ln scale (Gneiting and Raftery 2007).

    `width` is a factor of the distance of both ends from the median.
    """
    median, low, high = np.array([(row.median, row.low, row.high) for row in outcomes]).reshape(-1, 3).T
    low, high = median + width * (low - median), median + width * (high - median)
    missed = np.maximum(0.0, np.maximum(low, -high))
    return np.asarray(high - low + 2 / (1 - LEVEL) * missed)


def select(outcomes: Iterable[Outcome], **wanted: str) -> list[Outcome]:
    """Return the outcomes whose fields have the given values."""
    return [row for row in outcomes if all(getattr(row, name) == value for name, value in wanted.items())]


def summary(outcomes: Sequence[Outcome]) -> Summary:
    """Return the statistics of a method in one setting."""
    answered = [row for row in outcomes if not row.refused and np.isfinite(row.error)]
    signed = np.array([row.error for row in answered])
    errors = np.abs(np.exp(signed) - 1)
    with_interval = [row for row in answered if np.isfinite(row.low)]
    low, high = np.array([row.low for row in with_interval]), np.array([row.high for row in with_interval])
    heights = np.array([row.heights for row in answered])
    heights = heights[np.isfinite(heights)]

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
    )


def difference(ours: Sequence[Outcome], theirs: Sequence[Outcome]) -> tuple[float, float, float, int]:
    """Return the mean of |error of ours| - |error of theirs|, its 95 % bootstrap interval and the number of scenes.

    The means are over the scenes of both methods. Errors are of the highest mode, refused or not.
    """
    by_scene = {(row.group, row.scene): abs(np.expm1(row.error)) for row in theirs}
    differences = np.array(
        [
            abs(np.expm1(row.error)) - by_scene[row.group, row.scene]
            for row in ours
            if (row.group, row.scene) in by_scene
        ]
    )
    differences = differences[np.isfinite(differences)]
    if not len(differences):
        return float("nan"), float("nan"), float("nan"), 0
    resampled = np.random.default_rng(SEED).choice(differences, (N_RESAMPLES, len(differences))).mean(axis=1)
    low, high = np.quantile(resampled, [0.025, 0.975])
    return float(differences.mean()), float(low), float(high), len(differences)


def write_outcomes(outcomes: Sequence[Outcome], file: Path) -> None:
    """Write one JSON line for each outcome."""
    file.write_text("".join(json.dumps(asdict(row)) + "\n" for row in outcomes), encoding="utf-8")


def read_outcomes(file: Path) -> list[Outcome]:
    """Read the file of `write_outcomes`."""
    return [Outcome(**json.loads(line)) for line in file.read_text(encoding="utf-8").splitlines()]

"""Scores of an estimate against the truth: scale, heights as the paper measures them, coverage, association."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.records.objects import Track
from estimator.records.scene import Instance
from metric_base.arrays import FloatArray
from tests.synthetic.rooms.truth import Truth

__all__ = [
    "AssociationScore",
    "Score",
    "Summary",
    "adjusted_rand_index",
    "association_score",
    "height_error",
    "summary",
]


@dataclass(frozen=True, slots=True)
class Score:
    """One method on one scene.

    error : |scale / true - 1|, None where refused; signed : ln(scale / true); heights : the paper's measure, mean
    relative error of the objects' heights; covered : whether the interval holds the truth, None without an interval;
    ratio : its high over its low.
    """

    scene: str
    method: str
    error: float | None
    signed: float | None
    heights: float | None
    covered: bool | None
    ratio: float | None
    seconds: float


@dataclass(frozen=True, slots=True)
class Summary:
    """Over scenes; medians and the like over those that were not refused, NaN where none is left."""

    scenes: int
    refused: float
    median: float
    mean: float
    p90: float
    bias: float
    heights_median: float
    heights_mean: float
    heights_sd: float
    heights_p90: float
    coverage: float
    ratio: float


@dataclass(frozen=True, slots=True)
class AssociationScore:
    """Adjusted Rand index over masks; splits : tracks too many, merges : objects too few."""

    ari: float
    splits: int
    merges: int
    objects: int


def summary(scores: Sequence[Score]) -> Summary:
    """The figures of one method."""
    errors = _known_values([s.error for s in scores])
    heights = _known_values([s.heights for s in scores])
    covered = _known_values([None if s.covered is None else float(s.covered) for s in scores])
    return Summary(
        len(scores),
        1 - len(errors) / max(len(scores), 1),
        _quantile(errors, 0.5),
        _mean(errors),
        _quantile(errors, 0.9),
        _quantile(_known_values([s.signed for s in scores]), 0.5),
        _quantile(heights, 0.5),
        _mean(heights),
        float(np.std(heights)) if len(heights) else float("nan"),
        _quantile(heights, 0.9),
        _mean(covered),
        _quantile(_known_values([s.ratio for s in scores]), 0.5),
    )


def height_error(scale: float, heights: Sequence[float], tracks: Sequence[str | None], truth: Truth) -> float | None:
    """Mean over objects of |scale * height / true height - 1| (paper section 5.1).

    heights : in scene units, NaN where none was measured; tracks : the true object of each. Tilted objects and such as
    move have no height of their own in the scene and are left out.
    """
    errors = []
    for height, track in zip(heights, tracks, strict=True):
        item = truth.objects.get(track) if track else None
        if item is None or not np.isfinite(height) or item.tilt_deg or np.any(item.velocity):
            continue
        errors.append(abs(scale * height / float(item.size[2]) - 1))
    return float(np.mean(errors)) if errors else None


def association_score(
    instances: Sequence[Instance], tracks: Sequence[Track], among: Sequence[bool] | None = None
) -> AssociationScore:
    """Found tracks against the true ones, over the masks that any track holds; with `among`, over these only."""
    track_of = {row: number for number, track in enumerate(tracks) for row in track.members}
    rows = sorted(row for row in track_of if among is None or among[row])
    true = [str(instances[row].track) for row in rows]
    pairs = {(name, track_of[row]) for name, row in zip(true, rows, strict=True)}
    per_object, per_track = Counter(name for name, _ in pairs), Counter(number for _, number in pairs)
    ari = adjusted_rand_index(true, [str(track_of[row]) for row in rows])
    return AssociationScore(
        ari, sum(n - 1 for n in per_object.values()), sum(n - 1 for n in per_track.values()), len(per_object)
    )


def adjusted_rand_index(first: Sequence[str], second: Sequence[str]) -> float:
    """Agreement of two partitions corrected for chance (Hubert and Arabie 1985); 1 where both put all alike."""

    def pairs(counts: Counter[str] | Counter[tuple[str, str]]) -> float:
        return sum(n * (n - 1) / 2 for n in counts.values())

    both = pairs(Counter(zip(first, second, strict=True)))
    one, other = pairs(Counter(first)), pairs(Counter(second))
    total = len(first) * (len(first) - 1) / 2
    if total == 0:
        return 1.0
    chance, most = one * other / total, (one + other) / 2
    return 1.0 if most == chance else (both - chance) / (most - chance)


def _known_values(values: Sequence[float | None]) -> FloatArray:
    return np.array([value for value in values if value is not None], dtype=float)


def _quantile(values: FloatArray, share: float) -> float:
    return float(np.quantile(values, share)) if len(values) else float("nan")


def _mean(values: FloatArray) -> float:
    return float(values.mean()) if len(values) else float("nan")

"""What contradicts itself: known lengths and objects, or objects that all have one name. No scale is then better."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from estimator.posterior.likelihood import ObjectEvidence
from estimator.posterior.posterior import Posterior, posterior
from estimator.records.scale_evidence import ScaleEvidence
from estimator.results.object_verdicts import verdict

__all__ = ["MIN_KEPT_WEIGHT", "Contradiction", "contradiction_of", "doubt_of_one_name"]

#: Known lengths contradict the objects altogether when these keep less than this share of the weight (the summed
#: probability of being what their labels say) that they have among themselves: most of them are then disbelieved.
MIN_KEPT_WEIGHT = 0.5

#: They also do where the objects alone leave this little of their posterior at the length's scale or further out.
MIN_TAIL_MASS = 1e-4

#: Objects of one name contradict each other where this share of them are outliers, and so many. In synthetic rooms
#: whose masks are all called "person" it is .31 to 1; among the objects that do have one name, at most .2.
LEAST_ALIKE_OUTLIERS, MIN_ALIKE_OUTLIERS = 0.3, 2


@dataclass(frozen=True, slots=True)
class Contradiction:
    """Known lengths outside the interval of the objects alone.

    with_known : metres per unit of all evidence; low, high : the objects' own interval; outliers : how many of the
    `objects` are outliers at the first; kept : the share of their weight that is left; chance : what the objects
    alone leave of their posterior at the length's scale or further out.
    """

    with_known: float
    low: float
    high: float
    outliers: int
    objects: int
    kept: float
    chance: float

    @property
    def most(self) -> bool:
        """Whether most objects, or all a little, would have to be wrong: unresolved unless the length is trusted."""
        return self.kept < MIN_KEPT_WEIGHT or self.chance < MIN_TAIL_MASS

    def line(self, trusted: bool) -> str:
        """The warning; `trusted` : the length is believed all the same."""
        scales = f"{self.with_known:.4g} m per unit, {self.low:.4g} to {self.high:.4g} by the objects alone"
        check = "check the points, the metres and the labels"
        if not self.most:
            return f"the known lengths are outside the objects' own interval: {scales}; {check}"
        count = f"{self.outliers} of {self.objects} objects would be outliers"
        if self.kept >= MIN_KEPT_WEIGHT:
            count = f"the objects leave it a chance of less than {MIN_TAIL_MASS:g}"
        start = "" if trusted else "unresolved: "
        override = "" if trusted else " (--trust-known-length overrides)"
        return f"{start}the known lengths contradict the objects: {scales}, and {count}; {check}{override}"


def contradiction_of(
    estimate: Posterior, evidence: Sequence[ObjectEvidence], lines: Sequence[ScaleEvidence]
) -> Contradiction | None:
    """How certain lines (without doubt) contradict the n objects of the posterior; None where they do not."""
    certain = [item.scale for item in lines if item.doubt == 0 and item.scale is not None]
    if not evidence or not certain:
        return None
    alone = posterior(evidence, level=estimate.level)
    low, high = alone.interval
    if all(low <= scale <= high for scale in certain):
        return None
    kept = float(estimate.weight.sum()) / max(float(alone.weight.sum()), 1e-9)
    outliers = sum(verdict(float(weight)) == "outlier" for weight in estimate.weight)
    chance = min(_tail(alone, math.log(scale)) for scale in certain)
    return Contradiction(estimate.modes[0].scale, low, high, outliers, len(evidence), kept, chance)


def doubt_of_one_name(estimate: Posterior, evidence: Sequence[ObjectEvidence]) -> str | None:
    """Why no scale follows where all objects have one name and many do not have its sizes; None where they do.

    A few of any sizes agree by chance, and no other name says that they are not what they are called.
    """
    names = {item.object.category for item in evidence}
    outliers = sum(verdict(float(weight)) == "outlier" for weight in estimate.weight)
    if len(names) != 1 or outliers < max(MIN_ALIKE_OUTLIERS, LEAST_ALIKE_OUTLIERS * len(evidence)):
        return None
    name = next(iter(names))
    return f"{outliers} of {len(evidence)} objects are outliers, and all are called {name!r}: their labels are wrong"


def _tail(alone: Posterior, u: float) -> float:
    """The mass of a posterior at log scale u and beyond, on the side of u that is further out."""
    curve = alone.curve
    mass = curve.density / curve.density.sum() * (1 - curve.below - curve.above)
    below = curve.below + float(mass[curve.log_scale <= u].sum())
    return min(below, 1 - below + 1e-12)

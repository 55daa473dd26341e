"""Known lengths that the objects contradict: one of both is wrong, and no scale is better than a wrong one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from estimator.posterior.likelihood import ObjectEvidence
from estimator.posterior.posterior import Posterior, posterior
from estimator.results.verdicts import verdict

__all__ = ["KEPT", "Contradiction", "contradiction_of"]

#: Known lengths contradict the objects when these keep less than this share of the weight (the summed probability
#: of not being an outlier) that they have among themselves: most of what spoke for another scale is then disbelieved.
KEPT = 0.5


@dataclass(frozen=True, slots=True)
class Contradiction:
    """Known lengths against objects.

    with_known, without : metres per unit, of all evidence and of the objects alone; outliers : how many of the
    `objects` are outliers at the first.
    """

    with_known: float
    without: float
    outliers: int
    objects: int

    @property
    def total(self) -> bool:
        """Whether no object is left that bears the known lengths out: the scene is unresolved."""
        return self.outliers == self.objects

    def line(self) -> str:
        """The warning."""
        scales = f"{self.with_known:.4g} m per unit with the known lengths, {self.without:.4g} by the objects alone"
        check = "check the points, the metres and the labels"
        if self.total:
            return f"unresolved: the known lengths contradict every object: {scales}; {check}"
        count = f"{self.outliers} of {self.objects} objects are outliers at the first"
        return f"the known lengths contradict the objects: {scales}, and {count}; {check}"


def contradiction_of(found: Posterior, evidence: Sequence[ObjectEvidence]) -> Contradiction | None:
    """How known lengths contradict the n objects of the posterior `found`; None where they do not."""
    if not evidence or not len(found.known):
        return None
    alone = posterior(evidence, level=found.level)
    if float(found.weight.sum()) >= KEPT * float(alone.weight.sum()):
        return None
    outliers = sum(verdict(float(weight)) == "outlier" for weight in found.weight)
    return Contradiction(found.modes[0].scale, alone.modes[0].scale, outliers, len(evidence))

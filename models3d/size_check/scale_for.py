"""Estimate the scale of one object from its category and proportions, without a file or a scene.

The kinds of scale of `check-asset` and the posterior of the true size are multiplied by the likelihood of the evidence
about the factor: with factors f_i, standard deviations s_i of their logarithms and probabilities d_i of a mistake,

    L(u) = prod_i [(1 - d_i) N(u; ln f_i, s_i^2) + d_i / (2 ln `ARBITRARY_RANGE`)].
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from metric_base.arrays import FloatArray
from metric_base.errors import InputError
from metric_base.parsing import finite_numbers
from metric_tree.axes import AXES
from metric_tree.tree import Tree, open_tree
from models3d.asset import MAX_COORDINATE_M, AssetBody, Up
from models3d.size_check.category import named_category
from models3d.size_check.check import Verdict, miniature_chance, verdict_of
from models3d.size_check.hypotheses import ARBITRARY_RANGE, hypotheses
from models3d.size_check.size_model import node_model
from models3d.size_check.true_size import LEVEL, common_factor

#: Prior probability that evidence about the factor is wrong, as for evidence in a scene.
DOUBT = 0.1


@dataclass(frozen=True, slots=True)
class FactorEvidence:
    """Evidence about the factor, such as the estimate of another program: ln factor ~ N(ln `factor`, `sd_log`^2)."""

    factor: float
    sd_log: float
    doubt: float = DOUBT  #: Probability that it is wrong.

    def __post_init__(self) -> None:
        if not (0 < self.factor < math.inf and 0 < self.sd_log < math.inf and 0 <= self.doubt < 1):
            expected = "a positive factor, a positive sd_log and a doubt of at least 0, below 1"
            raise InputError.at("scale_for", "evidence", expected, (self.factor, self.sd_log, self.doubt))


@dataclass(frozen=True, slots=True)
class ObjectScale:
    """The factor that turns the extents of an object into metres."""

    node_id: str
    factor: float  #: Factor of the verdict, 1 if it is `right`; the median if the verdict has none.
    median: float  #: Median of the posterior by the proportions and the evidence, whatever the unit.
    low: float  #: Ends of its interval with the probability `level`, extended to the factor if it is outside.
    high: float
    level: float
    verdict: Verdict  #: Verdict on the extents as metres.
    probability: float  #: Probability of the verdict.
    reason: str
    tier: str | None  #: Evidence tier of the sizes of the category.

    def to_json(self) -> dict[str, Any]:
        """Return the fields as a JSON object."""
        return asdict(self)


def scale_for(
    category: str,
    extents: Sequence[float] | Mapping[str, float],
    *,
    evidence: Sequence[FactorEvidence | tuple[float, float]] = (),
    up: Up | None = None,
    tree: Tree | None = None,
) -> ObjectScale:
    """Estimate the factor from the units of an object to metres.

    Parameters
    ----------
    category : str
        Name of the category, as detectors write it.
    extents : sequence of three float, or mapping
        Extents along x, y, z, or `length`, `width` and `height`; in metres or in unknown units.
    evidence : sequence of FactorEvidence or (factor, sd_log)
        Other estimates of the factor, with the standard deviations of their natural logarithms.
    up : {"x", "y", "z"}, optional
        Vertical axis of a sequence of extents, if it is known.
    tree : Tree, optional
        By default, the shipped release.

    Raises
    ------
    metric_tree.tree.UnknownName
        `category` is not a name of the tree.
    InputError
        An extent or a piece of evidence is invalid, or no size of the category is known.

    Examples
    --------
    >>> import metric_tree
    >>> chair = metric_tree.scale_for("chair", {"length": 52.0, "width": 50.0, "height": 90.0})
    >>> chair.verdict, chair.factor
    ('wrong unit', 0.01)
    """
    if isinstance(extents, Mapping):
        if set(extents) != set(AXES):
            raise InputError.at("scale_for", "extents", "length, width and height", sorted(extents))
        extents, up = [extents[name] for name in AXES], "z"
    sides = np.array(finite_numbers(extents, limit=MAX_COORDINATE_M))
    if sides.shape != (3,) or not (sides > 0).all():
        raise InputError.at("scale_for", "extents", "three positive numbers", sides.tolist())
    tree = tree or open_tree()
    named = named_category(tree, category)
    node = named.node
    model = None if node is None else node_model(tree, node.node_id, named.is_broader)
    if node is None or model is None:
        raise InputError.at("scale_for", "category", "a category with known sizes", category)
    given = [one if isinstance(one, FactorEvidence) else FactorEvidence(*one) for one in evidence]

    def likelihood(log_factor: FloatArray) -> FloatArray:
        """Return the likelihood (n,) of ln factors (n,)."""
        product = np.ones_like(log_factor)
        for one in given:
            z = (log_factor - math.log(one.factor)) / one.sd_log
            density = np.exp(-(z**2) / 2) / (one.sd_log * math.sqrt(2 * math.pi))
            product *= (1 - one.doubt) * density + one.doubt / (2 * math.log(ARBITRARY_RANGE))
        return product

    body = AssetBody(category, np.zeros(3), sides)
    low, median, high, mean_likelihood = common_factor([(body, up, model)], likelihood)
    explained = [
        replace(
            one,
            probability=one.probability
            * (mean_likelihood if one.factor is None else float(likelihood(np.log([one.factor]))[0])),
        )
        for one in hypotheses(body, up, model, miniature_chance(node))
    ]
    total = sum(one.probability for one in explained)
    verdict, factor, probability = verdict_of([replace(one, probability=one.probability / total) for one in explained])
    factor = median if factor is None else factor
    low, high = min(low, factor), max(high, factor)
    return ObjectScale(
        node.node_id,
        factor,
        median,
        low,
        high,
        LEVEL,
        verdict,
        probability,
        f"{verdict} (p = {probability:.2f}) as {node.name}; "
        f"its proportions{f' and {len(given)} estimate(s)' if given else ''} give x {low:.3g} to {high:.3g}",
        node.tier,
    )

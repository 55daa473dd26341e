"""Inner nodes: what a parent believes of its children, and its own prior as a mixture of theirs.

Children count by how common the things are, not by pages: every source is one witness of the shares among its own
items, whether it lists a hundred or a hundred thousand, so that one shop's range does not drown what others show.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from metric_tree.em import Belief, Mixture, floored
from metric_tree.fit import VAGUE, Moments
from metric_tree.prior import FloatArray, Prior

__all__ = ["belief_of", "commonness", "inner_prior", "reduced"]

#: Rows that the parent's covariance counts in a child. Spreads of siblings are alike (a factor 1.5 or so between them),
#: which is what a sample of about eight rows tells of a spread.
COVARIANCE_ROWS = 8.0

#: Bounds on the rows that the parent's mean counts: siblings differ by far more than one class spreads, so that it is a
#: fraction of a row; never none, so that an axis without data stays near its siblings'.
MEAN_ROWS = (0.02, 2.0)

#: What is believed above counts as half a child: it only speaks for axes that no child states.
ABOVE = 0.5

#: Items below a node at which a source has half of a witness's weight: shares among ten are known to a sixth.
WITNESS_HALF = 10.0

#: Part of the weight that all children share alike, for those that no witness holds.
EQUAL_SHARE = 0.1

#: Components of an inner node's prior: its children are many and no four Gaussians hold them, but a reader and the
#: estimator must be able to carry it.
COMPONENTS = 8


def belief_of(children: Sequence[Moments], above: Belief = VAGUE) -> Belief:
    """The parent's moments as a child's belief: normal-inverse-Wishart, siblings equally weighted.

    An axis counts in the children that state it; `above` is what the node above believes.
    """
    if not children:
        return above
    seen = np.array([child.known > 0 for child in children], dtype=float)  # (c, 3)
    means = np.array([child.mean for child in children])
    mass = seen.sum(axis=0)
    mean = (above.mean * ABOVE + (seen * means).sum(axis=0)) / (ABOVE + mass)
    both = seen.T @ seen
    within = np.einsum("ci,cj,cij->ij", seen, seen, np.array([child.within for child in children]))
    covariance = floored((ABOVE * above.covariance + within) / (ABOVE + both))
    offset = seen * (means - mean)
    spread = float((offset**2).sum() / max(mass.sum() - 3, 1)) if len(children) > 1 else 1.0
    mean_rows = float(np.clip(np.trace(covariance) / 3 / max(spread, 1e-6), *MEAN_ROWS))
    return Belief(mean, mean_rows, covariance, COVARIANCE_ROWS)


def commonness(counts: Sequence[Mapping[str, int]], trust: Mapping[str, float]) -> FloatArray:
    """How common each child is, (c,), sum 1: its share in each source, averaged over the sources.

    Parameters
    ----------
    counts : items by source of each child; trust : weight of a source's kind (`evidence.KIND_WEIGHT`)
    """
    equal = np.full(len(counts), 1 / len(counts))
    sources = sorted({source for count in counts for source in count})
    items = np.array([[count.get(source, 0) for source in sources] for count in counts], dtype=float)  # (c, s)
    below = items.sum(axis=0)
    witness = np.array([trust[source] for source in sources]) * below / (below + WITNESS_HALF)
    if not witness.sum() > 0:
        return equal
    shares: FloatArray = EQUAL_SHARE * equal + (1 - EQUAL_SHARE) * (items / below) @ witness / witness.sum()
    return shares


def inner_prior(node_id: str, children: Sequence[Prior], weights: FloatArray, axes: tuple[str, ...]) -> Prior | None:
    """The mixture of the children's priors by the given weights (c,), reduced to `COMPONENTS`; None of no child.

    It stands over the most of `axes` that any child has, and mixes the children that have them all.
    """
    usable = [number for number, child in enumerate(children) if set(child.dims) <= set(axes)]
    if not usable:
        return None
    mass: dict[tuple[str, ...], float] = {}
    for number in usable:
        mass[children[number].dims] = mass.get(children[number].dims, 0.0) + float(weights[number])
    dims = max(mass, key=lambda had: (len(had), mass[had]))
    kept = [number for number in usable if set(dims) <= set(children[number].dims)]
    having, share = [children[number].marginal(dims) for number in kept], weights[kept] / weights[kept].sum()
    mixture = reduced(
        Mixture(
            np.concatenate([child.weights * part for child, part in zip(having, share, strict=True)]),
            np.concatenate([child.means for child in having]),
            np.concatenate([child.covariances for child in having]),
        ),
        COMPONENTS,
    )
    kinds = sorted({kind for child in having for kind in child.share_by_kind})
    by_kind = np.array([[child.share_by_kind.get(kind, 0.0) for kind in kinds] for child in having])
    return Prior(
        node_id=node_id,
        dims=dims,
        weights=mixture.weights / mixture.weights.sum(),
        means=mixture.means,
        covariances=mixture.covariances,
        shared_covariance=np.einsum("c,cij->ij", share, np.array([child.shared_covariance for child in having])),
        n=sum(children[number].n for number in usable),
        n_sources=max(child.n_sources for child in having),
        share_by_kind=dict(zip(kinds, (share @ by_kind).tolist(), strict=True)),
        borrowed=0.0,
    )


def reduced(mixture: Mixture, components: int) -> Mixture:
    """The mixture with the cheapest pairs merged, moments kept (Runnalls 2007, upper bound of the divergence).

    Merging i and j costs ((w_i + w_j) ln|S_ij| - w_i ln|S_i| - w_j ln|S_j|) / 2.
    """
    weights, means, covariances = mixture.weights.copy(), mixture.means.copy(), mixture.covariances.copy()
    cost = np.array([_costs(weights, means, covariances, i) for i in range(len(weights))])
    while len(weights) > components:
        i, j = sorted(divmod(int(np.argmin(cost)), len(cost)))
        weights[i], means[i], covariances[i] = _merged(weights, means, covariances, i, j)
        keep = np.arange(len(weights)) != j
        weights, means, covariances = weights[keep], means[keep], covariances[keep]
        cost = cost[np.ix_(keep, keep)]
        cost[i] = cost[:, i] = _costs(weights, means, covariances, i)
    return Mixture(weights, means, covariances)


def _pair(
    weights: FloatArray, means: FloatArray, covariances: FloatArray, i: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Weights (k,), means (k, d), covariances (k, d, d) of component i merged with each."""
    total = weights + weights[i]
    a, b = (weights[i] / total)[:, None], (weights / total)[:, None]
    offset = means - means[i]
    outer = (a * b)[:, :, None] * offset[:, :, None] * offset[:, None, :]
    return total, a * means[i] + b * means, a[:, :, None] * covariances[i] + b[:, :, None] * covariances + outer


def _costs(weights: FloatArray, means: FloatArray, covariances: FloatArray, i: int) -> FloatArray:
    total, _, merged = _pair(weights, means, covariances, i)
    log_det = np.linalg.slogdet(covariances)[1]
    cost: FloatArray = 0.5 * (total * np.linalg.slogdet(merged)[1] - weights[i] * log_det[i] - weights * log_det)
    cost[i] = np.inf
    return cost


def _merged(
    weights: FloatArray, means: FloatArray, covariances: FloatArray, i: int, j: int
) -> tuple[float, FloatArray, FloatArray]:
    total, mean, covariance = _pair(weights, means, covariances, i)
    return float(total[j]), mean[j], covariance[j]

"""Inner nodes: what a parent believes of its children, and its own prior as a mixture of theirs.

How common the children of a node are, and which of them people mean by its plain name.

Children count by how common the objects are, not pages. Where a reviewer has stated how often people mean which child
by the plain name (`data/curated/frequencies.csv`), that holds. Else the leaf of objects that are called by the plain
name alone has at least `PLAIN_SHARE`, and every source is one witness of the shares of the others among its own items,
whether it lists a hundred or a hundred thousand, so that one shop's range does not drown what others show.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from metric_base.arrays import FloatArray
from metric_tree.fit.contexts import inner_contexts
from metric_tree.fit.mixture import Belief, Mixture, raise_to_floor
from metric_tree.fit.moments import VAGUE, Moments
from metric_tree.prior import Prior
from metric_tree.tiers import Evidence, mixture_tier
from taxonomy.categories import Category

#: Rows that the parent's covariance counts in a child. Spreads of siblings are alike (a factor 1.5 or so between them),
#: which is how well a sample of about eight rows shows a spread.
COVARIANCE_ROWS = 8.0
#: Bounds on the rows that the parent's mean counts: siblings differ by far more than one class spreads, so that it is a
#: fraction of a row; never none, so that an axis without data stays near its siblings'.
MEAN_ROWS = (0.02, 2.0)
#: What is believed above counts as half a child: it only covers axes that no child states.
PARENT_WEIGHT = 0.5
#: A single axis has a prior of its own where this much more of the children's weight states it than the joint prior.
MORE = 0.1
#: Components of an inner node's prior: its children are many and no four Gaussians hold them, but a reader and the
#: estimator must be able to carry it.
COMPONENTS = 8
#: Items below a node at which a source has half of a witness's weight: shares among ten are known to a sixth.
WITNESS_HALF = 10.0
#: Weight of the leaf `<id>/other` in its node: of objects of 97 kinds that have thirty labels or more in ScanNet and
#: Matterport3D, annotators give 79 % the plain name, on average over the kinds (half of the kinds: 97 % and more).
PLAIN_SHARE = 0.8
#: Last words of the names of parts, and of objects for another object: a toilet seat, a knife set, a mirror cabinet.
PART_WORDS = frozenset({
    "cab", "cabinet", "cover", "frame", "front", "handle", "holder", "insert", "leg", "lid", "part", "piece", "seat",
    "set", "stand", "tank", "tool", "topper", "trailer", "tray",
})  # fmt: skip
#: How far a source of a kind is a witness of how common objects are. Measured rooms and streets show it, shops
#: show what is bought, artists what they like to draw; what a museum keeps is rare.
WITNESS = {
    "measured": 1.0,
    "product": 0.5,
    "standard": 0.1,
    "asset": 0.2,
    "museum": 0.01,
    "default": 0.1,
    "judged": 0.0,
    "norm": 0.0,
    "statistic": 0.0,
}
#: Sources of products, measurements and tables of norms have this or more.
REAL_WITNESS = 0.5
#: Part of the weight that all children share alike, for those that no witness holds ...
EQUAL_SHARE = 0.1
#: ... and more of it while the witnesses together weigh little against this: two models of toys say nothing of what is
#: common on a street.
EQUAL_WITNESS = 0.5
#: How far a child that only this kind of evidence speaks of is an object of today, in what all children share
#: alike. What a museum alone keeps is not what people mean.
PRESENCE = {"museum": 0.02, "default": 0.3, "asset": 0.5}


def belief_of(children: Sequence[Moments], above: Belief = VAGUE) -> Belief:
    """The parent's moments as a child's belief: normal-inverse-Wishart, siblings equally weighted.

    An axis counts in the children that state it; `above` is what the node above believes.
    """
    if not children:
        return above
    seen = np.array([child.known > 0 for child in children], dtype=float)  # (c, 3)
    means = np.array([child.mean for child in children])
    mass = seen.sum(axis=0)
    mean = (above.mean * PARENT_WEIGHT + (seen * means).sum(axis=0)) / (PARENT_WEIGHT + mass)
    both = seen.T @ seen
    within = np.einsum("ci,cj,cij->ij", seen, seen, np.array([child.within for child in children]))
    covariance = raise_to_floor((PARENT_WEIGHT * above.covariance + within) / (PARENT_WEIGHT + both))
    offset = seen * (means - mean)
    spread = float((offset**2).sum() / max(mass.sum() - 3, 1)) if len(children) > 1 else 1.0
    mean_rows = float(np.clip(np.trace(covariance) / 3 / max(spread, 1e-6), *MEAN_ROWS))
    return Belief(mean, mean_rows, covariance, COVARIANCE_ROWS)


def inner_priors(
    node_id: str,
    children: Sequence[Sequence[Prior]],
    weights: FloatArray,
    axes: tuple[str, ...],
    plain: Sequence[Prior] = (),
) -> list[Prior]:
    """The priors of an inner node: the joint one that says most, then single axes that more of its children state.

    Parameters
    ----------
    children : the priors of each child, (c,); weights : how common each is; axes : of the frame; plain : the priors of
        the leaf of objects called by the plain name alone, wherever it is below

    A joint prior says as much as it has axes times the weight of the children that have them all: a measured height of
    all people goes before a judged box of some.
    """
    counted = np.flatnonzero(weights > 0)
    children, weights = [children[number] for number in counted.tolist()], weights[counted]
    stated = {dims: _mass(children, weights, dims) for child in children for prior in child for dims in [prior.dims]}
    stated = {dims: mass for dims, mass in stated.items() if set(dims) <= set(axes)}
    if not stated:
        return []
    joint = max(stated, key=lambda dims: (len(dims) * stated[dims], len(dims), dims))
    single = [(axis,) for axis in axes if _mass(children, weights, (axis,)) > stated[joint] * (axis in joint) + MORE]
    return [
        _inner_prior(node_id, children, weights, dims, next((one for _, one in _priors_over([plain], dims)), None))
        for dims in (joint, *(d for d in single if d != joint))
    ]


def _priors_over(children: Sequence[Sequence[Prior]], dims: tuple[str, ...]) -> list[tuple[int, Prior]]:
    """Of each child that has all of `dims` its number and its prior over them."""
    having = []
    for number, priors in enumerate(children):
        containing = [prior for prior in priors if set(dims) <= set(prior.dims)]
        if containing:
            having.append((number, min(containing, key=lambda prior: len(prior.dims)).marginal(dims)))
    return having


def _mass(children: Sequence[Sequence[Prior]], weights: FloatArray, dims: tuple[str, ...]) -> float:
    """The weight of the children that have all of `dims`; weights : (c,)."""
    return float(sum(weights[number] for number, _ in _priors_over(children, dims)))


def _inner_prior(
    node_id: str,
    children: Sequence[Sequence[Prior]],
    weights: FloatArray,
    dims: tuple[str, ...],
    plain: Prior | None = None,
) -> Prior:
    """The mixture of the children's priors over `dims`, reduced to `COMPONENTS`; `plain` is of `<id>/other`.

    weights : (c,) how common each child is.
    """
    numbers, having = zip(*_priors_over(children, dims), strict=True)
    share = weights[list(numbers)] / weights[list(numbers)].sum()
    mixture = reduce_mixture(
        Mixture(
            np.concatenate([child.weights * part for child, part in zip(having, share, strict=True)]),
            np.concatenate([child.means for child in having]),
            np.concatenate([child.covariances for child in having]),
        ),
        COMPONENTS,
    )
    known = [child.evidence for child in having if child.evidence]
    kinds = sorted({kind for child in having for kind in child.share_by_kind})
    shared = np.einsum("c,cij->ij", share, np.array([child.shared_covariance for child in having]))
    by_kind = np.array([[child.share_by_kind.get(kind, 0.0) for kind in kinds] for child in having])
    return Prior(
        node_id=node_id,
        dims=dims,
        weights=mixture.weights / mixture.weights.sum(),
        means=mixture.means,
        covariances=mixture.covariances,
        shared_covariance=shared,
        n=sum(child.n for child in having),
        n_sources=max(child.n_sources for child in having),
        share_by_kind=dict(zip(kinds, (share @ by_kind).tolist(), strict=True)),
        borrowed=0.0,
        tier=mixture_tier(zip([child.tier for child in having], share.tolist(), strict=True)),
        evidence=Evidence.total(known, max(one.sources for one in known)) if known else None,
        contexts=inner_contexts(having, share, np.diagonal(shared), plain),
    )


def reduce_mixture(mixture: Mixture, components: int) -> Mixture:
    """The mixture with the cheapest pairs merged, moments kept (Runnalls 2007, upper bound of the divergence).

    Merging i and j costs ((w_i + w_j) ln|S_ij| - w_i ln|S_i| - w_j ln|S_j|) / 2.
    """
    weights, means, covariances = mixture.weights.copy(), mixture.means.copy(), mixture.covariances.copy()
    cost = np.array([_costs(weights, means, covariances, i) for i in range(len(weights))])
    while len(weights) > components:
        i, j = sorted(divmod(int(np.argmin(cost)), len(cost)))
        weights[i], means[i], covariances[i] = _merge(weights, means, covariances, i, j)
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
    """(k,) what it costs to merge component i with each, infinite for itself.

    weights : (k,); means : (k, d); covariances : (k, d, d).
    """
    total, _, merged = _pair(weights, means, covariances, i)
    log_det = np.linalg.slogdet(covariances)[1]
    cost: FloatArray = 0.5 * (total * np.linalg.slogdet(merged)[1] - weights[i] * log_det[i] - weights * log_det)
    cost[i] = np.inf
    return cost


def _merge(
    weights: FloatArray, means: FloatArray, covariances: FloatArray, i: int, j: int
) -> tuple[float, FloatArray, FloatArray]:
    """Weight, mean (d,) and covariance (d, d) of components i and j as one.

    weights : (k,); means : (k, d); covariances : (k, d, d).
    """
    total, mean, covariance = _pair(weights, means, covariances, i)
    return float(total[j]), mean[j], covariance[j]


def presence(children: Sequence[Sequence[Prior]]) -> FloatArray:
    """How far each child is an object of today, (c,), by the kinds of evidence in its prior (`PRESENCE`)."""
    shares = (own[0].share_by_kind if own else {} for own in children)
    return np.array([sum(PRESENCE.get(kind, 1.0) * part for kind, part in one.items()) or 1.0 for one in shares])


def commonness(
    counts: Sequence[Mapping[str, int]], trust: Mapping[str, float], present: FloatArray | None = None
) -> FloatArray:
    """How common each child is, (c,), sum 1: its share in each source, averaged over the sources.

    Parameters
    ----------
    counts : items by source of each child; trust : weight of a source's kind (`WITNESS`)
    present : (c,) parts of what all children share alike (`presence`); the same for all by default
    """
    equal = np.full(len(counts), 1 / len(counts)) if present is None else present / present.sum()
    sources = sorted({source for count in counts for source in count})
    items = np.array([[count.get(source, 0) for source in sources] for count in counts], dtype=float)  # (c, s)
    below = items.sum(axis=0)
    witness = np.array([trust[source] for source in sources]) * below / (below + WITNESS_HALF)
    if not witness.sum() > 0:
        return equal
    alike = max(EQUAL_SHARE, EQUAL_WITNESS / (EQUAL_WITNESS + witness.sum()))
    shares: FloatArray = alike * equal + (1 - alike) * (items / below) @ witness / witness.sum()
    return shares


def plain_weights(
    node_id: str,
    children: Sequence[str],
    common: FloatArray,
    stated: Mapping[str, float] | None = None,
    kinds: Sequence[bool] | None = None,
) -> FloatArray:
    """Weight of each child in what people call by the node's plain name, (c,), sum 1.

    Parameters
    ----------
    common : (c,) how common each child is; stated : a reviewer's weights by child, which hold where there are any
    kinds : (c,) whether the child is called by the plain name; where objects of the plain name have a leaf, the others
        weigh nothing: an ironing board hangs on `iron`, and nobody calls it so
    """
    if stated and (total := sum(stated.get(child, 0.0) for child in children)) > 0:
        return np.array([stated.get(child, 0.0) / total for child in children])
    parts = np.array([is_part(child, node_id) for child in children])
    if parts.any() and not parts.all():
        common = np.where(parts, 0.0, common) / max(float(common[~parts].sum()), 1e-12)
    plain = np.array([child == f"{node_id}/other" for child in children])
    if not plain.any() or plain.all():
        return common
    if kinds is not None:
        called = np.where(np.asarray(kinds) | plain, common, 0.0)
        common = called / called.sum() if called.sum() > 0 else plain / plain.sum()
    if not common[~plain].any():
        return np.asarray(plain / plain.sum())
    least = max(PLAIN_SHARE, float(common[plain].sum()))
    return np.where(plain, least, common * (1 - least) / max(float(common[~plain].sum()), 1e-12))


def is_part(child_id: str, node_id: str) -> bool:
    """Return True if a child is a part of the node, or an object for it, by its name: a toilet seat is no toilet.

    >>> is_part("toilet_seat.n.01", "toilet.n.02"), is_part("flush_toilet.n.01", "toilet.n.02")
    (True, False)
    """
    child, node = (name.removeprefix("mt:").partition(".n.")[0] for name in (child_id, node_id))
    return child.startswith(f"{node}_") and child.rpartition("_")[2] in PART_WORDS


def is_called(child: Category, node: Category) -> bool:
    """Return True if people use the plain name of a node for a child.

    The child is a hyponym in WordNet, or its name ends in the name of the node: a steam iron is an iron, an ironing
    board is not.
    """
    if node.synset is not None and node.synset in child.hypernyms:
        return True
    plain = {name.lower() for name in (node.name, *node.aliases)}
    names = (name.lower().replace("-", " ") for name in (child.name, *child.aliases))
    return any(name in plain or any(name.endswith(f" {one}") for one in plain) for name in names)

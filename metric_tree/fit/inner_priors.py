"""Priors of inner nodes: expectation for their children, their prior as a mixture, and the weights of the children.

The weight of a child is the frequency of its objects, not of its web pages. Frequencies of a reviewer
(`data/curated/frequencies.csv`) take precedence. Otherwise the leaf `<id>/other`, whose objects have the plain name of
the node, has at least `PLAIN_NAME_WEIGHT`. Each source estimates the fractions of the other children from its items,
and has the same weight for a hundred items or a hundred thousand, so that a single shop does not dominate.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from metric_base.arrays import FloatArray
from metric_tree.fit.contexts import inner_contexts
from metric_tree.fit.mixture import Mixture, NormalInverseWishart, raise_to_floor, reduce_mixture
from metric_tree.fit.moments import VAGUE, Moments
from metric_tree.prior import Prior
from metric_tree.tiers import Evidence, mixture_tier
from taxonomy.categories import Category
from taxonomy.words.phrases import word_list

#: Weight of the covariance of the parent in a child, in rows. Standard deviations of siblings differ by a factor of
#: about 1.5, which is also the accuracy of a standard deviation from eight rows.
COVARIANCE_ROWS = 8.0
#: Minimum and maximum weight of the mean of the parent in a child, in rows. Siblings differ by much more than the
#: standard deviation of one class; the minimum keeps an axis without data close to the siblings.
MEAN_ROWS = (0.02, 2.0)
#: Weight of the expectation of the parent relative to a child. It only covers axes that no child states.
PARENT_WEIGHT = 0.5
#: Minimum weight of further children, 0 to 1, for a separate prior of a single axis: children that state this axis but
#: not all axes of the joint prior.
MIN_EXTRA_WEIGHT = 0.1
#: Maximum number of components of the prior of an inner node, a compromise between its many children and the size of
#: the table.
COMPONENTS = 8
#: Items below a node at which a source has half of its maximum weight: fractions of ten items have an error of 1/6.
WITNESS_HALF_ITEMS = 10.0
#: Minimum weight of the leaf `<id>/other` in its node, 0 to 1. For the 97 kinds with 30 labels or more in ScanNet and
#: Matterport3D, annotators use the plain name for 79 % of the objects on average (97 % or more for half of the kinds).
PLAIN_NAME_WEIGHT = 0.8
#: Weight of a source of each kind for the frequency of objects, 0 to 1. Measured rooms and streets show it directly,
#: shops show purchases, models the taste of artists, and museums keep rare objects.
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
#: Minimum `WITNESS` of sources of products and measurements.
REAL_WITNESS = 0.5
#: Minimum fraction of the weight that is distributed by `present_fraction`, for children without items.
MIN_EQUAL_FRACTION = 0.1
#: Sum of `WITNESS` at which half of the weight is distributed by `present_fraction`: two models of toys contain no
#: information about the frequency of objects on a street.
EQUAL_HALF_WITNESS = 0.5
#: Relative probability that a child with only this kind of evidence is in use today.
PRESENCE = {"museum": 0.02, "default": 0.3, "asset": 0.5}


def child_belief(children: Sequence[Moments], above: NormalInverseWishart = VAGUE) -> NormalInverseWishart:
    """Estimate the normal-inverse-Wishart prior of a further child of a node from its children, with equal weights.

    Parameters
    ----------
    children : sequence of Moments
        Moments of the children in one frame of axes; a child contributes to the axes that it states.
    above : NormalInverseWishart
        Prior that the node itself has from its parent.
    """
    if not children:
        return above
    is_stated = np.array([child.known > 0 for child in children], dtype=float)  # (c, 3)
    means = np.array([child.mean for child in children])
    mass = is_stated.sum(axis=0)
    mean = (above.mean * PARENT_WEIGHT + (is_stated * means).sum(axis=0)) / (PARENT_WEIGHT + mass)
    both = is_stated.T @ is_stated
    within = np.einsum("ci,cj,cij->ij", is_stated, is_stated, np.array([child.within for child in children]))
    covariance = raise_to_floor((PARENT_WEIGHT * above.covariance + within) / (PARENT_WEIGHT + both))
    offset = is_stated * (means - mean)
    between = float((offset**2).sum() / max(mass.sum() - 3, 1)) if len(children) > 1 else 1.0
    mean_rows = float(np.clip(np.trace(covariance) / 3 / max(between, 1e-6), *MEAN_ROWS))
    return NormalInverseWishart(mean, mean_rows, covariance, COVARIANCE_ROWS)


def inner_priors(
    node_id: str,
    children: Sequence[Sequence[Prior]],
    weights: FloatArray,
    axes: tuple[str, ...],
    plain: Sequence[Prior] = (),
) -> list[Prior]:
    """Return the priors of an inner node: the joint prior, then priors of single axes that more of its children state.

    The joint prior has the dimensions that maximise their number times the weight of the children that state all of
    them. A measured height of all people has precedence over a judged box of some.

    Parameters
    ----------
    node_id : str
        Id of the node.
    children : (c,) sequence of sequences of Prior
        Priors of each child.
    weights : (c,) float
        Weight of each child, sum 1.
    axes : tuple of str
        Axes of the frame of the node.
    plain : sequence of Prior
        Priors of the leaf `<id>/other`, if it exists.
    """
    counted = np.flatnonzero(weights > 0)
    children, weights = [children[index] for index in counted.tolist()], weights[counted]

    def mass(dims: tuple[str, ...]) -> float:
        return float(sum(weights[index] for index, _ in _priors_over(children, dims)))

    stated = {dims: mass(dims) for child in children for dims in (prior.dims for prior in child)}
    stated = {dims: weight for dims, weight in stated.items() if set(dims) <= set(axes)}
    if not stated:
        return []
    joint = max(stated, key=lambda dims: (len(dims) * stated[dims], len(dims), dims))
    single = [(axis,) for axis in axes if mass((axis,)) > stated[joint] * (axis in joint) + MIN_EXTRA_WEIGHT]
    return [
        _mixture_prior(node_id, children, weights, dims, next((one for _, one in _priors_over([plain], dims)), None))
        for dims in (joint, *(dims for dims in single if dims != joint))
    ]


def _priors_over(children: Sequence[Sequence[Prior]], dims: tuple[str, ...]) -> list[tuple[int, Prior]]:
    """Return index and prior over `dims` of each child that has all of them."""
    priors_over = []
    for index, priors in enumerate(children):
        containing = [prior for prior in priors if set(dims) <= set(prior.dims)]
        if containing:
            priors_over.append((index, min(containing, key=lambda prior: len(prior.dims)).marginal(dims)))
    return priors_over


def _mixture_prior(
    node_id: str, children: Sequence[Sequence[Prior]], weights: FloatArray, dims: tuple[str, ...], plain: Prior | None
) -> Prior:
    """Return the mixture of the priors of the children over `dims`, reduced to `COMPONENTS`.

    weights : (c,) weight of each child; plain : prior of `<id>/other` over `dims`.
    """
    indices, having = zip(*_priors_over(children, dims), strict=True)
    share = weights[list(indices)] / weights[list(indices)].sum()
    mixture = reduce_mixture(
        Mixture(
            np.concatenate([child.weights * part for child, part in zip(having, share, strict=True)]),
            np.concatenate([child.means for child in having]),
            np.concatenate([child.covariances for child in having]),
        ),
        COMPONENTS,
    )
    evidence = [child.evidence for child in having if child.evidence]
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
        evidence=Evidence.total(evidence, max(one.sources for one in evidence)) if evidence else None,
        contexts=inner_contexts(having, share, np.diagonal(shared), plain),
    )


def present_fraction(children: Sequence[Sequence[Prior]]) -> FloatArray:
    """Return the probability (c,) that each child is in use today, from the kinds of evidence of its first prior."""
    shares = (priors[0].share_by_kind if priors else {} for priors in children)
    return np.array([sum(PRESENCE.get(kind, 1.0) * part for kind, part in one.items()) or 1.0 for one in shares])


def child_frequencies(
    counts: Sequence[Mapping[str, int]], trust: Mapping[str, float], present: FloatArray | None = None
) -> FloatArray:
    """Estimate the frequency of each child (c,), sum 1: its fraction of the items of a source, averaged over sources.

    Parameters
    ----------
    counts : (c,) sequence of mappings
        Number of items of each child by source.
    trust : mapping
        Weight of each source (`WITNESS`).
    present : (c,) float, optional
        Distribution of the weight for which the sources give no evidence (`present_fraction`); uniform by default.
    """
    equal = np.full(len(counts), 1 / len(counts)) if present is None else present / present.sum()
    sources = sorted({source for count in counts for source in count})
    items = np.array([[count.get(source, 0) for source in sources] for count in counts], dtype=float)  # (c, s)
    below = items.sum(axis=0)
    witness = np.array([trust[source] for source in sources]) * below / (below + WITNESS_HALF_ITEMS)
    if not witness.sum() > 0:
        return equal
    equal_fraction = max(MIN_EQUAL_FRACTION, EQUAL_HALF_WITNESS / (EQUAL_HALF_WITNESS + witness.sum()))
    frequencies: FloatArray = equal_fraction * equal + (1 - equal_fraction) * (items / below) @ witness / witness.sum()
    return frequencies


def plain_name_weights(
    node_id: str,
    children: Sequence[str],
    frequencies: FloatArray,
    stated: Mapping[str, float] | None = None,
    has_name: Sequence[bool] | None = None,
) -> FloatArray:
    """Return the probability (c,) that people mean each child by the plain name of the node, sum 1.

    Parameters
    ----------
    node_id, children : str, (c,) sequence of str
        Ids of the node and of its children.
    frequencies : (c,) float
        Frequency of each child (`child_frequencies`).
    stated : mapping, optional
        Weights of a reviewer by child id; they take precedence.
    has_name : (c,) sequence of bool, optional
        Whether the child shares the plain name (`shares_plain_name`). If `<id>/other` is a child, the children that do
        not share the name have no weight: `ironing board` is below `iron`, but is not called an iron.
    """
    if stated and (total := sum(stated.get(child, 0.0) for child in children)) > 0:
        return np.array([stated.get(child, 0.0) / total for child in children])
    parts = np.array([is_part(child, node_id) for child in children])
    if parts.any() and not parts.all():
        frequencies = np.where(parts, 0.0, frequencies) / max(float(frequencies[~parts].sum()), 1e-12)
    is_other = np.array([child == f"{node_id}/other" for child in children])
    if not is_other.any() or is_other.all():
        return frequencies
    if has_name is not None:
        named = np.where(np.asarray(has_name) | is_other, frequencies, 0.0)
        frequencies = named / named.sum() if named.sum() > 0 else is_other / is_other.sum()
    if not frequencies[~is_other].any():
        return np.asarray(is_other / is_other.sum())
    weight = max(PLAIN_NAME_WEIGHT, float(frequencies[is_other].sum()))
    others = frequencies * (1 - weight) / max(float(frequencies[~is_other].sum()), 1e-12)
    return np.where(is_other, weight, others)


def is_part(child_id: str, node_id: str) -> bool:
    """Return True if a child is a part or an accessory of the node, by its name.

    >>> is_part("toilet_seat.n.01", "toilet.n.02"), is_part("flush_toilet.n.01", "toilet.n.02")
    (True, False)
    """
    child, node = (name.removeprefix("mt:").partition(".n.")[0] for name in (child_id, node_id))
    return child.startswith(f"{node}_") and child.rpartition("_")[2] in word_list("accessories")


def shares_plain_name(child: Category, node: Category) -> bool:
    """Return True if people use the plain name of a node for a child.

    The child is a hyponym in WordNet, or its name ends with the name of the node: a steam iron is an iron, an ironing
    board is not.
    """
    if node.synset is not None and node.synset in child.hypernyms:
        return True
    plain = {name.lower() for name in (node.name, *node.aliases)}
    names = (name.lower().replace("-", " ") for name in (child.name, *child.aliases))
    return any(name in plain or any(name.endswith(f" {one}") for one in plain) for name in names)

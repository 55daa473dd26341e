"""The rule that proposes three inner levels out of WordNet's paths of 1 to 20 steps (docs/explanation/levels.md).

Levels are nested cuts of the tree of hypernyms. A cut is a set of synsets such that every leaf has exactly one of them
above it. The cost of a cut is the squared error that stays within its synsets when each is described by its mean log
size, plus a price for each synset; familiar synsets are cheaper. The cheapest cut for a price is found from the leaves
up, as in cost-complexity pruning of a decision tree (Breiman and others, Classification and Regression Trees, 1984,
section 3.3), whose cuts for rising prices are nested. Three prices give kinds, families and realms. The result depends
on the set of leaves and on nothing else: not on their order, not on depth in WordNet.

What comes out is a proposal. The levels that ship were read and mended by a reader, and are frozen (`taxonomy.levels`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["PRICES", "FloatArray", "cut", "explained", "nested_cuts"]

FloatArray = NDArray[np.float64]

#: Prices of a kind, a family and a realm, in squared units of log size summed over leaves: on the sizes of 2026-11 they
#: give cuts about as fine as people name things by, some five hundred kinds, a hundred families, a few tens of realms.
PRICES = (2.0, 20.0, 50.0)

#: Share of the price that the most familiar synsets are let off.
_FAMILIARITY = 0.5


@dataclass(slots=True)
class _Sums:
    """Weight, sum and sum of squares of the log sizes below a synset, (d,) each."""

    weight: float
    first: FloatArray
    second: FloatArray

    def error(self) -> float:
        """Squared error about the mean."""
        if not self.weight:
            return 0.0
        return float((self.second - self.first**2 / self.weight).sum())


def nested_cuts(
    paths: Mapping[str, Sequence[str]],
    log_sizes: Mapping[str, FloatArray],
    familiarity: Mapping[str, float],
    prices: Sequence[float] = PRICES,
) -> list[dict[str, str]]:
    """Cuts for rising prices, each as the synset above every leaf.

    Parameters
    ----------
    paths : hypernyms of each leaf from the root to the leaf itself; where WordNet has several, the caller chooses
    log_sizes : (d,) mean log size of leaves that have one; others follow their neighbours
    familiarity : 0 to 1 by synset, 0 where missing.
    """
    return [cut(paths, log_sizes, familiarity, price) for price in sorted(prices)]


def cut(
    paths: Mapping[str, Sequence[str]],
    log_sizes: Mapping[str, FloatArray],
    familiarity: Mapping[str, float],
    price: float,
) -> dict[str, str]:
    """The cheapest cut for a price: the synset above each leaf; of two alike, the one nearer the root."""
    parent = _parents(paths)
    children, order = _tree(parent)
    sums = _sums(order, children, log_sizes)
    cost: dict[str, float] = {}
    kept: dict[str, bool] = {}
    for node in reversed(order):
        own = sums[node].error() + price * (1 - _FAMILIARITY * familiarity.get(node, 0.0))
        below = sum(cost[child] for child in children[node])
        kept[node] = not children[node] or node in paths or own <= below
        cost[node] = own if kept[node] else below
    return {leaf: next(node for node in _above(leaf, parent) if kept[node]) for leaf in sorted(paths)}


def explained(groups: Mapping[str, str], log_sizes: Mapping[str, FloatArray], weights: Mapping[str, float]) -> float:
    """Share of the variance of log size that lies between groups, all axes together; leaves count by weight."""
    leaves = sorted(set(groups) & set(log_sizes))
    if not leaves:
        return 0.0
    names = np.array([groups[leaf] for leaf in leaves])
    values = np.array([log_sizes[leaf] for leaf in leaves])  # (n, d)
    mass = np.array([weights.get(leaf, 1.0) for leaf in leaves])  # (n,)
    mean = np.average(values, axis=0, weights=mass)
    total = float((mass[:, None] * (values - mean) ** 2).sum())
    _, code = np.unique(names, return_inverse=True)
    group_mass = np.bincount(code, mass)
    sums = np.stack([np.bincount(code, mass * values[:, axis]) for axis in range(values.shape[1])], axis=1)
    between = float((group_mass[:, None] * (sums / group_mass[:, None] - mean) ** 2).sum())
    return between / total if total else 0.0


def _parents(paths: Mapping[str, Sequence[str]]) -> dict[str, str | None]:
    """The node above each.

    A synset that several paths reach by different parents keeps the first of them in the order of leaves' names, so
    that there is one path to each whatever the order of the input.
    """
    parent: dict[str, str | None] = {}
    for leaf in sorted(paths):
        for above, below in zip((None, *paths[leaf]), paths[leaf], strict=False):
            parent.setdefault(below, above)
    return parent


def _tree(parent: Mapping[str, str | None]) -> tuple[dict[str, list[str]], list[str]]:
    """Children of every node, sorted, and all nodes with parents first."""
    children: dict[str, list[str]] = {node: [] for node in sorted(parent)}
    for node in sorted(parent):
        above = parent[node]
        if above is not None:
            children[above].append(node)
    order = sorted(node for node, above in parent.items() if above is None)
    for node in order:
        order.extend(children[node])
    return children, order


def _above(leaf: str, parent: Mapping[str, str | None]) -> list[str]:
    """The leaf and all nodes above it, root first."""
    chain: list[str] = []
    node: str | None = leaf
    while node is not None:
        chain.append(node)
        node = parent[node]
    return chain[::-1]


def _sums(order: list[str], children: dict[str, list[str]], log_sizes: Mapping[str, FloatArray]) -> dict[str, _Sums]:
    axes = len(next(iter(log_sizes.values()))) if log_sizes else 1
    sums: dict[str, _Sums] = {}
    for node in reversed(order):
        own = log_sizes.get(node)
        first = np.zeros(axes) if own is None else own.astype(float)
        total = _Sums(float(own is not None), first.copy(), first**2)
        for child in children[node]:
            total.weight += sums[child].weight
            total.first += sums[child].first
            total.second += sums[child].second
        sums[node] = total
    return sums

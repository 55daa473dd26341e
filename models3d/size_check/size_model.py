"""The density of the extents that a true-sized model of a category has: the size prior, widened by what artists do.

A model is an artist's object: its size differs from that of the objects it shows by an error common to its three sides
and by one of each side. A share of the models, larger where the prior rests on less, shows something unlike the prior.
With x = ln of the extents in mm and a component k of the prior,

    p(x) = sum_k w_k [(1 - e) N(x; m_k, C_k) + e N(x; m_k, C_k + wide)],  C_k = S_k + B + artist
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from metric_base.arrays import FloatArray
from metric_tree.node import Node
from metric_tree.prior import Prior
from metric_tree.tree import Tree

#: Error of an artist's model: common to its sides, and of each side (sd of the natural log). Chosen on half of the
#: categories of 707 open models (docs/evidence/assets.md).
ARTIST_COMMON_SD, ARTIST_OWN_SD = 0.15, 0.12
#: What is unlike the prior differs by this much more, in common and by side.
UNLIKE_COMMON_SD, UNLIKE_OWN_SD = 0.6, 0.5
#: Share of models that are unlike the prior, by what the prior rests on.
UNLIKE_SHARE = {"norm": 0.05, "measured": 0.05, "few": 0.08, "models": 0.08, "borrowed": 0.15, "judged": 0.12}
#: Where a release does not say what its priors rest on.
UNLIKE_UNKNOWN = 0.1
#: The least share where the category is a broader kind of what the file names.
UNLIKE_BROADER = 0.3
NAMED = ("length", "width", "height")
SORTED = ("extent1", "extent2", "extent3")


@lru_cache(maxsize=4096)
def _models(tree: Tree, node_id: str, is_broader: bool) -> SizeModel | None:
    node = tree.node(node_id)
    if not node.prior_dims:
        return None
    dims = max(node.prior_dims, key=lambda names: (len(names), names == node.dims))
    return size_model(node.prior(dims), node_tier(node), is_broader=is_broader)


@dataclass(frozen=True, eq=False)
class SizeModel:
    """A mixture of Gaussians over ln mm.

    axes : (d,) which of length, width, height (or, if `is_sorted`, of the extents, longest first) the model covers;
    weights : (k,); means : (k, d); covariances : (k, d, d).
    """

    axes: tuple[int, ...]
    is_sorted: bool
    weights: FloatArray
    means: FloatArray
    covariances: FloatArray

    def log_density(self, x: FloatArray) -> FloatArray:
        """Log density of ln mm, x : (n, 3) -> (n,)."""
        return self._mixture(self._quadratic(x)[0])

    def log_evidence(self, x: FloatArray) -> FloatArray:
        """Log of the integral of the density of x + u over all u: what the proportions say, x : (n, 3) -> (n,).

        For a component with r = m - x, L = C^-1, l = 1'L1 and u = 1'Lr / l it is
        |C|^(-1/2) l^(-1/2) exp(-(r'Lr - l u^2) / 2) (2 pi)^(-(d-1)/2).
        """
        log_terms, u, precision = self._shifts(x)
        del u, precision
        return self._mixture(log_terms)

    def shift_components(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The posterior of u with x + u from this density, for one x : (3,): weights, means and sds, (k,) each."""
        log_terms, u, precision = self._shifts(x[None])
        logs = log_terms[0] + np.log(self.weights)
        weights = np.exp(logs - logs.max())
        return weights / weights.sum(), u[0], 1 / np.sqrt(precision)

    def without(self, axis: int) -> SizeModel:
        """The exact marginal without one of `axes`."""
        keep = np.array([place for place, one in enumerate(self.axes) if one != axis])
        return SizeModel(
            tuple(self.axes[place] for place in keep),
            self.is_sorted,
            self.weights,
            self.means[:, keep],
            self.covariances[:, keep[:, None], keep],
        )

    @cached_property
    def _inverse(self) -> FloatArray:
        """(k, d, d)."""
        return np.asarray(np.linalg.inv(self.covariances))

    @cached_property
    def _log_norm(self) -> FloatArray:
        """(k,)."""
        return np.asarray(-0.5 * (np.linalg.slogdet(self.covariances)[1] + len(self.axes) * np.log(2 * np.pi)))

    def _quadratic(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Log density of each component, (n, k), and the residuals m - x, (n, k, d)."""
        residual = self.means - x[:, None, list(self.axes)]
        squares = np.einsum("nki,kij,nkj->nk", residual, self._inverse, residual)
        return self._log_norm - squares / 2, residual

    def _shifts(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Log evidence (n, k), best shift (n, k) and its precision (k,) of each component."""
        logs, residual = self._quadratic(x)
        pull = self._inverse.sum(axis=1)  # (k, d)
        precision = pull.sum(axis=1)  # (k,)
        u = np.einsum("nki,ki->nk", residual, pull) / precision
        return logs + precision * u**2 / 2 + np.log(2 * np.pi / precision) / 2, u, precision

    def _mixture(self, logs: FloatArray) -> FloatArray:
        """(n,) log of the weighted sum over components of exp(logs), (n, k)."""
        logs = logs + np.log(self.weights)
        top = logs.max(axis=1, keepdims=True)
        return np.asarray(top[:, 0] + np.log(np.exp(logs - top).sum(axis=1)))


def size_model(prior: Prior, tier: str | None, *, is_broader: bool = False) -> SizeModel:
    """The density of true-sized models of a category with this prior, which rests on `tier`.

    is_broader : the category is a broader kind of what the file names.
    """
    is_sorted = prior.dims[0] in SORTED
    names = SORTED if is_sorted else NAMED
    d = len(prior.dims)
    artist = ARTIST_COMMON_SD**2 + ARTIST_OWN_SD**2 * np.eye(d)
    unlike = UNLIKE_COMMON_SD**2 + UNLIKE_OWN_SD**2 * np.eye(d)
    body = prior.covariances + prior.shared_covariance + artist
    share = UNLIKE_UNKNOWN if tier is None else UNLIKE_SHARE[tier]
    share = max(share, UNLIKE_BROADER) if is_broader else share
    return SizeModel(
        tuple(names.index(name) for name in prior.dims),
        is_sorted,
        np.concatenate([(1 - share) * prior.weights, share * prior.weights]),
        np.concatenate([prior.means, prior.means]),
        np.concatenate([body, body + unlike]),
    )


def node_tier(node: Node) -> str | None:
    """What the node's sizes rest on, None in a release that does not say."""
    tier: str | None = getattr(node, "tier", None)
    return tier


def node_model(tree: Tree, node_id: str, is_broader: bool = False) -> SizeModel | None:
    """The size model of a node over as many dimensions as its priors have; None if it has no prior."""
    return _models(tree, node_id, is_broader)


def extents_text(extents: Sequence[float]) -> str:
    """Extents in words of a person: `0.52 x 0.90 x 0.50 m`, millimetres below 10 cm."""
    if max(extents) < 0.1:
        return " x ".join(f"{1000 * one:.3g}" for one in extents) + " mm"
    return " x ".join(f"{one:.3g}" for one in extents) + " m"

"""Density of the extents of true-sized 3-D models of a category: the size prior, widened by the errors of artists.

The size of a model differs from the size of the object by an error that all sides have in common, and by an independent
error of each side. A fraction e of the models, larger for categories with little evidence, deviates much more. With
x = ln of the extents in mm and a component k of the prior,

    p(x) = sum_k w_k [(1 - e) N(x; m_k, C_k) + e N(x; m_k, C_k + wide)],  C_k = S_k + B + artist
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from metric_base.arrays import FloatArray
from metric_base.statistics import gaussian_log_densities, mixture_log_density
from metric_tree.axes import AXES, EXTENTS
from metric_tree.prior import Prior
from metric_tree.tree import Tree

#: Standard deviation of the log error that the sides of a model have in common. Chosen on half of the categories of 707
#: open models (docs/evidence/model-sizes.md).
ARTIST_COMMON_SD = 0.15
#: Standard deviation of the log error of each side.
ARTIST_SIDE_SD = 0.12
#: Additional standard deviations of models that deviate much from the prior: in common, and of each side.
UNLIKE_COMMON_SD = 0.6
UNLIKE_SIDE_SD = 0.5
#: Fraction of models that deviate much from the prior, by the tier of the prior.
UNLIKE_FRACTION = {"norm": 0.05, "measured": 0.05, "few": 0.08, "models": 0.08, "borrowed": 0.15, "judged": 0.12}
#: The same for a release without tiers.
UNLIKE_UNKNOWN = 0.1
#: Minimum of this fraction if the category is broader than the text of the file.
UNLIKE_BROADER = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class SizeModel:
    """A mixture of k Gaussians over d of the logarithms of the extents in mm."""

    #: (d,) indices into length, width, height; or, if `is_sorted`, into the extents, the longest first.
    axes: tuple[int, ...]
    is_sorted: bool
    #: (k,)
    weights: FloatArray
    #: (k, d)
    means: FloatArray
    #: (k, d, d)
    covariances: FloatArray

    def log_density(self, x: FloatArray) -> FloatArray:
        """Return the log density (n,) of ln mm, x (n, 3)."""
        return mixture_log_density(x[:, list(self.axes)], self.weights, self.means, self.covariances)

    def log_evidence(self, x: FloatArray) -> FloatArray:
        """Return the log (n,) of the integral of the density of x + u over all u: the evidence of the proportions.

        For a component with r = m - x, L = C^-1, l = 1'L1 and u = 1'Lr / l it is
        |C|^(-1/2) l^(-1/2) exp(-(r'Lr - l u^2) / 2) (2 pi)^(-(d-1)/2).

        x : (n, 3) ln mm
        """
        return np.asarray(np.logaddexp.reduce(self._shifts(x)[0] + np.log(self.weights), axis=1))

    def shift_components(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return weights, means and standard deviations (k,) of the posterior of u, with x + u from this density.

        x : (3,) ln mm
        """
        log_terms, u, precision = self._shifts(x[None])
        logs = log_terms[0] + np.log(self.weights)
        weights = np.exp(logs - logs.max())
        return weights / weights.sum(), u[0], 1 / np.sqrt(precision)

    def without(self, axis: int) -> SizeModel:
        """Return the exact marginal without one of `axes`."""
        keep = np.array([index for index, kept in enumerate(self.axes) if kept != axis])
        return SizeModel(
            tuple(self.axes[index] for index in keep),
            self.is_sorted,
            self.weights,
            self.means[:, keep],
            self.covariances[:, keep[:, None], keep],
        )

    def _shifts(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return log evidence (n, k), best shift (n, k) and its precision (k,) for each component."""
        sides = x[:, list(self.axes)]
        logs = gaussian_log_densities(sides, self.means, self.covariances).T  # (n, k)
        residual = self.means - sides[:, None]
        row_sums = np.linalg.inv(self.covariances).sum(axis=1)  # (k, d)
        precision = row_sums.sum(axis=1)  # (k,)
        u = np.einsum("nki,ki->nk", residual, row_sums) / precision
        return logs + precision * u**2 / 2 + np.log(2 * np.pi / precision) / 2, u, precision


def size_model(prior: Prior, tier: str | None, *, is_broader: bool = False) -> SizeModel:
    """Return the density of true-sized models of a category.

    Parameters
    ----------
    prior : Prior
        Size prior of the category.
    tier : str or None
        Evidence tier of the prior.
    is_broader : bool, default False
        The category is broader than the text of the file.
    """
    is_sorted = prior.dims[0] in EXTENTS
    names = EXTENTS if is_sorted else AXES
    d = len(prior.dims)
    artist = ARTIST_COMMON_SD**2 + ARTIST_SIDE_SD**2 * np.eye(d)
    unlike = UNLIKE_COMMON_SD**2 + UNLIKE_SIDE_SD**2 * np.eye(d)
    covariances = prior.covariances + prior.shared_covariance + artist
    fraction = UNLIKE_UNKNOWN if tier is None else UNLIKE_FRACTION[tier]
    fraction = max(fraction, UNLIKE_BROADER) if is_broader else fraction
    return SizeModel(
        tuple(names.index(name) for name in prior.dims),
        is_sorted,
        np.concatenate([(1 - fraction) * prior.weights, fraction * prior.weights]),
        np.concatenate([prior.means, prior.means]),
        np.concatenate([covariances, covariances + unlike]),
    )


@lru_cache(maxsize=4096)
def node_model(tree: Tree, node_id: str, is_broader: bool = False) -> SizeModel | None:
    """Return the size model of a node over as many dimensions as its priors have; None if it has no prior."""
    node = tree.node(node_id)
    if not node.prior_dims:
        return None
    dims = max(node.prior_dims, key=lambda names: (len(names), names == node.dims))
    return size_model(node.outer(node.prior(dims)), node.tier, is_broader=is_broader)


def extents_text(extents: Sequence[float]) -> str:
    """Format extents in metres for users: `0.52 x 0.90 x 0.50 m`, in millimetres below 10 cm."""
    if max(extents) < 0.1:
        return " x ".join(f"{1000 * extent:.3g}" for extent in extents) + " mm"
    return " x ".join(f"{extent:.3g}" for extent in extents) + " m"

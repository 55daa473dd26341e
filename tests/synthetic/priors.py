"""Priors and measured objects for tests of the posterior."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estimator.posterior.object_likelihood import ObjectEvidence
from estimator.records.objects import MeasuredObject
from metric_base.arrays import FloatArray
from metric_tree.axes import AXES
from metric_tree.prior import Prior

__all__ = ["evidence", "prior"]


def prior(
    name: str,
    sizes_mm: Sequence[Sequence[float]],
    spread: float = 0.12,
    shared: float = 0.08,
    dims: tuple[str, ...] = AXES,
    in_place: float = 1.0,
) -> Prior:
    """Return a prior with one component per row of sizes; half of each variance is common to the dimensions.

    in_place : fraction of rows that were measured on site.
    """
    k, d = np.shape(sizes_mm)
    pattern = 0.5 + 0.5 * np.eye(d)
    return Prior(
        node_id=name,
        dims=dims,
        weights=np.full(k, 1 / k),
        means=np.log(np.array(sizes_mm, dtype=float)),
        covariances=np.tile(spread**2 * pattern, (k, 1, 1)),
        shared_covariance=shared**2 * pattern,
        n=100,
        n_sources=4,
        share_by_kind={"product": 1.0 - in_place, "measured": in_place},
        borrowed=0.0,
    )


def evidence(
    of: Prior,
    extents: Sequence[float] | FloatArray,
    sigma: float = 0.03,
    cut: Sequence[bool] = (False, False, False),
    pose: str = "upright",
    vertical_known: bool = True,
    score: float = 1.0,
    name: str = "1",
) -> ObjectEvidence:
    """Return an object in scene units with its prior."""
    item = MeasuredObject(
        id=name,
        category=of.node_id,
        extents=np.array(extents, dtype=float),
        sigma=np.full(3, sigma),
        truncated=np.array(cut),
        score=score,
        vertical_known=vertical_known,
    )
    return ObjectEvidence(item, of, pose)

"""The sizes of an item in its states: an umbrella open and folded, a book that stands, a person who sits.

The prior of a node is of its usual state, or of several where its rows do not say which; `plain` says so. A release has
the states of its nodes in the manifest (`states`): by node the name of each, its sizes in mm and the standard deviation
of ln size. They are judged, and as wide as judged ranges turned out to be.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from metric_base.errors import InputError
from metric_tree.prior import Prior
from metric_tree.tiers import Evidence

__all__ = ["SHARED", "state_priors"]

#: Part of a state's variance that objects of one scene share, as of a judged range.
SHARED = 0.35


def state_priors(node_id: str, record: Sequence[Mapping[str, Any]]) -> dict[str, Prior]:
    """The prior of each state of a node, by its name, from the manifest's record.

    Raises
    ------
    InputError
        A state has no name, no axis, or sizes and spreads that are no positive numbers.
    """
    return {str(state.get("state")): _prior(node_id, state) for state in record}


def _prior(node_id: str, state: Mapping[str, Any]) -> Prior:
    try:
        dims = tuple(state["size_mm"])
        size = np.array([state["size_mm"][dim] for dim in dims], dtype=float)
        sd = np.array([state["sd_log"][dim] for dim in dims], dtype=float)
        known = bool(dims and state["state"] and (size > 0).all() and (sd > 0).all() and np.isfinite([size, sd]).all())
    except (KeyError, TypeError, ValueError):
        known = False
    if not known:
        raise InputError(f"{node_id}: states: expected a name, sizes and spreads of axes; found {dict(state)!r}")
    variance = np.diag(sd**2)
    return Prior(
        node_id=node_id,
        dims=dims,
        weights=np.ones(1),
        means=np.log(size)[None],
        covariances=(1 - SHARED) * variance[None],
        shared_covariance=SHARED * variance,
        n=0,
        n_sources=1,
        share_by_kind={"judged": 1.0},
        borrowed=0.0,
        tier="judged",
        evidence=Evidence(0.0, 0, 0, 1),
    )

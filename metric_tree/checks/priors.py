"""Checks on the priors of a release (codes 4xx)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pyarrow as pa

from metric_tree.axes import DIMENSIONS
from metric_tree.checks.finding import Finding

#: Maximum rounding error of the sum of weights that were converted to text or to another float format.
WEIGHT_TOLERANCE = 1e-6

#: Minimum eigenvalue of the covariance of a component, which may not be singular.
MIN_EIGENVALUE = 1e-12

#: Minimum eigenvalue of the covariance between sources, which may be singular (one common factor), with rounding.
MIN_SHARED_EIGENVALUE = -1e-12


def findings(priors: pa.Table, nodes: pa.Table) -> Iterator[Finding]:
    """Yield the findings on the priors table."""
    known = dict(zip(nodes["node_id"].to_pylist(), nodes["n_items"].to_pylist(), strict=True))
    seen: set[tuple[str, tuple[str, ...]]] = set()
    for row in priors.to_pylist():
        subject = f"{row['node_id']} {'/'.join(row['dims'] or [])}"
        key = (row["node_id"], tuple(row["dims"] or []))
        if row["node_id"] not in known or key in seen:
            yield Finding("E401", subject, "expected one prior of a node of the tree; found another")
        seen.add(key)
        # Check family, dimensions and weights of a row, and the shapes of its arrays (E402, E403, E405).
        dims, weights = row["dims"] or [], np.asarray(row["weights"], dtype=float)
        if row["family"] != "lognormal-mixture" or not dims or any(dim not in DIMENSIONS for dim in dims):
            text = f"expected a log-normal mixture; found {row['family']} over {dims}"
            yield Finding("E405", subject, f"family, dims: {text}")
        if not 0 <= row["borrowed"] <= 1:
            yield Finding("E405", subject, f"borrowed: expected a share of 0 to 1; found {row['borrowed']}")
        if not (weights.size and np.all(weights >= 0) and abs(weights.sum() - 1) < WEIGHT_TOLERANCE):
            yield Finding("E402", subject, f"weights: expected probabilities of sum 1; found sum {weights.sum():.6g}")
        expected = {
            "means": (weights.size, len(dims)),
            "covariances": (weights.size, len(dims), len(dims)),
            "shared_covariance": (len(dims), len(dims)),
        }
        for name, shape in expected.items():
            yield from _matrix_findings(subject, name, row[name], shape)
    fitted = {node_id for node_id, _ in seen}
    for node_id, n_items in known.items():
        if n_items and node_id not in fitted:
            yield Finding("W406", node_id, f"expected a prior from {n_items} items; found none")


def _matrix_findings(subject: str, name: str, value: object, shape: tuple[int, ...]) -> Iterator[Finding]:
    """Check the shape of an array (E403), and that a covariance is symmetric and positive (E404)."""
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.shape != shape or not np.all(np.isfinite(array)):
        yield Finding("E403", subject, f"{name}: expected finite numbers of shape {shape}; found {array.shape}")
    elif name != "means":
        symmetric = np.allclose(array, np.swapaxes(array, -1, -2))
        smallest = float(np.linalg.eigvalsh(array).min())
        if not symmetric or smallest < (MIN_SHARED_EIGENVALUE if name == "shared_covariance" else MIN_EIGENVALUE):
            yield Finding("E404", subject, f"{name}: expected symmetric and positive; found eigenvalue {smallest:.3g}")

"""Report of a build for its maintainer: disagreements, classes with several sizes, findings on leaves, counts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa

from metric_tree.checks.leaves import LeafSize, leaf_findings, titles
from metric_tree.curated.sizes import settled_findings
from metric_tree.fit.evidence_model import EvidenceModel
from metric_tree.fit.rows import JUDGED
from metric_tree.pipeline.clean import NodeClass
from metric_tree.pipeline.hierarchy import Hierarchy
from metric_tree.prior import Prior, has_distinct_components


def build_report(
    classes: Mapping[str, NodeClass],
    leaves: Mapping[str, Prior],
    model: EvidenceModel,
    counts: Mapping[str, int],
    hierarchy: Hierarchy,
    items: pa.Table,
) -> dict[str, Any]:
    """Return the content of `report.json` (`metric-tree/build-report/1`), with the open findings on leaves.

    Parameters
    ----------
    classes, leaves : mapping
        Class and prior of each leaf; the classes include rows that are not shipped.
    model : EvidenceModel
        Fitted model of the kinds of evidence.
    counts : mapping
        Number of raw items by outcome.
    hierarchy : Hierarchy
        Categories of the release.
    items : Table
        Shipped items, for their titles.
    """
    categories = {category.node_id: category for category in hierarchy.categories}
    families, named = hierarchy.families(), titles(items)
    sizes, disagreements = [], []
    for node_id, one in classes.items():
        by_source, category, prior = one.moments.by_source, categories[node_id], leaves[node_id]
        means = list(zip(by_source.sources, by_source.kinds, by_source.means, strict=True)) if by_source else []
        sizes.append(
            LeafSize(
                node_id,
                category.parent_id or "",
                category.pose,
                prior.dims,
                prior.quantile(0.5),
                next((np.exp(mean) for _, kind, mean in means if kind == JUDGED), None),
                {name: np.exp(mean) for name, kind, mean in means if kind != JUDGED},
                families[node_id],
                named.get(node_id, ()),
            )
        )
        if by_source is not None and by_source.freedom >= 1:
            # `between_sd` along the mean of the axes is the error that an estimate of scale suffers from.
            disagreements.append(
                {
                    "node_id": node_id,
                    "sources": len(by_source.sources),
                    "between_sd": round(float(np.sqrt(prior.shared_covariance.mean())), 4),
                    "observed_sd": round(float(np.sqrt(max(by_source.between.mean(), 0.0))), 4),
                    "within_sd": round(float(np.sqrt(max(by_source.within.mean(), 0.0))), 4),
                    "axes": list(one.moments.axes),
                    "means_mm": {
                        name: [None if np.isnan(value) else round(float(np.exp(value)), 1) for value in mean]
                        for name, _, mean in means
                    },
                }
            )
    findings = leaf_findings(sizes, settled_findings())
    return {
        "schema": "metric-tree/build-report/1",
        "raw": dict(counts),
        "evidence_model": model.record(),
        "disagreements": sorted(disagreements, key=lambda record: -float(record["observed_sd"])),
        "mixed": sorted(node_id for node_id, prior in leaves.items() if has_distinct_components(prior)),
        "leaves": [{"code": one.code, "node_id": one.subject, "message": one.message} for one in findings],
    }

"""What a build reports to its maintainer: sources that disagree, classes that look mixed, what was refused."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from metric_tree.checks.leaves import LeafSize, leaf_findings, titles
from metric_tree.curated.sizes import settled_findings
from metric_tree.fit.evidence_model import KindModel
from metric_tree.fit.rows import JUDGED
from metric_tree.pipeline.clean import NodeClass
from metric_tree.pipeline.hierarchy import Hierarchy
from metric_tree.prior import Prior, has_distinct_components
from taxonomy.categories import Category


def report(
    classes: Sequence[NodeClass],
    priors: Mapping[str, Prior],
    model: KindModel,
    counts: Counter[str],
    categories: Sequence[Category] = (),
    items: pa.Table | None = None,
) -> dict[str, Any]:
    """The report of a build, as it is written to `report.json`; the leaves' findings are those not yet settled.

    items : the items that ship, whose titles are read
    """
    sizes = list(leaf_sizes(classes, priors, categories, titles(items) if items is not None else {}))
    findings = leaf_findings(sizes, settled_findings())
    return {
        "schema": "metric-tree/build-report/1",
        "raw": dict(sorted(counts.items())),
        "evidence_model": model.record(),
        "disagreements": disagreements(classes, priors),
        "mixed": sorted(node_id for node_id, prior in priors.items() if has_distinct_components(prior)),
        "leaves": [{"code": one.code, "node_id": one.node_id, "message": one.message} for one in findings],
    }


def leaf_sizes(
    classes: Sequence[NodeClass],
    priors: Mapping[str, Prior],
    categories: Sequence[Category],
    named: Mapping[str, Sequence[str]],
) -> Iterator[LeafSize]:
    """The sizes of the leaves with what every source states of them, those whose rows are withheld too.

    named : titles of items by leaf
    """
    places = {category.node_id: category for category in categories}
    families = Hierarchy.of(categories).families()
    for one in classes:
        place, prior = places.get(one.node_id), priors.get(one.node_id)
        own = one.moments[0].disagreement
        if place is None or prior is None:
            continue
        said = list(zip(own.sources, own.kinds, np.exp(own.means), strict=True)) if own else []
        yield LeafSize(
            one.node_id,
            place.parent_id or "",
            place.pose,
            prior.dims,
            prior.quantile(0.5),
            next((mean for _, kind, mean in said if kind == JUDGED), None),
            {name: mean for name, kind, mean in said if kind != JUDGED},
            families[one.node_id],
            named.get(one.node_id, ()),
        )


def disagreements(classes: Sequence[NodeClass], priors: Mapping[str, Prior]) -> list[dict[str, Any]]:
    """Classes of two sources or more, the largest disagreement first.

    `between_sd` is the published standard deviation of ln size between sources along the mean of the axes, the one
    that an estimate of scale suffers from; `means_mm` the geometric mean sizes of each source.
    """
    records = []
    for one in classes:
        own = one.moments[0].disagreement
        if own is None or own.freedom < 1:
            continue
        shared = priors[one.node_id].shared_covariance
        records.append(
            {
                "node_id": one.node_id,
                "sources": len(own.sources),
                "between_sd": round(float(np.sqrt(shared.mean())), 4),
                "observed_sd": round(float(np.sqrt(max(own.between.mean(), 0.0))), 4),
                "within_sd": round(float(np.sqrt(max(own.within.mean(), 0.0))), 4),
                "axes": list(one.moments[0].axes),
                "means_mm": {
                    name: [None if np.isnan(mean) else round(float(np.exp(mean)), 1) for mean in means]
                    for name, means in zip(own.sources, own.means, strict=True)
                },
            }
        )
    return sorted(records, key=lambda record: -float(record["observed_sd"]))

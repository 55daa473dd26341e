"""Checks on the sizes of leaves against independent ranges, siblings and sources (codes W411 to W415).

A finding is not an error: a clove is smaller than other spices. A reviewer or a program settles each one after reading
the rows (`data/curated/settled.csv`); `validate` and the report of a build list the others.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from metric_base.arrays import FloatArray, grouped
from metric_base.statistics import robust_sigma
from metric_tree.axes import AXES, EXTENTS
from metric_tree.checks.finding import Finding
from metric_tree.curated.sizes import settled_findings
from metric_tree.fit.rows import JUDGED, NORM, extents_of
from metric_tree.prior import Prior

#: Minimum factor of a finding; smaller differences are within the variety of objects.
FACTOR = 2.0
#: Minimum number of siblings for their scatter.
MIN_SIBLINGS = 5
#: Minimum deviation of a leaf from its siblings, in standard deviations from the median absolute deviation.
SIBLING_SD = 3.5
#: Maximum size of models, parts or other objects, as a fraction of the median on every axis.
MINIATURE = 0.4
#: Families (nodes of level 2) whose objects represent other objects.
LIKENESSES = frozenset({"art.n.01", "plaything.n.01"})
#: Words of titles of toys. "Model" also occurs in model numbers and in collections of 3-D models.
_TOY = re.compile(
    r"\b(toys?|miniatures?|doll'?s?[ -]?house|figurines?|1[:/](?:12|18|24|32|43|48|72|87))\b", re.IGNORECASE
)
#: Ratio of depth to height from which the axes of an upright object may be exchanged. Below, the ratio must exceed
#: `FACTOR` and the median of its siblings by this factor.
LYING = 5.0
#: Minimum ratio of the length of a round object to its diameter, so that its pose matters; below, it is a ball.
MIN_ROUND_RATIO = 1.2
#: Maximum difference of the two diameters of a round object, as a fraction.
MAX_ROUND_DIFFERENCE = 0.03
#: Tolerance for the order of two medians, which are rounded.
ORDER_SLACK = 1.02
#: Minimum number of other sources.
MIN_OTHER_SOURCES = 2
#: Name of the release whose findings are settled in `data/curated/settled.csv`.
SHIPPED = "metric-tree"


@dataclass(frozen=True, slots=True, eq=False)
class LeafSize:
    """Published size of a leaf, with independent sizes."""

    node_id: str
    parent_id: str
    pose: str
    dims: tuple[str, ...]
    median: FloatArray  #: (d,) mm over `dims`.
    typical: FloatArray | None = None  #: (3,) typical size of an independent range in mm, NaN if not stated.
    sources: Mapping[str, FloatArray] | None = None  #: Mean size (3,) in mm by source, in the frame of `dims`.
    family: str = ""  #: Node of level 2.
    titles: Sequence[str] = ()  #: Titles of the shipped items.

    @property
    def size(self) -> dict[str, float]:
        """Median in mm by dimension."""
        return dict(zip(self.dims, self.median.tolist(), strict=True))

    @property
    def columns(self) -> list[int]:
        """Index of each dimension in its frame of axes."""
        frame = AXES if self.dims[0] in AXES else EXTENTS
        return [frame.index(dim) for dim in self.dims]


def leaf_findings(leaves: Sequence[LeafSize], accepted: Iterable[tuple[str, str]] = ()) -> list[Finding]:
    """Return all findings on the leaves of a tree, without the `accepted` ones (code, node id)."""
    known = set(accepted)
    found: list[Finding] = []
    for leaf in leaves:
        found += [*_size_findings(leaf), *_source_findings(leaf)]
    for family in grouped((leaf.parent_id, leaf) for leaf in leaves).values():
        found += [*_sibling_findings(family), *_lying_findings(family), *_round_findings(family)]
    return sorted(one for one in found if (one.code, one.subject) not in known)


def titles(items: pa.Table) -> dict[str, list[str]]:
    """Return the titles of the shipped items by leaf, without norms and ranges."""
    rows = zip(*(items[name].to_pylist() for name in ("node_id", "title", "kind")), strict=True)
    return grouped((node_id, title) for node_id, title, kind in rows if title and kind not in {JUDGED, NORM})


def findings(nodes: pa.Table, items: pa.Table, priors: pa.Table, manifest: Mapping[str, Any]) -> list[Finding]:
    """Return the findings on the leaves from the shipped rows; settled findings of the shipped release are omitted."""
    means, named = _source_means(items), titles(items)
    priors_by_node: dict[str, Mapping[str, Any]] = {}
    for row in priors.to_pylist():
        priors_by_node.setdefault(row["node_id"], row)
    parents = dict(zip(nodes["node_id"].to_pylist(), nodes["parent_id"].to_pylist(), strict=True))
    inner = set(parents.values())
    leaves = []
    for node in nodes.to_pylist():
        node_id = node["node_id"]
        if node_id in inner or node_id not in priors_by_node:
            continue
        prior = Prior.of_row(priors_by_node[node_id])
        stated = {key: extents if prior.dims[0] in EXTENTS else axes for key, axes, extents in means.get(node_id, ())}
        path = [node_id]
        while (parent := parents.get(path[-1])) is not None and parent not in path:
            path.append(parent)
        leaves.append(
            LeafSize(
                node_id,
                node["parent_id"] or "",
                node["pose"],
                prior.dims,
                prior.quantile(0.5),
                next((mean for (_, kind), mean in stated.items() if kind == JUDGED), None),
                {name: mean for (name, kind), mean in stated.items() if kind not in {JUDGED, NORM}},
                path[-2] if len(path) > 1 else node_id,
                named.get(node_id, ()),
            )
        )
    return leaf_findings(leaves, settled_findings() if manifest["name"] == SHIPPED else ())


def _source_means(items: pa.Table) -> dict[str, list[tuple[tuple[str, str], FloatArray, FloatArray]]]:
    """Return, by leaf, (source, kind) with the geometric means (3,) of axes and of extents in mm, NaN if not stated."""
    axes = np.column_stack([items[f"{axis}_mm"].to_numpy(zero_copy_only=False) for axis in AXES])
    logs = np.log(np.hstack([axes.astype(float), extents_of(items)]))  # (n, 6)
    keys = ["node_id", "source", "kind"]
    columns = {name: pa.array(logs[:, index], from_pandas=True) for index, name in enumerate((*AXES, *EXTENTS))}
    table = pa.table({name: items[name] for name in keys} | columns)
    means = table.group_by(keys, use_threads=False).aggregate([(name, "mean") for name in columns])
    sizes = np.column_stack([means[f"{name}_mean"].to_numpy(zero_copy_only=False) for name in columns])
    rows = zip(*(means[name].to_pylist() for name in keys), np.exp(sizes), strict=True)
    return grouped((node_id, ((source, kind), size[:3], size[3:])) for node_id, source, kind, size in rows)


def _size_findings(leaf: LeafSize) -> Iterator[Finding]:
    """Compare the median with an independent range (W411), and its axes with each other (W413)."""
    if leaf.typical is not None:
        typical_of = leaf.typical if leaf.dims[0] in AXES else -np.sort(-leaf.typical)
        for dim, column, median in zip(leaf.dims, leaf.columns, leaf.median, strict=True):
            typical = float(typical_of[column])
            if abs(np.log(median / typical)) > np.log(FACTOR):  # False if NaN
                yield Finding("W411", leaf.node_id, f"{dim}: expected about {typical:.4g} mm; found {median:.4g}")
    length, width, height = (leaf.size.get(axis, np.nan) for axis in AXES)
    if width > ORDER_SLACK * length:
        yield Finding("W413", leaf.node_id, f"expected length over width; found {length:.4g} and {width:.4g} mm")
    if leaf.pose == "flat" and height > ORDER_SLACK * width:
        yield Finding("W413", leaf.node_id, f"lies flat, and is {width:.4g} mm wide and {height:.4g} high")


def _source_findings(leaf: LeafSize) -> Iterator[Finding]:
    """Compare the sources with each other (W414), and look for toys by titles and sizes (W415)."""
    sources = leaf.sources or {}
    sizes = {name: float(np.log(mean).mean()) for name, mean in sources.items() if not np.isnan(mean).any()}
    for name, size in sizes.items():
        others = np.array([other_size for other, other_size in sizes.items() if other != name])
        if len(others) >= MIN_OTHER_SOURCES and np.abs(size - others).min() > np.log(FACTOR):
            median = np.exp(np.median(others))
            yield Finding("W414", leaf.node_id, f"{name}: expected about {median:.4g} mm; found {np.exp(size):.4g}")
    if leaf.family in LIKENESSES:
        return
    toy = next((title for title in leaf.titles if _TOY.search(title)), None)
    if toy is not None:
        yield Finding("W415", leaf.node_id, f"expected titles of real objects; found {toy!r}")
    for name, mean in sources.items():
        ratio = mean[leaf.columns] / leaf.median
        if np.isfinite(ratio).sum() > 1 and np.nanmax(ratio) < MINIATURE:
            size_text = f"expected objects of about the class's size; found {np.nanmax(ratio):.2f} of it on every axis"
            yield Finding("W415", leaf.node_id, f"{name}: {size_text}")


def _sibling_findings(family: Sequence[LeafSize]) -> Iterator[Finding]:
    """Compare the geometric mean sizes of the children of a node (W412)."""
    family = [leaf for leaf in family if len(leaf.dims) == len(AXES)]
    if len(family) < MIN_SIBLINGS:
        return
    sizes = np.array([np.log(leaf.median).mean() for leaf in family])
    median = float(np.median(sizes))
    limit = max(np.log(FACTOR), SIBLING_SD * robust_sigma(sizes))
    for leaf, size in zip(family, sizes.tolist(), strict=True):
        if abs(size - median) > limit:
            yield Finding("W412", leaf.node_id, f"expected about {np.exp(median):.4g} mm; found {np.exp(size):.4g}")


def _lying_findings(family: Sequence[LeafSize]) -> Iterator[Finding]:
    """Compare the ratio of depth to height of upright siblings (W413), from their ranges if these state both."""
    ratios: dict[str, float] = {}
    for leaf in family:
        if leaf.pose == "upright":
            size = leaf.size
            if leaf.typical is not None and not np.isnan(leaf.typical[1:]).any():
                size = dict(zip(AXES, leaf.typical.tolist(), strict=True))
            ratios[leaf.node_id] = float(size.get("width", np.nan) / size.get("height", np.nan))
    siblings = [ratio for ratio in ratios.values() if np.isfinite(ratio)]
    usual = float(np.median(siblings)) if len(siblings) > MIN_SIBLINGS else 1.0
    for node_id, ratio in ratios.items():
        if ratio > max(FACTOR, LYING * min(usual, 1.0)):
            message = f"stands, and is {ratio:.3g} times as deep as high; {usual:.3g} times is usual there"
            yield Finding("W413", node_id, message)


def _round_findings(family: Sequence[LeafSize]) -> Iterator[Finding]:
    """Find upright round objects (bulbs, bottles) that lie on their side while a sibling stands (W413)."""
    upright = [(leaf, leaf.median) for leaf in family if leaf.pose == "upright" and leaf.dims == AXES]

    def is_round(diameter: float, other: float, length: float) -> bool:
        is_same = abs(diameter / other - 1) < MAX_ROUND_DIFFERENCE
        return is_same and length >= MIN_ROUND_RATIO * max(diameter, other)

    standing = [leaf.node_id for leaf, (length, width, height) in upright if is_round(length, width, height)]
    for leaf, (length, width, height) in upright if standing else ():
        if is_round(width, height, length):
            message = f"stands, and is {length / height:.3g} times as long as high; {standing[0]} is round and stands"
            yield Finding("W413", leaf.node_id, message)

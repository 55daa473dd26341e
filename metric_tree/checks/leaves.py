"""Checks on the sizes of leaves beside ranges, siblings and sources (codes W411 to W415).

What looks wrong about a leaf's size beside an independent range, its siblings and its own sources.

A finding is no error: a clove is smaller than other spices. Each one is settled by a person or a program that looked at
its rows (`data/curated/settled.csv`), and what is not yet settled is listed by `validate` and by the build's report.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from metric_base.arrays import FloatArray
from metric_tree.axes import AXES, EXTENTS
from metric_tree.checks.finding import Finding
from metric_tree.curated.sizes import settled_findings
from metric_tree.fit.rows import JUDGED, NORM, extents_of
from metric_tree.prior import Prior

CODES = {
    "W411": "a leaf whose median is off by more than 2 from an independent range of it",
    "W412": "a leaf far from its siblings, by more than 2 and by more than they scatter",
    "W413": "a leaf with its axes out of order: wider than long, lying and higher than wide, or upright and flat",
    "W414": "a source of a leaf that is off by more than 2 from all its others",
    "W415": "toys or miniatures in a class of real objects: by a title, or a source that is small on every axis",
}
#: A size beyond this factor is not a matter of taste.
FACTOR = 2.0
#: Siblings whose scatter counts, and how many of their standard deviations (by the median deviation) a leaf may be off.
SIBLINGS, SIBLING_SD = 5, 3.5
#: The median absolute deviation of a normal distribution, as a part of its standard deviation.
NORMAL_MAD = 0.6745
#: A source whose objects are under this part of the median on every axis has likenesses, parts or another object.
MINIATURE = 0.4
#: Families (nodes of level 2) whose objects are likenesses themselves.
LIKENESSES = frozenset({"art.n.01", "plaything.n.01"})
#: Words of a title that say so. A maker's model number and the files of an artist's collection say "model", too.
_TOY = re.compile(
    r"\b(toys?|miniatures?|doll'?s?[ -]?house|figurines?|1[:/](?:12|18|24|32|43|48|72|87))\b", re.IGNORECASE
)
#: An upright object whose depth is so many times its height seems to lie: two of its axes may be exchanged. So does one
#: that is deeper than high by `FACTOR`, and by this much more than its siblings are.
LYING = 5.0
#: Rounding: a median drawn from two marginals.
ORDER_SLACK = 1.02
#: Sources besides the one that differs.
OTHER_SOURCES = 2
#: The release whose findings `data/curated/settled.csv` settles.
SHIPPED = "metric-tree"


@dataclass(frozen=True, slots=True, eq=False)
class LeafSize:
    """A leaf's published sizes, and what stands beside them.

    median : (d,) mm over `dims`; typical : (3,) mm that an independent range calls typical, NaN unstated, None of no
    range; sources : mean size (3,) in mm by source, in the frame of `dims`; family : node of level 2; titles : of the
    shipped items.
    """

    node_id: str
    parent_id: str
    pose: str
    dims: tuple[str, ...]
    median: FloatArray
    typical: FloatArray | None = None
    sources: Mapping[str, FloatArray] | None = None
    family: str = ""
    titles: Sequence[str] = ()


@dataclass(frozen=True, slots=True, order=True)
class LeafFinding:
    """What was found about a leaf."""

    code: str
    node_id: str
    message: str


def leaf_findings(leaves: Sequence[LeafSize], accepted: Iterable[tuple[str, str]] = ()) -> list[LeafFinding]:
    """All findings on the leaves of a tree, less those that are `accepted` (code, node id)."""
    known = set(accepted)
    own = [one for leaf in leaves for one in _own_findings(leaf)]
    among = (*_sibling_findings(leaves), *_lying_findings(leaves))
    return sorted(one for one in (*own, *among) if (one.code, one.node_id) not in known)


def titles(items: pa.Table) -> dict[str, list[str]]:
    """The titles of the shipped items by leaf; of norms and ranges there is none."""
    named: defaultdict[str, list[str]] = defaultdict(list)
    columns = (items[name].to_pylist() for name in ("node_id", "title", "kind"))
    for node_id, title, kind in zip(*columns, strict=True):
        if title and kind not in {JUDGED, NORM}:
            named[node_id].append(title)
    return named


def _own_findings(leaf: LeafSize) -> Iterator[LeafFinding]:
    yield from _range_findings(leaf)
    yield from _order_findings(leaf)
    yield from _source_findings(leaf)
    if leaf.family not in LIKENESSES:
        yield from _toy_findings(leaf)


def _range_findings(leaf: LeafSize) -> Iterator[LeafFinding]:
    if leaf.typical is None:
        return
    by_axis = leaf.typical if leaf.dims[0] in AXES else -np.sort(-leaf.typical)
    names = AXES if leaf.dims[0] in AXES else tuple(f"extent{number}" for number in (1, 2, 3))
    for dim, median in zip(leaf.dims, leaf.median, strict=True):
        typical = float(by_axis[names.index(dim)])
        if abs(np.log(median / typical)) > np.log(FACTOR):  # False where nothing is stated
            yield LeafFinding("W411", leaf.node_id, f"{dim}: expected about {typical:.4g} mm; found {median:.4g}")


def _order_findings(leaf: LeafSize) -> Iterator[LeafFinding]:
    size = dict(zip(leaf.dims, leaf.median.tolist(), strict=True))
    length, width, height = (size.get(axis, np.nan) for axis in AXES)
    if width > ORDER_SLACK * length:
        yield LeafFinding("W413", leaf.node_id, f"expected length over width; found {length:.4g} and {width:.4g} mm")
    if leaf.pose == "flat" and height > ORDER_SLACK * width:
        yield LeafFinding("W413", leaf.node_id, f"lies flat, and is {width:.4g} mm wide and {height:.4g} high")


def _source_findings(leaf: LeafSize) -> Iterator[LeafFinding]:
    sizes = {name: float(np.nanmean(np.log(mean))) for name, mean in (leaf.sources or {}).items() if _whole(mean)}
    for name, own in sizes.items():
        others = np.array([size for other, size in sizes.items() if other != name])
        if len(others) >= OTHER_SOURCES and np.abs(own - others).min() > np.log(FACTOR):
            middle = np.exp(np.median(others))
            yield LeafFinding("W414", leaf.node_id, f"{name}: expected about {middle:.4g} mm; found {np.exp(own):.4g}")


def _toy_findings(leaf: LeafSize) -> Iterator[LeafFinding]:
    named = next((title for title in leaf.titles if _TOY.search(title)), None)
    if named is not None:
        yield LeafFinding("W415", leaf.node_id, f"expected titles of real objects; found {named!r}")
    names = AXES if leaf.dims[0] in AXES else tuple(f"extent{number}" for number in (1, 2, 3))
    places = [names.index(dim) for dim in leaf.dims]
    for name, mean in (leaf.sources or {}).items():
        part = mean[places] / leaf.median
        if np.isfinite(part).sum() > 1 and np.nanmax(part) < MINIATURE:
            size = f"expected objects of about the class's size; found {np.nanmax(part):.2f} of it on every axis"
            yield LeafFinding("W415", leaf.node_id, f"{name}: {size}")


def _whole(mean: FloatArray) -> bool:
    """Return True if a mean size (3,) states every axis."""
    return not bool(np.isnan(mean).any())


def _sibling_findings(leaves: Sequence[LeafSize]) -> Iterator[LeafFinding]:
    families: defaultdict[str, list[LeafSize]] = defaultdict(list)
    for leaf in leaves:
        if len(leaf.dims) == len(AXES):
            families[leaf.parent_id].append(leaf)
    for family in families.values():
        sizes = np.array([np.log(leaf.median).mean() for leaf in family])
        if len(sizes) < SIBLINGS:
            continue
        middle = float(np.median(sizes))
        scatter = float(np.median(np.abs(sizes - middle))) / NORMAL_MAD
        for leaf, size in zip(family, sizes.tolist(), strict=True):
            if abs(size - middle) > max(np.log(FACTOR), SIBLING_SD * scatter):
                yield LeafFinding(
                    "W412", leaf.node_id, f"expected about {np.exp(middle):.4g} mm; found {np.exp(size):.4g}"
                )


def _lying_findings(leaves: Sequence[LeafSize]) -> Iterator[LeafFinding]:
    upright = [(leaf, _depth_over_height(leaf)) for leaf in leaves if leaf.pose == "upright"]
    families: defaultdict[str, list[float]] = defaultdict(list)
    for leaf, ratio in upright:
        if np.isfinite(ratio):
            families[leaf.parent_id].append(ratio)
    for leaf, ratio in upright:
        siblings = families[leaf.parent_id]
        usual = float(np.median(siblings)) if len(siblings) > SIBLINGS else 1.0
        if ratio > max(FACTOR, LYING * min(usual, 1.0)):
            message = f"stands, and is {ratio:.3g} times as deep as high; {usual:.3g} times is usual there"
            yield LeafFinding("W413", leaf.node_id, message)


def _depth_over_height(leaf: LeafSize) -> float:
    """Width over height, of the range where it states both, else of the medians; NaN unstated."""
    size = dict(zip(leaf.dims, leaf.median.tolist(), strict=True))
    if leaf.typical is not None and not np.isnan(leaf.typical[1:]).any():
        size = dict(zip(AXES, leaf.typical.tolist(), strict=True))
    return float(size.get("width", np.nan) / size.get("height", np.nan))


def findings(nodes: pa.Table, items: pa.Table, priors: pa.Table, manifest: Mapping[str, Any]) -> Iterator[Finding]:
    """Findings on the leaves, from the rows that ship; those of the shipped release that are settled are left out."""
    accepted = settled_findings() if manifest["name"] == SHIPPED else frozenset()
    for one in leaf_findings(list(_leaf_sizes(nodes, items, priors)), accepted):
        yield Finding(one.code, one.node_id, one.message)


def _leaf_sizes(nodes: pa.Table, items: pa.Table, priors: pa.Table) -> Iterator[LeafSize]:
    means = _source_means(items)
    fitted: dict[str, Mapping[str, Any]] = {}
    for row in priors.to_pylist():
        fitted.setdefault(row["node_id"], row)
    above = dict(zip(nodes["node_id"].to_pylist(), nodes["parent_id"].to_pylist(), strict=True))
    inner, named = set(above.values()), titles(items)
    for node in nodes.to_pylist():
        node_id = node["node_id"]
        if node_id in inner or node_id not in fitted:
            continue
        prior = Prior.of_row(fitted[node_id])
        frame = int(prior.dims[0] in EXTENTS)
        said = {key: mean[frame] for key, mean in means.get(node_id, {}).items()}
        typical = next((mean for (_, kind), mean in said.items() if kind == JUDGED), None)
        sources = {name: mean for (name, kind), mean in said.items() if kind not in {JUDGED, NORM}}
        yield LeafSize(
            node_id,
            node["parent_id"] or "",
            node["pose"],
            prior.dims,
            prior.quantile(0.5),
            typical,
            sources,
            _family(node_id, above),
            named.get(node_id, ()),
        )


def _family(node_id: str, above: Mapping[str, str | None]) -> str:
    """The node of level 2 that a node is in, below the root."""
    path = [node_id]
    while (parent := above.get(path[-1])) is not None and parent not in path:
        path.append(parent)
    return path[-2] if len(path) > 1 else node_id


def _source_means(items: pa.Table) -> dict[str, dict[tuple[str, str], tuple[FloatArray, FloatArray]]]:
    """By leaf and (source, kind): geometric mean (3,) of the axes, and (3,) of the extents, mm, NaN unstated."""
    axes = np.column_stack([items[f"{axis}_mm"].to_numpy(zero_copy_only=False) for axis in AXES])
    sizes = np.log(np.stack([axes.astype(float), extents_of(items)], axis=1))  # (n, 2, 3)
    groups: defaultdict[tuple[str, str, str], list[int]] = defaultdict(list)
    columns = (items[name].to_pylist() for name in ("node_id", "source", "kind"))
    for row, key in enumerate(zip(*columns, strict=True)):
        groups[key].append(row)
    means: defaultdict[str, dict[tuple[str, str], tuple[FloatArray, FloatArray]]] = defaultdict(dict)
    for (node_id, source, kind), rows in groups.items():
        stated = ~np.isnan(sizes[rows])
        total, count = np.where(stated, sizes[rows], 0.0).sum(axis=0), stated.sum(axis=0)
        mean = np.exp(np.where(count > 0, total / np.maximum(count, 1), np.nan))
        means[node_id][source, kind] = (mean[0], mean[1])
    return means

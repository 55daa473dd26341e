"""Checks on the nodes of a release (codes 2xx): five levels, one root, known parents, no cycle."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

import pyarrow as pa

from metric_base.arrays import grouped
from metric_tree.axes import DIMENSIONS
from metric_tree.checks.finding import Finding

LEVELS = 5
POSES = ("upright", "flat", "any")


def findings(nodes: pa.Table) -> Iterator[Finding]:
    """Yield the findings on the nodes table."""
    rows = nodes.to_pylist()
    by_id = {row["node_id"]: row for row in rows}
    children = grouped((row["parent_id"], row) for row in rows)
    for node_id, times in Counter(row["node_id"] for row in rows).items():
        if times > 1:
            yield Finding("E204", node_id, f"expected one row; found {times}")
    roots = [row["node_id"] for row in rows if row["parent_id"] is None]
    if len(roots) != 1:
        yield Finding("E201", "nodes.parquet", f"expected one root; found {len(roots)}: {', '.join(roots[:5])}")
    for row in rows:
        yield from _ancestor_findings(row, by_id)
        yield from _column_findings(row)
        yield from _child_findings(row, children.get(row["node_id"], []))
    for name, times in Counter(row["name"] for row in rows).items():
        if times > 1:
            yield Finding("W212", name, f"expected one node of this name; found {times}")


def _ancestor_findings(row: Mapping[str, Any], by_id: Mapping[str, Mapping[str, Any]]) -> Iterator[Finding]:
    """Check the parent, the ancestors, the level and the path of a node (E202, E203, E205, E207)."""
    node_id = row["node_id"]
    parent = None if row["parent_id"] is None else by_id.get(row["parent_id"])
    if row["parent_id"] is not None and parent is None:
        yield Finding("E202", node_id, f"parent_id: expected a node; found {row['parent_id']!r}")
        return
    seen, ancestor = {node_id}, parent
    while ancestor is not None:
        if ancestor["node_id"] in seen:
            yield Finding("E203", node_id, "parent_id: expected a way to the root; found a cycle")
            return
        seen.add(ancestor["node_id"])
        ancestor = None if ancestor["parent_id"] is None else by_id.get(ancestor["parent_id"])
    expected = 1 if parent is None else parent["level"] + 1
    if row["level"] != expected:
        yield Finding("E205", node_id, f"level: expected {expected}; found {row['level']}")
    path = [*(parent["path"] if parent else []), row["name"]]
    if row["path"] != path:
        yield Finding("E207", node_id, f"path: expected {' > '.join(path)}; found {' > '.join(row['path'] or [])}")


def _column_findings(row: Mapping[str, Any]) -> Iterator[Finding]:
    """Check pose, dimensions and synset of a node (E208, W213)."""
    if row["pose"] not in POSES:
        yield Finding("E208", row["node_id"], f"pose: expected one of {', '.join(POSES)}; found {row['pose']!r}")
    if unknown := [dim for dim in row["dims"] or [] if dim not in DIMENSIONS]:
        yield Finding("E208", row["node_id"], f"dims: expected among {', '.join(DIMENSIONS)}; found {unknown}")
    if row["synset"] is None and not row["node_id"].startswith("mt:") and not row["node_id"].endswith("/other"):
        yield Finding("W213", row["node_id"], "synset: expected one, or an id of a reviewed insertion; found neither")


def _child_findings(row: Mapping[str, Any], children: list[dict[str, Any]]) -> Iterator[Finding]:
    """Check the level of leaves, the number and the names of children, and the counts (E206, E209, E210, W211)."""
    if (not children) != (row["level"] == LEVELS):
        yield Finding("E206", row["node_id"], f"level: expected leaves at {LEVELS} alone; found {row['level']}")
    if len(children) == 1:
        yield Finding("W211", row["node_id"], f"expected two children or more; found {children[0]['node_id']} alone")
    for name, times in Counter(child["name"] for child in children).items():
        if times > 1:
            yield Finding("E210", row["node_id"], f"expected children of different names; found {name!r} {times} times")
    total = row["n_own"] + sum(child["n_items"] for child in children)
    if row["n_items"] != total:
        yield Finding("E209", row["node_id"], f"n_items: expected {total}, own and below; found {row['n_items']}")

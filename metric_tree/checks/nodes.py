"""Checks on the nodes of a release: exactly five levels, one root, no orphan, no cycle (codes 2xx)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

import pyarrow as pa

from metric_tree.axes import AXES, EXTENTS
from metric_tree.checks.finding import Finding

LEVELS = 5
POSES = ("upright", "flat", "any")
DIMENSIONS = (*AXES, *EXTENTS)

CODES = {
    "E201": "not exactly one root",
    "E202": "a node whose parent is not in the tree",
    "E203": "a node that is its own ancestor",
    "E204": "two nodes with one id",
    "E205": "a level that is not the parent's plus one",
    "E206": "a leaf that is not at level 5, or a node below it",
    "E207": "a path that is not the parent's path and the node's name",
    "E208": "a pose or a dimension that the format does not know",
    "E209": "counts of items that disagree with those below",
    "E210": "siblings with one name",
    "W211": "an inner node with one child",
    "W212": "one name on nodes in different places",
    "W213": "a hypernym path that does not come from WordNet",
}


def findings(nodes: pa.Table) -> Iterator[Finding]:
    """Findings on the nodes table."""
    rows = nodes.to_pylist()
    by_id = {row["node_id"]: row for row in rows}
    for node_id, times in Counter(row["node_id"] for row in rows).items():
        if times > 1:
            yield Finding("E204", node_id, f"expected one row; found {times}")
    roots = [row["node_id"] for row in rows if row["parent_id"] is None]
    if len(roots) != 1:
        yield Finding("E201", "nodes.parquet", f"expected one root; found {len(roots)}: {', '.join(roots[:5])}")
    for row in rows:
        yield from _place_findings(row, by_id)
        yield from _word_findings(row)
    yield from _family_findings(rows)


def _place_findings(row: Mapping[str, Any], by_id: Mapping[str, Mapping[str, Any]]) -> Iterator[Finding]:
    parent = by_id.get(row["parent_id"]) if row["parent_id"] is not None else None
    node_id = row["node_id"]
    if row["parent_id"] is not None and parent is None:
        yield Finding("E202", node_id, f"parent_id: expected a node; found {row['parent_id']!r}")
        return
    if _is_own_ancestor(row, by_id):
        yield Finding("E203", node_id, "parent_id: expected a way to the root; found a cycle")
        return
    expected = 1 if parent is None else parent["level"] + 1
    if row["level"] != expected:
        yield Finding("E205", node_id, f"level: expected {expected}; found {row['level']}")
    path = [*(parent["path"] if parent else []), row["name"]]
    if row["path"] != path:
        yield Finding("E207", node_id, f"path: expected {' > '.join(path)}; found {' > '.join(row['path'] or [])}")


def _word_findings(row: Mapping[str, Any]) -> Iterator[Finding]:
    if row["pose"] not in POSES:
        yield Finding("E208", row["node_id"], f"pose: expected one of {', '.join(POSES)}; found {row['pose']!r}")
    if unknown := [dim for dim in row["dims"] or [] if dim not in DIMENSIONS]:
        yield Finding("E208", row["node_id"], f"dims: expected among {', '.join(DIMENSIONS)}; found {unknown}")
    inserted = row["synset"] is None and not row["node_id"].startswith("mt:") and not row["node_id"].endswith("/other")
    if inserted:
        yield Finding("W213", row["node_id"], "synset: expected one, or an id of a reviewed insertion; found neither")


def _family_findings(rows: list[dict[str, Any]]) -> Iterator[Finding]:
    children: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        children.setdefault(row["parent_id"], []).append(row)
    names = Counter(row["name"] for row in rows)
    for row in rows:
        below = children.get(row["node_id"], [])
        if (not below) != (row["level"] == LEVELS):
            yield Finding("E206", row["node_id"], f"level: expected leaves at {LEVELS} alone; found {row['level']}")
        if len(below) == 1:
            yield Finding("W211", row["node_id"], f"expected two children or more; found {below[0]['node_id']} alone")
        for name, times in Counter(child["name"] for child in below).items():
            if times > 1:
                yield Finding(
                    "E210", row["node_id"], f"expected children of different names; found {name!r} {times} times"
                )
        total = row["n_own"] + sum(child["n_items"] for child in below)
        if row["n_items"] != total:
            yield Finding("E209", row["node_id"], f"n_items: expected {total}, own and below; found {row['n_items']}")
    for name, times in names.items():
        if times > 1:
            yield Finding("W212", name, f"expected one node of this name; found {times}")


def _is_own_ancestor(row: Mapping[str, Any], by_id: Mapping[str, Mapping[str, Any]]) -> bool:
    seen = set()
    while row is not None and row["node_id"] not in seen:
        seen.add(row["node_id"])
        above = by_id.get(row["parent_id"]) if row["parent_id"] is not None else None
        if above is None:
            return False
        row = above
    return True

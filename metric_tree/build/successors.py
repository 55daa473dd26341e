"""What became of the ids of earlier releases: each leads to a node of this one."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa

from metric_base.errors import InputError
from metric_base.folders import taxonomy_directory
from taxonomy.levels import table_rows

__all__ = ["FormerNode", "former_nodes", "successor_table"]

_COLUMNS = ("release", "node_id", "parent_id")


@dataclass(frozen=True, slots=True)
class FormerNode:
    """A node of an earlier release; the root has no parent."""

    release: str
    node_id: str
    parent_id: str | None


def former_nodes(path: Path | None = None) -> list[FormerNode]:
    """The nodes of releases 1.0.0 and 2.0.0 (`data/taxonomy/former_ids.csv`)."""
    rows = table_rows(path or taxonomy_directory() / "former_ids.csv", _COLUMNS)
    return [FormerNode(row["release"], row["node_id"], row["parent_id"] or None) for _, row in rows]


def successor_table(former: Collection[FormerNode], nodes: Collection[str], replaced: Mapping[str, str]) -> pa.Table:
    """Columns `old_id`, `release`, `node_id`: the id itself, what replaced it, or else the successor of its parent.

    Parameters
    ----------
    nodes : ids of the new release; replaced : ids that are gone and what replaces each

    Raises
    ------
    InputError
        Not even a parent leads to a node.
    """
    parents = {(one.release, one.node_id): one.parent_id for one in former}

    def successor(release: str, node_id: str) -> str:
        current: str | None = node_id
        while current is not None:
            following = replaced.get(current, current)
            for known in (current, following, f"{following}/other", current.removesuffix("/other")):
                if known in nodes:
                    return known
            current = parents.get((release, current))
        raise InputError(f"former_ids.csv: {node_id} of {release}: expected a way to a node; found none")

    rows = [
        {"old_id": one.node_id, "release": one.release, "node_id": successor(one.release, one.node_id)}
        for one in sorted(former, key=lambda one: (one.release, one.node_id))
    ]
    return pa.Table.from_pylist(rows, schema=SUCCESSORS)


#: Columns of `successors.parquet`.
SUCCESSORS = pa.schema([("old_id", pa.string()), ("release", pa.string()), ("node_id", pa.string())])

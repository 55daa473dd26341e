"""A small valid release for tests: fifteen nodes, forty synthetic items, and priors of six leaves."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from metric_tree.release.release import Release, publish_release
from metric_tree.release.schema import TABLES

__all__ = ["Rows", "release", "rows"]

Rows = dict[str, list[dict[str, Any]]]

#: id, parent, pose, typical length, width, height in mm (leaves only), aliases
_NODES = [
    ("entity.n.01", None, "upright", None, ["entity"]),
    ("furniture.n.01", "entity.n.01", "upright", None, ["furniture"]),
    ("electronics.n.01", "entity.n.01", "any", None, ["electronics"]),
    ("seat.n.03", "furniture.n.01", "upright", None, ["seat"]),
    ("device.n.01", "electronics.n.01", "any", None, ["device"]),
    ("animal_figure.n.01", "furniture.n.01", "any", None, ["figure"]),
    ("chair.n.01", "seat.n.03", "upright", None, ["chair", "stuhl"]),
    ("pointer.n.01", "device.n.01", "any", None, ["pointing device"]),
    ("rodent_figure.n.01", "animal_figure.n.01", "any", None, []),
    ("swivel_chair.n.01", "chair.n.01", "upright", (620, 600, 1050), ["swivel chair", "desk chair"]),
    ("mt:bar_stool", "chair.n.01", "upright", (420, 400, 760), ["bar stool"]),
    ("mouse.n.04", "pointer.n.01", "flat", (112, 62, 38), ["mouse", "computer mouse"]),
    ("trackball.n.01", "pointer.n.01", "flat", (140, 95, 60), ["trackball"]),
    ("mouse.n.01", "rodent_figure.n.01", "any", (90, 40, 45), ["mouse"]),
    ("rat.n.01", "rodent_figure.n.01", "any", (180, 60, 70), ["rat"]),
]

_COUNTS = {
    "swivel_chair.n.01": 14,
    "mt:bar_stool": 9,
    "mouse.n.04": 9,
    "trackball.n.01": 4,
    "mouse.n.01": 2,
    "rat.n.01": 2,
}


def rows(seed: int = 0) -> Rows:
    """Return the rows of the release, which a test may change before `release` writes them."""
    generator = np.random.default_rng(seed)
    parents = {node_id: parent for node_id, parent, *_ in _NODES}
    items = [item for node_id, *_, size, _ in _NODES if size for item in _items(node_id, size, generator)]
    nodes = [_node(entry, parents) for entry in _NODES]
    priors = [_prior(node_id, size) for node_id, _, _, size, _ in _NODES if size]
    return {"nodes.parquet": nodes, "items.parquet": items, "priors.parquet": priors, "images.parquet": []}


def release(
    directory: Path,
    content: Rows | None = None,
    manifest: Callable[[dict[str, Any]], None] | None = None,
    extras: Path | None = None,
) -> Release:
    """Publish rows (default: valid ones) as a release. `manifest` may change the manifest before."""
    content = rows() if content is None else content
    tables = {name: pa.Table.from_pylist(content[name], schema=schema) for name, schema in TABLES.items()}
    parents = {row["parent_id"] for row in content["nodes.parquet"]}
    fields: dict[str, Any] = {
        "name": "mini",
        "version": "0.0.1",
        "created": "2026-11-21",
        "sources": [{"id": "made", "title": "made for tests", "url": "", "licence": "CC0-1.0", "kind": "product"}],
        "counts": {
            "nodes": len(content["nodes.parquet"]),
            "leaves": sum(row["node_id"] not in parents for row in content["nodes.parquet"]),
            "levels": 5,
            "n_fit": len(content["items.parquet"]),
            "n_rows": len(content["items.parquet"]),
        },
    }
    if manifest is not None:
        manifest(fields)
    return publish_release(directory, tables, fields, extras)


def _node(entry: tuple[Any, ...], parents: dict[str, str | None]) -> dict[str, Any]:
    node_id, parent, pose, size, aliases = entry
    ancestors = [node_id]
    while (above := parents[ancestors[0]]) is not None:
        ancestors.insert(0, above)
    direct = _COUNTS.get(node_id, 0)
    below = sum(count for leaf, count in _COUNTS.items() if node_id in _ancestors(leaf, parents))
    return {
        "node_id": node_id,
        "name": _name(node_id),
        "synset": None if node_id.startswith("mt:") else node_id,
        "parent_id": parent,
        "level": len(ancestors),
        "path": [_name(step) for step in ancestors],
        "hypernyms": ancestors[:-1],
        "aliases": aliases,
        "pose": pose,
        "dims": ["length", "width", "height"],
        "n_items": direct + below,
        "n_own": direct if size else 0,
    }


def _ancestors(node_id: str, parents: dict[str, str | None]) -> set[str]:
    found: set[str] = set()
    while (above := parents[node_id]) is not None:
        found.add(above)
        node_id = above
    return found


def _items(node_id: str, size: tuple[float, ...], generator: np.random.Generator) -> list[dict[str, Any]]:
    made = []
    for number in range(_COUNTS[node_id]):
        length, width, height = np.round(np.array(size) * np.exp(generator.normal(0, 0.05, 3)), 1)
        length, width = max(length, width), min(length, width)
        made.append(
            {
                "item_id": f"made:{node_id}-{number}",
                "node_id": node_id,
                "source": "made",
                "attribution": "the tests",
                "source_id": f"{node_id}-{number}",
                "title": f"{_name(node_id)} {number}",
                "length_mm": length,
                "width_mm": width,
                "height_mm": height,
                "extents_mm": sorted([length, width, height], reverse=True),
                "kind": "product",
                "year": None,
                "region": None,
                "url": "",
                "licence": "CC0-1.0",
                "flags": [],
            }
        )
    return made


def _prior(node_id: str, size: tuple[float, ...]) -> dict[str, Any]:
    return {
        "node_id": node_id,
        "dims": ["length", "width", "height"],
        "family": "lognormal-mixture",
        "weights": [1.0],
        "means": [np.log(size).tolist()],
        "covariances": [(np.eye(3) * 0.05**2 + 0.02**2).tolist()],
        "shared_covariance": np.full((3, 3), 0.04**2).tolist(),
        "n": _COUNTS[node_id],
        "n_sources": 1,
        "share_by_kind": {"product": 1.0},
        "borrowed": 0.0,
        "heldout_log_density": None,
        "tier": "measured",
    }


def _name(node_id: str) -> str:
    return node_id.removeprefix("mt:").split(".")[0].replace("_", " ")

"""Tables and indices of a release for pages: rows, labels and codes by node, and the meaning of the tiers."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from explorer.urls import slug
from metric_base.arrays import FloatArray, IntArray, grouped
from metric_base.errors import InputError
from metric_base.escaping import visible
from metric_base.folders import taxonomy_directory
from metric_base.text_tables import named_texts
from metric_tree.node import Node, NoPrior
from metric_tree.prior import QUANTILES, Prior
from metric_tree.tree import Tree
from taxonomy.label_lists import Label, vocabularies, vocabulary

#: Tier of a node without a prior.
UNKNOWN = "unknown"
#: Meaning of each tier, the best first.
MEANINGS = named_texts(Path(__file__).with_name("tier_meanings.txt"))


class ReleaseCatalogue:
    """Tables and indices of one release of a site or server.

    Parameters
    ----------
    trees : sequence of Tree
        All releases of the site; the first is at the root, the others are under `releases/VERSION/`.
    place : int, default 0
        Index of this release in `trees`.

    Raises
    ------
    InputError
        Two releases have the same version, or two ids are equal as file names.
    """

    def __init__(self, trees: Sequence[Tree], place: int = 0) -> None:
        versions = [tree.version for tree in trees]
        if len(set(versions)) != len(versions):
            raise InputError(f"--tree: expected releases of different versions; found {', '.join(versions)}")
        tree = trees[place]
        self.tree, self.main = tree, trees[0]
        self.others = tuple(other for other in trees if other is not tree)
        self.nodes = {node.node_id: node for node in tree}
        self.by_slug = {slug(node_id): node for node_id, node in self.nodes.items()}
        if len({name.casefold() for name in self.by_slug}) != len(self.nodes):
            expected = "ids that differ as file names; found two that are equal"
            raise InputError(f"{tree.release.directory}: node_id: expected {expected}")
        self._quantiles: dict[str, FloatArray] = {}

    @cached_property
    def etag(self) -> str:
        """A name of the release's content: the start of the sha256 of its manifest."""
        text = json.dumps(self.tree.release.manifest, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def relative_root(self, tree: Tree) -> str:
        """Return the relative URL from the root of this release to the root of `tree`."""
        up = "" if self.tree is self.main else "../../"
        return up if tree is self.main else f"{up}releases/{tree.version}/"

    def tier(self, node: Node) -> str:
        """Return the tier of the default prior of a node."""
        return node.tier or UNKNOWN

    def prior(self, node: Node) -> Prior | None:
        """Return the default prior of a node, otherwise the one with most dimensions; None if the node has no prior."""
        try:
            return node.prior()
        except NoPrior:
            dims = max(node.prior_dims, key=len, default=None)
            return None if dims is None else node.prior(dims)

    def dims(self, node: Node) -> tuple[str, ...]:
        """Return the dimensions of the default prior of a node, empty without a prior."""
        prior = self.prior(node)
        return prior.dims if prior is not None else ()

    def quantiles(self, node: Node) -> FloatArray:
        """Return `QUANTILES` (5, d) of the default prior of a node in mm; d is 0 without a prior."""
        if node.stated is not None:  # a variant, which is not the node of the cache
            return node.prior().quantiles(QUANTILES)
        if node.node_id not in self._quantiles:
            prior = self.prior(node)
            none = np.zeros((len(QUANTILES), 0))
            self._quantiles[node.node_id] = none if prior is None else prior.quantiles(QUANTILES)
        return self._quantiles[node.node_id]

    @cached_property
    def items(self) -> pa.Table:
        """All published items. Raises InputError if an item has an unknown node."""
        table = self.tree.release.table("items")
        if strays := set(table["node_id"].unique().to_pylist()) - set(self.nodes):
            raise InputError(self._refusal("node_id", "ids of nodes", min(strays)))
        return table

    def published(self, rows: IntArray) -> pa.Table:
        """Return rows of `items`. Their indices are a buffer, because pyarrow imports pandas to read an array."""
        indices = pa.py_buffer(np.ascontiguousarray(rows, dtype=np.int64))
        return self.items.take(pa.Array.from_buffers(pa.int64(), len(rows), [None, indices]))

    @cached_property
    def sizes(self) -> FloatArray:
        """Sizes of all items, (n, 6) in mm by `metric_tree.axes.DIMENSIONS`, NaN where not stated."""
        table = np.full((self.items.num_rows, 6), np.nan)
        for column, name in enumerate(("length_mm", "width_mm", "height_mm")):
            table[:, column] = np.array(self.items[name].to_pylist(), dtype=float)
        for row, extents in enumerate(self.items["extents_mm"].to_pylist()):
            for column, value in enumerate((extents or ())[:3]):
                table[row, 3 + column] = value
        if len(bad := table[~np.isnan(table) & ~((table > 0) & (table < np.inf))]):
            raise InputError(self._refusal("length_mm, width_mm, height_mm, extents_mm", "positive sizes", str(bad[0])))
        return table

    def _refusal(self, field: str, expected: str, found: str) -> str:
        return f"{self.tree.release.directory}/items.parquet: {field}: expected {expected}; found {visible(found)}"

    @cached_property
    def kinds(self) -> Any:
        """Kinds of evidence of all items, (n,) texts."""
        return np.array(self.items["kind"].to_pylist(), dtype=object)

    def rows(self, node: Node) -> IntArray:
        """Rows in `items` of the items at or below a node, in the order of the table."""
        found = [self._own_rows[one.node_id] for one in node.descendants() if one.node_id in self._own_rows]
        return np.sort(np.concatenate(found)) if found else np.zeros(0, dtype=int)

    def images(self, node: Node) -> list[dict[str, Any]]:
        """The images of the items at or below a node."""
        return [row for one in node.descendants() for row in self._images.get(one.node_id, ())]

    @cached_property
    def item_rows(self) -> Mapping[str, int]:
        """Row in `items` by item id."""
        return {item_id: row for row, item_id in enumerate(self.items["item_id"].to_pylist())}

    @cached_property
    def _own_rows(self) -> dict[str, IntArray]:
        return _rows_by(self.items["node_id"].to_pylist())

    @cached_property
    def rows_by_source(self) -> dict[str, IntArray]:
        """Rows in `items` by source id."""
        return _rows_by(self.items["source"].to_pylist())

    @cached_property
    def _images(self) -> dict[str, list[dict[str, Any]]]:
        return grouped((row["node_id"], row) for row in self.tree.release.table("images").to_pylist())

    @cached_property
    def sources(self) -> dict[str, dict[str, Any]]:
        """The manifest's record of each source."""
        return {record["id"]: record for record in self.tree.release.manifest["sources"]}

    @cached_property
    def vocabularies(self) -> dict[str, tuple[Label, ...]]:
        """The label lists of detectors by name."""
        return {name: vocabulary(name) for name in vocabularies()}

    @cached_property
    def names(self) -> frozenset[str]:
        """All folded names of the nodes."""
        return frozenset(name for name, _ in self.tree.names())

    @cached_property
    def labels(self) -> Mapping[str, list[tuple[str, str]]]:
        """List and label of each node that a list names, by node id."""
        entries = ((name, label) for name, labels in self.vocabularies.items() for label in labels)
        return grouped((str(one.node_id), (name, one.label)) for name, one in entries if one.node_id in self.nodes)

    @cached_property
    def codes(self) -> Mapping[str, list[str]]:
        """WordNet offsets (`n03001627`) and Freebase ids (`/m/01mzpv`) by node id."""
        text = (taxonomy_directory() / "generated" / "codes.tsv").read_text(encoding="utf-8")
        return grouped((node_id, code) for code, _, node_id in (line.partition("\t") for line in text.splitlines()))


def _rows_by(names: Sequence[str]) -> dict[str, IntArray]:
    rows = grouped((name, row) for row, name in enumerate(names))
    return {name: np.array(own) for name, own in rows.items()}

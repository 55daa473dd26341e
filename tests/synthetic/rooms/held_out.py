"""True sizes for synthetic rooms: real items of the fold that the test room's tree does not see."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa

from estimator.results.object_priors import resolve_categories
from metric_base.arrays import FloatArray
from metric_tree.node import Node
from metric_tree.pipeline.ingest import blocks, ingest_block, is_held_out, raw_files
from metric_tree.tree import Tree
from taxonomy.categories import Taxonomy
from tests.synthetic.rooms.shapes import CATEGORIES
from tests.synthetic.rooms.sizes import plausible_sizes

__all__ = ["LEAST_ITEMS", "held_out_pool", "pool_at"]

#: Items below which a category also draws from artists' models, whose sizes are plausible but nobody's product.
LEAST_ITEMS = 8
#: Kinds of items that are objects somebody made, sold or measured.
REAL = frozenset({"product", "measured", "standard"})
#: Kinds that are statements about a category and no object at all.
STATED_KINDS = frozenset({"curated", "judged", "norm", "default"})


def held_out_pool(
    raw: Sequence[Path], tree: Tree, taxonomy: Callable[[], Taxonomy], fold: tuple[int, int]
) -> dict[str, FloatArray]:
    """The held-out items of every category as (n, 3) length, width, height in mm, but for those without any.

    A category draws from the node that the estimator reads its name as, and from all below it. An item whose size to
    the millimetre also occurs in the part that the fit sees is left out: shops list one object many times.
    """
    rows = _complete_rows(raw, taxonomy)
    held = [is_held_out(item, *fold) for item in rows["item_id"].to_pylist()]
    sizes = np.column_stack([rows[f"{axis}_mm"].to_numpy() for axis in ("length", "width", "height")])
    nodes, kinds = rows["node_id"].to_pylist(), rows["kind"].to_pylist()
    seen = {_key(node, size) for node, size, out in zip(nodes, sizes, held, strict=True) if not out}
    free = [
        out and kind not in STATED_KINDS and _key(node, size) not in seen
        for node, size, out, kind in zip(nodes, sizes, held, kinds, strict=True)
    ]
    pool = {}
    for category, meaning in resolve_categories(tree, set(CATEGORIES)).items():
        if meaning.node is None:
            continue
        below = _below(meaning.node)
        mine = np.array([ok and node in below for ok, node in zip(free, nodes, strict=True)], dtype=bool)
        real = plausible_sizes(category, sizes[mine & np.array([kind in REAL for kind in kinds])])
        pool[category] = real if len(real) >= LEAST_ITEMS else plausible_sizes(category, sizes[mine])
    return {category: np.unique(own.round(1), axis=0) for category, own in pool.items() if len(own)}


def pool_at(path: Path, synthetic: Callable[[], dict[str, FloatArray]]) -> dict[str, FloatArray]:
    """The pool kept in a file, made where the file is not there."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps({name: rows.tolist() for name, rows in synthetic().items()}))
    return {name: np.array(rows) for name, rows in json.loads(path.read_text()).items()}


def _complete_rows(raw: Iterable[Path], taxonomy: Callable[[], Taxonomy]) -> pa.Table:
    """Rows of the build's own first step that have all three axes."""
    batches = []
    for block in blocks(raw_files(raw)):
        reader = pa.ipc.open_file(pa.py_buffer(ingest_block(block, taxonomy).rows))
        batches += [reader.get_batch(k) for k in range(reader.num_record_batches)]
    table = pa.Table.from_batches(batches)
    return table.filter(
        pa.compute.is_valid(pa.compute.add(table["length_mm"], pa.compute.add(table["width_mm"], table["height_mm"])))
    )


def _key(node: str, size: FloatArray) -> tuple[str, int, int, int]:
    long, wide, high = (round(float(v)) for v in size)
    return node, long, wide, high


def _below(node: Node) -> set[str]:
    """Ids of a node and of all below it."""
    return {node.node_id, *(name for child in node.children for name in _below(child))}

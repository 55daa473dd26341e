"""True sizes for synthetic rooms: real items of the fold that the tree is built without."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa

from estimator.results.object_priors import resolve_categories
from metric_base.arrays import FloatArray
from metric_tree.node import Node
from metric_tree.pipeline.ingest import blocks, ingest_block, is_held_out, raw_files, unpack
from metric_tree.tree import Tree
from taxonomy.categories import Taxonomy
from tests.synthetic.rooms.shapes import CATEGORIES
from tests.synthetic.rooms.sizes import plausible_sizes

__all__ = ["held_out_pool", "pool_at"]

#: Minimum number of real items of a category. With fewer, models of artists are used too; their sizes are plausible,
#: but not of real products.
MIN_REAL_ITEMS = 8
#: Kinds of items that are manufactured, sold or measured objects.
REAL_KINDS = frozenset({"product", "measured", "standard"})
#: Kinds of items that are statements about a category, not about an object.
STATED_KINDS = frozenset({"curated", "judged", "norm", "default"})


def held_out_pool(
    raw: Sequence[Path], tree: Tree, taxonomy: Callable[[], Taxonomy], fold: tuple[int, int]
) -> dict[str, FloatArray]:
    """Return length, width and height (n, 3) in mm of the held-out items of each category with such items.

    The items of a category are from its node in the tree and from all nodes below. Items with the same size in mm as an
    item of the other folds are skipped, because shops list an object several times.
    """
    rows = _complete_rows(raw, taxonomy)
    held = [is_held_out(item, *fold) for item in rows["item_id"].to_pylist()]
    sizes = np.column_stack([rows[f"{axis}_mm"].to_numpy() for axis in ("length", "width", "height")])
    nodes, kinds = rows["node_id"].to_pylist(), rows["kind"].to_pylist()
    fitted = {_key(node, size) for node, size, out in zip(nodes, sizes, held, strict=True) if not out}
    usable = [
        out and kind not in STATED_KINDS and _key(node, size) not in fitted
        for node, size, out, kind in zip(nodes, sizes, held, kinds, strict=True)
    ]
    pool = {}
    for category, match in resolve_categories(tree, set(CATEGORIES)).items():
        if match.node is None:
            continue
        subtree = _subtree(match.node)
        chosen = np.array([ok and node in subtree for ok, node in zip(usable, nodes, strict=True)], dtype=bool)
        real = plausible_sizes(category, sizes[chosen & np.array([kind in REAL_KINDS for kind in kinds])])
        pool[category] = real if len(real) >= MIN_REAL_ITEMS else plausible_sizes(category, sizes[chosen])
    return {category: np.unique(rows.round(1), axis=0) for category, rows in pool.items() if len(rows)}


def pool_at(path: Path, make: Callable[[], dict[str, FloatArray]]) -> dict[str, FloatArray]:
    """Read a pool from a file, or compute and store it if the file does not exist."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps({name: rows.tolist() for name, rows in make().items()}))
    return {name: np.array(rows) for name, rows in json.loads(path.read_text()).items()}


def _complete_rows(raw: Iterable[Path], taxonomy: Callable[[], Taxonomy]) -> pa.Table:
    """Return the rows of the first step of a build that have all three axes."""
    batches = []
    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder) / "raw.jsonl"
        for file in raw_files(raw):
            unpack(file, plain)
            for block in blocks(plain, str(file)):
                reader = pa.ipc.open_file(pa.py_buffer(ingest_block(block, taxonomy).rows))
                batches += [reader.get_batch(k) for k in range(reader.num_record_batches)]
    table = pa.Table.from_batches(batches)
    return table.filter(
        pa.compute.is_valid(pa.compute.add(table["length_mm"], pa.compute.add(table["width_mm"], table["height_mm"])))
    )


def _key(node: str, size: FloatArray) -> tuple[str, int, int, int]:
    long, wide, high = (round(float(v)) for v in size)
    return node, long, wide, high


def _subtree(node: Node) -> set[str]:
    """Return the ids of a node and of all nodes below it."""
    return {node.node_id, *(name for child in node.children for name in _subtree(child))}

"""The fit without non-commercial sources beside the whole one.

`python -m benchmarks.metric_tree.open_fit --out docs/evidence/open_fit.md`.

What is lost (nodes, items, coverage of label lists) and how far the priors of the nodes that both have differ.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from metric_tree.report.changes import (
    SIZE_QUANTILES,
    SPREAD_QUANTILES,
    Change,
    changes,
    label,
    largest_changes,
    removed_nodes,
    size_and_spread,
    source_changes,
)
from metric_tree.report.counts import ENOUGH, Coverage, coverage
from metric_tree.tree import Node, Tree, open_tree
from taxonomy.label_lists import vocabularies

__all__ = ["main", "page"]

#: Nodes of the table of what changes most.
SHOWN = 20

#: Change of a median that is worth counting: below it lies the rounding of what shops state.
MOVED = 0.02

_HEAD = """# The fit without non-commercial sources

`{open_directory}` is release {version} fitted without the sources whose terms exclude commercial use; nothing else
differs. This page says what that costs. It is printed by

    python -m benchmarks.metric_tree.open_fit --out docs/evidence/open_fit.md

and stands beside `metric-tree report {open_directory} --against {directory}`, which shows the same with figures.
"""


def main() -> None:
    """Write the page, or print it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--release", type=Path, default=Path("data/release/2.0.0"), help="the whole fit (%(default)s)")
    parser.add_argument("--open", type=Path, default=Path("data/release/2.0.0-open"), help="the other (%(default)s)")
    parser.add_argument("--out", type=Path, metavar="FILE.md", help="write the page there (default: print it)")
    arguments = parser.parse_args()
    text = page(open_tree(arguments.release), open_tree(arguments.open))
    if arguments.out:
        part = arguments.out.with_name(f".{arguments.out.name}.part")
        part.write_text(text, encoding="utf-8")
        part.replace(arguments.out)
    else:
        print(text, end="")


def page(whole: Tree, opened: Tree, names: Sequence[str] | None = None) -> str:
    """The page as Markdown, over these label lists (all by default)."""
    found = changes(opened, whole)
    head = _HEAD.format(
        open_directory=opened.release.directory, directory=whole.release.directory, version=label(whole)
    )
    lists = vocabularies() if names is None else names
    sections = [
        head,
        "## What is lost\n",
        _table(("", "whole", "open", "lost"), _counts(whole, opened)),
        _nodes(removed_nodes(opened, whole)),
        "Items of the fit by source, where they differ:\n",
        _table(("source", "whole", "open"), source_changes(opened, whole)),
        "## Label lists\n",
        f"Labels that have a prior from {ENOUGH} real items or more, from any, and at all; whole → open.\n",
        _table(
            ("list", "labels", f"{ENOUGH}+ real items", "any real item", "any prior"), _coverage(whole, opened, lists)
        ),
        "## How far the priors differ\n",
        _size_note(found),
        _model_note(whole, opened),
        _distribution(found),
        f"The {SHOWN} nodes with {ENOUGH} or more items in both whose size changes most:\n",
        _most(largest_changes(found, SHOWN, ENOUGH)),
    ]
    return "\n".join(section for section in sections if section)


def _counts(whole: Tree, opened: Tree) -> list[tuple[str, int, int, int]]:
    pairs = [
        ("nodes", len(whole), len(opened)),
        *((f"leaves with {least}+ real items", _leaves(whole, least), _leaves(opened, least)) for least in (1, 10, 30)),
        ("items of the fit", whole.root.n_items, opened.root.n_items),
        ("sources", *(len(tree.release.manifest["sources"]) for tree in (whole, opened))),
    ]
    return [(name, then, now, then - now) for name, then, now in pairs]


def _leaves(tree: Tree, least: int) -> int:
    return sum(node.n_items >= least for node in tree if not node.children)


def _nodes(lost: Iterable[Node]) -> str:
    names = [f"`{node.node_id}`" for node in lost]
    return f"The {len(names)} nodes: {', '.join(names)}.\n" if names else "No node is lost.\n"


def _coverage(whole: Tree, opened: Tree, names: Sequence[str]) -> list[tuple[object, ...]]:
    rows = []
    for name in names:
        then, now = coverage(whole, name), coverage(opened, name)
        shares = (_pair(then, now, field) for field in ("enough", "real", "any"))
        rows.append((name, then.labels, *shares))
    return rows


def _pair(then: Coverage, now: Coverage, field: str) -> str:
    before, after = getattr(then, field), getattr(now, field)
    if not then.labels:
        return "–"
    return f"{before} ({before / then.labels:.0%})" + (
        f" → {after} ({after / then.labels:.0%})" if after != before else ""
    )


def _size_note(found: Sequence[Change]) -> str:
    moved = sum(abs(change.size) > np.log1p(MOVED) for change in found)
    return (
        f"{len(found)} nodes have a prior over the same dimensions in both; {moved} of their median sizes move by more "
        f"than {MOVED:.0%}. Size: |change of ln median|, as a factor less one; width: change of the standard "
        "deviation of ln size; both are means over the dimensions of a node. A column is a quantile over the nodes.\n"
    )


def _model_note(whole: Tree, opened: Tree) -> str:
    """What the two fits expect of sources that disagree: every width holds it."""
    models = [tree.release.manifest.get("source_disagreement") for tree in (whole, opened)]
    if not all(models):
        return ""
    then, now = (f"share {model['share']:g}, spread {model['spread']:g}" for model in models if model)
    return f"The model of disagreement between sources, which every width holds, is fitted anew: {then} → {now}.\n"


def _distribution(found: Sequence[Change]) -> str:
    sizes_at, widths_at = ([f"{q:.0%}" for q in marks] for marks in (SIZE_QUANTILES, SPREAD_QUANTILES))
    head = ("level", "nodes", *(f"size {m}" for m in sizes_at), *(f"width {m}" for m in widths_at))
    rows = [
        (level, n, *(f"{np.expm1(s):.1%}" for s in sizes), *(f"{np.expm1(w):+.1%}" for w in widths))
        for level, n, sizes, widths in size_and_spread(found)
    ]
    return _table(head, rows)


def _most(found: Sequence[Change]) -> str:
    rows = [
        (
            " > ".join(c.node.path[1:]),
            f"{c.before.n_items} → {c.node.n_items}",
            " x ".join(c.dims),
            f"{_sizes(c.then_mm)} → {_sizes(c.now_mm)}",
            f"{np.expm1(c.size):+.0%}",
            f"{np.expm1(c.spread):+.0%}",
        )
        for c in found
    ]
    return _table(("node", "items", "dimensions", "medians, mm", "size", "width"), rows)


def _sizes(sizes_mm: Iterable[float]) -> str:
    return " x ".join(f"{size:.0f}" for size in sizes_mm)


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    lines = [list(map(str, head)), ["---"] * len(head), *([str(cell) for cell in row] for row in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


if __name__ == "__main__":
    main()

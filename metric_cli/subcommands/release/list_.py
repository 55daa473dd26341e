"""`metric-tree list`: the available releases, or with `--tree` the outline of a release."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator

from metric_base.errors import InputError
from metric_cli.tables import print_json, print_result
from metric_tree.node import Node
from metric_tree.release.registry import PATH_VARIABLE, releases
from metric_tree.release.release import open_release
from metric_tree.tree import open_tree

HELP = f"The available releases, newest first; {PATH_VARIABLE} names further folders of releases."

#: Number of levels of a tree.
LEVELS = 5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    parser.add_argument(
        "--tree",
        metavar="REF",
        nargs="?",
        const="",
        help="the outline of a release: a version or a folder (default: the newest available)",
    )
    parser.add_argument("--depth", type=int, default=3, help="levels of the outline, 1 to 5 (default: %(default)s)")
    parser.add_argument("--below", metavar="NAME", help="only the outline of this category, down to its leaves")


def run(arguments: argparse.Namespace) -> None:
    """Print the releases, or the outline of a release."""
    if arguments.tree is not None or arguments.below is not None:
        if not 1 <= arguments.depth <= LEVELS:
            raise InputError(f"--depth: expected 1 to {LEVELS}; found {arguments.depth}")
        tree = open_tree(arguments.tree or None)
        top = tree.root if arguments.below is None else tree.find(arguments.below)
        max_level = arguments.depth if arguments.below is None else LEVELS
        if arguments.json:
            print_json([node_entry(node) for node in top.descendants() if node.level <= max_level])
        else:
            sys.stdout.writelines(f"{line}\n" for line in outline(top, max_level))
        return
    fields, counts = ("name", "version", "created"), ("nodes", "leaves", "n_fit", "n_rows")
    described, rows = [], []
    for release in map(open_release, releases()):
        record = {name: release.manifest[name] for name in (*fields, "counts")} | {"path": str(release.directory)}
        described.append(record)
        rows.append((*(record[name] for name in fields), *map(record["counts"].get, counts), record["path"]))
    print_result(arguments.json, described, [*fields, *counts, "path"], rows)


def node_entry(node: Node) -> dict[str, object]:
    """Return the record of a node in the outline."""
    return {
        "node": node.node_id,
        "name": node.name,
        "level": node.level,
        "parent": node.parent_id,
        "tier": node.tier,
        "n_items": node.n_items,
    }


def outline(node: Node, max_level: int, prefix: str = "", branch: str = "") -> Iterator[str]:
    """Yield the lines of a node and its descendants, drawn like folders by the program `tree`."""
    yield f"{prefix}{branch}{node.name}  {node.tier or 'no size'}  {node.n_items:,}"
    children = node.children if node.level < max_level else ()
    inner = prefix + {"": "", "├─ ": "│  ", "└─ ": "   "}[branch]
    for index, child in enumerate(children, 1):
        yield from outline(child, max_level, inner, "└─ " if index == len(children) else "├─ ")

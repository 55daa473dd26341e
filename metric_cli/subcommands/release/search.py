"""`metric-tree search TEXT`: categories for a text."""

from __future__ import annotations

import argparse

from metric_base.errors import InputError
from metric_cli.parser import add_tree
from metric_cli.tables import print_result
from metric_tree.tree import open_tree

HELP = "Categories for a text, the most likely first; typing errors are tolerated."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    parser.add_argument("text", metavar="TEXT", help="a name or a part of a name")
    parser.add_argument("--limit", metavar="N", type=int, default=10, help="maximum number of rows (default: 10)")
    add_tree(parser)


def run(arguments: argparse.Namespace) -> None:
    """Print a row per category; the exit status is 2 if no category matches."""
    if arguments.limit < 1:
        raise InputError(f"--limit: expected a number from 1; found {arguments.limit}")
    nodes = open_tree(arguments.tree).search(arguments.text, arguments.limit)
    if not nodes:
        raise InputError(f"no node is called {arguments.text[:60]!r} or anything like it")
    rows = [(node.node_id, " > ".join(node.path[1:]), node.tier, node.n_items) for node in nodes]
    records = [dict(zip(("node", "path", "tier", "n_items"), row, strict=True)) for row in rows]
    print_result(arguments.json, records, ["node", "path", "tier", "items"], rows)

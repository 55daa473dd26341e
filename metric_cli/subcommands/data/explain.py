"""`metric-tree explain ITEM_ID RAW...`: explain the category of an item."""

from __future__ import annotations

import argparse

from metric_cli.parser import add_tree, input_path
from metric_cli.tables import print_json, print_table
from metric_tree.tree import open_tree

HELP = "Explain the category of an item: words of the source, matching rule, decisions, position in the release."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    add = parser.add_argument
    add("item", metavar="ITEM_ID", help="<source>:<source_id>, as in the items of a release")
    add("raw", metavar="RAW", nargs="*", type=input_path, help="raw items with the words of the item")
    add("--log", metavar="DIR", type=input_path, help="log of the build (DIR.build), with the items that it rejected")
    add_tree(parser)


def run(arguments: argparse.Namespace) -> None:
    """Print the words, the match and the position of the item."""
    from metric_tree.pipeline.explanation import explanation

    record = explanation(open_tree(arguments.tree), arguments.item, arguments.raw, arguments.log)
    if arguments.json:
        print_json(record)
        return
    for part in ("words", "match", "release"):
        rows = []
        for name, value in record[part].items():
            text = ", ".join(map(str, value)) if isinstance(value, list) else value
            rows.append((name, "" if text is None else str(text)))
        print_table([part, ""], rows)

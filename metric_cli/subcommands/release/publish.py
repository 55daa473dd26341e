"""`metric-tree publish DIR`: a release as a folder for a data hub or an archive."""

from __future__ import annotations

import argparse

from metric_cli.parser import new_folder
from metric_cli.tables import print_line
from metric_tree.tree import open_tree

HELP = "A release as a folder for a data hub: tables, data card, licences, checksums, Croissant, datasheet, citation."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    parser.add_argument("out", metavar="DIR", type=new_folder, help="folder to write; it must not exist")
    parser.add_argument(
        "--tree", metavar="REF", help="release: version or folder (default: the shipped one without withheld sources)"
    )


def run(arguments: argparse.Namespace) -> None:
    """Write the publication and print the number of files."""
    from metric_tree.release.publication import publish

    tree = open_tree(licence="open") if arguments.tree is None else open_tree(arguments.tree)
    files = publish(tree, arguments.out)
    print_line(arguments.json, [str(path) for path in files], f"{arguments.out}: {len(files):,} files")

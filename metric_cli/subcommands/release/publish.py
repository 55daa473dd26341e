"""`metric-tree publish DIR`: a release as a folder for a data hub or an archive."""

from __future__ import annotations

import argparse

from metric_cli.parser import new_folder
from metric_cli.tables import print_json
from metric_tree.release.registry import release_directory, releases
from metric_tree.tree import open_tree

HELP = "A release as a folder for a data hub: tables, data card, licences, checksums, Croissant, datasheet, citation."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    parser.add_argument("out", metavar="DIR", type=new_folder, help="folder to write; it must not exist")
    parser.add_argument(
        "--tree", metavar="REF", help="release: version or folder (default: the shipped one without withheld sources)"
    )


def run(arguments: argparse.Namespace) -> int:
    """Write the publication and print the number of files."""
    from metric_tree.release.publication import publish

    reference = arguments.tree
    if reference is None:  # the newest release without non-commercial sources if there is one, else the newest release
        newest = release_directory()
        reference = next((path for path in releases() if path.name == f"{newest.name}-open"), newest)
    files = publish(open_tree(reference), arguments.out)
    if arguments.json:
        print_json([str(path) for path in files])
    else:
        print(f"{arguments.out}: {len(files):,} files")  # noqa: T201 - the command's result
    return 0

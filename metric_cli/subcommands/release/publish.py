"""`metric-tree publish DIR`: a release as a folder for a data hub or an archive."""

from __future__ import annotations

import argparse
from pathlib import Path

from metric_cli.parser import new_folder
from metric_cli.tables import print_json
from metric_tree.release.registry import release_directory, releases
from metric_tree.tree import open_tree

HELP = "A release as a folder for a data hub: tables, data card, licences, checksums, Croissant, datasheet, citation."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    parser.add_argument("out", metavar="DIR", type=new_folder, help="folder to write; it must not exist")
    parser.add_argument(
        "--tree", metavar="REF", help="version or folder of a release (default: the open twin of the shipped one)"
    )


def run(arguments: argparse.Namespace) -> int:
    """Write the publication; print its files."""
    from metric_tree.release.publication import publish

    files = publish(open_tree(arguments.tree or _open_twin()), arguments.out)
    if arguments.json:
        print_json([str(path) for path in files])
    else:
        print(f"{arguments.out}: {len(files):,} files")  # noqa: T201 - the command's result
    return 0


def _open_twin() -> Path:
    """The release without non-commercial sources beside the newest one, else the newest one."""
    newest = release_directory()
    return next((path for path in releases() if path.name == f"{newest.name}-open"), newest)

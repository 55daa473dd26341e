"""`metric-tree list`: the available releases."""

from __future__ import annotations

import argparse

from metric_cli.terminal import print_json, print_table
from metric_tree.release import open_release
from metric_tree.releases import PATH_VARIABLE, releases

__all__ = ["HELP", "add_arguments", "run"]

HELP = f"The available releases, newest first; {PATH_VARIABLE} names further folders that hold some."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments: none."""


def run(arguments: argparse.Namespace) -> int:
    """Print a line per release."""
    described = [
        {
            "name": release.manifest["name"],
            "version": release.manifest["version"],
            "created": release.manifest["created"],
            "counts": release.manifest["counts"],
            "path": str(release.directory),
        }
        for release in map(open_release, releases())
    ]
    if arguments.json:
        print_json(described)
    else:
        counts = ("nodes", "leaves", "n_fit", "n_rows")
        rows = [
            (r["name"], r["version"], r["created"], *(r["counts"].get(c) for c in counts), r["path"]) for r in described
        ]
        print_table(["name", "version", "created", *counts, "path"], rows)
    return 0

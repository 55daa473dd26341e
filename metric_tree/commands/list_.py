"""`metric-tree list`: the releases at hand."""

from __future__ import annotations

import argparse

from metric_base.terminal import print_json, print_table
from metric_tree.release import opened
from metric_tree.releases import PATH_VARIABLE, releases

__all__ = ["HELP", "add_arguments", "run"]

HELP = f"The releases at hand, newest first; {PATH_VARIABLE} names further folders that hold some."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments: none."""


def run(arguments: argparse.Namespace) -> int:
    """Print a line per release."""
    found = [
        {
            "name": release.manifest["name"],
            "version": release.manifest["version"],
            "created": release.manifest["created"],
            "counts": release.manifest["counts"],
            "path": str(release.directory),
        }
        for release in map(opened, releases())
    ]
    if arguments.json:
        print_json(found)
    else:
        counts = ("nodes", "leaves", "n_fit", "n_rows")
        rows = [
            (r["name"], r["version"], r["created"], *(r["counts"].get(c) for c in counts), r["path"]) for r in found
        ]
        print_table(["name", "version", "created", *counts, "path"], rows)
    return 0

"""`metric-tree fetch VERSION`: download a release from a registry."""

from __future__ import annotations

import argparse

from metric_cli.tables import print_line
from metric_tree.release.registry import REGISTRY_VARIABLE, fetch_release
from metric_tree.release.release import open_release

HELP = f"Download a release from the registry that {REGISTRY_VARIABLE} names, verify it and store it for offline use."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    add = parser.add_argument
    add("version", metavar="VERSION", help="version of the release")
    add("--registry", metavar="ADDRESS", help=f"path or address of a registry (default: {REGISTRY_VARIABLE})")


def run(arguments: argparse.Namespace) -> None:
    """Download the release and print its folder."""
    folder = fetch_release(arguments.version, arguments.registry)
    open_release(folder)
    print_line(arguments.json, {"version": arguments.version, "path": str(folder)}, folder)

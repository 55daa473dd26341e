"""`metric-tree site OUT`: the explorer as static files."""

from __future__ import annotations

import argparse
import time

from metric_cli.parser import new_folder
from metric_cli.tables import print_line
from metric_tree.tree import open_tree

HELP = "Write all pages and JSON records of the explorer as files, for a static host or a local browser."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    parser.add_argument("out", metavar="OUT", type=new_folder, help="folder to write; it must not exist")
    parser.add_argument(
        "--tree", metavar="REF", action="append", help="release: version or folder; may be repeated (default: shipped)"
    )
    parser.add_argument("--workers", metavar="N", type=int, help="number of processes (default: one per processor)")


def run(arguments: argparse.Namespace) -> None:
    """Write the site and print its path and size."""
    from explorer.static_site import write_site

    started = time.perf_counter()
    trees = [open_tree(ref) for ref in arguments.tree or [None]]
    written = write_site(arguments.out, trees, arguments.workers)
    seconds = time.perf_counter() - started
    record = {"schema": "metric-tree/site/1", "path": str(arguments.out), "files": written.files}
    record |= {"bytes": written.bytes, "seconds": round(seconds, 1)}
    size = f"{written.files:,} files, {written.bytes / 1e6:.0f} MB, {seconds:.0f} s"
    print_line(arguments.json, record, f"{arguments.out / 'index.html'}: {size}")

"""`metric-tree import SOURCE`: an open data set into raw items, refused rows into a quarantine file."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from crawler.faults import InputFault
from crawler.imports import Import, imported, readings
from crawler.imports.files import source_folder, write_import, write_lines
from crawler.imports.overview import overview, summary, terms
from crawler.sources import Source, source, sources
from metric_tree.commands.shell import print_json, print_table

__all__ = ["HELP", "add_arguments", "run"]

HELP = "An open data set into raw items; refused rows go, with their reasons, into a quarantine file beside them."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument("source", nargs="?", metavar="SOURCE", help="id of a declared source; --list names them")
    parser.add_argument("--all", action="store_true", help="every declared source")
    parser.add_argument("--list", action="store_true", help="the declared sources: terms, where they are had")
    parser.add_argument(
        "--input",
        type=Path,
        metavar="PATH",
        help="the source's folder or its one file, or a folder that holds such folders (default: download)",
    )
    parser.add_argument(
        "--out", type=Path, metavar="PATH", help="FILE.jsonl or FILE.jsonl.gz; with --all a folder (default: none)"
    )
    parser.add_argument(
        "--ship", type=Path, metavar="DIR", help="DIR/<source>.jsonl.gz of the sources whose terms allow it"
    )
    parser.add_argument("--summary", type=Path, metavar="FILE.md", help="write the table of the sources imported")


def run(arguments: argparse.Namespace) -> int:
    """Import, write, and print the counts of each source."""
    if arguments.list:
        return _print_sources(arguments.json)
    summaries = []
    for declared in _with_progress(_chosen(arguments)):
        result = imported(declared, readings(declared, source_folder(declared, arguments.input)))
        _write(result, arguments)
        summaries.append(summary(result))
    if arguments.summary:
        write_lines(arguments.summary, overview(summaries).splitlines())
    if arguments.json:
        print_json(summaries if arguments.all else summaries[0])
    else:
        columns = ("source", "rows", "items", "sampled_out", "refused")
        rows = [(*(entry[c] for c in columns), _listed(entry["reasons"])) for entry in summaries]
        print_table([*columns, "reasons"], rows)
    return 0


def _chosen(arguments: argparse.Namespace) -> Sequence[Source]:
    if arguments.all == bool(arguments.source):
        raise InputFault(f"SOURCE: expected one source, or --all; found {arguments.source or 'neither'!r}")
    return sources() if arguments.all else [source(arguments.source)]


def _write(result: Import, arguments: argparse.Namespace) -> None:
    name = f"{result.source.id}.jsonl"
    if arguments.out:
        write_import(result, arguments.out / name if arguments.all else arguments.out)
    if arguments.ship and result.source.ship:
        write_lines(arguments.ship / f"{name}.gz", (item.line() for item in result.items))


def _with_progress(chosen: Sequence[Source]) -> Iterator[Source]:
    """The sources, with a bar on standard error where that is a terminal."""
    if not sys.stderr.isatty():
        yield from chosen
        return
    from rich.console import Console
    from rich.progress import track

    yield from track(chosen, description="importing", console=Console(stderr=True), transient=True)


def _print_sources(as_json: bool) -> int:
    found = [terms(one) for one in sources()]
    if as_json:
        print_json(found)
    else:
        columns = ("source", "kind", "licence", "ship", "downloads", "url", "reason")
        shown = [entry | {"ship": "yes" if entry["ship"] else "no"} for entry in found]
        print_table(columns, [tuple(entry[c] for c in columns) for entry in shown])
    return 0


def _listed(reasons: dict[str, int]) -> str:
    return ", ".join(f"{code} {n}" for code, n in reasons.items())

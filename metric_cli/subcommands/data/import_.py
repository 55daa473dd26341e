"""`metric-tree import SOURCE`: convert an open data set to raw items and a quarantine file."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from crawler.imports import import_source
from crawler.imports.declaration import Source, source, sources
from crawler.imports.importer import changed_files, source_folder, write_import, write_lines
from crawler.imports.overview import overview, summary, terms
from metric_base.errors import InputError
from metric_base.files import output_file
from metric_cli.parser import OutputFile, input_path, output_folder
from metric_cli.progress import track
from metric_cli.tables import print_result, warn

HELP = "Convert an open data set to raw items; rejected rows are written with reasons to a quarantine file."

SCHEMA = "metric-tree/import/1"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    add = parser.add_argument
    # fmt: off
    add("source", nargs="?", metavar="SOURCE", help="id of a declared source; see --list")
    add("--all", action="store_true", help="import every declared source")
    add("--list", action="store_true", help="list the declared sources with terms and URLs")
    add("--sources", type=input_path, metavar="DIR",
        help="folder of declarations, SOURCE.toml each (default: those of the package)")
    add("--input", type=input_path, metavar="PATH",
        help="file or folder of the source, or a folder of such folders (default: download)")
    add("--out", type=OutputFile("metric-tree/raw/"), metavar="PATH",
        help="FILE.jsonl, FILE.jsonl.gz, or a folder (default: none)")
    add("--ship", type=output_folder, metavar="DIR", help="write DIR/<source>.jsonl.gz if the terms allow it")
    add("--verbose", action="store_true", help="with --list: why a source can be downloaded or not")
    add("--summary", type=OutputFile(), metavar="FILE.md", help="write the table of the imported sources")
    # fmt: on


def run(arguments: argparse.Namespace) -> None:
    """Import and write the sources; print their counts."""
    if arguments.list:
        print_sources(sources(arguments.sources), arguments.json, arguments.verbose)
        return
    if arguments.all == bool(arguments.source):
        given = f"both, {arguments.source} and --all" if arguments.all else "neither"
        raise InputError(f"SOURCE: expected one source, or --all; found {given}")
    declared = sources(arguments.sources) if arguments.all else [source(arguments.source, arguments.sources)]
    selected = [one for one in declared if not arguments.all or has_files(one, arguments.input)]
    for option, folder in (("--out", arguments.out if arguments.all else None), ("--ship", arguments.ship)):
        if folder and folder.exists() and not folder.is_dir():
            raise InputError(f"{option}: expected a folder; found the file {folder}")
    if arguments.summary:
        output_file(arguments.summary, "--summary")
    summaries = [import_and_write(one, arguments) for one in track(selected, "importing")]
    if arguments.summary:
        absent = [one for one in declared if one not in selected]
        write_lines(arguments.summary, overview(summaries, absent).splitlines(), "--summary")
    columns = ("source", "rows", "items", "sampled_out", "refused")
    rows = []
    for entry in summaries:
        reasons = ", ".join(f"{code} {n}" for code, n in entry["reasons"].items())
        rows.append((*(entry[column] for column in columns), reasons))
    record = summaries if arguments.all else summaries[0]
    print_result(arguments.json, record, [*columns, "reasons"], rows)


def has_files(declared: Source, folder: Path | None) -> bool:
    """Return False, with a warning, for a source that `--input` lacks and that cannot be downloaded."""
    if declared.files or declared.excluded or folder is None or (folder / declared.id).exists():
        return True
    warn(f"{declared.id}: no folder of this name in {folder}; left out ({declared.fetch})")
    return False


def import_and_write(declared: Source, arguments: argparse.Namespace) -> dict[str, Any]:
    """Import a source, write its items, and return its counts."""
    folder = source_folder(declared, arguments.input)
    result = import_source(declared, folder)
    for file in changed_files(declared, folder) if arguments.input else ():
        expected = f"expected that declared for {declared.id}"
        warn(f"{file}: sha256: {expected}; found another, so nothing is checked of it")
    name = f"{declared.id}.jsonl"
    if arguments.out:
        is_folder = arguments.all or arguments.out.is_dir()
        write_import(result, arguments.out / name if is_folder else arguments.out, "--out")
    if arguments.ship and declared.ship:
        write_lines(arguments.ship / f"{name}.gz", (item.line() for item in result.items), "--ship")
    return {"schema": SCHEMA, **summary(result)}


def print_sources(declared: Sequence[Source], as_json: bool, verbose: bool) -> None:
    """Print the terms of the sources; without `verbose`, reasons only for those that cannot be downloaded."""
    entries = [terms(one) for one in declared]
    rows = []
    for entry in entries:
        reason = entry["reason"] if verbose or entry["downloads"] != "yes" else ""
        first = (entry["source"], entry["kind"], entry["licence"], "yes" if entry["ship"] else "no")
        rows.append((*first, entry["downloads"], entry["url"], reason))
    print_result(as_json, entries, ("source", "kind", "licence", "ship", "downloads", "url", "reason"), rows)

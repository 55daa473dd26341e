"""`metric-tree import SOURCE`: an open data set into raw items, refused rows into a quarantine file."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from crawler.imports import Import, import_source
from crawler.imports.declaration import Source, source, sources
from crawler.imports.importer import changed_files, source_folder, write_import, write_lines
from crawler.imports.overview import overview, summary, terms
from metric_base.errors import InputError
from metric_base.files import output_file
from metric_cli.parser import OutputFile, input_path, output_folder
from metric_cli.progress import with_bar
from metric_cli.tables import print_json, print_table, warn

HELP = "An open data set to raw items; refused rows are written, with reasons, to a quarantine file beside them."

SCHEMA = "metric-tree/import/1"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    add = parser.add_argument
    add("source", nargs="?", metavar="SOURCE", help="id of a declared source; --list names them")
    add("--all", action="store_true", help="every declared source")
    add("--list", action="store_true", help="list the declared sources, with terms and addresses")
    add(
        "--sources",
        type=input_path,
        metavar="DIR",
        help="declarations of your own, SOURCE.toml each, in place of the package's",
    )
    add(
        "--input",
        type=input_path,
        metavar="PATH",
        help="the source's folder or its one file, or a folder that holds such folders (default: download)",
    )
    add(
        "--out",
        type=OutputFile("metric-tree/raw/"),
        metavar="PATH",
        help="FILE.jsonl, FILE.jsonl.gz, or a folder (default: none)",
    )
    add("--ship", type=output_folder, metavar="DIR", help="DIR/<source>.jsonl.gz of the sources whose terms allow it")
    add("--verbose", action="store_true", help="with --list: why a source can be downloaded or not")
    add("--summary", type=OutputFile(), metavar="FILE.md", help="write the table of the sources imported")


def run(arguments: argparse.Namespace) -> int:
    """Import, write, and print the counts of each source."""
    if arguments.list:
        return _print_sources(_declared_sources(arguments), arguments.json, arguments.verbose)
    chosen = _chosen_sources(arguments)
    _see_places(arguments)
    summaries = []
    for declared in with_bar(chosen, "importing"):
        folder = source_folder(declared, arguments.input)
        result = import_source(declared, folder)
        if arguments.input:
            _warn_of_changes(declared, folder)
        _write(result, arguments)
        summaries.append({"schema": SCHEMA, **summary(result)})
    if arguments.summary:
        write_lines(arguments.summary, overview(summaries, _absent(arguments, chosen)).splitlines(), "--summary")
    if arguments.json:
        print_json(summaries if arguments.all else summaries[0])
    else:
        columns = ("source", "rows", "items", "sampled_out", "refused")
        rows = [(*(entry[c] for c in columns), _reason_counts(entry["reasons"])) for entry in summaries]
        print_table([*columns, "reasons"], rows)
    return 0


def _chosen_sources(arguments: argparse.Namespace) -> Sequence[Source]:
    if arguments.all == bool(arguments.source):
        given = f"both, {arguments.source} and --all" if arguments.all else "neither"
        raise InputError(f"SOURCE: expected one source, or --all; found {given}")
    if not arguments.all:
        return [source(arguments.source, arguments.sources)]
    return [one for one in _declared_sources(arguments) if _is_at_hand(one, arguments.input)]


def _absent(arguments: argparse.Namespace, chosen: Sequence[Source]) -> list[Source]:
    """Sources that --all asked for, and whose files are not there."""
    known = {one.id for one in chosen}
    return [one for one in _declared_sources(arguments) if one.id not in known] if arguments.all else []


def _is_at_hand(declared: Source, folder: Path | None) -> bool:
    """False, with a warning, of a set without known files (it can only be fetched by hand) that `--input` lacks."""
    if declared.files or declared.excluded or folder is None or (folder / declared.id).exists():
        return True
    warn(f"{declared.id}: no folder of this name in {folder}; left out ({declared.fetch})")
    return False


def _declared_sources(arguments: argparse.Namespace) -> Sequence[Source]:
    """All declared sources: the package's, or those of the folder that was given."""
    declared = sources(arguments.sources)
    if not declared:
        raise InputError(
            f"--sources: expected a folder of declarations, SOURCE.toml; found none in {arguments.sources}"
        )
    return declared


def _see_places(arguments: argparse.Namespace) -> None:
    """The places to write to, asked before any source is read."""
    for option, folder in (("--out", arguments.out if arguments.all else None), ("--ship", arguments.ship)):
        if folder and folder.exists() and not folder.is_dir():
            raise InputError(f"{option}: expected a folder; found the file {folder}")
    if arguments.summary:
        output_file(arguments.summary, "--summary")


def _warn_of_changes(declared: Source, folder: Path) -> None:
    for file in changed_files(declared, folder):
        warn(f"{file}: sha256: expected that declared for {declared.id}; found another, so nothing is checked of it")


def _write(result: Import, arguments: argparse.Namespace) -> None:
    name = f"{result.source.id}.jsonl"
    if arguments.out:
        inside = arguments.all or arguments.out.is_dir()
        write_import(result, arguments.out / name if inside else arguments.out, "--out")
    if arguments.ship and result.source.ship:
        write_lines(arguments.ship / f"{name}.gz", (item.line() for item in result.items), "--ship")


def _print_sources(declared: Sequence[Source], as_json: bool, verbose: bool) -> int:
    entries = [terms(one) for one in declared]
    if as_json:
        print_json(entries)
    else:
        columns = ("source", "kind", "licence", "ship", "downloads", "url", "reason")
        shown = [
            entry
            | {
                "ship": "yes" if entry["ship"] else "no",
                "reason": entry["reason"] if verbose or entry["downloads"] != "yes" else "",
            }
            for entry in entries
        ]
        print_table(columns, [tuple(entry[c] for c in columns) for entry in shown])
    return 0


def _reason_counts(reasons: dict[str, int]) -> str:
    return ", ".join(f"{code} {n}" for code, n in reasons.items())

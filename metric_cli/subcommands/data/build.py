"""`metric-tree build RAW... --out DIR`: raw items to a release."""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from crawler.imports.declaration import declared_sources
from crawler.items import STATED_KINDS
from metric_base.errors import InputError
from metric_base.executors import executor_of
from metric_cli.parser import input_path, new_folder, output_folder
from metric_cli.progress import progress_bars
from metric_cli.tables import print_json, print_table, warn
from metric_tree.pipeline.build import Build, BuildOptions, build_release, shipped_curated
from metric_tree.pipeline.ingest import raw_files
from metric_tree.release.release import open_release

HELP = "Raw items to a release: matched, cleaned, fitted, published whole or not at all."
#: The variable by which reproducible builds tell a date (reproducible-builds.org).
DATE_VARIABLE = "SOURCE_DATE_EPOCH"
#: A build in seconds of one processor, from that of release 2.0.0 (83 MB of raw items, 160 s): what it takes at least,
#: and what each megabyte adds; held-out scores take longer. Packed files are some eight times as large unpacked.
SECONDS_AT_LEAST, SECONDS_PER_MB, PACKED = 25, 1.6, 8


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    add = parser.add_argument
    add("raw", metavar="RAW", nargs="+", type=input_path, help="*.jsonl, *.jsonl.gz, or folders of them")
    add("--out", metavar="DIR", type=new_folder, required=True, help="the release; it must not exist yet")
    add("--version", default="0.1.0", help="semantic version of the release (default: %(default)s)")
    add("--name", default="metric-tree", help="name of the release (default: %(default)s)")
    add("--created", metavar="DATE", help=f"ISO date (default: ${DATE_VARIABLE}, else today)")
    add("--log", metavar="DIR", type=output_folder, help="quarantine and report (default: DIR.build)")
    add("--fold-out", metavar="I/N", type=_fold, help="leave out fold I (from 0) of N, by item id")
    add("--without-noncommercial", action="store_true", help="leave out non-commercial sources")
    add(
        "--include-withheld",
        dest="private",
        metavar="SOURCE",
        action="append",
        default=[],
        help="keep this source's rows and pictures, though"
        " no open licence lets you give them on: the release is for your own use (may be repeated)",
    )
    add("--own-use", dest="private", action="append", help=argparse.SUPPRESS)  # its old name
    add(
        "--sources",
        metavar="DIR",
        type=input_path,
        help="declarations of your own, SOURCE.toml each, beside the package's, for the terms and kinds of RAW",
    )
    add("--without-curated", action="store_true", help="leave out the project's norms and judged ranges")
    add("--carry", metavar="DIR", type=input_path, help="take nodes, priors and the choice of rows from this release")
    add(
        "--without-pictures",
        action="store_true",
        help="leave out the pictures beside RAW: a twin of a release that has them",
    )
    add("--no-heldout", action="store_true", help="skip the held-out scores of the priors (faster)")
    add("--workers", type=int, default=os.cpu_count() or 1, help="processes (default: %(default)s)")
    add("--scheduler", metavar="ADDRESS", help="a Dask scheduler, in place of processes")


def run(arguments: argparse.Namespace) -> int:
    """Build and print what came of it."""
    options = BuildOptions(
        version=_semantic(arguments.version),
        created=_creation_date(arguments.created),
        name=arguments.name,
        fold_out=arguments.fold_out,
        noncommercial=not arguments.without_noncommercial,
        private=tuple(arguments.private),
        heldout=not arguments.no_heldout,
        pictures=not arguments.without_pictures,
    )
    declared = declared_sources(arguments.sources)
    _print_estimate(arguments.raw, arguments.workers)
    with executor_of(arguments.workers, arguments.scheduler) as executor, progress_bars() as shown:
        build = build_release(
            arguments.raw,
            arguments.out,
            options,
            log=arguments.log,
            carried=open_release(arguments.carry) if arguments.carry else None,
            curated=() if arguments.without_curated else shipped_curated(),
            declared=declared,
            executor=executor,
            progress=shown,
        )
    _warn(build)
    _print(build, arguments.json)
    return 0


def _print_estimate(raw: Sequence[Path], workers: int) -> None:
    """Say on a terminal how long the build will take; the bars then show how much of each step is left."""
    if sys.stderr.isatty():
        sizes = ((file.stat().st_size, PACKED if file.suffix == ".gz" else 1) for file in raw_files(raw))
        megabytes = sum(size * packed for size, packed in sizes) / 1e6
        minutes = (SECONDS_AT_LEAST + SECONDS_PER_MB * megabytes / max(1, min(workers, os.cpu_count() or 1))) / 60
        sys.stderr.write(f"about {minutes:.1f} min: {megabytes:.0f} MB of raw items, {workers} processes\n")


def _warn(build: Build) -> None:
    """Say what the counts do not: that nothing was taken, or that the rows of undeclared sources were left out."""
    manifest = build.release.manifest
    if "carried" in manifest:  # the sources are those of the release that is carried over
        return
    used = [record for record in manifest["sources"] if record["kind"] not in STATED_KINDS]
    if not any(record["n_fit"] for record in used):
        warn(f"no raw item was taken: the release holds norms and ranges alone; see {build.log / 'quarantine.jsonl'}")
    # a declared source has its address in the manifest; that its rows are withheld is its declaration's own choice
    unknown = (record for record in used if record["withheld"] and not record["url"])
    withheld = [record["id"] for record in unknown if not record["n_rows"]]
    if withheld:
        keep = " ".join(f"--include-withheld {name}" for name in withheld)
        warn(f"withheld, for want of a declared open licence: all rows of {', '.join(withheld)}; {keep} keeps them")


def _print(build: Build, as_json: bool) -> None:
    manifest = build.release.manifest
    if as_json:
        print_json({"directory": str(build.release.directory), **manifest})
        return
    counts = manifest["counts"]
    rows = [(name, value) for name, value in counts.items() if not isinstance(value, dict)]
    print_table(["count", "value"], rows, title=f"{build.release.directory}: {manifest['name']} {manifest['version']}")
    print_table(["raw item", "rows"], Counter(counts["raw"]).most_common())


def _fold(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d+)/(\d+)", text)
    if match is None or not int(match[1]) < int(match[2]):
        raise argparse.ArgumentTypeError(f"expected I/N with 0 <= I < N; found {text!r}")
    return int(match[1]), int(match[2])


def _semantic(text: str) -> str:
    if not re.fullmatch(r"\d+\.\d+\.\d+([-+][0-9A-Za-z.-]+)?", text):
        raise InputError(f"--version: expected a semantic version such as 1.0.0; found {text!r}")
    return text


def _creation_date(text: str | None) -> str:
    if text is None:
        epoch = os.environ.get(DATE_VARIABLE)
        moment = datetime.fromtimestamp(int(epoch), UTC) if epoch else datetime.now(UTC)
        return moment.date().isoformat()
    try:
        return (
            datetime.fromisoformat(text).isoformat() if "T" in text else datetime.fromisoformat(text).date().isoformat()
        )
    except ValueError:
        raise InputError(f"--created: expected an ISO date; found {text!r}") from None

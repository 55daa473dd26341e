"""`metric-tree build RAW... --out DIR`: build a release from raw items."""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections import Counter
from datetime import UTC, datetime
from typing import Any

from crawler.imports.declaration import declared_sources
from crawler.items import STATED_KINDS
from metric_base.errors import InputError
from metric_base.executors import executor_of
from metric_base.remote import file_size
from metric_cli.parser import input_path, new_folder, output_folder, parse_part, same_named, streamed_path
from metric_cli.progress import progress_bars
from metric_cli.tables import print_json, print_result, print_table, warn
from metric_tree.pipeline.build import Build, BuildOptions, build_release, ingest_part, shipped_curated
from metric_tree.pipeline.ingest import raw_files
from metric_tree.release.release import open_release

HELP = "Build a release from raw items: matched, cleaned and fitted. It is published completely or not at all."
#: Environment variable with the date of a reproducible build (reproducible-builds.org).
DATE_VARIABLE = "SOURCE_DATE_EPOCH"
#: Minimum duration of a build in seconds of one processor (release 2.0.0 took 160 s for 83 MB of raw items).
MIN_BUILD_S = 25
#: Additional duration in seconds per megabyte of raw items; held-out scores take longer.
SECONDS_PER_MB = 1.6
#: Size of raw items relative to that of their gzip file.
GZIP_RATIO = 8


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    # fmt: off
    add = parser.add_argument
    add("raw", metavar="RAW", nargs="+", type=streamed_path,
        help="*.jsonl, *.jsonl.gz, or folders of them; also s3://, gs:// and az:// URLs")
    add("--out", metavar="DIR", type=new_folder, required=True, help="folder of the release; it must not exist")
    add("--version", default="0.1.0", help="semantic version of the release (default: %(default)s)")
    add("--name", default="metric-tree", help="name of the release (default: %(default)s)")
    add("--created", metavar="DATE", help=f"ISO date (default: ${DATE_VARIABLE}, else today)")
    add("--log", metavar="DIR", type=output_folder, help="folder of quarantine and report (default: DIR.build)")
    add = parser.add_argument_group("content").add_argument
    add("--sources", metavar="DIR", type=input_path,
        help="folder of further declarations, SOURCE.toml each, with the terms and kinds of RAW")
    add("--include-withheld", dest="private", metavar="SOURCE", action="append", default=[],
        help="include the rows and images of this source although no open licence allows redistribution: the release"
        " is for private use (may be repeated)")
    add("--without-noncommercial", dest="noncommercial", action="store_false", help="omit non-commercial sources")
    add("--without-curated", action="store_true", help="omit the norms and judged ranges of the project")
    add("--without-pictures", dest="pictures", action="store_false", help="omit the images next to RAW")
    add("--carry", metavar="DIR", type=input_path, help="take nodes, priors and selected rows from this release")
    add("--fold-out", metavar="I/N", type=parse_fold, help="omit fold I (from 0) of N, by item id")
    add = parser.add_argument_group("computation").add_argument
    add("--workers", type=int, default=os.cpu_count() or 1, help="number of processes (default: %(default)s)")
    add("--scheduler", metavar="ADDRESS", help="a Dask scheduler instead of processes; its workers share the folders")
    add("--part", metavar="I/N", help="only ingest part I of N, for Slurm arrays; then build without --part")
    add("--no-heldout", dest="heldout", action="store_false", help="omit the held-out scores of the priors (faster)")
    # fmt: on


def parse_fold(text: str) -> tuple[int, int]:
    """Parse `I/N` with 0 <= I < N."""
    match = re.fullmatch(r"(\d+)/(\d+)", text)
    if match is None or not int(match[1]) < int(match[2]):
        raise argparse.ArgumentTypeError(f"expected I/N with 0 <= I < N; found {text!r}")
    return int(match[1]), int(match[2])


def run(arguments: argparse.Namespace) -> None:
    """Build the release and print its counts."""
    if not re.fullmatch(r"\d+\.\d+\.\d+([-+][0-9A-Za-z.-]+)?", arguments.version):
        raise InputError(f"--version: expected a semantic version such as 1.0.0; found {arguments.version!r}")
    computed = {"created": creation_date(arguments.created), "private": tuple(arguments.private)}
    options = BuildOptions(**same_named(arguments, BuildOptions) | computed)
    declared = declared_sources(arguments.sources)
    if sys.stderr.isatty():
        sizes = ((file_size(file), GZIP_RATIO if file.suffix == ".gz" else 1) for file in raw_files(arguments.raw))
        megabytes = sum(size * ratio for size, ratio in sizes) / 1e6
        processors = max(1, min(arguments.workers, os.cpu_count() or 1))
        minutes = (MIN_BUILD_S + SECONDS_PER_MB * megabytes / processors) / 60
        sys.stderr.write(f"about {minutes:.1f} min: {megabytes:.0f} MB of raw items, {arguments.workers} processes\n")
    settings: dict[str, Any] = {
        "log": arguments.log,
        "carried": open_release(arguments.carry) if arguments.carry else None,
        "curated": () if arguments.without_curated else shipped_curated(),
        "declared": declared,
    }
    with executor_of(arguments.workers, arguments.scheduler) as executor, progress_bars() as progress:
        settings |= {"executor": executor, "progress": progress}
        if arguments.part:
            raw_counts = ingest_part(arguments.raw, arguments.out, options, parse_part(arguments.part), **settings)
        else:
            build = build_release(arguments.raw, arguments.out, options, **settings)
    if arguments.part:
        record, title = {"part": arguments.part, "raw": raw_counts}, f"part {arguments.part}"
        print_result(arguments.json, record, ["raw item", "rows"], raw_counts.most_common(), title)
        return
    warn_of_omissions(build)
    manifest = build.release.manifest
    if arguments.json:
        print_json({"directory": str(build.release.directory), **manifest})
        return
    counts = [(name, value) for name, value in manifest["counts"].items() if not isinstance(value, dict)]
    title = f"{build.release.directory}: {manifest['name']} {manifest['version']}"
    print_table(["count", "value"], counts, title=title)
    print_table(["raw item", "rows"], Counter(manifest["counts"]["raw"]).most_common())


def warn_of_omissions(build: Build) -> None:
    """Warn if the release uses no raw item, or omits the rows of undeclared sources."""
    manifest = build.release.manifest
    if "carried" in manifest:  # the manifest has the sources of the earlier release
        return
    used = [record for record in manifest["sources"] if record["kind"] not in STATED_KINDS]
    if not any(record["n_fit"] for record in used):
        warn(f"no raw item was taken: the release holds norms and ranges alone; see {build.log / 'quarantine.jsonl'}")
    # a declared source has its URL in the manifest; its declaration decides whether its rows are withheld
    unknown = (record for record in used if record["withheld"] and not record["url"])
    withheld = [record["id"] for record in unknown if not record["n_rows"]]
    if withheld:
        keep = " ".join(f"--include-withheld {name}" for name in withheld)
        warn(f"withheld, for want of a declared open licence: all rows of {', '.join(withheld)}; {keep} keeps them")


def creation_date(text: str | None) -> str:
    """Return the ISO date or time of `--created` or of the environment variable, otherwise the current date."""
    if text is None:
        epoch = os.environ.get(DATE_VARIABLE)
        moment = datetime.fromtimestamp(int(epoch), UTC) if epoch else datetime.now(UTC)
        return moment.date().isoformat()
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise InputError(f"--created: expected an ISO date; found {text!r}") from None
    return moment.isoformat() if "T" in text else moment.date().isoformat()

"""`metric-tree extract FILE`: extract raw items from a saved web page or a web archive."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter

from metric_base.errors import InputError
from metric_base.escaping import visible_json
from metric_cli.parser import OutputFile, input_path
from metric_cli.progress import progress_bars
from metric_cli.tables import print_result, print_table

HELP = "Extract raw items from a saved web page or a web archive, with the spider of its site or the generic one."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    # fmt: off
    parser.add_argument("file", type=input_path, metavar="FILE",
                        help="HTML, optionally compressed by gzip; WARC (.warc[.gz]); N-Quads of products (.nq[.gz])")
    parser.add_argument("--site", type=input_path, metavar="FILE.toml", help="declaration of a site")
    parser.add_argument("--url", help="URL of the page")
    parser.add_argument("--out", metavar="FILE.jsonl", type=OutputFile(),
                        help="with an archive: the raw items of pages that state a size")
    # fmt: on


def run(arguments: argparse.Namespace) -> None:
    """Print the raw item of a page as a table, or with --json as one line; of an archive, the numbers of pages."""
    from crawler.page.archives import ARCHIVE_SUFFIXES
    from crawler.sites.registry import use_site

    is_archive = arguments.file.name.removesuffix(".gz").endswith(ARCHIVE_SUFFIXES)
    if is_archive != (arguments.url is None) or is_archive != (arguments.out is not None):
        expected = "--out, and no --url, with an archive" if is_archive else "--url, and no --out, with a page"
        raise InputError(f"{arguments.file}: expected {expected}")
    if arguments.site:
        use_site(arguments.site)
    extract = _extract_archive if is_archive else _extract_page
    extract(arguments)


def _extract_page(arguments: argparse.Namespace) -> None:
    """Print the raw item of a page."""
    from crawler.page.page import saved_page
    from crawler.page.time_limit import SlowPage, processor_budget
    from crawler.page.urls import web_address
    from crawler.sites.registry import item_of

    url = web_address(arguments.url, "--url")
    try:
        with processor_budget():
            line = item_of(saved_page(arguments.file, url)).line()
    except SlowPage as error:
        raise InputError(f"{arguments.file}: {error}") from None
    if arguments.json:
        sys.stdout.write(f"{visible_json(line)}\n")
    else:
        record = json.loads(line)
        rows = []
        for name, value in record.items():
            text = str(value)
            if isinstance(value, list):
                separator = " > " if all(isinstance(part, str) for part in value) else ", "
                text = separator.join(map(str, value))
            elif isinstance(value, dict):
                text = ", ".join(f"{axis} {length} mm" for axis, length in value.items() if length is not None)
            if value:
                rows.append((name, text))
        print_table(["field", "value"], rows)


def _extract_archive(arguments: argparse.Namespace) -> None:
    """Write the raw items of the pages of an archive that state a size, and print the numbers of pages."""
    from crawler.page.archives import archived_pages
    from crawler.page.time_limit import SlowPage, processor_budget
    from crawler.sites.registry import item_of
    from metric_base.files import whole_file

    counts: Counter[str] = Counter()
    start = time.process_time()
    with whole_file(arguments.out, "--out") as part, part.open("w", encoding="utf-8") as file, progress_bars() as bars:
        for page in archived_pages(arguments.file):
            counts["pages"] += 1
            bars("pages", counts["pages"], None)
            if page is None:
                continue
            counts["read"] += 1
            try:
                with processor_budget():
                    item = item_of(page)
            except SlowPage:
                counts["too_slow"] += 1
                continue
            if item.extents_mm is not None:
                counts["items"] += 1
                file.write(f"{item.line()}\n")
    n_pages = max(counts["pages"], 1)
    record = {
        **{name: counts[name] for name in ("pages", "read", "too_slow", "items")},
        "kept": round(counts["items"] / n_pages, 4),
        "ms_per_page": round((time.process_time() - start) * 1000 / n_pages, 3),
    }
    print_result(arguments.json, record, ["pages", "value"], record.items())

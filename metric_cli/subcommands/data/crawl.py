"""`metric-tree crawl SPIDER`: run a spider into a raw-item data set."""

from __future__ import annotations

import argparse
import math
import os
import re
import sys
import time
from collections.abc import Callable, Mapping
from typing import Any

from metric_base.errors import InputError
from metric_cli.parser import input_path, output_folder, same_named
from metric_cli.tables import print_json, print_table

HELP = "Crawl a site into a data set of raw items; a crawl is polite, can be resumed and can run unattended."

#: Environment variable with the contact of the operator of a crawl, for the owners of sites.
CONTACT_ENV = "METRIC_TREE_CONTACT"

#: An e-mail address or a URL, with an optional name.
_CONTACT = re.compile(r".*(?:[^@\s]+@[^@\s]+|https?://[^\s/]+).*")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    # fmt: off
    add = parser.add_argument
    add("spider", metavar="SPIDER", help="amazon, ikea, ..., wikidata, or generic for any site")
    add("--out", type=output_folder, required=True, metavar="DIR", help="folder of the data set")
    add("--contact", default=os.environ.get(CONTACT_ENV),
        help=f"e-mail address or web page of the operator (default: {CONTACT_ENV})")
    add("--limit", type=int, metavar="N", help="stop after N new items (default: no limit)")
    add("--resume", action="store_true", help="continue the crawl in DIR")
    add("--pictures", action="store_true", help="download images if the terms of the site allow it")
    add = parser.add_argument_group("first pages").add_argument
    add("--start-url", action="append", default=[], metavar="URL", help="first page; may be repeated")
    add("--query", default="", help="start with a search of the site")
    add("--category", default="", help="start with a category of the site")
    add("--site", type=input_path, metavar="FILE.toml", help="declaration of another site, whose name is SPIDER")
    add = parser.add_argument_group("requests").add_argument
    add("--delay", type=float, metavar="SECONDS",
        help="minimum time between two requests (default: specified by the site, or 1)")
    add("--cache", type=output_folder, metavar="DIR", help="HTTP cache for conditional requests")
    add("--redis", default="", metavar="URL", help="share the frontier with other workers")
    add("--worker", default="", metavar="NAME", help="folder of this worker in DIR, with --redis")
    add("--private", action="store_true", help="allow addresses of this machine and of its network")
    # fmt: on


def run(arguments: argparse.Namespace) -> None:
    """Crawl and print the summary."""
    from crawler.fetch.crawl import Crawl, run_crawl

    check_options(arguments)
    crawl = Crawl(**same_named(arguments, Crawl) | {"start": arguments.start_url, "limit": arguments.limit or 0})
    with CrawlProgress() as show:
        summary = run_crawl(crawl, show)
    record = summary.record()
    if arguments.json:
        print_json(record)
    else:
        sites = record.pop("sites")
        print_table(["crawl", ""], [(name, _shown(value)) for name, value in record.items() if name != "schema"])
        print_table(["site", ""], [(host, _shown(counts)) for host, counts in sites.items()])
    if summary.error:
        raise InputError(f"{crawl.folder}: {summary.error}")


def check_options(arguments: argparse.Namespace) -> None:
    """Raise InputError for an invalid option before the crawl starts."""
    if arguments.out.exists() and not arguments.out.is_dir():
        raise InputError(f"--out: expected a folder; found the file {arguments.out}")
    contact, limit, delay = arguments.contact, arguments.limit, arguments.delay
    if not contact or not _CONTACT.fullmatch(contact) or not contact.isprintable():
        given = repr(contact) if contact else "none"
        raise InputError(f"--contact: expected a mail address or a page's URL, or {CONTACT_ENV}; found {given}")
    if arguments.worker and not re.fullmatch(r"[\w.-]*\w[\w.-]*", arguments.worker):
        raise InputError(f"--worker: expected a name of letters, digits, - and _; found {arguments.worker!r}")
    if limit is not None and limit < 1:
        raise InputError(f"--limit: expected 1 or more items; found {limit}")
    if delay is not None and not (math.isfinite(delay) and delay >= 0):
        raise InputError(f"--delay: expected 0 or more seconds; found {delay}")


def _shown(value: object) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {count}" for name, count in value.items()) or "none"
    return str(value)


class CrawlProgress:
    """Context manager with a callback that shows pages, items, drops and waiting requests on a terminal, else None."""

    def __enter__(self) -> Callable[[Mapping[str, Any]], None] | None:
        self._started = time.monotonic()
        return self.show if sys.stderr.isatty() else None

    def __exit__(self, *_: object) -> None:
        if sys.stderr.isatty():
            sys.stderr.write("\r\x1b[K")

    def show(self, stats: Mapping[str, Any]) -> None:
        """Replace the line on the terminal."""
        seconds = max(time.monotonic() - self._started, 1e-3)
        rate = stats.get("metric_tree/pages", 0) / seconds
        dropped = sum(value for name, value in stats.items() if name.startswith("metric_tree/dropped/"))
        line = (
            f"{stats.get('metric_tree/pages', 0)} pages ({rate:.1f}/s),"
            f" {stats.get('metric_tree/items', 0)} items, {dropped} dropped,"
            f" {stats.get('waiting', 0)} waiting, {stats.get('metric_tree/bans', 0)} bans"
        )
        sys.stderr.write(f"\r\x1b[K{line}")
        sys.stderr.flush()

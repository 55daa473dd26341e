"""`metric-tree extract FILE --url URL`: one saved web page to a raw item."""

from __future__ import annotations

import argparse
import json
import sys

from metric_base.escaping import visible_json
from metric_cli.parser import input_path
from metric_cli.tables import print_table

HELP = "One saved web page to a raw item, by the spider that owns the URL's site, else the generic one."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    parser.add_argument("file", type=input_path, metavar="FILE", help="HTML, gzipped or not")
    parser.add_argument("--site", type=input_path, metavar="FILE.toml", help="a site of your own, whose page this is")
    parser.add_argument("--url", required=True, help="the address the page was saved from")


def run(arguments: argparse.Namespace) -> int:
    """Print the raw item: one line with --json, a table without."""
    from crawler.page.page import saved_page
    from crawler.page.time_limit import SlowPage, processor_budget
    from crawler.page.urls import web_address
    from crawler.sites.registry import item_of, use_site
    from metric_base.errors import InputError

    url = web_address(arguments.url, "--url")
    if arguments.site:
        use_site(arguments.site)
    try:
        with processor_budget():
            line = item_of(saved_page(arguments.file, url)).line()
    except SlowPage as error:
        raise InputError(f"{arguments.file}: {error}") from None
    if arguments.json:
        sys.stdout.write(f"{visible_json(line)}\n")
    else:
        record = json.loads(line)
        print_table(["field", "value"], [(name, _shown(value)) for name, value in record.items() if value])
    return 0


def _shown(value: object) -> str:
    if isinstance(value, list):
        return (
            " > ".join(map(str, value)) if all(isinstance(part, str) for part in value) else ", ".join(map(str, value))
        )
    if isinstance(value, dict):
        return ", ".join(f"{axis} {length} mm" for axis, length in value.items() if length is not None)
    return str(value)

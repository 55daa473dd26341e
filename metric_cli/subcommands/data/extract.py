"""`metric-tree extract FILE --url URL`: extract a raw item from a saved web page."""

from __future__ import annotations

import argparse
import json
import sys

from metric_base.escaping import visible_json
from metric_cli.parser import input_path
from metric_cli.tables import print_table

HELP = "Extract a raw item from a saved web page, with the spider of its site or the generic one."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    parser.add_argument("file", type=input_path, metavar="FILE", help="HTML, optionally compressed by gzip")
    parser.add_argument("--site", type=input_path, metavar="FILE.toml", help="declaration of the site of the page")
    parser.add_argument("--url", required=True, help="URL of the page")


def run(arguments: argparse.Namespace) -> int:
    """Print the raw item as a table, or with --json as one line."""
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
    return 0

"""`metric-tree report DIR`: a readable page about a release."""

from __future__ import annotations

import argparse
from pathlib import Path

from metric_base.files import output_file, write_whole
from metric_cli.parser import OutputFile
from metric_cli.tables import print_json
from metric_tree.tree import open_tree

HELP = "A readable page about a release: counts, coverage of label lists, size distributions, findings, changes."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    parser.add_argument("release", metavar="DIR", nargs="?", help="folder or version of a release (default: shipped)")
    parser.add_argument("--against", metavar="DIR", help="an earlier release, for a section about the changes")
    parser.add_argument(
        "--out", metavar="FILE", type=OutputFile(), default=Path("report.html"), help="page (report.html)"
    )


def run(arguments: argparse.Namespace) -> None:
    """Write the page; print its path, or with `--json` the counts of the page."""
    from explorer.pages.report_page import page
    from metric_tree.reports.summary import coverage, level_counts
    from taxonomy.label_lists import vocabularies

    output_file(arguments.out)
    tree = open_tree(arguments.release)
    against = open_tree(arguments.against) if arguments.against else None
    text = page(tree, against)
    write_whole(arguments.out, text, "--out")
    if arguments.json:
        columns = ("level", "nodes", "with_1", "with_10", "with_30")
        levels = [dict(zip(columns, row, strict=True)) for row in level_counts(tree)]
        lists = [
            {"list": c.name, "labels": c.labels, "enough": c.enough, "real": c.real, "any": c.any}
            for c in (coverage(tree, name) for name in vocabularies())
        ]
        record = {"schema": "metric-tree/report/1", "page": str(arguments.out)}
        print_json(record | {"levels": levels, "vocabularies": lists})
    else:
        print(arguments.out)  # noqa: T201 - the command's result

"""`metric-tree select`: categories for instance segmentation and scale estimation."""

from __future__ import annotations

import argparse
from typing import Any

from metric_base.errors import InputError
from metric_base.files import output_file, write_whole
from metric_base.records import csv_text
from metric_cli.parser import OutputFile, add_tree, same_named
from metric_cli.tables import print_json, print_table
from metric_tree.training.selection import TRAINING_LISTS, Rules, candidates, choose, paper_selection, selection_record
from metric_tree.tree import open_tree

HELP = "Select categories for instance segmentation and scale estimation, with the figures of each rule."

_COLUMNS = ("node", "name", "divergence", "samples", "sources", "lists", "sd", "narrowing", "paper")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    add = parser.add_argument
    rules = Rules()
    # fmt: off
    add("--count", type=int, default=rules.count,
        help="number of categories (default: %(default)s, as in the paper)")
    add("--most-divergence", type=float, default=rules.most_divergence,
        help="maximum standard deviation of log size (default: %(default)s)")
    add("--least-samples", type=int, default=rules.least_samples,
        help="minimum number of items of the fit (default: %(default)s)")
    add("--least-sources", type=int, default=rules.least_sources,
        help="minimum number of their sources (default: %(default)s)")
    add("--least-lists", type=int, default=rules.least_lists,
        help=f"minimum number of the training sets {', '.join(TRAINING_LISTS)} (default: %(default)s)")
    add("--out", type=OutputFile(), metavar="FILE.csv", help="write the selected categories, for `export`")
    add("--figure", type=OutputFile(), metavar="FILE", help="draw the figure of each rule (.png, .svg, .pdf)")
    # fmt: on
    add_tree(parser)


def run(arguments: argparse.Namespace) -> None:
    """Print the selection and, for comparison, that of the paper with the reasons of the differences."""
    rules = Rules(**same_named(arguments, Rules))
    if not rules.most_divergence > 0:
        raise InputError(f"--most-divergence: expected a number above 0; found {rules.most_divergence}")
    if rules.count < 1:
        raise InputError(f"--count: expected 1 or more; found {rules.count}")
    if arguments.out:
        output_file(arguments.out)
    tree = open_tree(arguments.tree)
    ranked = candidates(tree)
    taken = choose(ranked, rules)
    record = selection_record(tree, ranked, taken, rules)
    if arguments.figure:
        from metric_tree.training.selection_figure import write_figure

        write_figure(arguments.figure, ranked, taken, {node_id for _, node_id in paper_selection()}, rules)
    if arguments.out:
        rows = ([len(row[name]) if name == "lists" else row[name] for name in _COLUMNS] for row in record["chosen"])
        write_whole(arguments.out, csv_text(_COLUMNS, rows), "--out")
    if arguments.json:
        print_json(record)
    else:
        print_selection(record)


def print_selection(summary: dict[str, Any]) -> None:
    """Print the selection and that of the paper."""
    columns = ("category", "divergence", "samples", "sources", "lists", "sd of log scale", "narrowing")
    print_table(
        [*columns, "paper's name"],
        [(row["name"], *figures(row), row["paper"]) for row in summary["chosen"]],
        title=f"{len(summary['chosen'])} of {summary['candidates']} candidates, the most narrowing first",
    )
    both = sum(row["chosen"] for row in summary["paper"])
    print_table(
        ["the paper's", *columns, "why not ours"],
        [(row["paper"], row.get("name"), *figures(row), row["reason"]) for row in summary["paper"]],
        title=f"the paper's {len(summary['paper'])}: {both} are ours too",
    )


def figures(row: dict[str, Any]) -> tuple[object, ...]:
    """Return the cells of the columns from divergence to narrowing; None for a category without a prior."""
    if "samples" not in row:
        return (None,) * 6
    lists = f"{len(row['lists'])} of {len(TRAINING_LISTS)}"
    divergence, sd, narrowing = f"{row['divergence']:.2f}", f"{row['sd']:.3f}", f"{row['narrowing']:.2f}"
    return divergence, row["samples"], row["sources"], lists, sd, narrowing

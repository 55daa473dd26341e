"""`metric-tree select`: the categories fit for instance segmentation and scale estimation, and what decided."""

from __future__ import annotations

import argparse
import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from metric_base.errors import InputError
from metric_base.files import output_file, whole_file
from metric_cli.parser import OutputFile, add_tree
from metric_cli.tables import print_json, print_table
from metric_tree.training.selection import (
    TRAINING_LISTS,
    CategoryCandidate,
    Rules,
    candidates,
    choose,
    paper_selection,
    reason_against,
)
from metric_tree.tree import Tree, open_tree

HELP = "The categories fit for instance segmentation and scale estimation, with the figures that decided."

_COLUMNS = ("node", "name", "divergence", "samples", "sources", "lists", "sd", "narrowing", "paper")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    add = parser.add_argument
    rules = Rules()
    add("--count", type=int, default=rules.count, help="how many (default: %(default)s, as the paper)")
    add("--most-divergence", type=float, default=rules.most_divergence, help="sd of log size (default: %(default)s)")
    add("--least-samples", type=int, default=rules.least_samples, help="items of the fit (default: %(default)s)")
    add("--least-sources", type=int, default=rules.least_sources, help="sources of these (default: %(default)s)")
    add(
        "--least-lists",
        type=int,
        default=rules.least_lists,
        help=f"of the training sets {', '.join(TRAINING_LISTS)} (default: %(default)s)",
    )
    add("--out", type=OutputFile(), metavar="FILE.csv", help="write the chosen categories, for `export`")
    add("--figure", type=OutputFile(), metavar="FILE", help="draw the figure of each rule (.png, .svg, .pdf)")
    add_tree(parser)


def run(arguments: argparse.Namespace) -> int:
    """Choose, print our selection and beside it the paper's with the reasons of the differences."""
    rules = Rules(
        arguments.count,
        arguments.most_divergence,
        arguments.least_samples,
        arguments.least_sources,
        arguments.least_lists,
    )
    if not rules.most_divergence > 0:
        raise InputError(f"--most-divergence: expected a number above 0; found {rules.most_divergence}")
    if rules.count < 1:
        raise InputError(f"--count: expected 1 or more; found {rules.count}")
    if arguments.out:
        output_file(arguments.out)
    tree = open_tree(arguments.tree)
    ranked = candidates(tree)
    taken = choose(ranked, rules)
    chosen_summary = selection(tree, ranked, taken, rules)
    if arguments.figure:
        from metric_tree.training.selection_figure import write_figure

        write_figure(arguments.figure, ranked, taken, {node_id for _, node_id in paper_selection()}, rules)
    if arguments.out:
        _write(chosen_summary["chosen"], arguments.out)
    if arguments.json:
        print_json(chosen_summary)
    else:
        _print(chosen_summary)
    return 0


def selection(
    tree: Tree, all_candidates: Sequence[CategoryCandidate], taken: Sequence[CategoryCandidate], rules: Rules
) -> dict[str, Any]:
    """The selection as the JSON of the command."""
    labels = {node_id: label for label, node_id in paper_selection()}
    by_id = {one.node.node_id: one for one in all_candidates}
    return {
        "schema": "metric-tree/select/1",
        "tree": {"name": tree.name, "version": tree.version},
        "rules": {name: getattr(rules, name) for name in Rules.__dataclass_fields__},
        "candidates": len(all_candidates),
        "chosen": [_row(one, labels.get(one.node.node_id)) for one in taken],
        "paper": [
            {
                **(_row(by_id[node_id], label) if node_id in by_id else {"node": node_id, "paper": label}),
                "chosen": any(one.node.node_id == node_id for one in taken),
                "reason": _reason(by_id.get(node_id), taken, rules),
            }
            for label, node_id in paper_selection()
        ],
    }


def _reason(one: CategoryCandidate | None, taken: Sequence[CategoryCandidate], rules: Rules) -> str | None:
    return "no prior in this release" if one is None else reason_against(one, taken, rules)


def _row(one: CategoryCandidate, paper: str | None) -> dict[str, Any]:
    return {
        "node": one.node.node_id,
        "name": one.node.name,
        "dims": list(one.prior.dims),
        "divergence": round(one.divergence, 3),
        "samples": one.samples,
        "sources": one.prior.n_sources,
        "lists": list(one.lists),
        "sd": round(one.sd, 3),
        "narrowing": round(one.narrowing, 3),
        "paper": paper,
    }


def _write(rows: Sequence[dict[str, Any]], path: Path) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for row in rows:
        writer.writerow([*(row[name] for name in _COLUMNS[:5]), len(row["lists"]), *(row[n] for n in _COLUMNS[6:])])
    with whole_file(path, "--out") as work:
        work.write_text(text.getvalue(), encoding="utf-8")


def _print(summary: dict[str, Any]) -> None:
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
    """The cells of a row of the selection under the columns from divergence to narrowing; dashes where it has none."""
    if "samples" not in row:
        return (None,) * 6
    lists = f"{len(row['lists'])} of {len(TRAINING_LISTS)}"
    return (
        f"{row['divergence']:.2f}",
        row["samples"],
        row["sources"],
        lists,
        f"{row['sd']:.3f}",
        f"{row['narrowing']:.2f}",
    )

"""`metric-tree diff A B`: differences between two releases, with an exit status for `--fail-over`."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Mapping, Sequence

from metric_base.errors import InputError
from metric_cli.parser import add_units
from metric_cli.tables import print_json, print_table, size_format
from metric_tree.reports.diff import MovedPrior, ReleaseDiff, release_diff
from metric_tree.tree import open_tree

HELP = "Differences between two releases: nodes, tiers, priors with the items that changed them, licences."

#: Maximum number of printed priors.
MAX_ROWS = 20


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    add = parser.add_argument
    add("before", metavar="A", help="version or folder of the earlier release")
    add("after", metavar="B", help="version or folder of the later one")
    add(
        "--fail-over", metavar="RATIO", type=float, help="exit 1 if more than this fraction of the priors moved, 0 to 1"
    )
    add("--factor", type=float, help="print only the leaves whose median moved by more than this factor")
    add_units(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print the differences; 1 if a larger fraction of the priors moved than `--fail-over`."""
    limit = arguments.fail_over
    if limit is not None and not 0 <= limit <= 1:
        raise InputError(f"--fail-over: expected a share from 0 to 1; found {limit:g}")
    if arguments.factor is not None and not arguments.factor > 1:
        raise InputError(f"--factor: expected a number over 1; found {arguments.factor:g}")
    before, after = open_tree(arguments.before), open_tree(arguments.after)
    diff = release_diff(before, after)
    if arguments.factor is not None:
        diff = diff.of_leaves(after, arguments.factor)
    if arguments.json:
        print_json(diff.record())
    elif arguments.factor is not None:
        tiers = [f"{before.tier(moved.node)} to {after.tier(moved.node)}" for moved in diff.priors]
        print_table(["tiers", "leaves"], Counter(tiers).most_common(), title=f"{len(tiers):,} leaves moved")
        print_moved(diff.priors, arguments.units, "leaf", {"tiers": tiers})
    else:
        print_diff(diff, arguments.units)
    return 1 if limit is not None and diff.share_moved > limit else 0


def print_diff(diff: ReleaseDiff, unit: str) -> None:
    """Print the counts of all changes, and the priors that moved most."""
    counts = [
        ("nodes", f"{diff.nodes_before:,} before, {diff.nodes_after:,} now"),
        ("new", len(diff.added)),
        ("gone", f"{len(diff.removed):,}, of which the items of {len(diff.merged):,} are in other nodes"),
        ("with another parent", len(diff.moved)),
        ("with another name", len(diff.renamed)),
        ("with another tier", len(diff.tiers)),
        ("with a prior that moved", f"{len(diff.priors):,} ({diff.share_moved:.1%} of those in both)"),
    ]
    print_table(["", ""], counts, title=f"{diff.before} to {diff.after}")
    shown = diff.priors[:MAX_ROWS]
    if shown:
        figures = {"median": [f"{moved.median:+.0%}" for moved in shown]}
        figures["interval"] = [f"{moved.spread:+.0%}" for moved in shown]
        print_moved(shown, unit, "node", figures, f"priors that moved most, {len(shown)} of {len(diff.priors):,}")
    for title, table in (("shipped items by source", diff.items), ("shipped items by licence", diff.licences)):
        if table:
            print_table([title, "before", "now"], [(name, *pair) for name, pair in table.items()])


def print_moved(
    priors: Sequence[MovedPrior], unit: str, what: str, figures: Mapping[str, Sequence[str]], title: str | None = None
) -> None:
    """Print the medians of priors before and now, further columns, and the items that moved each prior."""
    write = size_format((mm for moved in priors for mm in (moved.before_mm, moved.after_mm)), unit)
    rows = []
    for moved, *others in zip(priors, *figures.values(), strict=True):
        blame = ", ".join(f"{n:+} {source}" for source, n in list(moved.blame.items())[:3]) or "no shipped item"
        rows.append((moved.node, moved.dim, write(moved.before_mm), write(moved.after_mm), *others, blame))
    print_table([what, "dimension", f"median {unit}", "now", *figures, "items that moved it"], rows, title=title)

"""`metric-tree cite`: the citation of a release, the basis of its priors and the attributions of its rows."""

from __future__ import annotations

import argparse

from metric_cli.parser import add_tree
from metric_cli.tables import print_json, print_table
from metric_tree.release.terms import basis
from metric_tree.tree import open_tree

HELP = "The citation of a release, the sources on which its priors rest, and the attributions of its rows."

#: Columns of the table of sources.
COLUMNS = ("id", "licence", "n_rows", "attribution")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    add_tree(parser)


def run(arguments: argparse.Namespace) -> None:
    """Print the citation, the basis and the sources with published rows."""
    from metric_tree.release.publication import texts

    tree = open_tree(arguments.tree)
    manifest, citation = tree.release.manifest, texts(tree)["CITATION.cff"]
    rows = [{name: source.get(name) for name in COLUMNS} for source in manifest["sources"] if source.get("n_rows")]
    if arguments.json:
        record = {"schema": "metric-tree/cite/1", "tree": {"name": tree.name, "version": tree.version}}
        for name in ("withheld", "noncommercial"):
            record[name] = [source["id"] for source in manifest["sources"] if source.get(name)]
        print_json(record | {"citation": citation, "basis": basis(manifest), "sources": rows})
    else:
        print(f"{citation}\n{basis(manifest)}")  # noqa: T201 - the command's result
        print_table(COLUMNS, [[row[name] for name in COLUMNS] for row in rows], title="published rows")

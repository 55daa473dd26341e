"""`metric-tree priors`: the sizes of all nodes, or of a label list, as a flat table."""

from __future__ import annotations

import argparse
import sys

from metric_base.errors import InputError
from metric_base.files import output_file, whole_file
from metric_base.records import csv_cell
from metric_cli.parser import OutputFile, add_tree, add_units
from metric_cli.tables import print_json, print_table, size_format
from metric_tree.tree import open_tree

HELP = "Sizes as a flat table with a row per node or label: tier, items, quantiles; JSON and files are in millimetres."

_SIZES = ("length_q50", "width_q50", "height_q05", "height_q50", "height_q95")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    parser.add_argument("--vocabulary", metavar="NAME", help="the labels of this list (coco_80, lvis_v1, ...)")
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--csv", action="store_true", help="print it as CSV")
    form.add_argument("--parquet", metavar="FILE", type=OutputFile(), help="write it as Parquet")
    add_units(parser)
    add_tree(parser)


def run(arguments: argparse.Namespace) -> None:
    """Print or write the table."""
    tree = open_tree(arguments.tree)
    if arguments.parquet is not None:
        output_file(arguments.parquet, "--parquet")
    table = tree.priors(arguments.vocabulary)
    if arguments.parquet is not None:
        import pyarrow.parquet as pq

        if arguments.json:
            raise InputError("--json: expected it without --parquet; found both")
        with whole_file(arguments.parquet, "--parquet") as work:
            pq.write_table(table, work, compression="zstd")
    elif arguments.json:
        print_json(table.to_pylist())
    elif arguments.csv:
        import pyarrow as pa
        import pyarrow.csv as pc

        for index, column in enumerate(table.columns):
            if pa.types.is_string(column.type):
                cells = pa.array([csv_cell(value) for value in column.to_pylist()], column.type)
                table = table.set_column(index, table.column_names[index], cells)
        sys.stdout.flush()
        pc.write_csv(table, sys.stdout.buffer)
    else:
        columns = ["label" if arguments.vocabulary else "node_id", "tier", "n_items"]
        rows = table.to_pylist()
        write = size_format((row[f"{name}_mm"] for row in rows for name in _SIZES), arguments.units)
        print_table(
            [*columns, *(f"{name}_{arguments.units}" for name in _SIZES)],
            [[*(row[name] for name in columns), *(write(row[f"{name}_mm"]) for name in _SIZES)] for row in rows],
        )

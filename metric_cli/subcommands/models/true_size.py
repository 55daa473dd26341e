"""`metric-tree true-size MODEL --category NAME`: the true size of a model without one."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from metric_base.errors import InputError
from metric_cli.parser import OutputFile, add_tree, input_path
from metric_cli.tables import print_result

if TYPE_CHECKING:
    from models3d.asset import Asset

HELP = "Estimate the true size of a generated or normalised model from its shape and its category."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    add = parser.add_argument
    add("model", metavar="MODEL", type=input_path, nargs="?", help="glTF, USD, OBJ, STL, PLY, DAE, URDF, SDF or MJCF")
    add("--category", metavar="NAME", help="category of the model")
    add("--batch", metavar="TABLE", type=input_path, help="boxes of a scene (CSV or Parquet), with a common factor")
    add("--out", metavar="FILE", type=OutputFile(), help="write the model at the median true size")
    add("--bake", action="store_true", help="with --out: change the vertices of glTF instead of adding a node")
    add_tree(parser)


def run(arguments: argparse.Namespace) -> None:
    """Print the factor with its interval, and write the model to `--out`."""
    from metric_tree.tree import open_tree
    from models3d.formats import read_assets
    from models3d.rescaling import write_at_scale
    from models3d.size_check.true_size import boxes_true_size, model_true_size

    tree = open_tree(arguments.tree)
    asset: Asset | None = None
    if arguments.model is not None:
        ((_, content),) = read_assets([arguments.model])
        if isinstance(content, InputError):
            raise content
        asset = content
    if arguments.batch is not None:
        result = boxes_true_size(arguments.batch, tree)
    elif asset is None or arguments.category is None:
        raise InputError("arguments: expected MODEL --category NAME, or --batch TABLE; found neither")
    else:
        result = model_true_size(asset, arguments.category, tree)
    if arguments.out is not None and asset is not None:
        write_at_scale(asset, arguments.out, result.factor[1], baked=arguments.bake)
    columns = ["", "low", "median", "high"]
    rows = [
        ("factor", *(f"{value:.4g}" for value in result.factor)),
        ("height, m", *(f"{value:.4g}" for value in result.height_m)),
    ]
    print_result(arguments.json, result.to_json(), columns, rows, f"{result.file}: {result.reason}")

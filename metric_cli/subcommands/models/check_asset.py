"""`metric-tree check-asset FILE...`: check whether 3-D models have their true size."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from metric_base.batch import append_records, completed_records
from metric_base.errors import InputError, Unquoted
from metric_base.escaping import visible, visible_json
from metric_base.files import OutputNames, sole_writer
from metric_cli.batch import BatchCommand, add_batch, check_batch_options
from metric_cli.errors import EXIT_NEGATIVE_RESULT, EXIT_OK, INPUT_ERROR
from metric_cli.parser import OutputFile, add_tree, input_path
from metric_cli.progress import track
from metric_cli.subcommands import parser_of
from metric_cli.tables import print_table, warn

if TYPE_CHECKING:
    from metric_tree.tree import Tree
    from models3d.asset import Asset
    from models3d.size_check.check import AssetCheck

HELP = f"Check whether 3-D models have their true size: a line per model; exit {EXIT_NEGATIVE_RESULT} if one is wrong."


def batch_columns(text: str) -> dict[str, Any]:
    """Return the columns of a batch for the lines of a model: its first wrong object, or its first one."""
    rows = [json.loads(line) for line in text.splitlines()]
    row = next((row for row in rows if row["verdict"] not in ("right", "not known")), rows[0])
    return {"status": row["verdict"], "scale": row["factor"]}


#: Return the parser of the subcommand.
model_parser = partial(parser_of, "check-asset")
BATCH = BatchCommand(
    "metric-tree check-asset", "metric_cli.subcommands", ("check-asset",), model_parser, batch_columns, ("file",), True
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    # fmt: off
    add = parser.add_argument
    add("files", metavar="FILE", nargs="*", type=input_path,
        help="models (glTF, USD, OBJ, STL, PLY, DAE, URDF, ...) or folders")
    add("--category", metavar="NAME", help="category of all models (default: from the names in each file)")
    add("--strict", action="store_true", help=f"exit {EXIT_NEGATIVE_RESULT} also for unknown sizes")
    add = parser.add_argument_group("output").add_argument
    add("--fix", metavar="OUT", type=OutputFile(),
        help="write wrong models at their true size: a file, or a folder for several")
    add("--bake", action="store_true", help="with --fix: change the vertices of glTF instead of adding a node")
    add("--report", metavar="FILE.html", type=OutputFile(), help="page with drawings to scale, largest errors first")
    add("--out", metavar="FILE.jsonl", type=OutputFile("metric-tree/asset/"),
        help="one JSON line per model, or with --batch a table RESULTS.parquet; an interrupted run is continued")
    add = parser.add_argument_group("lists").add_argument
    add("--batch", metavar="LIST", type=input_path,
        help="table of boxes (CSV or Parquet: name, x, y, z in metres), or a list of file names; with --out "
        "RESULTS.parquet, models with options as columns (CSV, Parquet, JSON Lines)")
    add("--up", choices=("x", "y", "z"), help="the axis that points up in boxes")
    # fmt: on
    add_batch(parser, with_out=False, with_list=False)
    add_tree(parser)


def run(arguments: argparse.Namespace) -> int:
    """Check each model; 2 if a model cannot be written, else 3 if one is wrong, else 2 if one cannot be read."""
    from metric_tree.tree import open_tree
    from models3d.size_check.category import named_category

    check_batch_options(arguments)
    if not arguments.files and arguments.batch is None:
        raise InputError("arguments: expected FILE... or --batch LIST; found neither")
    if arguments.fix is not None and is_table(arguments.batch):
        raise InputError(f"--fix: expected models to write anew; found a table of boxes, {arguments.batch}")
    tree = open_tree(arguments.tree)
    if arguments.category is not None:
        named_category(tree, arguments.category)  # an unknown name is an error before any work
    if arguments.out is None:
        return check_models(arguments, tree, [])
    with sole_writer(arguments.out):
        rows = completed_records(
            arguments.out, "metric-tree/asset/1", ("file", "verdict"), "--out", "check-asset", is_own=True
        )
        return check_models(arguments, tree, [row for _, row in rows])


def check_models(arguments: argparse.Namespace, tree: Tree, rows: list[dict[str, Any]]) -> int:
    """Check the models that have no rows of an earlier run; the exit status is that of all."""
    files, fix = arguments.files, arguments.fix
    done = {row["file"] for row in rows}
    verdicts = Counter(row["verdict"] for row in rows)
    checks: list[AssetCheck] = []
    n_unread = n_unwritten = 0
    has_several = arguments.batch is not None or len(files) > 1 or files[0].is_dir()
    names = OutputNames(fix) if fix is not None and has_several else None
    if names is not None:  # those that the earlier run wrote
        written = ("wrong unit", "arbitrary scale")
        for name in (Path(row["file"]).name for row in rows if row["verdict"] in written):
            names.path(name)
    for asset in track(assets_of(arguments, done if arguments.report is None else set()), "models"):
        found = checks_of(asset, tree, arguments.category)
        if isinstance(asset, InputError) or isinstance(found, InputError):
            warn(str(found))
            n_unread += 1
            continue
        checks += found
        if str(asset.file) in done:  # only the report needs it again
            continue
        verdicts.update(check.verdict for check in found)
        if fix is not None and not write_fixed(asset, found, fix, names, arguments.bake):
            n_unwritten += 1
            continue
        write_lines(found, arguments)  # after the model, because a model with a line is not checked again
    if arguments.report is not None:
        from models3d.size_check.report import write_report

        write_report(arguments.report, checks)
    if not arguments.json and verdicts.total() > 1:
        print_table(["verdict", "models"], verdicts.most_common())
    accepted = {"right"} if arguments.strict else {"right", "not known"}
    if n_unwritten:
        return INPUT_ERROR
    return EXIT_NEGATIVE_RESULT if set(verdicts) - accepted else INPUT_ERROR if n_unread else EXIT_OK


def checks_of(asset: Asset | InputError, tree: Tree, category: str | None) -> Sequence[AssetCheck] | InputError:
    """Return the verdicts on the objects of a model, or its error, which does not stop the models after it."""
    from models3d.size_check.check import check_bodies

    if isinstance(asset, InputError):
        return asset
    try:
        return check_bodies(asset, tree, category)
    except Exception as error:  # noqa: BLE001 - a file of a stranger may have any content
        found = Unquoted(f"{type(error).__name__}: {error}")
        return InputError.at(asset.file, "content", "a model that can be checked", found)


def assets_of(arguments: argparse.Namespace, done: set[str]) -> Iterable[Asset | InputError]:
    """Yield the models of the arguments and of `--batch` that are not done, or the error of one that is unreadable."""
    from metric_base.input_files import read_text
    from models3d.formats import find_models, read_assets, read_boxes

    files = list(arguments.files)
    if is_table(arguments.batch):
        boxes = read_boxes(arguments.batch, arguments.up)
        yield from (box for box in boxes if isinstance(box, InputError) or str(box.file) not in done)
    elif arguments.batch is not None:
        lines = read_text(arguments.batch).split("\n")
        files += [arguments.batch.parent / line.strip() for line in lines if line.strip()]
    for _, asset in read_assets(path for path in find_models(files) if str(path) not in done):
        yield asset


def is_table(batch: Path | None) -> bool:
    """Return whether `--batch` is a table of boxes, not a list of files."""
    return batch is not None and batch.suffix.lower() in {".csv", ".parquet"}


def write_lines(checks: Sequence[AssetCheck], arguments: argparse.Namespace) -> None:
    """Append the results of a model to `--out`, and print them."""
    from models3d.size_check.check import verdict_line

    rows = [visible_json(json.dumps(check.to_json(), ensure_ascii=False, allow_nan=False)) for check in checks]
    if arguments.out is not None:
        append_records(arguments.out, rows)
    for check, row in zip(checks, rows, strict=True):
        if arguments.json:
            print(row)  # noqa: T201 - the command's result
        elif arguments.batch is None or check.is_wrong:
            name = check.file if Path(check.file).stem == check.body else f"{check.file}: {check.body}"
            print(visible(f"{name}: {verdict_line(check)}"))  # noqa: T201 - the command's result


def write_fixed(asset: Asset, checks: Sequence[AssetCheck], fix: Path, names: OutputNames | None, baked: bool) -> bool:
    """Write a wrong model at its true size, into the folder `fix` if `names` are given; False if that is impossible.

    A warning states why nothing is written.
    """
    from models3d.rescaling import write_at_scale

    for check in checks:
        factor: Any = check.factor if check.verdict == "wrong unit" else None
        if check.verdict == "arbitrary scale" and check.true_size is not None:
            factor = check.true_size.factor[1]
        if factor is not None:
            if names is not None:
                fix.mkdir(parents=True, exist_ok=True)
            try:
                write_at_scale(asset, fix if names is None else names.path(asset.file.name), factor, baked=baked)
            except InputError as error:
                warn(str(error))
                return False
        elif check.is_wrong:
            warn(f"{check.file}: not written: {check.verdict} says no factor")
    return True

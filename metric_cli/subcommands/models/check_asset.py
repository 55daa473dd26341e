"""`metric-tree check-asset FILE...`: check whether 3-D models have their true size."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from metric_base.errors import InputError
from metric_base.files import OutputNames
from metric_cli.errors import EXIT_NEGATIVE_RESULT, EXIT_OK, INPUT_ERROR
from metric_cli.parser import OutputFile, add_tree, input_path
from metric_cli.progress import track
from metric_cli.tables import print_table, warn

if TYPE_CHECKING:
    from models3d.asset import Asset
    from models3d.size_check.check import AssetCheck

HELP = f"Check whether 3-D models have their true size: a line per model; exit {EXIT_NEGATIVE_RESULT} if one is wrong."


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
        help="one JSON line per model; an interrupted run is continued")
    add = parser.add_argument_group("lists").add_argument
    add("--batch", metavar="LIST", type=input_path,
        help="table of boxes (CSV or Parquet: name, x, y, z in metres), or a list of file names")
    add("--up", choices=("x", "y", "z"), help="the axis that points up in boxes")
    # fmt: on
    add_tree(parser)


def run(arguments: argparse.Namespace) -> int:
    """Check each model; 3 if one is wrong, else 2 if one cannot be read."""
    from metric_tree.tree import open_tree
    from models3d.size_check.check import check_bodies

    files, batch, fix = arguments.files, arguments.batch, arguments.fix
    if not files and batch is None:
        raise InputError("arguments: expected FILE... or --batch LIST; found neither")
    if fix is not None and is_table(batch):
        raise InputError(f"--fix: expected models to write anew; found a table of boxes, {batch}")
    tree = open_tree(arguments.tree)
    checks, n_unread = [], 0
    done = finished_files(arguments.out)
    has_several = batch is not None or len(files) > 1 or files[0].is_dir()
    names = OutputNames(fix) if fix is not None and has_several else None
    for asset in track(assets_of(arguments), "models"):
        if isinstance(asset, InputError):
            warn(str(asset))
            n_unread += 1
        elif str(asset.file) not in done:
            for check in check_bodies(asset, tree, arguments.category):
                checks.append(check)
                write_line(check, arguments)
                if fix is not None and check.is_wrong:
                    write_fixed(asset, check, fix, names, arguments.bake)
    if arguments.report is not None:
        from models3d.size_check.report import write_report

        write_report(arguments.report, checks)
    if not arguments.json and len(checks) > 1:
        print_table(["verdict", "models"], Counter(check.verdict for check in checks).most_common())
    is_wrong = any(check.is_wrong or (arguments.strict and check.verdict == "not known") for check in checks)
    return EXIT_NEGATIVE_RESULT if is_wrong else INPUT_ERROR if n_unread else EXIT_OK


def assets_of(arguments: argparse.Namespace) -> Iterable[Asset | InputError]:
    """Yield the models of the arguments and of `--batch`, or the error of a model that cannot be read."""
    from metric_base.input_files import read_text
    from models3d.formats import find_models, read_assets, read_boxes

    files = list(arguments.files)
    if is_table(arguments.batch):
        yield from read_boxes(arguments.batch, arguments.up)
    elif arguments.batch is not None:
        lines = read_text(arguments.batch).split("\n")
        files += [arguments.batch.parent / line.strip() for line in lines if line.strip()]
    for _, asset in read_assets(find_models(files)):
        yield asset


def is_table(batch: Path | None) -> bool:
    """Return whether `--batch` is a table of boxes, not a list of files."""
    return batch is not None and batch.suffix.lower() in {".csv", ".parquet"}


def finished_files(out: Path | None) -> set[str]:
    """Return the models that an earlier run wrote, and remove an incomplete last line.

    Raises
    ------
    InputError
        The file has other content than results of check-asset.
    """
    if out is None or not out.exists():
        return set()
    text = out.read_text(encoding="utf-8")
    complete = text[: text.rfind("\n") + 1]
    rows = [line for line in complete.split("\n") if line.strip()]
    if text.strip() and '"metric-tree/asset/1"' not in text.partition("\n")[0]:
        raise InputError(f"{out}: --out: expected results of check-asset, or no file yet; found another file")
    if complete != text:
        out.write_text(complete, encoding="utf-8")
    return {json.loads(row)["file"] for row in rows}


def write_line(check: AssetCheck, arguments: argparse.Namespace) -> None:
    """Append the result of a model to `--out`, and print it."""
    from models3d.size_check.check import verdict_line

    row = json.dumps(check.to_json(), ensure_ascii=False, allow_nan=False)
    if arguments.out is not None:
        with arguments.out.open("a", encoding="utf-8") as lines:
            lines.write(row + "\n")
    if arguments.json:
        print(row)  # noqa: T201 - the command's result
    elif arguments.batch is None or check.is_wrong:
        name = check.file if Path(check.file).stem == check.body else f"{check.file}: {check.body}"
        print(f"{name}: {verdict_line(check)}")  # noqa: T201 - the command's result


def write_fixed(asset: Asset, check: AssetCheck, fix: Path, names: OutputNames | None, baked: bool) -> None:
    """Write a model at its true size, into the folder `fix` if `names` are given; warn if no factor is known."""
    from models3d.rescaling import write_at_scale

    factor: Any = check.factor if check.verdict == "wrong unit" else None
    if check.verdict == "arbitrary scale" and check.true_size is not None:
        factor = check.true_size.factor[1]
    if factor is None:
        warn(f"{check.file}: not written: {check.verdict} says no factor")
        return
    if names is not None:
        fix.mkdir(parents=True, exist_ok=True)
    write_at_scale(asset, fix if names is None else names.path(asset.file.name), factor, baked=baked)

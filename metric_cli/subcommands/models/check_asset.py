"""`metric-tree check-asset FILE...`: whether 3-D models are at true size."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from metric_base.errors import InputError
from metric_base.files import OutputNames
from metric_cli.errors import DONE, EXIT_NEGATIVE_RESULT, INPUT_ERROR
from metric_cli.parser import OutputFile, add_tree, input_path
from metric_cli.progress import with_bar
from metric_cli.tables import print_table, warn

if TYPE_CHECKING:
    from models3d.asset import Asset
    from models3d.size_check.check import AssetCheck

HELP = f"Whether 3-D models are at true size: one line a model; exit {EXIT_NEGATIVE_RESULT} if any is wrong."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    add = parser.add_argument
    add(
        "files",
        metavar="FILE",
        nargs="*",
        type=input_path,
        help="models (glTF, USD, OBJ, STL, PLY, DAE, URDF, ...) or folders",
    )
    add("--category", metavar="NAME", help="what all of them are; else the files' own words say")
    add(
        "--batch",
        metavar="LIST",
        type=input_path,
        help="table of boxes (CSV or Parquet: name, x, y, z in metres), or file names",
    )
    add("--up", choices=("x", "y", "z"), help="the axis that points up in boxes")
    add(
        "--out",
        metavar="FILE.jsonl",
        type=OutputFile("metric-tree/asset/"),
        help="one JSON line a model; a run that was stopped goes on there",
    )
    add("--report", metavar="FILE.html", type=OutputFile(), help="a page, the most wrong first, with drawings to scale")
    add(
        "--fix",
        metavar="OUT",
        type=OutputFile(),
        help="write what is wrong at its true size: a file, or a folder for many",
    )
    add("--bake", action="store_true", help="with --fix: change the vertices of glTF, not a node above them")
    add("--strict", action="store_true", help=f"exit {EXIT_NEGATIVE_RESULT} also for what is not known")
    add_tree(parser)


def run(arguments: argparse.Namespace) -> int:
    """Check each model; 3 if one is wrong, else 2 if one cannot be read."""
    from metric_tree.tree import open_tree
    from models3d.size_check.check import check_bodies

    if not arguments.files and arguments.batch is None:
        raise InputError("arguments: expected FILE... or --batch LIST; found neither")
    if arguments.fix is not None and _is_table(arguments.batch):
        raise InputError(f"--fix: expected models to write anew; found a table of boxes, {arguments.batch}")
    tree = open_tree(arguments.tree)
    checks, unread = [], 0
    done = _files_there(arguments.out)
    names = OutputNames(arguments.fix) if arguments.fix is not None and _are_many(arguments) else None
    for asset in with_bar(_assets(arguments), "models"):
        if isinstance(asset, InputError):
            warn(str(asset))
            unread += 1
        elif str(asset.file) not in done:
            for check in check_bodies(asset, tree, arguments.category):
                checks.append(check)
                _print_line(arguments, check)
                if arguments.fix is not None and check.is_wrong:
                    _fix(arguments, asset, check, names)
    if arguments.report is not None:
        from models3d.size_check.report import write_report

        write_report(arguments.report, checks)
    if not arguments.json and len(checks) > 1:
        _print_counts(checks)
    wrong = any(check.is_wrong or (arguments.strict and check.verdict == "not known") for check in checks)
    return EXIT_NEGATIVE_RESULT if wrong else INPUT_ERROR if unread else DONE


def _assets(arguments: argparse.Namespace) -> Iterable[Asset | InputError]:
    from metric_base.input_files import read_text
    from models3d.formats import find_models, read_assets, read_boxes

    files = list(arguments.files)
    if arguments.batch is not None:
        if _is_table(arguments.batch):
            yield from read_boxes(arguments.batch, arguments.up)
        else:
            folder = arguments.batch.parent
            files += [folder / line.strip() for line in read_text(arguments.batch).split("\n") if line.strip()]
    for _, asset in read_assets(find_models(files)):
        yield asset


def _is_table(batch: Path | None) -> bool:
    return batch is not None and batch.suffix.lower() in {".csv", ".parquet"}


def _are_many(arguments: argparse.Namespace) -> bool:
    """Return True if `--fix` names a folder: there may be several models."""
    files = arguments.files
    return arguments.batch is not None or len(files) > 1 or files[0].is_dir()


def _files_there(out: Path | None) -> set[str]:
    """The models that an earlier run wrote; half a line of a kill is removed.

    InputError for a file that is none of its kind.
    """
    if out is None or not out.exists():
        return set()
    text = out.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]
    rows = [line for line in whole.split("\n") if line.strip()]
    if text.strip() and '"metric-tree/asset/1"' not in text.partition("\n")[0]:
        raise InputError(f"{out}: --out: expected results of check-asset, or no file yet; found another file")
    if whole != text:
        out.write_text(whole, encoding="utf-8")
    return {json.loads(row)["file"] for row in rows}


def _print_line(arguments: argparse.Namespace, check: AssetCheck) -> None:
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


def _print_counts(checks: list[AssetCheck]) -> None:
    counts = Counter(check.verdict for check in checks)
    print_table(["verdict", "models"], counts.most_common())


def _fix(arguments: argparse.Namespace, asset: Asset, check: AssetCheck, names: OutputNames | None) -> None:
    from models3d.rescaling import write_at_scale

    factor: Any = check.factor if check.verdict == "wrong unit" else None
    if check.verdict == "arbitrary scale" and check.true_size is not None:
        factor = check.true_size.factor[1]
    if factor is None:
        warn(f"{check.file}: not written: {check.verdict} says no factor")
        return
    if names is not None:
        arguments.fix.mkdir(parents=True, exist_ok=True)
    out = arguments.fix if names is None else names.path(asset.file.name)
    write_at_scale(asset, out, factor, baked=arguments.bake)

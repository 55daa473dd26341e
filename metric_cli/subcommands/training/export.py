"""`metric-tree export --out DIR`: training data for instance segmentation, in COCO's form."""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from metric_base.errors import InputError
from metric_cli.parser import add_tree, input_path, new_folder
from metric_cli.progress import with_bar
from metric_cli.tables import print_json, print_table
from metric_tree.node import Node
from metric_tree.tree import Tree, open_tree

HELP = "Training data for instance segmentation (COCO format): pasted cut-outs, and matching pictures of other sets."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    add = parser.add_argument
    add("--out", type=new_folder, required=True, metavar="DIR", help="a folder that does not exist yet")
    add("--categories", metavar="FILE.csv|NAME,NAME", help="what `select --out` wrote, or names (default: select's)")
    add("--pictures", type=int, default=1000, help="synthetic pictures (default: %(default)s)")
    add("--size", default="640x480", metavar="WxH", help="of a synthetic picture in pixels (default: %(default)s)")
    add("--backgrounds", type=input_path, metavar="DIR", help="pictures to paste on (default: made patches)")
    add("--val-share", type=float, default=0.1, help="share of items and pictures kept for validation")
    add(
        "--coco", nargs=2, type=input_path, action="append", default=[], metavar=("JSON", "IMAGES"), help="COCO or LVIS"
    )
    add("--ade20k", type=input_path, action="append", default=[], metavar="DIR", help="ADE20K: full set or challenge")
    add(
        "--open-images", type=input_path, action="append", default=[], metavar="DIR", help="Open Images masks, V5 to V7"
    )
    add("--seed", type=int, default=0, help="the same seed and input give the same bytes (default: %(default)s)")
    add("--jobs", type=int, default=1, help="processes; they change nothing but the time (default: %(default)s)")
    add_tree(parser)


def run(arguments: argparse.Namespace) -> int:
    """Write the data set and print what is in it."""
    from metric_tree.training.classes import Classes
    from metric_tree.training.composition import cutouts_of
    from metric_tree.training.dataset import export_dataset

    plan = _plan(arguments)
    _see_coco(arguments.coco)
    tree = open_tree(arguments.tree)
    classes = Classes(tree, _nodes(tree, arguments.categories))
    cutouts = cutouts_of(classes, plan.seed)
    summary = export_dataset(arguments.out, classes, cutouts, plan, _others(arguments), _making)
    record: dict[str, Any] = {
        "schema": "metric-tree/export/1",
        "out": str(arguments.out),
        "cutouts": len(cutouts),
        "pictures": dict(summary.pictures),
        "objects": dict(summary.objects),
        "categories": {node.name: summary.by_category[k] for k, node in enumerate(classes.nodes, start=1)},
        "too_wide_to_tell": summary.ambiguous,
    }
    if arguments.json:
        print_json(record)
    else:
        _print(record)
    return 0


def _plan(arguments: argparse.Namespace) -> Any:
    from metric_tree.training.dataset import Plan, background_files

    try:
        width, height = (int(side) for side in arguments.size.lower().split("x"))
    except ValueError:
        width = height = 0
    if not (64 <= width <= 8192 and 64 <= height <= 8192):
        raise InputError(f"--size: expected WIDTHxHEIGHT from 64 to 8192; found {arguments.size!r}")
    if not 0 <= arguments.val_share < 1:
        raise InputError(f"--val-share: expected a share from 0 to under 1; found {arguments.val_share}")
    for name, least in (("pictures", 0), ("jobs", 1), ("seed", 0)):
        if getattr(arguments, name) < least:
            raise InputError(f"--{name}: expected {least} or more; found {getattr(arguments, name)}")
    backgrounds = background_files(arguments.backgrounds) if arguments.backgrounds else ()
    return Plan(arguments.pictures, (width, height), arguments.val_share, arguments.seed, backgrounds, arguments.jobs)


def _nodes(tree: Tree, categories: str | None) -> list[Node]:
    """The nodes of a file that `select` wrote, or of names, or of the selection."""
    if categories is None:
        from metric_tree.training.selection import candidates, choose

        ranked = candidates(tree)
        taken = [one.node for one in choose(ranked)]
        if not taken:
            count = f"none of {len(ranked)} candidates of {tree.name} {tree.version}"
            raise InputError(f"--categories: expected names, as select's rules chose no category; found {count}")
        return taken
    if not categories.endswith(".csv"):
        return [tree.find(name.strip()) for name in categories.split(",")]
    with Path(categories).open(encoding="utf-8", newline="") as lines:
        reader = csv.DictReader(lines)
        rows = [(reader.line_num, row) for row in reader]
    if not rows or "node" not in rows[0][1]:
        raise InputError(f"{categories}: columns: expected node, as `metric-tree select --out` writes it; found none")
    nodes = []
    for line, row in rows:
        try:
            nodes.append(tree.node(row["node"]))
        except InputError as error:
            raise InputError(f"{categories}:{line}: {error}") from None
    return nodes


def _see_coco(given: Iterable[tuple[Path, Path]]) -> None:
    """The annotation files and the folders of their images, asked before the work."""
    for file, images in given:
        if not file.is_file():
            raise InputError(f"--coco: expected a JSON file; found no file {file}")
        if not images.is_dir():
            raise InputError(f"--coco: expected a folder of pictures; found no folder {images}")


def _others(arguments: argparse.Namespace) -> Iterator[tuple[tuple[str, ...], Iterable[Any]]]:
    from metric_tree.training import ade20k, coco, open_images

    for file, images in arguments.coco:
        yield coco.LISTS, coco.coco_images(file, images)
    for folder in arguments.ade20k:
        yield ade20k.LISTS, ade20k.ade20k_images(folder)
    for folder in arguments.open_images:
        yield open_images.LISTS, open_images.open_images_images(folder)


def _making(pictures: Iterable[Any], total: int) -> Iterable[Any]:
    return with_bar(pictures, "making pictures", total)


def _print(record: dict[str, Any]) -> None:
    print_table(
        ["split", "pictures", "objects"],
        [(split, count, record["objects"][split]) for split, count in record["pictures"].items()],
        title=f"{record['out']}: from {record['cutouts']} cut-outs",
    )
    counts: dict[str, int] = record["categories"]
    names = sorted(counts, key=lambda name: -counts[name])
    print_table(["category", "objects"], [(name, counts[name]) for name in names])
    if record["too_wide_to_tell"]:
        print_table(["label above a category, left out", "objects"], record["too_wide_to_tell"].items())

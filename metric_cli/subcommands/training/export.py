"""`metric-tree export --out DIR`: training data for instance segmentation in the COCO format."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

from metric_base.errors import InputError
from metric_cli.parser import add_tree, input_path, new_folder
from metric_cli.progress import track
from metric_cli.tables import print_json, print_table
from metric_tree.tree import open_tree

if TYPE_CHECKING:
    from metric_tree.training.dataset import Plan

HELP = "Training data for instance segmentation (COCO format): pasted cut-outs, and images of other data sets."

#: Range of the sides of a synthetic image in pixels.
MIN_SIDE_PX, MAX_SIDE_PX = 64, 8192


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    # fmt: off
    add = parser.add_argument
    add("--out", type=new_folder, required=True, metavar="DIR", help="folder of the data set; it must not exist")
    add("--categories", metavar="FILE.csv|NAME,NAME",
        help="output of `select --out`, or names (default: the selection of `select`)")
    add("--val-share", type=float, default=0.1, help="fraction of items and images for validation")
    add("--seed", type=int, default=0, help="seed; results are identical for equal seeds (default: %(default)s)")
    add("--jobs", type=int, default=1, help="number of processes; results do not depend on it (default: %(default)s)")
    add = parser.add_argument_group("synthetic images").add_argument
    add("--pictures", type=int, default=1000, help="number of images (default: %(default)s)")
    add("--size", default="640x480", metavar="WxH", help="size of an image in pixels (default: %(default)s)")
    add("--backgrounds", type=input_path, metavar="DIR", help="background images (default: synthetic patches)")
    add = parser.add_argument_group("images of other data sets (may be repeated)").add_argument
    add("--coco", nargs=2, type=input_path, action="append", default=[], metavar=("JSON", "IMAGES"),
        help="annotations and images of COCO or LVIS")
    add("--ade20k", type=input_path, action="append", default=[], metavar="DIR",
        help="ADE20K, the full set or the challenge")
    add("--open-images", type=input_path, action="append", default=[], metavar="DIR",
        help="Open Images with masks, V5 to V7")
    # fmt: on
    add_tree(parser)


def run(arguments: argparse.Namespace) -> None:
    """Write the data set and print its counts."""
    from metric_tree.training.classes import Classes
    from metric_tree.training.composition import cutouts_of
    from metric_tree.training.dataset import export_dataset
    from metric_tree.training.selection import named_nodes

    plan = parse_plan(arguments)
    tree = open_tree(arguments.tree)
    classes = Classes(tree, named_nodes(tree, arguments.categories))
    cutouts = cutouts_of(classes, plan.seed)

    def progress(images: Iterable[Any], total: int) -> Iterable[Any]:
        return track(images, "making pictures", total)

    summary = export_dataset(arguments.out, classes, cutouts, plan, other_datasets(arguments), progress)
    counts = {node.name: summary.by_category[k] for k, node in enumerate(classes.nodes, start=1)}
    if arguments.json:
        record = {"schema": "metric-tree/export/1", "out": str(arguments.out), "cutouts": len(cutouts)}
        record |= {"pictures": dict(summary.pictures), "objects": dict(summary.objects)}
        print_json(record | {"categories": counts, "too_wide_to_tell": summary.ambiguous})
        return
    rows = [(split, count, summary.objects[split]) for split, count in summary.pictures.items()]
    title = f"{arguments.out}: from {len(cutouts)} cut-outs"
    print_table(["split", "pictures", "objects"], rows, title=title)
    print_table(["category", "objects"], Counter(counts).most_common())
    if summary.ambiguous:
        print_table(["label above a category, left out", "objects"], summary.ambiguous.items())


def parse_plan(arguments: argparse.Namespace) -> Plan:
    """Return the plan of the data set. Raises InputError for an invalid number or a missing file."""
    from metric_tree.training.dataset import Plan, background_files

    try:
        width, height = (int(side) for side in arguments.size.lower().split("x"))
    except ValueError:
        width = height = 0
    if not (MIN_SIDE_PX <= width <= MAX_SIDE_PX and MIN_SIDE_PX <= height <= MAX_SIDE_PX):
        expected = f"WIDTHxHEIGHT from {MIN_SIDE_PX} to {MAX_SIDE_PX}"
        raise InputError(f"--size: expected {expected}; found {arguments.size!r}")
    if not 0 <= arguments.val_share < 1:
        raise InputError(f"--val-share: expected a share from 0 to under 1; found {arguments.val_share}")
    for name, minimum in (("pictures", 0), ("jobs", 1), ("seed", 0)):
        if getattr(arguments, name) < minimum:
            raise InputError(f"--{name}: expected {minimum} or more; found {getattr(arguments, name)}")
    for file, images in arguments.coco:
        if not file.is_file():
            raise InputError(f"--coco: expected a JSON file; found no file {file}")
        if not images.is_dir():
            raise InputError(f"--coco: expected a folder of pictures; found no folder {images}")
    backgrounds = background_files(arguments.backgrounds) if arguments.backgrounds else ()
    return Plan(arguments.pictures, (width, height), arguments.val_share, arguments.seed, backgrounds, arguments.jobs)


def other_datasets(arguments: argparse.Namespace) -> Iterator[tuple[tuple[str, ...], Iterable[Any]]]:
    """Yield the label lists and the images of the other data sets."""
    from metric_tree.training import ade20k, coco, open_images

    for file, images in arguments.coco:
        yield coco.LISTS, coco.coco_images(file, images)
    for folder in arguments.ade20k:
        yield ade20k.LISTS, ade20k.ade20k_images(folder)
    for folder in arguments.open_images:
        yield open_images.LISTS, open_images.open_images_images(folder)

"""`metric-tree query NAME`: the record of a category."""

from __future__ import annotations

import argparse
from typing import Any

from metric_base.errors import InputError
from metric_cli.parser import OutputFile, add_tree
from metric_cli.tables import print_json, print_table
from metric_tree.axes import AXES
from metric_tree.context import where_of
from metric_tree.prior import QUANTILES
from metric_tree.release.schema import IMAGES
from metric_tree.reports.description import item_quantiles
from metric_tree.reports.node_record import node_record
from metric_tree.tree import open_tree

HELP = "A category: its node, path, counts, evidence, quantiles in millimetres and prior."

#: Default number of images of a sheet.
SHEET_IMAGES = 12


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    add = parser.add_argument
    add("name", metavar="NAME", help="name, synset, alias or detector label")
    add("--dims", help="dimensions, separated by commas: length,width,height or extent1,extent2,extent3")
    add("--where", metavar="PLACE,YEAR", help="sizes of a region and a year: germany, europe,2011")
    add("--vocabulary", help="resolve NAME as a label of this list (coco_80, lvis_v1, ...)")
    add("--at-least", metavar="TIER", help="minimum tier: norm, measured, few, ...; a lower tier is an error")
    add("--kind", help="also print the sizes of the published items of this kind: product, measured, ...")
    add("--images", metavar="N", type=int, help="list N images, evenly distributed over the sizes")
    add(
        "--sheet",
        metavar="FILE.png",
        type=OutputFile(),
        help="draw these images to a common scale (default: 12)",
    )
    add_tree(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print the node and its prior."""
    tree = open_tree(arguments.tree)
    node = tree.find(arguments.name, arguments.vocabulary, at_least=arguments.at_least)
    dims = tuple(arguments.dims.split(",")) if arguments.dims else None
    record = node_record(node, dims, where_of(arguments.where) if arguments.where is not None else None)
    record["note"] = tree.resolve(arguments.name, arguments.vocabulary).note
    if arguments.kind is not None:
        record["items_of_kind"] = item_quantiles(node, arguments.kind, QUANTILES)
    if arguments.images is not None or arguments.sheet is not None:
        from metric_tree.reports.contact_sheet import image_rows, write_sheet

        if arguments.images is not None and arguments.images < 1:
            raise InputError(f"--images: expected a number from 1; found {arguments.images}")
        count = arguments.images or SHEET_IMAGES
        rows = write_sheet(arguments.sheet, node, count) if arguments.sheet is not None else image_rows(node, count)
        fields = (*IMAGES.names, "extents_mm")
        record["images"] = [{name: row[name] for name in fields} for row in rows]
    if arguments.json:
        print_json(record)
    else:
        _print(record)
    return 0


def _print(record: dict[str, Any]) -> None:
    prior = record["prior"]
    shares = sorted(prior["share_by_kind"].items(), key=lambda entry: -entry[1]) if prior else ()
    licences = record["shipped"]["licence"].items()
    norms = record["norm"].split("; ") if record["norm"] else ()
    rows = [
        ("node", record["node"]),
        ("note", record["note"]),
        ("path", " > ".join(record["path"])),
        ("pose", record["pose"]),
        ("height", record["height_is"]),
        ("items", record["n_items"]),
        ("tier", record["tier"] or "none"),
        *(("norm", norm) for norm in norms),
        ("in words", record["sentence"] or "nothing is known of its size"),
        ("where", record["where"]),
        ("state", record["plain_state"]),
        *(
            (name, "judged: " + " x ".join(_mm(q["0.5"]) for q in sizes.values()) + f" mm ({', '.join(sizes)})")
            for name, sizes in record["states_mm"].items()
        ),
        ("evidence", ", ".join(f"{kind} {share:.0%}" for kind, share in shares) or "none"),
        ("licences", ", ".join(f"{name} ({n})" for name, n in licences) or "none"),
        ("children", ", ".join(record["children"]) or "none"),
        ("tree", f"{record['tree']['name']} {record['tree']['version']}"),
    ]
    optional = {"note", "height", "where", "state"}
    print_table(["", ""], [row for row in rows if row[1] or row[0] not in optional], title=record["name"])
    if "images" in record:
        columns = ("image_id", "item_id", "cutout_path", "licence", "source_url")
        print_table(columns, [[row[name] for name in columns] for row in record["images"]], title="pictures")
    if record["variants"]:
        _print_variants(record["variants"])
    if prior is None:
        print_table(["prior"], [("none: no item with a size at or below this node",)])
        return
    counted = f"{prior['n']} items, {prior['n_sources']} sources, {prior['borrowed']:.0%} borrowed from the parent"
    _print_quantiles(record["quantiles_mm"], f"{record['tier']}, mm; {counted}")
    if "items_of_kind" in record:
        of_kind = record["items_of_kind"]
        _print_quantiles(of_kind["quantiles_mm"], f"mm; the {of_kind['n']} shipped items of kind {of_kind['kind']}")


def _print_variants(variants: list[dict[str, Any]]) -> None:
    rows = []
    for variant in variants:
        sizes = [_mm(variant["sizes"][axis]["mm"]) if axis in variant["sizes"] else "" for axis in AXES]
        rows.append((variant["name"], *sizes, variant["region"], variant["years"], variant["document"]))
    print_table(["variant", *AXES, "region", "years", "document"], rows, title="variants, mm")


def _print_quantiles(quantiles: dict[str, dict[str, float]], title: str) -> None:
    rows = [(dim, *map(_mm, q.values())) for dim, q in quantiles.items()]
    print_table(["dimension", *(f"{q:.0%}" for q in QUANTILES)], rows, title=title)


def _mm(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"

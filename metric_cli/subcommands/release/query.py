"""`metric-tree query NAME`: the record of a category."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from metric_base.errors import InputError
from metric_cli.parser import OutputFile, add_tree, add_units
from metric_cli.tables import print_json, print_table, size_format
from metric_tree.axes import AXES
from metric_tree.context import where_of
from metric_tree.node import Node
from metric_tree.prior import QUANTILES
from metric_tree.release.schema import IMAGES
from metric_tree.reports.description import item_quantiles
from metric_tree.reports.node_record import node_record
from metric_tree.reports.stated_axes import axis_names, stated_size
from metric_tree.tree import open_tree

HELP = "A category: its node, path, counts, evidence, quantiles and prior; JSON is in millimetres."

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
    add("--sheet", metavar="FILE.png", type=OutputFile(), help="draw these images to a common scale (default: 12)")
    add_units(parser)
    add_tree(parser)


def run(arguments: argparse.Namespace) -> None:
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
        _print(record, node, arguments.units)


def _print(record: dict[str, Any], node: Node, unit: str) -> None:
    prior = record["prior"]
    medians = {dim: quantiles["0.5"] for dim, quantiles in (record["quantiles_mm"] or {}).items()}
    write = size_format(medians.values(), unit)
    size = stated_size(node, {dim: str(write(mm)) for dim, mm in medians.items()}, unit) if medians else None
    shares = sorted(prior["share_by_kind"].items(), key=lambda entry: -entry[1]) if prior else ()
    licences = record["shipped"]["licence"].items()
    norms = record["norm"].split("; ") if record["norm"] else ()
    rows = [
        ("node", record["node"]),
        ("note", record["note"]),
        ("path", " > ".join(record["path"])),
        ("pose", record["pose"]),
        ("height", record["height_is"]),
        ("unknown", record["unknown_axes"]),
        ("items", record["n_items"]),
        ("tier", record["tier"] or "none"),
        *(("norm", norm) for norm in norms),
        ("in words", record["sentence"] or "nothing is known of its size"),
        ("size", size),
        ("where", record["where"]),
        ("state", record["plain_state"]),
        *(
            (name, "judged: " + stated_size(node, {dim: str(write(q["0.5"])) for dim, q in sizes.items()}, unit))
            for name, sizes in record["states_mm"].items()
        ),
        ("evidence", ", ".join(f"{kind} {share:.0%}" for kind, share in shares) or "none"),
        ("licences", ", ".join(f"{name} ({n})" for name, n in licences) or "none"),
        ("children", ", ".join(record["children"]) or "none"),
        ("tree", f"{record['tree']['name']} {record['tree']['version']}"),
    ]
    optional = {"note", "height", "unknown", "where", "state", "size"}
    print_table(["", ""], [row for row in rows if row[1] or row[0] not in optional], title=record["name"])
    if "images" in record:
        columns = ("image_id", "item_id", "cutout_path", "licence", "source_url")
        print_table(columns, [[row[name] for name in columns] for row in record["images"]], title="pictures")
    if record["variants"]:
        _print_variants(record["variants"], node, unit)
    if prior is None:
        print_table(["prior"], [("none: no item with a size at or below this node",)])
        return
    counted = f"{prior['n']} items, {prior['n_sources']} sources, {prior['borrowed']:.0%} borrowed from the parent"
    names = axis_names(node)
    _print_quantiles(record["quantiles_mm"], f"{record['tier']}, {unit}; {counted}", names, unit)
    if "items_of_kind" in record:
        of_kind = record["items_of_kind"]
        title = f"{unit}; the {of_kind['n']} shipped items of kind {of_kind['kind']}"
        _print_quantiles(of_kind["quantiles_mm"], title, names, unit)


def _print_variants(variants: list[dict[str, Any]], node: Node, unit: str) -> None:
    sizes = [[variant["sizes"].get(axis, {}).get("mm") for axis in AXES] for variant in variants]
    write = size_format((mm for row in sizes for mm in row), unit)
    rows = [
        (variant["name"], *(write(mm) or "" for mm in row), variant["region"], variant["years"], variant["document"])
        for variant, row in zip(variants, sizes, strict=True)
    ]
    axes = [axis_names(node).get(axis, axis) for axis in AXES]
    print_table(["variant", *axes, "region", "years", "document"], rows, title=f"variants, {unit}")


def _print_quantiles(
    quantiles: Mapping[str, Mapping[str, float]], title: str, names: Mapping[str, str], unit: str
) -> None:
    write = size_format((mm for sizes in quantiles.values() for mm in sizes.values()), unit)
    rows = [
        (f"{names[dim]} ({dim})" if dim in names else dim, *map(write, sizes.values()))
        for dim, sizes in quantiles.items()
    ]
    print_table(["dimension", *(f"{q:.0%}" for q in QUANTILES)], rows, title=title)

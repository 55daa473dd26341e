"""`metric-tree query NAME`: what the tree knows about a category."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from metric_base.errors import InputError
from metric_cli.parser import OutputFile, add_tree
from metric_cli.tables import print_json, print_table
from metric_tree.context import Where, where_of
from metric_tree.node import Node, NoPrior
from metric_tree.prior import QUANTILES, Prior
from metric_tree.release.schema import IMAGES
from metric_tree.reports.description import is_heterogeneous, item_quantiles, node_sentence, shipped_evidence
from metric_tree.tree import open_tree

HELP = "A category: its node, path, counts, evidence, quantiles in millimetres and prior."

#: Images of a sheet where no number is given.
SHEET_IMAGES = 12


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    add = parser.add_argument
    add("name", metavar="NAME", help="name, synset, alias or detector label")
    add("--dims", help="dimensions, with commas: length,width,height or extent1,extent2,extent3")
    add("--where", metavar="PLACE,YEAR", help="for a place and a year: germany, europe,2011")
    add("--vocabulary", help="read NAME as this label list does (coco_80, lvis_v1, ...)")
    add("--at-least", metavar="TIER", help="refuse a size that rests on less: norm, measured, few, ...")
    add("--kind", help="also the sizes of the shipped items of this kind: product, measured, ...")
    add("--images", metavar="N", type=int, help="name N pictures, spread over the sizes")
    add("--sheet", metavar="FILE.png", type=OutputFile(), help="draw them to one scale (12 unless --images)")
    add_tree(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print the node and its prior."""
    tree = open_tree(arguments.tree)
    node = tree.find(arguments.name, arguments.vocabulary, at_least=arguments.at_least)
    dims = tuple(arguments.dims.split(",")) if arguments.dims else None
    description = summary(node, dims, where_of(arguments.where) if arguments.where is not None else None)
    description["note"] = tree.resolve(arguments.name, arguments.vocabulary).note
    if arguments.kind is not None:
        description["items_of_kind"] = item_quantiles(node, arguments.kind, QUANTILES)
    if arguments.images is not None or arguments.sheet is not None:
        description["images"] = _images(node, arguments.images, arguments.sheet)
    if arguments.json:
        print_json(description)
    else:
        _print(description)
    return 0


def summary(node: Node, dims: tuple[str, ...] | None = None, where: Where | None = None) -> dict[str, Any]:
    """The node as the JSON of the command; `prior` is null where the node has none and no `dims` were asked for."""
    try:
        prior = node.prior(dims, where)
    except NoPrior:
        if dims is not None:
            raise
        prior = None
    return {
        "schema": "metric-tree/query/1",
        "tree": {"name": node.tree.name, "version": node.tree.version},
        "node": node.node_id,
        "name": node.name,
        "path": list(node.path),
        "level": node.level,
        "pose": node.pose,
        "height_is": node.height_is,
        "n_items": node.n_items,
        "children": [child.node_id for child in node.children],
        "dims": list(prior.dims) if prior else list(node.dims),
        "tier": prior.tier if prior else None,
        "tier_evidence": prior.evidence.record() if prior and prior.evidence else None,
        "norm": prior.norm if prior else None,
        "where": prior.note if prior else None,
        "contexts": {"regions": list(node.contexts.regions), "years": list(node.contexts.years)},
        "sentence": node_sentence(node, node.name.partition(" (")[0], prior) if prior else None,
        "mixed": is_heterogeneous(node, prior) if prior else None,
        "shipped": shipped_evidence(node),
        "plain_state": node.plain_state,
        "states_mm": {name: _quantiles(state) for name, state in node.states.items()},
        "quantiles_mm": _quantiles(prior) if prior else None,
        "prior": _prior_record(prior) if prior else None,
    }


def _images(node: Node, count: int | None, sheet: Path | None) -> list[dict[str, Any]]:
    """The fields of images that a person needs to use and to credit them; drawn where a sheet is asked for."""
    from metric_tree.reports.contact_sheet import image_rows, write_sheet

    if count is not None and count < 1:
        raise InputError(f"--images: expected a number from 1; found {count}")
    wanted = count or SHEET_IMAGES
    rows = write_sheet(sheet, node, wanted) if sheet is not None else image_rows(node, wanted)
    return [{name: row[name] for name in (*IMAGES.names, "extents_mm")} for row in rows]


def _quantiles(prior: Prior) -> dict[str, dict[str, float]]:
    table = prior.quantiles(QUANTILES).T
    return {
        dim: {f"{q:g}": round(float(value), 2) for q, value in zip(QUANTILES, row, strict=True)}
        for dim, row in zip(prior.dims, table, strict=True)
    }


def _prior_record(prior: Prior) -> dict[str, Any]:
    return {
        "family": "lognormal-mixture",
        "weights": prior.weights.tolist(),
        "means": prior.means.tolist(),
        "covariances": prior.covariances.tolist(),
        "shared_covariance": prior.shared_covariance.tolist(),
        "n": prior.n,
        "n_sources": prior.n_sources,
        "share_by_kind": prior.share_by_kind,
        "borrowed": prior.borrowed,
    }


def _print(description: dict[str, Any]) -> None:
    print_table(
        ["", ""],
        [
            ("node", description["node"]),
            *([("note", description["note"])] if description["note"] else []),
            ("path", " > ".join(description["path"])),
            ("pose", description["pose"]),
            *([("height", description["height_is"])] if description["height_is"] else []),
            ("items", description["n_items"]),
            ("tier", description["tier"] or "none"),
            *((("norm", one) for one in description["norm"].split("; ")) if description["norm"] else ()),
            ("in words", description["sentence"] or "nothing is known of its size"),
            *([("where", description["where"])] if description["where"] else []),
            *([("state", description["plain_state"])] if description["plain_state"] else []),
            *((name, _state(sizes)) for name, sizes in description["states_mm"].items()),
            ("evidence", _shares(description)),
            ("licences", ", ".join(f"{name} ({n})" for name, n in description["shipped"]["licence"].items()) or "none"),
            ("children", ", ".join(description["children"]) or "none"),
            ("tree", f"{description['tree']['name']} {description['tree']['version']}"),
        ],
        title=description["name"],
    )
    if "images" in description:
        columns = ("image_id", "item_id", "cutout_path", "licence", "source_url")
        print_table(columns, [[row[name] for name in columns] for row in description["images"]], title="pictures")
    if description["prior"] is None:
        print_table(["prior"], [("none: no item with a size at or below this node",)])
        return
    prior = description["prior"]
    counted = f"{prior['n']} items, {prior['n_sources']} sources, {prior['borrowed']:.0%} borrowed from the parent"
    title = f"{description['tier']}, mm; {counted}"
    _print_quantiles(description["quantiles_mm"], title)
    if "items_of_kind" in description:
        own = description["items_of_kind"]
        _print_quantiles(own["quantiles_mm"], f"mm; the {own['n']} shipped items of kind {own['kind']}")


def _print_quantiles(quantiles: dict[str, dict[str, float]], title: str) -> None:
    rows = [(dim, *map(_mm, q.values())) for dim, q in quantiles.items()]
    print_table(["dimension", *(f"{q:.0%}" for q in QUANTILES)], rows, title=title)


def _mm(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def _state(sizes: dict[str, dict[str, float]]) -> str:
    """The median size of a state by its axes."""
    return "judged: " + " x ".join(_mm(q["0.5"]) for q in sizes.values()) + f" mm ({', '.join(sizes)})"


def _shares(description: dict[str, Any]) -> str:
    """The kinds of evidence of the fit by their share, the largest first."""
    shares = description["prior"]["share_by_kind"] if description["prior"] else {}
    return ", ".join(f"{kind} {share:.0%}" for kind, share in sorted(shares.items(), key=lambda one: -one[1])) or "none"

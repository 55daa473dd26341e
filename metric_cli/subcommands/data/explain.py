"""`metric-tree explain ITEM_ID RAW...`: from an item to its category: the source's words, the rule, the decisions."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from metric_base.errors import InputError
from metric_base.input_files import read_text
from metric_cli.parser import add_tree, input_path
from metric_cli.tables import print_json, print_table
from metric_tree.tree import Tree, open_tree

if TYPE_CHECKING:
    from crawler.items import RawItem

HELP = "Why an item is in its category: source words, the matching rule, decisions, the path, and what the build did."

SCHEMA = "metric-tree/explain/1"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the subcommand."""
    parser.add_argument("item", metavar="ITEM_ID", help="<source>:<source_id>, as in a release's items")
    parser.add_argument("raw", metavar="RAW", nargs="*", type=input_path, help="raw items to look for its words in")
    parser.add_argument(
        "--log", metavar="DIR", type=input_path, help="log of the build (DIR.build): why it refused the item"
    )
    add_tree(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print the way from the source's words to the node."""
    tree = open_tree(arguments.tree)
    row = _shipped_row(tree, arguments.item)
    raw = _raw_item(arguments.item, arguments.raw)
    if row is None and raw is None:
        where = " nor in the raw items" if arguments.raw else "; name the raw items to look further"
        raise InputError(
            f"item: expected an item of {tree.name} {tree.version}; found {arguments.item!r} not there{where}"
        )
    explanation = {"schema": SCHEMA, "item": arguments.item, "words": _words(raw, row), "match": _match(raw, row)}
    explanation["release"] = _release_part(tree, row) if row else _absence(tree, arguments.item, arguments.log)
    if arguments.json:
        print_json(explanation)
    else:
        for part in ("words", "match", "release"):
            print_table([part, ""], [(name, _cell(value)) for name, value in explanation[part].items()])
    return 0


def _shipped_row(tree: Tree, item_id: str) -> dict[str, Any] | None:
    """The item's row in the release; None if it is not shipped."""
    table = tree.release.table("items")
    places = table["item_id"].to_pylist()
    return table.slice(places.index(item_id), 1).to_pylist()[0] if item_id in places else None


def _raw_item(item_id: str, files: list[Path]) -> RawItem | None:
    """The raw item of an id; the sources that a build reads name each item by source and source_id."""
    if not files:
        return None
    from metric_tree.pipeline.ingest import blocks, items_of, raw_files

    every = (item for block in blocks(raw_files(files)) for item in items_of(block))
    return next((item for item in every if f"{item.source}:{item.source_id}" == item_id), None)


def _words(raw: RawItem | None, row: dict[str, Any] | None) -> dict[str, Any]:
    """What the source states about the item."""
    if raw is None:
        return {"source": row["source"], "title": row["title"]} if row else {}
    path = " > ".join(raw.category_path)
    return {"source": raw.source, "title": raw.title, "category_path": path, "synset": raw.synset, "kind": raw.kind}


def _match(raw: RawItem | None, row: dict[str, Any] | None) -> dict[str, Any]:
    """The concept that the matcher gives the words, its rule and score, and all decisions on the subject."""
    from taxonomy.matching.decisions import NONE, decisions
    from taxonomy.matching.matcher import default_matcher

    if raw is not None:
        source, path, title, synset = raw.source, raw.category_path, raw.title, raw.synset
    elif row is not None:
        source, path, title, synset = row["source"], (), row["title"], None
    else:
        return {}
    finding = default_matcher().finding(source, path, title, synset)
    subjects = {f"{source}: {finding.subject}", f"*: {finding.subject}"}
    said = [f"{one.decision or NONE} ({one.reviewer}, {one.when})" for one in decisions() if one.subject in subjects]
    return {
        "subject": finding.subject,
        "concept": finding.concept,
        "rule": finding.rule,
        "score": round(finding.score, 3),
        "reason": finding.reason,
        "decisions": said,
        "settled": finding.settled,
    }


def _absence(tree: Tree, item_id: str, log: Path | None) -> dict[str, Any]:
    """Why the release does not show an item: its source is withheld, or the build refused it."""
    source = item_id.partition(":")[0]
    withheld = any(one["id"] == source and one["withheld"] for one in tree.release.manifest["sources"])
    refusal = _refusal(item_id, log / "quarantine.jsonl") if log is not None else None
    if refusal is not None:
        why = f"refused: {refusal['reason']}"
    elif withheld:
        why = "its source is withheld: rows count in the fit and do not ship"
    else:
        why = "not among its items; the log of its build (--log) says what was refused"
    return {"release": f"{tree.name} {tree.version}", "shipped": False, "why": why}


def _refusal(item_id: str, file: Path) -> dict[str, Any] | None:
    """The record of an item among those that a build refused."""
    lines = read_text(file, may_be_empty=True).split("\n")
    try:
        records = [json.loads(line) for line in lines if line.strip()]
        return next((one for one in records if f"{one['source']}:{one['source_id']}" == item_id), None)
    except (ValueError, KeyError, TypeError, RecursionError):
        raise InputError(f"{file}: expected refused items as a build writes them; found others") from None


def _release_part(tree: Tree, row: dict[str, Any]) -> dict[str, Any]:
    """The item's place in the release and the doubts that the build noted."""
    sizes = {name: row[name] for name in ("length_mm", "width_mm", "height_mm", "extents_mm")}
    return {
        "release": f"{tree.name} {tree.version}",
        "shipped": True,
        "node": row["node_id"],
        "path": list(tree.node(row["node_id"]).path),
        **sizes,
        "height_is": tree.node(row["node_id"]).height_is,
        "flags": row["flags"] or [],
        "licence": row["licence"],
        "url": row["url"],
    }


def _cell(value: object) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else "" if value is None else str(value)

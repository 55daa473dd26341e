"""Explain the category of an item: words of its source, matching rule, decisions, and position in the release."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from crawler.items import raw_items
from metric_base.errors import InputError
from metric_base.input_files import read_text
from metric_tree.pipeline.ingest import raw_files
from metric_tree.tree import Tree
from taxonomy.matching.decisions import EVERY_SOURCE, NONE, decisions
from taxonomy.matching.matcher import default_matcher


def explanation(tree: Tree, item_id: str, raw: Sequence[Path] = (), log: Path | None = None) -> dict[str, Any]:
    """Return the words, the match and the position of an item, as `metric-tree/explain/1`.

    Parameters
    ----------
    tree : Tree
        A release.
    item_id : str
        `<source>:<source_id>`, as in the items of a release.
    raw : sequence of Path
        Raw items (files or folders) that are searched for the item.
    log : Path, optional
        Log folder of the build, with the items that it rejected.

    Raises
    ------
    InputError
        Neither the release nor the raw items have the item, or a file cannot be read.
    """
    table = tree.release.table("items")
    ids = table["item_id"].to_pylist()
    row = table.slice(ids.index(item_id), 1).to_pylist()[0] if item_id in ids else None
    all_items = (item for file in raw_files(raw) for item in raw_items(file))
    item = next((item for item in all_items if item.identity == item_id), None)
    if item is not None:
        words = {name: getattr(item, name) for name in ("source", "title", "category_path", "synset", "kind")}
        words["category_path"] = " > ".join(item.category_path)
        match = match_record(item.source, item.category_path, item.title, item.synset)
    elif row is not None:
        words = {"source": row["source"], "title": row["title"]}
        match = match_record(row["source"], (), row["title"], None)
    else:
        hint = " nor in the raw items" if raw else "; name the raw items to look further"
        expected = f"an item of {tree.name} {tree.version}"
        raise InputError(f"item: expected {expected}; found {item_id!r} not there{hint}")
    record = {"schema": "metric-tree/explain/1", "item": item_id, "words": words, "match": match}
    release = f"{tree.name} {tree.version}"
    if row is None:
        why = reason_of_absence(tree, item_id, log)
        return record | {"release": {"release": release, "shipped": False, "why": why}}
    node = tree.node(row["node_id"])
    shown = {name: row[name] for name in ("length_mm", "width_mm", "height_mm", "extents_mm")}
    shown |= {"height_is": node.height_is, "flags": row["flags"] or [], "licence": row["licence"], "url": row["url"]}
    place = {"release": release, "shipped": True, "node": row["node_id"], "path": list(node.path)}
    return record | {"release": place | shown}


def match_record(source: str, path: tuple[str, ...], title: str, synset: str | None) -> dict[str, Any]:
    """Return the concept of the words of a source with its rule and score, and all decisions about these words."""
    finding = default_matcher().finding(source, path, title, synset)
    subjects = {f"{source}: {finding.subject}", f"{EVERY_SOURCE}: {finding.subject}"}
    return {
        "subject": finding.subject,
        "concept": finding.concept,
        "rule": finding.rule,
        "score": round(finding.score, 3),
        "reason": finding.reason,
        "decisions": [
            f"{decision.decision or NONE} ({decision.reviewer}, {decision.when})"
            for decision in decisions()
            if decision.subject in subjects
        ],
        "settled": finding.settled,
    }


def reason_of_absence(tree: Tree, item_id: str, log: Path | None = None) -> str:
    """Return why a release does not publish an item: the build rejected it, or its source is withheld."""
    if log is not None:
        file = log / "quarantine.jsonl"
        lines = read_text(file, may_be_empty=True).split("\n")
        try:
            records = [json.loads(line) for line in lines if line.strip()]
            for record in records:
                if f"{record['source']}:{record['source_id']}" == item_id:
                    return f"refused: {record['reason']}"
        except (ValueError, KeyError, TypeError, RecursionError):
            raise InputError(f"{file}: expected refused items as a build writes them; found others") from None
    source = item_id.partition(":")[0]
    if any(record["id"] == source and record["withheld"] for record in tree.release.manifest["sources"]):
        return "its source is withheld: rows count in the fit and do not ship"
    return "not among its items; the log of its build (--log) says what was refused"

"""What a build writes beside its tables: pictures, README, LICENSE, successors, and the log that a maintainer reads."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from collections.abc import Container, Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from metric_base.files import whole_file
from metric_tree.axes import AXES
from metric_tree.build.successors import former_nodes, successor_table
from metric_tree.build.texts import licence_text, readme_text
from metric_tree.curated.sizes import curated_heights, curated_ranges, curated_states, norms
from metric_tree.fit.class_prior import NEW_SOURCE
from metric_tree.pipeline.ingest import believed_spread
from metric_tree.release.images import collect_pictures, picture_files
from taxonomy.levels import replaced_ids

__all__ = ["add_pictures", "height_records", "state_records", "write_log", "write_texts", "writers"]


def state_records(nodes: Container[str]) -> dict[str, list[dict[str, Any]]]:
    """The states of the release's nodes, as the manifest has them (`metric_tree.states`)."""
    records: dict[str, list[dict[str, Any]]] = {}
    for one in curated_states():
        ends = dict(zip(AXES, zip(one.low, one.typical, one.high, strict=True), strict=True))
        known = {axis: (low, mid, high) for axis, (low, mid, high) in ends.items() if low and mid and high}
        believed = {axis: believed_spread(low, high) for axis, (low, _, high) in known.items()}
        spreads = {axis: round(sd * float(NEW_SOURCE.factor(0, sd)) ** 0.5, 4) for axis, sd in believed.items()}
        sizes = {axis: typical for axis, (_, typical, _) in known.items()}
        record = {"state": one.state, "plain": one.plain, "size_mm": sizes, "sd_log": spreads, "reason": one.reason}
        if one.node_id in nodes:
            records.setdefault(one.node_id, []).append(record)
    return dict(sorted(records.items()))


def height_records(nodes: Container[str]) -> dict[str, dict[str, Any]]:
    """What the heights of the release's hollow nodes are, as the manifest has them (`Node.height_is`)."""
    return {
        one.node_id: {"height": one.height, "underside_seen": one.underside_seen, "reason": one.reason}
        for one in sorted(curated_heights(), key=lambda one: one.node_id)
        if one.node_id in nodes
    }


def writers() -> list[dict[str, Any]]:
    """Who wrote the norms and the judged ranges, when, and how many rows."""
    counts = Counter(
        (table, row.reviewer, row.written)
        for table, rows in (("norms.csv", norms()), ("ranges.csv", curated_ranges()))
        for row in rows
    )
    return [
        {"table": table, "writer": writer, "date": date, "rows": n}
        for (table, writer, date), n in sorted(counts.items())
    ]


def write_texts(folder: Path, tables: Mapping[str, pa.Table], manifest: Mapping[str, Any], *, former: bool) -> None:
    """README and LICENSE, and with `former` the successors of the ids of earlier releases."""
    rows = {name: table.num_rows for name, table in tables.items()}
    (folder / "README.md").write_text(readme_text(manifest, rows), encoding="utf-8")
    (folder / "LICENSE").write_text(licence_text(manifest), encoding="utf-8")
    if former:
        table = successor_table(
            former_nodes(), frozenset(tables["nodes.parquet"]["node_id"].to_pylist()), replaced_ids()
        )
        pq.write_table(table, folder / "successors.parquet", compression="zstd")


def add_pictures(raw: Sequence[Path], tables: dict[str, pa.Table], report: dict[str, Any], folder: Path) -> None:
    """Put the pictures that lie beside the raw items into the tables, the report and a folder."""
    files = picture_files(raw)
    if not files:
        return
    pictures = collect_pictures(files, tables["items.parquet"], folder)
    tables["images.parquet"] = pictures.rows
    report["pictures"] = {"taken": pictures.rows.num_rows, "left_out": dict(pictures.refused)}


def write_log(log: Path, work: Path, content: Mapping[str, Any]) -> None:
    """`quarantine.jsonl` of the refused rows in a work folder, and `report.json`."""
    with whole_file(log / "quarantine.jsonl", "--log") as place, place.open("wb") as quarantine:
        for path in sorted(work.glob("*.refused"), reverse=True):  # ingest first, then clean
            with path.open("rb") as part:
                shutil.copyfileobj(part, quarantine)
    with whole_file(log / "report.json", "--log") as place:
        place.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")

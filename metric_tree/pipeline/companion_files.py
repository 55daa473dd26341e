"""Files of a build next to its tables: images, README, LICENSE, successors of earlier ids, and the log.

`successors.parquet` maps each id of an earlier release to a node of the new one. README.md describes the tables, and
LICENSE lists the licence and the attribution of each source.
"""

from __future__ import annotations

import json
import shutil
from collections import Counter
from collections.abc import Collection, Container, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import pyarrow as pa
import pyarrow.parquet as pq

from metric_base.errors import InputError
from metric_base.files import whole_file
from metric_base.folders import taxonomy_directory
from metric_base.records import read_csv
from metric_base.remote import fetched, is_remote
from metric_tree.curated.sizes import curated_heights, curated_ranges, curated_states, norms
from metric_tree.fit.class_prior import NEW_SOURCE
from metric_tree.pipeline.ingest import widened_sd
from metric_tree.release.images import collect_images, image_record_files
from metric_tree.release.schema import SUCCESSORS
from taxonomy.levels import BadLevels, replaced_ids

#: README and LICENSE of a release, with placeholders of `str.format`.
_TEMPLATES = Path(__file__).with_name("templates")


#: Ids of releases before 4.0.0 that are of another sense in WordNet, and the ids of the sense that was meant.
OTHER_SENSES = {"mace.n.01": "mace.n.04", "viola.n.01": "viola.n.03", "writing_desk.n.01": "writing_desk.n.02"}


class FormerNode(msgspec.Struct, frozen=True):
    """A node of an earlier release, a row of `former_ids.csv`; the root has no parent."""

    release: str
    node_id: str
    parent_id: str | None = None


def former_nodes(path: Path | None = None) -> list[FormerNode]:
    """Return the nodes of releases 1.0.0 and 2.0.0, and those of 3.0.0 that are gone (`former_ids.csv`)."""
    table = path or taxonomy_directory() / "generated" / "former_ids.csv"
    return [row for _, row in read_csv(table, FormerNode, BadLevels)]


def successor_table(former: Collection[FormerNode], nodes: Collection[str], replaced: Mapping[str, str]) -> pa.Table:
    """Return the successor of each earlier id: the id itself, its replacement, or the successor of its parent.

    Parameters
    ----------
    former : collection of FormerNode
        Nodes of earlier releases.
    nodes : collection of str
        Ids of the new release.
    replaced : mapping
        Replacements of ids.

    Returns
    -------
    Table
        Columns `old_id`, `release`, `node_id`.

    Raises
    ------
    InputError
        A node and all its ancestors have no successor.
    """
    parents = {(one.release, one.node_id): one.parent_id for one in former}
    of_any_release = {one.node_id: one.parent_id for one in former}

    def successor(release: str, node_id: str) -> str:
        current: str | None = node_id
        while current is not None:
            following = replaced.get(current, current)
            for candidate in (current, following, f"{following}/other", current.removesuffix("/other")):
                if candidate in nodes:
                    return candidate
            current = parents.get((release, current), of_any_release.get(current))
        raise InputError(f"former_ids.csv: {node_id} of {release}: neither the node nor an ancestor has a successor")

    rows = [
        {"old_id": one.node_id, "release": one.release, "node_id": successor(one.release, one.node_id)}
        for one in sorted(former, key=lambda one: (one.release, one.node_id))
    ]
    return pa.Table.from_pylist(rows, schema=SUCCESSORS)


def state_records(nodes: Container[str]) -> dict[str, list[dict[str, Any]]]:
    """Return the states of the nodes of the release, as in the manifest (`metric_tree.node.State`)."""
    records: dict[str, list[dict[str, Any]]] = {}
    for one in curated_states():
        widened = {axis: widened_sd(low, high) for axis, (low, _, high) in one.ends.items()}
        spreads = {axis: round(sd * float(NEW_SOURCE.factor(0, sd)) ** 0.5, 4) for axis, sd in widened.items()}
        sizes = {axis: typical for axis, (_, typical, _) in one.ends.items()}
        record = {"state": one.state, "plain": one.plain, "size_mm": sizes, "sd_log": spreads, "reason": one.reason}
        if one.node_id in nodes:
            records.setdefault(one.node_id, []).append(record)
    return dict(sorted(records.items()))


def height_records(nodes: Container[str]) -> dict[str, dict[str, Any]]:
    """Return the definitions of height of the nodes of the release, as in the manifest (`Node.height_is`)."""
    return {
        one.node_id: {"height": one.height, "underside_seen": one.underside == "seen", "reason": one.reason}
        | ({"extent": one.extent} if one.extent else {})
        for one in sorted(curated_heights(), key=lambda one: one.node_id)
        if one.node_id in nodes
    }


def writers() -> list[dict[str, Any]]:
    """Return writer, date and number of rows of the norms and the judged ranges."""
    tables = (("norms.csv", norms()), ("ranges.csv", curated_ranges()))
    counts = Counter((table, row.reviewer, row.written) for table, rows in tables for row in rows)
    return [{"table": of[0], "writer": of[1], "date": of[2], "rows": n} for of, n in sorted(counts.items())]


def write_texts(folder: Path, tables: Mapping[str, pa.Table], manifest: Mapping[str, Any], *, former: bool) -> None:
    """Write README and LICENSE, and with `former` the successors of the ids of earlier releases."""
    rows = {name: table.num_rows for name, table in tables.items()}
    in_each_row = "author in the column `attribution`"
    shown = (record for record in manifest["sources"] if record["n_rows"])
    attributions = (f"- {one['id']} ({one['licence']}): {one['attribution'] or in_each_row}" for one in shown)
    values = {"manifest": manifest, "rows": rows, "attributions": "\n".join(attributions)}
    for template in _TEMPLATES.iterdir():
        (folder / template.name).write_text(template.read_text(encoding="utf-8").format(**values), encoding="utf-8")
    if former:
        ids = frozenset(tables["nodes.parquet"]["node_id"].to_pylist())
        table = successor_table(former_nodes(), ids, {**replaced_ids(), **OTHER_SENSES})
        pq.write_table(table, folder / "successors.parquet", compression="zstd")


def add_images(raw: Sequence[Path], tables: dict[str, pa.Table], report: dict[str, Any], folder: Path) -> None:
    """Add the images next to the raw items to the tables, the report and a folder."""
    folders = (path.parent if is_remote(path) and path.suffix in (".jsonl", ".gz") else path for path in raw)
    files = image_record_files(fetched(path, "/pictures") for path in folders)
    if not files:
        return
    pictures = collect_images(files, tables["items.parquet"], folder)
    tables["images.parquet"] = pictures.rows
    report["pictures"] = {"taken": pictures.rows.num_rows, "left_out": dict(pictures.refused)}


def write_log(log: Path, work: Path, content: Mapping[str, Any]) -> None:
    """Write `quarantine.jsonl` from the refused rows in a work folder, and `report.json`."""
    with whole_file(log / "quarantine.jsonl", "--log") as place, place.open("wb") as quarantine:
        for path in sorted(work.glob("*.refused"), reverse=True):  # ingest first, then clean
            with path.open("rb") as part:
                shutil.copyfileobj(part, quarantine)
    with whole_file(log / "report.json", "--log") as place:
        place.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")

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
from metric_tree.curated.sizes import curated_heights, curated_ranges, curated_states, norms
from metric_tree.fit.class_prior import NEW_SOURCE
from metric_tree.pipeline.ingest import widened_sd
from metric_tree.release.images import collect_images, image_record_files
from metric_tree.release.schema import TABLES
from taxonomy.levels import BadLevels, replaced_ids

#: Columns of `successors.parquet`.
SUCCESSORS = pa.schema([("old_id", pa.string()), ("release", pa.string()), ("node_id", pa.string())])
#: Content of a row of each table, for the README.
_ROW_CONTENT = {
    "nodes.parquet": "a category of the tree",
    "items.parquet": "an item with its size, source and licence",
    "priors.parquet": "a size distribution, with its tier and the counts behind it",
    "images.parquet": "an image of an item",
}


class FormerNode(msgspec.Struct, frozen=True):
    """A node of an earlier release, a row of `former_ids.csv`; the root has no parent."""

    release: str
    node_id: str
    parent_id: str | None = None


def former_nodes(path: Path | None = None) -> list[FormerNode]:
    """Return the nodes of releases 1.0.0 and 2.0.0 (`data/taxonomy/generated/former_ids.csv`)."""
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

    def successor(release: str, node_id: str) -> str:
        current: str | None = node_id
        while current is not None:
            following = replaced.get(current, current)
            for candidate in (current, following, f"{following}/other", current.removesuffix("/other")):
                if candidate in nodes:
                    return candidate
            current = parents.get((release, current))
        raise InputError(f"former_ids.csv: {node_id} of {release}: neither the node nor an ancestor has a successor")

    rows = [
        {"old_id": one.node_id, "release": one.release, "node_id": successor(one.release, one.node_id)}
        for one in sorted(former, key=lambda one: (one.release, one.node_id))
    ]
    return pa.Table.from_pylist(rows, schema=SUCCESSORS)


def readme_text(manifest: Mapping[str, Any], rows: Mapping[str, int]) -> str:
    """Return the README of a release; rows : number of rows of each table."""
    lines = [
        f"# {manifest['name']} {manifest['version']}",
        "",
        f"Object sizes by category, of {manifest['created']}. A release is never changed once published.",
        "",
        "| file | one row is | rows |",
        "|---|---|---|",
        *(f"| `{name}` | {_ROW_CONTENT[name]} | {rows[name]} |" for name in TABLES),
        "| `successors.parquet` | an id of an earlier release and the node that it leads to | |",
        "| `manifest.json` | sources, counts, models of the evidence, checksums of every file | |",
        "",
        "Columns and units are in the schemas of the tables; lengths are in mm, priors over ln mm. `tier` is the",
        "evidence of a size: norm, measured, few, models, borrowed, judged. A language model wrote judged ranges and",
        "norms: `judged_by` in the manifest has names and dates. Each row has its licence; LICENSE has attributions.",
        "",
        "```python",
        "import metric_tree",
        "",
        f'tree = metric_tree.open("{manifest["version"]}")  # or the path of this folder',
        "```",
    ]
    return "\n".join(lines) + "\n"


def licence_text(manifest: Mapping[str, Any]) -> str:
    """Return the LICENSE of a release: licence and attribution of each source."""
    shown = [record for record in manifest["sources"] if record["n_rows"]]
    lines = [
        "Each row of items.parquet and images.parquet has its licence in the column `licence`. Norms, judged ranges,",
        "nodes and priors are part of this project, under the Apache License 2.0",
        "(https://www.apache.org/licenses/LICENSE-2.0).",
        "",
        "Attribution:",
        "",
        *(
            f"- {record['id']} ({record['licence']}): "
            f"{record['attribution'] or 'author in the attribution field of each row'}"
            for record in shown
        ),
    ]
    return "\n".join(lines) + "\n"


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
    """Return the definitions of height of the hollow nodes of the release, as in the manifest (`Node.height_is`)."""
    return {
        one.node_id: {"height": one.height, "underside_seen": one.underside_seen, "reason": one.reason}
        for one in sorted(curated_heights(), key=lambda one: one.node_id)
        if one.node_id in nodes
    }


def writers() -> list[dict[str, Any]]:
    """Return writer, date and number of rows of the norms and the judged ranges."""
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
    """Write README and LICENSE, and with `former` the successors of the ids of earlier releases."""
    rows = {name: table.num_rows for name, table in tables.items()}
    (folder / "README.md").write_text(readme_text(manifest, rows), encoding="utf-8")
    (folder / "LICENSE").write_text(licence_text(manifest), encoding="utf-8")
    if former:
        table = successor_table(
            former_nodes(), frozenset(tables["nodes.parquet"]["node_id"].to_pylist()), replaced_ids()
        )
        pq.write_table(table, folder / "successors.parquet", compression="zstd")


def add_pictures(raw: Sequence[Path], tables: dict[str, pa.Table], report: dict[str, Any], folder: Path) -> None:
    """Add the images next to the raw items to the tables, the report and a folder."""
    files = image_record_files(raw)
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

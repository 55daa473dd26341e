"""A release as a folder for a data hub or an archive: tables, data card, licences, checksums, Croissant, datasheet.

Each table is alone in a folder of its name, so that `pandas.read_parquet`, `pyarrow.dataset` and SQL read the folder.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from metric_base.arrays import grouped
from metric_base.files import whole_folder
from metric_base.records import csv_text
from metric_tree.prior import QUANTILES, Prior
from metric_tree.release.images import link_images
from metric_tree.release.release import MANIFEST, sha256
from metric_tree.release.schema import SUCCESSORS, table_schema
from metric_tree.release.terms import OWN_LICENCE, basis
from metric_tree.tree import Tree

#: Tables of a publication with the content of a row; the first is the default of data hubs.
TABLES = {
    "sizes": "the size of a category, of a variant or of a state of it, along one axis: quantiles in mm",
    "nodes": "a category and its place in the tree",
    "items": "a physical item with its size, source, licence and attribution",
    "priors": "a fitted size distribution over ln mm",
    "images": "an image of an item",
    "successors": "an id of an earlier release and the node that replaces it",
}
SIZES = table_schema("sizes")

_ADDRESS = "https://github.com/metric-tree/metric-tree"

#: Texts of a publication by file name, with placeholders of `str.format`.
_TEMPLATES = Path(__file__).with_name("templates")

#: Terms of Croissant 1.0, from its specification.
_CONTEXT = Path(__file__).with_name("croissant_context.json")

#: Croissant types by Arrow type.
_CROISSANT_TYPES = {"string": "sc:Text", "double": "sc:Float"} | dict.fromkeys(("int64", "int32", "int8"), "sc:Integer")


_SOURCE = ("id", "title", "url", "licence", "attribution", "kind", "n_fit", "n_rows", "withheld", "noncommercial")


def publish(tree: Tree, out: Path) -> list[Path]:
    """Write the publication of a release into a new folder, and return its files.

    Raises
    ------
    InputError
        `out` exists.
    """
    with whole_folder(out, "DIR") as work:
        for name in TABLES:
            table = _table(tree, name)
            (work / name).mkdir()
            pq.write_table(table, work / name / f"{name}.parquet", compression="zstd", store_schema=False)
        shutil.copyfile(tree.release.directory / MANIFEST, work / MANIFEST)
        link_images(tree.release, work)
        licences = licence_rows(tree)
        (work / "licences.csv").write_bytes(csv_text(("licence", "sources", "rows", "attribution"), licences))
        sources = [[row.get(name) for name in _SOURCE] for row in tree.release.manifest["sources"]]
        (work / "sources.csv").write_bytes(csv_text(_SOURCE, sources))
        croissant = json.dumps(croissant_record(tree, work), indent=1, ensure_ascii=False)
        for name, text in {**texts(tree, licences), "croissant.json": f"{croissant}\n"}.items():
            (work / name).write_text(text, encoding="utf-8")
        files = [path for path in sorted(work.rglob("*")) if path.is_file()]
        checksums = {str(path.relative_to(work)): sha256(path) for path in files}
        lines = "".join(f"{checksum}  {name}\n" for name, checksum in checksums.items())
        (work / "SHA256SUMS").write_text(lines, encoding="utf-8")
    return [out / name for name in (*checksums, "SHA256SUMS")]


def _table(tree: Tree, name: str) -> pa.Table:
    """Return a table of a publication."""
    if name == "sizes":
        return size_table(tree)
    if name == "successors":
        path = tree.release.directory / f"{name}.parquet"
        return pq.ParquetFile(path).read() if path.is_file() else SUCCESSORS.empty_table()
    return without_maps(tree.release.table(name))


def size_table(tree: Tree) -> pa.Table:
    """Return the flat table of sizes: a row for each axis of a category, and of its variants and states."""
    rows = []
    for node in tree:
        if not node.prior_dims:
            continue
        shared = {
            "node": node.node_id,
            "name": node.name,
            "path": " > ".join(node.path),
            "aliases": list(node.aliases),
            "pose": node.pose,
            "height_is": node.height_is,
            "licence": OWN_LICENCE,
        }
        sizes: list[tuple[dict[str, Any], Prior]] = [({}, node.prior())]
        for one in node.variants:
            named = {"aliases": one.aliases.split("; ") if one.aliases else [], "variant": one.name}
            sizes.append((named | {"region": one.region, "years": one.years}, replace(node, stated=one.stated).prior()))
        sizes += [({"state": state}, prior) for state, prior in node.states.items()]
        for own, prior in sizes:
            for axis, quantiles in zip(prior.dims, prior.quantiles(QUANTILES).T, strict=True):
                mm = {f"q{100 * q:02.0f}": float(f"{size:.5g}") for q, size in zip(QUANTILES, quantiles, strict=True)}
                rows.append(shared | own | {"tier": prior.tier, "n": prior.n, "axis": axis} | mm)
    return pa.Table.from_pylist(rows, schema=SIZES)


def without_maps(table: pa.Table) -> pa.Table:
    """Return a table with structs instead of maps, which readers of data hubs do not support."""
    for index, field in enumerate(table.schema):
        if pa.types.is_map(field.type):
            maps = [dict(row or ()) for row in table.column(index).to_pylist()]
            keys = sorted({key for row in maps for key in row})
            kind = pa.struct([(key, field.type.item_type) for key in keys])
            values = pa.array([{key: row.get(key, 0.0) for key in keys} for row in maps], kind)
            table = table.set_column(index, pa.field(field.name, kind, metadata=field.metadata), values)
    return table.replace_schema_metadata(None)


def licence_rows(tree: Tree) -> list[tuple[str, str, int, str]]:
    """Return licence, sources, shipped rows and attribution, the most rows first."""
    items = tree.release.table("items").select(["licence", "source"]).to_pydict()
    rows = grouped((licence or "unstated", source) for licence, source in zip(*items.values(), strict=True))
    owed = {row["id"]: row.get("attribution") or row["title"] for row in tree.release.manifest["sources"]}
    counted = [(licence, sorted(set(given)), len(given)) for licence, given in rows.items()]
    counted.sort(key=lambda row: -row[2])
    return [(name, " ".join(given), n, "; ".join(owed.get(one, one) for one in given)) for name, given, n in counted]


def texts(tree: Tree, licences: list[tuple[str, str, int, str]] | None = None) -> dict[str, str]:
    """Return the filled templates: data card for data hubs, datasheet and citation.

    The datasheet answers the questions of Gebru et al. 2021, "Datasheets for Datasets".
    """
    manifest = tree.release.manifest
    configs = "".join(f"- config_name: {name}\n  data_files: {name}/*.parquet\n" for name in TABLES)
    values = {
        "tree": tree,
        "address": _ADDRESS,
        "counts": manifest["counts"],
        "created": manifest["created"],
        "basis": basis(manifest),
        "configs": configs.replace("\n", "\n  default: true\n", 1),
        "tables": "\n".join(f"| `{name}/` | {content} |" for name, content in TABLES.items()),
        "rows": "\n".join(f"| {licence} | {n:,} | {sources} |" for licence, sources, n, _ in licences or ()),
        "n_sources": len(manifest["sources"]),
        "n_withheld": sum(bool(row.get("withheld")) for row in manifest["sources"]),
    }
    return {file.name: file.read_text(encoding="utf-8").format(**values) for file in sorted(_TEMPLATES.iterdir())}


def croissant_record(tree: Tree, work: Path) -> dict[str, Any]:
    """Return Croissant 1.0 metadata: a file for each table, and a record set of its columns with plain values."""
    files, record_sets = [], []
    for name, content in TABLES.items():
        file = {
            "@type": "cr:FileObject",
            "@id": f"{name}/{name}.parquet",
            "name": f"{name}/{name}.parquet",
            "description": f"One row is {content}.",
            "contentUrl": f"{name}/{name}.parquet",
            "encodingFormat": "application/x-parquet",
            "sha256": sha256(work / name / f"{name}.parquet"),
        }
        fields = [
            {
                "@type": "cr:Field",
                "@id": f"{name}/{field.name}",
                "name": field.name,
                "description": (field.metadata or {}).get(b"meaning", field.name.encode()).decode(),
                "dataType": _CROISSANT_TYPES[str(field.type)],
                "source": {"fileObject": {"@id": f"{name}/{name}.parquet"}, "extract": {"column": field.name}},
            }
            for field in pq.read_schema(work / name / f"{name}.parquet")
            if str(field.type) in _CROISSANT_TYPES
        ]
        files.append(file)
        record_set = {"@type": "cr:RecordSet", "@id": name, "name": name, "description": file["description"]}
        record_sets.append({**record_set, "field": fields})
    return {
        "@context": json.loads(_CONTEXT.read_text(encoding="utf-8")),
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": f"{tree.name}",
        "description": "Object sizes by category of WordNet, with a size distribution on every category.",
        "url": _ADDRESS,
        "license": "licences.csv",
        "version": tree.version,
        "datePublished": str(tree.release.manifest["created"]),
        "creator": {"@type": "sc:Organization", "name": "The Metric-Tree contributors"},
        "citeAs": f"{tree.name} {tree.version}, {_ADDRESS}",
        "distribution": files,
        "recordSet": record_sets,
    }

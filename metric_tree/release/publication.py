"""A release as a folder for a data hub or an archive: tables, data card, licences, checksums, Croissant, datasheet."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from metric_base.errors import InputError
from metric_base.files import whole_folder
from metric_base.records import csv_text
from metric_tree.release.images import link_images
from metric_tree.release.release import sha256
from metric_tree.tree import Tree

#: Tables of a publication with the content of a row; data hubs show the first table.
TABLES = {
    "quantiles": "a category: its tier and the quantiles of its sizes in mm",
    "nodes": "a category and its place in the tree",
    "items": "a physical item with its size, source and licence",
    "priors": "a fitted size distribution over ln mm",
    "images": "a picture of an item",
}

_ADDRESS = "https://github.com/metric-tree/metric-tree"

#: Texts of a publication by file name, with placeholders of `str.format`.
_TEMPLATES = Path(__file__).with_name("templates")

#: Terms of Croissant 1.0, from its specification.
_CONTEXT = Path(__file__).with_name("croissant_context.json")

#: Croissant types by Arrow type.
_CROISSANT_TYPES = {
    "string": "sc:Text",
    "double": "sc:Float",
    "int64": "sc:Integer",
    "int32": "sc:Integer",
    "int8": "sc:Integer",
}


_SOURCE = ("id", "title", "url", "licence", "attribution", "kind", "n_fit", "n_rows", "withheld", "noncommercial")


def publish(tree: Tree, out: Path) -> list[Path]:
    """Write the publication of a release into a new folder, and return its files.

    Raises
    ------
    InputError
        `out` exists.
    """
    if out.exists():
        raise InputError(f"{out}: already exists; a publication is written into a new folder")
    with whole_folder(out, "DIR") as work:
        for name in TABLES:
            table = tree.priors() if name == "quantiles" else without_maps(tree.release.table(name))
            pq.write_table(table, work / f"{name}.parquet", compression="zstd", store_schema=False)
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
    rows = Counter(licence or "unstated" for licence in items["licence"])
    sources: dict[str, set[str]] = {}
    for licence, source in zip(items["licence"], items["source"], strict=True):
        sources.setdefault(licence or "unstated", set()).add(source)
    owed = {row["id"]: row.get("attribution") or row["title"] for row in tree.release.manifest["sources"]}
    return [
        (name, " ".join(sorted(sources[name])), n, "; ".join(owed.get(one, one) for one in sorted(sources[name])))
        for name, n in rows.most_common()
    ]


def texts(tree: Tree, licences: list[tuple[str, str, int, str]]) -> dict[str, str]:
    """Return the filled templates: data card for data hubs, datasheet and citation.

    The datasheet answers the questions of Gebru et al. 2021, "Datasheets for Datasets".
    """
    manifest = tree.release.manifest
    values = {
        "tree": tree,
        "address": _ADDRESS,
        "counts": manifest["counts"],
        "created": manifest["created"],
        "configs": "".join(f"- config_name: {name}\n  data_files: {name}.parquet\n" for name in TABLES),
        "tables": "\n".join(f"| `{name}.parquet` | {content} |" for name, content in TABLES.items()),
        "rows": "\n".join(f"| {licence} | {n:,} | {sources} |" for licence, sources, n, _ in licences),
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
            "@id": f"{name}.parquet",
            "name": f"{name}.parquet",
            "description": f"One row is {content}.",
            "contentUrl": f"{name}.parquet",
            "encodingFormat": "application/x-parquet",
            "sha256": sha256(work / f"{name}.parquet"),
        }
        fields = [
            {
                "@type": "cr:Field",
                "@id": f"{name}/{field.name}",
                "name": field.name,
                "description": (field.metadata or {}).get(b"meaning", field.name.encode()).decode(),
                "dataType": _CROISSANT_TYPES[str(field.type)],
                "source": {"fileObject": {"@id": f"{name}.parquet"}, "extract": {"column": field.name}},
            }
            for field in pq.read_schema(work / f"{name}.parquet")
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

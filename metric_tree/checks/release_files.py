"""The coded checks of a release: every rule of `metric-tree/1`, each finding with its code.

E is an error (the release breaks the format), W a warning (a maintainer should look). Codes: 1xx files, 2xx tree,
3xx items, 4xx priors, 5xx images. Each code has a fixture in `tests/metric_tree/checks/test_checks.py`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa

from metric_tree.checks import items, leaves, nodes, priors
from metric_tree.checks.finding import Finding
from metric_tree.release.images import image_path, stored_file
from metric_tree.release.release import BadRelease, Release, open_release, sha256
from metric_tree.release.schema import ADDED_COLUMNS, FORMER_TYPES, TABLES

#: What each code means; `metric-tree validate --codes` prints it.
CODES = {
    "E101": "no readable manifest, or of another schema, or a file is missing or of another size",
    "E102": "a file's sha256 differs from the manifest's",
    "E103": "a table's rows differ from the manifest's",
    "E104": "a table's columns or types differ from the schema",
    "E106": "a picture or a text beside the tables is missing, or its sha256 differs from the manifest's",
    "E105": "counts in the manifest differ from the tables",
    **nodes.CODES,
    **items.CODES,
    **priors.CODES,
    **leaves.CODES,
}


@dataclass(frozen=True, slots=True, eq=False)
class _Tables:
    nodes: pa.Table
    items: pa.Table
    priors: pa.Table
    images: pa.Table


def findings(directory: Path) -> list[Finding]:
    """All findings on a release, errors first."""
    try:
        release = open_release(directory)
    except BadRelease as error:
        return [Finding("E101", str(directory), str(error))]
    damaged = list(_file_findings(release))
    if any(finding.code != "E105" for finding in damaged):  # tables that cannot be trusted are not read further
        return sorted(damaged)
    tables = _Tables(**{name.removesuffix(".parquet"): release.table(name.removesuffix(".parquet")) for name in TABLES})
    return sorted(
        [
            *damaged,
            *_extra_findings(release),
            *_count_findings(release, tables),
            *nodes.findings(tables.nodes),
            *items.findings(tables.items, tables.nodes, release.manifest),
            *priors.findings(tables.priors, tables.nodes),
            *_leaf_findings(release, tables),
            *_image_findings(release, tables),
        ]
    )


def _leaf_findings(release: Release, tables: _Tables) -> Iterator[Finding]:
    """None where the priors themselves are damaged: other codes say so."""
    if not any(finding.is_error for finding in priors.findings(tables.priors, tables.nodes)):
        yield from leaves.findings(tables.nodes, tables.items, tables.priors, release.manifest)


def _file_findings(release: Release) -> Iterator[Finding]:
    for name, schema in TABLES.items():
        recorded = release.manifest["files"][name]
        if (digest := sha256(release.directory / name)) != recorded.get("sha256"):
            yield Finding("E102", name, f"expected sha256 {recorded.get('sha256')}; found {digest}")
            continue
        table = release.unchecked_table(name.removesuffix(".parquet"))
        if table.num_rows != recorded.get("rows"):
            yield Finding("E103", name, f"expected {recorded.get('rows')} rows; found {table.num_rows}")
        for field in schema:
            if field.name not in table.column_names:
                if field.name not in ADDED_COLUMNS:
                    yield Finding("E104", f"{name}: {field.name}", "expected the column; found none")
            elif (own_type := table.schema.field(field.name).type) not in (field.type, FORMER_TYPES.get(field.name)):
                yield Finding("E104", f"{name}: {field.name}", f"expected {field.type}; found {own_type}")


def _extra_findings(release: Release) -> Iterator[Finding]:
    for name, recorded in release.manifest.get("extras", {}).items():
        path = stored_file(release.directory, name)
        digest = "no file" if path is None else sha256(path)
        if digest != recorded:
            yield Finding("E106", name, f"expected sha256 {recorded}; found {digest}")


def _count_findings(release: Release, tables: _Tables) -> Iterator[Finding]:
    parents = set(tables.nodes["parent_id"].to_pylist())
    leaves = sum(node_id not in parents for node_id in tables.nodes["node_id"].to_pylist())
    levels = tables.nodes["level"].to_pylist()
    counts = {
        "nodes": tables.nodes.num_rows,
        "leaves": leaves,
        "levels": max(levels, default=0),
        "n_rows": tables.items.num_rows,
    }
    for name, value in counts.items():
        if release.manifest["counts"].get(name) != value:
            recorded = release.manifest["counts"].get(name)
            yield Finding(
                "E105", f"manifest.json: counts.{name}", f"expected {value} as in the tables; found {recorded}"
            )


def _image_findings(release: Release, tables: _Tables) -> Iterator[Finding]:
    items = set(tables.items["item_id"].to_pylist())
    for row in tables.images.to_pylist():
        image_id, item_id, path, licence = (row[name] for name in ("image_id", "item_id", "path", "licence"))
        if item_id not in items:
            yield Finding("E501", image_id, f"item_id: expected an item of the release; found {item_id!r}")
        for column in ("path", "cutout_path"):
            if row[column] is not None and image_path(release.directory, row, column) is None:
                yield Finding(
                    "E502", image_id, f"{column}: expected a file of the release; found none at {row[column]}"
                )
        if path is not None and (file := image_path(release.directory, row)) and sha256(file) != image_id:
            yield Finding("E504", image_id, f"path: expected bytes of this sha256; found others in {path}")
        if not licence:
            yield Finding("E503", image_id, "licence: expected the picture's terms; found none")


CODES |= {
    "E501": "a picture of an item that the release does not hold",
    "E502": "a picture or cut-out whose file is missing, or lies outside the release and the shared store",
    "E503": "a picture without a licence",
    "E504": "a picture whose bytes are not those that its id names",
}

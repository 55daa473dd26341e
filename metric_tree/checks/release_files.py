"""Coded checks of a release against the format `metric-tree/1`.

E is an error (the release violates the format), W a warning for a maintainer. Codes: 1xx files, 2xx tree, 3xx items,
4xx priors, 5xx images. Each code has a fixture in `tests/metric_tree/checks/test_checks.py`.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa

from metric_base.text_tables import named_texts
from metric_tree.checks import items, leaves, nodes, priors
from metric_tree.checks.finding import Finding
from metric_tree.release.images import image_path, stored_file
from metric_tree.release.release import BadRelease, Release, open_release, sha256
from metric_tree.release.schema import ADDED_COLUMNS, FORMER_TYPES, TABLES

#: Meaning of each code; `metric-tree validate --codes` prints it.
CODES = named_texts(Path(__file__).with_name("codes.txt"))


def findings(directory: Path) -> list[Finding]:
    """Return all findings on a release, errors first."""
    try:
        release = open_release(directory)
    except BadRelease as error:
        return [Finding("E101", str(directory), str(error))]
    damaged = list(_file_findings(release))
    if any(finding.code != "E105" for finding in damaged):  # the content of damaged tables is not checked
        return sorted(damaged)
    tables = {name.removesuffix(".parquet"): release.table(name.removesuffix(".parquet")) for name in TABLES}
    found = [
        *damaged,
        *_extra_findings(release),
        *_count_findings(release, tables["nodes"], tables["items"]),
        *nodes.findings(tables["nodes"]),
        *items.findings(tables["items"], tables["nodes"], release.manifest),
        *_image_findings(release, tables["images"], tables["items"]),
    ]
    prior_findings = list(priors.findings(tables["priors"], tables["nodes"]))
    if not any(finding.is_error for finding in prior_findings):  # damaged priors have no sizes to compare
        found += leaves.findings(tables["nodes"], tables["items"], tables["priors"], release.manifest)
    return sorted([*found, *prior_findings])


def _file_findings(release: Release) -> Iterator[Finding]:
    """Check checksums, rows, columns and types of the tables (E102 to E104)."""
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
            elif (found_type := table.schema.field(field.name).type) not in (field.type, FORMER_TYPES.get(field.name)):
                yield Finding("E104", f"{name}: {field.name}", f"expected {field.type}; found {found_type}")


def _extra_findings(release: Release) -> Iterator[Finding]:
    """Check the files next to the tables (E106)."""
    for name, recorded in release.manifest.get("extras", {}).items():
        path = stored_file(release.directory, name)
        digest = "no file" if path is None else sha256(path)
        if digest != recorded:
            yield Finding("E106", name, f"expected sha256 {recorded}; found {digest}")


def _count_findings(release: Release, nodes: pa.Table, items: pa.Table) -> Iterator[Finding]:
    """Compare the counts of the manifest with the tables (E105)."""
    parents = set(nodes["parent_id"].to_pylist())
    counts = {
        "nodes": nodes.num_rows,
        "leaves": sum(node_id not in parents for node_id in nodes["node_id"].to_pylist()),
        "levels": max(nodes["level"].to_pylist(), default=0),
        "n_rows": items.num_rows,
    }
    for name, value in counts.items():
        recorded = release.manifest["counts"].get(name)
        if recorded != value:
            text = f"expected {value} as in the tables; found {recorded}"
            yield Finding("E105", f"manifest.json: counts.{name}", text)


def _image_findings(release: Release, images: pa.Table, items: pa.Table) -> Iterator[Finding]:
    """Check items, files, checksums and licences of the images (E501 to E504)."""
    item_ids = set(items["item_id"].to_pylist())
    for row in images.to_pylist():
        image_id, item_id, path, licence = (row[name] for name in ("image_id", "item_id", "path", "licence"))
        if item_id not in item_ids:
            yield Finding("E501", image_id, f"item_id: expected an item of the release; found {item_id!r}")
        for column in ("path", "cutout_path"):
            if row[column] is not None and image_path(release.directory, row, column) is None:
                text = f"expected a file of the release; found none at {row[column]}"
                yield Finding("E502", image_id, f"{column}: {text}")
        if path is not None and (file := image_path(release.directory, row)) and sha256(file) != image_id:
            yield Finding("E504", image_id, f"path: expected bytes of this sha256; found others in {path}")
        if not licence:
            yield Finding("E503", image_id, "licence: expected the picture's terms; found none")

"""README.md and LICENSE of a release: what lies in it, how it is read, whom to name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from metric_tree.release.schema import TABLES

__all__ = ["licence_text", "readme_text"]

_MEANING = {
    "nodes.parquet": "a category of the tree",
    "items.parquet": "an item with its size, source and licence",
    "priors.parquet": "a size distribution, with its tier and the counts behind it",
    "images.parquet": "a picture of an item",
}


def readme_text(manifest: Mapping[str, Any], rows: Mapping[str, int]) -> str:
    """The README of a release; rows : of each table."""
    lines = [
        f"# {manifest['name']} {manifest['version']}",
        "",
        f"Object sizes by category, of {manifest['created']}. A release is never changed once published.",
        "",
        "| file | one row is | rows |",
        "|---|---|---|",
        *(f"| `{name}` | {_MEANING[name]} | {rows[name]} |" for name in TABLES),
        "| `successors.parquet` | an id of an earlier release and the node that it leads to | |",
        "| `manifest.json` | sources, counts, models of the evidence, checksums of every file | |",
        "",
        "Columns and units are in the tables' own schemas; lengths are in mm, priors over ln mm. `tier` says what a",
        "size rests on: norm, measured, few, models, borrowed, judged. A language model wrote judged ranges and",
        "norms: `judged_by` in the manifest has names and dates. Each row has its licence; LICENSE says whom to name.",
        "",
        "```python",
        "import metric_tree",
        "",
        f'tree = metric_tree.open("{manifest["version"]}")  # or the path of this folder',
        "```",
    ]
    return "\n".join(lines) + "\n"


def licence_text(manifest: Mapping[str, Any]) -> str:
    """Whose terms hold for the rows of a release, source by source."""
    shown = [record for record in manifest["sources"] if record["n_rows"]]
    lines = [
        "Each row of items.parquet and images.parquet is under the licence that it names. Norms, judged ranges, nodes",
        "and priors are the project's own, under the Apache License 2.0 (https://www.apache.org/licenses/LICENSE-2.0).",
        "",
        "Rows are owed to:",
        "",
        *(
            f"- {record['id']} ({record['licence']}): "
            f"{record['attribution'] or 'each row names its author in its own field'}"
            for record in shown
        ),
    ]
    return "\n".join(lines) + "\n"

"""A made-up source of open data, written for a test and imported."""

from __future__ import annotations

from pathlib import Path

from crawler.imports import Import, import_source
from crawler.imports.declaration import source

HEAD = """
id = "made_up"
title = "Made-up table"
url = "https://example.org"
licence = "CC0-1.0"
licence_basis = "we made them up"
attribution = "us"
kind = "product"
year = 2001
region = "NO"
ship = true
"""


def made_up(folder: Path, declaration: str, **files: str) -> Import:
    """The import of files written for the occasion; `table_csv` becomes `table.csv`."""
    for name, text in files.items():
        folder.joinpath(".".join(name.rsplit("_", 1))).write_text(text, encoding="utf-8")
    (folder / "made_up.toml").write_text(HEAD + declaration, encoding="utf-8")
    declared = source("made_up", folder)
    return import_source(declared, folder)


def sizes(result: Import) -> list[dict[str, float]]:
    return [{axis: value for axis, value in item.dimensions_mm.items() if value} for item in result.items]


def reasons(result: Import) -> list[tuple[str, str]]:
    return [(row.reason, row.field) for row in result.rejected]

"""Page of all sources: rows, items, rejections by reason, licence, redistribution and availability of files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from crawler.imports.declaration import REASONS, Source
from crawler.imports.importer import Import

_HEAD = """# Sources of open data

Each source has one declaration: its origin and licence, the kind of evidence of its rows (`kind`), its columns, and its
traps with their treatment. `crawler/imports/declaration.py` describes the fields. Without `--input`, the files of a
source are downloaded, verified by their SHA-256 and cached. The last table lists the sources that support this, and the
files to fetch and to pass by `--input` for the others. If two statements of a licence differ, the stricter one applies
until the licence of the publisher is known: such rows are used in the fit and not redistributed.

The terms of crawled sites, as far as they are known, are in [SITES.md](SITES.md).

This page, and the redistributable raw items in `data/raw`, are written by

    metric-tree import --all --input ../shared/data/sizes --ship data/raw --summary data/sources/README.md

`rows` is the number of rows behind `items` (identical rows are one item with a count), plus `drawn out` (rows of large
categories, of which only a sample is kept, by the hash of the id), plus `refused`. Rejected rows are written with field
and reason to a quarantine file next to `--out`.
"""

_AVAILABILITY = """
Availability of the files (also printed by `metric-tree import --list --verbose`). `downloads itself` is `yes` if the
address names a commit, and `while unchanged` if it follows the newest state of a repository, so that a changed file is
rejected by its SHA-256. No address was tried over a network when this page was written: the column `reason` states the
comparison that was made, and the SHA-256 of each file is that of the file that was read.
"""

_COLUMNS = ("source", "kind", "rows", "items", "drawn out", "refused", "by reason", "licence", "rows ship")


def terms(source: Source) -> dict[str, Any]:
    """Return origin and terms of a source as JSON of the command."""
    addresses = list(dict.fromkeys(file.url for file in source.files if file.url))
    return {
        "source": source.id,
        "title": source.title,
        "url": source.url,
        "addresses": addresses if source.downloads != "no" else [],
        "licence": source.licence,
        "noncommercial": source.noncommercial,
        "ship": source.ship,
        "attribution": source.attribution,
        "kind": source.kind,
        "downloads": source.downloads,
        "reason": source.address if source.downloads != "no" else f"fetch {source.fetch}",
    }


def summary(result: Import) -> dict[str, Any]:
    """Return the counts of an import and the terms of its source as JSON of the command."""
    source = result.source
    return {
        **terms(source),
        "rows": result.n_rows,
        "items": len(result.items),
        "physical_rows": sum(item.count for item in result.items),
        "sampled_out": result.n_sampled_out,
        "refused": len(result.rejected),
        "reasons": result.reasons,
        "excluded": source.excluded,
    }


def overview(summaries: Sequence[dict[str, Any]], absent: Sequence[Source] = ()) -> str:
    """Return the page in Markdown: imports, reason codes, attributions, excluded sources and availability.

    Parameters
    ----------
    summaries : sequence of dict
        Results of `summary`.
    absent : sequence of Source
        Sources whose files were missing.
    """
    lines = [_HEAD]
    lines += [
        f"[{source.id}]({source.url}) ({source.title}) is declared and has no row below: its files were not at hand."
        f" `metric-tree import {source.id} --input PATH --out {source.id}.jsonl` reads them; its licence:"
        f" {source.licence_basis}.\n"
        for source in absent
    ]
    lines += [_line(_COLUMNS), _line("---" for _ in _COLUMNS)]
    counts = ("rows", "items", "sampled_out", "refused")
    for entry in summaries:
        reasons = ", ".join(f"{code} {n}" for code, n in entry["reasons"].items())
        cells = [f"[{entry['source']}]({entry['url']})", entry["kind"], *(entry[count] for count in counts)]
        lines.append(_line([*cells, reasons, entry["licence"], _ships(entry)]))
    totals = (f"**{sum(entry[count] for entry in summaries)}**" for count in counts)
    lines.append(_line([f"**{len(summaries)} sources**", "", *totals, "", "", ""]))
    lines += ["", "Reason codes:", ""]
    lines += [f"- `{code}`: {meaning}" for code, meaning in REASONS.items()]
    lines += ["", "Attributions of redistributed rows:", ""]
    lines += [f"- `{entry['source']}`: {entry['attribution']}" for entry in summaries if entry["ship"]]
    if excluded := [entry for entry in summaries if entry["excluded"]]:
        lines += ["", "Excluded sources:", ""]
        lines += [f"- `{entry['source']}`: {entry['excluded']}" for entry in excluded]
    columns = ("source", "address", "licence", "rows ship", "downloads itself", "reason")
    lines += [_AVAILABILITY, _line(columns), _line("---" for _ in columns)]
    for entry in summaries:
        addresses = entry["addresses"]
        several = f"first of {len(addresses)}" if len(addresses) > 1 else "file"
        address = f"[{several}]({addresses[0]})" if addresses else f"[set]({entry['url']})"
        cells = [entry["source"], address, entry["licence"], _ships(entry), entry["downloads"], entry["reason"]]
        lines.append(_line(cells))
    return "\n".join(lines) + "\n"


def _ships(entry: dict[str, Any]) -> str:
    return "yes" if entry["ship"] else "no, non-commercial" if entry["noncommercial"] else "no"


def _line(cells: Iterable[object]) -> str:
    return "| " + " | ".join(str(cell) for cell in cells) + " |"

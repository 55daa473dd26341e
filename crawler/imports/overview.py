"""The table of all sources: rows, items, refusals by reason, licence, whether rows are given on."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from crawler.imports import Import
from crawler.tables import REASONS

__all__ = ["overview", "summary"]

_HEAD = """# Sources of open data

One declaration a source: where it is from, whose terms decide, what its rows are worth as evidence (`kind`), how its
columns are read, its traps and what is done about each. `crawler/sources.py` describes the fields, `crawler/tables.py`
those of a plain table. A file that was cut down from a larger set has no address of its own and wants `--input`; the
others are downloaded, checked against their sha256 and cached where `--input` is missing.

This page, and the raw items under `data/raw` whose terms allow to give them on, are made by

    metric-tree import --all --input ../shared/data/sizes --ship data/raw --summary data/sources/README.md

`rows` = rows behind `items` (identical rows are one item with a count) + `drawn out` (of categories so large that a
sample of them is kept, by the hash of the id) + `refused`. Refused rows go, with field and reason, into a quarantine
file beside `--out`.
"""

_COLUMNS = ("source", "kind", "rows", "items", "drawn out", "refused", "by reason", "licence", "rows ship")


def summary(result: Import) -> dict[str, Any]:
    """The counts of an import and the terms of its source, as the command's JSON."""
    source = result.source
    return {
        "source": source.id,
        "title": source.title,
        "url": source.url,
        "licence": source.licence,
        "noncommercial": source.noncommercial,
        "ship": source.ship,
        "attribution": source.attribution,
        "kind": source.kind,
        "rows": result.n_rows,
        "items": len(result.items),
        "physical_rows": sum(item.count for item in result.items),
        "sampled_out": result.n_sampled_out,
        "refused": len(result.refusals),
        "reasons": result.reasons,
        "excluded": source.excluded,
    }


def overview(summaries: Sequence[dict[str, Any]]) -> str:
    """A Markdown page: the table of the summaries, the reason codes, why sources are left out whole."""
    lines = [_HEAD, _line(_COLUMNS), _line("---" for _ in _COLUMNS)]
    lines += [_line(_cells(entry)) for entry in summaries]
    totals = {key: sum(entry[key] for entry in summaries) for key in ("rows", "items", "sampled_out", "refused")}
    lines.append(_line([f"**{len(summaries)} sources**", "", *(f"**{n}**" for n in totals.values()), "", "", ""]))
    lines += ["", "Reason codes:", ""]
    lines += [f"- `{code}`: {meaning}" for code, meaning in REASONS.items()]
    lines += ["", "Rows that are given on are owed to:", ""]
    lines += [f"- `{entry['source']}`: {entry['attribution']}" for entry in summaries if entry["ship"]]
    if excluded := [entry for entry in summaries if entry["excluded"]]:
        lines += ["", "Left out whole:", ""]
        lines += [f"- `{entry['source']}`: {entry['excluded']}" for entry in excluded]
    return "\n".join(lines) + "\n"


def _cells(entry: dict[str, Any]) -> list[object]:
    reasons = ", ".join(f"{code} {n}" for code, n in entry["reasons"].items())
    ship = "yes" if entry["ship"] else "no, non-commercial" if entry["noncommercial"] else "no"
    name = f"[{entry['source']}]({entry['url']})"
    counts = [entry[key] for key in ("rows", "items", "sampled_out", "refused")]
    return [name, entry["kind"], *counts, reasons, entry["licence"], ship]


def _line(cells: Iterable[object]) -> str:
    return "| " + " | ".join(str(cell) for cell in cells) + " |"

"""Page of all sources: rows, items, rejections by reason, licence, redistribution and availability of files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from crawler.imports.declaration import REASONS, Source
from crawler.imports.importer import Import

#: The page, with placeholders of `str.format`.
_TEMPLATE = Path(__file__).with_name("overview.md")


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
    missing = [
        f"[{source.id}]({source.url}) ({source.title}) is declared and has no row below: its files were not at hand."
        f" `metric-tree import {source.id} --input PATH --out {source.id}.jsonl` reads them; its licence:"
        f" {source.licence_basis}.\n\n"
        for source in absent
    ]
    counts = ("rows", "items", "sampled_out", "refused")
    sources, files = [], []
    for entry in summaries:
        reasons = ", ".join(f"{code} {n}" for code, n in entry["reasons"].items())
        cells = [f"[{entry['source']}]({entry['url']})", entry["kind"], *(entry[count] for count in counts)]
        sources.append(_line([*cells, reasons, entry["licence"], _ships(entry)]))
        addresses = entry["addresses"]
        several = f"first of {len(addresses)}" if len(addresses) > 1 else "file"
        address = f"[{several}]({addresses[0]})" if addresses else f"[set]({entry['url']})"
        cells = [entry["source"], address, entry["licence"], _ships(entry), entry["downloads"], entry["reason"]]
        files.append(_line(cells))
    totals = (f"**{sum(entry[count] for entry in summaries)}**" for count in counts)
    sources.append(_line([f"**{len(summaries)} sources**", "", *totals, "", "", ""]))
    shipped = [f"- `{entry['source']}`: {entry['attribution']}" for entry in summaries if entry["ship"]]
    excluded = [f"- `{entry['source']}`: {entry['excluded']}\n" for entry in summaries if entry["excluded"]]
    return _TEMPLATE.read_text(encoding="utf-8").format(
        absent="".join(missing),
        sources="\n".join(sources),
        reasons="\n".join(f"- `{code}`: {meaning}" for code, meaning in REASONS.items()),
        attributions="\n".join(shipped),
        excluded="".join(["\nExcluded sources:\n\n", *excluded] if excluded else []),
        files="\n".join(files),
    )


def _ships(entry: dict[str, Any]) -> str:
    return "yes" if entry["ship"] else "no, non-commercial" if entry["noncommercial"] else "no"


def _line(cells: Iterable[object]) -> str:
    return "| " + " | ".join(str(cell) for cell in cells) + " |"

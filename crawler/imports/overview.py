"""The page of all sources: rows, items, refusals by reason, licence, whether rows ship, where files are available."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from crawler.imports.declaration import REASONS, Source
from crawler.imports.importer import Import

_HEAD = """# Sources of open data

One declaration a source: where it is from, whose terms decide, what its rows are worth as evidence (`kind`), how its
columns are read, its traps and what is done about each. `crawler/imports/declaration.py` describes the fields,
`crawler/imports/declaration.py`
those of a plain table. Where `--input` is missing, a source's files are downloaded, checked against their sha256 and
cached; the last table lists the sources for which that holds, and what to fetch for the others (`--input`).
Where two statements of a licence differ, the narrower one is taken until the publisher's own is known: such rows are
used in the fit and not given on.

The terms of crawled sites, as far as they are known, are in [SITES.md](SITES.md).

This page, and the raw items under `data/raw` whose terms allow to give them on, are made by

    metric-tree import --all --input ../shared/data/sizes --ship data/raw --summary data/sources/README.md

`rows` = rows behind `items` (identical rows are one item with a count) + `drawn out` (of categories so large that a
sample of them is kept, by the hash of the id) + `refused`. Refused rows go, with field and reason, into a quarantine
file beside `--out`.
"""

_WHERE = """
Where the files are available (`metric-tree import --list --verbose` prints the same). `downloads itself`: `yes`, the
address names a commit; `while unchanged`, it follows the newest state of a repository and is refused once the sha256
fails. No address was tried over a network when this was written: what was compared is what the reason says, and the
sha256 of every file is that of the file read here.
"""

_COLUMNS = ("source", "kind", "rows", "items", "drawn out", "refused", "by reason", "licence", "rows ship")


def terms(source: Source) -> dict[str, Any]:
    """Where a source is had and on what terms, as the command's JSON."""
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
    """The counts of an import and the terms of its source, as the command's JSON."""
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
    """A Markdown page: the table of the summaries, the reason codes, why sources are left out whole.

    absent : sources whose files were not at hand
    """
    lines = [_HEAD, *map(_absence, absent), _line(_COLUMNS), _line("---" for _ in _COLUMNS)]
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
    columns = ("source", "address", "licence", "rows ship", "downloads itself", "reason")
    lines += [_WHERE, _line(columns), _line("---" for _ in columns)]
    lines += [_line(_where(entry)) for entry in summaries]
    return "\n".join(lines) + "\n"


def _absence(source: Source) -> str:
    return (
        f"[{source.id}]({source.url}) ({source.title}) is declared and has no row below: its files were not at hand."
        f" `metric-tree import {source.id} --input PATH --out {source.id}.jsonl` reads them; its licence:"
        f" {source.licence_basis}.\n"
    )


def _cells(entry: dict[str, Any]) -> list[object]:
    reasons = ", ".join(f"{code} {n}" for code, n in entry["reasons"].items())
    name = f"[{entry['source']}]({entry['url']})"
    counts = [entry[key] for key in ("rows", "items", "sampled_out", "refused")]
    return [name, entry["kind"], *counts, reasons, entry["licence"], _ships(entry)]


def _where(entry: dict[str, Any]) -> list[object]:
    addresses = entry["addresses"]
    several = f"first of {len(addresses)}" if len(addresses) > 1 else "file"
    address = f"[{several}]({addresses[0]})" if addresses else f"[set]({entry['url']})"
    return [entry["source"], address, entry["licence"], _ships(entry), entry["downloads"], entry["reason"]]


def _ships(entry: dict[str, Any]) -> str:
    return "yes" if entry["ship"] else "no, non-commercial" if entry["noncommercial"] else "no"


def _line(cells: Iterable[object]) -> str:
    return "| " + " | ".join(str(cell) for cell in cells) + " |"

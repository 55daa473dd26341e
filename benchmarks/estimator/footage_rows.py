"""Judged results of the benchmark of real footage, kept as `footage_rows.csv`, so that no figure is lost with a run."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.estimator.footage_cases import FootageCase
from benchmarks.estimator.footage_judging import GATES, Judgement, Row

__all__ = ["ROWS", "read_rows", "updated_rows", "write_rows"]

ROWS = Path(__file__).with_name("footage_rows.csv")
#: Columns of the case, and of each result (of plain pycolmap with the prefix `plain_`).
CASE = ("case", "group", "chosen_on", "unusable", "error", "reference_focal")
RESULT = ("commit", "code", "frames", "placed", "right", "rms", "median", "is_right", "focal", "cpu_s", "load", "gates")
#: Gates of a model whose figures were not kept.
UNKNOWN = "unknown"


def write_rows(rows: Sequence[Row], file: Path) -> None:
    """Write the judged results of the cases, one case per line; empty cells are None or False."""
    with file.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([*CASE, *RESULT, *(f"plain_{name}" for name in RESULT)])
        for row in rows:
            case = row.case
            cells: list[Any] = [case.name, case.group, case.chosen_on or "", case.unusable or "", case.error]
            cells.append(row.reference_focal)
            for result, judgement in ((row.ours, row.judgement), (row.plain, row.plain_judgement)):
                cells += [None] * len(RESULT) if result is None or judgement is None else _cells(result, judgement)
            writer.writerow([round(cell, 5) if isinstance(cell, float) else cell for cell in cells])


def _cells(result: Mapping[str, Any], judgement: Judgement) -> list[Any]:
    """Return the cells of `RESULT`."""
    gates = UNKNOWN if result.get("gates") is None else ";".join(gate for gate in GATES if gate in result["gates"])
    judged = [judgement.n_placed, judgement.n_right, judgement.rms, judgement.median, judgement.is_right]
    measured = [result.get(name) for name in ("focal", "cpu_s", "load")]
    return [*(result.get(name) for name in ("commit", "code", "frames")), *judged, *measured, gates]


def read_rows(file: Path) -> list[Row]:
    """Return the judged results in a file, none if it does not exist; cases have no place, and results no centres."""
    if not file.is_file():
        return []
    rows = []
    with file.open(encoding="utf-8", newline="") as stream:
        for line in csv.DictReader(stream):
            chosen_on, unusable = line["chosen_on"] == "True", line["unusable"] == "True"
            case = FootageCase(
                line["case"],
                line["group"],
                Path(line["case"]),
                chosen_on=chosen_on,
                unusable=unusable,
                error=line["error"],
            )
            (ours, judgement), (plain, other) = _result(line, ""), _result(line, "plain_")
            assert ours is not None
            assert judgement is not None
            rows.append(Row(case, ours, judgement, plain, other, _number(line["reference_focal"])))
    return rows


def updated_rows(stored: Sequence[Row], fresh: Sequence[Row]) -> list[Row]:
    """Return the stored rows, replaced or followed by fresh ones.

    A fresh row without a result of plain pycolmap keeps the stored one.
    """
    rows = {row.case.name: row for row in stored}
    for row in fresh:
        before = rows.get(row.case.name)
        if row.plain is None and before is not None:
            rows[row.case.name] = replace(row, plain=before.plain, plain_judgement=before.plain_judgement)
        else:
            rows[row.case.name] = row
    return list(rows.values())


def _result(line: Mapping[str, str], prefix: str) -> tuple[dict[str, Any] | None, Judgement | None]:
    """Return a result and its judgement from the columns with a prefix; None if the case was not run."""
    cells = {name: line[prefix + name] for name in RESULT}
    if not cells["placed"]:
        return None, None
    placed, right = int(cells["placed"]), int(cells["right"]) if cells["right"] else None
    is_right = cells["is_right"] == "True" if cells["is_right"] else None
    judgement = Judgement(placed, right, _number(cells["rms"]), _number(cells["median"]), is_right)
    gates = None if cells["gates"] == UNKNOWN else {gate for gate in cells["gates"].split(";") if gate in GATES}
    result: dict[str, Any] = {"code": cells["code"] or None, "frames": int(cells["frames"]), "gates": gates}
    result |= {name: _number(cells[name]) for name in ("focal", "cpu_s", "load")}
    return result | ({"commit": cells["commit"]} if cells["commit"] else {}), judgement


def _number(text: str) -> float | None:
    return float(text) if text else None

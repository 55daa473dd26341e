"""The result as a person reads it: the scale on one line, then what every object and every other evidence said."""

from __future__ import annotations

import csv
import io
import re
import textwrap
from collections import Counter
from collections.abc import Sequence

from estimator.records.result import Alternative, ObjectReport, ScaleResult
from metric_base.escaping import visible
from metric_cli.terminal import Cell, output_width, style_text, table_text
from metric_tree.axes import AXES, EXTENTS

__all__ = ["csv_text", "headline", "page_record", "result_text"]

STYLE = {"used": "green", "outlier": "red", "skipped": "dim"}
#: Columns where standard output is no terminal and `COLUMNS` is not set: room for a long reason on one line.
PIPE_WIDTH = 120
#: `--wide` has room for all its columns, whatever the terminal's width: its rows are read by scrolling.
MOST_NEEDED = 160
#: What `style_text` adds for a terminal.
_ANSI = re.compile(r"\x1b\[[0-9;]*m")
NOTE = (
    "tier: what the category's size rests on; l × w × h in metres; in brackets: not used; >: truncated, at least that"
)


def result_text(result: ScaleResult, *, wide: bool = False) -> str:
    """The printed result, as wide as the terminal or as `COLUMNS` says.

    wide : with the node of each object, its size in scene units, its weight and its points.
    """
    width = output_width(PIPE_WIDTH)
    lines = [headline(result)]
    if result.up is not None:
        vector = ", ".join(f"{value:.3f}" for value in result.up.vector)
        lines.append(style_text(f"up ({vector})  {result.up.method}, ±{result.up.sigma_deg:.1f}°", "dim"))
    if result.objects or result.evidence:
        lines.append(_object_table(result, width, wide).rstrip("\n"))
        lines += [style_text(line, "dim") for text in _unmeasured_lines(result) for line in textwrap.wrap(text, width)]
        lines += [style_text(line, "dim") for line in textwrap.wrap(NOTE, width)]
    for item in result.would_help:
        lines += textwrap.wrap(visible(f"would help: {item.what} (interval {item.narrows_by:.0%} narrower)"), width)
    if result.without_support is not None:
        lines += textwrap.wrap(_line("without support planes", result.without_support, result.scale), width)
    if result.leave_one_class_out:
        lines.append(_left_out_table(result, width).rstrip("\n"))
    return "\n".join(lines) + "\n"


def headline(result: ScaleResult) -> str:
    """The scale and its interval in one line, or the modes of a scale that is unresolved."""
    if result.scale is None or result.interval is None:
        modes = ", ".join(f"{mode.scale:.4g} ({mode.mass:.0%})" for mode in result.modes) or "none"
        return style_text(f"scale unresolved; modes in m/unit: {modes}", "red")
    low, high, level = result.interval.low, result.interval.high, result.interval.level
    down, up = max(1 - low / result.scale, 0.0), max(high / result.scale - 1, 0.0)
    spread = f"-{down:.0%} +{up:.0%}"
    scale = style_text(f"scale {result.scale:.4g} m per unit", "bold")
    if result.status == "uncertain":
        scale = f"{scale} ({style_text('uncertain', 'red')})"
    return f"{scale}   {level:.0%} interval {low:.4g} to {high:.4g} ({spread})"


def page_record(result: ScaleResult) -> dict[str, object]:
    """The result as the drawing page shows it: headline, table, and what is missing or doubtful, as plain text."""
    own = _own_scales([item.scale for item in result.objects])
    rows = [
        [
            f"{item.category} {item.id}",
            item.tier or "–",
            "–" if result.scale is None else _sizes(item, result.scale),
            text.strip(),
            item.verdict if item.reason is None else f"{item.verdict}: {item.reason}",
        ]
        for item, text in zip(result.objects, own, strict=True)
    ]
    helps = [f"would help: {item.what} (interval {item.narrows_by:.0%} narrower)" for item in result.would_help]
    return {
        "headline": _ANSI.sub("", headline(result)),
        "columns": ["object", "tier", "metres", "own scale", "verdict"],
        "rows": rows,
        "missing": [*_unmeasured_lines(result), *helps, *result.warnings],
    }


def csv_text(result: ScaleResult) -> str:
    """The objects as CSV: id, category, node, tier, sizes in metres, own scale, weight, verdict, reason."""
    file = io.StringIO()
    names = [
        name for names in (AXES, EXTENTS) for name in names if any(name in item.dimensions for item in result.objects)
    ]
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(
        ["id", "category", "node", "tier", *(f"{name}_m" for name in names), "scale", "weight", "verdict", "reason"]
    )
    for item in result.objects:
        sizes = [_metres(item, name, result.scale) for name in names]
        own = None if item.scale is None else float(f"{item.scale:.5g}")
        row = [
            item.id,
            item.category,
            item.node,
            item.tier,
            *sizes,
            own,
            round(item.weight, 3),
            item.verdict,
            item.reason,
        ]
        writer.writerow([_plain_cell(value) for value in row])
    return file.getvalue()


def _metres(item: ObjectReport, name: str, scale: float | None) -> float | None:
    if scale is None or name not in item.dimensions:
        return None
    return float(f"{item.dimensions[name] * scale:.5g}")


def _plain_cell(value: object) -> object:
    """A value as a cell; text that a spreadsheet would take for a formula gets an apostrophe."""
    if not isinstance(value, str):
        return value
    text = visible(value)
    return f"'{text}" if text.startswith(("=", "+", "-", "@")) else text


def _object_table(result: ScaleResult, width: int, wide: bool) -> str:
    shown = list(filter(_has_size, result.objects))
    own = _own_scales([item.scale for item in shown] + [report.scale for report in result.evidence])
    rows = [_cells(item, result.scale, text, wide) for item, text in zip(shown, own, strict=False)]
    for report, text in zip(result.evidence, own[len(shown) :], strict=True):
        name = f"{report.kind.replace('_', ' ')} {report.id}"
        more: list[object] = ["–", "–", f"{report.weight:.2f}", "–"] if wide else []
        rows.append([name, "–", "–", text, _verdict(report.verdict, report.reason), *more])
    columns = [
        "object",
        "tier",
        "metres",
        "own scale",
        "verdict",
        *(["node", "units", "weight", "points"] if wide else []),
    ]
    return table_text(
        columns, rows, max(width, MOST_NEEDED if wide else 0), unbroken=("tier", "metres", "own scale", "units")
    )


def _cells(item: ObjectReport, scale: float | None, own: str, wide: bool) -> list[object]:
    size = "–" if scale is None else _sizes(item, scale)
    cells: list[object] = [
        f"{item.category} {item.id}",
        item.tier or "–",
        size,
        own,
        _verdict(item.verdict, item.reason),
    ]
    if wide:
        weight = f"{item.weight:.2f}" if item.verdict != "skipped" else "–"
        cells += [item.node, _sizes(item, 1.0), weight, str(item.points)]
    return cells


def _verdict(verdict: str, reason: str | None) -> Cell:
    return Cell(verdict if reason is None else f"{verdict}: {reason}", STYLE[verdict])


def _has_size(item: ObjectReport) -> bool:
    return bool(item.dimensions)


def _unmeasured_lines(result: ScaleResult) -> list[str]:
    """One line for each reason why objects have no size.

    It counts masks: those of one object that hold no points of the cloud cannot be joined to one object.
    """
    masks: dict[str, Counter[str]] = {}
    for item in result.objects:
        if not _has_size(item):
            reason = "too few points" if "points" in (item.reason or "") else item.reason or ""
            masks.setdefault(reason, Counter())[item.category] += max(item.views, 1)
    lines = (
        (reason, ", ".join(f"{name} in {_masks(n)}" for name, n in counts.items())) for reason, counts in masks.items()
    )
    return [visible(f"not measured ({reason}): {names}") for reason, names in lines]


def _masks(count: int) -> str:
    return "1 mask" if count == 1 else f"{count} masks"


def _own_scales(scales: Sequence[float | None]) -> list[str]:
    """Three digits each, the points of all under one another."""
    texts = ["–" if scale is None else f"{scale:#.3g}".rstrip(".") for scale in scales]
    parts = [text.partition(".") for text in texts]
    before, after = (max((len(part[side]) for part in parts), default=0) for side in (0, 2))
    return [f"{whole:>{before}}{point or ' '}{rest:<{after}}" for whole, point, rest in parts]


def _sizes(item: ObjectReport, factor: float) -> str:
    names = EXTENTS if any(name in item.dimensions for name in EXTENTS) else AXES
    parts = []
    for name in names:
        if name not in item.dimensions:
            parts.append("-")
            continue
        text = f"{'>' if name in item.truncated else ''}{item.dimensions[name] * factor:.2f}"
        parts.append(text if name in item.used else f"({text})")
    return " × ".join(parts)


def _line(name: str, other: Alternative, scale: float | None) -> str:
    change = f", {other.scale / scale - 1:+.1%}" if scale else ""
    return f"{name}: {other.scale:.4g} ({other.low:.4g} to {other.high:.4g}{change})"


def _left_out_table(result: ScaleResult, width: int) -> str:
    rows = []
    for left in result.leave_one_class_out or ():
        change = f"{left.scale / result.scale - 1:+.1%}" if result.scale else None
        rows.append((left.name, left.objects, f"{left.scale:.4g}", f"{left.low:.4g} to {left.high:.4g}", change))
    return table_text(("left out", "objects", "scale", "interval", "change"), rows, width)

"""The result as a person reads it: the scale on one line, then what every object said."""

from __future__ import annotations

import io
import shutil
import sys
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

from estimator.records.result import Alternative, ObjectReport, ScaleResult
from metric_base.escaping import visible

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

__all__ = ["print_result", "result_text"]

#: Columns of the dimensions, in the order in which people say them; a free box has its sorted extents.
AXES = ("length", "width", "height")
EXTENTS = ("extent1", "extent2", "extent3")

STYLE = {"used": "green", "outlier": "red", "skipped": "dim"}


#: Columns of a table that no terminal bounds: room for a long reason on one line.
PIPE_WIDTH = 200


def result_text(result: ScaleResult) -> str:
    """The printed result, as wide as the terminal, with colours on a terminal only."""
    from rich.console import Console

    terminal = sys.stdout.isatty()
    width = shutil.get_terminal_size().columns if terminal else PIPE_WIDTH
    console = Console(file=io.StringIO(), width=width, force_terminal=terminal)
    with console.capture() as captured:
        print_result(result, console)
    return "\n".join(line.rstrip() for line in captured.get().splitlines()) + "\n"


def print_result(result: ScaleResult, console: Console) -> None:
    """Print the headline, the objects and the alternatives."""
    console.print(_headline(result), highlight=False)
    if result.up is not None:
        vector = ", ".join(f"{value:.3f}" for value in result.up.vector)
        console.print(f"up ({vector})  {result.up.method}, ±{result.up.sigma_deg:.1f}°", style="dim", highlight=False)
    if result.objects:
        console.print(_object_table(result))
        if unmeasured := _unmeasured(result):
            console.print(unmeasured, style="dim", highlight=False, markup=False)
        console.print("l × w × h in metres at this scale; in brackets: not used, > cut short", style="dim")
    if result.without_support is not None:
        console.print(_line("without support planes", result.without_support, result.scale), highlight=False)
    if result.leave_one_class_out:
        console.print(_left_out_table(result))


def _headline(result: ScaleResult) -> Text:
    from rich.text import Text

    if result.scale is None or result.interval is None:
        modes = ", ".join(f"{mode.scale:.4g} ({mode.mass:.0%})" for mode in result.modes) or "none"
        return Text(f"scale unresolved; modes in m/unit: {modes}", style="bold red")
    low, high, level = result.interval.low, result.interval.high, result.interval.level
    spread = f"-{1 - low / result.scale:.0%} +{high / result.scale - 1:.0%}"
    text = Text(f"scale {result.scale:.4g} m per unit", style="bold")
    return text.append(f"   {level:.0%} interval {low:.4g} to {high:.4g} ({spread})", style="not bold")


def _object_table(result: ScaleResult) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for name in ("id", "category", "node"):
        table.add_column(name, overflow="fold")
    for name in ("units", "metres"):
        table.add_column(name, no_wrap=True)
    table.add_column("own scale", no_wrap=True)
    table.add_column("weight", justify="right")
    table.add_column("verdict", overflow="fold", ratio=1)
    shown = list(filter(_has_size, result.objects))
    for item, own in zip(shown, _own_scales(shown), strict=True):
        table.add_row(*_cells(item, result.scale, own))
    return table


def _has_size(item: ObjectReport) -> bool:
    return bool(item.dimensions)


def _unmeasured(result: ScaleResult) -> str:
    """One line for all objects without any size: far tracks of few points may be many."""
    reasons = [(item.category, item.reason or "") for item in result.objects if not _has_size(item)]
    counts = Counter((category, "too few points" if "points" in reason else reason) for category, reason in reasons)
    lines: dict[str, list[str]] = {}
    for (category, reason), count in counts.items():
        lines.setdefault(reason, []).append(f"{count} {category}")
    return "\n".join(f"not measured ({reason}): {', '.join(parts)}" for reason, parts in lines.items())


def _own_scales(items: Sequence[ObjectReport]) -> list[str]:
    """Three digits each, the points of all under one another."""
    texts = ["-" if item.scale is None else f"{item.scale:#.3g}".rstrip(".") for item in items]
    parts = [text.partition(".") for text in texts]
    before, after = (max((len(part[side]) for part in parts), default=0) for side in (0, 2))
    return [f"{whole:>{before}}{point or ' '}{rest:<{after}}" for whole, point, rest in parts]


def _cells(item: ObjectReport, scale: float | None, own: str) -> tuple[str, ...]:
    style = STYLE[item.verdict]
    verdict = f"[{style}]{item.verdict}[/]" + (f" [dim]{_escaped(item.reason)}[/]" if item.reason else "")
    return (
        _escaped(item.id),
        _escaped(item.category),
        item.node or "-",
        _sizes(item, 1.0),
        _sizes(item, scale) if scale is not None else "-",
        own,
        f"{item.weight:.2f}" if item.verdict != "skipped" else "-",
        verdict,
    )


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


def _left_out_table(result: ScaleResult) -> Table:
    from rich import box
    from rich.table import Table

    table = Table("left out", "objects", "scale", "interval", "change", box=box.SIMPLE_HEAD, pad_edge=False)
    for left in result.leave_one_class_out or ():
        change = f"{left.scale / result.scale - 1:+.1%}" if result.scale else "-"
        table.add_row(left.name, str(left.objects), f"{left.scale:.4g}", f"{left.low:.4g} to {left.high:.4g}", change)
    return table


def _escaped(text: str | None) -> str:
    from rich.markup import escape

    return escape(visible(text or ""))

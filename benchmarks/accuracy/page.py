"""Write the page of the accuracy report: tables in Markdown from outcomes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from string import Template

import numpy as np

from benchmarks.accuracy.methods import METHODS, TRUE_SIZES
from benchmarks.accuracy.outcomes import Outcome, difference, interval_scores, select, summary
from benchmarks.accuracy.simulations import FAULTS
from benchmarks.common import row_text, table_head

__all__ = ["Facts", "page"]

_HEAD = table_head(
    ("setting", "method", "scenes", "refused, %", "error, %: median", "90th pct", "bias, %", "coverage", "high/low")
)
#: Errors of sizes, fractions of common spread, and numbers of objects that the tables of simulations show.
_NOISES, _COMMON = ("0%", "6%", "12%"), ("as modelled", "0%", "60%", "90%")
_COUNTS = ("1", "3", "5", "10", "50")
_SAMENESS_OBJECTS, _SAMENESS_CLASSES = ("1", "3", "50"), ("1", "3", "10")
#: Minimum number of scenes of a row of streets, and of objects of a class in the table of single objects.
_MIN_STREET_SCENES, _MIN_CLASS_OBJECTS = 20, 100
#: Levels of the coverage in the table of the calibration, and the factors of the width of intervals that it compares.
_LEVELS, _WIDTHS = (0.5, 0.8, 0.9, 0.95), np.geomspace(0.4, 2.5, 93)


@dataclass(frozen=True, slots=True)
class Facts:
    """Facts about the run: the command, the release, the source of the synthetic sizes and the processor time.

    earlier : parts with outcomes of earlier runs (`--rows`).
    """

    command: str
    earlier: tuple[str, ...]
    release: str
    rooms: str
    minutes: float


def page(outcomes: Sequence[Outcome], facts: Facts, template: str) -> str:
    """Fill the template with the facts and the tables."""
    scenes = [row for row in outcomes if row.part in {"methods", "scenes"}]
    earlier = (
        f" The outcomes of {', '.join(facts.earlier)} are from earlier runs of this command, part by part (`--rows`)."
    )
    return Template(template).substitute(
        command=facts.command,
        earlier=earlier if facts.earlier else "",
        release=facts.release,
        rooms=facts.rooms,
        minutes=f"{facts.minutes:.0f}",
        calibration=_calibration_table(outcomes),
        methods=_methods_table(scenes),
        heights=_heights_table(scenes),
        differences=_differences_table(scenes),
        sameness=_sameness_table(select(outcomes, part="sameness")),
        structured=_structured_table(select(outcomes, part="structured")),
        errors=_errors_table(select(outcomes, part="errors")),
        pulls=_pulls_table(select(outcomes, part="pulls")),
        unseen=_groups_table(select(outcomes, part="unseen")),
        streets=_groups_table(select(outcomes, part="streets"), _MIN_STREET_SCENES),
    )


def _groups(outcomes: Sequence[Outcome]) -> list[str]:
    return list(dict.fromkeys(row.group for row in outcomes))


def _line(group: str, method: str, outcomes: Sequence[Outcome]) -> str:
    s = summary(outcomes)
    cells = [
        group, method, str(s.n), f"{100 * s.refused:.0f}", _percent(s.median), _percent(s.p90),
        _percent(s.bias, "+"), _number(s.coverage), _number(s.ratio),
    ]  # fmt: skip
    return row_text(cells)


def _methods_table(outcomes: Sequence[Outcome]) -> str:
    rows = [
        _line(group, method, chosen)
        for group in _groups(outcomes)
        for method in METHODS
        if "all" not in method
        and (chosen := select(outcomes, group=group, method=method))
        # of a single scene, the methods that users do not choose state next to nothing
        and (method in ("default", "paper") or len(chosen) > 1)
    ]
    return "\n".join([_HEAD, *rows]) if rows else "Not run."


def _calibration_table(outcomes: Sequence[Outcome]) -> str:
    """Return the coverage, the interval score, the PIT and the best width of the default method by setting."""
    coverage = [f"{level:.0%}" for level in _LEVELS]
    columns = ("scenes", *coverage, "interval score", "truth in quarters of the posterior, %", "best width")
    lines = [table_head(("setting", *columns))]
    settings = {"real scenes": "scenes"}
    settings |= {"streets of unseen sources": "streets"}
    settings |= {row.group: row.part for row in outcomes if row.part in ("methods", "unseen")}
    for name, part in settings.items():
        of_part = select(outcomes, part=part, method="default")
        group = [row for row in of_part if part in ("scenes", "streets") or row.group == name]
        group = [row for row in group if np.isfinite([row.pit, row.low]).all()]
        if not group:
            continue
        pit = np.array([row.pit for row in group])
        covered = [f"{np.mean(np.abs(2 * pit - 1) <= level):.2f}" for level in _LEVELS]
        quarters = ", ".join(f"{100 * part:.0f}" for part in np.histogram(pit, bins=4, range=(0, 1))[0] / len(pit))
        best = _WIDTHS[np.argmin([interval_scores(group, width).mean() for width in _WIDTHS])]
        lines.append(
            row_text([name, str(len(group)), *covered, _number(interval_scores(group).mean()), quarters, _number(best)])
        )
    return "\n".join(lines) if len(lines) > 1 else "Not run."


def _heights_table(outcomes: Sequence[Outcome]) -> str:
    """Return the mean error of heights (standard deviation over scenes), the measure of the paper, by method."""
    methods = [method for method in METHODS if "all" not in method]
    lines = [table_head(("setting", *methods))]
    for group in _groups(outcomes):
        of_method = [summary(select(outcomes, group=group, method=method)) for method in methods]
        if all(np.isfinite(s.heights) and s.n > 1 for s in of_method):
            cells = [f"{_percent(s.heights)} ({_percent(s.heights_sd)})" for s in of_method]
            lines.append(row_text([group, *cells]))
    return "\n".join(lines) if len(lines) > 1 else "Not run."


def _groups_table(outcomes: Sequence[Outcome], min_scenes: int = 1) -> str:
    rows = [
        _line(group, method, select(outcomes, group=group, method=method))
        for group in _groups(outcomes)
        for method in dict.fromkeys(row.method for row in select(outcomes, group=group))
        if len(select(outcomes, group=group, method=method)) >= min_scenes
    ]
    return "\n".join([_HEAD, *rows]) if rows else "Not run."


def _differences_table(outcomes: Sequence[Outcome]) -> str:
    lines = [table_head(("setting", "against", "scenes", "mean difference of the error, %", "95 % interval"))]
    for group in _groups(outcomes):
        ours = select(outcomes, group=group, method="default")
        methods = dict.fromkeys(one.method for one in select(outcomes, group=group))
        for method in [name for name in methods if name not in ("default", TRUE_SIZES) and "all" not in name]:
            mean, low, high, count = difference(ours, select(outcomes, group=group, method=method))
            if count > 1:
                ends = f"{_percent(low, '+')} to {_percent(high, '+')}"
                lines.append(f"| {group} | {method} | {count} | {_percent(mean, '+')} | {ends} |")
    return "\n".join(lines) if len(lines) > 1 else "Not run."


def _structured_table(outcomes: Sequence[Outcome]) -> str:
    if not outcomes:
        return "Not run."
    cells = [group.split("/") for group in _groups(outcomes)]
    counts = [count for count in dict.fromkeys(cell[0] for cell in cells) if count in _COUNTS]
    noises = [noise for noise in dict.fromkeys(cell[1] for cell in cells) if noise in _NOISES]
    lines = [table_head(("N", "method", *(f"R = {noise}" for noise in noises)))]
    for count in counts:
        for method in ("default", "paper"):
            # refused outcomes are included with their highest mode, because the paper's method never refuses
            by_noise = [
                summary(
                    [replace(row, refused=False) for row in select(outcomes, group=f"{count}/{noise}", method=method)]
                )
                for noise in noises
            ]
            texts = [f"{_percent(s.mean)} ({_number(s.coverage)})" for s in by_noise]
            scenes = max(s.n for s in by_noise)
            lines.append(f"| {count} | {method} ({scenes} scenes) | {' | '.join(texts)} |")
    return "\n".join(lines)


def _sameness_table(outcomes: Sequence[Outcome]) -> str:
    if not outcomes:
        return "Not run."
    cells = [group.split("/") for group in _groups(outcomes)]
    shares = [share for share in dict.fromkeys(cell[2] for cell in cells) if share in _COMMON]
    by_cell: dict[str, list[Outcome]] = {}
    for one in outcomes:
        by_cell.setdefault(one.group, []).append(replace(one, refused=False))
    lines = [table_head(("objects", "classes", *shares))]
    shown_cells = (cell for cell in cells if cell[0] in _SAMENESS_OBJECTS and cell[1] in _SAMENESS_CLASSES)
    for objects, classes in dict.fromkeys((cell[0], cell[1]) for cell in shown_cells):
        of_share = [summary(by_cell[f"{objects}/{classes}/{share}"]) for share in shares]
        lines.append(row_text([objects, classes, *(_number(s.coverage) for s in of_share)]))
    return "\n".join(lines)


def _pulls_table(outcomes: Sequence[Outcome]) -> str:
    """Return the table of the scales that single objects of the most frequent classes imply."""
    if not outcomes:
        return "Not run."
    lines = [table_head(("label", "objects", "median of ln(scale by it alone / true)", "median distance from that"))]
    by_class: dict[str, list[float]] = {}
    for row in outcomes:
        by_class.setdefault(row.group, []).append(row.error)
    for name, errors in sorted(by_class.items(), key=lambda pair: -len(pair[1])):
        if len(errors) < _MIN_CLASS_OBJECTS:
            break
        median = float(np.median(errors))
        deviation = float(np.median(np.abs(np.array(errors) - median)))
        lines.append(f"| {name} | {len(errors)} | {median:+.2f} | {deviation:.2f} |")
    return "\n".join(lines)


def _errors_table(outcomes: Sequence[Outcome]) -> str:
    """Return the table of the default method with one error at a time; equal numbers of scenes in all rows."""
    lines = [table_head(("setting", "refused, %", "median error, %", "coverage", "high/low"))]
    for error, settings in FAULTS.items():
        for value, _ in settings:
            chosen = select(outcomes, group=f"{error}: {value}", method="default")
            if chosen:
                s = summary(chosen)
                numbers = (f"{100 * s.refused:.0f}", _percent(s.median), _number(s.coverage))
                lines.append(row_text([f"{error}: {value}", *numbers, _number(s.ratio)]))
    return "\n".join(lines) if len(lines) > 1 else "Not run."


def _percent(value: float, sign: str = "") -> str:
    return "" if not np.isfinite(value) else f"{100 * value:{sign}.1f}"


def _number(value: float) -> str:
    return "" if not np.isfinite(value) else f"{value:.2f}"

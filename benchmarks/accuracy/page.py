"""The page: tables in Markdown from outcomes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from string import Template

import numpy as np

from benchmarks.accuracy.methods import METHODS, TRUE_SIZES
from benchmarks.accuracy.outcomes import Outcome, difference, select, summary
from benchmarks.accuracy.simulations import FAULTS
from benchmarks.common import row_text, table_head

__all__ = ["Facts", "page"]

_HEAD = table_head(
    ("setting", "method", "scenes", "refused", "error, median", "mean", "90th pct", "bias", "heights, mean (sd)",
     "coverage of 90 %", "high/low", "interval score", "CRPS")
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Facts:
    """What the page states about itself: the command, the releases and how the synthetic rooms' sizes were drawn.

    earlier : parts whose outcomes were kept from earlier runs (`--rows`).
    """

    command: str
    earlier: tuple[str, ...]
    release: str
    rooms: str
    minutes: float


def page(outcomes: Sequence[Outcome], facts: Facts, template: str) -> str:
    """The page; the template has a place for each table and the facts."""
    scenes = [one for one in outcomes if one.part in {"methods", "scenes"}]
    return Template(template).substitute(
        command=facts.command,
        earlier=_earlier_text(facts.earlier),
        release=facts.release,
        rooms=facts.rooms,
        minutes=f"{facts.minutes:.0f}",
        methods=_methods_table(scenes),
        differences=_differences_table(scenes),
        sameness=_sameness_table(select(outcomes, part="sameness")),
        structured=_structured_table(select(outcomes, part="structured")),
        errors=_errors_table(select(outcomes, part="errors")),
        pulls=_pulls_table(select(outcomes, part="pulls")),
        unseen=_groups_table(select(outcomes, part="unseen")),
        streets=_groups_table(select(outcomes, part="streets")),
        street_differences=_differences_table(select(outcomes, part="streets")),
        refusals=_refusals_table(outcomes),
    )


def _earlier_text(parts: Sequence[str]) -> str:
    earlier = f" The outcomes of {', '.join(parts)} are those of earlier runs of this command, part by part (`--rows`)."
    return earlier if parts else ""


def _groups(outcomes: Sequence[Outcome]) -> list[str]:
    return list(dict.fromkeys(one.group for one in outcomes))


def _line(group: str, method: str, outcomes: Sequence[Outcome]) -> str:
    s = summary(outcomes)
    cells = [
        group, method, str(s.n), f"{s.refused:.0%}", _share(s.median), _share(s.mean), _share(s.p90),
        _share(s.bias, "+"),
        f"{_share(s.heights)} ({_share(s.heights_sd)})" if np.isfinite(s.heights) else "",
        _number(s.coverage), _number(s.ratio), _number(s.score, 3),
        _number(s.crps, 3),
    ]  # fmt: skip
    return row_text(cells)


def _methods_table(outcomes: Sequence[Outcome]) -> str:
    groups = _groups(outcomes)
    rows = [
        _line(group, method, chosen)
        for group in groups
        for method in (TRUE_SIZES, *METHODS)
        # of one scene the arms without dimensions say next to nothing
        if (chosen := select(outcomes, group=group, method=method)) and ("all" not in method or len(chosen) > 1)
    ]
    return "\n".join([_HEAD, *rows]) if rows else "Not run."


def _groups_table(outcomes: Sequence[Outcome]) -> str:
    rows = [
        _line(group, method, select(outcomes, group=group, method=method))
        for group in _groups(outcomes)
        for method in dict.fromkeys(one.method for one in select(outcomes, group=group))
    ]
    return "\n".join([_HEAD, *rows]) if rows else "Not run."


def _differences_table(outcomes: Sequence[Outcome]) -> str:
    lines = [table_head(("setting", "against", "scenes", "mean difference of the error", "95 %"))]
    for group in _groups(outcomes):
        ours = select(outcomes, group=group, method="default")
        for method in dict.fromkeys(one.method for one in select(outcomes, group=group) if one.method != "default"):
            mean, low, high, count = difference(ours, select(outcomes, group=group, method=method))
            if count > 1:
                ends = f"{_share(low, '+')} to {_share(high, '+')}"
                lines.append(f"| {group} | {method} | {count} | {_share(mean, '+')} | {ends} |")
    return "\n".join(lines) if len(lines) > 1 else "Not run."


def _structured_table(outcomes: Sequence[Outcome]) -> str:
    if not outcomes:
        return "Not run."
    cells = [group.split("/") for group in _groups(outcomes)]
    counts, noises = (list(dict.fromkeys(cell[place] for cell in cells)) for place in (0, 1))
    lines = [table_head(("N", "method", *(f"R = {noise}" for noise in noises)))]
    for count in counts:
        for method in ("default", "paper"):
            of_noise = [
                summary(_all_answered(select(outcomes, group=f"{count}/{noise}", method=method))) for noise in noises
            ]
            shown = [f"{_share(s.mean)} ({_number(s.coverage)})" for s in of_noise]
            scenes = max(one.n for one in of_noise)
            lines.append(f"| {count} | {method} ({scenes} scenes) | {' | '.join(shown)} |")
    return "\n".join(lines)


def _sameness_table(outcomes: Sequence[Outcome]) -> str:
    if not outcomes:
        return "Not run."
    cells = [group.split("/") for group in _groups(outcomes)]
    shares = list(dict.fromkeys(cell[2] for cell in cells))
    by_cell: dict[str, list[Outcome]] = {}
    for one in outcomes:
        by_cell.setdefault(one.group, []).append(replace(one, refused=False))
    lines = [table_head(("objects", "classes", *shares))]
    for objects, classes in dict.fromkeys((cell[0], cell[1]) for cell in cells):
        of_share = [summary(by_cell[f"{objects}/{classes}/{share}"]) for share in shares]
        shown = [f"{_number(s.coverage)} ({_number(s.score, 3)})" for s in of_share]
        lines.append(f"| {objects} | {classes} | {' | '.join(shown)} |")
    return "\n".join(lines)


def _pulls_table(outcomes: Sequence[Outcome]) -> str:
    """What single objects say against the truth, the most frequent classes first."""
    if not outcomes:
        return "Not run."
    lines = [table_head(("label", "objects", "median of ln(scale by it alone / true)", "median distance from that"))]
    by_class: dict[str, list[float]] = {}
    for one in outcomes:
        by_class.setdefault(one.group, []).append(one.error)
    for name, errors in sorted(by_class.items(), key=lambda pair: -len(pair[1])):
        middle = float(np.median(errors))
        apart = float(np.median(np.abs(np.array(errors) - middle)))
        lines.append(f"| {name} | {len(errors)} | {middle:+.2f} | {apart:.2f} |")
    return "\n".join(lines)


def _all_answered(outcomes: Sequence[Outcome]) -> list[Outcome]:
    """The outcomes with refused ones counted by their highest mode, as the paper does, which never refuses."""
    return [replace(one, refused=False) for one in outcomes]


def _errors_table(outcomes: Sequence[Outcome]) -> str:
    rows = []
    for error, settings in FAULTS.items():
        for value, _ in settings:
            chosen = select(outcomes, group=f"{error}: {value}", method="default")
            rows += [_line(f"{error}: {value}", "default", chosen)] if chosen else []
    return "\n".join([_HEAD, *rows]) if rows else "Not run."


def _refusals_table(outcomes: Sequence[Outcome]) -> str:
    """What would have been said where nothing was."""
    of_these = ("error of these, median", "mean")
    lines = [table_head(("part", "answered", *of_these, "refused", *of_these))]
    for part in dict.fromkeys(one.part for one in outcomes):
        ours = [one for one in select(outcomes, part=part, method="default") if np.isfinite(one.error)]
        if not ours:
            continue
        cells = []
        for refused in (False, True):
            errors = np.abs(np.expm1([one.error for one in ours if one.refused is refused]))
            figures = [_share(float(np.median(errors))), _share(float(errors.mean()))] if len(errors) else ["", ""]
            cells += [str(len(errors)), *figures]
        lines.append(f"| {part} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _share(value: float, sign: str = "") -> str:
    return "" if not np.isfinite(value) else f"{value:{sign}.1%}".replace("%", " %")


def _number(value: float, digits: int = 2) -> str:
    return "" if not np.isfinite(value) else f"{value:.{digits}f}"

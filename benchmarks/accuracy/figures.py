"""The figures of the page: simulation, errors, and width against error."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.accuracy.outcomes import Outcome, select, summary
from benchmarks.accuracy.simulations import FAULTS

__all__ = ["write_figures"]

OURS, THEIRS = "#0072B2", "#D55E00"
#: Errors beyond this are drawn at the edge.
MOST_ERROR = 0.6


def write_figures(outcomes: Sequence[Outcome], folder: Path) -> list[str]:
    """The figures of the parts that were run, and their names."""
    import matplotlib as mpl

    mpl.use("Agg")
    names = []
    for name, draw, parts in (
        ("accuracy_simulation.png", _draw_simulation, ("structured",)),
        ("accuracy_errors.png", _draw_errors, ("errors",)),
        ("accuracy_scenes.png", _draw_scenes, ("methods", "scenes")),
    ):
        chosen = [one for one in outcomes if one.part in parts]
        if chosen:
            figure = draw(chosen)
            figure.savefig(folder / name, dpi=110, metadata={"Software": None})
            names.append(name)
    return names


def _draw_simulation(outcomes: Sequence[Outcome]) -> Any:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.8), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    cells = [group.split("/") for group in dict.fromkeys(one.group for one in outcomes)]
    counts, noises = (list(dict.fromkeys(cell[place] for cell in cells)) for place in (0, 1))
    for axis, method in zip(axes, ("default", "paper"), strict=True):
        for number, noise in enumerate(noises):
            means = [
                np.mean(
                    np.abs(np.expm1([one.error for one in select(outcomes, group=f"{count}/{noise}", method=method)]))
                )
                for count in counts
            ]
            shade = 0.15 + 0.7 * number / max(len(noises) - 1, 1)
            axis.plot(
                range(len(counts)), means, marker="o", markersize=3, color=str(0.85 - shade), label=f"R = {noise}"
            )
        axis.set_title(method)
        axis.set_xticks(range(len(counts)), counts)
        axis.set_xlabel("objects N")
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("mean error of the scale")
    axes[0].set_ylim(0, None)
    axes[1].legend(fontsize=8)
    return figure


def _draw_errors(outcomes: Sequence[Outcome]) -> Any:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 5), layout="constrained")
    axes = figure.subplots(2, len(FAULTS), sharey="row")
    for column, (error, settings) in enumerate(FAULTS.items()):
        values = [value for value, _ in settings]
        for method, colour in (("default", OURS), ("paper", THEIRS)):
            groups = [select(outcomes, group=f"{error}: {value}", method=method) for value in values]
            errors = [float(np.mean(np.abs(np.expm1([one.error for one in group])))) for group in groups]
            axes[0, column].plot(range(len(values)), errors, marker="o", color=colour, label=method)
            axes[1, column].plot(
                range(len(values)), [summary(group).coverage for group in groups], marker="o", color=colour
            )
        axes[1, column].axhline(0.9, color="0.5", linewidth=0.8)
        axes[0, column].set_title(error, fontsize=9)
        for row in (0, 1):
            axes[row, column].set_xticks(range(len(values)), values, fontsize=8)
            axes[row, column].grid(alpha=0.3)
    axes[0, 0].set_ylabel("mean error")
    axes[1, 0].set_ylabel("coverage of 90 %")
    axes[0, 0].legend(fontsize=8)
    return figure


def _draw_scenes(outcomes: Sequence[Outcome]) -> Any:
    from matplotlib.figure import Figure

    groups = list(dict.fromkeys(one.group for one in outcomes))
    methods = ("default", "height", "paper", "sucar")
    figure = Figure(figsize=(9, 0.5 + 0.62 * len(groups)), layout="constrained")
    axis = figure.subplots()
    for row, group in enumerate(groups):
        for place, (method, colour) in enumerate(zip(methods, (OURS, "#56B4E9", THEIRS, "#999999"), strict=True)):
            signed = np.expm1([one.error for one in select(outcomes, group=group, method=method)])
            at = np.full(len(signed), row + 0.18 * (place - 1.5))
            label = method if row == 0 else None
            axis.scatter(np.clip(signed, -MOST_ERROR, MOST_ERROR), at, s=12, color=colour, alpha=0.7, label=label)
    axis.axvline(0, color="0.4", linewidth=0.8)
    axis.set_yticks(range(len(groups)), groups)
    axis.invert_yaxis()
    axis.set_xlim(-MOST_ERROR * 1.03, MOST_ERROR * 1.03)
    axis.set_xlabel(f"scale / true - 1 (beyond {MOST_ERROR:.0%} at the edge)")
    axis.legend(fontsize=8, loc="lower right")
    axis.grid(alpha=0.3, axis="x")
    return figure

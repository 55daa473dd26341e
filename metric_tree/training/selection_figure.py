"""The figures of the choice of categories: one panel for each rule, and one for what they are for.

Every point is a candidate; its height is the expected narrowing of log scale. The dashed line is the rule's threshold:
what is taken lies right of it, but for divergence, where it lies left.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from metric_base.arrays import FloatArray
from metric_base.errors import InputError
from metric_base.files import whole_file
from metric_tree.training.selection import TRAINING_LISTS, CategoryCandidate, Rules

SUFFIXES = (".png", ".svg", ".pdf")

#: Told apart by people who see no red and green too (Okabe and Ito 2008).
_COLOURS = {"candidates": "#BBBBBB", "the paper's": "#E69F00", "ours": "#0072B2"}

#: Width of the jitter that keeps points of one whole number apart, and the seed of it.
_JITTER, _SEED = 0.3, 0


def write_figure(
    file: Path,
    ranked: Sequence[CategoryCandidate],
    taken: Sequence[CategoryCandidate],
    paper: Collection[str],
    rules: Rules,
) -> None:
    """Draw the candidates under each rule, ours and the paper's marked.

    Raises
    ------
    InputError
        The file's name does not end in one of `SUFFIXES`.
    """
    from matplotlib.figure import Figure

    if file.suffix.lower() not in SUFFIXES:
        raise InputError(f"--figure: expected a name that ends in {', '.join(SUFFIXES)}; found {file}")
    figure = Figure(figsize=(11, 8), layout="constrained")
    divergence, samples, lists, ranks = figure.subplots(2, 2).ravel()
    groups = _groups(ranked, taken, paper)
    spread = np.random.default_rng(_SEED).uniform(-_JITTER, _JITTER, len(ranked))
    apart = dict(zip((one.node.node_id for one in ranked), spread, strict=True))
    _panel(divergence, groups, lambda one: one.divergence, rules.most_divergence, "divergence: sd of log size")
    _panel(samples, groups, lambda one: one.samples + 1, rules.least_samples + 1, "samples: items of the fit, plus one")
    samples.set_xscale("log")
    _panel(
        lists, groups, lambda one: len(one.lists) + apart[one.node.node_id], rules.least_lists - 0.5,
        f"training data: of {len(TRAINING_LISTS)} data sets, those with the category",
    )  # fmt: skip
    lists.set_xticks(range(len(TRAINING_LISTS) + 1))
    _ranking(ranks, taken, paper)
    divergence.legend(loc="upper right", frameon=False)
    _save(figure, file)


def _groups(
    ranked: Sequence[CategoryCandidate], taken: Sequence[CategoryCandidate], paper: Collection[str]
) -> dict[str, Sequence[CategoryCandidate]]:
    return {"candidates": ranked, "the paper's": [one for one in ranked if one.node.node_id in paper], "ours": taken}


def _panel(
    panel: Any, groups: dict[str, Sequence[CategoryCandidate]], value: Any, threshold: float, label: str
) -> None:
    """One rule: its figure along, the narrowing up, the threshold dashed."""
    for name, ones in groups.items():
        heights: FloatArray = np.array([one.narrowing for one in ones])
        ring = {"facecolors": "none", "edgecolors": _COLOURS[name], "s": 70, "linewidths": 1.6, "zorder": 4}
        dot = {"color": _COLOURS[name], "s": 16, "linewidths": 0, "zorder": 3 if name == "ours" else 2}
        style = ring if name == "the paper's" else dot
        panel.scatter([value(one) for one in ones], heights, label=f"{name} ({len(ones)})", **style)
    panel.axvline(threshold, color="black", linestyle="--", linewidth=0.9)
    panel.set(xlabel=label, ylabel="expected narrowing of ln scale, nats")


def _ranking(panel: Any, taken: Sequence[CategoryCandidate], paper: Collection[str]) -> None:
    """Ours by what one object of each narrows: the standard deviation of log scale that is left."""
    left = [one.sd for one in taken]
    colours = [_COLOURS["the paper's" if one.node.node_id in paper else "ours"] for one in taken]
    panel.bar(range(len(taken)), left, color=colours)
    panel.set_xticks(range(len(taken)), [one.node.name for one in taken], rotation=90, fontsize=7)
    panel.set_ylabel("sd of ln scale after one object")
    panel.set_title("ours (orange: the paper's too)", fontsize=9)


def _save(figure: Any, file: Path) -> None:
    """The figure under its name, whole or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(file, "--figure") as work:
        figure.savefig(work, dpi=120, format=file.suffix[1:].lower())

"""Figure of the choice of categories: one panel for each rule, and one for the chosen categories.

A point is a candidate; its ordinate is the expected narrowing of the log scale. The dashed line is the threshold of the
rule: chosen categories are to the right of it, for the divergence to the left.
"""

from __future__ import annotations

import io
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from metric_base.arrays import FloatArray
from metric_base.errors import InputError
from metric_base.files import write_whole
from metric_tree.training.selection import TRAINING_LISTS, CategoryCandidate, Rules

SUFFIXES = (".png", ".svg", ".pdf")

#: Colours that are distinguishable without red and green vision (Okabe and Ito 2008).
_COLOURS = {"candidates": "#BBBBBB", "the paper's": "#E69F00", "ours": "#0072B2"}

#: Maximum shift of a point whose abscissa is a whole number, which separates equal points.
_JITTER = 0.3


def write_figure(
    file: Path,
    ranked: Sequence[CategoryCandidate],
    taken: Sequence[CategoryCandidate],
    paper: Collection[str],
    rules: Rules,
) -> None:
    """Draw the candidates under each rule, with the chosen ones and those of the paper marked.

    Parameters
    ----------
    file : Path
        Image file.
    ranked, taken : sequence of CategoryCandidate
        All candidates, and the chosen ones.
    paper : collection of str
        Node ids of the categories of the paper.
    rules : Rules
        Thresholds.

    Raises
    ------
    InputError
        The name of the file does not end in one of `SUFFIXES`.
    """
    from matplotlib.figure import Figure

    if file.suffix.lower() not in SUFFIXES:
        raise InputError(f"--figure: expected a name that ends in {', '.join(SUFFIXES)}; found {file}")
    figure = Figure(figsize=(11, 8), layout="constrained")
    divergence, samples, lists, chosen = figure.subplots(2, 2).ravel()
    groups = {"candidates": ranked, "the paper's": [one for one in ranked if one.node.node_id in paper], "ours": taken}
    jitter = np.random.default_rng(0).uniform(-_JITTER, _JITTER, len(ranked))
    shifts = dict(zip((one.node.node_id for one in ranked), jitter, strict=True))
    _draw_rule(divergence, groups, lambda one: one.divergence, rules.most_divergence, "divergence: sd of log size")
    label = "samples: items of the fit, plus one"
    _draw_rule(samples, groups, lambda one: one.prior.n + 1, rules.least_samples + 1, label)
    samples.set_xscale("log")
    label = f"training data: of {len(TRAINING_LISTS)} data sets, those with the category"
    _draw_rule(lists, groups, lambda one: len(one.lists) + shifts[one.node.node_id], rules.least_lists - 0.5, label)
    lists.set_xticks(range(len(TRAINING_LISTS) + 1))
    colours = [_COLOURS["the paper's" if one.node.node_id in paper else "ours"] for one in taken]
    chosen.bar(range(len(taken)), [one.sd for one in taken], color=colours)
    chosen.set_xticks(range(len(taken)), [one.node.name for one in taken], rotation=90, fontsize=7)
    chosen.set_ylabel("sd of ln scale after one object")
    chosen.set_title("ours (orange: the paper's too)", fontsize=9)
    divergence.legend(loc="upper right", frameon=False)
    file.parent.mkdir(parents=True, exist_ok=True)
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=120, format=file.suffix[1:].lower())
    write_whole(file, drawn.getvalue(), "--figure")


def _draw_rule(
    panel: Any, groups: dict[str, Sequence[CategoryCandidate]], value: Any, threshold: float, label: str
) -> None:
    """Draw the narrowing of each candidate over its value, and the threshold as a dashed line."""
    for name, members in groups.items():
        heights: FloatArray = np.array([one.narrowing for one in members])
        ring = {"facecolors": "none", "edgecolors": _COLOURS[name], "s": 70, "linewidths": 1.6, "zorder": 4}
        dot = {"color": _COLOURS[name], "s": 16, "linewidths": 0, "zorder": 3 if name == "ours" else 2}
        style = ring if name == "the paper's" else dot
        panel.scatter([value(one) for one in members], heights, label=f"{name} ({len(members)})", **style)
    panel.axvline(threshold, color="black", linestyle="--", linewidth=0.9)
    panel.set(xlabel=label, ylabel="expected narrowing of ln scale, nats")

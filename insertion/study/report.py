"""The report of a study: a text and a figure."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from insertion.study.curve import Curve

__all__ = ["report_text", "write_curve"]

#: The paper's highest share, at -5 %.
PAPER_PEAK = (-5.0, 0.65)


def report_text(curve: Curve) -> str:
    """The report in plain text, one line a step."""
    lines = ["  step   answers   too small   right   too large   95 % of right"]
    lines += [
        f"{p.step:+5.0f} %   {p.count:7d}   {p.too_small:9.2f}   {p.right:5.2f}   {p.too_large:9.2f}"
        f"   {p.low:.2f} to {p.high:.2f}"
        for p in curve.points
    ]
    lines.append(f"{curve.participants} participant(s)")
    if curve.flat:
        lines.append(
            "the answers do not depend on the size: the curve is flat, and there is no just-noticeable step. More "
            "participants, larger pictures, or things of known size beside the object may show one."
        )
        return "\n".join(lines)
    lines.append(f"most say right at {curve.observer.peak:+.1f} %{_interval_text(curve.peak_interval)}")
    lines.append(f"just-noticeable step: {curve.observer.noticeable:.1f} %{_interval_text(curve.noticeable_interval)}")
    lines.append(f"the paper: at most {PAPER_PEAK[1]:.2f} say right, at {PAPER_PEAK[0]:+.0f} %")
    return "\n".join(lines)


def _interval_text(interval: tuple[float, float] | None) -> str:
    return "" if interval is None else f" (95 %: {interval[0]:+.1f} to {interval[1]:+.1f} %)"


def write_curve(curve: Curve, file: Path) -> None:
    """Draw the shares with their intervals and the observer's curve."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.add_subplot()
    steps = np.array([p.step for p in curve.points])
    right = np.array([p.right for p in curve.points])
    spread = np.array([[p.right - p.low for p in curve.points], [p.high - p.right for p in curve.points]])
    axes.errorbar(steps, right, yerr=np.maximum(spread, 0), fmt="o", capsize=3, label='"right", 95 % interval')
    fine = np.linspace(steps.min(), steps.max(), 200)
    shares = curve.observer.shares(fine)
    if not curve.flat:
        axes.plot(fine, shares[:, 1], label="observer")
    axes.plot(*PAPER_PEAK, marker="x", color="black", linestyle="none", label="the paper's peak")
    axes.set_xlabel("change of the object's size, %")
    axes.set_ylabel("share of answers")
    axes.set_ylim(0, 1)
    axes.legend()
    figure.savefig(file)

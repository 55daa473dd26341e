"""Report of a study as text and as a figure."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.user_study.curve import StudyCurve
from metric_base.files import whole_file

#: Step in per cent and fraction of "right" at the peak of the paper's curve.
PAPER_PEAK = (-5.0, 0.65)
#: Width in per cent below which an interval is printed with one decimal.
FINE_PERCENT = 3.0


def report_text(curve: StudyCurve) -> str:
    """Return the report as plain text with one line per step."""
    lines = ["  step   answers   too small   right   too large   95 % of right"]
    lines += [
        f"{p.step:+5.0f} %   {p.count:7d}   {p.too_small:9.2f}   {p.right:5.2f}   {p.too_large:9.2f}"
        f"   {p.low:.2f} to {p.high:.2f}"
        for p in curve.points
    ]
    lines.append(f"{curve.participants} participant(s)")
    if curve.flat:
        lines.append(
            "the answers do not depend on the size: the curve is flat, and there is no just-noticeable step; try more "
            "participants, larger images, or objects of known size next to the object"
        )
        return "\n".join(lines)
    if curve.careless:
        lines.append(f"{curve.careless} of them answer without regard to the size; only the table includes them")
    return "\n".join([*lines, *_observer_lines(curve)])


def _observer_lines(curve: StudyCurve) -> list[str]:
    """Return lines about the peak and the just-noticeable step, limited to the range of the sizes shown."""
    low, high = curve.points[0].step, curve.points[-1].step
    peak, step = curve.observer.peak, curve.observer.noticeable
    lines = []
    if low <= peak <= high:
        share = float(curve.observer.shares(np.array([peak]))[0, 1])
        text = _with_interval(peak, curve.peak_interval, low, high, sign="+")
        lines.append(f"most say right at {text}; there it is {share:.2f} of them")
    else:
        lines.append(f"most say right beyond {low if peak < low else high:+.0f} %, the last size shown")
    changes = [abs(point.step) for point in curve.points if point.step]
    smallest, largest = min(changes, default=0.0), max(changes, default=0.0)
    if step < smallest / 2:
        lines.append(f"just-noticeable step: less than half of {smallest:.0f} %, the smallest change shown")
    elif step <= largest:
        lines.append(f"just-noticeable step: {_with_interval(step, curve.noticeable_interval, 0.0, largest)}")
    else:
        lines.append(f"just-noticeable step: more than {largest:.0f} %, the largest change shown")
    if curve.peak_interval is None:
        lines.append("no intervals: they need three attentive participants")
    lines.append(f"the paper: at most {PAPER_PEAK[1]:.2f} say right, at {PAPER_PEAK[0]:+.0f} %")
    return lines


def _with_interval(
    value: float, interval: tuple[float, float] | None, low_step: float, high_step: float, sign: str = ""
) -> str:
    """Return a value in per cent with its interval as text.

    low_step, high_step : range of the sizes shown; ends outside are not printed.
    sign : `+` for a change.
    """
    if interval is None:
        return f"about {value:{sign}.0f} %"
    digits = 1 if interval[1] - interval[0] < FINE_PERCENT else 0
    low, high = (
        f"{end:{sign}.{digits}f}" if low_step <= end <= high_step else "beyond the sizes shown" for end in interval
    )
    return f"{value:{sign}.{digits}f} % (95 %: {low} to {high} %)"


def write_curve(curve: StudyCurve, file: Path) -> None:
    """Plot the fractions with their intervals and the observer's curve."""
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
    with whole_file(file, "--figure") as work:
        figure.savefig(work, format=file.suffix[1:].lower())

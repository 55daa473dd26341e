"""Draw the figure of an estimate: the evidence of each object for the scale, and the positions of the objects.

The left half shows the posterior of the scale with its interval and modes, and below it a row with the likelihood of
each object and each other evidence alone; and the true scale, if it is known. The right half shows the scene from above
and from the side, with the boxes of the objects in metres (`plan`).
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from estimator.outputs.ground_truth import read_truth
from estimator.outputs.plan import COLOURS, draw_scene
from estimator.records.result import ScaleResult, Verdict
from metric_base.arrays import FloatArray
from metric_base.errors import InputError
from metric_base.escaping import visible
from metric_base.files import write_whole

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from estimator.records.result import SceneEstimate

#: Colours of the posterior, of the true scale, and of the title of an unresolved scale.
POSTERIOR_COLOUR, TRUTH_COLOUR, WARNING_COLOUR = "#222222", "#009E73", "#B00020"
FORMATS = (".png", ".pdf", ".svg")
#: Maximum number of rows of objects; the most certain objects are drawn.
MAX_ROWS = 45
#: Heights of a row, of the posterior and of the axis, and minimum height and width of the figure, in inches.
ROW_INCHES, HEAD_INCHES, FOOT_INCHES, MIN_INCHES, WIDTH_INCHES = 0.21, 2.4, 0.9, 7.0, 14.0
#: Maximum number of characters of the name of a row.
MAX_LABEL_CHARS = 40
#: Margin of the axis around the interval and the scales of the objects, as a ratio.
AXIS_MARGIN = 1.25
#: Fraction of the scales of single objects at each end that the axis need not include, because of outliers.
AXIS_TAIL_FRACTION = 0.1
#: Minimum likelihood that is drawn, relative to its peak.
_MIN_DRAWN_LIKELIHOOD = 1e-3


def write_figure(estimate: SceneEstimate | ScaleResult, file: Path) -> None:
    """Write the figure to a file.

    Parameters
    ----------
    estimate : SceneEstimate or ScaleResult
    file : Path
        With the suffix `.png`, `.pdf` or `.svg`.

    Raises
    ------
    InputError
        The suffix is another one, or the file cannot be written.
    """
    if file.suffix.lower() not in FORMATS:
        raise InputError.at(file, "--figure", f"a name that ends in {', '.join(FORMATS)}", file.suffix)
    # Drawn in memory, because the PDF writer replaces the error of a full disk by one of its own stream.
    drawn = io.BytesIO()
    figure(estimate).savefig(drawn, format=file.suffix[1:].lower(), dpi=130)
    write_whole(file, drawn.getvalue(), "--figure")


def figure_png(estimate: SceneEstimate | ScaleResult) -> bytes:
    """Return the figure as a PNG file."""
    file = io.BytesIO()
    figure(estimate).savefig(file, format="png", dpi=100)
    return file.getvalue()


def figure(estimate: SceneEstimate | ScaleResult) -> Figure:
    """Return the figure of an estimate, or of a result without its scene, which has no right half."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    scene = None if isinstance(estimate, ScaleResult) else estimate
    result = estimate if isinstance(estimate, ScaleResult) else estimate.result
    rows = _rows(result)
    rows_inches = ROW_INCHES * max(len(rows), 1)
    height = max(MIN_INCHES, HEAD_INCHES + rows_inches + FOOT_INCHES)
    halves = 1 if scene is None else 2
    drawn = Figure(figsize=(WIDTH_INCHES * halves / 2, height), layout="constrained")
    FigureCanvasAgg(drawn)
    left, *right = np.ravel(np.asarray(drawn.subfigures(1, halves), dtype=object))
    head_height = min(HEAD_INCHES, 0.4 * height)
    head, body = left.subplots(2, 1, sharex=True, height_ratios=(head_height, height - head_height))
    _draw_posterior(head, result, None if scene is None else read_truth(scene.scene.path).scale)
    _draw_rows(body, result, rows)
    if scene is not None:
        above, side = right[0].subplots(2, 1, height_ratios=(3, 2))
        draw_scene(above, side, scene)
    return drawn


@dataclass(frozen=True, slots=True, eq=False)
class _Row:
    """A row below the posterior: an object or other evidence."""

    name: str
    #: (g,) likelihood of this row alone, with a peak of 1.
    curve: FloatArray
    #: Metres per unit at the peak.
    scale: float
    verdict: Verdict


def _rows(result: ScaleResult) -> list[_Row]:
    """Return the rows of other evidence and of at most `MAX_ROWS` objects with the sharpest likelihoods, by class."""
    if result.curve is None:
        return []
    evidence = []
    for item in result.evidence:
        if item.scale is not None and item.sd_log is not None:
            likelihood = np.exp(-0.5 * ((result.curve.log_scale - math.log(item.scale)) / item.sd_log) ** 2)
            evidence.append(_Row(f"{item.kind.replace('_', ' ')} {item.id}", likelihood, item.scale, item.verdict))
    objects = []
    for report in result.objects:
        if report.id in result.object_curves and report.scale:
            # Without the flat density of an outlier.
            likelihood = np.asarray(result.object_curves[report.id], dtype=np.float64)
            likelihood = likelihood - likelihood.min()
            likelihood = likelihood / max(float(likelihood.max()), np.finfo(np.float64).tiny)
            objects.append(_Row(f"{report.category} {report.id}", likelihood, report.scale, report.verdict))
    width = {row.name: float(row.curve.sum()) for row in objects}  # the area over the height
    sharpest = sorted(objects, key=lambda row: width[row.name])[:MAX_ROWS]
    category = {f"{report.category} {report.id}": report.category for report in result.objects}
    return [*evidence, *sorted(sharpest, key=lambda row: (category[row.name], width[row.name]))]


def _draw_posterior(axes: Axes, result: ScaleResult, truth: float | None) -> None:
    """Draw the posterior with its interval and modes, and the true scale."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    if result.curve is None or result.best_scale is None:
        axes.set_axis_off()
        return
    scales = np.exp(result.curve.log_scale)
    density = result.curve.density / result.curve.density.max()
    interval = result.interval
    if interval is not None:  # up to its ends, which are between grid points
        inside = np.clip(scales, interval.low, interval.high)
        under = np.interp(np.log(inside), result.curve.log_scale, density)
        axes.fill_between(inside, under, color=POSTERIOR_COLOUR, alpha=0.18, linewidth=0)
    axes.plot(scales, density, color=POSTERIOR_COLOUR, linewidth=1.6)
    for mode in result.modes:
        axes.axvline(mode.scale, color=POSTERIOR_COLOUR, linewidth=0.8, linestyle=":")
        if mode.scale != result.best_scale:
            axes.annotate(f"{mode.mass:.0%}", (mode.scale, 0.5), xytext=(3, 0), textcoords="offset points", fontsize=8)
    if truth is not None:
        axes.axvline(truth, color=TRUTH_COLOUR, linewidth=1.4)
    axes.set_xscale("log")
    axes.set_xlim(*_scale_range(result))
    axes.set_ylim(0, 1.12)
    axes.set_yticks([])
    axes.tick_params(axis="x", labelbottom=False, which="both")
    level = None if interval is None else interval.level
    mode_label = "mode" if len(result.modes) == 1 else "modes, with their mass"
    handles: list[Artist] = [
        Line2D([], [], color=POSTERIOR_COLOUR, linewidth=1.6, label="posterior of the scale"),
        Line2D([], [], color=POSTERIOR_COLOUR, linewidth=0.8, linestyle=":", label=mode_label),
    ]
    if level is not None:
        handles.insert(1, Patch(color=POSTERIOR_COLOUR, alpha=0.18, linewidth=0, label=f"{level:.0%} interval"))
    if truth is not None:
        handles.append(Line2D([], [], color=TRUTH_COLOUR, linewidth=1.4, label=f"true scale, {truth:.4g}"))
    axes.legend(handles=handles, fontsize=8, loc="upper right", frameon=False)
    title = f"UNRESOLVED: the highest mode is {result.best_scale:.4g} m per scene unit"
    if interval is not None:
        mark = "" if result.status == "resolved" else f"{result.status.upper()}: "
        bounds = f"{interval.level:.0%} between {interval.low:.4g} and {interval.high:.4g}"
        title = f"{mark}{result.best_scale:.4g} m per scene unit   ({bounds})"
    axes.set_title(title, fontsize=12, loc="left", color="black" if interval is not None else WARNING_COLOUR)
    axes.spines[["top", "right", "left"]].set_visible(False)


def _scale_range(result: ScaleResult) -> tuple[float, float]:
    """Return the limits of the axis: the interval, and the scales of most objects and other evidence alone."""
    scales = [item.scale for item in result.objects] + [item.scale for item in result.evidence]
    single = [scale for scale in scales if scale]
    ends = list(np.quantile(single, [AXIS_TAIL_FRACTION, 1 - AXIS_TAIL_FRACTION])) if single else []
    if result.interval is not None:
        ends += [result.interval.low, result.interval.high]
    elif result.modes:
        ends += [mode.scale for mode in result.modes]
    return min(ends) / AXIS_MARGIN, max(ends) * AXIS_MARGIN


def _draw_rows(axes: Axes, result: ScaleResult, rows: Sequence[_Row]) -> None:
    """Draw the rows of objects and other evidence: likelihood, scale if it is outside the axis, and name."""
    from matplotlib.patheffects import Normal, Stroke
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    if result.curve is None or not rows:
        axes.set_axis_off()
        return
    low, high = _scale_range(result)
    scales = np.exp(result.curve.log_scale)
    if result.interval is not None:
        axes.axvspan(result.interval.low, result.interval.high, color=POSTERIOR_COLOUR, alpha=0.08, linewidth=0)
    for y, row in enumerate(rows):
        colour = COLOURS[row.verdict]
        height = np.where(row.curve > _MIN_DRAWN_LIKELIHOOD, 0.85 * row.curve, np.nan)
        axes.fill_between(scales, y, y - height, color=colour, alpha=0.45, linewidth=0)
        axes.plot(scales, y - height, color=colour, linewidth=0.8)
        if not low <= row.scale <= high:
            mark, edge = ("◂", low) if row.scale < low else ("▸", high)
            side = "left" if row.scale < low else "right"
            label = f"{mark} {row.scale:.2g}" if side == "left" else f"{row.scale:.2g} {mark}"
            text = axes.text(edge, y - 0.1, label, color=colour, fontsize=7, ha=side, va="bottom")
            text.set_path_effects([Stroke(linewidth=2, foreground="white"), Normal()])
    labels = [visible(row.name)[:MAX_LABEL_CHARS] for row in rows]
    axes.set_yticks(np.arange(len(rows)) - 0.25, labels, fontsize=8, parse_math=False)
    for tick, row in zip(axes.get_yticklabels(), rows, strict=True):
        tick.set_color(COLOURS[row.verdict])
    axes.set_ylim(len(rows) - 0.4, -1.2)
    axes.set_xlim(low, high)
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.3g}"))
    verdicts = [item.verdict for item in result.objects if item.dimensions]
    verdicts += [item.verdict for item in result.evidence]
    counts = {name: verdicts.count(name) for name in ("used", "outlier", "skipped")}
    caption = f"scale in metres per scene unit; rows: likelihood of each alone   (blue {counts['used']} used, "
    caption += f"orange {counts['outlier']} outliers; {counts['skipped']} skipped"
    n_rows = counts["used"] + counts["outlier"]
    axes.set_xlabel(caption + (f"; {len(rows)} of {n_rows} drawn)" if len(rows) < n_rows else ")"), fontsize=9)
    axes.spines[["top", "right", "left"]].set_visible(False)

"""Figures of the report of a release, as SVG elements by matplotlib."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np

from crawler.items import STATED_KINDS
from metric_base.escaping import visible
from metric_tree.axes import EXTENTS
from metric_tree.node import Node
from metric_tree.reports.summary import Coverage

#: Colours of the axes, which colour-blind readers can distinguish (Okabe and Ito 2008); extents have the same ones.
_AXIS_COLOURS = {"length": "#0072B2", "width": "#E69F00", "height": "#009E73"}
_COLOURS = _AXIS_COLOURS | dict(zip(EXTENTS, _AXIS_COLOURS.values(), strict=True))
#: Number of panels in a row of `size_figure`.
_COLUMNS = 3
#: Minimum number of items for a histogram.
MIN_HISTOGRAM_ITEMS = 10
#: Maximum of the vertical axis of a panel, relative to the highest density; histograms may be cut off there.
_HEADROOM = 1.6
#: Fraction of the prior outside of the axis of a panel, at each end.
_TAIL_FRACTION = 0.005


def size_figure(nodes: Sequence[Node]) -> str:
    """Return the densities of the priors over log size with histograms of the published items, one panel per node."""
    if not nodes:
        return "<p>No typical category has a prior.</p>"
    import pyarrow as pa
    import pyarrow.compute as pc
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullLocator

    rows = -(-len(nodes) // _COLUMNS)
    figure = Figure(figsize=(11, 2.5 * rows), layout="constrained")
    panels = np.atleast_1d(figure.subplots(rows, _COLUMNS)).ravel()
    for panel, node in zip(panels, nodes, strict=False):
        widest = max(node.prior_dims, key=len)
        items = node.items()
        items = items.filter(pc.invert(pc.is_in(items["kind"], pa.array(STATED_KINDS, pa.string()))))  # no ranges
        max_density, n_shown = 0.0, 0
        for dim in [dim for dim in node.dims if dim in widest] or widest:
            prior = node.prior((dim,))
            low, high = (float(prior.quantile(q)[0]) for q in (_TAIL_FRACTION, 1 - _TAIL_FRACTION))
            grid = np.geomspace(low, high, 200)
            density = np.exp(prior.log_density(grid[:, None]))  # over ln mm
            panel.plot(grid, density, color=_COLOURS[dim], label=dim)
            panel.fill_between(grid, density, color=_COLOURS[dim], alpha=0.15)
            max_density = max(max_density, float(density.max()))
            if f"{dim}_mm" in items.column_names:
                sizes = np.array([v for v in items[f"{dim}_mm"].to_pylist() if v], dtype=float)
                n_shown = max(n_shown, len(sizes))
                if len(sizes) >= MIN_HISTOGRAM_ITEMS:
                    edges = np.geomspace(low, high, 30)
                    counts, _ = np.histogram(sizes, edges)
                    panel.stairs(counts / len(sizes) / np.diff(np.log(edges)), edges, color=_COLOURS[dim], alpha=0.5)
        panel.set_xscale("log")
        panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        panel.xaxis.set_major_formatter("{x:g}")
        panel.xaxis.set_minor_locator(NullLocator())
        panel.set_yticks([])
        panel.set_ylim(0, _HEADROOM * max_density)
        few = "" if n_shown < MIN_HISTOGRAM_ITEMS else f", {n_shown:,} shown"
        panel.set_title(f"{visible(node.name)}: {node.n_items:,} items{few}", fontsize=11)
        panel.tick_params(labelsize=9)
        panel.legend(fontsize=8, frameon=False, handlelength=1)
        panel.set_xlabel("mm", fontsize=9, labelpad=0)
        panel.spines[["top", "left", "right"]].set_visible(False)
    for panel in panels[len(nodes) :]:
        panel.set_axis_off()
    return _svg(figure)


def coverage_figure(lists: Sequence[Coverage]) -> str:
    """Return bars of the fraction of each label list with a prior: from enough real items, from any, and any prior."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import PercentFormatter

    figure = Figure(figsize=(11, 0.32 * len(lists) + 0.8), layout="constrained")
    panel = figure.subplots()
    rows = np.arange(len(lists))[::-1]
    for field, colour, name in (
        ("any", "#ccd5dd", "any prior"),
        ("real", "#7fb3d5", "any real item"),
        ("enough", "#0072B2", "10+ real items"),
    ):
        panel.barh(rows, [getattr(row, field) / row.labels for row in lists], color=colour, label=name)
    panel.set_yticks(rows, [row.name for row in lists], fontsize=10)
    panel.set_xlim(0, 1)
    panel.margins(y=0.01)
    panel.xaxis.set_major_formatter(PercentFormatter(1.0))
    panel.tick_params(axis="x", labelsize=10)
    panel.tick_params(axis="y", length=0)
    panel.spines[["top", "left", "right"]].set_visible(False)
    panel.legend(fontsize=9, frameon=False, ncols=3, loc="lower right", bbox_to_anchor=(1, 1))
    return _svg(figure)


def _svg(figure: Any) -> str:
    """Return a figure as an SVG element, identical for identical figures."""
    import matplotlib as mpl

    buffer = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "metric-tree", "svg.fonttype": "path"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]

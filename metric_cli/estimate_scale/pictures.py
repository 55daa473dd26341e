"""What `estimate-scale` draws and writes of an estimate: figure, overlay, views, the scaled model."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from metric_cli.estimate_scale.options import PROGRAM

if TYPE_CHECKING:
    from estimator.records.result import ScaleResult
    from estimator.results.scene_estimate import SceneEstimate

__all__ = ["is_drawable", "write_pictures"]


def write_pictures(options: argparse.Namespace, estimate: SceneEstimate) -> None:
    """Figure and overlay, marked where the scale is not resolved, and the scaled model of one that is stated.

    Of a scene that contradicts itself nothing is drawn.
    """
    scale = estimate.result.scale
    if not is_drawable(estimate.result, options):
        return
    if options.figure is not None:
        from estimator.outputs.figure import write_figure

        write_figure(estimate, options.figure)
    if options.overlay is not None:
        from estimator.outputs.overlay import write_overlays

        write_overlays(estimate, options.overlay, options.images)
    if options.view or options.view_png is not None or options.view_glb is not None:
        _write_views(options, estimate)
    if options.write_scaled is not None and scale is not None:
        from estimator.outputs.rescaled import write_scaled

        write_scaled(estimate.scene, scale, options.write_scaled)


def _write_views(options: argparse.Namespace, estimate: SceneEstimate) -> None:
    """The estimate in three dimensions, as files and in a window, which is open until the user closes it."""
    from estimator.views.scene_view import scene_view

    view = scene_view(estimate)
    if options.view_png is not None:
        from estimator.views.picture import write_view

        write_view(view, options.view_png)
    if options.view_glb is not None:
        from estimator.views.glb import write_glb

        write_glb(view, options.view_glb)
    if options.view:
        from estimator.views.window import show

        show(view)


def is_drawable(result: ScaleResult, options: argparse.Namespace) -> bool:
    """Whether there is a posterior to draw; says so where there is none."""
    drawable = result.curve is not None or result.status != "unresolved"
    names = ("figure", "overlay", "view", "view_png", "view_glb")
    asked = [f"--{name.replace('_', '-')}" for name in names if getattr(options, name)]
    if asked and not drawable and not options.quiet:
        from metric_cli.terminal import warn

        warn(f"{', '.join(asked)}: there is nothing to draw", PROGRAM)
    return drawable

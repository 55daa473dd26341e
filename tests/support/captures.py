"""Matches and figures of a right model, of which tests change one figure at a time."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import msgspec
import numpy as np

from capture.mapping.match_graph import FramePair, MatchGraph
from capture.mapping.model_metrics import ModelMetrics

__all__ = ["right_model", "walk_graph"]


def walk_graph(n: int = 20, **changes: Any) -> MatchGraph:
    """Return frames of a walk: every frame matches the next three, with parallax."""
    generator = np.random.default_rng(0)
    pairs = tuple(
        FramePair(a, b, 200, 60.0 * (b - a), np.eye(3) + generator.normal(0, 0.02, (3, 3)))
        for a in range(n)
        for b in range(a + 1, min(a + 4, n))
    )
    names = [f"{k:06d}.jpg" for k in range(n)]
    graph = MatchGraph(names, np.full(n, 1500), pairs, (640, 480), np.tile([0.19, 0.22], (n, 1)))
    return replace(graph, **changes)


def right_model(n: int = 20, **changes: Any) -> ModelMetrics:
    """Return figures of a right model of all n frames, with changes."""
    model = ModelMetrics(
        names=tuple(walk_graph(n).names),
        points=4000,
        error_px=0.4,
        focal=0.8,
        lens_bend=0.01,
        camera="SIMPLE_RADIAL",
        focal_deviation=0.01,
        focal_spread=0.001,
        pattern=0.02,
        triplets=100,
        pieces=(n,),
    )
    return msgspec.structs.replace(model, **changes)

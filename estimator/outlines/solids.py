"""Upright solids that stand in for objects: their projections, where rays enter them, and how far they reach.

A solid is a row of seven parameters: centre (3,), yaw, log extents (3,), in the level basis. Its footprint is a
rectangle ("box"), an ellipse ("round"), or between them an octagon with corners cut off from `CUT` of half a side.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from estimator.outlines.reaches import DIRECTIONS, Outlines
from metric_base.arrays import FloatArray

__all__ = ["Shape", "entry_depths", "projected_reaches", "supports"]

Shape = Literal["box", "round", "octagon"]

# Corners of the polygon that stands for an ellipse, which lies half inside and half outside of it: 1 % either way.
RING = 16
_ANGLES = np.arange(RING) * 2 * np.pi / RING
_RIM = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)]) / (1 + np.cos(np.pi / RING))
CUT = 0.75
_OCTAGON = np.array([(x * a, y * b) for a, b in ((1, CUT), (CUT, 1)) for x in (-1, 1) for y in (-1, 1)]) / 2
_CORNERS = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) / 2
# Vertices (n, 3) of each shape of unit size.
_UNIT = {
    shape: np.array([[*at, z] for at in ring for z in (-0.5, 0.5)])
    for shape, ring in (("box", _CORNERS), ("round", _RIM), ("octagon", _OCTAGON))
}


def projected_reaches(outlines: Outlines, parameters: FloatArray, shape: Shape) -> FloatArray:
    """(k, v, 8) how far k solids, parameters (k, 7), reach in each picture towards each of the `DIRECTIONS`."""
    local = _UNIT[shape] * np.exp(parameters[:, None, 4:])  # (k, n, 3)
    c, s = np.cos(parameters[:, 3, None]), np.sin(parameters[:, 3, None])
    turned = [c * local[..., 0] - s * local[..., 1], s * local[..., 0] + c * local[..., 1], local[..., 2]]
    world = np.stack(turned, axis=1) + parameters[:, :3, None]  # (k, 3, n)
    camera = outlines.rotation @ world[:, None] + outlines.translation[:, :, None]  # (k, v, 3, n)
    # what is behind the camera is far to the side
    ahead = np.maximum(camera[:, :, 2], 1e-3 * np.abs(camera).max())
    x, y = camera[:, :, 0] / ahead, camera[:, :, 1] / ahead
    ends = [x.min(axis=2), x.max(axis=2), y.min(axis=2), y.max(axis=2)]
    falling, rising = (x + y) * DIRECTIONS[6, 0], (x - y) * DIRECTIONS[6, 0]
    slants = [falling.min(axis=2), falling.max(axis=2), rising.min(axis=2), rising.max(axis=2)]
    # left, top, right, bottom, then between them
    return np.stack([-ends[0], -ends[2], ends[1], ends[3], -slants[0], slants[3], slants[1], -slants[2]], axis=-1)


def entry_depths(
    parameters: FloatArray, eyes: FloatArray, rays: FloatArray, shape: Shape = "box"
) -> tuple[FloatArray, FloatArray]:
    """(k, n) depth at which each ray (n, 3) from its eye (n, 3) enters k solids (k, 7), and how long it stays inside.

    A ray that misses enters and leaves where it comes nearest to doing both.
    """
    half = np.exp(parameters[:, None, 4:]) / 2  # (k, 1, 3)
    c, s = np.cos(parameters[:, 3, None]), np.sin(parameters[:, 3, None])

    def local(vectors: FloatArray) -> FloatArray:
        """(k, n, 3) vectors in each solid's own axes, in half extents."""
        turned = [c * vectors[..., 0] + s * vectors[..., 1], c * vectors[..., 1] - s * vectors[..., 0], vectors[..., 2]]
        return np.stack(turned, -1) / half

    start = local(eyes - parameters[:, None, :3])
    ray = local(np.broadcast_to(rays, start.shape))
    least = 1e-9 * np.abs(ray).max(axis=2, keepdims=True)
    ray = np.where(np.abs(ray) < least, least, ray)
    one, two = (-1 - start) / ray, (1 - start) / ray
    first, last = np.minimum(one, two), np.maximum(one, two)
    if shape != "round":
        enter, leave = first.max(axis=2), last.min(axis=2)
    else:
        square = (ray[..., :2] ** 2).sum(axis=2)
        nearest = -(start[..., :2] * ray[..., :2]).sum(axis=2) / square
        gap = 1 - (start[..., :2] ** 2).sum(axis=2) + square * nearest**2
        reach = np.sqrt(np.maximum(gap, 0.0) / square)
        enter, leave = np.maximum(nearest - reach, first[..., 2]), np.minimum(nearest + reach, last[..., 2])
    missed = enter > leave
    return np.where(missed, (enter + leave) / 2, enter), np.where(missed, 0.0, leave - enter)


def supports(parameters: FloatArray, directions: FloatArray, shape: Shape) -> FloatArray:
    """(k, m) how far k solids (k, 7) reach along unit directions (m, 3) of the level basis, from its origin."""
    c, s = np.cos(parameters[:, 3, None]), np.sin(parameters[:, 3, None])
    half = np.exp(parameters[:, None, 4:]) / 2
    x, y, z = directions.T
    flat = np.abs(np.stack([c * x + s * y, c * y - s * x], axis=-1) * half[..., :2])  # (k, m, 2)
    side = flat.sum(axis=2) if shape != "round" else np.sqrt((flat**2).sum(axis=2))
    return np.asarray(parameters[:, :3] @ directions.T + side + np.abs(z) * half[..., 2])

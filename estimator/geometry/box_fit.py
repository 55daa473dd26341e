"""The upright cuboid of a thing that is known by boxes alone: the one whose outlines the boxes of all views frame.

Points of a box are background for the most part, and of a small thing they are few. A box's own edges say more: each is
where the outline of the thing ends in that direction. A cuboid seen from several sides has to fit them all, so that its
sides come with the spread that the views leave. Edges at the border of a picture say nothing; an edge may lie inside
the thing's outline, where something hides the rest, rather than outside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.reconstructions.cameras import view_rays
from estimator.records.measured_object import Box, MeasuredObject
from estimator.records.scene import Instance, Scene, View
from metric_base.arrays import BoolArray, FloatArray

__all__ = ["BoxEdges", "Cuboid", "box_edges", "boxed_object", "fit_cuboid"]

# A detector's edge is good to so many pixels and to this share of its box's side.
EDGE_PX, EDGE_SHARE = 2.0, 0.03
# Edges nearer to the border of the picture are cut there.
BORDER_PX = 2.0
# Residuals, in standard deviations, at which an edge counts half: inside the outline, where things may be hidden, and
# outside.
HALF_INSIDE, HALF_OUTSIDE = 1.5, 2.5
# Footprints are between a rectangle and an ellipse: an octagon with corners cut off from this share of half a side.
CORNER = 0.6
# What is known of a cuboid before: its sides within a factor of 1.6 of what single boxes show, its centre within half a
# size of the points.
SIDE_SD, YAW_SD, CENTRE_SD = 0.5, 0.6, 0.5
# Steps of the fit, the change at which it ends, and its damping.
STEPS, ENOUGH, DAMPING = 15, 1e-3, 1e-2
# Furthest that one step goes, in sizes, natural logs and radians.
MOST_STEP = 0.4
# The errors of length, width and height are so many times what the fit states, beside a part of their own: things are
# no cuboids, and edges err alike in neighbouring views. Robust spreads in hard synthetic rooms, seeds 1000 to 1002,
# with boxes of `tests.synthetic.rooms.detections`.
SIGMA_TIMES, OWN_SIGMA = 2.2, (0.09, 0.13, 0.06)
# The height of a support plane under a thing is good to this share of the thing's height.
FOOT_SHARE = 0.03


@dataclass(frozen=True, slots=True, eq=False)
class BoxEdges:
    """The boxes of one thing in v views, at unit depth.

    edges : (v, 4) left, top, right, bottom; sigma : (v, 4) one standard deviation of each; free : (v, 4) whether it is
    not at the border of its picture; rotation : (v, 3, 3) and translation : (v, 3) from the level basis to the cameras.
    """

    edges: FloatArray
    sigma: FloatArray
    free: BoolArray
    rotation: FloatArray
    translation: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Cuboid:
    """An upright cuboid: centre (3,) in the level basis, yaw in radians, extents (3,) along its sides and up.

    sigma : (3,) standard deviations of the log extents; misfit : root mean square of the residuals that count.
    """

    centre: FloatArray
    yaw: float
    extents: FloatArray
    sigma: FloatArray
    misfit: float


def boxed_object(
    thing: MeasuredObject, scene: Scene, instances: Sequence[Instance], basis: FloatArray
) -> MeasuredObject:
    """The object with the sizes of the cuboid that its boxes frame; the same where it has masks or was skipped.

    basis : (3, 3) rows two horizontal axes and up. Where it stands is taken from its points.
    """
    boxes = [instances[row] for row in thing.members]
    if thing.skipped is not None or thing.box is None or not all(box.from_box for box in boxes):
        return thing
    cloud = scene.points if thing.cloud == "sparse" or scene.dense is None else scene.dense.points
    middle = np.median(cloud[thing.point_rows] @ basis.T, axis=0)
    along = thing.box.axes[0] @ basis.T
    foot = None
    if thing.unsupported_height is not None:
        bottom = float(thing.box.centre @ basis[2]) - float(thing.extents[2]) / 2
        foot = (bottom, FOOT_SHARE * float(thing.extents[2]))
    edges = box_edges(boxes, [scene.views[box.view] for box in boxes], basis)
    cuboid = fit_cuboid(edges, middle, float(np.arctan2(along[1], along[0])), foot)
    order = [0, 1, 2] if cuboid.extents[0] >= cuboid.extents[1] else [1, 0, 2]
    c, s = np.cos(cuboid.yaw), np.sin(cuboid.yaw)
    axes = (np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ basis)[order]
    extents = cuboid.extents[order]
    return replace(
        thing,
        extents=extents,
        sigma=np.hypot(SIGMA_TIMES * max(cuboid.misfit, 0.5) * cuboid.sigma[order], OWN_SIGMA),
        truncated=np.zeros(3, dtype=bool),
        unsupported_height=None,
        box=Box(cuboid.centre @ basis, axes, extents),
    )


def box_edges(boxes: Sequence[Instance], views: Sequence[View], basis: FloatArray) -> BoxEdges:
    """The edges of boxes in their own views, `basis` (3, 3) having up as its last row."""
    edges, sigma, free = [], [], []
    for box, view in zip(boxes, views, strict=True):
        (height, width), (left, top) = box.mask.shape, box.origin
        middles = np.array(
            [
                [left, top + height / 2],
                [left + width / 2, top],
                [left + width, top + height / 2],
                [left + width / 2, top + height],
            ]
        )
        rays = view_rays(view.camera, middles)
        edges.append([rays[0, 0], rays[1, 1], rays[2, 0], rays[3, 1]])
        sides = np.array([width, height, width, height])
        # the first parameter of every camera model is a focal length in pixels
        sigma.append((EDGE_PX + EDGE_SHARE * sides) / float(view.camera.params[0]))
        far = np.array([view.camera.width, view.camera.height]) - BORDER_PX
        free.append([left > BORDER_PX, top > BORDER_PX, left + width < far[0], top + height < far[1]])
    rotation = np.array([view.rotation for view in views]) @ basis.T
    return BoxEdges(
        np.array(edges), np.array(sigma), np.array(free), rotation, np.array([view.translation for view in views])
    )


def fit_cuboid(boxes: BoxEdges, middle: FloatArray, yaw: float, foot: tuple[float, float] | None = None) -> Cuboid:
    """The cuboid that fits the boxes best, by damped least squares with weights 1 / (1 + r^2 / c^2).

    middle : (3,) of the thing's points in the level basis; yaw : of their footprint; foot : height and standard
    deviation of what it stands on, scene units.
    """
    depth = (boxes.rotation @ middle + boxes.translation)[:, 2]
    near = depth > 0
    sides = (boxes.edges[:, 2:] - boxes.edges[:, :2])[near] * depth[near, None]  # (k, 2) width and height
    across, tall = np.maximum(np.median(sides, axis=0), np.finfo(float).tiny) if near.any() else (1.0, 1.0)
    starts = [
        np.array([*middle, yaw + turn, np.log(across), np.log(0.8 * across), np.log(tall)]) for turn in (0.0, np.pi / 4)
    ]
    fits = [_fit(boxes, start, float(np.sqrt(across * tall)), foot) for start in starts]
    return min(fits, key=lambda fit: fit[0])[1]


def _outlines(boxes: BoxEdges, parameters: FloatArray) -> FloatArray:
    """(k, v, 4) left, top, right, bottom of k cuboids, parameters (k, 7): centre, yaw, log extents."""
    ring = np.array([(1, CORNER), (CORNER, 1)])
    signs = np.array([(1, 1), (-1, 1), (1, -1), (-1, -1)])
    flat = (ring[:, None] * signs).reshape(-1, 2) / 2
    unit = np.array([[*at, z] for at in flat for z in (-0.5, 0.5)])  # (16, 3)
    local = unit * np.exp(parameters[:, None, 4:])  # (k, 16, 3)
    c, s = np.cos(parameters[:, 3, None]), np.sin(parameters[:, 3, None])
    turned = [c * local[..., 0] - s * local[..., 1], s * local[..., 0] + c * local[..., 1], local[..., 2]]
    world = np.stack(turned, axis=-1) + parameters[:, None, :3]
    camera = np.einsum("vij,knj->kvin", boxes.rotation, world) + boxes.translation[:, :, None]  # (k, v, 3, 16)
    # what is behind the camera is far to the side
    flat_camera = camera[:, :, :2] / np.maximum(camera[:, :, 2:], 1e-3 * np.abs(camera).max())
    return np.concatenate([flat_camera.min(axis=3), flat_camera.max(axis=3)], axis=2)


def _fit(boxes: BoxEdges, start: FloatArray, size: float, foot: tuple[float, float] | None) -> tuple[float, Cuboid]:
    """Cost and cuboid of one start (7,): centre, yaw, sides."""
    step = np.array([*[1e-3 * size] * 3, *[1e-3] * 4])
    prior_sd = np.array([*[CENTRE_SD * size] * 3, YAW_SD, *[SIDE_SD] * 3])
    outward = np.array([-1.0, -1.0, 1.0, 1.0])
    at = start.copy()
    for _ in range(STEPS):
        outlines = _outlines(boxes, at + np.vstack([np.zeros(7), np.diag(step)]))
        residual = (outlines[0] - boxes.edges) * outward / boxes.sigma
        slope = ((outlines[1:] - outlines[0]) * outward / boxes.sigma).transpose(1, 2, 0) / step  # (v, 4, 7)
        half = np.where(residual > 0, HALF_INSIDE, HALF_OUTSIDE)
        weight = boxes.free / (1 + (residual / half) ** 2)
        rows = slope.reshape(-1, 7)
        normal = rows.T @ (rows * weight.reshape(-1, 1)) + np.diag(prior_sd**-2)
        pull = rows.T @ (weight * residual).ravel() + (at - start) / prior_sd**2
        if foot is not None:
            height = np.exp(at[6])
            own = np.array([0, 0, 1, 0, 0, 0, -height / 2]) / foot[1]
            normal += np.outer(own, own)
            pull += own * (at[2] - height / 2 - foot[0]) / foot[1]
        change = -np.linalg.solve(normal + DAMPING * np.diag(np.diag(normal)), pull)
        change = np.clip(change, *(np.array([[-1], [1]]) * MOST_STEP * np.array([size, size, size, 1, 1, 1, 1])))
        at = at + change
        if np.abs(change / np.array([size, size, size, 1, 1, 1, 1])).max() < ENOUGH:
            break
    cost = float(
        (boxes.free * half**2 * np.log1p((residual / half) ** 2)).sum() + (((at - start) / prior_sd) ** 2).sum()
    )
    misfit = float(np.sqrt((weight * residual**2).sum() / max(float(weight.sum()), 1.0)))
    sigma = np.sqrt(np.diag(np.linalg.inv(normal)))[4:]
    return cost, Cuboid(at[:3], float(at[3]), np.exp(at[4:]), sigma, misfit)

"""One picture with one object in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.records.scene import Instance, View
from insertion.colour.encoding import linear_to_srgb, srgb_to_linear
from insertion.composite.blur import blur_layer
from insertion.composite.match import Look, grain
from insertion.composite.occlusion import hidden_share, on_support
from insertion.composite.received import received_share
from insertion.placement.surface import Surface
from insertion.render.boxes import Box, cast_box, object_box, shadow_box
from insertion.render.layers import object_layer, shadow_layer
from insertion.render.renderer import ObjectImage, ObjectRenderer
from insertion.scene.cloud import Cloud, FrontPoints

__all__ = ["Composed", "compose", "compose_traced"]

Picture = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Composed:
    """A picture with an object.

    silhouette : the box of the object's own pixels (x, y, width, height), or None; visible : the share of them that
    nothing hides; box, alpha, depth : the object's visible coverage and its depth in a part of the picture.
    """

    picture: Picture
    silhouette: tuple[int, int, int, int] | None
    visible: float
    box: Box | None = None
    alpha: NDArray[np.float32] | None = None
    depth: NDArray[np.float32] | None = None

    def whole(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(h, w) visible coverage and depth (NaN where the object is not) over the whole picture."""
        alpha = np.zeros(self.picture.shape[:2], np.float32)
        depth = np.full(self.picture.shape[:2], np.nan, np.float32)
        if self.box is not None and self.alpha is not None and self.depth is not None:
            alpha[self.box.slices], depth[self.box.slices] = self.alpha, self.depth
        return alpha, depth


def compose(
    picture: Picture,
    view: View,
    renderer: ObjectRenderer,
    cloud: Cloud,
    front: FrontPoints,
    instances: Sequence[Instance],
    plane: Surface | None,
    look: Look,
    seed: int,
) -> Composed:
    """The picture (h, w, 3) with the object, its shadow, and what stands in front of both.

    In linear light: out = frame * share * (1 - a) + gain * object * (1 - hidden), a = alpha * (1 - hidden).
    """
    body_box = object_box(view, renderer.body)
    dark_box = shadow_box(view, renderer.body, renderer.plane)
    if body_box is None and dark_box is None:
        return Composed(picture, None, 0.0)
    box = dark_box.union(body_box) if dark_box is not None else body_box
    assert box is not None  # one of the two is there
    box = box.union(cast_box(view, renderer.body, renderer.casting))
    layer = _nothing(box)
    if body_box is not None:
        layer = _within(object_layer(renderer, view, body_box), body_box, box)
    hidden = hidden_share(layer, box, view, instances, front, on_support(renderer.body, cloud, front))
    share, plane_depth = shadow_layer(renderer, view, box)
    share = received_share(share, plane_depth, renderer, view, box, front, instances, plane)
    before = picture[box.slices]
    after = _blend(before, layer, hidden, share, look, box, seed)
    out = picture.copy()
    out[box.slices] = after
    visible = _visible(layer.alpha, hidden)
    return Composed(out, _silhouette(layer.alpha, box), visible, box, layer.alpha * (1 - hidden), layer.depth)


def compose_traced(
    picture: Picture,
    view: View,
    renderers: Sequence[ObjectRenderer],
    traced: NDArray[np.float32],
    cloud: Cloud,
    front: FrontPoints,
    instances: Sequence[Instance],
    look: Look,
    seed: int,
) -> tuple[Picture, list[Composed]]:
    """The picture with all objects as another renderer drew them together, and what each of them covers.

    traced : (h, w, 4) linear light, premultiplied, of the objects and their shadows on the support, through the lens.
    """
    whole = Box(0, 0, view.camera.width, view.camera.height)
    hidden = np.zeros(whole.shape, np.float32)
    each = []
    for renderer in renderers:
        box = object_box(view, renderer.body)
        if box is None:
            each.append(Composed(picture, None, 0.0))
            continue
        layer = _within(object_layer(renderer, view, box), box, whole)
        covered = hidden_share(layer, whole, view, instances, front, on_support(renderer.body, cloud, front))
        hidden = np.maximum(hidden, covered)
        silhouette, alpha = _silhouette(layer.alpha, whole), layer.alpha * (1 - covered)
        each.append(Composed(picture, silhouette, _visible(layer.alpha, covered), whole, alpha, layer.depth))
    flat = np.ones((*whole.shape, 3), np.float32)
    layer = ObjectImage(traced[..., :3], traced[..., 3], np.full(whole.shape, np.nan, np.float32))
    return _blend(picture, layer, hidden, flat, look, whole, seed), each


def _blend(
    before: Picture,
    layer: ObjectImage,
    hidden: NDArray[np.float32],
    share: NDArray[np.float32],
    look: Look,
    box: Box,
    seed: int,
) -> Picture:
    """The picture (h, w, 3) of a box with the layer over it, 8-bit sRGB.

    before : (h, w, 3); hidden : (h, w) share of the layer that something hides; share : (h, w, 3) of the light that is
    left.
    """
    light = srgb_to_linear(before)
    kept = (1 - hidden)[..., None]
    covering = np.dstack([layer.colour * look.gain.astype(np.float32) * kept, layer.alpha[..., None] * kept])
    covering = blur_layer(covering, look.blur)
    alpha = covering[..., 3:]
    mixed = light * share * (1 - alpha) + covering[..., :3]
    grey = linear_to_srgb(mixed)
    grey += grain(look, box, grey.mean(axis=-1), seed) * alpha
    changed = (alpha[..., 0] > 1e-3) | ((1 - share).max(axis=-1) > 1e-3)
    return np.where(changed[..., None], np.clip(np.rint(grey), 0, 255).astype(np.uint8), before)


def _silhouette(alpha: NDArray[np.float32], box: Box) -> tuple[int, int, int, int] | None:
    """The box of the object's own pixels (x, y, width, height), by its coverage alpha (h, w); None without."""
    rows, columns = np.flatnonzero((alpha > 0.5).any(axis=1)), np.flatnonzero((alpha > 0.5).any(axis=0))
    if not len(rows):
        return None
    x, y = box.x0 + int(columns[0]), box.y0 + int(rows[0])
    return x, y, int(columns[-1] - columns[0]) + 1, int(rows[-1] - rows[0]) + 1


def _visible(alpha: NDArray[np.float32], hidden: NDArray[np.float32]) -> float:
    """The share of the coverage alpha (h, w) that is not hidden; hidden : (h, w) share of each pixel."""
    total = float(alpha.sum())
    return float((alpha * (1 - hidden)).sum()) / total if total > 0 else 0.0


def _within(layer: ObjectImage, inner: Box, outer: Box) -> ObjectImage:
    """The layer of a box inside a larger one."""
    whole = _nothing(outer)
    rows = slice(inner.y0 - outer.y0, inner.y1 - outer.y0)
    columns = slice(inner.x0 - outer.x0, inner.x1 - outer.x0)
    for large, small in zip(
        (whole.colour, whole.alpha, whole.depth), (layer.colour, layer.alpha, layer.depth), strict=True
    ):
        large[rows, columns] = small
    return whole


def _nothing(box: Box) -> ObjectImage:
    empty = np.zeros(box.shape, np.float32)
    return ObjectImage(np.zeros((*box.shape, 3), np.float32), empty, np.full(box.shape, np.nan, np.float32))

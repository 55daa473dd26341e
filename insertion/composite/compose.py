"""Layers joined to a picture: the light that the objects take, then the objects, each behind what hides it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from insertion.colour import linear_to_srgb, srgb_to_linear
from insertion.composite.camera_look import REACH_PX, Look, blur_layer, grain
from insertion.render.layers import ObjectLayers
from insertion.scene.pixel_box import PixelBox

Picture = NDArray[np.uint8]
#: Pixels of the picture change where an object covers this much of them, or takes this much of their light.
LEAST_COVER, LEAST_LOSS = 1e-3, 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Joined:
    """The layers of one object with what the picture does to them, over the box of the layers.

    hidden : (h, w) share of each pixel in which something hides the object; share : (h, w, 3) of the light that the
    object leaves to what each pixel shows.
    """

    layers: ObjectLayers
    hidden: NDArray[np.float32]
    share: NDArray[np.float32]

    @property
    def alpha(self) -> NDArray[np.float32]:
        """(h, w) visible coverage."""
        return self.layers.image.alpha * (1 - self.hidden)

    @property
    def visible(self) -> float:
        """The share of the object's coverage that nothing hides."""
        total = float(self.layers.image.alpha.sum())
        return float(self.alpha.sum()) / total if total > 0 else 0.0

    def whole(self, shape: tuple[int, ...]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(h, w) visible coverage and depth (NaN where the object is not) over a whole picture of a shape."""
        alpha, depth = np.zeros(shape[:2], np.float32), np.full(shape[:2], np.nan, np.float32)
        alpha[self.layers.box.slices], depth[self.layers.box.slices] = self.alpha, self.layers.image.depth
        return alpha, depth


@dataclass(frozen=True, slots=True, eq=False)
class Composite:
    """A picture (h, w, 3) with objects, and what it was joined from over a box of it; outside it is the plate.

    over : (h, w, 4) the objects, linear and premultiplied; left : (h, w, 3) of the plate's light; both count in the
    pixels that are `changed` (h, w).
    """

    picture: Picture
    box: PixelBox
    over: NDArray[np.float32]
    left: NDArray[np.float32]
    changed: NDArray[np.bool_]

    @property
    def covering(self) -> NDArray[np.float32]:
        """(h, w, 4) the objects as they are seen, linear and premultiplied."""
        return self.over * self.changed[..., None]

    @property
    def share(self) -> NDArray[np.float32]:
        """(h, w, 3) of the plate's light that is left."""
        return np.where(self.changed[..., None], self.left, np.float32(1.0))


def behind_each_other(joined: Sequence[Joined]) -> list[Joined]:
    """The objects, each hidden also where another one is nearer, pixel by pixel."""
    result = []
    for number, item in enumerate(joined):
        hidden, box = item.hidden.copy(), item.layers.box
        for other_number, other in enumerate(joined):
            common = box.overlap(other.layers.box)
            if other_number == number or common is None:
                continue
            here, there = common.within(box), common.within(other.layers.box)
            with np.errstate(invalid="ignore"):
                nearer = other.layers.image.depth[there] < item.layers.image.depth[here]
            # what hides the other one hides this one behind it, too
            cover = other.layers.image.alpha[there] * nearer
            hidden[here] = 1 - (1 - hidden[here]) * (1 - cover)
        result.append(replace(item, hidden=hidden))
    return result


def compose(picture: Picture, joined: Sequence[Joined], look: Look, seed: int) -> Composite:
    """The picture (h, w, 3) with all objects.

    In linear light, with a = alpha (1 - hidden) of each object:
    out = frame * product of share * (1 - sum of a) + gain * sum of object * (1 - hidden).
    """
    if not joined:
        box = PixelBox(0, 0, 1, 1)
        nothing, whole = np.zeros((1, 1, 4), np.float32), np.ones((1, 1, 3), np.float32)
        return Composite(picture, box, nothing, whole, np.zeros((1, 1), bool))
    box = joined[0].layers.box
    for item in joined[1:]:
        box = box.union(item.layers.box)
    share = np.ones((*box.shape, 3), np.float32)
    covering = np.zeros((*box.shape, 4), np.float32)
    for item in joined:
        own, image = item.layers.box.within(box), item.layers.image
        share[own] *= item.share
        covering[own] += np.dstack([image.colour, image.alpha]) * (1 - item.hidden)[..., None]
    return _covered_picture(picture, covering, share, look, box, seed)


def compose_traced(
    picture: Picture, traced: NDArray[np.float32], joined: Sequence[Joined], look: Look, seed: int
) -> Composite:
    """The picture (h, w, 3) with all objects as another renderer drew them together.

    traced : (h, w, 4) linear light, premultiplied, of the objects and their shadows on the support, through the lens.
    joined : the layers of the objects over the whole picture, whose depths say which of them each pixel shows.
    """
    whole = PixelBox(0, 0, picture.shape[1], picture.shape[0])
    depth = np.full(whole.shape, np.inf, np.float32)
    # a pixel of the shadow alone is hidden where the receiver is not what it shows
    hidden = np.ones(whole.shape, np.float32)
    for item in joined:
        hidden = np.minimum(hidden, 1 - (item.share < 1 - LEAST_LOSS).any(axis=-1))
    for item in joined:
        own = np.nan_to_num(item.layers.image.depth, nan=np.inf)
        nearer = own < depth
        hidden[nearer], depth[nearer] = item.hidden[nearer], own[nearer]
    covering = traced * (1 - hidden)[..., None]
    return _covered_picture(picture, covering, np.ones((*whole.shape, 3), np.float32), look, whole, seed)


def _covered_picture(
    picture: Picture, covering: NDArray[np.float32], share: NDArray[np.float32], look: Look, box: PixelBox, seed: int
) -> Composite:
    """The picture (h, w, 3), 8-bit sRGB, with a layer over a box of it.

    covering : (h, w, 4) of the box, linear and premultiplied; share : (h, w, 3) of the light that is left.
    """
    import cv2

    before = picture[box.slices]
    gain = np.append(look.gain, 1.0).astype(np.float32)
    part = _covered_part(covering[..., 3])  # of the box; blur and grain are there alone
    own = np.s_[part.y0 : part.y1, part.x0 : part.x1]
    covering = covering.copy()
    covering[own] = blur_layer(covering[own] * gain, look.blur)
    np.clip(covering[..., 3], 0.0, 1.0, out=covering[..., 3])
    least = np.minimum(np.minimum(share[..., 0], share[..., 1]), share[..., 2])  # much faster than along an axis
    changed = (covering[..., 3] > LEAST_COVER) | (least < 1 - LEAST_LOSS)
    light, alpha = srgb_to_linear(before) * share, covering[own][..., 3:]
    light[own] = light[own] * (1 - alpha) + covering[own][..., :3]
    grey = linear_to_srgb(light)
    grey[own] += grain(look, part, grey[own], seed) * alpha
    out = picture.copy()
    out[box.slices] = np.where(changed[..., None], cv2.add(grey, 0.0, dtype=cv2.CV_8U), before)  # rounded and clipped
    return Composite(out, box, covering, share, changed)


def _covered_part(alpha: NDArray[np.float32]) -> PixelBox:
    """The part of an array (h, w) that the objects cover, as far as a blur spreads them; one pixel without any."""
    rows, columns = np.flatnonzero(alpha.any(axis=1)), np.flatnonzero(alpha.any(axis=0))
    if not len(rows):
        return PixelBox(0, 0, 1, 1)
    height, width = alpha.shape
    low, high = (int(columns[0]), int(rows[0])), (int(columns[-1]) + 1, int(rows[-1]) + 1)
    return PixelBox(
        max(low[0] - REACH_PX, 0), max(low[1] - REACH_PX, 0), min(high[0] + REACH_PX, width),
        min(high[1] + REACH_PX, height),
    )  # fmt: skip

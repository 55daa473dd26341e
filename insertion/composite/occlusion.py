"""What of the object is hidden by nearer objects.

Masks have clean edges, so they decide wherever there are masks: an occluder whose points under the object are all
nearer hides the object in its whole mask. Where it is partly nearer and partly farther, and where there is no mask, the
cloud decides pixel by pixel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.records.scene import Instance, View
from insertion.render.body import Body
from insertion.render.renderer import ObjectImage
from insertion.scene.frame_masks import Upright
from insertion.scene.pixel_box import PixelBox, mask_in_box
from insertion.scene.point_cloud import Cloud, FrontPoints
from metric_base.arrays import BoolArray, FloatArray

#: Points that an order in depth rests on.
MIN_POINTS = 4
#: An occluder with this share of nearer points hides the object, with less than the rest it does not; between them the
#: pixels decide: the near leg of a table hides what stands under it, and the far leg does not.
NEARER, FARTHER = 0.97, 0.03
#: An occluder with too few points stands on what is so many pixels below it.
BELOW_PX = 4
#: Then so many nearest points of the occluder vote in each pixel.
VOTES = 5
#: A point is nearer if it lies in front of the object by this share of the depth: the cloud's own noise.
DEPTH_TOLERANCE = 0.012
#: How far beyond the object's outline points of an occluder vote, in pixels at a width of 640.
AROUND_PX = 12
#: Where there is no mask, this many nearest points of a dense cloud vote, no further than so many pixels at a width
#: of 640: plain surfaces leave few points.
DENSE_POINTS, DENSE_PX, DENSE_SHARE = 7, 24.0, 0.7
#: Points this near to a mask belong to the occluder in it: masks are drawn a little small. In pixels at a width of 640.
BORDER_PX = 8
#: Gaps between occluders that hide the object are closed up to twice this width, unless points are seen through them:
#: masks do not always meet. In pixels at a width of 640.
GAP_PX = 5
#: Points within this share of the object's size of the support plane belong to it, or within this share of their own
#: depth, which is the noise of a cloud; but never so much of the object's size that its upper part is meant.
SUPPORT_SHARE, SUPPORT_NOISE, MOST_SUPPORT = 0.05, 0.012, 0.3
#: Edges of occluders are as soft as a lens makes them, one sigma in pixels.
EDGE_PX = 0.6
#: An edge is looked for within so many pixels at a width of 640: how far masks and carried masks are off.
MATTE_PX = 4.0
#: What the guided filter takes for texture: a variance of the colours in 0 to 1. How much steeper its edges are made.
MATTE_SMOOTH, MATTE_CONTRAST = 2e-4, 2.5
#: Shares this near to 0 or 1 are a remainder of the filter, not an edge: a soft edge has passed them within a pixel.
MATTE_REMAINDER = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Occlusion:
    """share : (h, w) of each pixel in which something nearer hides the object; front : (h, w) pixels of what does."""

    share: NDArray[np.float32]
    front: NDArray[np.bool_]


def hidden_share(
    layer: ObjectImage,
    box: PixelBox,
    view: View,
    instances: Sequence[Instance],
    front: FrontPoints,
    on_support: BoolArray,
    picture: NDArray[np.uint8] | None = None,
    moving: Sequence[Upright] = (),
) -> Occlusion:
    """What hides the object in the pixels of a box.

    on_support : (m,) the points of `front` that are on what the object stands on; they hide nothing. picture :
    (h, w, 3) of the box, whose edges the hidden part follows; None leaves it as masks and points have it. moving :
    occluders that the reconstruction knows nothing of.
    """
    import cv2

    if not (layer.alpha > 0).any():
        return Occlusion(np.zeros(box.shape, np.float32), np.zeros(box.shape, dtype=bool))
    inside = front.inside(box.x0, box.y0, box.x1, box.y1)
    pixels = inside.pixels - [box.x0, box.y0]
    depths = np.where(front.marks_inside(on_support, box.x0, box.y0, box.x1, box.y1), np.inf, inside.depths)
    observed = np.ones(len(depths), dtype=bool) if inside.observed is None else inside.observed
    hidden = np.zeros(box.shape, dtype=bool)
    masked = np.zeros(box.shape, dtype=bool)
    silhouette = layer.alpha > 0.5
    width_factor = view.camera.width / 640
    reach = max(1, round(AROUND_PX * width_factor))
    around = cv2.dilate(silhouette.astype(np.uint8), np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)) > 0
    behind = _object_depth(layer)
    unknown = []
    for item in instances:
        mask = mask_in_box(item, box)
        if mask is None or not (mask & around).any():
            continue
        masked |= mask
        part = _hidden_by(mask, around, behind, pixels, depths, observed)
        if part is None:
            unknown.append(mask)
        else:
            hidden |= part
    for mask in (mask for mask in unknown if _stands_on(hidden, mask)):
        hidden |= mask
    if front.dense:
        size = 2 * round(BORDER_PX * width_factor) + 1
        at = pixels.astype(np.int64)
        free = ~(cv2.dilate(masked.astype(np.uint8), np.ones((size, size), np.uint8)) > 0)[at[:, 1], at[:, 0]]
        hidden |= _nearer_pixels(~masked & around, behind, pixels[free], depths[free], DENSE_PX * width_factor)
    for part in (upright.hides(box, view, behind) for upright in moving):
        hidden |= part
    hidden = _without_gaps(hidden, round(GAP_PX * width_factor), behind, pixels[observed], depths[observed])
    if picture is None or not (hidden & around).any():
        share = cv2.GaussianBlur(hidden.astype(np.float32), (0, 0), EDGE_PX)
    else:
        share = matte(hidden, picture, round(MATTE_PX * width_factor))
    return Occlusion(np.asarray(share), hidden)


def on_support(body: Body, cloud: Cloud, front: FrontPoints, sigma: float = 0.0) -> BoolArray:
    """(m,) which points are on the support plane: what an object stands on never hides it.

    sigma : of the plane's own points, scene units; a dense cloud is rougher than a small object's foot is high.
    """
    rise = np.abs((cloud.points[front.rows] - body.position) @ body.basis[2])
    rough = np.minimum(np.maximum(3 * sigma, SUPPORT_NOISE * front.depths), MOST_SUPPORT * body.unit)
    return np.asarray(rise < np.maximum(SUPPORT_SHARE * body.unit, rough))


def matte(hidden: NDArray[np.bool_], picture: NDArray[np.uint8], reach: int) -> NDArray[np.float32]:
    """(h, w) share of each pixel that is hidden: the edge of `hidden` (h, w) moved to the edge in the picture near it.

    The guided filter (He, Sun and Tang 2013): in each window the matte is a linear function of the picture's colours.
    It decides within `reach` pixels of the edge; further away the masks are right.
    """
    import cv2

    reach = max(reach, 2)
    size = (2 * reach + 1, 2 * reach + 1)
    rough = hidden.astype(np.float32)
    level = cv2.blur(rough, size, borderType=cv2.BORDER_REPLICATE)
    band = (level > 1e-3) & (level < 1 - 1e-3)
    if not band.any():
        return rough
    rows, columns = np.flatnonzero(band.any(axis=1)), np.flatnonzero(band.any(axis=0))
    near = tuple(
        slice(max(int(ends[0]) - 2 * reach, 0), int(ends[-1]) + 2 * reach + 1) for ends in (rows, columns)
    )  # what the windows of the band's pixels see
    rough[near] = _matte_in_band(rough[near], band[near], picture[near], size)
    return rough


def _matte_in_band(
    rough: NDArray[np.float32], band: NDArray[np.bool_], picture: NDArray[np.uint8], size: tuple[int, int]
) -> NDArray[np.float32]:
    """(h, w) the matte `rough` (h, w) with the pixels of the band (h, w) as the picture (h, w, 3) has the edge."""
    import cv2

    guide = cv2.GaussianBlur(picture, (0, 0), 0.5).astype(np.float32) / 255

    def mean(values: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(cv2.blur(values, size, borderType=cv2.BORDER_REPLICATE), dtype=np.float32)

    middle, level = mean(guide), mean(rough)
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]
    products = {pair: mean(guide[..., pair[0]] * guide[..., pair[1]]) for pair in pairs}
    spread = np.empty((*rough.shape, 3, 3), np.float32)
    for i, j in pairs:
        spread[..., i, j] = spread[..., j, i] = products[i, j] - middle[..., i] * middle[..., j]
    spread += np.eye(3, dtype=np.float32) * MATTE_SMOOTH
    along = np.stack([mean(guide[..., k] * rough) - middle[..., k] * level for k in range(3)], axis=-1)
    slope = np.linalg.solve(spread, along[..., None])[..., 0]
    offset = level - (slope * middle).sum(axis=-1)
    fitted = (mean(slope) * guide).sum(axis=-1) + mean(offset)
    # an edge that the picture does not show stays where it was; the contrast brings a weak one back to 0 and 1
    shown = np.clip((fitted - 0.5) * MATTE_CONTRAST + 0.5, 0.0, 1.0)
    strength = mean((slope * along).sum(axis=-1)) / np.maximum(mean(level * (1 - level)), 1e-3)
    weight = np.clip((strength - 0.3) / 0.4, 0.0, 1.0)
    plain = cv2.GaussianBlur(rough, (0, 0), EDGE_PX)
    mixed = weight * shown + (1 - weight) * plain
    whole = np.clip((mixed - MATTE_REMAINDER) / (1 - 2 * MATTE_REMAINDER), 0.0, 1.0)
    return np.asarray(np.where(band, whole, rough), dtype=np.float32)


def _object_depth(layer: ObjectImage) -> NDArray[np.float32]:
    """(h, w) depth of the object, beyond its outline that of the nearest pixel of it."""
    from scipy.ndimage import distance_transform_edt

    rows, columns = distance_transform_edt(~np.isfinite(layer.depth), return_distances=False, return_indices=True)
    return np.asarray(layer.depth[rows, columns])


def _hidden_by(
    mask: NDArray[np.bool_],
    around: NDArray[np.bool_],
    behind: NDArray[np.float32],
    pixels: FloatArray,
    depths: FloatArray,
    observed: BoolArray,
) -> NDArray[np.bool_] | None:
    """The pixels in which the occluder with this mask hides the object; None where too few points tell.

    mask, around, behind : (h, w), the last the object's depth; pixels : (m, 2) in the box; depths : (m,) scene units;
    observed : (m,) whether a point is certainly seen, and not through the occluder; the result is (h, w).
    """
    at = pixels.astype(np.int64)
    ratio = depths / behind[at[:, 1], at[:, 0]]
    own = mask[at[:, 1], at[:, 0]] & (np.abs(ratio - 1) > DEPTH_TOLERANCE)
    near = own & around[at[:, 1], at[:, 0]]
    voters = next(
        (some for some in (near & observed, own & observed, near, own) if np.count_nonzero(some) >= MIN_POINTS), None
    )
    if voters is None:
        return None
    nearer = ratio[voters] < 1
    share = float(nearer.mean())
    if share >= NEARER:
        return mask
    if share <= FARTHER:
        return np.zeros_like(mask)
    return mask & _by_vote(mask, pixels[voters], nearer)


def _stands_on(hidden: NDArray[np.bool_], mask: NDArray[np.bool_]) -> bool:
    """Whether what is below a mask (h, w) is hidden, (h, w): a cup on a table that hides the object hides it, too."""
    below = np.zeros_like(mask)
    below[BELOW_PX:] = mask[:-BELOW_PX]
    below &= ~mask
    return bool(below.any()) and float(hidden[below].mean()) > 0.5


def _by_vote(mask: NDArray[np.bool_], pixels: FloatArray, nearer: BoolArray) -> NDArray[np.bool_]:
    """Whether most of the nearest points of the occluder are nearer than the object, for each pixel of the mask.

    mask and the result : (h, w); pixels : (m, 2) in the box; nearer : (m,) whether each point is.
    """
    from scipy.ndimage import median_filter
    from scipy.spatial import cKDTree

    rows, columns = np.nonzero(mask)
    count = min(VOTES, (len(pixels) - 1) // 2 * 2 + 1)  # odd: no tie
    nearest = cKDTree(pixels).query(np.column_stack([columns, rows]) + 0.5, k=[*range(1, count + 1)])[1]
    result = np.zeros_like(mask)
    result[rows, columns] = nearer[nearest].mean(axis=1) > 0.5
    return np.asarray(median_filter(result, 5))


def _without_gaps(
    hidden: NDArray[np.bool_], reach: int, behind: NDArray[np.float32], pixels: FloatArray, depths: FloatArray
) -> NDArray[np.bool_]:
    """What is hidden with the narrow gaps in which no point behind the object is seen.

    hidden, behind and the result : (h, w), `behind` the object's depth; pixels : (m, 2) in the box; depths : (m,) scene
    units; reach : half the width of a gap in pixels.
    """
    import cv2

    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    closed = cv2.morphologyEx(np.pad(hidden, reach).astype(np.uint8), cv2.MORPH_CLOSE, disc)
    gaps = (closed[reach:-reach, reach:-reach] > 0) & ~hidden
    count, parts = cv2.connectedComponents(gaps.astype(np.uint8))
    if count < 2:
        return hidden
    at = pixels.astype(np.int64)
    own = parts[at[:, 1], at[:, 0]]
    farther = depths > behind[at[:, 1], at[:, 0]] * (1 + DEPTH_TOLERANCE)
    seen_through = np.bincount(own[farther], minlength=count) > 0
    seen_through[0] = True  # what is no gap
    return np.asarray(hidden | ~seen_through[parts])


def _nearer_pixels(
    where: NDArray[np.bool_], behind: NDArray[np.float32], pixels: FloatArray, depths: FloatArray, reach: float
) -> NDArray[np.bool_]:
    """Of the pixels `where`, those whose nearest points of the cloud are clearly nearer than the object.

    where, behind and the result : (h, w), `behind` the object's depth; pixels : (m, 2) in the box; depths : (m,) scene
    units; reach : in pixels.
    """
    from scipy.ndimage import median_filter
    from scipy.spatial import cKDTree

    result = np.zeros_like(where)
    rows, columns = np.nonzero(where)
    if not len(rows) or len(pixels) < DENSE_POINTS:
        return result
    distance, nearest = cKDTree(pixels).query(np.column_stack([columns, rows]) + 0.5, k=DENSE_POINTS)
    nearer = depths[nearest] < behind[rows, columns, None] * (1 - 3 * DEPTH_TOLERANCE)
    result[rows, columns] = (nearer.mean(axis=1) > DENSE_SHARE) & (distance[:, DENSE_POINTS // 2] < reach)
    return np.asarray(median_filter(result, 5))

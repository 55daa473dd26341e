"""Composite object layers over a plate: the light that the objects remove, then the objects behind their occluders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from insertion.colour import Image, linear_to_srgb, srgb_to_linear
from insertion.composite.camera_look import MAX_BLUR_REACH_PX, CameraLook, blur_layer, grain
from insertion.composite.motion_blur import smear_layer
from insertion.render.layers import ObjectLayers
from insertion.scene.pixel_box import PixelBox
from metric_base.arrays import FloatArray

#: Minimum coverage by the objects of a pixel that changes.
MIN_COVERAGE = 1e-3
#: Minimum fraction of the light that the objects remove from a pixel that changes.
MIN_LOSS = 1e-3
#: Pixels of the frame per pixel of glass from which only the mean of squares of this side is shown.
MAX_STRETCH = 8


@dataclass(frozen=True, slots=True, eq=False)
class ObjectComposite:
    """Layers of one object with its occlusion and its shadow, over the box of the layers."""

    layers: ObjectLayers
    occluded: NDArray[np.float32]  #: (h, w) occluded fraction of each pixel
    transmitted: NDArray[np.float32]  #: (h, w, 3) fraction of the light that reaches the surface past the object
    smear: FloatArray = field(default_factory=lambda: np.zeros(2))  #: (2,) motion in pixels during the exposure

    @property
    def alpha(self) -> NDArray[np.float32]:
        """(h, w) visible coverage."""
        return self.layers.image.coverage * (1 - self.occluded)

    @property
    def visible(self) -> float:
        """Fraction of the coverage that is not occluded."""
        total = float(self.layers.image.coverage.sum())
        return float(self.alpha.sum()) / total if total > 0 else 0.0

    def full_size(self, shape: tuple[int, ...]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return visible coverage and depth (h, w) over an image of a shape; the depth is NaN beyond the object."""
        alpha, depth = np.zeros(shape[:2], np.float32), np.full(shape[:2], np.nan, np.float32)
        alpha[self.layers.box.slices], depth[self.layers.box.slices] = self.alpha, self.layers.image.depth
        return alpha, depth


@dataclass(frozen=True, slots=True, eq=False)
class Composite:
    """An image with objects, and its layers over a box; outside it is the plate."""

    image: Image  #: (h, w, 3)
    box: PixelBox
    foreground: NDArray[np.float32]  #: (h, w, 4) objects, linear and premultiplied
    transmittance: NDArray[np.float32]  #: (h, w, 3) fraction of the light of the plate that remains
    changed: NDArray[np.bool_]  #: (h, w) pixels that differ from the plate; the layers hold in these only

    @property
    def visible_foreground(self) -> NDArray[np.float32]:
        """(h, w, 4) the foreground, 0 in unchanged pixels."""
        return self.foreground * self.changed[..., None]

    @property
    def visible_transmittance(self) -> NDArray[np.float32]:
        """(h, w, 3) the transmittance, 1 in unchanged pixels."""
        return np.where(self.changed[..., None], self.transmittance, np.float32(1.0))


def occlude_mutually(objects: Sequence[ObjectComposite]) -> list[ObjectComposite]:
    """Return the objects, each occluded also by the coverage of closer ones, for each pixel."""
    result = []
    for index, item in enumerate(objects):
        occluded, box = item.occluded.copy(), item.layers.box
        for other_index, other in enumerate(objects):
            common = box.overlap(other.layers.box)
            if other_index == index or common is None:
                continue
            part, other_part = common.within(box), common.within(other.layers.box)
            with np.errstate(invalid="ignore"):
                is_closer = other.layers.image.depth[other_part] < item.layers.image.depth[part]
            # an occluder of the other object occludes this one behind it too
            coverage = other.layers.image.alpha[other_part] * is_closer
            occluded[part] = 1 - (1 - occluded[part]) * (1 - coverage)
        result.append(replace(item, occluded=occluded))
    return result


def composite_objects(plate: Image, objects: Sequence[ObjectComposite], look: CameraLook, seed: int) -> Composite:
    """Composite objects over a plate.

    In linear light, with a = alpha * (1 - occluded) and t = transmitted of each object::

        image = plate * prod(t) * (1 - sum(a)) + gain * sum(colour * (1 - occluded))

    The layers of each object are smeared by its motion. Glass replaces the background by a shifted one, which is then
    part of the foreground.

    Parameters
    ----------
    plate : (h, w, 3) ndarray of uint8
        The frame without objects.
    objects : sequence of ObjectComposite
        The objects.
    look : CameraLook
        Exposure, blur and grain of the frame.
    seed : int
        Seed of the grain.
    """
    if not objects:
        box = PixelBox(0, 0, 1, 1)
        nothing, everything = np.zeros((1, 1, 4), np.float32), np.ones((1, 1, 3), np.float32)
        return Composite(plate, box, nothing, everything, np.zeros((1, 1), bool))
    box = reduce(PixelBox.union, (item.layers.box for item in objects))
    box = box.enlarged(max(int(np.ceil(np.abs(item.smear).max())) for item in objects), plate.shape)
    transmittance = np.ones((*box.shape, 3), np.float32)
    foreground = np.zeros((*box.shape, 4), np.float32)
    glasses = []
    for item in objects:
        part, image = item.layers.box.within(box), item.layers.image
        visible = (1 - item.occluded)[..., None]
        layer = np.dstack([image.colour, image.alpha]) * visible
        if image.glass is not None and image.shift is not None:
            glass, shift = np.zeros_like(foreground), np.zeros((*box.shape, 2), np.float32)
            glass[part], shift[part] = image.glass * visible, image.shift
            glasses.append((smear_layer(glass, item.smear) if item.smear.any() else glass, shift))
        if not item.smear.any():
            transmittance[part] *= item.transmitted
            foreground[part] += layer
            continue
        light, moving = np.ones_like(transmittance), np.zeros_like(foreground)
        light[part], moving[part] = item.transmitted, layer
        transmittance *= smear_layer(light, item.smear)
        foreground += smear_layer(moving, item.smear)
    return _over_plate(plate, foreground, transmittance, look, box, seed, glasses)


def composite_traced(
    plate: Image, traced: NDArray[np.float32], objects: Sequence[ObjectComposite], look: CameraLook, seed: int
) -> Composite:
    """Composite objects that another renderer has rendered together.

    Parameters
    ----------
    plate : (h, w, 3) ndarray of uint8
        The frame without objects.
    traced : (h, w, 4) ndarray of float32
        Objects and their shadows on the support through the lens, in linear light, premultiplied.
    objects : sequence of ObjectComposite
        Layers over the whole image; their depths determine which object a pixel shows.
    look : CameraLook
        Exposure, blur and grain of the frame.
    seed : int
        Seed of the grain.
    """
    box = PixelBox(0, 0, plate.shape[1], plate.shape[0])
    depth = np.full(box.shape, np.inf, np.float32)
    # a pixel of the shadow alone is occluded if it does not show the receiver
    occluded = np.ones(box.shape, np.float32)
    for item in objects:
        occluded = np.minimum(occluded, 1 - (item.transmitted < 1 - MIN_LOSS).any(axis=-1))
    for item in objects:
        object_depth = np.nan_to_num(item.layers.image.depth, nan=np.inf)
        is_closer = object_depth < depth
        occluded[is_closer], depth[is_closer] = item.occluded[is_closer], object_depth[is_closer]
    foreground = traced * (1 - occluded)[..., None]
    if objects:  # one layer of all objects has one motion
        foreground = smear_layer(foreground, np.mean([item.smear for item in objects], axis=0))
    return _over_plate(plate, foreground, np.ones((*box.shape, 3), np.float32), look, box, seed)


def _over_plate(
    plate: Image,
    foreground: NDArray[np.float32],
    transmittance: NDArray[np.float32],
    look: CameraLook,
    box: PixelBox,
    seed: int,
    glasses: Sequence[tuple[NDArray[np.float32], NDArray[np.float32]]] = (),
) -> Composite:
    """Composite a foreground (h, w, 4) and a transmittance (h, w, 3) over a box of a plate (h, w, 3).

    The foreground receives the gain, the blur and the grain of the frame. `glasses` are the layers (h, w, 4) and
    shifts (h, w, 2) of objects with glass. If both neighbours of a pixel show remote parts of the frame, as at a rim,
    the pixel shows a mean of the frame.
    """
    import cv2

    before = plate[box.slices]
    gain = np.append(look.gain, 1.0).astype(np.float32)
    coverage = sum((glass[..., 3] for glass, _ in glasses), foreground[..., 3])
    part = covered_box(coverage)  # blur and grain are computed in this part only
    covered = part.slices
    foreground = foreground.copy()
    foreground[covered] = blur_layer(foreground[covered] * gain, look.blur)
    np.clip(foreground[..., 3], 0.0, 1.0, out=foreground[..., 3])
    opaque = foreground[covered][..., 3:].copy()
    if glasses:
        light = srgb_to_linear(plate)
        light[box.slices] *= transmittance
        coarse = cv2.resize(light, None, fx=1 / MAX_STRETCH, fy=1 / MAX_STRETCH, interpolation=cv2.INTER_AREA)
    for glass, shift in glasses:
        x, y = np.meshgrid(np.arange(part.x0, part.x1), np.arange(part.y0, part.y1))
        at = (np.dstack([x + box.x0, y + box.y0]) + shift[covered]).astype(np.float32)
        rows = np.linalg.norm(np.diff(at, axis=0, prepend=at[:1], append=at[-1:]), axis=-1)
        columns = np.linalg.norm(np.diff(at, axis=1, prepend=at[:, :1], append=at[:, -1:]), axis=-1)
        stretch = np.maximum(np.minimum(rows[:-1], rows[1:]), np.minimum(columns[:, :-1], columns[:, 1:]))
        weight = np.clip((stretch - 1) / (MAX_STRETCH - 1), 0.0, 1.0)[..., None]
        sharp, mean = (
            cv2.remap(source, (at + 0.5) / side - 0.5, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
            for source, side in ((light, 1), (coarse, MAX_STRETCH))
        )
        behind = sharp + weight * (mean - sharp)
        layer = blur_layer(glass[covered] * np.dstack([behind, np.ones_like(opaque)]), look.blur)
        foreground[covered] += layer * (1 - foreground[covered][..., 3:])
    # two minima are much faster than one along the last axis
    darkest = np.minimum(np.minimum(transmittance[..., 0], transmittance[..., 1]), transmittance[..., 2])
    changed = (foreground[..., 3] > MIN_COVERAGE) | (darkest < 1 - MIN_LOSS)
    light, alpha = srgb_to_linear(before) * transmittance, foreground[covered][..., 3:]
    light[covered] = light[covered] * (1 - alpha) + foreground[covered][..., :3]
    levels = linear_to_srgb(light)
    levels[covered] += grain(look, part, levels[covered], seed) * opaque
    image = plate.copy()
    rounded = cv2.add(levels, 0.0, dtype=cv2.CV_8U)  # rounded and clipped
    image[box.slices] = np.where(changed[..., None], rounded, before)
    return Composite(image, box, foreground, transmittance, changed)


def covered_box(alpha: NDArray[np.float32]) -> PixelBox:
    """Return the box of the covered pixels of a layer (h, w), enlarged by the blur; one pixel if none is covered."""
    rows, columns = np.flatnonzero(alpha.any(axis=1)), np.flatnonzero(alpha.any(axis=0))
    if not len(rows):
        return PixelBox(0, 0, 1, 1)
    box = PixelBox(int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)
    return box.enlarged(MAX_BLUR_REACH_PX, alpha.shape)

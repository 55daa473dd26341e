"""Preview of the free positions: a numbered image, and the options that select each position."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimator.projection.cameras import pixels_in_view
from estimator.records.scene import View
from insertion.colour import Image
from insertion.footage.footage import SceneImages
from insertion.placement.at_pixel import plane_coordinates
from insertion.placement.free_space import free_positions
from insertion.placement.placement import Placement, PlacementError, PlacementSpace
from metric_base.arrays import FloatArray
from metric_base.files import write_whole

#: Colours of the positions in turn (red, green, blue).
_COLOURS = ((80, 220, 255), (255, 190, 60), (140, 255, 140), (255, 130, 220))
#: Minimum height of a footprint that contains its number, in pixels at an image width of 640.
MIN_RING_HEIGHT_PX = 26


@dataclass(frozen=True, slots=True)
class FreePosition:
    """A position of the preview."""

    number: int
    plane: int  #: index of the support plane
    xy_m: tuple[float, float]  #: metres along the axes of the plane, as `--xy`
    above_m: float  #: height above the lowest plane
    in_image: bool  #: the image of the preview shows it

    @property
    def options(self) -> str:
        """Options of the command that select the position."""
        return f"--plane {self.plane} --xy {self.xy_m[0]:.3f},{self.xy_m[1]:.3f}"


def write_preview(
    space: PlacementSpace, images: SceneImages, radius: float, height: float, file: Path
) -> list[FreePosition]:
    """Draw the footprint of an object at every free position, in the view that sees most of them.

    Parameters
    ----------
    radius, height : float
        Half the diagonal of the footprint, and height of the object, in scene units.
    file : Path
        Image to write.

    Raises
    ------
    PlacementError
        There is no free position.
    """
    import cv2

    placements = free_positions(space, radius, height)
    if not placements:
        raise PlacementError("--preview: no free level space of this size; try a smaller --size")
    azimuth = np.linspace(0, 2 * np.pi, 33)[:-1]
    circle = np.column_stack([np.cos(azimuth), np.sin(azimuth)]) * radius
    rings = [placement.position + circle @ placement.basis[:2] for placement in placements]
    row = max(images.rows, key=lambda k: sum(_is_inside(space.views[k], ring) for ring in rings))
    view, image = space.views[row], images.image(row).copy()
    shown = [_is_inside(view, ring) for ring in rings]
    for number, ring in enumerate(rings):
        if shown[number]:
            _draw_ring(image, pixels_in_view(view, ring)[0], number)
    write_whole(file, cv2.imencode(file.suffix, image[..., ::-1])[1].tobytes(), "--preview")
    return describe_positions(space, placements, shown)


def describe_positions(
    space: PlacementSpace, placements: Sequence[Placement], shown: Sequence[bool]
) -> list[FreePosition]:
    """Return the coordinates of placements on planes; `shown` states whether each is in the image."""
    lowest = space.supports.surfaces[0].plane
    positions = []
    for number, placement in enumerate(placements):
        assert placement.plane is not None  # free positions are on planes
        x, y = plane_coordinates(space, placement) * space.metres_per_unit
        above_m = float(placement.position @ lowest.basis[2] - lowest.height) * space.metres_per_unit
        positions.append(FreePosition(number, placement.plane, (float(x), float(y)), above_m, shown[number]))
    return positions


def _draw_ring(image: Image, pixels: FloatArray, number: int) -> None:
    """Draw a ring of pixels (n, 2) and its number on an image (h, w, 3)."""
    import cv2

    unit = max(1, round(image.shape[1] / 640))
    colour = _COLOURS[number % len(_COLOURS)]
    ring = pixels.round().astype(np.int32)
    x, y = (int(value) for value in pixels.mean(axis=0))
    if np.ptp(ring[:, 1]) < MIN_RING_HEIGHT_PX * unit:  # above the ring
        y = int(ring[:, 1].min()) - 14 * unit
    for shade, width in (((0, 0, 0), 4 * unit), (colour, 2 * unit)):  # a dark border is visible on a light floor
        cv2.polylines(image, [ring], True, shade, width, cv2.LINE_AA)
        origin = (x - 7 * unit, y + 8 * unit)
        cv2.putText(image, str(number), origin, cv2.FONT_HERSHEY_SIMPLEX, 0.75 * unit, shade, width, cv2.LINE_AA)


def _is_inside(view: View, ring: FloatArray) -> bool:
    """Return whether all points (n, 3) are in the image of a view."""
    return bool(np.isfinite(pixels_in_view(view, ring)[0]).all())

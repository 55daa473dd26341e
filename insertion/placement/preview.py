"""The free places for a person who chooses one: a numbered picture, and the options that put the object there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from estimator.projection.cameras import pixels_in_view
from insertion.placement.at_pixel import plane_coordinates
from insertion.placement.free_space import Space, candidates
from insertion.placement.placement import NoPlace
from insertion.request import Place
from metric_base.files import whole_file

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from estimator.records.scene import View
    from insertion.insertion_scene import PreparedScene
    from metric_base.arrays import FloatArray

#: Colours of the places in turn (red, green, blue).
_COLOURS = ((80, 220, 255), (255, 190, 60), (140, 255, 140), (255, 130, 220))


@dataclass(frozen=True, slots=True)
class FreePlace:
    """A place of the preview: its number, its plane, metres along it as `--xy` takes them, and above the lowest plane.

    in_picture : whether the preview's picture shows it.
    """

    number: int
    plane: int
    xy_m: tuple[float, float]
    above_m: float
    in_picture: bool

    @property
    def options(self) -> str:
        """What puts the object here."""
        return f"--plane {self.plane} --xy {self.xy_m[0]:.3f},{self.xy_m[1]:.3f}"


def write_preview(prepared: PreparedScene, space: Space, file: Path) -> list[FreePlace]:
    """Draw the footprint of the object at every free place, in the view that sees most of them.

    Raises NoPlace where there is none.
    """
    places = candidates(space)
    if not places:
        raise NoPlace("--preview: no free level space of this size; try a smaller --size")
    rings = [_ring(place, space.radius) for place in places]
    row = max(prepared.stills.rows, key=lambda k: sum(_inside(prepared.scene.views[k], ring) for ring in rings))
    view, picture = prepared.scene.views[row], prepared.stills.picture(row).copy()
    shown = [_inside(view, ring) for ring in rings]
    for number, ring in enumerate(rings):
        if shown[number]:
            _draw(picture, pixels_in_view(view, ring)[0], number)
    _write(picture, file)
    return free_places(prepared, space, places, shown)


def free_places(
    prepared: PreparedScene, space: Space, places: Sequence[Place], shown: Sequence[bool]
) -> list[FreePlace]:
    """What a person reads of the places; shown : whether each is in the picture."""
    metres = prepared.scale.metres_per_unit
    lowest = prepared.supports.surfaces[0].plane
    listed = []
    for number, place in enumerate(places):
        assert place.plane is not None  # free space is on planes
        x, y = plane_coordinates(space, place) * metres
        above = float(place.position @ lowest.basis[2] - lowest.height) * metres
        listed.append(FreePlace(number, place.plane, (float(x), float(y)), above, shown[number]))
    return listed


def _draw(picture: NDArray[np.uint8], pixels: FloatArray, number: int) -> None:
    """A ring of pixels (n, 2) and its number in the middle, on a picture (h, w, 3)."""
    import cv2

    thin = max(1, round(picture.shape[1] / 640))
    colour = _COLOURS[number % len(_COLOURS)]
    ring = pixels.round().astype(np.int32)
    x, y = (int(value) for value in pixels.mean(axis=0))
    if np.ptp(ring[:, 1]) < 26 * thin:  # the number does not fit: above the ring
        y = int(ring[:, 1].min()) - 14 * thin
    for shade, width in (((0, 0, 0), 4 * thin), (colour, 2 * thin)):  # dark edges show on a light floor, too
        cv2.polylines(picture, [ring], True, shade, width, cv2.LINE_AA)
        cv2.putText(
            picture, str(number), (x - 7 * thin, y + 8 * thin), cv2.FONT_HERSHEY_SIMPLEX, 0.75 * thin, shade, width,
            cv2.LINE_AA,
        )  # fmt: skip


def _write(picture: NDArray[np.uint8], file: Path) -> None:
    """Write a picture (h, w, 3), whole or not at all."""
    import cv2

    with whole_file(file, "--preview") as temporary:
        temporary.write_bytes(cv2.imencode(file.suffix, picture[..., ::-1])[1].tobytes())


def _ring(place: Place, radius: float) -> FloatArray:
    """(32, 3) points of a circle about the place in its plane; radius in scene units."""
    turn = np.linspace(0, 2 * np.pi, 33)[:-1]
    flat = np.column_stack([np.cos(turn), np.sin(turn)]) * radius
    return np.asarray(place.position + flat @ place.basis[:2])


def _inside(view: View, ring: FloatArray) -> bool:
    """Whether all points (n, 3) of a ring are in the picture of a view."""
    return bool(np.isfinite(pixels_in_view(view, ring)[0]).all())

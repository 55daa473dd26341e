"""A picture of the free places, numbered, for a person who chooses one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from estimator.reconstructions.cameras import pixels_in_view
from insertion.places.place import NoPlace, Place
from metric_base.files import whole_file

if TYPE_CHECKING:
    from estimator.records.scene import View
    from insertion.staging.insert import Placed
    from insertion.staging.stage import Stage
    from metric_base.arrays import FloatArray

__all__ = ["write_preview"]

_COLOURS = ((80, 220, 255), (255, 190, 60), (140, 255, 140), (255, 130, 220))


def write_preview(stage: Stage, places: Sequence[Place], placed: Placed, file: Path) -> None:
    """Draw the footprint of the object at every free place, in the view that sees most of them."""
    import cv2

    if not places:
        raise NoPlace("--preview: no free level space of this size; try a smaller --size")
    rings = [_ring(place, placed.body.unit / 2) for place in places]
    rows = stage.stills.rows
    row = max(rows, key=lambda k: sum(_inside(stage.scene.views[k], ring) for ring in rings))
    view, picture = stage.scene.views[row], stage.stills.picture(row).copy()
    for number, (place, ring) in enumerate(zip(places, rings, strict=True)):
        if not _inside(view, ring):
            continue
        pixels = pixels_in_view(view, ring)[0].round().astype(np.int32)
        colour = _COLOURS[number % len(_COLOURS)]
        cv2.polylines(picture, [pixels], True, colour, 2, cv2.LINE_AA)
        x, y = pixels.mean(axis=0).astype(int)
        text = f"{number}: {place.support}"
        cv2.putText(picture, text, (int(x) - 30, int(y)), cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, 1, cv2.LINE_AA)
    with whole_file(file, "--preview") as temporary:
        data = cv2.imencode(file.suffix, picture[..., ::-1])[1]
        temporary.write_bytes(data.tobytes())


def _ring(place: Place, radius: float) -> FloatArray:
    """(32, 3) points of a circle about the place in its plane; radius in scene units."""
    turn = np.linspace(0, 2 * np.pi, 33)[:-1]
    flat = np.column_stack([np.cos(turn), np.sin(turn)]) * radius
    return np.asarray(place.position + flat @ place.basis[:2])


def _inside(view: View, ring: FloatArray) -> bool:
    """Whether all points (n, 3) of a ring are in the picture of a view."""
    return bool(np.isfinite(pixels_in_view(view, ring)[0]).all())

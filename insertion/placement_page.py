"""A page on which a person puts an object into a picture: it is dragged, turned and drawn, and the command said."""

from __future__ import annotations

import json
import re
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from estimator.projection.cameras import project
from insertion.composite.compositor import single_pictures
from insertion.footage.footage import Shot
from insertion.insertion_scene import PreparedScene
from insertion.placement.placed_object import Placed, place_objects
from insertion.request import ObjectRequest, PixelPosition
from metric_base.errors import InputError, expect
from metric_base.local_page import LocalPage

if TYPE_CHECKING:
    from metric_tree.tree import Tree

#: Pictures that are offered, spread over the footage.
MOST_FRAMES = 12
#: A wish in a path: number of the picture, pixel, degrees.
_WISH = re.compile(
    r"(box|drawn|picture)/([0-9]{1,7})/(-?[0-9]{1,6}(?:\.[0-9]+)?)/(-?[0-9]{1,6}(?:\.[0-9]+)?)/(-?[0-9]{1,4})"
)


@dataclass(frozen=True, slots=True, eq=False)
class _Kept:
    """Some pictures of the footage, decoded once."""

    shots: tuple[Shot, ...]
    kept: tuple[NDArray[np.uint8], ...]

    def pictures(self) -> Iterator[tuple[Shot, NDArray[np.uint8]]]:
        """Every shot with its picture (h, w, 3)."""
        yield from zip(self.shots, self.kept, strict=True)


class PlacePage(LocalPage):
    """The page; `chosen` is the request with the place once the person is done.

    command : the words of a command that puts the object of a request there.
    """

    def __init__(
        self,
        prepared: PreparedScene,
        request: ObjectRequest,
        tree: Tree | None,
        command: Callable[[ObjectRequest], str],
        port: int = 0,
    ) -> None:
        self._kept = _some_pictures(prepared)
        self._prepared, self._tree, self._command = replace(prepared, footage=self._kept), tree, command
        self._request = replace(request, on=None, plane=None)
        self._lock = threading.Lock()  # one renderer at a time
        self._drawn: dict[str, bytes] = {}
        self.chosen: ObjectRequest | None = None
        super().__init__("--place", port)

    def answer(self, path: str) -> tuple[str, bytes] | None:
        """The page, its pictures, the outline of the object at a place, and the picture with it."""
        if path == "":
            return "text/html; charset=utf-8", Path(__file__).with_suffix(".html").read_bytes()
        if path == "start":
            return _json(
                {"model": self._request.model.name, "frames": [self._frame(shot) for shot in self._kept.shots]}
            )
        wish = _WISH.fullmatch(path)
        if wish is not None:
            return self._wish(
                wish[1], path.split("/", 1)[1], int(wish[2]), (float(wish[3]), float(wish[4])), int(wish[5])
            )
        for shot, picture in self._kept.pictures():
            if path == f"frame/{shot.index}":
                return "image/jpeg", _jpeg(picture)
        return None

    def receive(self, path: str, body: bytes) -> tuple[int, dict[str, str]] | None:
        """Take the place that is sent to `done`."""
        if path != "done":
            return None
        try:
            stated = json.loads(body)
            expect(isinstance(stated, dict), "place", "frame, x, y and facing", stated)
            asked = self._request_at(
                int(stated["frame"]), (float(stated["x"]), float(stated["y"])), int(stated["facing"])
            )
            self._place(asked)
        except (InputError, ValueError, TypeError, LookupError, ArithmeticError, RecursionError) as error:
            return 400, {"error": str(error)}
        self.chosen = asked
        self.finish()
        return 200, {"command": self._command(asked)}

    def _frame(self, shot: Shot) -> dict[str, Any]:
        assert shot.view is not None  # only such are kept
        return {
            "number": shot.index, "name": shot.name, "width": shot.view.camera.width, "height": shot.view.camera.height
        }  # fmt: skip

    def _wish(self, kind: str, key: str, number: int, at: tuple[float, float], facing: int) -> tuple[str, bytes] | None:
        if kind == "picture":
            return ("image/jpeg", self._drawn[key]) if key in self._drawn else None
        try:
            asked = self._request_at(number, at, facing)
            placed = self._place(asked)
        except LookupError:
            return None
        except InputError as error:
            return _json({"refused": str(error)})
        shot = self._shot(number)
        if kind == "box":
            return _json({"corners": _box_corners(placed, shot, self._prepared.scale.metres_per_unit)})
        with self._lock:
            (picture,) = single_pictures(self._prepared, [[placed]], shot)
            self._drawn = {key: _jpeg(picture)}
        size = " x ".join(f"{value:.3g}" for value in placed.size_m.values())
        says = [f"{size} m on {placed.place.support}", *placed.size.warnings, *placed.warnings]
        return _json({"command": self._command(asked), "says": says})

    def _shot(self, number: int) -> Shot:
        """Raises LookupError for a picture that is not on the page."""
        return {shot.index: shot for shot in self._kept.shots}[number]

    def _request_at(self, number: int, at: tuple[float, float], facing: int) -> ObjectRequest:
        return replace(self._request, at=PixelPosition(self._shot(number).name, *at), facing=float(facing))

    def _place(self, request: ObjectRequest) -> Placed:
        return place_objects(self._prepared, [request], self._tree)[0]


def _some_pictures(prepared: PreparedScene) -> _Kept:
    """Pictures with a pose, spread over the footage. Raises InputError without any."""
    posed = [shot for shot in prepared.footage.shots if shot.view is not None]
    if not posed:
        raise InputError("--place: expected a picture with a known pose; found none")
    rows = np.unique(np.linspace(0, len(posed) - 1, min(len(posed), MOST_FRAMES)).round().astype(int))
    wanted = {posed[row].index for row in rows}
    pairs = [(shot, picture) for shot, picture in prepared.footage.pictures() if shot.index in wanted]
    return _Kept(tuple(shot for shot, _ in pairs), tuple(picture for _, picture in pairs))


def _box_corners(placed: Placed, shot: Shot, metres_per_unit: float) -> list[list[float] | None]:
    """Pixels of the corners of the object's box, x fastest, then y (up), then z; None where it is not seen."""
    assert shot.view is not None
    low, high = placed.model.bounds
    foot = np.array([(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2])
    corners = np.array([[x, y, z] for z in (low[2], high[2]) for y in (low[1], high[1]) for x in (low[0], high[0])])
    scene = placed.place.position + (corners - foot) * (placed.size.factor / metres_per_unit) @ placed.turn.T
    local = scene @ shot.view.rotation.T + shot.view.translation
    pixels = project(shot.view.camera, local)
    return [
        pixel.tolist() if np.isfinite(pixel).all() and z > 0 else None
        for pixel, z in zip(pixels, local[:, 2], strict=True)
    ]


def _json(record: dict[str, Any]) -> tuple[str, bytes]:
    return "application/json", json.dumps(record).encode()


def _jpeg(picture: NDArray[np.uint8]) -> bytes:
    """A picture (h, w, 3) as JPEG."""
    import cv2

    return cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 92])[1].tobytes()

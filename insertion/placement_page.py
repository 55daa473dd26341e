"""Local web page on which the user drags, turns and renders objects in a frame (`--place`)."""

from __future__ import annotations

import json
import re
import threading
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from estimator.projection.cameras import project
from insertion.colour import Image
from insertion.composite.compositor import Compositor
from insertion.footage.footage import Frame
from insertion.insertion_scene import InsertionScene
from insertion.placement.placed_object import PlacedObject, place_objects
from insertion.request import ObjectRequest, PixelPosition
from metric_base.errors import InputError, expect
from metric_base.local_page import LocalPage, json_answer

if TYPE_CHECKING:
    from metric_tree.tree import Tree

#: Maximum number of frames on the page, evenly spaced.
MAX_FRAMES = 12
#: A path of the page: action, index of the object, index of the frame, pixel, degrees.
_ACTION = re.compile(
    r"(box|drawn|picture)/([0-9]{1,3})/([0-9]{1,7})/(-?[0-9]{1,6}(?:\.[0-9]+)?)/(-?[0-9]{1,6}(?:\.[0-9]+)?)/(-?[0-9]{1,4})"
)


class PlacementPage(LocalPage):
    """The page.

    Parameters
    ----------
    scene : InsertionScene
        The scene. Up to `MAX_FRAMES` of its frames with a pose are decoded once.
    requests : sequence of ObjectRequest
        The objects. Until the user moves an object, it has its own position.
    tree : Tree, optional
        Release for a size by the prior.
    command : callable
        Returns the command that repeats the requests.
    port : int
        Port of the page; 0 for a free one.

    Attributes
    ----------
    chosen : tuple of ObjectRequest or None
        The requests with the chosen positions, when the user has finished.

    Raises
    ------
    InputError
        No frame has a known pose.
    """

    def __init__(
        self,
        scene: InsertionScene,
        requests: Sequence[ObjectRequest],
        tree: Tree | None,
        command: Callable[[Sequence[ObjectRequest]], str],
        port: int = 0,
    ) -> None:
        posed = [frame for frame in scene.footage.frames if frame.view is not None]
        if not posed:
            raise InputError("--place: expected a frame with a known pose; found none")
        rows = np.unique(np.linspace(0, len(posed) - 1, min(len(posed), MAX_FRAMES)).round().astype(int))
        wanted = {posed[row].index for row in rows}
        self._images = {frame.index: (frame, image) for frame, image in scene.footage if frame.index in wanted}
        self._frames = tuple(frame for frame, _ in self._images.values())
        self._scene, self._tree, self._command = scene, tree, command
        self._requests = tuple(requests)
        self._lock = threading.Lock()  # one renderer at a time
        self._drawn: dict[str, bytes] = {}
        self.chosen: tuple[ObjectRequest, ...] | None = None
        super().__init__("--place", port)

    def answer(self, path: str) -> tuple[str, bytes] | None:
        """Return the page, its frames, the outline of the object at a position, or the frame with the object."""
        if path == "":
            return "text/html; charset=utf-8", Path(__file__).with_suffix(".html").read_bytes()
        if path == "start":
            frames = []
            for frame in self._frames:
                assert frame.view is not None  # only such frames are on the page
                camera = frame.view.camera
                frames.append(
                    {"number": frame.index, "name": frame.name, "width": camera.width, "height": camera.height}
                )
            return json_answer({"models": [request.model.name for request in self._requests], "frames": frames})
        action = _ACTION.fullmatch(path)
        if action is not None:
            key = path.split("/", 1)[1]
            pixel = float(action[4]), float(action[5])
            return self._act(action[1], key, int(action[2]), int(action[3]), pixel, int(action[6]))
        for index, (_, image) in self._images.items():
            if path == f"frame/{index}":
                return "image/jpeg", _jpeg(image)
        return None

    def receive(self, path: str, body: bytes) -> tuple[int, dict[str, str]] | None:
        """Receive the chosen position at `done`."""
        if path != "done":
            return None
        try:
            stated = json.loads(body)
            expect(isinstance(stated, dict), "place", "object, frame, x, y and facing", stated)
            pixel = float(stated["x"]), float(stated["y"])
            requests = self._requests_at(int(stated["object"]), int(stated["frame"]), pixel, int(stated["facing"]))
            self._place(requests)
        except (InputError, ValueError, TypeError, LookupError, ArithmeticError, RecursionError) as error:
            return 400, {"error": str(error)}
        self.chosen = requests
        self.finish()
        return 200, {"command": self._command(requests)}

    def _act(
        self, kind: str, key: str, number: int, index: int, pixel: tuple[float, float], facing: int
    ) -> tuple[str, bytes] | None:
        """Return the box of an object at a pixel, the command with the frame drawn, or the drawn frame."""
        if kind == "picture":
            return ("image/jpeg", self._drawn[key]) if key in self._drawn else None
        try:
            requests = self._requests_at(number, index, pixel, facing)
            objects = self._place(requests[number : number + 1] if kind == "box" else requests)
        except LookupError:
            return None
        except InputError as error:
            return json_answer({"refused": str(error)})
        frame, plate = self._images[index]
        if kind == "box":
            return json_answer({"corners": _box_corners(objects[0], frame)})
        with self._lock:
            scene, start_s = self._scene, self._frames[0].clock_s
            with closing(Compositor(objects, scene.light, scene.content, start_s)) as compositor:
                self._drawn, self._requests = {key: _jpeg(compositor.draw(frame, plate))}, requests
        placed = objects[number]
        size = " x ".join(f"{value:.3g}" for value in placed.size_m.values())
        lines = [f"{size} m on {placed.placement.support}", *placed.size.warnings, *placed.warnings]
        return json_answer({"command": self._command(requests), "says": lines})

    def _requests_at(
        self, number: int, index: int, pixel: tuple[float, float], facing: int
    ) -> tuple[ObjectRequest, ...]:
        """Return the requests with object `number` at a pixel. Raises LookupError if it or the frame does not exist."""
        at = PixelPosition(self._images[index][0].name, *pixel)
        requests = list(self._requests)
        requests[number] = replace(requests[number], on=None, plane=None, at=at, facing=float(facing))
        return tuple(requests)

    def _place(self, requests: Sequence[ObjectRequest]) -> list[PlacedObject]:
        return place_objects(requests, self._scene.space, self._scene.footage.frames, self._tree)


def _box_corners(placed: PlacedObject, frame: Frame) -> list[list[float] | None]:
    """Return the pixels of the corners of the object's box, x fastest, then y (up), then z; None if not visible."""
    assert frame.view is not None
    low, high = placed.model.bounds
    foot = np.array([(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2])
    corners = np.array([[x, y, z] for z in (low[2], high[2]) for y in (low[1], high[1]) for x in (low[0], high[0])])
    units = placed.size.factor / placed.metres_per_unit
    scene = placed.placement.position + (corners - foot) * units @ placed.turn.T
    local = frame.view.to_camera(scene)
    pixels = project(frame.view.camera, local)
    return [
        pixel.tolist() if np.isfinite(pixel).all() and z > 0 else None
        for pixel, z in zip(pixels, local[:, 2], strict=True)
    ]


def _jpeg(image: Image) -> bytes:
    """Return an image (h, w, 3) as JPEG."""
    import cv2

    return cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 92])[1].tobytes()

"""Local page on which a person outlines and names the objects in a few frames; it works offline.

While a name is typed, the page shows its meaning in the tree.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal
from urllib.parse import unquote

import cv2
import msgspec
import numpy as np

from capture.masks.instances_file import coco_document
from estimator.geometry.outline_measurement import MIN_BOX_VIEWS
from estimator.reconstructions.image_files import image_file
from estimator.records.scene import Scene
from estimator.results.object_priors import resolve_categories
from metric_base.errors import InputError, damage_as_field_error, in_file
from metric_base.files import write_whole
from metric_base.images import read_image
from metric_base.input_files import read_json
from metric_base.local_page import LocalPage, is_count, json_answer
from metric_tree.tree import Tree

#: Schema of the file that keeps an unfinished drawing.
SCHEMA = "metric-tree/drawing/1"
#: Number of frames to draw in: fewer show objects from one side only, more are tiring.
N_FRAMES = 5
#: Maximum number of characters of a name.
MAX_NAME_CHARS = 200
#: Number of similar names that are offered.
N_OFFERED = 8
#: Minimum side of an object in pixels.
MIN_SIDE_PX = 2.0
#: Computes the record of a drawing that the page shows, and the figure as PNG, which may be empty.
Estimator = Callable[[dict[str, Any]], tuple[dict[str, Any], bytes]]
#: Returns the description of a name, see `name_meaning`.
LookUp = Callable[[str], dict[str, Any]]


class DrawnObject(msgspec.Struct):
    """An object that a person outlined."""

    name: str
    kind: Literal["box", "polygon"]
    points: list[tuple[float, float]]  #: Corners in pixels.


class DrawnImage(msgspec.Struct):
    """The objects in a frame."""

    name: str
    objects: list[DrawnObject]


class SavedDrawing(msgspec.Struct):
    """Message of the page."""

    images: list[DrawnImage]
    done: bool = False  #: Whether the user requests the result.
    close: bool = False  #: Whether the person ends the page.


class Draft(msgspec.Struct):
    """Content of the file that keeps an unfinished drawing; its schema is first, so that `whole_file` finds it."""

    schema: str = SCHEMA
    frames: dict[str, list[DrawnObject]] = {}


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame to draw in."""

    name: str
    width: int
    height: int
    file: Path


def frames_to_draw(scene: Scene, folders: tuple[Path, ...]) -> list[Frame]:
    """Return frames spread over the capture: from each stretch, the frame with the most points of the model.

    Views without an image in `folders` (`view_matching.image_folders`) are left out; the list may be empty.
    """
    files = {view.name: image_file(folders, view) for view in scene.views}
    views = sorted((view for view in scene.views if files[view.name] is not None), key=lambda view: view.name)
    parts = np.array_split(np.arange(len(views)), max(min(N_FRAMES, len(views)), 1))
    chosen = [max((views[k] for k in part), key=lambda view: len(view.point_index)) for part in parts if len(part)]
    sizes = [(view.name, view.camera.width, view.camera.height) for view in chosen]
    return [Frame(*size, file) for size in sizes if (file := files[size[0]]) is not None]


class MaskPage(LocalPage):
    """The page, served until the person is done.

    Parameters
    ----------
    frames : list of Frame
    names : list of str
        Names to propose.
    draft : Path
        File that keeps an unfinished drawing.
    look_up : callable, optional
        Describes a name.
    port : int
        0 for a free one.
    estimate : callable, optional
        Computes the result that the page shows before it ends, so that the person may continue.

    Raises
    ------
    InputError
        The draft is no drawing; it is not replaced.
    """

    def __init__(
        self,
        frames: list[Frame],
        names: list[str],
        draft: Path,
        look_up: LookUp | None = None,
        port: int = 0,
        estimate: Estimator | None = None,
    ) -> None:
        self._frames, self._names, self._draft, self._look_up = frames, names, draft, look_up
        self._estimate, self._figure, self._one_at_a_time = estimate, b"", threading.Lock()
        expected = "a drawing that the page saved, or no file"
        with in_file(draft), damage_as_field_error(expected, ValueError, str, field="drawing"):
            kept = msgspec.convert(read_json(draft) if draft.is_file() else {}, Draft)
            self._drawing = self._checked(kept.frames)
        super().__init__("--draw", port)

    def collect(self) -> dict[str, Any]:
        """Serve until the person is done, and return the COCO dataset of the drawing."""
        self.serve()
        return self._instances()

    def start(self) -> dict[str, Any]:
        """Return the initial state of the page: frames, names to propose, and the earlier drawing."""
        frames = [
            {
                "name": frame.name,
                "width": frame.width,
                "height": frame.height,
                "objects": msgspec.to_builtins(self._drawing[frame.name]),
            }
            for frame in self._frames
        ]
        return {"frames": frames, "names": self._names, "box_frames": MIN_BOX_VIEWS}

    def save(self, document: Any) -> dict[str, Any]:
        """Keep a drawing; if it is done, return the result that the page shows.

        The page ends when it is closed, or done without a result to show.

        Raises
        ------
        ValueError
            It is no drawing of these frames, or it is done and empty, or cannot be estimated.
        """
        saved = msgspec.convert(document, SavedDrawing)
        drawing = self._checked({image.name: image.objects for image in saved.images})
        write_whole(self._draft, json.dumps(msgspec.to_builtins(Draft(frames=drawing))), "--work", SCHEMA)
        self._drawing = drawing
        if (saved.done or saved.close) and not any(drawing.values()):
            raise ValueError("draw at least one object first")
        if saved.done and self._estimate is not None:
            with self._one_at_a_time:
                shown, self._figure = self._estimate(self._instances())
            return {"answer": {**shown, "figure": bool(self._figure)}}
        if saved.done or saved.close:
            self.finish()
        return {}

    def answer(self, path: str) -> tuple[str, bytes] | None:
        """Return content type and body for a path below the secret one, or None."""
        if path == "":
            return "text/html; charset=utf-8", Path(__file__).with_suffix(".html").read_bytes()
        if path == "start":
            return json_answer(self.start())
        if path.startswith("name/") and self._look_up is not None:
            name = unquote(path.removeprefix("name/"), errors="replace").strip()
            meaning = {"known": False, "says": f"a name has 1 to {MAX_NAME_CHARS} characters", "offers": []}
            if 0 < len(name) <= MAX_NAME_CHARS:
                meaning = self._look_up(name)
            return json_answer(meaning)
        if path.partition("?")[0] == "figure" and self._figure:
            return "image/png", self._figure
        number = path.removeprefix("frame/")
        if path.startswith("frame/") and is_count(number) and int(number) < len(self._frames):
            # Browsers rotate images by EXIF and cannot show TIFF; the model refers to the pixels as they are stored.
            pixels = read_image(self._frames[int(number)].file, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
            return None if pixels is None else ("image/jpeg", cv2.imencode(".jpg", pixels)[1].tobytes())
        return None

    def receive(self, path: str, body: bytes) -> tuple[int, dict[str, Any]] | None:
        """Keep the drawing that is sent to `save`."""
        if path != "save":
            return None
        try:
            return 200, self.save(json.loads(body))
        except InputError as error:
            return 500, {"error": f"the drawing cannot be kept or estimated: {error}"}
        except (ValueError, OverflowError, RecursionError) as error:
            return 400, {"error": str(error)}

    def _instances(self) -> dict[str, Any]:
        """Return the COCO dataset of the drawing; polygons have a segmentation, boxes do not."""
        rows = []
        for k, frame in enumerate(self._frames):
            for drawn in self._drawing[frame.name]:
                points = np.array(drawn.points, dtype=np.float64)
                left, top = points.min(axis=0).tolist()
                width, height = np.ptp(points, axis=0).tolist()
                row = {"bbox": [left, top, width, height], "area": width * height, "iscrowd": 0}
                if drawn.kind == "polygon":
                    row["segmentation"] = [points.ravel().tolist()]
                rows.append((k, drawn.name, row))
        images = [(frame.name, frame.width, frame.height) for frame in self._frames]
        return {"info": {"description": "drawn on the page of estimate-scale"}} | coco_document(images, rows)

    def _checked(self, objects: Mapping[str, list[DrawnObject]]) -> dict[str, list[DrawnObject]]:
        """Return the objects of every frame of the page, clipped to it; raises ValueError."""
        drawing: dict[str, list[DrawnObject]] = {frame.name: [] for frame in self._frames}
        if not drawing.keys() >= objects.keys():
            raise ValueError("expected the frames of this page")
        for frame in self._frames:
            for drawn in objects.get(frame.name, []):
                name, n_corners = drawn.name.strip(), 2 if drawn.kind == "box" else 3
                if not 0 < len(name) <= MAX_NAME_CHARS:
                    raise ValueError("every object needs a name")
                if len(drawn.points) < n_corners or not np.isfinite(drawn.points).all():
                    raise ValueError(f"{name}: expected {n_corners} or more corners x, y")
                points = np.clip(np.array(drawn.points, dtype=np.float64), 0, (frame.width, frame.height))
                if np.ptp(points, axis=0).min() < MIN_SIDE_PX:
                    raise ValueError(f"{name}: it is smaller than two pixels")
                drawing[frame.name].append(DrawnObject(name, drawn.kind, points.tolist()))
        return drawing


def name_meaning(tree: Tree, text: str) -> dict[str, Any]:
    """Return whether the tree has a name, a sentence with its node and median size, and similar names.

    The name is resolved as the labels of a detector are.
    """
    meaning = resolve_categories(tree, {text})[text]
    offers = [node.name for node in tree.search(text, N_OFFERED)]
    sentence = str(meaning.reason)
    if meaning.node is not None and meaning.prior is not None:
        medians = meaning.prior.quantile(0.5) / 1000
        sizes = ", ".join(f"{name} {size:.2g} m" for name, size in zip(meaning.prior.dims, medians, strict=True))
        sentence = "; ".join([f"{meaning.node.name}: usually {sizes}", *meaning.notes])
    return {"known": meaning.prior is not None, "says": sentence, "offers": list(dict.fromkeys(offers))}

"""A page on which a person draws round the objects in a few frames and names them; offline, on loopback alone.

What a person's name for an object means in the tree, while it is typed.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from estimator.geometry.outline_measurement import MIN_BOX_VIEWS
from estimator.records.scene import Scene
from estimator.results.object_priors import CategoryMatch, resolve_categories
from metric_base.errors import InputError, Unquoted
from metric_base.files import whole_file
from metric_base.input_files import read_json
from metric_base.local_page import LocalPage, is_count
from metric_tree.tree import Tree

#: Of what was drawn so far.
SCHEMA = "metric-tree/drawing/1"
#: Frames to draw in: fewer leave objects measured from one side, more tire.
FRAMES = 5
#: Longest name of an object, and what is said of a longer one.
LONGEST_NAME = 200
UNNAMED = {"known": False, "says": f"a name has 1 to {LONGEST_NAME} characters", "offers": []}
#: What a drawing says about the scale: the record that the page shows, and the figure as PNG, empty without one.
Estimator = Callable[[dict[str, Any]], tuple[dict[str, Any], bytes]]
#: Says of a name whether it is known, a sentence, and which others to offer.
LookUp = Callable[[str], dict[str, Any]]
#: Objects by the file name of a frame, each `{"name", "kind", "points"}`; kind is `box` or `polygon`, points pixels.
Drawing = dict[str, list[dict[str, Any]]]
#: Names that are offered for what was typed.
OFFERED = 8


@dataclass(frozen=True, slots=True)
class _Frame:
    name: str
    width: int
    height: int
    file: Path


def frames_to_draw(scene: Scene, folder: Path) -> list[_Frame]:
    """Frames spread over the capture, of each stretch the one that sees most points of the model."""
    views = sorted(scene.views, key=lambda view: view.name)
    parts = np.array_split(np.arange(len(views)), min(FRAMES, len(views)))
    chosen = [max((views[k] for k in part), key=lambda view: len(view.point_index)) for part in parts]
    return [_Frame(view.name, view.camera.width, view.camera.height, folder / view.name) for view in chosen]


def instances_document(frames: list[_Frame], drawing: Mapping[str, list[dict[str, Any]]]) -> dict[str, Any]:
    """The COCO dataset of a drawing: polygons as such, boxes as boxes."""
    names = sorted({item["name"] for items in drawing.values() for item in items})
    rows = [(k + 1, item) for k, frame in enumerate(frames) for item in drawing.get(frame.name, [])]
    return {
        "info": {"description": "drawn on the page of estimate-scale"},
        "images": [
            {"id": k + 1, "file_name": frame.name, "width": frame.width, "height": frame.height}
            for k, frame in enumerate(frames)
        ],
        "categories": [{"id": k + 1, "name": name} for k, name in enumerate(names)],
        "annotations": [
            {"id": k + 1, "image_id": image, "category_id": names.index(item["name"]) + 1, **_shape(item)}
            for k, (image, item) in enumerate(rows)
        ],
    }


class MaskPage(LocalPage):
    """The page, served until the person is done.

    look_up : says what a name means, as `ObjectNames` does; estimate : what the page shows of a drawing before it ends,
    so that one may draw on.
    """

    def __init__(
        self,
        frames: list[_Frame],
        names: list[str],
        draft: Path,
        look_up: LookUp | None = None,
        port: int = 0,
        estimate: Estimator | None = None,
    ) -> None:
        self._frames, self._names, self._draft, self._look_up = frames, names, draft, look_up
        self._estimate, self._figure, self._one_at_a_time = estimate, b"", threading.Lock()
        self._sizes = {frame.name: (frame.width, frame.height) for frame in frames}
        self._drawing = _draft_of(draft, self._sizes)
        super().__init__("--draw", port)

    def collect(self) -> dict[str, Any]:
        """Serve until the person is done; the COCO dataset of what was drawn."""
        self.serve()
        return instances_document(self._frames, self._drawing)

    def start(self) -> dict[str, Any]:
        """What the page begins with: frames, names to propose, and what was drawn before."""
        frames = [
            {"name": frame.name, "width": frame.width, "height": frame.height, "objects": self._drawing[frame.name]}
            for frame in self._frames
        ]
        return {"frames": frames, "names": self._names, "box_frames": MIN_BOX_VIEWS}

    def save(self, document: Any) -> dict[str, Any]:
        """Keep what was drawn; of a drawing that is done, the answer that the page shows, if it shows one.

        The page ends when it is closed, or done where it shows no answer.

        Raises
        ------
        ValueError
            It is not a drawing of these frames, or it is done and empty, or cannot be estimated.
        """
        drawing = _check_drawing(document, self._sizes)
        with whole_file(self._draft, "--work", SCHEMA) as file:
            file.write_text(json.dumps({"schema": SCHEMA, "frames": drawing}), encoding="utf-8")
        self._drawing = drawing
        done, closed = (document.get(name) is True for name in ("done", "close"))
        if (done or closed) and not any(drawing.values()):
            raise ValueError("draw at least one object first")
        if done and self._estimate is not None:
            with self._one_at_a_time:
                shown, self._figure = self._estimate(instances_document(self._frames, drawing))
            return {"answer": {**shown, "figure": bool(self._figure)}}
        if done or closed:
            self.finish()
        return {}

    def answer(self, path: str) -> tuple[str, bytes] | None:
        """Content type and body for a path below the secret one, or None."""
        if path == "":
            return "text/html; charset=utf-8", Path(__file__).with_suffix(".html").read_bytes()
        if path == "start":
            return "application/json", json.dumps(self.start()).encode()
        if path.startswith("name/") and self._look_up is not None:
            name = unquote(path.removeprefix("name/"), errors="replace").strip()
            meaning = self._look_up(name) if 0 < len(name) <= LONGEST_NAME else UNNAMED
            return "application/json", json.dumps(meaning).encode()
        if path.partition("?")[0] == "figure" and self._figure:
            return "image/png", self._figure
        number = path.removeprefix("frame/")
        if path.startswith("frame/") and is_count(number) and int(number) < len(self._frames):
            return "image/*", self._frames[int(number)].file.read_bytes()
        return None

    def receive(self, path: str, body: bytes) -> tuple[int, dict[str, Any]] | None:
        """Keep the drawing that is sent to `save`."""
        if path != "save":
            return None
        try:
            return 200, self.save(json.loads(body))
        except InputError as error:
            return 500, {"error": f"the drawing cannot be kept or estimated: {error}"}
        except (ValueError, RecursionError) as error:
            return 400, {"error": str(error)}


def _shape(item: dict[str, Any]) -> dict[str, Any]:
    points = np.array(item["points"], dtype=np.float64)
    (left, top), (right, bottom) = points.min(axis=0), points.max(axis=0)
    box = [float(left), float(top), float(right - left), float(bottom - top)]
    row: dict[str, Any] = {"bbox": box, "area": box[2] * box[3], "iscrowd": 0}
    if item["kind"] == "polygon":
        row["segmentation"] = [points.ravel().tolist()]
    return row


def _draft_of(file: Path, sizes: Mapping[str, tuple[int, int]]) -> Drawing:
    """What an earlier page kept of the same frames; sizes : width and height by name.

    Raises
    ------
    InputError
        The file is no drawing: to begin anew would lose what somebody drew.
    """
    kept = read_json(file) if file.is_file() else {}
    kept = kept.get("frames") if isinstance(kept, dict) and kept else kept
    try:
        if not isinstance(kept, dict):
            raise ValueError("no frames by name")
        images = [{"name": name, "objects": kept[name]} for name in sizes if name in kept]
        return _check_drawing({"images": images}, sizes)
    except ValueError as error:
        raise InputError.at(file, "drawing", "what the page kept, or no such file", Unquoted(str(error))) from None


def _check_drawing(document: Any, sizes: Mapping[str, tuple[int, int]]) -> Drawing:
    drawing: Drawing = {name: [] for name in sizes}
    if not isinstance(document, dict) or not isinstance(document.get("images"), list):
        raise ValueError("expected a list of images")
    for image in document["images"]:
        name = image.get("name") if isinstance(image, dict) else None
        if not isinstance(name, str) or name not in sizes or not isinstance(image.get("objects"), list):
            raise ValueError("expected the frames of this page")
        drawing[name] = [_check_object(one, sizes[name]) for one in image["objects"]]
    return drawing


def _check_object(drawn: Any, size: tuple[int, int]) -> dict[str, Any]:
    if not isinstance(drawn, dict) or drawn.get("kind") not in ("box", "polygon"):
        raise ValueError("expected a box or a polygon")
    name = drawn.get("name")
    if not isinstance(name, str) or not name.strip() or len(name.strip()) > LONGEST_NAME:
        raise ValueError("every object needs a name")
    try:
        points = np.array(drawn.get("points"), dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name}: expected corners x, y") from None
    least = 2 if drawn["kind"] == "box" else 3
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < least or not np.isfinite(points).all():
        raise ValueError(f"{name}: expected {least} or more corners x, y")
    points = np.clip(points, 0, size)
    if (points.max(axis=0) - points.min(axis=0)).min() < 2:
        raise ValueError(f"{name}: it is smaller than two pixels")
    return {"name": name.strip(), "kind": drawn["kind"], "points": points.tolist()}


@dataclass(frozen=True, slots=True, eq=False)
class ObjectNames:
    """The names of a tree, read as the labels of a detector are."""

    tree: Tree

    def __call__(self, text: str) -> dict[str, Any]:
        """Whether the name is known, a sentence about it, and names that begin like it or mean something near it."""
        meaning = resolve_categories(self.tree, {text})[text]
        offers = [node.name for node in self.tree.search(text, OFFERED)]
        return {"known": meaning.prior is not None, "says": _sentence(meaning), "offers": list(dict.fromkeys(offers))}


def _sentence(meaning: CategoryMatch) -> str:
    """The node with its median size, or why there is none."""
    if meaning.node is None or meaning.prior is None:
        return str(meaning.reason)
    middle = meaning.prior.quantile(0.5) / 1000
    sizes = ", ".join(f"{name} {size:.2g} m" for name, size in zip(meaning.prior.dims, middle, strict=True))
    notes = "".join(f"; {note}" for note in meaning.notes)
    return f"{meaning.node.name}: usually {sizes}{notes}"

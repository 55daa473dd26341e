"""Detectors of one stage by the outputs of their ONNX graphs: YOLO (v8, 11 and later, with or without masks), RT-DETR.

| form | outputs |
|---|---|
| YOLO-seg | (1, 4 + classes + k, n) boxes x y w h, scores and k coefficients; (1, k, h, w) the masks' basis |
| YOLO-seg without NMS after it | (1, n, 6 + k) x1 y1 x2 y2 score class and coefficients; (1, k, h, w) |
| YOLO | (1, 4 + classes, n), or (1, n, 6) |
| RT-DETR of Ultralytics | (1, n, 4 + classes), boxes x y w h in shares of the picture |
| RT-DETR of Hugging Face | logits (1, n, classes) and boxes (1, n, 4) in shares |
| RT-DETR of its authors | labels (1, n), boxes (1, n, 4) x1 y1 x2 y2 in pixels, scores (1, n) |

The input is RGB from 0 to 1; YOLO's is padded with grey to its shape, RT-DETR's stretched. Classes count from 0.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import BoolArray, FloatArray, IntArray

OneStageForm = Literal["yolo", "yolo-end", "detr", "detr-logits", "detr-authors"]

#: Boxes of one class that overlap by more than this are one object (Ultralytics' own default).
OVERLAP = 0.7
#: Sides of the input where the graph leaves them free, and the grey of the padding.
SIDE_PX, GREY = 640, 114
#: Most candidates that are compared with each other: YOLO makes 8,400 of a picture, most of them with low scores.
MOST_CANDIDATES = 10_000
#: Most boxes of a picture after that.
MOST_KEPT = 1000
#: Longest text of the names in a graph: Open Images has 20,000 names.
LONGEST_NAMES = 1 << 20
#: Columns of a row that is already decided: a box, a score, a class.
_DECIDED = 6
_BOX_COLUMNS = 4

Found = tuple[FloatArray, IntArray, FloatArray, tuple[BoolArray, ...] | None]


def one_stage_form(outputs: Sequence[Any]) -> OneStageForm | None:
    """Which form a graph's outputs are of, or None."""
    shapes = [tuple(node.shape) for node in outputs]
    ranks = sorted(len(shape) for shape in shapes)
    threes = [shape for shape in shapes if len(shape) == 3]
    if ranks == [2, 2, 3] and threes[0][2] == 4:
        return "detr-authors"
    if ranks == [3, 3] and sum(shape[2] == 4 for shape in threes) == 1:
        return "detr-logits"
    if ranks not in ([3], [3, 4]) or (isinstance(threes[0][0], int) and threes[0][0] != 1):
        return None
    first, last = threes[0][1], threes[0][2]
    basis = next((shape[1] for shape in shapes if len(shape) == 4), 0)
    if isinstance(last, int) and isinstance(basis, int) and last == _DECIDED + basis:
        return "yolo-end"
    wide = isinstance(last, int) and (not isinstance(first, int) or first > last)
    form: OneStageForm = "detr" if wide and ranks == [3] else "yolo"
    columns = last if form == "detr" else first
    return form if isinstance(columns, int) and columns > _BOX_COLUMNS else None


def class_names(metadata: dict[str, str]) -> tuple[str, ...] | None:
    """The names that Ultralytics writes into its graphs, label 0 being the background; None where there are none."""
    text = metadata.get("names", "")
    try:
        names = ast.literal_eval(text if len(text) < LONGEST_NAMES else "")
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        return None
    if isinstance(names, dict) and names and all(isinstance(key, int) and 0 <= key < 100_000 for key in names):
        return ("", *(str(names.get(key, "")) for key in range(max(names) + 1)))
    return ("", *map(str, names)) if isinstance(names, list) and names else None


def one_stage_inputs(
    inputs: Sequence[Any], form: OneStageForm, picture: NDArray[np.uint8]
) -> tuple[dict[str, Any], FloatArray, FloatArray]:
    """What the graph is fed by name, and the factor (2,) and shift (2,) from the picture's pixels to its own."""
    import cv2

    height, width = picture.shape[:2]
    image = next(node for node in inputs if len(node.shape) == 4)
    sides = [side if isinstance(side, int) else SIDE_PX for side in image.shape[2:]]
    if form.startswith("yolo"):
        ratio = min(sides[0] / height, sides[1] / width)
        new = (round(width * ratio), round(height * ratio))
    else:
        new = (sides[1], sides[0])
    shift = np.array([(sides[1] - new[0]) // 2, (sides[0] - new[1]) // 2])
    canvas = np.full((*sides, 3), GREY, dtype=np.uint8)
    canvas[shift[1] : shift[1] + new[1], shift[0] : shift[0] + new[0]] = cv2.resize(picture, new)
    fed = np.ascontiguousarray(canvas.transpose(2, 0, 1)[None], dtype=np.float32) / np.float32(255)
    feeds: dict[str, Any] = {image.name: fed}
    for node in inputs:
        if len(node.shape) == 2:
            feeds[node.name] = np.array([[width, height]], dtype=np.int64)
    return feeds, np.array(new) / (width, height), shift.astype(float)


def one_stage_detections(
    form: OneStageForm, answers: Sequence[NDArray[Any]], picture: tuple[int, int], fed: tuple[int, int],
    factor: FloatArray, shift: FloatArray, least_score: float,
) -> Found:  # fmt: skip
    """Boxes (n, 4) x1 y1 x2 y2 in the picture's pixels, labels (n,) from 1, scores (n,), and masks where there are any.

    picture, fed : (width, height) of the picture and of what the graph was fed.
    """
    basis = next((answer[0] for answer in answers if answer.ndim == 4), None)
    boxes, classes, scores, coefficients = _rows(form, answers, picture)
    kept = np.flatnonzero(scores >= least_score)
    if len(kept) > MOST_CANDIDATES:
        raise ValueError(f"{len(kept):,} candidates of score {least_score} or more")
    if form == "yolo":
        kept = kept[_without_doubles(boxes[kept], classes[kept], scores[kept])]
    boxes, classes, scores = boxes[kept], classes[kept], scores[kept]
    if form.startswith("yolo"):
        masks = None if basis is None else _masks(basis, coefficients[kept], boxes, picture, fed, factor, shift)
        boxes = (boxes - np.tile(shift, 2)) / np.tile(factor, 2)
    else:
        masks = None
    return boxes, classes + 1, scores, masks


def _rows(
    form: OneStageForm, answers: Sequence[NDArray[Any]], picture: tuple[int, int]
) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
    """Boxes (n, 4), classes (n,) from 0, scores (n,) and coefficients (n, k) of the candidates (YOLO: fed pixels)."""
    none = np.empty((0, 0))
    if form == "detr-authors":
        boxes = next(answer[0] for answer in answers if answer.ndim == 3)
        labels = next(answer[0] for answer in answers if answer.ndim == 2 and answer.dtype.kind in "iu")
        scores = next(answer[0] for answer in answers if answer.ndim == 2 and answer.dtype.kind == "f")
        return boxes.astype(float), labels.astype(np.int64), scores.astype(float), none
    threes = [np.asarray(answer[0], dtype=float) for answer in answers if answer.ndim == 3]
    if form == "detr-logits":
        shares = next(answer for answer in threes if answer.shape[1] == 4)
        logits = next(answer for answer in threes if answer is not shares)
        chances = 1 / (1 + np.exp(-np.clip(logits, -50, 50)))
        return _box_corners(shares) * np.tile(picture, 2), chances.argmax(axis=1), chances.max(axis=1), none
    rows = threes[0]
    if form == "yolo-end":
        return rows[:, :4], rows[:, 5].astype(np.int64), rows[:, 4], rows[:, 6:]
    rows = rows.T if form == "yolo" else rows
    n_basis = next((answer.shape[1] for answer in answers if answer.ndim == 4), 0)
    chances = rows[:, 4 : rows.shape[1] - n_basis]
    boxes = _box_corners(rows[:, :4]) * (np.tile(picture, 2) if form == "detr" else 1.0)
    return boxes, chances.argmax(axis=1), chances.max(axis=1), rows[:, rows.shape[1] - n_basis :]


def _box_corners(boxes: FloatArray) -> FloatArray:
    """(n, 4) x1 y1 x2 y2 of boxes by their middle, width and height."""
    half = boxes[:, 2:] / 2
    return np.hstack([boxes[:, :2] - half, boxes[:, :2] + half])


def _without_doubles(boxes: FloatArray, classes: IntArray, scores: FloatArray) -> IntArray:
    """Rows (k,) that remain, best score first, without boxes (n, 4) that overlap a better one of their class."""
    kept: list[int] = []
    area = np.maximum(boxes[:, 2:] - boxes[:, :2], 0).prod(axis=1)
    for row in np.argsort(-scores, kind="stable").tolist():
        others = [other for other in kept if classes[other] == classes[row]]
        low = np.maximum(boxes[others, :2], boxes[row, :2])
        high = np.minimum(boxes[others, 2:], boxes[row, 2:])
        shared = np.maximum(high - low, 0).prod(axis=1)
        if not (shared > OVERLAP * (area[others] + area[row] - shared)).any():
            kept.append(row)
        if len(kept) > MOST_KEPT:
            raise ValueError(f"more than {MOST_KEPT:,} boxes that are apart")
    return np.array(kept, dtype=np.int64)


def _masks(
    basis: NDArray[Any], coefficients: FloatArray, boxes: FloatArray, picture: tuple[int, int], fed: tuple[int, int],
    factor: FloatArray, shift: FloatArray,
) -> tuple[BoolArray, ...]:  # fmt: skip
    """(H, W) of each: its combination of the basis, inside its box, at the picture's size."""
    import cv2

    masks = []
    left, top = shift.astype(int)
    inner = np.rint(np.array(picture) * factor).astype(int)
    flat = basis.reshape(len(basis), -1).astype(np.float32)
    for row, box in zip(coefficients, boxes, strict=True):
        small = (row.astype(np.float32) @ flat).reshape(basis.shape[1:])  # its sign decides: sigmoid(x) > .5
        large = cv2.resize(small, fed, interpolation=cv2.INTER_LINEAR)
        x0, y0, x1, y1 = np.clip(np.rint(box), 0, np.tile(fed, 2)).astype(int)
        inside = np.full(large.shape, -1.0, dtype=np.float32)
        inside[y0:y1, x0:x1] = large[y0:y1, x0:x1]
        part = inside[top : top + inner[1], left : left + inner[0]]
        masks.append(np.asarray(cv2.resize(part, picture, interpolation=cv2.INTER_LINEAR) > 0))
    return tuple(masks)

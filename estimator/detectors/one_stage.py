"""Interpret the outputs of one-stage detectors in ONNX: YOLO, RT-DETR and D-FINE, RF-DETR, RTMDet.

| form | outputs |
|---|---|
| YOLO-seg | (1, 4 + classes + k, n) boxes x y w h, scores and k coefficients; (1, k, h, w) the basis of the masks |
| YOLO-seg with built-in NMS | (1, n, 6 + k) x1 y1 x2 y2 score class and coefficients; (1, k, h, w) |
| YOLO | (1, 4 + classes, n), or (1, n, 6) |
| RT-DETR of Ultralytics | (1, n, 4 + classes), boxes x y w h relative to the image |
| RT-DETR of Hugging Face | logits (1, n, classes) and boxes (1, n, 4) relative to the image |
| RT-DETR and D-FINE of their authors | labels (1, n), boxes (1, n, 4) x1 y1 x2 y2 in pixels, scores (1, n) |
| RF-DETR | `dets` (1, n, 4) relative to the image, `labels` (1, n, slots) logits; (1, n, h, w) logits of masks |
| RTMDet of MMDeploy | `dets` (1, n, 5) x1 y1 x2 y2 score, `labels` (1, n); (1, n, H, W) masks from 0 to 1 |

The input is RGB from 0 to 1. For RF-DETR and RTMDet, ImageNet's mean is subtracted and the result is divided by its
standard deviation; the order of RTMDet is BGR. For YOLO, the image is centred in grey padding; for RTMDet, the padding
is on the right and below; otherwise the image is stretched. Class numbers start at 0. An RF-DETR with 91 slots has
COCO's identifiers as numbers; in others, the last slot is the background (rfdetr.roboflow.com/latest/exports/onnx).
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from metric_base.arrays import BoolArray, FloatArray, IntArray

OneStageForm = Literal["yolo", "yolo-end", "detr", "detr-logits", "detr-authors", "rfdetr", "rtmdet"]
#: Forms whose outputs are identified by name, because a graph of four slots has boxes and logits of equal shape.
NAMED_FORMS, NAMED_OUTPUTS = frozenset({"rfdetr", "rtmdet"}), ("dets", "labels")
#: Mean and standard deviation of red, green and blue in ImageNet, from 0 to 1.
IMAGENET_MEAN = np.array([0.485, 0.456, 0.406], dtype=np.float32)
IMAGENET_SD = np.array([0.229, 0.224, 0.225], dtype=np.float32)
#: Number of slots of an RF-DETR whose class numbers are COCO's identifiers.
N_COCO_SLOTS = 91
#: Minimum value of a pixel of an RTMDet mask, `mask_thr_binary` of its configuration.
MIN_RTMDET_MASK = 0.5

#: Maximum IoU of two detections of one class; the default of Ultralytics.
NMS_IOU = 0.7
#: Sides of the input if the graph does not define them, in pixels.
INPUT_SIDE_PX = 640
#: Grey value of the padding.
PADDING_GREY = 114
#: Maximum number of candidates before non-maximum suppression. YOLO returns 8,400 per image, most with low scores.
MAX_CANDIDATES = 10_000
#: Maximum number of detections of an image after it.
MAX_KEPT = 1000
#: Maximum length of the class names in a graph. Open Images has 20,000 names.
MAX_NAMES_CHARS = 1 << 20
#: Maximum class number with a name in a graph.
MAX_CLASSES = 100_000
#: Columns of a row after built-in NMS: box, score, class.
_N_FINAL_COLUMNS = 6
_N_BOX_COLUMNS = 4

#: Boxes (n, 4), labels (n,), scores (n,), and masks (H, W) if the graph returns any.
Found = tuple[FloatArray, IntArray, FloatArray, tuple[BoolArray, ...] | None]


def one_stage_form(outputs: Sequence[Any]) -> OneStageForm | None:
    """Return the form of the outputs of a graph, or None if it is not a one-stage detector."""
    shapes = [tuple(node.shape) for node in outputs]
    named = {node.name: len(node.shape) for node in outputs}
    if set(NAMED_OUTPUTS) <= named.keys() and named["dets"] == 3:
        return "rfdetr" if named["labels"] == 3 else "rtmdet"
    ranks = sorted(len(shape) for shape in shapes)
    tables = [shape for shape in shapes if len(shape) == 3]
    if ranks == [2, 2, 3] and tables[0][2] == 4:
        return "detr-authors"
    if ranks == [3, 3] and sum(shape[2] == 4 for shape in tables) == 1:
        return "detr-logits"
    if ranks not in ([3], [3, 4]) or (isinstance(tables[0][0], int) and tables[0][0] != 1):
        return None
    first, last = tables[0][1], tables[0][2]
    n_basis = next((shape[1] for shape in shapes if len(shape) == 4), 0)
    if isinstance(last, int) and isinstance(n_basis, int) and last == _N_FINAL_COLUMNS + n_basis:
        return "yolo-end"
    has_more_rows = isinstance(last, int) and (not isinstance(first, int) or first > last)
    form: OneStageForm = "detr" if has_more_rows and ranks == [3] else "yolo"
    columns = last if form == "detr" else first
    return form if isinstance(columns, int) and columns > _N_BOX_COLUMNS else None


def class_names(metadata: dict[str, str]) -> tuple[str, ...] | None:
    """Return the class names that Ultralytics writes to its graphs, after "" for the background; None without any."""
    text = metadata.get("names", "")
    try:
        names = ast.literal_eval(text if len(text) < MAX_NAMES_CHARS else "")
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        return None
    if isinstance(names, dict) and names and all(isinstance(key, int) and 0 <= key < MAX_CLASSES for key in names):
        return ("", *(str(names.get(key, "")) for key in range(max(names) + 1)))
    return ("", *map(str, names)) if isinstance(names, list) and names else None


def one_stage_inputs(
    nodes: Sequence[Any], form: OneStageForm, image: NDArray[np.uint8]
) -> tuple[dict[str, Any], FloatArray, FloatArray]:
    """Prepare the inputs of a graph.

    Parameters
    ----------
    nodes : sequence
        Inputs of the graph.
    form : OneStageForm
    image : (H, W, 3) ndarray of uint8
        RGB.

    Returns
    -------
    inputs : dict of str to ndarray
        Arrays by input name.
    factor, shift : (2,) ndarray of float
        A pixel x of the image is at factor * x + shift in the input.
    """
    from PIL import Image

    height, width = image.shape[:2]
    node = next(node for node in nodes if len(node.shape) == 4)
    sides = [side if isinstance(side, int) else INPUT_SIDE_PX for side in node.shape[2:]]
    if form.startswith("yolo") or form == "rtmdet":
        ratio = min(sides[0] / height, sides[1] / width)
        resized = (round(width * ratio), round(height * ratio))
    else:
        resized = (sides[1], sides[0])
    shift = np.array([(sides[1] - resized[0]) // 2, (sides[0] - resized[1]) // 2]) * (form != "rtmdet")
    canvas = np.full((*sides, 3), PADDING_GREY, dtype=np.uint8)
    if form == "rfdetr":  # its own resizing averages over the pixels when it reduces an image, as Pillow's does
        small = np.asarray(Image.fromarray(image).resize(resized, Image.Resampling.BILINEAR))
    else:
        small = cv2.resize(image, resized)
    canvas[shift[1] : shift[1] + resized[1], shift[0] : shift[0] + resized[0]] = small
    pixels = np.ascontiguousarray(canvas.transpose(2, 0, 1)[None], dtype=np.float32) / np.float32(255)
    if form in NAMED_FORMS:
        pixels = (pixels - IMAGENET_MEAN[:, None, None]) / IMAGENET_SD[:, None, None]
        pixels = np.ascontiguousarray(pixels[:, ::-1]) if form == "rtmdet" else pixels
    inputs: dict[str, Any] = {node.name: pixels}
    for other in nodes:
        if len(other.shape) == 2:
            inputs[other.name] = np.array([[width, height]], dtype=np.int64)
    return inputs, np.array(resized) / (width, height), shift.astype(float)


def one_stage_detections(
    form: OneStageForm, outputs: Sequence[NDArray[Any]], size: tuple[int, int], input_size: tuple[int, int],
    factor: FloatArray, shift: FloatArray, min_score: float,
) -> Found:  # fmt: skip
    """Convert the outputs of a graph to detections.

    Parameters
    ----------
    form : OneStageForm
    outputs : sequence of ndarray
    size, input_size : (width, height)
        Sizes of the image and of the input, in pixels.
    factor, shift : (2,) ndarray of float
        Results of `one_stage_inputs`.
    min_score : float

    Returns
    -------
    Found
        Boxes are x1, y1, x2, y2 in pixels of the image; labels start at 1.

    Raises
    ------
    ValueError
        There are too many candidates or detections.
    """
    if form in NAMED_FORMS:
        return _named_detections(form, outputs, size, factor, min_score)
    basis = next((output[0] for output in outputs if output.ndim == 4), None)
    boxes, classes, scores, coefficients = _candidates(form, outputs, size)
    keep = np.flatnonzero(scores >= min_score)
    if len(keep) > MAX_CANDIDATES:
        raise ValueError(f"{len(keep):,} candidates of score {min_score} or more")
    if form == "yolo" and len(keep):
        # Non-maximum suppression within each class, the best score first.
        corner_and_size = np.hstack([boxes[keep, :2], boxes[keep, 2:] - boxes[keep, :2]]).tolist()
        classes_and_scores = scores[keep].tolist(), classes[keep].tolist()
        best = np.asarray(cv2.dnn.NMSBoxesBatched(corner_and_size, *classes_and_scores, 0.0, NMS_IOU), dtype=np.int64)
        if len(best) > MAX_KEPT:
            raise ValueError(f"more than {MAX_KEPT:,} detections")
        keep = keep[best[np.argsort(-scores[keep][best], kind="stable")]]
    boxes, classes, scores = boxes[keep], classes[keep], scores[keep]
    masks = None
    if form.startswith("yolo"):
        if basis is not None:
            masks = _masks(basis, coefficients[keep], boxes, size, input_size, factor, shift)
        boxes = (boxes - np.tile(shift, 2)) / np.tile(factor, 2)
    return boxes, classes + 1, scores, masks


def _named_detections(
    form: OneStageForm, outputs: Sequence[NDArray[Any]], size: tuple[int, int], factor: FloatArray, min_score: float
) -> Found:
    """Convert boxes (1, n, 4 or 5), labels and masks (1, n, h, w) of an RF-DETR or RTMDet; result as for all forms."""
    boxes, labels, *basis = (output[0] for output in outputs)
    if form == "rfdetr":
        chances = 1 / (1 + np.exp(-np.clip(np.asarray(labels, dtype=float), -50, 50)))
        is_coco = chances.shape[1] == N_COCO_SLOTS
        # As in the original, a query counts for each class that is probable enough.
        queries, classes = np.nonzero((chances if is_coco else chances[:, :-1]) >= min_score)
        scores, classes = chances[queries, classes], classes + (not is_coco)
        corners, threshold, used = _box_corners(boxes[queries].astype(float)) * np.tile(size, 2), 0.0, np.s_[:, :]
    else:
        scores, threshold = boxes[:, 4].astype(float), MIN_RTMDET_MASK
        queries = np.flatnonzero(scores >= min_score)
        scores, classes = scores[queries], labels[queries].astype(np.int64) + 1
        corners = boxes[queries, :4].astype(float) / np.tile(factor, 2)
        width, height = np.rint(np.array(size) * factor).astype(int)
        used = np.s_[:height, :width]
    masks = None
    if basis:
        small = (np.ascontiguousarray(basis[0][query][used], dtype=np.float32) for query in queries)
        masks = tuple(cv2.resize(mask, size, interpolation=cv2.INTER_LINEAR) > threshold for mask in small)
    return corners, classes, scores, masks


def _candidates(
    form: OneStageForm, outputs: Sequence[NDArray[Any]], size: tuple[int, int]
) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
    """Return boxes (n, 4), classes (n,) from 0, scores (n,) and mask coefficients (n, k) of all candidates.

    Boxes are x1, y1, x2, y2 in pixels of the image, or of the input for YOLO.
    """
    no_coefficients = np.empty((0, 0))
    if form == "detr-authors":
        boxes = next(output[0] for output in outputs if output.ndim == 3)
        labels = next(output[0] for output in outputs if output.ndim == 2 and output.dtype.kind in "iu")
        scores = next(output[0] for output in outputs if output.ndim == 2 and output.dtype.kind == "f")
        return boxes.astype(float), labels.astype(np.int64), scores.astype(float), no_coefficients
    tables = [np.asarray(output[0], dtype=float) for output in outputs if output.ndim == 3]
    if form == "detr-logits":
        relative = next(table for table in tables if table.shape[1] == 4)
        logits = next(table for table in tables if table is not relative)
        chances = 1 / (1 + np.exp(-np.clip(logits, -50, 50)))
        corners = _box_corners(relative) * np.tile(size, 2)
        return corners, chances.argmax(axis=1), chances.max(axis=1), no_coefficients
    rows = tables[0]
    if form == "yolo-end":
        return rows[:, :4], rows[:, 5].astype(np.int64), rows[:, 4], rows[:, 6:]
    rows = rows.T if form == "yolo" else rows
    n_basis = next((output.shape[1] for output in outputs if output.ndim == 4), 0)
    chances = rows[:, 4 : rows.shape[1] - n_basis]
    boxes = _box_corners(rows[:, :4]) * (np.tile(size, 2) if form == "detr" else 1.0)
    return boxes, chances.argmax(axis=1), chances.max(axis=1), rows[:, rows.shape[1] - n_basis :]


def _box_corners(boxes: FloatArray) -> FloatArray:
    """Convert boxes (n, 4) from centre, width and height to x1, y1, x2, y2."""
    half = boxes[:, 2:] / 2
    return np.hstack([boxes[:, :2] - half, boxes[:, :2] + half])


def _masks(
    basis: NDArray[Any], coefficients: FloatArray, boxes: FloatArray, size: tuple[int, int],
    input_size: tuple[int, int], factor: FloatArray, shift: FloatArray,
) -> tuple[BoolArray, ...]:  # fmt: skip
    """Return the mask (H, W) of each detection: its combination of the basis (k, h, w) inside its box."""
    masks = []
    left, top = shift.astype(int)
    inner_width, inner_height = np.rint(np.array(size) * factor).astype(int)
    flat = basis.reshape(len(basis), -1).astype(np.float32)
    for row, box in zip(coefficients, boxes, strict=True):
        # The sign of the logit decides: sigmoid(x) > 0.5.
        small = (row.astype(np.float32) @ flat).reshape(basis.shape[1:])
        logits = cv2.resize(small, input_size, interpolation=cv2.INTER_LINEAR)
        x0, y0, x1, y1 = np.clip(np.rint(box), 0, np.tile(input_size, 2)).astype(int)
        inside = np.full(logits.shape, -1.0, dtype=np.float32)
        inside[y0:y1, x0:x1] = logits[y0:y1, x0:x1]
        without_padding = inside[top : top + inner_height, left : left + inner_width]
        masks.append(np.asarray(cv2.resize(without_padding, size, interpolation=cv2.INTER_LINEAR) > 0))
    return tuple(masks)

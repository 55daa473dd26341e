"""Run an instance detector, an ONNX graph, on images: Mask R-CNN, or a one-stage detector (`one_stage`).

A Mask R-CNN has the signature of torchvision's export. Its input is one image (3, H, W), RGB from 0 to 1. Its outputs
are boxes (n, 4) with x1, y1, x2, y2 in pixels, labels (n,), scores (n,) and masks (n, 1, H, W) from 0 to 1. Graphs of
the ONNX Model Zoo differ in two respects: their input is BGR from 0 to 255 minus the means of Caffe (`input = "caffe"`
in the registry), and their masks are small images of the boxes (n, 1, 28, 28). Results of other detectors are read from
COCO files (docs/how-to/detectors.md).

Graphs are untrusted input: time and memory of a run are limited, and outputs are checked.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.detectors.one_stage import (
    NAMED_FORMS,
    NAMED_OUTPUTS,
    OneStageForm,
    class_names,
    one_stage_detections,
    one_stage_form,
    one_stage_inputs,
)
from estimator.detectors.registry import download, registry_entry, registry_entry_of
from estimator.instances.mask_decoding import box_mask
from metric_base.arrays import BoolArray, FloatArray, IntArray
from metric_base.errors import FieldError, InputError, Unquoted, damage_as_field_error, in_file
from metric_base.input_files import read_text
from metric_base.operating_system import growth_limit
from metric_base.progress import NoticeCallback, no_notice
from taxonomy.label_lists import label_names

#: Maximum memory that a run may add, in bytes. The largest Mask R-CNN needs 4 GB for a large image.
MAX_RUN_BYTES = 12 << 30
#: Maximum time for one image, in seconds. A large Mask R-CNN needs ten.
MAX_IMAGE_S = 300.0
#: Level of onnxruntime's messages that hides its warnings, which quote names of the graph.
_FATAL = 4
#: Unless this variable is set before its import, onnxruntime writes a device id to the cache of the user.
TELEMETRY_VARIABLE = "ORT_DISABLE_TELEMETRY"
#: Colour order and range of the input of a Mask R-CNN.
InputForm = Literal["torchvision", "caffe"]
#: Minimum score of a detection. At this score, detectors trained on COCO are right about half the time. The posterior
#: assigns a larger outlier probability to low scores, but false detections also disturb the tracks.
MIN_SCORE = 0.5
#: Minimum value of a mask pixel, as in torchvision's example and in the evaluation of COCO.
MIN_MASK_VALUE = 0.5
#: Means of blue, green and red that models of Caffe subtract.
CAFFE_MEANS = (102.9801, 115.9465, 122.7717)
#: Length of the shorter side of an image for models of Caffe, in pixels.
CAFFE_SHORT_SIDE = 800
#: Maximum length of the longer side, in pixels.
CAFFE_MAX_SIDE = 1333
#: Divisor of the sides, with which these graphs were traced.
CAFFE_DIVISOR = 32
#: Maximum distance of a corner of a box from the image, in image sizes; masks of other boxes are empty.
MAX_BOX_DISTANCE = 10
#: Maximum number of detections in an image. Detectors trained on COCO return at most 100.
MAX_DETECTIONS = 1000
#: Maximum number of labels of a detector. Open Images has 20,000.
MAX_LABELS = 100_000
#: Maximum size of a file of labels, in bytes.
MAX_LABEL_BYTES = 1 << 24
#: Maximum size of a graph in bytes, which is that of its file format.
MAX_GRAPH_BYTES = 1 << 31
#: Maximum distance of a score from the range 0 to 1, due to rounding.
SCORE_TOLERANCE = 1e-3
#: Maximum side of an input or of a mask, in pixels.
MAX_SIDE_PX = 10_000
Image = NDArray[np.uint8]
#: Convert an error of onnxruntime, whose errors have no common base.
_onnx_errors = partial(damage_as_field_error, found=lambda error: (str(error).splitlines() or ["an error"])[0])


@dataclass(frozen=True, slots=True, eq=False)
class Detections:
    """Detections in one image."""

    #: (n, 4) x1, y1, x2, y2 in pixels.
    boxes: FloatArray
    #: (n,)
    labels: IntArray
    #: (n,) from 0 to 1.
    scores: FloatArray
    #: n masks (H, W) at the resolution of the image.
    masks: tuple[BoolArray, ...]
    #: True if the masks are filled boxes.
    from_boxes: bool = False


class Detector:
    """An ONNX graph with the names of its labels.

    Parameters
    ----------
    path : Path
        The graph.
    labels : sequence of str
        Names by label, label 0 being the background; "" for labels without a name. If empty, the names in the graph,
        or those of COCO.
    form : {"torchvision", "caffe"}
        Input of a Mask R-CNN.

    Raises
    ------
    InputError
        The file is not an ONNX graph, or has another signature.
    """

    def __init__(self, path: Path, labels: Sequence[str], form: InputForm = "torchvision") -> None:
        self.path, self.labels, self.form = path, tuple(labels), form
        self._session = _load_graph(path)
        inputs, outputs = self._session.get_inputs(), self._session.get_outputs()
        for node in inputs:
            sides = [side for side in node.shape if isinstance(side, int)]
            if not all(0 < side <= MAX_SIDE_PX for side in sides):
                raise InputError.at(path, "input", f"sides of 1 to {MAX_SIDE_PX:,} pixels", Unquoted(str(node.shape)))
        self._one_stage = one_stage_form(outputs)
        if self._one_stage is not None:
            names = class_names(self._session.get_modelmeta().custom_metadata_map)
            self.labels = self.labels or names or label_names("coco_91" if self._one_stage == "rfdetr" else "coco_80")
            return
        self.labels = self.labels or label_names("coco_91")
        self._input = inputs[0]
        rank = len(self._input.shape)
        if len(inputs) != 1 or rank not in (3, 4):
            found = ", ".join(f"{node.name} {node.shape}" for node in inputs)
            raise InputError.at(path, "input", "one image (3, H, W), as torchvision exports it", Unquoted(found))
        self._is_batched = rank == 4
        with in_file(path):
            self._outputs = _output_names(outputs)

    def __call__(self, image: Image) -> Detections:
        """Return the detections in an image (H, W, 3), RGB.

        Raises
        ------
        InputError
            The graph fails, or its outputs have other shapes or values than its signature.
        """
        if self._one_stage is not None:
            return self._one_stage_detections(self._one_stage, image)
        inputs, factor = self.prepare(image)
        boxes, labels, scores, masks = run_graph(
            self._session, self.path, self._outputs, {self._input.name: inputs[None] if self._is_batched else inputs}
        )
        n = len(boxes)
        shapes = (boxes.shape, labels.shape, scores.shape, masks.shape)
        if boxes.shape != (n, 4) or labels.shape != (n,) or scores.shape != (n,) or masks.shape[:2] != (n, 1):
            expected = "boxes (n, 4), labels (n,), scores (n,), masks (n, 1, H, W)"
            raise InputError.at(self.path, "outputs", expected, Unquoted(str(shapes)))
        if n and not all(0 < side <= MAX_SIDE_PX for side in masks.shape[2:]):
            raise InputError.at(self.path, "masks", f"sides of 1 to {MAX_SIDE_PX:,} pixels", masks.shape)
        self.check_scores(scores)
        boxes = np.asarray(boxes, dtype=float) / np.tile(factor, 2)
        keep = np.flatnonzero(scores >= MIN_SCORE)
        is_full_size = masks.shape[2:] == inputs.shape[1:]
        mask_of = partial(full_size_mask, masks) if is_full_size else partial(pasted_mask, masks, boxes)
        size = image.shape[1], image.shape[0]
        return Detections(
            boxes[keep],
            np.asarray(labels[keep], dtype=np.int64),
            np.asarray(scores[keep], dtype=float),
            tuple(mask_of(int(row), size) for row in keep),
        )

    def _one_stage_detections(self, form: OneStageForm, image: Image) -> Detections:
        """Run a one-stage detector; without masks, boxes are filled."""
        inputs, factor, shift = one_stage_inputs(self._session.get_inputs(), form, image)
        input_size = next(value.shape[3:1:-1] for value in inputs.values() if value.ndim == 4)
        masks_of = [node.name for node in self._session.get_outputs() if len(node.shape) == 4]
        names = [*NAMED_OUTPUTS, *masks_of] if form in NAMED_FORMS else None
        outputs = run_graph(self._session, self.path, names, inputs)
        size = image.shape[1], image.shape[0]
        try:
            boxes, labels, scores, masks = one_stage_detections(
                form, outputs, size, input_size, factor, shift, MIN_SCORE
            )
        except (IndexError, ValueError, StopIteration, MemoryError, cv2.error) as error:
            shapes = Unquoted(f"{[output.shape for output in outputs]}: {error}")
            raise InputError.at(self.path, "outputs", f"those of {form}", shapes) from None
        self.check_scores(scores)
        if masks is not None:
            return Detections(boxes, labels, scores, masks)
        with np.errstate(invalid="ignore"):
            corners = np.clip(np.nan_to_num(boxes), 0, np.tile(size, 2))
        corners[:, 2:] = np.maximum(corners[:, 2:] - corners[:, :2], 0.5)  # COCO's form: corner and sides
        filled = [box_mask(box, size) for box in corners.tolist()]
        return Detections(boxes, labels, scores, tuple(filled), from_boxes=True)

    def check_scores(self, scores: NDArray[Any]) -> None:
        """Raise InputError unless scores (n,) are between 0 and 1, and not too many of them are detections."""
        is_wrong = ~((scores > -SCORE_TOLERANCE) & (scores < 1 + SCORE_TOLERANCE))
        if is_wrong.any():
            raise InputError.at(self.path, "scores", "numbers from 0 to 1", float(scores[is_wrong][0]))
        if (count := int((scores >= MIN_SCORE).sum())) > MAX_DETECTIONS:
            expected = f"at most {MAX_DETECTIONS:,} of score {MIN_SCORE} or more in an image"
            raise InputError.at(self.path, "detections", expected, Unquoted(f"{count:,}"))

    def prepare(self, image: Image) -> tuple[NDArray[np.float32], FloatArray]:
        """Return the input (3, H', W') of a Mask R-CNN, and the factors (x, y) from pixels of the image to its own."""
        height, width = image.shape[:2]
        input_height, input_width = self._input.shape[-2:]
        if not (isinstance(input_height, int) and isinstance(input_width, int)):  # not traced for one size
            input_height, input_width = height, width
            if self.form == "caffe":
                scale = min(CAFFE_SHORT_SIDE / min(width, height), CAFFE_MAX_SIDE / max(width, height))
                input_height, input_width = round(height * scale), round(width * scale)
        if (input_width, input_height) != (width, height):
            image = cv2.resize(image, (input_width, input_height), interpolation=cv2.INTER_AREA)
        factor = np.array([input_width / width, input_height / height])
        if self.form == "torchvision":
            return np.ascontiguousarray(image.transpose(2, 0, 1), dtype=np.float32) / np.float32(255), factor
        bgr = image[:, :, ::-1].astype(np.float32) - np.array(CAFFE_MEANS, dtype=np.float32)
        rows, columns = -input_height % CAFFE_DIVISOR, -input_width % CAFFE_DIVISOR
        return np.pad(bgr.transpose(2, 0, 1), ((0, 0), (0, rows), (0, columns))), factor


def load_detector(ref: str | Path, labels: Path | None = None, notice: NoticeCallback = no_notice) -> Detector:
    """Load a detector from an ONNX file, or by its name in the registry.

    Parameters
    ----------
    ref : str or Path
        ONNX file, `detector.toml` of a network of the user, or name of a registered detector (`auto`: the recommended
        one), which is downloaded unless it is in the cache.
    labels : Path, optional
        Text file with one name per line, the first for label 1. By default, the names of the registry or of the graph,
        or the 91 ids of COCO, as in the weights of torchvision.
    notice : callable
        Called with a sentence before a download.

    Raises
    ------
    InputError
        There is no such file or name, or the download fails; the message explains how to get a detector.
    """
    is_file = Path(ref).is_file() and Path(ref).suffix != ".toml"
    if is_file and Path(ref).stat().st_size > MAX_GRAPH_BYTES:
        size = Unquoted(f"{Path(ref).stat().st_size:,}")
        raise InputError.at(ref, "--detector", f"at most {MAX_GRAPH_BYTES:,} bytes", size)
    entry = registry_entry_of(Path(ref)) if is_file else registry_entry(str(ref))
    path = Path(ref)
    if not is_file and entry is not None:
        path = entry.file or download(entry, notice)
    form: InputForm = "caffe" if entry is not None and entry.input == "caffe" else "torchvision"
    names: tuple[str, ...] = ()
    if entry is not None:
        names = label_names(entry.labels) if isinstance(entry.labels, str) else entry.labels
    if labels is not None:
        lines = read_text(labels, MAX_LABEL_BYTES).splitlines()
        if len(lines) > MAX_LABELS:
            raise InputError.at(labels, "labels", f"at most {MAX_LABELS:,} lines", Unquoted(f"{len(lines):,}"))
        names = ("", *(line.strip() for line in lines))
    return Detector(path, names, form)


def _load_graph(path: Path) -> Any:
    """Return an onnxruntime session; InputError if onnxruntime cannot load the file."""
    os.environ.setdefault(TELEMETRY_VARIABLE, "1")
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.log_severity_level = _FATAL
    with in_file(path), _onnx_errors("an ONNX graph that onnxruntime loads", field="detector"):
        return onnxruntime.InferenceSession(str(path), options, providers=onnxruntime.get_available_providers())


def run_graph(session: Any, path: Path, outputs: list[str] | None, inputs: dict[str, Any]) -> list[NDArray[Any]]:
    """Return outputs of any shape of a graph, by default all, for arrays by input name, within limits."""
    import onnxruntime

    options = onnxruntime.RunOptions()
    options.log_severity_level = _FATAL
    timer = threading.Timer(MAX_IMAGE_S, setattr, (options, "terminate", True))
    timer.daemon = True
    timer.start()
    expected = f"outputs for an image of shape {next(iter(inputs.values())).shape}"
    try:
        # A graph of a hundred bytes can allocate terabytes.
        with in_file(path), _onnx_errors(expected, field="run"), growth_limit(MAX_RUN_BYTES):
            return [np.asarray(output) for output in session.run(outputs, inputs, options)]
    finally:
        timer.cancel()


def full_size_mask(masks: NDArray[Any], row: int, size: tuple[int, int]) -> BoolArray:
    """Return a mask (H, W) that has the size of the input, resized to the (width, height) of the image."""
    mask = np.asarray(masks[row, 0], dtype=np.float32)
    if mask.shape != size[::-1]:
        mask = cv2.resize(mask, size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(mask >= MIN_MASK_VALUE)


def pasted_mask(masks: NDArray[Any], boxes: FloatArray, row: int, size: tuple[int, int]) -> BoolArray:
    """Return a mask (H, W) that is a small image of its box, resized to the box and cropped to the image."""
    width, height = size
    mask = np.zeros((height, width), dtype=bool)
    if not np.all(np.abs(boxes[row]) < MAX_BOX_DISTANCE * max(width, height)):
        return mask
    left, top = np.floor(boxes[row, :2]).astype(int)
    right, bottom = np.maximum(np.ceil(boxes[row, 2:]).astype(int), [left + 1, top + 1])
    x0, y0, x1, y1 = max(left, 0), max(top, 0), min(right, width), min(bottom, height)
    if x1 > x0 and y1 > y0:
        small = np.asarray(masks[row, 0], dtype=np.float32)
        resized = cv2.resize(small, (int(right - left), int(bottom - top)), interpolation=cv2.INTER_LINEAR)
        mask[y0:y1, x0:x1] = resized[y0 - top : y1 - top, x0 - left : x1 - left] >= MIN_MASK_VALUE
    return mask


def _output_names(outputs: Sequence[Any]) -> list[str]:
    """Return the names of boxes, labels, scores and masks, recognised by rank and type: exporters differ in names."""
    by_kind: dict[str, str] = {}
    for node in outputs:
        kind = {2: "boxes", 4: "masks"}.get(len(node.shape), "labels" if "int" in node.type else "scores")
        by_kind.setdefault(kind, node.name)
    wanted = ("boxes", "labels", "scores", "masks")
    if len(outputs) < len(wanted) or set(by_kind) != set(wanted):
        found = ", ".join(f"{node.name} {node.shape} {node.type}" for node in outputs)
        expected = "the outputs of Mask R-CNN as torchvision exports it, of YOLO or of RT-DETR"
        raise FieldError("outputs", expected, Unquoted(found))
    return [by_kind[kind] for kind in wanted]

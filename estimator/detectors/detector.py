"""Instances from a detector of the user's own: an ONNX Mask R-CNN, run by onnxruntime on the scene's pictures.

The signature is that of torchvision's export: one picture (3, H, W), RGB from 0 to 1, in; boxes (n, 4) of x1, y1, x2,
y2 pixels, labels (n,), scores (n,) and masks (n, 1, H, W) from 0 to 1 out. The graphs of the ONNX Model Zoo differ in
two objects and are read too: their input is BGR from 0 to 255 less Caffe's means (`input = "caffe"`), and their masks
are small pictures of the boxes (n, 1, 28, 28). Other detectors hand over COCO results (docs/how-to/detectors.md).

A detector's ONNX graph: loaded, and run with bounds on time and memory.
"""

from __future__ import annotations

import os
import resource
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from estimator.detectors.one_stage import (
    OneStageForm,
    class_names,
    one_stage_detections,
    one_stage_form,
    one_stage_inputs,
)
from estimator.detectors.registry import RegisteredDetector, download, registry_entry, registry_entry_of
from estimator.instances.mask_decoding import box_mask
from metric_base.arrays import BoolArray, FloatArray, IntArray
from metric_base.errors import FieldError, InputError, Unquoted, in_file
from metric_base.input_files import read_text
from taxonomy.label_lists import label_names

#: Bytes of address space that a run may add: the largest Mask R-CNN takes 4 GB for a large picture.
RUN_BYTES = 12 << 30
#: Seconds that a detector may take for one picture; a large Mask R-CNN takes ten.
PICTURE_SECONDS = 300.0
#: Of onnxruntime's five levels of messages the last: its warnings quote names of the graph as they are.
FATAL = 4
#: onnxruntime writes a device id under the user's cache unless this is set before its import.
TELEMETRY_VARIABLE = "ORT_DISABLE_TELEMETRY"
InputForm = Literal["torchvision", "caffe"]
#: Detections under this score are left out. COCO's detectors are right about half the time here; the posterior gives
#: low scores a larger outlier's share, but junk also joins tracks.
MIN_SCORE = 0.5
#: A pixel belongs to the mask from here on: torchvision's own example and COCO's evaluation.
MASK_THRESHOLD = 0.5
#: Means of blue, green, red that Caffe's models subtract; sides they were trained with (the shorter, and the longest
#: that a narrow picture may have), and the divisor their graph was traced with.
CAFFE_MEANS = (102.9801, 115.9465, 122.7717)
CAFFE_SHORT_SIDE, CAFFE_LONGEST_SIDE, CAFFE_DIVISOR = 800, 1333, 32
#: A box whose corner is this many pictures away, or no number, holds nothing that could be pasted.
FAR_BOX = 10
#: Most detections of a picture that are believed: COCO's detectors give at most 100.
MAX_DETECTIONS = 1000
#: Most names of a detector, and the largest file of them: Open Images has 20,000.
MAX_LABELS, MAX_LABEL_BYTES = 100_000, 1 << 24
#: Largest graph: a file of this form cannot be larger.
MAX_GRAPH_BYTES = 1 << 31
#: How far a score may be outside 0 to 1.
SCORE_SLACK = 1e-3
#: Longest side of a picture that a graph was traced for.
MAX_SIDE = 10_000
Picture = NDArray[np.uint8]
FloatPicture = NDArray[np.float32]


def load_graph(path: Path) -> Any:
    """The session of a graph. InputError where onnxruntime is missing or does not load the file."""
    os.environ.setdefault(TELEMETRY_VARIABLE, "1")
    try:
        import onnxruntime
    except ImportError:
        expected = "onnxruntime (pip install 'metric-tree[images]')"
        raise InputError.at(path, "detector", expected, Unquoted("not installed")) from None
    options = onnxruntime.SessionOptions()
    options.log_severity_level = FATAL
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=onnxruntime.get_available_providers())
    except Exception as error:  # noqa: BLE001 - its errors have no common base that it exports
        line = (str(error).splitlines() or ["an error"])[0]
        raise InputError.at(path, "detector", "an ONNX graph that onnxruntime loads", Unquoted(line)) from None


def graph_answers(session: Any, path: Path, outputs: list[str] | None, feeds: dict[str, Any]) -> list[NDArray[Any]]:
    """What the graph answers, arrays of any shape; its error is the file's. feeds : arrays by input name."""
    import onnxruntime

    options = onnxruntime.RunOptions()
    options.log_severity_level = FATAL
    limit = threading.Timer(PICTURE_SECONDS, setattr, (options, "terminate", True))
    limit.daemon = True
    limit.start()
    try:
        with _bounded_memory():
            return [np.asarray(answer) for answer in session.run(outputs, feeds, options)]
    except Exception as error:  # noqa: BLE001 - onnxruntime's errors have no common base that it exports
        line = (str(error).splitlines() or ["an error"])[0]
        shape = next(iter(feeds.values())).shape
        raise InputError.at(path, "run", f"an answer to a picture of shape {shape}", Unquoted(line)) from None
    finally:
        limit.cancel()


@contextmanager
def _bounded_memory() -> Iterator[None]:
    """Within the block the process may grow by `RUN_BYTES`: a graph of a hundred bytes can ask for terabytes."""
    if not sys.platform.startswith("linux"):  # the size of the process is read where Linux states it
        yield
        return
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    limits = [limit for limit in (soft, hard) if limit != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_AS, (min([pages * resource.getpagesize() + RUN_BYTES, *limits]), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


@dataclass(frozen=True, slots=True, eq=False)
class Detections:
    """What a detector saw in one picture.

    boxes : (n, 4) x1, y1, x2, y2 in pixels; labels : (n,); scores : (n,) 0 to 1; masks : n of (H, W) bool, at the
    picture's resolution; from_boxes : they are boxes that stand in for masks.
    """

    boxes: FloatArray
    labels: IntArray
    scores: FloatArray
    masks: tuple[BoolArray, ...]
    from_boxes: bool = False


class Detector:
    """An ONNX graph with its label names.

    Parameters
    ----------
    path : the graph
    labels : names by label number, label 0 being the background; "" where a number names nothing; empty for the
        names in the graph, else COCO's
    form : what the input holds

    Raises
    ------
    InputError
        It is no ONNX graph, or not of the signature.
    """

    def __init__(self, path: Path, labels: Sequence[str], form: InputForm = "torchvision") -> None:
        self.path, self.labels, self.form = path, tuple(labels), form
        self._session = load_graph(path)
        for node in self._session.get_inputs():
            sides = [side for side in node.shape if isinstance(side, int)]
            if not all(0 < side <= MAX_SIDE for side in sides):
                raise InputError.at(path, "input", f"sides of 1 to {MAX_SIDE:,} pixels", Unquoted(str(node.shape)))
        self._one_stage = one_stage_form(self._session.get_outputs())
        if self._one_stage is not None:
            named = class_names(self._session.get_modelmeta().custom_metadata_map)
            self.labels = self.labels or named or label_names("coco_80")
            return
        self.labels = self.labels or label_names("coco_91")
        self._input = self._session.get_inputs()[0]
        rank = len(self._input.shape)
        if len(self._session.get_inputs()) != 1 or rank not in (3, 4):
            inputs = ", ".join(f"{node.name} {node.shape}" for node in self._session.get_inputs())
            raise InputError.at(path, "input", "one picture (3, H, W), as torchvision exports it", Unquoted(inputs))
        self._batched = rank == 4
        with in_file(path):
            self._outputs = _output_names(self._session.get_outputs())

    def __call__(self, picture: Picture) -> Detections:
        """The detections in a picture (H, W, 3) RGB.

        Raises
        ------
        InputError
            The graph fails on it, or answers in other shapes than the signature's.
        """
        if self._one_stage is not None:
            return self._one_stage_detections(self._one_stage, picture)
        fed, factor = self._prepare(picture)
        boxes, labels, scores, masks = self._run(fed[None] if self._batched else fed)
        whole = masks.shape[2:] == fed.shape[1:]
        height, width = picture.shape[:2]
        boxes = np.asarray(boxes, dtype=float) / np.tile(factor, 2)
        kept = np.flatnonzero(scores >= MIN_SCORE)
        self._expect_few(len(kept))
        drawn = partial(_whole_mask, masks) if whole else partial(_pasted_mask, masks, boxes)
        return Detections(
            boxes[kept],
            np.asarray(labels[kept], dtype=np.int64),
            np.asarray(scores[kept], dtype=float),
            tuple(drawn(int(row), width, height) for row in kept),
        )

    def _one_stage_detections(self, form: OneStageForm, picture: Picture) -> Detections:
        """The detections of a YOLO or an RT-DETR."""
        import cv2

        feeds, factor, shift = one_stage_inputs(self._session.get_inputs(), form, picture)
        fed = next(value for value in feeds.values() if value.ndim == 4)
        answers = graph_answers(self._session, self.path, None, feeds)
        height, width = picture.shape[:2]
        try:
            boxes, labels, scores, masks = one_stage_detections(
                form, answers, (width, height), (fed.shape[3], fed.shape[2]), factor, shift, MIN_SCORE
            )
        except (IndexError, ValueError, StopIteration, MemoryError, cv2.error) as error:
            shapes = Unquoted(f"{[answer.shape for answer in answers]}: {error}")
            raise InputError.at(self.path, "outputs", f"those of {form}", shapes) from None
        self._expect_few(len(scores))
        self._expect_shares(scores)
        if masks is not None:
            return Detections(boxes, labels, scores, masks)
        with np.errstate(invalid="ignore"):
            sides = np.clip(np.nan_to_num(boxes), 0, np.tile((width, height), 2))
        drawn = [
            box_mask([*box[:2].tolist(), *np.maximum(box[2:] - box[:2], 0.5).tolist()], (width, height))
            for box in sides
        ]
        return Detections(boxes, labels, scores, tuple(drawn), from_boxes=True)

    def _expect_few(self, count: int) -> None:
        if count > MAX_DETECTIONS:
            expected = f"at most {MAX_DETECTIONS:,} of score {MIN_SCORE} or more in a picture"
            raise InputError.at(self.path, "detections", expected, Unquoted(f"{count:,}"))

    def _expect_shares(self, scores: NDArray[Any]) -> None:
        """InputError unless scores (n,) are from 0 to 1, but for rounding."""
        wrong = ~((scores > -SCORE_SLACK) & (scores < 1 + SCORE_SLACK))
        if wrong.any():
            raise InputError.at(self.path, "scores", "numbers from 0 to 1", float(scores[wrong][0]))

    def _run(self, fed: FloatPicture) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Boxes (n, 4), labels (n,), scores (n,) and masks (n, 1, H, W) of a picture (3, H, W) as it is fed."""
        boxes, labels, scores, masks = graph_answers(self._session, self.path, self._outputs, {self._input.name: fed})
        n = len(boxes)
        shapes = (boxes.shape, labels.shape, scores.shape, masks.shape)
        if boxes.shape != (n, 4) or labels.shape != (n,) or scores.shape != (n,) or masks.shape[:2] != (n, 1):
            expected = "boxes (n, 4), labels (n,), scores (n,), masks (n, 1, H, W)"
            raise InputError.at(self.path, "outputs", expected, Unquoted(str(shapes)))
        if n and not all(0 < side <= MAX_SIDE for side in masks.shape[2:]):
            raise InputError.at(self.path, "masks", f"sides of 1 to {MAX_SIDE:,} pixels", masks.shape)
        self._expect_shares(scores)
        return boxes, labels, scores, masks

    def _prepare(self, picture: Picture) -> tuple[FloatPicture, FloatArray]:
        """The input (3, H', W') and the factors (x, y) from the picture's pixels to its own."""
        import cv2

        height, width = picture.shape[:2]
        new_width, new_height = self._fed_size(width, height)
        if (new_width, new_height) != (width, height):
            picture = cv2.resize(picture, (new_width, new_height), interpolation=cv2.INTER_AREA)
        factor = np.array([new_width / width, new_height / height])
        if self.form == "torchvision":
            return np.ascontiguousarray(picture.transpose(2, 0, 1), dtype=np.float32) / np.float32(255), factor
        blue_first = picture[:, :, ::-1].astype(np.float32) - np.array(CAFFE_MEANS, dtype=np.float32)
        rows, columns = -new_height % CAFFE_DIVISOR, -new_width % CAFFE_DIVISOR
        return np.pad(blue_first.transpose(2, 0, 1), ((0, 0), (0, rows), (0, columns))), factor

    def _fed_size(self, width: int, height: int) -> tuple[int, int]:
        """(width, height) that the graph is fed: the picture's own, unless it was traced for one size or for Caffe."""
        fixed_height, fixed_width = self._input.shape[-2:]
        if isinstance(fixed_height, int) and isinstance(fixed_width, int):
            return fixed_width, fixed_height
        if self.form == "caffe":
            factor = min(CAFFE_SHORT_SIDE / min(width, height), CAFFE_LONGEST_SIDE / max(width, height))
            return round(width * factor), round(height * factor)
        return width, height


def load_detector(ref: str | Path, labels: Path | None = None) -> Detector:
    """The detector of an ONNX file, or of a name in the registry, which is downloaded where it is not yet kept.

    labels : a text file with one name per line, the first for label 1; by default COCO's 91 ids, as torchvision's own
    weights have them, or what the registry says.

    Raises
    ------
    InputError
        There is no such file or name, or the download is not to be had; the message says how to get a detector.
    """
    is_file = Path(ref).is_file()
    if is_file and Path(ref).stat().st_size > MAX_GRAPH_BYTES:
        size = Unquoted(f"{Path(ref).stat().st_size:,}")
        raise InputError.at(ref, "--detector", f"at most {MAX_GRAPH_BYTES:,} bytes", size)
    entry = registry_entry_of(Path(ref)) if is_file else registry_entry(str(ref))
    path = Path(ref) if is_file or entry is None else download(entry)
    if labels is not None:
        return Detector(path, _names(labels), _form(entry))
    names = () if entry is None else label_names(entry.labels)
    return Detector(path, names, _form(entry))


def _names(file: Path) -> tuple[str, ...]:
    """The names of a file of labels, one a line, behind that of the background."""
    lines = read_text(file, MAX_LABEL_BYTES).splitlines()
    if len(lines) > MAX_LABELS:
        raise InputError.at(file, "labels", f"at most {MAX_LABELS:,} lines", Unquoted(f"{len(lines):,}"))
    return ("", *(line.strip() for line in lines))


def _whole_mask(masks: NDArray[Any], row: int, width: int, height: int) -> BoolArray:
    """(H, W) of a mask as large as what was fed; brought to the picture's size where that was resized."""
    import cv2

    mask = np.asarray(masks[row, 0], dtype=np.float32)
    if mask.shape != (height, width):
        mask = cv2.resize(mask, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(mask >= MASK_THRESHOLD)


def _pasted_mask(masks: NDArray[Any], boxes: FloatArray, row: int, width: int, height: int) -> BoolArray:
    """(H, W) of a mask that is a small picture of its box: stretched over the box, bilinear, cut at the border."""
    import cv2

    whole = np.zeros((height, width), dtype=bool)
    if not np.all(np.abs(boxes[row]) < FAR_BOX * max(width, height)):
        return whole
    left, top = np.floor(boxes[row, :2]).astype(int)
    right, bottom = np.maximum(np.ceil(boxes[row, 2:]).astype(int), [left + 1, top + 1])
    x0, y0, x1, y1 = max(left, 0), max(top, 0), min(right, width), min(bottom, height)
    if x1 > x0 and y1 > y0:
        small = np.asarray(masks[row, 0], dtype=np.float32)
        stretched = cv2.resize(small, (int(right - left), int(bottom - top)), interpolation=cv2.INTER_LINEAR)
        whole[y0:y1, x0:x1] = stretched[y0 - top : y1 - top, x0 - left : x1 - left] >= MASK_THRESHOLD
    return whole


def _output_names(outputs: Sequence[Any]) -> list[str]:
    """Names of boxes, labels, scores and masks, recognised by rank and type: exporters name them as they like."""
    by_kind: dict[str, str] = {}
    for node in outputs:
        rank = len(node.shape)
        kind = {2: "boxes", 4: "masks"}.get(rank, "labels" if "int" in node.type else "scores")
        by_kind.setdefault(kind, node.name)
    wanted = ("boxes", "labels", "scores", "masks")
    if len(outputs) < len(wanted) or set(by_kind) != set(wanted):
        actual = ", ".join(f"{node.name} {node.shape} {node.type}" for node in outputs)
        expected = "the outputs of Mask R-CNN as torchvision exports it, of YOLO or of RT-DETR"
        raise FieldError("outputs", expected, Unquoted(actual))
    return [by_kind[kind] for kind in wanted]


def _form(entry: RegisteredDetector | None) -> InputForm:
    return "caffe" if entry is not None and entry.input == "caffe" else "torchvision"

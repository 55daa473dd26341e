"""One-stage detectors, recognised by their outputs: small real graphs whose answers are known."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper
from PIL import Image

from estimator.detectors.detector import load_detector
from estimator.detectors.one_stage import class_names, one_stage_form
from metric_base.errors import InputError

SIDE = 64
#: An image of twice the width of its height, which YOLO's input shows at half its size with grey above and below.
WIDTH, HEIGHT = 128, 64
#: The object in the image's pixels, and its class (COCO's chair is 56, counted from 0).
BOX, CLASS = (32.0, 16.0, 96.0, 48.0), 56


def _graph(
    path: Path, answers: dict[str, np.ndarray[Any, Any]], sized: bool = False, names: str = "", echo: str = ""
) -> Path:
    """A graph that answers the same to every image; its output `echo` is the input."""
    nodes = [helper.make_node("Identity", ["images" if name == echo else f"{name}_value"], [name]) for name in answers]
    inputs = [helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, 3, SIDE, SIDE])]
    if sized:
        inputs.append(helper.make_tensor_value_info("orig_target_sizes", TensorProto.INT64, [1, 2]))
    kinds = {
        name: TensorProto.INT64 if value.dtype.kind == "i" else TensorProto.FLOAT for name, value in answers.items()
    }
    outputs = [helper.make_tensor_value_info(name, kinds[name], list(value.shape)) for name, value in answers.items()]
    initial = [numpy_helper.from_array(value, f"{name}_value") for name, value in answers.items() if name != echo]
    model = helper.make_model(
        helper.make_graph(nodes, "d", inputs, outputs, initial), opset_imports=[helper.make_opsetid("", 17)]
    )
    model.ir_version = 9
    if names:
        helper.set_model_props(model, {"names": names})
    onnx.save(model, str(path))
    return path


def _fed_box() -> np.ndarray[Any, Any]:
    """x y w h in the letterboxed input: half the size, 16 pixels of grey above."""
    x0, y0, x1, y1 = np.array(BOX) / 2 + (0, 16, 0, 16)
    return np.array([(x0 + x1) / 2, (y0 + y1) / 2, x1 - x0, y1 - y0])


def _yolo(n_basis: int) -> dict[str, np.ndarray[Any, Any]]:
    """Raw rows: the object twice (the worse one is a double), another class in its place, and junk."""
    rows = np.zeros((1, 4 + 80 + n_basis, 100), dtype=np.float32)
    for column, score, number in ((3, 0.9, CLASS), (4, 0.8, CLASS), (5, 0.7, 60), (6, 0.3, 2)):
        rows[0, :4, column] = _fed_box() + (0.2 if column == 4 else 0)
        rows[0, 4 + number, column] = score
        if n_basis:
            rows[0, 84:, column] = (1, -1)
    if not n_basis:
        return {"output0": rows}
    basis = np.zeros((1, n_basis, 16, 16), dtype=np.float32)
    basis[0, 0, :, 8:] = 4  # the right half of the input
    basis[0, 1, :, :8] = 4
    return {"output0": rows, "output1": basis}


def _yolo_end() -> dict[str, np.ndarray[Any, Any]]:
    x, y, w, h = _fed_box()
    rows = np.zeros((1, 300, 8), dtype=np.float32)
    rows[0, 0] = [x - w / 2, y - h / 2, x + w / 2, y + h / 2, 0.9, CLASS, 1, -1]
    return {"output0": rows, "output1": _yolo(2)["output1"]}


def _shares() -> np.ndarray[Any, Any]:
    x0, y0, x1, y1 = BOX
    return np.array(
        [(x0 + x1) / 2 / WIDTH, (y0 + y1) / 2 / HEIGHT, (x1 - x0) / WIDTH, (y1 - y0) / HEIGHT], dtype=np.float32
    )


def _detr() -> dict[str, np.ndarray[Any, Any]]:
    rows = np.zeros((1, 300, 84), dtype=np.float32)
    rows[0, 7, :4], rows[0, 7, 4 + CLASS] = _shares(), 0.9
    return {"output0": rows}


def _detr_logits() -> dict[str, np.ndarray[Any, Any]]:
    logits, boxes = np.full((1, 300, 80), -9, dtype=np.float32), np.zeros((1, 300, 4), dtype=np.float32)
    logits[0, 7, CLASS], boxes[0, 7] = np.log(9), _shares()
    return {"logits": logits, "pred_boxes": boxes}


def _detr_authors() -> dict[str, np.ndarray[Any, Any]]:
    labels, boxes, scores = (
        np.zeros((1, 300), np.int64),
        np.zeros((1, 300, 4), np.float32),
        np.zeros((1, 300), np.float32),
    )
    labels[0, 7], boxes[0, 7], scores[0, 7] = CLASS, BOX, 0.9
    return {"labels": labels, "boxes": boxes, "scores": scores}


@pytest.mark.parametrize(
    ("form", "answers", "masked"),
    [
        ("yolo-seg", _yolo(2), True),
        ("yolo-end", _yolo_end(), True),
        ("yolo", _yolo(0), False),
        ("detr", _detr(), False),
        ("detr-logits", _detr_logits(), False),
        ("detr-authors", _detr_authors(), False),
    ],
)
def test_each_form_finds_the_object(form: str, answers: dict[str, Any], masked: bool, tmp_path: Path) -> None:
    detector = load_detector(_graph(tmp_path / "net.onnx", answers, sized=form == "detr-authors"))
    seen = detector(np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8))
    assert len(seen.labels) == (2 if form in {"yolo", "yolo-seg"} else 1), "the double is gone, another class stays"
    assert detector.labels[seen.labels[0]] == "chair"
    assert seen.scores[0] == pytest.approx(0.9, abs=1e-5)
    np.testing.assert_allclose(seen.boxes[0], BOX, atol=0.5)
    assert seen.from_boxes is not masked
    x0, y0, x1, y1 = map(int, BOX)
    expected = np.zeros((HEIGHT, WIDTH), dtype=bool)
    expected[y0:y1, (WIDTH // 2 if masked else x0) : x1] = True  # the basis shows the right half of the input
    assert seen.masks[0].shape == expected.shape
    assert (seen.masks[0] & expected).sum() > 0.9 * (seen.masks[0] | expected).sum()


def _rfdetr(slots: int, number: int, n_masks: int = 0) -> dict[str, np.ndarray[Any, Any]]:
    """The outputs of RF-DETR's own export, whose queries have the class `number` in the last rows."""
    boxes, logits = np.zeros((1, 5, 4), dtype=np.float32), np.full((1, 5, slots), -9, dtype=np.float32)
    boxes[0, 2:], logits[0, 2:, number], logits[0, 0, -1] = _shares(), np.log(9), 3
    masks = {"masks": np.zeros((1, n_masks, SIDE, SIDE), dtype=np.float32)} if n_masks else {}
    return {"dets": boxes[:, -n_masks or None :], "labels": logits[:, -n_masks or None :]} | masks


def _rtmdet(n_masks: int) -> dict[str, np.ndarray[Any, Any]]:
    """The outputs of MMDeploy: boxes and scores in the input, whose right and lower rest is padding."""
    rows = np.tile(np.array([*np.array(BOX) / 2, 0.9], dtype=np.float32), (1, n_masks, 1))
    masks = np.zeros((1, n_masks, SIDE, SIDE), dtype=np.float32)
    return {"dets": rows, "labels": np.full((1, n_masks), CLASS), "masks": masks}


def _smooth_image() -> np.ndarray[Any, Any]:
    noise = np.random.default_rng(0).integers(0, 256, (8, 16, 3)).astype(np.uint8)
    return cv2.resize(noise, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)


def _upsampled(small: np.ndarray[Any, Any], size: tuple[int, int]) -> np.ndarray[Any, Any]:
    """`F.interpolate(mode="bilinear", align_corners=False)` of PyTorch."""
    for axis, length in enumerate(size[::-1]):
        n = small.shape[axis]
        at = np.clip((np.arange(length) + 0.5) * n / length - 0.5, 0, n - 1)
        low = np.minimum(at.astype(int), n - 2)
        weight = (at - low).reshape((-1, 1) if axis == 0 else (1, -1))
        small = small.take(low, axis) * (1 - weight) + small.take(low + 1, axis) * weight
    return small


def test_rfdetr_is_read_as_its_own_code_does(tmp_path: Path) -> None:
    """`RFDETR.predict`: normalise, resize with anti-aliasing, boxes times size, masks interpolated and above 0.

    The graph returns its input as the logits of the masks of three queries.
    """
    image = _smooth_image()
    path = _graph(tmp_path / "net.onnx", _rfdetr(91, 62, n_masks=3), echo="masks")
    detector = load_detector(path)
    found = detector(image)
    assert [detector.labels[label] for label in found.labels] == ["chair"] * 3
    np.testing.assert_allclose(found.boxes, [BOX] * 3, atol=1e-3)
    np.testing.assert_allclose(found.scores, 0.9, atol=1e-6)
    means, sds = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
    for channel, mask in enumerate(found.masks):
        normal = (image[..., channel].astype(np.float32) / 255 - means[channel]) / sds[channel]
        resized = np.asarray(Image.fromarray(normal).resize((SIDE, SIDE), Image.Resampling.BILINEAR))
        assert (mask != (_upsampled(resized, (WIDTH, HEIGHT)) > 0)).mean() < 0.01  # rounding to integers


def test_rtmdet_is_read_as_its_own_code_does(tmp_path: Path) -> None:
    """Pipeline of MMDetection: resize with the ratio kept, pad with 114 right and below, BGR; masks above 0.5."""
    image = _smooth_image()
    detector = load_detector(_graph(tmp_path / "net.onnx", _rtmdet(3), echo="masks"))
    found = detector(image)
    assert [detector.labels[label] for label in found.labels] == ["chair"] * 3
    np.testing.assert_allclose(found.boxes, [BOX] * 3, atol=1e-3)
    small = cv2.resize(image[..., ::-1], (SIDE, SIDE // 2)).astype(np.float32)
    normal = (small - (103.53, 116.28, 123.675)) / (57.375, 57.12, 58.395)
    for channel, mask in enumerate(found.masks):
        assert (mask != (_upsampled(normal[..., channel], (WIDTH, HEIGHT)) > 0.5)).mean() < 0.01


@pytest.mark.parametrize(("slots", "number", "label"), [(91, 62, 62), (91, 90, 90), (5, 2, 3), (5, 3, 4)])
def test_the_last_slot_of_an_rfdetr_is_the_background_unless_it_has_the_numbers_of_coco(
    slots: int, number: int, label: int, tmp_path: Path
) -> None:
    found = load_detector(_graph(tmp_path / "net.onnx", _rfdetr(slots, number)))(np.zeros((HEIGHT, WIDTH, 3), np.uint8))
    of_last_slot = [90] if slots == 91 else []
    assert found.labels.tolist() == of_last_slot + [label] * 3
    assert found.from_boxes


def test_names_in_the_graph_come_first(tmp_path: Path) -> None:
    path = _graph(tmp_path / "net.onnx", _yolo(2), names="{" + ", ".join(f"{n}: 'object {n}'" for n in range(80)) + "}")
    assert load_detector(path).labels[1 + CLASS] == f"object {CLASS}"
    (tmp_path / "own.txt").write_text("\n".join(f"own {n}" for n in range(80)))
    assert load_detector(path, tmp_path / "own.txt").labels[1 + CLASS] == f"own {CLASS}"
    assert class_names({"names": "__import__('os')"}) is None
    assert class_names({"names": "['a', 'b']"}) == ("", "a", "b")


def test_a_graph_of_none_of_them_is_one_line(tmp_path: Path) -> None:
    graph = _graph(tmp_path / "net.onnx", {"embedding": np.zeros((1, 512), dtype=np.float32)})
    with pytest.raises(InputError, match="YOLO or of RT-DETR, found embedding"):
        load_detector(graph)


@pytest.mark.parametrize(("iou", "count"), [(0.68, 2), (0.72, 1)])
def test_boxes_of_a_class_that_overlap_by_seven_tenths_are_one(tmp_path: Path, iou: float, count: int) -> None:
    """Two equal boxes that are shifted by s of their width have an IoU of (1 - s) / (1 + s)."""
    shift = (1 - iou) / (1 + iou)
    rows = np.zeros((1, 84, 400), dtype=np.float32)
    rows[0, :4, 0], rows[0, :4, 1] = (200, 200, 100, 100), (200 + 100 * shift, 200, 100, 100)
    rows[0, 4 + CLASS, :2] = 0.9, 0.8
    detector = load_detector(_graph(tmp_path / "net.onnx", {"output0": rows}))
    assert len(detector(np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)).labels) == count


@pytest.mark.parametrize(("score", "count"), [(0.499, 0), (0.501, 1)])
def test_detections_have_a_score_of_at_least_one_half(tmp_path: Path, score: float, count: int) -> None:
    rows = np.zeros((1, 84, 400), dtype=np.float32)
    rows[0, :4, 0], rows[0, 4 + CLASS, 0] = (200, 200, 100, 100), score
    detector = load_detector(_graph(tmp_path / "net.onnx", {"output0": rows}))
    assert len(detector(np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)).labels) == count


@pytest.mark.parametrize(("score", "n_found"), [(0.49, 0), (0.51, 1)])
def test_a_detection_has_a_score_of_one_half(score: float, n_found: int, tmp_path: Path) -> None:
    answers = _detr_authors()
    answers["scores"][0, 7] = score
    detector = load_detector(_graph(tmp_path / "net.onnx", answers, sized=True))
    assert len(detector(np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)).labels) == n_found


@pytest.mark.parametrize(("overlap", "n_found"), [(0.68, 2), (0.72, 1)])
def test_detections_of_a_class_are_one_from_an_iou_of_seven_tenths(
    overlap: float, n_found: int, tmp_path: Path
) -> None:
    """Two boxes of equal size, shifted along x by (1 - IoU) / (1 + IoU) of their width."""
    rows = np.zeros((1, 84, 100), dtype=np.float32)
    for column, score in ((3, 0.9), (4, 0.8)):
        rows[0, :4, column] = _fed_box()
        rows[0, 4 + CLASS, column] = score
    rows[0, 0, 4] += (1 - overlap) / (1 + overlap) * rows[0, 2, 4]
    detector = load_detector(_graph(tmp_path / "net.onnx", {"output0": rows}))
    assert len(detector(np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)).labels) == n_found


@pytest.mark.parametrize(
    ("n_candidates", "n_apart", "message"),
    [
        (10_000, 1, None),
        (10_001, 1, "10,001 candidates"),
        (1000, 1000, None),
        (1001, 1001, "more than 1,000 detections"),
    ],
)
def test_candidates_and_detections_of_an_image_are_limited(
    n_candidates: int, n_apart: int, message: str | None, tmp_path: Path
) -> None:
    """Boxes of a class at one place are one detection; those of different places are not."""
    rows = np.zeros((1, 84, 10_001), dtype=np.float32)
    places = np.arange(n_candidates) % n_apart
    rows[0, :4, :n_candidates] = (
        places % 40 * 10 + 5,
        places // 40 * 10 + 5,
        np.full(n_candidates, 8),
        np.full(n_candidates, 8),
    )
    rows[0, 4 + CLASS, :n_candidates] = 0.9
    detector = load_detector(_graph(tmp_path / "net.onnx", {"output0": rows}))
    with nullcontext() if message is None else pytest.raises(InputError, match=message):
        assert len(detector(np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)).labels) == n_apart


@pytest.mark.parametrize(
    ("shapes", "form"),
    [
        ([(1, 5, 8400)], "yolo"),
        ([(1, 4, 8400)], None),  # a box without a class
        ([(1, 8400, 5)], "detr"),
        ([(1, 8400, 4)], None),
        ([(1, 300, 6)], "yolo-end"),
        ([(1, 300, 7)], "detr"),
        ([("n", 300, 6)], "yolo-end"),
        ([(2, 300, 6)], None),
        ([(1, "n", 8)], "detr"),
        ([(1, 116, 8400), (1, 32, 160, 160)], "yolo"),
        ([(1, 300, 38), (1, 32, 160, 160)], "yolo-end"),
        ([(1, 300, 39), (1, 32, 160, 160)], "yolo"),
        ([(1, 300, 4), (1, 300, 91)], "detr-logits"),
        ([(1, 300, 4), (1, 300, 4)], None),
        ([(1, 300, 5), (1, 300, 91)], None),
        ([(1, 300), (1, 300), (1, 300, 4)], "detr-authors"),
        ([(1, 300), (1, 300), (1, 300, 5)], None),
    ],
)
def test_the_form_of_a_graph_by_its_outputs(shapes: list[tuple[int | str, ...]], form: str | None) -> None:
    outputs = [SimpleNamespace(name=str(index), shape=list(shape)) for index, shape in enumerate(shapes)]
    assert one_stage_form(outputs) == form


@pytest.mark.parametrize(("rank", "form"), [(2, "rtmdet"), (3, "rfdetr")])
def test_the_form_of_a_graph_by_the_names_of_its_outputs(rank: int, form: str) -> None:
    named = {"dets": (1, 300, 5), "labels": (1, 300, 91)[:rank], "masks": (1, 300, 20, 20)}
    outputs = [SimpleNamespace(name=name, shape=list(shape)) for name, shape in named.items()]
    assert one_stage_form(outputs) == form
    outputs[0].shape = [300, 5]
    assert one_stage_form(outputs) is None


@pytest.mark.parametrize(("length", "is_read"), [((1 << 20) - 1, True), (1 << 20, False)])
def test_class_names_of_a_graph_have_less_than_a_mebibyte(length: int, is_read: bool) -> None:
    names = class_names({"names": "['" + "a" * (length - 4) + "']"})
    assert (names is not None) == is_read


@pytest.mark.parametrize(("number", "n_names"), [(0, 2), (99_999, 100_001), (100_000, None), (-1, None)])
def test_class_numbers_of_a_graph_are_below_100000(number: int, n_names: int | None) -> None:
    names = class_names({"names": f"{{{number}: 'a'}}"})
    assert (None if names is None else len(names)) == n_names

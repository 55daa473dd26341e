"""Small ONNX models with the signatures of Mask R-CNN exports, which detect two colours."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

__all__ = ["COLOURS", "box_mask_graph", "constant_graph", "hue_graph", "paint_graph", "save"]

#: RGB colours of label 1 and label 2. The score of a label is 0.9 if its colour is in the image, otherwise 0.
COLOURS = np.array([[255, 0, 0], [0, 0, 255]], dtype=np.uint8)


def paint_graph(path: Path, fixed: tuple[int, int] | None = None) -> Path:
    """Write a model with torchvision's signature: one mask per colour; `fixed` (H, W) removes the dynamic axes."""
    height, width = fixed or ("height", "width")
    pure = (COLOURS / 255).astype(np.float32).reshape(2, 3, 1, 1)
    constants = {
        "pure": pure, "one": np.float32(1), "zero": np.float32(0), "sure": np.float32(0.9),
        "labels_value": np.array([1, 2], dtype=np.int64), "boxes_value": np.zeros((2, 4), dtype=np.float32),
        "channels": np.array([1], dtype=np.int64), "pixels": np.array([1, 2, 3], dtype=np.int64),
    }  # fmt: skip
    nodes = [
        helper.make_node("Sub", ["picture", "pure"], ["off"]),
        helper.make_node("Abs", ["off"], ["distance"]),
        helper.make_node("ReduceSum", ["distance", "channels"], ["total"], keepdims=1),
        helper.make_node("Sub", ["one", "total"], ["likeness"]),
        helper.make_node("Max", ["likeness", "zero"], ["masks"]),
        helper.make_node("ReduceMax", ["masks"], ["best"], axes=[1, 2, 3], keepdims=0),
        helper.make_node("Mul", ["best", "sure"], ["scores"]),
        helper.make_node("Identity", ["labels_value"], ["labels"]),
        helper.make_node("Identity", ["boxes_value"], ["boxes"]),
    ]
    outputs = _outputs(("boxes", "labels", "scores", "masks"), (2, 1, height, width))
    picture = helper.make_tensor_value_info("picture", TensorProto.FLOAT, [3, height, width])
    return save(path, nodes, constants, picture, outputs)


def hue_graph(path: Path) -> Path:
    """Write a model with torchvision's signature: a 1 x 1 convolution whose masks are the excess of blue and of green.

    The mask is 0.5 if the colour exceeds the mean of the others by 0.1. The score is 0.9 times the mask's maximum.
    """
    excess = 5 * np.array([[-0.5, -0.5, 1.0], [-0.5, 1.0, -0.5]], dtype=np.float32)
    constants = {
        "weights": excess.reshape(2, 3, 1, 1), "zero": np.float32(0), "one": np.float32(1), "sure": np.float32(0.9),
        "first": np.array([0], dtype=np.int64), "labels_value": np.array([1, 2], dtype=np.int64),
        "boxes_value": np.zeros((2, 4), dtype=np.float32),
    }  # fmt: skip
    nodes = [
        helper.make_node("Unsqueeze", ["picture", "first"], ["batch"]),
        helper.make_node("Conv", ["batch", "weights"], ["excess"]),
        helper.make_node("Clip", ["excess", "zero", "one"], ["clipped"]),
        helper.make_node("Transpose", ["clipped"], ["masks"], perm=[1, 0, 2, 3]),
        helper.make_node("ReduceMax", ["masks"], ["best"], axes=[1, 2, 3], keepdims=0),
        helper.make_node("Mul", ["best", "sure"], ["scores"]),
        helper.make_node("Identity", ["labels_value"], ["labels"]),
        helper.make_node("Identity", ["boxes_value"], ["boxes"]),
    ]
    outputs = _outputs(("boxes", "labels", "scores", "masks"), (2, 1, "height", "width"))
    picture = helper.make_tensor_value_info("picture", TensorProto.FLOAT, [3, "height", "width"])
    return save(path, nodes, constants, picture, outputs)


def box_mask_graph(path: Path, box: tuple[float, float, float, float], mask: np.ndarray, channel: int = -1) -> Path:
    """Write a model with the signature of the ONNX model zoo: one fixed box in pixels of the input, and a small mask.

    The score is 0.8, or the maximum of an input channel divided by 200 if `channel` is given.
    """
    constants = {
        "boxes_value": np.array([box], dtype=np.float32), "labels_value": np.array([1], dtype=np.int64),
        "scores_value": np.array([0.8], dtype=np.float32), "masks_value": mask[None, None].astype(np.float32),
    }  # fmt: skip
    names = ("6568", "6570", "6572", "6887")  # as written by the exporter
    values = ("boxes", "labels", "scores", "masks")
    nodes = [helper.make_node("Identity", [f"{v}_value"], [n]) for v, n in zip(values, names, strict=True)]
    if channel >= 0:
        constants |= {"channel": np.array([channel]), "most": np.float32(200), "one": np.array([1])}
        nodes[2:3] = [
            helper.make_node("Gather", ["image", "channel"], ["plane"], axis=0),
            helper.make_node("ReduceMax", ["plane"], ["peak"], axes=[0, 1, 2], keepdims=0),
            helper.make_node("Div", ["peak", "most"], ["ratio"]),
            helper.make_node("Reshape", ["ratio", "one"], [names[2]]),
        ]
    picture = helper.make_tensor_value_info("image", TensorProto.FLOAT, [3, "height", "width"])
    return save(path, nodes, constants, picture, _outputs(names, (1, 1, *mask.shape)))


def constant_graph(
    path: Path, count: int, score: float = 0.9, label: int = 1, mask: tuple[int, int] = (4, 4), box: float = 1.0
) -> Path:
    """Write a model with torchvision's signature that returns the same detection `count` times for every image."""
    constants = {
        "n": np.array([count], dtype=np.int64), "n4": np.array([count, 4], dtype=np.int64),
        "n1hw": np.array([count, 1, *mask], dtype=np.int64),
    }  # fmt: skip
    detections = {"boxes": ("n4", TensorProto.FLOAT, box), "labels": ("n", TensorProto.INT64, label),
               "scores": ("n", TensorProto.FLOAT, score), "masks": ("n1hw", TensorProto.FLOAT, 1.0)}  # fmt: skip
    nodes = [
        helper.make_node("ConstantOfShape", [shape], [name], value=helper.make_tensor("value", kind, [1], [value]))
        for name, (shape, kind, value) in detections.items()
    ]
    picture = helper.make_tensor_value_info("picture", TensorProto.FLOAT, [3, "height", "width"])
    return save(path, nodes, constants, picture, _outputs(tuple(detections), (None, 1, None, None)))


def save(
    path: Path, nodes: list[Any], constants: dict[str, Any], picture: onnx.ValueInfoProto, outputs: list[Any]
) -> Path:
    initial = [numpy_helper.from_array(np.asarray(value), name) for name, value in constants.items()]
    graph = helper.make_graph(nodes, "detector", [picture], outputs, initial)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)])
    model.ir_version = 9
    onnx.checker.check_model(model)
    onnx.save(model, str(path))
    return path


def _outputs(names: tuple[str, ...], mask_shape: tuple[int | str | None, ...]) -> list[Any]:
    boxes, labels, scores, masks = names
    n = mask_shape[0]
    return [
        helper.make_tensor_value_info(boxes, TensorProto.FLOAT, [n, 4]),
        helper.make_tensor_value_info(labels, TensorProto.INT64, [n]),
        helper.make_tensor_value_info(scores, TensorProto.FLOAT, [n]),
        helper.make_tensor_value_info(masks, TensorProto.FLOAT, list(mask_shape)),
    ]

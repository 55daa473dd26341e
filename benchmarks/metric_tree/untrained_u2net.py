"""U2-Net's graph with random weights: for rembg's rate where its weights are not at hand. Its masks mean nothing.

    python -m benchmarks.metric_tree.untrained_u2net u2net.onnx            # or --small for U2-Net-p
    python -m benchmarks.metric_tree.cutouts --count 10 --model u2net.onnx # read `per_second` alone

Layers and channels are those of Qin et al. 2020 (figures 2 and 5): nested U of six encoder and five decoder stages,
each a residual U itself, at 320 x 320 pixels; batch normalisation is folded into the convolutions, as exporters do.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

#: Height of each stage's own U, input, middle and output channels; encoders, then decoders from the deepest up. Height
#: 0 is the stage of dilations without pooling.
LARGE = (
    [(7, 3, 32, 64), (6, 64, 32, 128), (5, 128, 64, 256), (4, 256, 128, 512), (0, 512, 256, 512), (0, 512, 256, 512)],
    [(0, 1024, 256, 512), (4, 1024, 128, 256), (5, 512, 64, 128), (6, 256, 32, 64), (7, 128, 16, 64)],
)
SMALL = (
    [(height, 3 if height == 7 else 64, 16, 64) for height in (7, 6, 5, 4, 0, 0)],
    [(height, 128, 16, 64) for height in (0, 4, 5, 6, 7)],
)

SIDE = 320


class _Graph:
    """Nodes and weights, grown layer by layer; every method returns the name of its output."""

    def __init__(self) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.weights: list[onnx.TensorProto] = []
        self._generator = np.random.default_rng(0)

    def node(self, kind: str, inputs: list[str], **attributes: object) -> str:
        name = f"{kind}{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, inputs, [name], **attributes))
        return name

    def weight(self, values: np.ndarray) -> str:
        name = f"w{len(self.weights)}"
        self.weights.append(numpy_helper.from_array(values.astype(np.float32), name))
        return name

    def conv(self, x: str, channels: tuple[int, int], dilation: int = 1, side: int = 3) -> str:
        fan = channels[0] * side * side
        values = self._generator.normal(0, (2 / fan) ** 0.5, (channels[1], channels[0], side, side))
        reach = dilation * (side // 2)
        weights = [self.weight(values), self.weight(np.zeros(channels[1]))]
        return self.node("Conv", [x, *weights], dilations=[dilation] * 2, pads=[reach] * 4, kernel_shape=[side] * 2)

    def layer(self, x: str, channels: tuple[int, int], dilation: int = 1) -> str:
        return self.node("Relu", [self.conv(x, channels, dilation)])

    def pooled(self, x: str) -> str:
        return self.node("MaxPool", [x], kernel_shape=[2, 2], strides=[2, 2], ceil_mode=1)

    def resized(self, x: str, side: int, channels: int) -> str:
        size = numpy_helper.from_array(np.array([1, channels, side, side], dtype=np.int64), f"s{len(self.weights)}")
        self.weights.append(size)
        return self.node("Resize", [x, "", "", size.name], mode="linear", coordinate_transformation_mode="half_pixel")

    def joined(self, *parts: str) -> str:
        return self.node("Concat", list(parts), axis=1)

    def stage(self, x: str, shape: tuple[int, int, int, int], side: int) -> str:
        """A residual U: down through pooling (or dilation), and up again with the layers of the way down."""
        height, channels, middle, out = shape
        levels = height or 4
        first = self.layer(x, (channels, out))
        ways, sides, here = [], [side], first
        for level in range(1, levels):
            if height and level > 1:
                here = self.pooled(here)
                sides.append(-(-sides[-1] // 2))
            here = self.layer(here, (out if level == 1 else middle, middle), 1 if height else 2 ** (level - 1))
            ways.append(here)
        here = self.layer(here, (middle, middle), 2 if height else 8)
        for level in range(levels - 1, 0, -1):
            last = out if level == 1 else middle
            here = self.layer(
                self.joined(here, ways[level - 1]), (2 * middle, last), 1 if height else max(2 ** (level - 1), 1)
            )
            if height and level > 1:
                here = self.resized(here, sides[level - 2], middle)
        return self.node("Add", [here, first])


def network(shapes: tuple[list[tuple[int, int, int, int]], list[tuple[int, int, int, int]]]) -> onnx.ModelProto:
    """The whole graph: picture (1, 3, 320, 320) in, seven maps out, the fused one first, as rembg expects them."""
    graph = _Graph()
    encoders, decoders = shapes
    here, side, ways, maps = "picture", SIDE, [], []
    for number, shape in enumerate(encoders):
        if number:
            here, side = graph.pooled(here), side // 2
        here = graph.stage(here, shape, side)
        ways.append((here, side, shape[3]))
    outputs = [ways[-1]]
    for shape, (way, way_side, _) in zip(decoders, reversed(ways[:-1]), strict=True):
        below, _, channels = outputs[-1]
        here = graph.stage(graph.joined(graph.resized(below, way_side, channels), way), shape, way_side)
        outputs.append((here, way_side, shape[3]))
    for name, _, channels in reversed(outputs):
        maps.append(graph.resized(graph.conv(name, (channels, 1)), SIDE, 1))
    fused = graph.conv(graph.joined(*maps), (len(maps), 1), side=1)
    ends = [graph.node("Sigmoid", [one]) for one in (fused, *maps)]
    infos = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, 1, SIDE, SIDE]) for name in ends]
    picture = helper.make_tensor_value_info("picture", TensorProto.FLOAT, [1, 3, SIDE, SIDE])
    whole = helper.make_graph(graph.nodes, "u2net", [picture], infos, graph.weights)
    return helper.make_model(whole, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--small", action="store_true", help="U2-Net-p")
    arguments = parser.parse_args()
    model = network(SMALL if arguments.small else LARGE)
    onnx.checker.check_model(model)
    onnx.save(model, str(arguments.file))
    print(f"{arguments.file}: {sum(np.prod(w.dims) for w in model.graph.initializer) / 1e6:.2f} million weights")


if __name__ == "__main__":
    main()

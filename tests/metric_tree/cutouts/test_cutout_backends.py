"""Backends on synthetic images, the network through `rembg.remove`, and reasons that set a mask aside."""

from __future__ import annotations

import os
from io import BytesIO

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from metric_base.errors import InputError
from metric_tree.cutouts import network
from metric_tree.cutouts.backend import Auto, Foreground
from metric_tree.cutouts.network import Network, has_weights
from metric_tree.cutouts.plain import Plain, background
from metric_tree.cutouts.quality import assessment
from tests.synthetic.hostile_pictures import shop_picture
from tests.synthetic.picture_fixture import wallpaper

SHAPE = (160, 200)


def pixels(body: bytes) -> np.ndarray:
    return np.asarray(Image.open(BytesIO(body)).convert("RGB"))


def disc(radius: float = 50, centre: tuple[float, float] = (100, 80)) -> np.ndarray:
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    return np.hypot(x - centre[0], y - centre[1]) <= radius


def painted(mask: np.ndarray, colour=(150, 40, 30), behind=255.0) -> np.ndarray:
    scene = np.broadcast_to(np.asarray(behind, dtype=float), (*SHAPE, 3)).copy()
    scene[mask] = colour
    return np.clip(scene + np.random.default_rng(0).normal(0, 1, scene.shape), 0, 255).astype(np.uint8)


def iou(alpha: np.ndarray, mask: np.ndarray) -> float:
    found = alpha >= 128
    return float((found & mask).sum() / (found | mask).sum())


@given(
    radius=st.floats(20, 60),
    x=st.floats(75, 125),
    colour=st.tuples(*[st.integers(0, 150)] * 3),
    behind=st.tuples(*[st.integers(200, 255)] * 3),
)
@settings(max_examples=15, deadline=None)
def test_a_disc_on_any_light_paper_is_found(radius, x, colour, behind):
    mask = disc(radius, (x, 80))
    found = Plain().foreground(painted(mask, colour, behind))
    assert found.refused is None
    assert iou(found.alpha, mask) > 0.95


def test_light_that_falls_off_round_a_lamp_is_background():
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    light = 250 - 60 * np.hypot(x / 200 - 0.5, y / 160 - 0.4)
    mask = disc(40)
    found = Plain().foreground(painted(mask, behind=light[..., None]))
    assert iou(found.alpha, mask) > 0.95


def test_a_soft_shadow_is_background_and_a_dark_object_is_not():
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    shadow = 60 * np.exp(-(((x - 110) / 45) ** 2 + ((y - 125) / 9) ** 2))
    mask = disc(45)
    found = Plain().foreground(painted(mask, (60, 60, 62), 252 - shadow[..., None]))
    assert iou(found.alpha, mask) > 0.9


def test_the_hole_of_a_ring_is_background():
    ring = disc(60) & ~disc(30)
    assert iou(Plain().foreground(painted(ring)).alpha, ring) > 0.95


def test_an_object_that_leaves_the_picture_is_found():
    mask = disc(45, (100, 150))
    assert iou(Plain().foreground(painted(mask)).alpha, mask) > 0.93


def test_wallpaper_is_refused_and_auto_hands_it_on():
    picture = pixels(wallpaper())
    assert Plain().foreground(picture).refused == "not_plain"
    assert Auto(Plain(), None).foreground(picture).refused == "no_weights"

    class Everything:
        def foreground(self, picture):
            return Foreground(np.full(picture.shape[:2], 255, np.uint8), "everything")

    auto = Auto(Plain(), Everything())
    assert auto.foreground(picture).method == "everything"
    assert auto.foreground(pixels(shop_picture())).method == "plain"


def test_a_flat_picture_is_plain_and_empty():
    picture = np.full((*SHAPE, 3), 250, np.uint8)
    found = Plain().foreground(picture)
    assert found.refused is None
    assert assessment(picture, found.alpha).reason == "empty"


def test_border_noise_is_told():
    lab = np.random.default_rng(1).normal((80, 0, 0), 2.0, (*SHAPE, 3)).astype(np.float32)
    assert 1.0 < background(lab).noise < 2.0  # of the quieter three quarters


@pytest.mark.parametrize(
    ("alpha", "reason"),
    [
        (disc(50), None),
        (disc(3), "empty"),
        (np.ones(SHAPE, bool), "full"),
        (disc(25, (50, 80)) | disc(25, (150, 80)), "several"),
        (disc(40, (60, 80)) | disc(8, (180, 80)), None),
    ],
)
def test_masks_are_set_aside_with_their_reason(alpha, reason):
    assert assessment(painted(alpha), alpha.astype(np.uint8) * 255).reason == reason


def test_a_mask_without_an_edge_beneath_it_is_doubtful():
    told = assessment(painted(disc(5)), disc(50).astype(np.uint8) * 255)
    assert told.reason == "doubtful"
    assert told.quality < 0.1


def test_box_and_share():
    mask = np.zeros(SHAPE, bool)
    mask[20:60, 30:130] = True
    told = assessment(painted(mask), mask.astype(np.uint8) * 255)
    assert told.box == (30, 20, 100, 40)
    assert told.share == pytest.approx(4000 / (160 * 200))


def tiny_network(path) -> None:
    """An ONNX graph with U2-Net's signature whose mask is how dark a pixel is."""
    import onnx
    from onnx import TensorProto, helper

    shape = [1, 3, 320, 320]
    nodes = [
        helper.make_node("ReduceMean", ["in", "axes"], ["mean"], keepdims=1),
        helper.make_node("Neg", ["mean"], ["out"]),
    ]
    graph = helper.make_graph(
        nodes,
        "dark",
        [helper.make_tensor_value_info("in", TensorProto.FLOAT, shape)],
        [helper.make_tensor_value_info("out", TensorProto.FLOAT, [1, 1, 320, 320])],
        [helper.make_tensor("axes", TensorProto.INT64, [1], [1])],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    onnx.save(model, path)


def test_a_local_onnx_file_runs_through_rembg(tmp_path, monkeypatch):
    monkeypatch.delenv("U2NET_HOME", raising=False)
    tiny_network(tmp_path / "dark.onnx")
    assert has_weights(str(tmp_path / "dark.onnx"))
    found = Network.load(str(tmp_path / "dark.onnx"))
    mask = disc(50)
    cut = found.foreground(painted(mask, (10, 10, 10)))
    assert cut.method == "rembg:dark"
    assert iou(cut.alpha, mask) > 0.95
    blank = found.foreground(np.full((*SHAPE, 3), 250, np.uint8))
    assert assessment(np.full((*SHAPE, 3), 250, np.uint8), blank.alpha).reason == "empty"
    assert "U2NET_HOME" not in os.environ


def test_models_that_are_none_are_one_clear_line(tmp_path):
    (tmp_path / "broken.onnx").write_bytes(b"no graph")
    with pytest.raises(InputError, match="expected an ONNX network"):
        Network.load(str(tmp_path / "broken.onnx"))
    with pytest.raises(InputError, match="expected an ONNX file; found none"):
        has_weights(str(tmp_path / "missing.onnx"))
    with pytest.raises(InputError, match=r"expected one of u2net, .*'bria-rmbg'"):
        Network.load("bria-rmbg")


def test_a_refused_download_is_one_clear_line(tmp_path, monkeypatch):
    monkeypatch.setenv("U2NET_HOME", str(tmp_path))
    assert not has_weights("u2net")

    class NoNetwork:
        @staticmethod
        def new_session(_model):
            raise OSError("no route")

    monkeypatch.setattr(network, "_rembg", lambda: NoNetwork)
    with pytest.raises(InputError, match=r"--model u2net: expected weights .*no route.*--backend plain"):
        Network.load("u2net")


def boxes(*areas: tuple[slice, slice]) -> np.ndarray:
    """The opacity (100, 100) of an object in some parts of an image."""
    alpha = np.zeros((100, 100), np.uint8)
    for rows, columns in areas:
        alpha[rows, columns] = 255
    return alpha


@pytest.mark.parametrize(
    ("alpha", "reason"),
    [
        (boxes((slice(10, 50), slice(10, 35)), (slice(70, 87), slice(70, 90))), None),  # 34 % of the first part
        (boxes((slice(10, 50), slice(10, 35)), (slice(70, 88), slice(70, 90))), "several"),  # 36 %
        (boxes((slice(0, 100), slice(0, 69))), None),  # 59.5 % of the border
        (boxes((slice(0, 100), slice(0, 71))), "full"),  # 60.5 %
        (boxes((slice(40, 47), slice(40, 47))), "empty"),  # 0.49 % of the image
        (boxes((slice(40, 47), slice(40, 48))), None),  # 0.56 %
        (boxes((slice(1, 99), slice(1, 99))), None),  # 96.04 %
        (boxes((slice(1, 100), slice(1, 100))), "full"),  # 98.01 %
    ],
)
def test_thresholds_of_a_mask(alpha: np.ndarray, reason: str | None) -> None:
    picture = np.where(alpha[..., None] > 0, np.uint8([150, 40, 30]), np.uint8([255, 255, 255])).astype(np.uint8)
    assert assessment(picture, alpha).reason == reason


def test_a_mask_is_doubtful_below_half_of_a_clear_edge() -> None:
    alpha = boxes((slice(30, 70), slice(30, 70)))
    for lightness, reason in ((239, "doubtful"), (237, None)):  # qualities of 0.47 and 0.53
        picture = np.where(alpha[..., None] > 0, np.uint8(lightness), np.uint8(255)).repeat(3, axis=2)
        assert assessment(picture, alpha).reason == reason, assessment(picture, alpha)

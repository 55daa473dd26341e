"""The training set: exact masks, sizes of the tree, the same bytes again."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from pycocotools.coco import COCO

from metric_base.errors import InputError
from metric_cli.subcommands import main
from metric_tree.axes import AXES
from metric_tree.training.classes import Classes
from metric_tree.training.composition import (
    Cutout,
    Layer,
    compose,
    cutout_pixels,
    cutouts_of,
    place_cutouts,
    random_background,
    shown_sizes,
)
from metric_tree.training.dataset import Plan, random_window, synthetic_entries
from metric_tree.training.selection import named_nodes
from metric_tree.tree import Tree
from tests.metric_tree.training.conftest import CUTOUTS, EACH, export
from tests.synthetic.priors import prior


def documents(out: Path) -> dict[str, Any]:
    return {
        split: json.loads((out / "annotations" / f"instances_{split}.json").read_text()) for split in ("train", "val")
    }


def test_pycocotools_reads_it_and_every_mask_is_exact(tree: Tree, tmp_path: Path) -> None:
    assert export(tree, tmp_path / "set", "--pictures", "20", "--val-share", "0") == 0
    coco = COCO(str(tmp_path / "set" / "annotations" / "instances_train.json"))
    assert {category["name"] for category in coco.cats.values()} == {"chair", "mouse"}
    assert len(coco.imgs) == 20
    seen = 0
    for image in coco.imgs.values():
        picture = cv2.imread(str(tmp_path / "set" / "images" / image["file_name"])).astype(int)
        assert picture.shape == (240, 320, 3)
        found = coco.loadAnns(coco.getAnnIds(image["id"]))
        masks = np.array([coco.annToMask(one) for one in found])
        assert masks.sum(axis=0).max() == 1  # hidden pixels belong to the occluder
        for one, mask in zip(found, masks, strict=True):
            rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
            box = [columns[0], rows[0], columns[-1] - columns[0] + 1, rows[-1] - rows[0] + 1]
            assert one["bbox"] == box
            assert one["area"] == mask.sum()
            # the colour inside is that of the cut-out, and of no other
            inside = cv2.erode(mask, np.ones((7, 7), np.uint8)).astype(bool)
            node_id = one["item_id"].removeprefix("made:").rpartition("-")[0]
            if inside.sum() > 50:
                mean = picture[inside].mean(axis=0)
                assert int(mean.argmax()) == int(np.argmax(CUTOUTS[node_id][0]))
                assert picture[inside].std(axis=0).max() < 6
                seen += 1
    assert seen > 30


def test_relative_sizes_are_the_trees(tree: Tree, tmp_path: Path) -> None:
    assert export(tree, tmp_path / "set", "--pictures", "60", "--val-share", "0") == 0
    document = documents(tmp_path / "set")["train"]
    scale = {image["id"]: image["px_per_mm"] for image in document["images"]}
    items = {row["item_id"]: row for row in tree.root.items().to_pylist()}
    ratios = []
    for one in document["annotations"]:
        item = items[one["item_id"]]
        own = item["height_mm"] if one["size_of"] == "height" else max(item["length_mm"], item["height_mm"])
        assert one["size_mm"] == pytest.approx(own, abs=0.06)
        assert one["size_of"] == ("longest" if "mouse" in one["item_id"] else "height")
        if one["visible_share"] == 1:
            side = one["bbox"][3] if one["size_of"] == "height" else one["bbox"][2]
            ratios.append(np.log(side / (own * scale[one["image_id"]])))
    assert len(ratios) > 40
    # the remainder is the distance: about one, with the given standard deviation
    assert abs(np.mean(ratios)) < 0.1
    assert np.std(ratios) < 0.25


def test_the_same_seed_gives_the_same_bytes_whatever_the_processes(tree: Tree, tmp_path: Path) -> None:
    for name, words in {"a": (), "b": ("--jobs", "2"), "c": ("--seed", "1")}.items():
        assert export(tree, tmp_path / name, "--pictures", "6", "--val-share", "0.3", *words) == 0
    files = sorted(path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*") if path.is_file())
    assert len(files) == 8
    assert all((tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes() for file in files)
    assert any((tmp_path / "a" / file).read_bytes() != (tmp_path / "c" / file).read_bytes() for file in files)


def test_categories_that_are_none_are_told(
    tree: Tree, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "sel.csv"
    file.write_text("node,name\nmouse.n.04,mouse\nmous.n.09,mous\n")
    words = ["export", "--tree", str(tree.release.directory), "--out", str(tmp_path / "set")]
    assert main([*words, "--categories", str(file)]) == 2
    assert f"{file}:3: mous.n.09: no node has this id" in capsys.readouterr().err
    monkeypatch.setattr("metric_tree.training.selection.choose", lambda _lookup: [])
    assert main(words) == 2
    assert "select's rules chose no category; found none of " in capsys.readouterr().err


def test_items_belong_to_one_split(tree: Tree, tmp_path: Path) -> None:
    assert export(tree, tmp_path / "set", "--pictures", "30", "--val-share", "0.3") == 0
    items = {split: {one["item_id"] for one in d["annotations"]} for split, d in documents(tmp_path / "set").items()}
    assert items["train"]
    assert items["val"]
    assert not items["train"] & items["val"]


def test_an_item_without_a_size_draws_from_its_prior(tree: Tree) -> None:

    axis, sizes = shown_sizes({}, tree.node("swivel_chair.n.01"), seed=0)
    low, high = tree.node("swivel_chair.n.01").prior(("height",)).interval(0.9999)[0]
    assert axis == "height"
    assert len(set(sizes)) > 10
    assert low < min(sizes) <= max(sizes) < high
    assert shown_sizes({}, tree.node("mouse.n.04"), seed=0)[0] == "longest"
    assert len(cutouts_of(Classes(tree, [tree.node("chair.n.01")]), 0)) == 2 * EACH


def test_hidden_objects_are_taken_out(tmp_path: Path) -> None:
    block = np.full((100, 100, 4), 255, dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "block.png"), block)
    cutout = Cutout("made:1", "x", 1, tmp_path / "block.png", None, "height", (100.0,))
    for seed in range(20):
        generator = np.random.default_rng(seed)
        found = compose([[cutout]], random_background((120, 160), generator), generator)
        for index, layer in enumerate(found.layers):
            visible = (found.labels == index).sum()
            assert 0.2 <= visible / layer.area <= 1
            assert visible >= 100


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--size", "big"), "--size"),
        (("--pictures", "-1"), "--pictures"),
        (("--val-share", "1"), "--val-share"),
        (("--backgrounds", "nowhere"), "nowhere"),
        (("--categories", "chair,swivel chair"), "below"),
        (("--pictures", "0"), "expected cut-outs"),
        (("--coco", "no.json", "."), "no.json"),
    ],
)
def test_errors_are_one_line_and_leave_nothing(
    tree: Tree, tmp_path: Path, words: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = set(tmp_path.iterdir())
    assert export(tree, tmp_path / "set", *(("--pictures", "2") if "--pictures" not in words else ()), *words) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1
    assert set(tmp_path.iterdir()) == before


def test_a_damaged_cutout_is_named(tree: Tree, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for file in (tree.release.directory / "cutouts").iterdir():
        file.write_bytes(b"no picture")
    assert export(tree, tmp_path / "set", "--pictures", "2") == 2
    assert "cut-out" in capsys.readouterr().err
    assert not (tmp_path / "set").exists()


def test_objects_are_placed_from_24_pixels_to_nine_tenths_of_the_image(tmp_path: Path) -> None:
    """The first object determines the scale: its side is 15 % to 75 % of the 120 pixels of the shorter side."""
    cv2.imwrite(str(tmp_path / "block.png"), np.full((100, 100, 4), 255, dtype=np.uint8))
    sizes = (10.0, 20.0, 40.0, 80.0, 160.0, 320.0, 640.0)
    cutouts = [[Cutout(f"made:{size}", "x", 1, tmp_path / "block.png", None, "longest", (size,))] for size in sizes]
    sides = []
    for seed in range(60):
        layers, px_per_mm = place_cutouts(cutouts, (120, 160), np.random.default_rng(seed))
        ratios = [max(layer.pixels.shape) / (layer.size_mm * px_per_mm) for layer in layers]
        first = min(range(len(layers)), key=lambda index: abs(ratios[index] - 1))  # of distance 1 by definition
        sides += [max(layer.pixels.shape) for index, layer in enumerate(layers) if index != first]
    assert 24 <= min(sides) < 32
    assert 120 < max(sides) <= 144


@pytest.mark.parametrize(("alpha", "area"), [(127, 0), (128, 6)])
def test_a_pixel_of_a_cut_out_is_opaque_from_half_the_range(alpha: int, area: int) -> None:
    pixels = np.full((2, 3, 4), alpha, dtype=np.uint8)
    cutout = Cutout("1", "chair.n.01", 1, Path("a.png"), None, "height", (900.0,))
    assert Layer(cutout, 900.0, pixels, 0, 0, 0.0).area == area


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name\nmouse\n", "header: expected columns node, found no node"),
        ("node\n", "expected rows, as `metric-tree select --out` writes them; found none"),
        ("node\nmouse.n.04\nmous.n.09\n", r"chosen\.csv:3: mous\.n\.09: no node has this id"),
    ],
)
def test_a_file_of_categories_has_rows_of_nodes(tree: Tree, tmp_path: Path, text: str, message: str) -> None:
    (file := tmp_path / "chosen.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        named_nodes(tree, str(file))
    file.write_text("node\nmouse.n.04\n")
    assert named_nodes(tree, str(file)) == named_nodes(tree, " computer mouse ") == [tree.node("mouse.n.04")]


@pytest.mark.parametrize(("height", "width"), [(480, 640), (100, 100)])
def test_a_background_is_a_window_of_an_image_of_at_least_three_fifths(height: int, width: int, tmp_path: Path) -> None:
    rows, columns = np.mgrid[:height, :width]
    image = np.dstack([rows * 255 // height, columns * 255 // width, rows * 0]).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "a.png"), image)
    for seed in range(5):
        window = random_window([tmp_path / "a.png"], (48, 64), np.random.default_rng(seed)).astype(int)
        assert window.shape == (48, 64, 3)
        span = min(height / 48, width / 64)
        for channel, side, axis in ((0, height, 48), (1, width, 64)):
            assert 0.55 * 255 * span * axis / side <= np.ptp(window[..., channel]) <= 1.01 * 255 * span * axis / side
    (tmp_path / "b.png").write_bytes(b"x")
    with pytest.raises(InputError, match=r"b\.png: image: expected an image"):
        random_window([tmp_path / "b.png"], (48, 64), np.random.default_rng(0))


@pytest.mark.parametrize(("side", "expected"), [(640, 640), (641, 640), (800, 640), (100, 100)])
def test_a_cut_out_in_memory_has_at_most_640_pixels(side: int, expected: int, tmp_path: Path) -> None:
    pixels = np.zeros((side + 20, 90, 4), dtype=np.uint8)
    pixels[10:-10, 10:-10] = 255
    cv2.imwrite(str(tmp_path / "a.png"), pixels)
    cutout = Cutout("1", "chair.n.01", 1, tmp_path / "a.png", None, "longest", (900.0,))
    read, longest = cutout_pixels(cutout)
    assert (longest, max(read.shape)) == (expected, expected)
    assert read.shape[1] == round(70 * expected / side)


def test_a_cut_out_without_an_opaque_pixel_is_an_error(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.full((9, 9, 4), 127, dtype=np.uint8))
    with pytest.raises(InputError, match="cut-out: expected an opaque pixel; found none"):
        cutout_pixels(Cutout("1", "chair.n.01", 1, tmp_path / "a.png", None, "height", (900.0,)))
    cv2.imwrite(str(tmp_path / "b.png"), np.full((9, 9, 3), 127, dtype=np.uint8))
    with pytest.raises(InputError, match="cut-out: expected an RGBA image of 8 bits"):
        cutout_pixels(Cutout("1", "chair.n.01", 1, tmp_path / "b.png", None, "height", (900.0,)))


def test_all_cut_outs_are_for_training_if_the_other_split_has_them(tmp_path: Path) -> None:
    """The hash of no item is below a fraction of zero, that of each is below one."""
    cv2.imwrite(str(tmp_path / "a.png"), np.full((9, 9, 4), 255, dtype=np.uint8))
    one = Cutout("1", "chair.n.01", 1, tmp_path / "a.png", None, "longest", (900.0,))
    for fraction in (0.0, 1.0):
        plan = Plan(pictures=1, size=(64, 48), val_share=fraction)
        assert [split for split, *_ in synthetic_entries(tmp_path / str(fraction), [one], plan)] == ["train"]
    assert list(synthetic_entries(tmp_path, [], plan)) == []


def test_a_node_without_a_prior_has_that_of_its_ancestor_or_no_size() -> None:
    above: Any = SimpleNamespace(prior_dims=(AXES,), prior=lambda: prior("b", [[600.0, 500.0, 900.0]]))
    node: Any = SimpleNamespace(pose="upright", prior_dims=(), ancestors=lambda: (above,))
    axis, sizes = shown_sizes({}, node, 0)
    assert (axis, len(sizes)) == ("height", 16)
    assert shown_sizes({"length_mm": 3.0, "width_mm": 9.0}, node, 0)[0] == "height"
    assert shown_sizes({"height_mm": 700.0}, node, 0) == ("height", (700.0,))
    node.pose = "flat"
    assert shown_sizes({}, node, 0)[0] == "longest"
    assert shown_sizes({"length_mm": 3.0, "width_mm": 9.0}, node, 0) == ("longest", (9.0,))
    node.ancestors = lambda: ()
    assert shown_sizes({"length_mm": 3.0}, node, 0) == ("longest", ())

"""From a shop's pages to a training set by commands alone (docs/how-to/training-sets.md)."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from pycocotools.coco import COCO

from metric_cli.subcommands import main
from metric_tree.tree import open_tree
from tests.synthetic.shop import EACH, PRODUCTS, PictureShop, size_mm

ROOT = Path(__file__).resolve().parents[2]

#: Breadcrumb to the node that the shipped taxonomy gives it, and which side of a picture its size is.
NODES = {"Dining Chairs": "mt:dining_chair", "Dining Tables": "dining_table.n.01", "Computer Mice": "mouse.n.04"}


@pytest.fixture(scope="module")
def crawl(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the real spider brings home, in a process of its own: Scrapy's reactor runs once."""
    out = tmp_path_factory.mktemp("pictures") / "crawl"
    code = "from metric_cli.subcommands import main; raise SystemExit(main())"
    with PictureShop() as shop:
        words = ["crawl", "generic", "--out", str(out), "--start-url", f"{shop.base}/list", "--pictures", "--json"]
        own = ["--contact", "tests@example.org", "--delay", "0", "--private"]
        done = subprocess.run(
            [sys.executable, "-c", code, *words, *own],
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=120,
            check=True,
        )
    assert json.loads(done.stdout)["dropped"]["picture_no_picture"] == 1  # the text under a picture's name
    return out


@pytest.fixture(scope="module")
def made(crawl: Path) -> Path:
    """The folder in which the three commands left a release, one with cut-outs, and a training set."""
    home = crawl.parent
    commands: list[tuple[object, ...]] = [
        ("build", crawl, "--out", home / "release", "--include-withheld", "127.0.0.1", "--workers", 1, "--no-heldout",
         "--without-curated"),
        ("cutout", home / "release", "--out", home / "cut", "--backend", "plain", "--workers", 1),
        ("export", "--tree", home / "cut", "--out", home / "set", "--pictures", 30, "--val-share", 0,
         "--categories", "dining chair,dining table,computer mouse"),
    ]  # fmt: skip
    for words in commands:
        assert main([str(word) for word in words]) == 0
    return home


@pytest.mark.slow
def test_every_picture_is_joined_to_its_item_and_cut_or_set_aside(made: Path) -> None:
    tree = open_tree(made / "cut")
    assert main(["validate", str(made / "cut")]) == 0
    rows = tree.root.images().to_pylist()
    assert len(rows) == len(PRODUCTS) - 1
    assert sum(row["cutout_path"] is None for row in rows) == 1  # what stands before clutter
    assert tree.release.manifest["cutouts"]["set_aside"] == {"not_plain": 1}
    for kind, node_id in NODES.items():
        node = tree.node(node_id)
        assert node.images().num_rows == (EACH - 1 if kind == "Dining Chairs" else EACH)
        stated = {tuple(sorted(row["extents_mm"])) for row in node.items().to_pylist()}
        assert stated == {tuple(sorted(map(float, size_mm(kind, number)))) for number in range(EACH)}


@pytest.mark.slow
def test_the_training_set_has_their_sizes_and_exact_masks(made: Path) -> None:
    coco = COCO(str(made / "set" / "annotations" / "instances_train.json"))
    items: dict[str, Any] = {row["item_id"]: row for row in open_tree(made / "cut").root.items().to_pylist()}
    assert len(coco.imgs) == 30
    assert {coco.cats[one["category_id"]]["node_id"] for one in coco.anns.values()} == set(NODES.values())
    for image in coco.imgs.values():
        found = coco.loadAnns(coco.getAnnIds(image["id"]))
        masks = np.array([coco.annToMask(one) for one in found])
        assert masks.sum(axis=0).max() == 1
        for one in found:
            item = items[one["item_id"]]
            side = item["height_mm"] if one["size_of"] == "height" else max(item["extents_mm"])
            assert one["size_mm"] == pytest.approx(side, abs=0.06)
            assert one["licence"] == item["licence"]
    with Image.open(made / "set" / "images" / coco.imgs[1]["file_name"]) as picture:
        assert picture.size == (640, 480)


@pytest.mark.slow
def test_a_researcher_draws_the_pictures_of_a_node(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["query", "dining chair", "--tree", str(made / "cut"), "--images", "5", "--sheet", str(made / "sheet.png")]
    assert main([*words, "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["images"]) == 5
    with Image.open(made / "sheet.png") as sheet:
        assert sheet.width == 1600

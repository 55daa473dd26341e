"""The commands create a training set from the pages of a shop (docs/how-to/training-sets.md)."""

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

#: Node of the shipped taxonomy for each breadcrumb.
NODES = {"Dining Chairs": "mt:dining_chair", "Dining Tables": "dining_table.n.01", "Computer Mice": "mouse.n.04"}


@pytest.fixture(scope="module")
def crawl(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a crawl. It runs in a separate process, because Scrapy's reactor cannot be restarted."""
    out = tmp_path_factory.mktemp("pictures") / "crawl"
    code = "from metric_cli.subcommands import main; raise SystemExit(main())"
    with PictureShop() as shop:
        arguments = ["crawl", "generic", "--out", str(out), "--start-url", f"{shop.base}/list", "--pictures", "--json"]
        arguments += ["--contact", "tests@example.org", "--delay", "0", "--private"]
        done = subprocess.run(
            [sys.executable, "-c", code, *arguments],
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=120,
            check=True,
        )
    assert json.loads(done.stdout)["dropped"]["picture_no_picture"] == 1  # the text file with the name of an image
    return out


@pytest.fixture(scope="module")
def results(crawl: Path) -> Path:
    """Return the folder with a release, a release with cut-outs, and a training set, written by three commands."""
    home = crawl.parent
    commands: list[tuple[object, ...]] = [
        ("build", crawl, "--out", home / "release", "--include-withheld", "127.0.0.1", "--workers", 1, "--no-heldout",
         "--without-curated"),
        ("cutout", home / "release", "--out", home / "cut", "--backend", "plain", "--workers", 1),
        ("export", "--tree", home / "cut", "--out", home / "set", "--pictures", 30, "--val-share", 0,
         "--categories", "dining chair,dining table,computer mouse"),
    ]  # fmt: skip
    for arguments in commands:
        assert main([str(argument) for argument in arguments]) == 0
    return home


@pytest.mark.slow
def test_every_image_belongs_to_its_item_and_is_cut_out_or_set_aside(results: Path) -> None:
    tree = open_tree(results / "cut")
    assert main(["validate", str(results / "cut")]) == 0
    rows = tree.root.images().to_pylist()
    assert len(rows) == len(PRODUCTS) - 1
    assert sum(row["cutout_path"] is None for row in rows) == 1  # the image with a cluttered background
    assert tree.release.manifest["cutouts"]["set_aside"] == {"not_plain": 1}
    for kind, node_id in NODES.items():
        node = tree.node(node_id)
        assert node.images().num_rows == (EACH - 1 if kind == "Dining Chairs" else EACH)
        stated = {tuple(sorted(row["extents_mm"])) for row in node.items().to_pylist()}
        assert stated == {tuple(sorted(map(float, size_mm(kind, number)))) for number in range(EACH)}


@pytest.mark.slow
def test_training_set_has_the_sizes_of_the_items_and_disjoint_masks(results: Path) -> None:
    coco = COCO(str(results / "set" / "annotations" / "instances_train.json"))
    items: dict[str, Any] = {row["item_id"]: row for row in open_tree(results / "cut").root.items().to_pylist()}
    assert len(coco.imgs) == 30
    categories = {coco.cats[annotation["category_id"]]["node_id"] for annotation in coco.anns.values()}
    assert categories == set(NODES.values())
    for record in coco.imgs.values():
        annotations = coco.loadAnns(coco.getAnnIds(record["id"]))
        masks = np.array([coco.annToMask(annotation) for annotation in annotations])
        assert masks.sum(axis=0).max() == 1
        for annotation in annotations:
            item = items[annotation["item_id"]]
            side = item["height_mm"] if annotation["size_of"] == "height" else max(item["extents_mm"])
            assert annotation["size_mm"] == pytest.approx(side, abs=0.06)
            assert annotation["licence"] == item["licence"]
    with Image.open(results / "set" / "images" / coco.imgs[1]["file_name"]) as image:
        assert image.size == (640, 480)


@pytest.mark.slow
def test_query_with_sheet_writes_a_contact_sheet_and_lists_images(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["query", "dining chair", "--tree", str(results / "cut"), "--images", "5"]
    assert main([*arguments, "--sheet", str(results / "sheet.png"), "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["images"]) == 5
    with Image.open(results / "sheet.png") as sheet:
        assert sheet.width == 1600

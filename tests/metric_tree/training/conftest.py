"""The small release with cut-outs."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from metric_cli.subcommands import main
from metric_tree.tree import Tree, open_tree
from tests.synthetic import minitree

#: Node, BGR of its cut-outs, their pixels (height, width).
CUTOUTS = {
    "swivel_chair.n.01": ((40, 40, 220), (210, 120)),
    "mt:bar_stool": ((40, 200, 40), (152, 84)),
    "mouse.n.04": ((220, 60, 40), (62, 112)),
}
#: Cut-outs of each node.
EACH = 4


@pytest.fixture
def tree(tmp_path: Path) -> Tree:
    """The small release with four cut-outs of each of three nodes: coloured blocks in a clear margin."""
    content = minitree.rows()
    directory = tmp_path / "release"
    for node_id in CUTOUTS:
        for number in range(EACH):
            row = dict.fromkeys(("path", "foreground_share", "source_url")) | {
                "image_id": f"{len(content['images.parquet']):064x}", "item_id": f"made:{node_id}-{number}",
                "node_id": node_id, "cutout_path": f"cutouts/{node_id}-{number}.png", "width_px": 1, "height_px": 1,
                "method": "made", "licence": "CC0-1.0",
            }  # fmt: skip
            content["images.parquet"].append(row)
    minitree.release(directory, content)
    (directory / "cutouts").mkdir()
    for node_id, (colour, (height, width)) in CUTOUTS.items():
        picture = np.zeros((height + 20, width + 20, 4), dtype=np.uint8)
        picture[10:-10, 10:-10] = (*colour, 255)
        for number in range(EACH):
            cv2.imwrite(str(directory / "cutouts" / f"{node_id}-{number}.png"), picture)
    return open_tree(directory)


def export(tree: Tree, out: Path, *words: str) -> int:
    start = ["export", "--tree", str(tree.release.directory), "--out", str(out), "--size", "320x240"]
    return main([*start, "--categories", "chair,computer mouse", *words])

"""The cut-outs of a release as objects to paste: a file, a class, and a true size from the tree."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from metric_tree.axes import AXES
from metric_tree.release.images import image_path
from metric_tree.training.classes import Classes
from metric_tree.tree import Node, NoPrior

__all__ = ["Cutout", "cutouts_of"]

#: Sizes drawn from the prior for an item that states none of its own.
MAX_DRAWS = 16


@dataclass(frozen=True, slots=True)
class Cutout:
    """An RGBA cut-out of one item.

    category : the class's id. axis : what of the picture `sizes_mm` is the size of: `height` of the cut-out's tight
    box, or its `longest` side. sizes_mm : the item's own size, or draws from its node's prior.
    """

    item_id: str
    node_id: str
    category: int
    file: Path
    licence: str | None
    axis: str
    sizes_mm: tuple[float, ...]


def cutouts_of(classes: Classes, seed: int) -> list[Cutout]:
    """The cut-outs of the classes' nodes, in the order of their items and images.

    A shop photographs an upright object from the front: its picture's height is the object's. What lies flat is shown
    from above and what has no pose from any side: there the longest side of the picture is the longest extent.
    """
    cutouts = []
    for category, root in enumerate(classes.nodes, start=1):
        sizes = {row["item_id"]: row for row in root.items().to_pylist()}
        rows = [row for row in root.images().to_pylist() if row["cutout_path"]]
        for row in sorted(rows, key=lambda row: (row["item_id"], row["image_id"])):
            node = classes.tree.node(row["node_id"])
            axis, values = _size(sizes.get(row["item_id"], {}), node, seed)
            file = image_path(classes.tree.release.directory, row, "cutout_path")
            if values and file is not None:
                cutouts.append(Cutout(row["item_id"], row["node_id"], category, file, row["licence"], axis, values))
    return cutouts


def _size(item: dict[str, object], node: Node, seed: int) -> tuple[str, tuple[float, ...]]:
    """What the size is of, and the item's own size, else draws from the prior of its node or the first one above."""
    known = [float(str(item[f"{axis}_mm"])) for axis in AXES if item.get(f"{axis}_mm") is not None]
    if node.pose == "upright" and item.get("height_mm") is not None:
        return "height", (float(str(item["height_mm"])),)
    if len(known) > 1 and node.pose != "upright":
        return "longest", (max(known),)
    above: Node | None = node
    while above is not None:
        try:
            prior = above.prior()
        except NoPrior:
            above = above.parent
            continue
        drawn = prior.sample(MAX_DRAWS, seed)
        if node.pose == "upright" and "height" in prior.dims:
            return "height", tuple(drawn[:, prior.dims.index("height")].tolist())
        return "longest", tuple(np.max(drawn, axis=1).tolist())
    return "longest", ()

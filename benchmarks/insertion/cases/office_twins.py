"""A bottle and a die beside those of `tum_office`: `python -m benchmarks.insertion.cases.office_twins --out DIR`.

The real scene lies beside the repository; no constant is set on it, and no picture of it may be published. The rows of
the twin are compared with those of the thing's mask, corrected for the distance of both.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.insertion.cases.case_list import SHARED
from benchmarks.insertion.cases.case_runs import command, drawn_heights, fresh, ratio_of
from benchmarks.insertion.cases.twins import share_words
from estimator.reading import read_instances, read_scene
from estimator.records.scene import View
from metric_base.arrays import BoolArray, FloatArray
from tests.synthetic.insertions import write_glb
from tests.synthetic.rooms.solids import Mesh

__all__ = ["main"]

SCENE = SHARED / "scenes" / "tum_office"
#: Name in the scene's truth, millimetres of height, half its thickness in metres, where its twin stands, its facing.
THINGS = (
    ("dice", 155, 0.0775, "frame=8,x=225,y=400", "25"),
    ("bottle_D1", 338, 0.0385, "frame=5,x=398,y=210", "camera"),
)
BOTTLE = SHARED / "models" / "sweethome3d" / "Scopia" / "wine_bottle.glb"
YELLOW = (0.9, 0.75, 0.05)
#: How far the flat part of a die's sides reaches, of half its edge.
FLAT = 0.65


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    folder = parser.parse_args().out / "office"
    folder.mkdir(parents=True, exist_ok=True)
    for thing in THINGS:
        print(_office_row(*thing, folder), flush=True)


def _office_row(name: str, height_mm: int, half_m: float, at: str, facing: str, folder: Path) -> str:
    """The twin of a thing: median of its rows over those of the thing, with the estimated and with the true scale."""
    true = json.loads((SCENE / "truth.json").read_text(encoding="utf-8"))["metres_per_unit"]
    code, record, _ = command("estimator.command", [SCENE, "--json"])
    model = write_glb(_die(height_mm / 1000), folder / "die.glb", YELLOW) if name == "dice" else BOTTLE
    cells = [name]
    for label, scale in ((f"{record['scale'] / true - 1:+.1%}", record["scale"]), ("true", true)):
        words: list[Any] = [SCENE, "--scale", scale, "--model", model, "--size", f"height={height_mm / 1000}"]
        words += ["--at", at, "--facing", facing, "--out", fresh(folder / f"{name}_{len(cells)}")]
        code, inserted, _ = command("insertion.command", [*words, "--json"])
        if code:
            return f"| {name} | {inserted['said']} |"
        real = _real_heights(name, half_m / true, np.array(inserted["place"]["position"]))
        ratio, frames = ratio_of(drawn_heights(inserted), real)
        cells += [label, f"{share_words(ratio)} ({frames})"]
    return f"| {' | '.join(cells)} |"


def _real_heights(name: str, half: float, there: FloatArray) -> dict[int, float]:
    """Rows of the thing's mask in each frame that shows all of it, as they would be at the depth of its twin.

    half : half the thing's thickness in scene units, as its points are on its front; there : (3,) the twin's foot.
    """
    read = read_scene(SCENE)
    truth = json.loads((SCENE / "truth.json").read_text(encoding="utf-8"))
    thing = next(item for item in truth["objects"] if item["track_name"] == name)
    kept = set(thing["frames"]) - set(thing["cut_off_by_image_border"]) - set(thing["occluded_by_annotated_objects"])
    names = sorted(view.name for view in read.views)
    heights = {}
    for item in read_instances(SCENE / "instances.json", read):
        view = read.views[item.view]
        number = names.index(view.name)
        if number in kept and item.track == str(thing["track_id"]):
            depth = _front_depth(view, read.points, item.mask, item.origin) + half
            twin = float(view.rotation[2] @ there + view.translation[2])
            heights[number] = item.mask.any(axis=1).sum() * depth / twin
    return heights


def _front_depth(view: View, points: FloatArray, mask: BoolArray, origin: tuple[int, int]) -> float:
    """Median depth of the view's own sparse points in a mask (h, w) at `origin`."""
    at = np.floor(view.keypoints - origin).astype(int)
    inside = ((at >= 0) & (at < mask.shape[::-1])).all(axis=1)
    rows = np.flatnonzero(inside)
    rows = rows[mask[at[rows, 1], at[rows, 0]]]
    local = points[view.point_index[rows]] @ view.rotation[2] + view.translation[2]
    return float(np.median(local)) if len(rows) else float("nan")


def _die(edge: float) -> Mesh:
    """A cube with round edges and corners, standing on the origin."""
    import trimesh

    cube = trimesh.creation.box((2.0, 2.0, 2.0))
    for _ in range(4):
        cube = cube.subdivide()
    inner = np.clip(cube.vertices, -FLAT, FLAT)
    out = cube.vertices - inner
    length = np.linalg.norm(out, axis=1, keepdims=True)
    vertices = (inner + (1 - FLAT) * out / np.maximum(length, 1e-9)) * edge / 2 + [0, 0, edge / 2]
    return Mesh(vertices, np.asarray(cube.faces), ("print",) * len(cube.faces))


if __name__ == "__main__":
    main()

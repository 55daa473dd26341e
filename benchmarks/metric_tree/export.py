"""`metric-tree export` at size: pictures per second, memory, pycocotools' reading, a contact sheet to look at.

    python -m benchmarks.metric_tree.export --out DIR [--pictures 1000] [--cutouts 200] [--jobs 1] [--tree REF]

Cut-outs are rendered things (`tests.synthetic.product_pictures`), put into a copy of a release, so that the command
runs as it does for a user; their sizes come from the release's priors.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pyarrow as pa

from estimator.results.categories import meanings
from metric_tree.release import MANIFEST, publish_release
from metric_tree.schema import IMAGES
from metric_tree.tree import Tree, open_tree
from tests.synthetic.product_pictures import things
from tests.synthetic.rooms.shapes import CATEGORIES

#: Pictures on the sheet, and the width of each.
SHEET, WIDTH = (4, 6), 400


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="a folder that is not there yet")
    parser.add_argument("--pictures", type=int, default=1000)
    parser.add_argument("--cutouts", type=int, default=200)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--tree", help="release (default: the shipped one)")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True)
    names = _release(open_tree(arguments.tree), arguments.out, arguments.cutouts)
    _exported(arguments.out, names, arguments.pictures, arguments.jobs)
    _read(arguments.out)


def _release(tree: Tree, out: Path, count: int) -> list[str]:
    """Publish a copy of the release with cut-outs; the ids of the nodes that have any."""
    folder = out / "extras" / "cutouts"
    folder.mkdir(parents=True)
    rows, nodes = [], {}
    known = {name: meaning.node for name, meaning in meanings(tree, {*CATEGORIES}).items()}
    for number, thing in enumerate(things(count, 0)):
        node = known[thing.category]
        if node is None:
            continue
        nodes[thing.category] = node.node_id
        alpha = np.rint(thing.coverage * 255).astype(np.uint8)
        cv2.imwrite(str(folder / f"{number:05d}.png"), np.dstack([thing.colour[:, :, ::-1], alpha]))
        rows.append(
            {
                "image_id": f"{number:064x}",
                "item_id": f"made:{number}",
                "node_id": node.node_id,
                "cutout_path": f"cutouts/{number:05d}.png",
                "width_px": alpha.shape[1],
                "height_px": alpha.shape[0],
                "method": "rendered",
                "licence": "CC0-1.0",
            }
        )
    tables = {f"{name}.parquet": tree.release.table(name) for name in ("nodes", "items", "priors")}
    tables["images.parquet"] = pa.Table.from_pylist(rows, schema=IMAGES)
    manifest = json.loads((tree.release.directory / MANIFEST).read_text())
    publish_release(out / "release", tables, {**manifest, "name": "export benchmark"}, out / "extras")
    print(f"{len(rows)} cut-outs of {len(nodes)} categories")
    # of two in one line of the tree the upper one is the class: a bookcase is a piece of furniture with shelves too
    kept = [name for name in sorted(set(nodes.values())) if not _above(tree, name) & set(nodes.values())]
    (out / "categories.csv").write_text("node\n" + "\n".join(kept) + "\n")
    return kept


def _above(tree: Tree, node_id: str) -> set[str]:
    line, node = set(), tree.node(node_id).parent
    while node is not None:
        line.add(node.node_id)
        node = node.parent
    return line


def _exported(out: Path, names: list[str], pictures: int, jobs: int) -> None:
    words = ["--categories", str(out / "categories.csv"), "--pictures", str(pictures), "--jobs", str(jobs)]
    code = "import sys; from metric_tree.commands import main; sys.exit(main(sys.argv[1:]))"
    call = [sys.executable, "-c", code, "export", "--tree", str(out / "release"), "--out", str(out / "set"), *words]
    started = time.perf_counter()
    subprocess.run([*call, "--json"], check=True, stdout=subprocess.DEVNULL)
    seconds = time.perf_counter() - started
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    size = sum(path.stat().st_size for path in (out / "set").rglob("*") if path.is_file())
    rate = pictures / seconds
    print(f"{pictures} pictures of {len(names)} categories in {seconds:.1f} s ({rate:.1f} a second, {jobs} jobs)")
    print(f"{usage.ru_utime + usage.ru_stime:.1f} s of processor; peak {usage.ru_maxrss / 1024:.0f} MB a process")
    print(f"{size / 1e6:.1f} MB on disk")


def _read(out: Path) -> None:
    """What pycocotools finds, checked: every box is that of its mask, no pixel belongs to two objects."""
    from pycocotools.coco import COCO

    sheet = []
    for split in ("train", "val"):
        coco = COCO(str(out / "set" / "annotations" / f"instances_{split}.json"))
        shares, sides, twice, boxes = [], [], 0, 0
        for image_id in coco.getImgIds():
            found = coco.loadAnns(coco.getAnnIds(image_id))
            masks = np.array([coco.annToMask(one) for one in found])
            twice += int((masks.sum(axis=0) > 1).sum()) if len(found) else 0
            boxes += sum(_box(mask) != one["bbox"] for mask, one in zip(masks, found, strict=True))
            shares += [one["visible_share"] for one in found]
            sides += [max(one["bbox"][2:]) for one in found]
            if split == "train" and len(sheet) < SHEET[0] * SHEET[1]:
                sheet.append(_drawn(out / "set" / "images" / coco.imgs[image_id]["file_name"], masks))
        images, objects = len(coco.imgs), len(coco.anns)
        each = objects / max(images, 1)
        print(f"{split}: {images} pictures, {objects} objects ({each:.1f} each); {twice} pixels twice,")
        print(f"  {boxes} boxes that are not their masks'; longest side 5 %, 50 %, 95 %: {_quantiles(sides)} px;")
        print(f"  occluded or cut (under 95 % visible): {np.mean(np.array(shares) < 0.95):.0%}")
    rows = [np.hstack(sheet[k : k + SHEET[1]]) for k in range(0, len(sheet), SHEET[1]) if k + SHEET[1] <= len(sheet)]
    if rows:
        cv2.imwrite(str(out / "sheet.png"), np.vstack(rows))
        print(f"contact sheet: {out / 'sheet.png'}")


def _box(mask: np.ndarray) -> list[float]:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return [float(v) for v in (columns[0], rows[0], columns[-1] - columns[0] + 1, rows[-1] - rows[0] + 1)]


def _quantiles(values: list[float]) -> str:
    return ", ".join(f"{value:.0f}" for value in np.quantile(values, [0.05, 0.5, 0.95])) if values else "none"


def _drawn(file: Path, masks: np.ndarray) -> np.ndarray:
    """The picture with every mask's outline."""
    picture = cv2.imread(str(file))
    for number, mask in enumerate(masks):
        outline, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        colour = tuple(int(v) for v in np.random.default_rng(number).integers(80, 256, 3))
        cv2.drawContours(picture, outline, -1, colour, 2)
    return np.asarray(cv2.resize(picture, (WIDTH, picture.shape[0] * WIDTH // picture.shape[1])))


if __name__ == "__main__":
    main()

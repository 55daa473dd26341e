"""Contact sheets of outlines and cuboids: `python -m benchmarks.estimator.contact_sheets OUT SCENE ...`.

For each scene one picture, OUT/SCENE.jpg: every measured object in up to three of its views, spread over them, with its
outline (yellow), its points (red) and its box (green, without the sides that no view shows to their end: orange).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.geometry.box_edges import EDGES, edge_axis, projected_edges
from estimator.pipeline import measure_objects
from estimator.reading import read_instances, read_scene
from estimator.reconstructions.cameras import pixels_in_view
from estimator.records.measured_object import MeasuredObject
from estimator.records.scene import Instance, Scene
from metric_base.arrays import FloatArray

__all__ = ["main"]

#: Pictures of one object, their side in pixels, and how much of them the object's outline is.
VIEWS, SIDE, FILL = 3, 260, 0.6
#: Lines of pixels for the title of an object.
TITLE = 22
#: Objects beside each other.
ACROSS = 2
YELLOW, RED, GREEN, ORANGE = (0, 255, 255), (0, 0, 255), (0, 220, 0), (0, 140, 255)
WHITE = (255, 255, 255)
MAX_POINTS = 150


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("scenes", nargs="+", type=Path)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for place in options.scenes:
        scene = read_scene(place)
        instances = read_instances(None, scene)
        items = [item for item in measure_objects(scene, instances).objects if item.box is not None]
        rows = [_object_row(item, scene, instances, place / "images") for item in items]
        blank = np.zeros_like(rows[0])
        rows += [blank] * (-len(rows) % ACROSS)
        sheet = np.vstack([np.hstack(rows[k : k + ACROSS]) for k in range(0, len(rows), ACROSS)])
        file = options.out / f"{place.resolve().name}.jpg"
        cv2.imwrite(str(file), sheet, [cv2.IMWRITE_JPEG_QUALITY, 85])
        print(f"{file}: {len(items)} objects")


def _object_row(item: MeasuredObject, scene: Scene, instances: tuple[Instance, ...], images: Path) -> NDArray[np.uint8]:
    """(h, w, 3) the object in its views, with what it measures."""
    members = [
        item.members[k]
        for k in np.linspace(0, len(item.members) - 1, min(VIEWS, len(item.members))).round().astype(int)
    ]
    tiles = [_tile(item, scene, instances[member], images) for member in members]
    tiles += [np.zeros((SIDE, SIDE, 3), np.uint8)] * (VIEWS - len(tiles))
    row = np.hstack(tiles)
    sizes = " x ".join(
        f"{size:.3g}{'+' if cut else ''}" for size, cut in zip(item.extents, item.truncated, strict=True)
    )
    text = f"{item.id} {item.category} {sizes}, {item.points} points"
    row[:TITLE] = 0
    cv2.putText(row, text, (6, 16), 0, 0.45, WHITE, 1, cv2.LINE_AA)
    return np.asarray(row, dtype=np.uint8)


def _tile(item: MeasuredObject, scene: Scene, instance: Instance, images: Path) -> NDArray[np.uint8]:
    """(h, w, 3) the object in one view."""
    view = scene.views[instance.view]
    picture = cv2.imread(str(images / view.name))
    if picture is None:
        picture = np.zeros((view.camera.height, view.camera.width, 3), np.uint8)
    height, width = instance.mask.shape
    scale = FILL * SIDE / max(height, width)
    middle = np.add(instance.origin, [width / 2, height / 2])
    corner = middle - SIDE / 2 / scale
    turn = np.array([[scale, 0, -scale * corner[0]], [0, scale, -scale * corner[1]]])
    tile = cv2.warpAffine(picture, turn, (SIDE, SIDE), flags=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC)

    def placed(pixels: FloatArray) -> NDArray[np.int32]:
        """(n, 2) pixels of the tile, those that are far away brought nearer."""
        at: NDArray[np.int32] = np.clip((pixels - corner) * scale, -4000, 4000).astype(np.int32)
        return at

    outlines, _ = cv2.findContours(instance.mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    for outline in outlines:
        cv2.polylines(tile, [placed(outline[:, 0] + instance.origin + 0.5)], True, YELLOW, 1)
    if item.box is not None:
        for edge, line in enumerate(projected_edges(item.box, view)[: len(EDGES)]):
            if np.isfinite(line).all():
                cv2.polylines(tile, [placed(line)], False, ORANGE if item.truncated[edge_axis(edge)] else GREEN, 1)
    if item.point_rows is not None and len(item.point_rows):
        cloud = scene.points if item.cloud == "sparse" or scene.dense is None else scene.dense.points
        pixels, _ = pixels_in_view(view, cloud[item.point_rows[:: max(1, len(item.point_rows) // MAX_POINTS)]])
        for at in placed(pixels[np.isfinite(pixels).all(axis=1)]):
            cv2.circle(tile, (int(at[0]), int(at[1])), 1, RED, -1)
    return np.asarray(tile, dtype=np.uint8)


if __name__ == "__main__":
    main()

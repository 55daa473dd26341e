"""Compare inserted objects with the same mesh really standing in the room: writes docs/evidence/insertion.md.

`python -m benchmarks.insertion.proof [--traced DIR ...] [--out docs/evidence]`. Made rooms are filmed with exact truth;
the object is inserted at the true scale and at scales that are wrong by 10 %, and compared with the mesh in the room.
DIR is a folder of `benchmarks.insertion.traced_room`, whose figures of light are taken over.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from insertion.scene.footage import Shot
from insertion.staging.insert import Placed, insert_objects, place_objects
from insertion.staging.options import ObjectRequest
from metric_base.arrays import BoolArray
from tests.made.insertions import FilmedRoom, added, film_room, stage_of, write_glb
from tests.made.rooms.render import Renderer
from tests.made.rooms.shapes import solid

__all__ = ["main"]

Picture = NDArray[np.uint8]
#: Kind and seed of the rooms; what is inserted into each, with its size in metres.
CASES = (
    ("sitting room", 1003, "chair", (0.42, 0.38, 0.75)),
    ("kitchen", 1005, "stool", (0.36, 0.36, 0.62)),
    ("bedroom", 1001, "chair", (0.42, 0.38, 0.75)),
)
SCALE_ERRORS = (0.9, 1.0, 1.1)
VIEWS = 5
#: An object of fewer pixels says little about its outline.
LEAST_PIXELS = 400


@dataclass(eq=False)
class Layers:
    """Takes the visible coverage and the picture of every frame."""

    visible: dict[int, NDArray[np.float32]] = field(default_factory=dict)

    def picture(self, shot: Shot, picture: Picture) -> None:
        """The frame without objects is not kept."""

    def layers(self, shot: Shot, number: int, alpha: NDArray[np.float32], depth: NDArray[np.float32]) -> None:
        """Visible coverage (h, w) of the one object, whose number and depth say nothing new."""
        del number, depth
        self.visible[shot.index] = alpha


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """One room: ratios of silhouette heights by scale error, and figures at the true scale."""

    name: str
    ratios: dict[float, float]
    views: int
    visible_error: float
    edge_px: float | None
    flicker: float
    pictures: list[tuple[Picture, Picture]]


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--traced", type=Path, nargs="*", default=[])
    parser.add_argument("--out", type=Path, default=Path("docs/evidence"))
    options = parser.parse_args()
    cases = [_case(*stated) for stated in CASES]
    folder = options.out / "insertion"
    folder.mkdir(parents=True, exist_ok=True)
    _write_sheet(folder / "made_rooms.jpg", [pair for case in cases for pair in case.pictures])
    if options.traced:
        _write_traced(folder / "traced_rooms.jpg", options.traced)
    (options.out / "insertion.md").write_text(_page(cases, options.traced), encoding="utf-8")
    print(options.out / "insertion.md")


def _case(kind: str, seed: int, what: str, size: Sequence[float]) -> Case:
    with tempfile.TemporaryDirectory() as name:
        room = film_room(kind, seed, Path(name), views=VIEWS, noise=0.004)
        mesh = solid(what, np.array(size))
        model = write_glb(mesh, room.folder / f"{what}.glb")
        true = stage_of(room)
        (placed,) = place_objects(true, [ObjectRequest(model)])
        whole, seen = (_true_masks(room, mesh, placed, alone) for alone in (True, False))
        ratios = {}
        for error in SCALE_ERRORS:
            stage = stage_of(room, error)
            wrong = placed if error == 1.0 else _at_scale(placed, error)
            layers = Layers()
            pictures: list[Picture] = []
            write = pictures.append
            (result,) = insert_objects(stage, [wrong], lambda _, p, keep=write: keep(p), film=True, layers=layers)
            heights = [
                frame.silhouette[3] / true_height
                for frame, mask in zip(result.frames, whole, strict=True)
                if frame.silhouette is not None and (true_height := _height_inside(mask)) is not None
            ]
            ratios[error] = float(np.mean(heights)) if heights else float("nan")
            if error == 1.0:
                figures = (len(heights), *_occlusion(layers, whole, seen), _flicker(pictures, seen))
                shown = [(pictures[k], _real(room, mesh, placed, k)) for k in _clearest(seen)]
        return Case(f"{kind} {seed}", ratios, *figures, shown)


def _at_scale(placed: Placed, error: float) -> Placed:
    """The object as a scale that is `error` times the true one makes it: metres over the scale."""
    from insertion.staging.insert import resize

    return resize(placed, 1 / error)


def _true_masks(room: FilmedRoom, mesh: object, placed: Placed, alone: bool) -> list[BoolArray]:
    world = added(room, mesh, placed.place.position, placed.front, alone)  # type: ignore[arg-type]
    with Renderer(world) as renderer:
        return [renderer.frame(k, colour=False).ids == len(world.objects) for k in range(len(world.poses))]


def _real(room: FilmedRoom, mesh: object, placed: Placed, index: int) -> Picture:
    """The picture of the room in which the mesh really stands, painted by the room's own renderer."""
    world = added(room, mesh, placed.place.position, placed.front)  # type: ignore[arg-type]
    with Renderer(world) as renderer:
        colour = renderer.frame(index).colour
    assert colour is not None
    return colour


def _height_inside(mask: BoolArray) -> int | None:
    """Rows of an outline that is wholly in the picture and large enough, else None."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if mask.sum() < LEAST_PIXELS or not (rows[0] > 1 and rows[-1] < mask.shape[0] - 2):
        return None
    if not (columns[0] > 1 and columns[-1] < mask.shape[1] - 2):
        return None
    return int(np.ptp(rows)) + 1


def _occlusion(layers: Layers, whole: list[BoolArray], seen: list[BoolArray]) -> tuple[float, float | None]:
    """Mean error of the visible share; mean distance in pixels between the edges of what hides the object."""
    import cv2

    shares, wrong, length = [], 0.0, 0.0
    for index, (all_of_it, rest) in enumerate(zip(whole, seen, strict=True)):
        if all_of_it.sum() < LEAST_PIXELS or index not in layers.visible:
            continue
        ours = layers.visible[index] > 0.5
        shares.append(abs(ours.sum() - rest.sum()) / all_of_it.sum())
        inner = cv2.erode(all_of_it.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
        hidden = (inner & ~rest).astype(np.uint8)
        edge = inner & (cv2.dilate(hidden, np.ones((3, 3), np.uint8)) > 0) & rest
        wrong += float((inner & (ours != rest)).sum())
        length += float(edge.sum())
    return float(np.mean(shares)) if shares else 0.0, wrong / length if length > 30 else None


def _flicker(pictures: list[Picture], seen: list[BoolArray]) -> float:
    """Largest change between neighbouring frames of the object's mean brightness, as a share of it."""
    means = [
        float(p[m].mean()) if m.sum() > LEAST_PIXELS else float("nan") for p, m in zip(pictures, seen, strict=True)
    ]
    steps = np.abs(np.diff(np.log(means)))
    return float(np.nanmax(steps)) if np.isfinite(steps).any() else 0.0


def _clearest(seen: list[BoolArray]) -> list[int]:
    """The two views with most of the object."""
    return [int(k) for k in np.argsort([-mask.sum() for mask in seen])[:2]]


def _write_sheet(file: Path, pairs: list[tuple[Picture, Picture]]) -> None:
    """Inserted beside real, two pairs a row, at half size."""
    import cv2

    cells = [np.hstack([cv2.resize(picture, None, fx=0.5, fy=0.5) for picture in pair]) for pair in pairs]
    cv2.imwrite(
        str(file),
        np.vstack([np.hstack(cells[k : k + 2]) for k in range(0, len(cells) - 1, 2)])[..., ::-1],
        [cv2.IMWRITE_JPEG_QUALITY, 85],
    )


def _write_traced(file: Path, folders: Sequence[Path]) -> None:
    """One view of each traced room, twice as large: without the object, with it inserted, with it really there."""
    import cv2

    rows = [cv2.imread(str(sorted(folder.glob("compare_*.png"))[-1])) for folder in folders]
    sheet = np.vstack([cv2.resize(row, None, fx=1.6, fy=1.6, interpolation=cv2.INTER_CUBIC) for row in rows])
    cv2.imwrite(str(file), sheet, [cv2.IMWRITE_JPEG_QUALITY, 85])


def _page(cases: list[Case], traced: Sequence[Path]) -> str:
    template = Path(__file__).with_name("proof_page.md").read_text(encoding="utf-8")
    rows = "\n".join(
        f"| {c.name} | {c.views} | {c.ratios[0.9]:.3f} | {c.ratios[1.0]:.3f} | {c.ratios[1.1]:.3f} "
        f"| {100 * c.visible_error:.1f} % | {'none hidden' if c.edge_px is None else f'{c.edge_px:.1f}'} "
        f"| {100 * c.flicker:.1f} % |"
        for c in cases
    )
    light = "\n".join(_light_row(folder) for folder in traced)
    return template.replace("{ROOMS}", rows).replace("{LIGHT}", light)


def _light_row(folder: Path) -> str:
    records = [json.loads(line) for line in (folder / "records.jsonl").read_text(encoding="utf-8").splitlines()]
    cells = [folder.name.replace("_", " "), f"{np.mean([row['mean_abs_srgb'] for row in records]):.1f}"]
    cells += [
        " ".join(f"{row[name]:.2f}" for row in records) for name in ("luminance_ratio", "shadow_true", "shadow_ours")
    ]
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    main()

"""An inserted object against the same mesh that is in the synthetic room itself."""

from __future__ import annotations

import json
import tempfile
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from estimator.projection.cameras import pixels_in_view
from estimator.records.scene import Instance
from insertion.composite.compositor import Compositor
from insertion.footage.footage import Frame
from insertion.insertion_scene import InsertionScene
from insertion.placement.at_pixel import plane_coordinates
from insertion.placement.placed_object import PlacedObject
from insertion.request import ObjectRequest, PixelPosition
from insertion.result import InsertionResult
from tests.synthetic.insertions import (
    RecordedRoom,
    added,
    composite_into,
    in_unit,
    place_in,
    prepared_scene_of,
    video_room,
    write_glb,
)
from tests.synthetic.rooms.render import Renderer
from tests.synthetic.rooms.shapes import solid

SIZE = np.array([0.42, 0.38, 0.75])
#: Number of units of another reconstruction of the room per unit of this one.
UNIT = 0.037
ROOM = ("sitting room", 1003)
#: What `_mean_changes` was when somebody inspected the images, and how many levels of 255 its cells may be off on
#: average: noise of one level in all images, as another rasteriser leaves, makes it 2.0.
LOOKED_AT, LEVELS, CELLS = Path(__file__).with_name("looked_at.json"), 2.5, 6
#: Image and pixel of a place on the floor behind a table.
BEHIND_TABLE = (5, 510.0, 262.0)


@dataclass(frozen=True, slots=True, eq=False)
class Inserted:
    room: RecordedRoom
    prepared: InsertionScene
    placed: PlacedObject
    result: InsertionResult
    pictures: dict[str, np.ndarray]


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> RecordedRoom:
    return video_room(*ROOM, tmp_path_factory.mktemp("room"))


def _insert(room: RecordedRoom, scale_error: float = 1.0) -> Inserted:
    prepared = prepared_scene_of(room, scale_error)
    model = write_glb(solid("chair", SIZE), room.folder / "chair.glb")
    (placed,) = place_in(prepared, [ObjectRequest(model)])
    pictures: dict[str, np.ndarray] = {}
    (result,) = composite_into(prepared, [placed], lambda shot, picture: pictures.update({shot.name: picture}))
    return Inserted(room, prepared, placed, result, pictures)


@pytest.fixture(scope="module")
def inserted(room: RecordedRoom) -> Inserted:
    return _insert(room)


def test_a_model_that_walks_has_its_true_size_all_along(inserted: Inserted) -> None:
    """A chair drawn across the floor: in each image it is where the way states, as the same chair would stand there."""
    prepared, stands = inserted.prepared, inserted.placed
    assert stands.placement.plane is not None
    x, y = plane_coordinates(prepared.space, stands.placement) * prepared.scale.metres_per_unit
    request = replace(stands.request, plane=stands.placement.plane, xy_m=(x, y), path=((x + 0.4, y),))
    (walks,) = place_in(prepared, [request])
    some = prepared.footage.between(2, 4)
    (result,) = composite_into(prepared, [walks], lambda *_: None, some)
    last = prepared.footage.frames[-1]
    for shot, frame in zip(some.frames, result.frames, strict=True):
        body = walks.body_at(shot.clock_s - prepared.footage.start_s)
        gone = np.linalg.norm(body.position - walks.placement.position) * prepared.scale.metres_per_unit
        assert gone == pytest.approx(0.4 * shot.index / last.index, abs=1e-6)
        assert body.unit == pytest.approx(walks.body.unit)
        assert shot.view is not None
        if frame.silhouette is None:
            continue
        pixels, _ = pixels_in_view(shot.view, body.position + body.unit * body.corners)
        if np.isfinite(pixels).all():
            box, low, high = frame.silhouette, pixels.min(axis=0), pixels.max(axis=0)
            np.testing.assert_allclose([box[0], box[1], box[2], box[3]], [*low, *(high - low)], atol=2.0)


@pytest.fixture(scope="module")
def masks_alone(inserted: Inserted) -> list[np.ndarray]:
    """Masks of the object in the room without other objects."""
    return _true_masks(inserted, alone=True)


def _drawn(prepared: InsertionScene, objects: list[PlacedObject], frame: Frame) -> np.ndarray:
    plate = next(image for other, image in prepared.footage if other.index == frame.index)
    start_s = prepared.footage.start_s
    with closing(Compositor(objects, prepared.light, prepared.content, start_s)) as compositor:
        return compositor.draw(frame, plate)


def _true_masks(inserted: Inserted, alone: bool) -> list[np.ndarray]:
    heading = inserted.placed.body.basis.T @ inserted.placed.body.basis @ _front(inserted)
    world = added(inserted.room, solid("chair", SIZE), inserted.placed.placement.position, heading, alone)
    with Renderer(world) as renderer:
        return [renderer.frame(k, colour=False).ids == len(world.objects) for k in range(len(world.poses))]


def _front(inserted: Inserted) -> np.ndarray:
    place = inserted.placed.placement
    up = place.basis[2]
    toward = place.camera - place.position
    toward = toward - (toward @ up) * up
    return toward / np.linalg.norm(toward)


def _whole_boxes(masks: list[np.ndarray], inserted: Inserted) -> list[tuple[tuple[int, int, int, int], tuple]]:
    """Boxes of the truth and of the insertion where the object is wholly in the image."""
    pairs = []
    for mask, frame in zip(masks, inserted.result.frames, strict=True):
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        if len(rows) and rows[0] > 1 and rows[-1] < 478 and columns[0] > 1 and columns[-1] < 638:
            box = (int(columns[0]), int(rows[0]), int(np.ptp(columns)) + 1, int(np.ptp(rows)) + 1)
            pairs.append((box, frame.silhouette))
    return pairs


@pytest.mark.slow
def test_the_silhouette_is_as_high_as_the_true_one(inserted: Inserted, masks_alone: list[np.ndarray]) -> None:
    pairs = _whole_boxes(masks_alone, inserted)
    assert len(pairs) >= 3
    ratios = [ours[3] / true[3] for true, ours in pairs]
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.01)
    for true, ours in pairs:
        assert np.abs(np.subtract(true, ours)).max() <= 3  # up is estimated, so an edge may be a pixel or two off


@pytest.mark.parametrize("error", [0.8, 1.25])
def test_a_wrong_scale_shows_in_full(room: RecordedRoom, inserted: Inserted, error: float) -> None:
    prepared = prepared_scene_of(room, error)
    placed = place_in(prepared, [inserted.placed.request])[0]
    assert placed.body.unit * error == pytest.approx(inserted.placed.body.unit)
    assert placed.size_m == inserted.placed.size_m


def test_what_stands_in_front_hides_the_object(inserted: Inserted, masks_alone: list[np.ndarray]) -> None:
    seen = _true_masks(inserted, alone=False)
    for frame, all_of_it, rest in zip(inserted.result.frames, masks_alone, seen, strict=True):
        if all_of_it.sum() > 500:
            assert frame.visible == pytest.approx(rest.sum() / all_of_it.sum(), abs=0.05)


def test_far_pixels_do_not_change(inserted: Inserted) -> None:
    import cv2

    for name, picture in inserted.pictures.items():
        before = cv2.imread(str(inserted.room.folder / "images" / name))[..., ::-1]
        changed = np.abs(picture.astype(int) - before).max(axis=-1) > 0
        assert changed.mean() < 0.5
        assert changed.any()


def _mean_changes(inserted: Inserted) -> dict[str, list[list[float]]]:
    """Mean change of colour by cells around the chair in each image, and around one that a table partly hides."""
    shot = inserted.prepared.footage.frames[BEHIND_TABLE[0]]
    point = PixelPosition(shot.name, *BEHIND_TABLE[1:])
    behind = place_in(inserted.prepared, [replace(inserted.placed.request, at=point)])
    picture = _drawn(inserted.prepared, behind, shot)
    named = zip(inserted.pictures.items(), inserted.result.frames, strict=True)
    boxes = {name: (picture, frame.silhouette) for (name, picture), frame in named if frame.silhouette is not None}
    changes = {name: _cells(inserted.room, name, *seen) for name, seen in boxes.items()}
    return changes | {"behind": _cells(inserted.room, shot.name, picture, (480, 150, 70, 130))}


def _cells(room: RecordedRoom, name: str, picture: np.ndarray, box: tuple[int, int, int, int]) -> list[list[float]]:
    """Mean change (3,) of CELLS x CELLS cells over a box (left, top, width, height) and half its size around it."""
    import cv2

    before = cv2.imread(str(room.folder / "images" / name))[..., ::-1]
    change = picture.astype(float) - before
    columns, rows = (
        np.clip(np.linspace(box[k] - box[k + 2] / 2, box[k] + 1.5 * box[k + 2], CELLS + 1).astype(int), 0, end)
        for k, end in ((0, picture.shape[1]), (1, picture.shape[0]))
    )
    cells = [change[a:b, c:d] for a, b in pairwise(rows) for c, d in pairwise(columns)]
    return [np.round(cell.mean(axis=(0, 1)), 2).tolist() if cell.size else [0.0] * 3 for cell in cells]


def test_the_light_on_the_object_and_around_it_is_as_it_was_looked_at(inserted: Inserted) -> None:
    """Who changes light looks at the images again and makes the file anew: `python -m tests.insertion.test_truth`."""
    looked_at = json.loads(LOOKED_AT.read_text())
    now = _mean_changes(inserted)
    assert now.keys() == looked_at.keys()
    for name, cells in looked_at.items():
        assert np.abs(np.subtract(now[name], cells)).mean() < LEVELS, name


def test_the_unit_of_the_reconstruction_does_not_show(inserted: Inserted) -> None:
    prepared = prepared_scene_of(in_unit(inserted.room, UNIT))
    (placed,) = place_in(prepared, [inserted.placed.request])
    shot = prepared.footage.frames[2]
    again = _drawn(prepared, [placed], shot)
    assert np.abs(again.astype(int) - inserted.pictures[shot.name]).max() <= 2  # levels, by rounding


def test_sizes_are_metres_over_scale(inserted: Inserted, tmp_path: Path) -> None:
    record = inserted.result.to_json()
    for name, metres in zip(("length", "width", "height"), (0.42, 0.38, 0.75), strict=True):
        assert record["size_m"][name] == pytest.approx(metres, rel=1e-5)
        assert record["size_units"][name] == pytest.approx(metres * inserted.room.to_scene.scale, rel=1e-4)


def test_who_walks_before_an_object_hides_it(inserted: Inserted) -> None:
    """A mask all over the image whose feet are below it: somebody right before the camera."""
    prepared = inserted.prepared
    assert prepared.space.supports.ground(prepared.space.cloud) is not None
    some = prepared.footage.between(2, 2)
    (shot,) = some.frames
    assert shot.view is not None
    camera = shot.view.camera
    near = Instance("walker", 0, "person", np.ones((camera.height, camera.width), bool), (0, 0))
    for moving, visible in (((), True), ((near,), False)):
        scene = replace(prepared, content=replace(prepared.content, moving={2: moving}))
        (result,) = composite_into(scene, [inserted.placed], lambda *_: None, some)
        assert (result.frames[0].visible > 0.2) == visible


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        seen = _mean_changes(_insert(video_room(*ROOM, Path(folder))))
    LOOKED_AT.write_text("{" + ",\n".join(f'"{name}":{json.dumps(cells)}' for name, cells in seen.items()) + "}\n")

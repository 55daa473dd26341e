"""Instance masks: COCO in all its spellings against pycocotools, joins by name, other sizes, OpenSfM's images."""

from __future__ import annotations

import json
import math
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from PIL import Image
from pycocotools import mask as coco

from estimator.instances import view_matching
from estimator.instances.instance_reader import read_instances, read_instances_and_warnings
from estimator.instances.mask_decoding import box_mask, decode_segmentation
from estimator.instances.view_matching import mask_crop
from estimator.reconstructions.image_files import image_folders
from estimator.records.scene import Camera, Instance, Scene, View
from metric_base.errors import FieldError, InputError
from tests.support.processor_time import processor_seconds

HERE = Path("instances.json")


def scene_of(folder: Path, *names: str, width: int = 40, height: int = 30) -> Scene:
    """A scene with views of these names and one point."""
    camera = Camera("SIMPLE_PINHOLE", width, height, np.array([30.0, width / 2, height / 2]))
    no_keypoints = (np.empty((0, 2)), np.empty(0, dtype=np.int64))
    views = tuple(View(name, camera, np.eye(3), np.zeros(3), *no_keypoints) for name in names)
    return Scene(folder, "memory", views, np.array([[0.0, 0.0, 1.0]]))


def dataset(annotations: list[dict[str, Any]], *names: str, size: tuple[int, int] | None = (40, 30)) -> dict[str, Any]:
    images: list[dict[str, Any]] = [{"id": 10 * row, "file_name": name} for row, name in enumerate(names, start=1)]
    if size:
        images = [image | {"width": size[0], "height": size[1]} for image in images]
    named = [{"image_id": 10, "category_id": 3} | annotation for annotation in annotations]
    return {"images": images, "categories": [{"id": 3, "name": "mug"}], "annotations": named}


def written(folder: Path, document: object, name: str = "instances.json") -> Path:
    (folder / name).write_text(json.dumps(document), encoding="utf-8")
    return folder / name


def pasted(instance: Instance, camera: Camera) -> np.ndarray:
    """(h, w) the mask in its whole image."""
    whole = np.zeros((camera.height, camera.width), dtype=bool)
    (x, y), (height, width) = instance.origin, instance.mask.shape
    whole[y : y + height, x : x + width] = instance.mask
    return whole


masks = st.integers(0, 2**32 - 1).map(
    lambda seed: cv2.blur(np.random.default_rng(seed).random((30, 40)), (5, 5)) > 0.5,
)


@settings(deadline=None)
@given(mask=masks, compressed=st.booleans())
def test_run_lengths_are_pycocotools(mask: np.ndarray, compressed: bool) -> None:
    runs = coco.encode(np.asfortranarray(mask, dtype=np.uint8))
    counts: Any = runs["counts"].decode()
    if not compressed:
        edges = np.flatnonzero(np.diff(mask.T.ravel().astype(int), prepend=0))
        counts = np.diff([0, *edges, mask.size]).tolist()
    read = decode_segmentation({"size": [30, 40], "counts": counts}, (1, 1))
    np.testing.assert_array_equal(read, mask)


@settings(deadline=None)
@given(seed=st.integers(0, 2**32 - 1), corners=st.integers(3, 12), parts=st.integers(1, 3))
def test_polygons_are_pycocotools(seed: int, corners: int, parts: int) -> None:
    rng = np.random.default_rng(seed)
    polygons = [(rng.random((corners, 2)) * (40, 30)).ravel().tolist() for _ in range(parts)]
    runs = coco.merge(coco.frPyObjects(polygons, 30, 40))
    np.testing.assert_array_equal(decode_segmentation(polygons, (40, 30)), coco.decode(runs).astype(bool))


def test_a_polygon_far_beyond_the_picture_is_cut_to_it() -> None:
    everything = decode_segmentation([[-1e9, -1e9, 1e9, -1e9, 1e9, 1e9, -1e9, 1e9]], (40, 30))
    assert everything.all()
    with pytest.raises(FieldError, match="outlines of at most"):
        decode_segmentation([[0, 0, 50_000, 0] * 100 + [0, 9]], (50_000, 100))


@pytest.mark.parametrize(
    ("box", "rows", "columns"),
    [([2, 3, 4, 5], (3, 8), (2, 6)), ([-5, -5, 10, 10], (0, 5), (0, 5)), ([35.6, 0, 100, 1.4], (0, 1), (36, 40))],
)
def test_boxes_hold_the_pixels_whose_centres_they_hold(
    box: list[float], rows: tuple[int, int], columns: tuple[int, int]
) -> None:
    expected = np.zeros((30, 40), dtype=bool)
    expected[slice(*rows), slice(*columns)] = True
    np.testing.assert_array_equal(box_mask(box, (40, 30)), expected)


def test_a_dataset_with_masks_boxes_scores_and_tracks(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, "a.png", "b.png")
    mask = np.zeros((30, 40), dtype=bool)
    mask[4:9, 6:20] = True
    runs = coco.encode(np.asfortranarray(mask, dtype=np.uint8))
    annotations = [
        {"id": 5, "segmentation": {"size": [30, 40], "counts": runs["counts"].decode()}, "track_id": 8, "score": 0.5},
        {"bbox": [1, 2, 3, 4], "image_id": 20},
        {"segmentation": [], "bbox": [1, 2, 3, 4]},
    ]
    written(tmp_path, dataset(annotations, "a.png", "b.png"))
    first, second, third = read_instances(None, scene)
    np.testing.assert_array_equal(pasted(first, scene.views[0].camera), mask)
    assert (first.id, first.view, first.category, first.score, first.track) == ("5", 0, "mug", 0.5, "8")
    assert not first.from_box
    assert (second.view, second.origin, second.mask.shape, second.from_box) == (1, (1, 2), (4, 3), True)
    assert third.from_box


def test_a_picture_that_is_listed_twice_is_said(tmp_path: Path) -> None:
    boxes = [{"bbox": [1, 1, 5, 5], "image_id": number} for number in (10, 20)]
    written(tmp_path, dataset(boxes, "a.png", "a.png"))
    instances, warnings = read_instances_and_warnings(scene_of(tmp_path, "a.png", "b.png"))
    assert [instance.view for instance in instances] == [0, 0]
    assert any("'a.png' is the file_name of 2 images" in line for line in warnings)


def test_joined_by_name_then_base_name_never_by_id(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, "left/a.png", "right/a.png", "left/b.png", "c.png")
    boxes = [{"bbox": [1, 1, 5, 5], "image_id": number} for number in (10, 20, 30, 40, 50)]
    names = ("right/a.png", "deep/b.png", "./c.png", "a.png", "nowhere.png")
    written(tmp_path, dataset(boxes, *names))
    instances, warnings = read_instances_and_warnings(scene)
    assert [instance.view for instance in instances] == [1, 2, 3], (
        "two views are called a.png, so the bare name is none"
    )
    assert any("2 of 5 images match no view, such as 'a.png'" in warning for warning in warnings)


def test_crowds_and_empty_masks_are_left_out_and_reported(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, "a.png")
    empty = {"size": [30, 40], "counts": [1200]}
    crowd = {"size": [30, 40], "counts": [0, 1200]}
    annotations = [{"segmentation": empty}, {"segmentation": crowd, "iscrowd": 1}, {"bbox": [1, 1, 2, 2]}]
    written(tmp_path, dataset(annotations, "a.png"))
    instances, warnings = read_instances_and_warnings(scene)
    assert len(instances) == 1
    assert any("1 crowd" in warning for warning in warnings)
    assert any("1 masks without a pixel" in warning for warning in warnings)


@settings(max_examples=40, deadline=None)
@given(mask=masks, width=st.integers(4, 100), wider=st.floats(-0.05, 0.05))
def test_another_size_is_resampled_at_pixel_centres(mask: np.ndarray, width: int, wider: float) -> None:
    height = round(width * 30 / 40 * math.exp(wider))
    assume(abs(math.log(width / height * 30 / 40)) < 0.1)
    camera = Camera("SIMPLE_PINHOLE", width, height, np.array([30.0, 1.0, 1.0]))
    expected = np.zeros((height, width), dtype=bool)
    for y in range(height):
        for x in range(width):
            expected[y, x] = mask[int((y + 0.5) * 30 / height), int((x + 0.5) * 40 / width)]
    crop = mask_crop(mask, camera)
    if crop is None:
        assert not expected.any()
    else:
        np.testing.assert_array_equal(pasted(Instance("1", 0, "mug", *crop), camera), expected)


@settings(max_examples=20, deadline=None)
@given(mask=masks, left=st.integers(0, 30), top=st.integers(0, 20), width=st.integers(30, 60))
def test_part_of_a_mask_has_the_crop_of_the_whole(mask: np.ndarray, left: int, top: int, width: int) -> None:
    camera = Camera("SIMPLE_PINHOLE", width, round(width * 0.75), np.array([30.0, 1.0, 1.0]))
    part = mask[top : top + 9, left : left + 8]
    whole = np.zeros_like(mask)
    whole[top : top + 9, left : left + 8] = part
    crop, expected = mask_crop(part, camera, (left, top), (40, 30)), mask_crop(whole, camera)
    assert (crop is None) == (expected is None)
    if crop is not None and expected is not None:
        assert crop[1] == expected[1]
        np.testing.assert_array_equal(crop[0], expected[0])


@pytest.mark.parametrize(("density", "is_refused"), [(0.15, True), (0.001, False)])
def test_noise_in_an_image_of_labels_is_refused_quickly(tmp_path: Path, density: float, is_refused: bool) -> None:
    scene = scene_of(tmp_path, "a.png", width=640, height=480)
    (tmp_path / "instances").mkdir()
    (tmp_path / "instances" / "categories.json").write_text('{"1": "chair"}', encoding="utf-8")
    noise = np.random.default_rng(0).random((480, 640)) < density
    Image.fromarray(noise.astype(np.uint8)).save(tmp_path / "instances" / "a.png.png")

    def read() -> None:
        if is_refused:
            with pytest.raises(InputError, match="parts: expected at most 10,000 of a category"):
                read_instances_and_warnings(scene, tmp_path / "instances")
        else:
            assert len(read_instances_and_warnings(scene, tmp_path / "instances")[0]) > 200

    assert processor_seconds(read, 3) < 3


@pytest.mark.parametrize(("limit", "field"), [("MAX_MASKS", "of an image"), ("MAX_SCENE_BYTES", "pixels in all")])
def test_masks_beyond_the_limits_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: str, field: str
) -> None:
    scene = scene_of(tmp_path, "a.png")
    written(tmp_path, dataset([{"bbox": [1, 1, 2, 1]}, {"bbox": [4, 4, 1, 1]}], "a.png"))
    size = {"MAX_MASKS": 2, "MAX_SCENE_BYTES": 3}[limit]
    monkeypatch.setattr(view_matching, limit, size)
    assert len(read_instances_and_warnings(scene)[0]) == 2
    monkeypatch.setattr(view_matching, limit, size - 1)
    with pytest.raises(InputError, match=field):
        read_instances_and_warnings(scene)


def test_a_turned_picture_is_reported(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, "a.png")
    written(tmp_path, dataset([{"bbox": [1, 1, 9, 9]}], "a.png", size=(42, 30)))
    assert any("another shape" in warning for warning in read_instances_and_warnings(scene)[1])
    written(tmp_path, dataset([{"bbox": [1, 1, 9, 9]}], "a.png", size=(30, 40)))
    with pytest.raises(InputError, match="turned"):
        read_instances_and_warnings(scene)
    runs = {"size": [40, 40], "counts": [800, 40, 760]}  # between bars
    written(tmp_path, dataset([{"segmentation": runs}], "a.png"))
    with pytest.raises(InputError, match="mask size"):
        read_instances_and_warnings(scene)


def test_boxes_of_two_corners_are_said(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, "a.png")
    corners = [{"bbox": [20, 10, 30, 25]}, {"bbox": [1, 15, 39, 29]}, {"bbox": [2, 2, 9, 9]}]
    written(tmp_path, dataset(corners, "a.png"))
    with pytest.raises(InputError, match="2 of 3 beyond it; they are two corners"):
        read_instances_and_warnings(scene)
    written(tmp_path, dataset([corners[2], {"bbox": [30, 20, 10.3, 10.2]}], "a.png"))  # a detector's, not clipped
    assert len(read_instances_and_warnings(scene)[0]) == 2


def test_results_take_names_from_beside_or_from_categories(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, "a.png")
    frame = dataset([], "a.png")
    results = written(tmp_path, [{"image_id": 10, "category_id": 3, "bbox": [1, 2, 3, 4], "score": 0.25}], "found.json")
    with pytest.raises(InputError, match=r"--categories.*no file found_categories\.json"):
        read_instances(results, scene)
    other = written(tmp_path, frame, "other.json")
    (instance,) = read_instances(results, scene, other)
    assert (instance.category, instance.score, instance.from_box) == ("mug", 0.25, True)
    assert read_instances_and_warnings(scene, results, other)[1] == ()
    written(tmp_path, frame, "found_categories.json")
    assert len(read_instances(results, scene)) == 1


def test_categories_beside_a_dataset_are_reported_not_read(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, "a.png")
    annotation = {"id": 1, "image_id": 10, "category_id": 3, "bbox": [1, 2, 3, 4]}
    whole = written(tmp_path, dataset([annotation], "a.png"), "whole.json")
    assert read_instances_and_warnings(scene, whole)[1] == ()
    (line,) = read_instances_and_warnings(scene, whole, "other.json")[1]
    assert line.startswith("--categories other.json: not read")


def pictures(folder: Path, names: dict[str, str], **pixels: np.ndarray) -> Path:
    (folder / "instances").mkdir()
    written(folder / "instances", names, "categories.json")
    for name, values in pixels.items():
        (folder / "instances" / f"{name}.jpg.png").write_bytes(cv2.imencode(".png", values)[1].tobytes())
    return folder / "instances"


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_pictures_whose_values_are_objects(dtype: type, tmp_path: Path) -> None:
    values = np.zeros((30, 40), dtype=dtype)
    values[2:8, 2:8], values[2:8, 30:38], values[20:25, 5:9], values[28:, :] = 1, 1, 2, 200
    pictures(tmp_path, {"1": "chair", "2": "chair"}, a=values)
    instances, warnings = read_instances_and_warnings(scene_of(tmp_path, "a.jpg", "b.jpg"))
    assert [(instance.view, instance.category, instance.mask.sum()) for instance in instances] == [
        (0, "chair", 36 + 48),
        (0, "chair", 20),
    ]
    assert any("read as objects" in warning for warning in warnings)


def test_pictures_whose_values_are_categories(tmp_path: Path) -> None:
    values = np.zeros((30, 40), dtype=np.uint8)
    values[2:12, 2:12], values[2:8, 30:38], values[20, 20] = 1, 1, 1  # two chairs and a speck
    values[20:25, 5:9] = 2
    pictures(tmp_path, {"1": "chair", "2": "cup"}, a=values)
    instances, warnings = read_instances_and_warnings(scene_of(tmp_path, "a.jpg"))
    assert [(instance.category, instance.mask.sum()) for instance in instances] == [
        ("chair", 100),
        ("chair", 48),
        ("cup", 20),
    ]
    assert any("read as categories" in warning for warning in warnings)


def test_pictures_of_three_channels_are_refused(tmp_path: Path) -> None:
    pictures(tmp_path, {"1": "chair"}, a=np.ones((30, 40, 3), dtype=np.uint8))
    with pytest.raises(InputError, match="channels: expected 1"):
        read_instances(None, scene_of(tmp_path, "a.jpg"))


def test_values_of_an_image_with_a_palette_are_its_indices(tmp_path: Path) -> None:
    values = np.zeros((30, 40), dtype=np.uint8)
    values[2:8, 2:8] = 3
    pictures(tmp_path, {"3": "chair", "0": "wall"})
    image = Image.fromarray(values).convert("P")
    image.putdata(values.ravel().tolist())
    image.save(tmp_path / "instances" / "a.jpg.png")
    instances = read_instances(None, scene_of(tmp_path, "a.jpg"))
    assert {instance.category: int(instance.mask.sum()) for instance in instances} == {"chair": 36, "wall": 1200 - 36}


@pytest.mark.parametrize(("area", "count"), [(1, 1), (2, 2)])
def test_parts_below_two_percent_of_the_largest_are_noise(tmp_path: Path, area: int, count: int) -> None:
    values = np.zeros((30, 40), dtype=np.uint8)
    values[2:12, 2:10], values[20, 20 : 20 + area] = 1, 1
    pictures(tmp_path, {"1": "chair", "2": "cup"}, a=values)
    assert len(read_instances(None, scene_of(tmp_path, "a.jpg"))) == count


@pytest.mark.parametrize(("width", "accepted"), [(44, True), (45, False)])
def test_masks_may_differ_by_a_tenth_in_their_aspect_ratio(width: int, accepted: bool) -> None:
    camera = Camera("PINHOLE", 40, 30, np.array([40.0, 40, 20, 15]))
    if accepted:
        assert mask_crop(np.ones((30, width), dtype=bool), camera) is not None
    else:
        with pytest.raises(FieldError, match="mask size"):
            mask_crop(np.ones((30, width), dtype=bool), camera)


def test_a_stated_folder_of_images_comes_first_and_exists(tmp_path: Path) -> None:
    scene = Scene(tmp_path / "scene", "memory", (), np.empty((0, 3)))
    usual, stated = tmp_path / "scene" / "images", tmp_path / "elsewhere"
    usual.mkdir(parents=True)
    stated.mkdir()
    itself = scene.path.resolve()
    assert image_folders(scene) == (usual.resolve(), itself)
    assert image_folders(scene, stated) == (stated.resolve(), usual.resolve(), itself)
    with pytest.raises(InputError, match="--images: expected a folder, found nothing"):
        image_folders(scene, tmp_path / "nowhere")


@pytest.mark.parametrize(("right", "is_inside"), [(41.1, True), (41.3, False)])
def test_boxes_of_a_detector_may_exceed_their_image_by_three_percent(
    right: float, is_inside: bool, tmp_path: Path
) -> None:
    """An image of 40 pixels; of several boxes two are beyond it."""
    scene = scene_of(tmp_path, "a.png")
    written(tmp_path, dataset([{"bbox": [30, 2, right - 30, 9]} for _ in range(2)], "a.png"))
    with nullcontext() if is_inside else pytest.raises(InputError, match="2 of 2 beyond it"):
        read_instances_and_warnings(scene)


@pytest.mark.parametrize(("n_boxes", "is_refused"), [(20, False), (19, True)])
def test_a_tenth_of_the_boxes_may_exceed_their_images(n_boxes: int, is_refused: bool, tmp_path: Path) -> None:
    scene = scene_of(tmp_path, "a.png")
    boxes = [{"bbox": [30, 2, 20 if k < 2 else 5, 9]} for k in range(n_boxes)]
    written(tmp_path, dataset(boxes, "a.png"))
    with pytest.raises(InputError, match="2 of 19 beyond it") if is_refused else nullcontext():
        read_instances_and_warnings(scene)


@pytest.mark.parametrize(("width", "is_reported"), [(407, False), (409, True)])
def test_another_shape_than_the_cameras_is_reported_from_two_percent(
    width: int, is_reported: bool, tmp_path: Path
) -> None:
    scene = scene_of(tmp_path, "a.png")  # 40 x 30 pixels
    written(tmp_path, dataset([{"bbox": [1, 1, 9, 9]}], "a.png", size=(width, 300)))
    warnings = read_instances_and_warnings(scene)[1]
    assert any("another shape" in warning for warning in warnings) == is_reported


@pytest.mark.parametrize(("half", "is_read"), [(999_000, True), (1_001_000, False)])
def test_an_outline_has_at_most_two_million_pixels(half: int, is_read: bool) -> None:
    """A polygon of no height, which is read as an empty mask."""
    side = 40_000
    there_and_back = [0, 0, side, 0] * (half // side) + [0, 0, half % side, 0]
    with nullcontext() if is_read else pytest.raises(FieldError, match="at most 2000000 pixels"):
        assert not decode_segmentation([there_and_back], (side, 2)).any()


@pytest.mark.parametrize(
    ("n_masks", "shape", "message"),
    [
        (10_000, (1, 1), None),
        (10_001, (1, 1), "at most 10,000 of an image"),
        (2, (1 << 16, 1 << 15), None),
        (3, (1 << 16, 1 << 15), "at most 4,294,967,296 pixels in all"),
    ],
)
def test_an_image_has_10000_masks_and_a_scene_four_gibibytes(
    n_masks: int, shape: tuple[int, int], message: str | None
) -> None:
    """A view of one byte has the size of a mask."""
    mask = Instance("1", 0, "chair", np.broadcast_to(np.array(True), shape), (0, 0))
    with nullcontext() if message is None else pytest.raises(FieldError, match=message):
        assert sum(1 for _ in view_matching.within_limits([mask] * n_masks)) == n_masks


@pytest.mark.parametrize(("height", "field"), [(256, "parts"), (304, "values")])
def test_values_of_an_image_of_categories_are_compared_with_four_billion_pixels(
    height: int, field: str, tmp_path: Path
) -> None:
    """MAX_COMPARED: 55,536 values times 65,536 pixels, and times 77,824; the first value has too many parts in both."""
    values = np.zeros((height, 256), dtype=np.uint16)
    is_background = np.zeros((height, 256), dtype=bool)
    is_background[:256:2, ::2].flat[:10_001] = True
    values[:256][~is_background[:256]] = np.arange(1, 65_536 - 10_001 + 1)
    values[256:] = 1
    scene = scene_of(tmp_path, "a.png", width=256, height=height)
    (tmp_path / "instances").mkdir()
    names = {str(value): str(value) for value in range(65_536)}
    (tmp_path / "instances" / "categories.json").write_text(json.dumps(names), encoding="utf-8")
    Image.fromarray(values).save(tmp_path / "instances" / "a.png.png")
    with pytest.raises(InputError, match=f"{field}: expected at most"):
        read_instances_and_warnings(scene, tmp_path / "instances")


@pytest.mark.parametrize(
    ("key", "is_read"), [("65535", True), ("0000000001", True), ("65536", False), ("00000000001", False)]
)
def test_a_pixel_value_has_16_bits_and_ten_digits(key: str, is_read: bool, tmp_path: Path) -> None:
    scene = scene_of(tmp_path, "a.png", width=8, height=8)
    (tmp_path / "instances").mkdir()
    (tmp_path / "instances" / "categories.json").write_text(json.dumps({key: "chair"}), encoding="utf-8")
    Image.fromarray(np.full((8, 8), int(key) % 65_536, dtype=np.uint16)).save(tmp_path / "instances" / "a.png.png")
    with nullcontext() if is_read else pytest.raises(InputError, match="value: expected a pixel value from 0 to 65535"):
        assert len(read_instances_and_warnings(scene, tmp_path / "instances")[0]) == 1

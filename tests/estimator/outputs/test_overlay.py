"""Overlays: boxes where the camera sees them, sizes in words, and files whole or not at all."""

from __future__ import annotations

import math
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from estimator.outputs.overlay import UNUSED, overlay, projected_edges, write_overlays
from estimator.outputs.size_labels import dimension_labels, size_interval
from estimator.records.objects import EDGES, Box, corners, edge_axis
from estimator.records.result import SceneEstimate
from metric_base.errors import InputError
from tests.support.drawn import SCALE, drawn_estimate
from tests.synthetic.small_scene import write_small_scene

GREY = 90


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small scene with a grey image for all but one of its views."""
    place = tmp_path_factory.mktemp("overlay") / "whole"
    write_small_scene(place)
    (place / "colmap" / "images").mkdir()
    for number, view in enumerate(drawn_estimate(place / "colmap").scene.views):
        if number:
            cv2.imwrite(str(place / "colmap" / "images" / view.name), np.full((240, 320, 3), GREY, dtype=np.uint8))
    return place / "colmap"


@pytest.fixture(scope="module")
def estimate(folder: Path) -> SceneEstimate:
    return drawn_estimate(folder)


def test_edges_differ_in_one_axis_each() -> None:
    box = Box(np.array([1.0, 2.0, 3.0]), np.eye(3)[[1, 2, 0]], np.array([0.6, 0.4, 0.8]))
    assert len({tuple(sorted(edge)) for edge in EDGES.tolist()}) == 12
    for number, (a, b) in enumerate(EDGES):
        step = corners(box)[b] - corners(box)[a]
        axis = edge_axis(number)
        np.testing.assert_allclose(step, box.axes[axis] * box.extents[axis], atol=1e-12)
    np.testing.assert_allclose(corners(box).mean(axis=0), box.centre)


def test_edges_project_as_points_do(estimate: SceneEstimate) -> None:
    view = estimate.scene.views[2]
    box = Box(np.zeros(3), np.eye(3), np.array([0.6, 0.4, 0.8]))
    lines = projected_edges(box, view)
    middle = np.array([corners(box)[edge].mean(axis=0) for edge in EDGES])
    x, y, z = (middle @ view.rotation.T + view.translation).T
    f, cx, cy, k = view.camera.params
    u, v = x / z, y / z
    factor = f * (1 + k * (u**2 + v**2))
    np.testing.assert_allclose(lines[:, lines.shape[1] // 2], np.column_stack([u * factor + cx, v * factor + cy]))


def test_a_box_behind_the_camera_is_not_drawn(estimate: SceneEstimate) -> None:
    view = estimate.scene.views[2]
    behind = Box(view.centre - 5 * view.rotation[2], np.eye(3), np.ones(3))
    assert np.isnan(projected_edges(behind, view)).all()


def test_sizes_in_words(estimate: SceneEstimate) -> None:
    assert estimate.measurements is not None
    chair, table = estimate.measurements.objects
    report, other = estimate.result.objects
    length, width, height = dimension_labels(chair, report, estimate.result, {"height": 0.41})
    assert length.text.startswith("l E 0.30 [")
    assert (length.is_used, width.is_used, height.is_used) == (True, False, True)
    assert width.text == "w E >0.20", "cut, and so no interval"
    assert height.text.endswith("G 0.41")
    assert dimension_labels(chair, report, estimate.result, {})[0].text.startswith("l 0.30 [")
    assert not any(label.is_used for label in dimension_labels(table, other, estimate.result, {}))


def test_the_interval_of_a_size_joins_scale_and_measurement(estimate: SceneEstimate) -> None:
    low, high = size_interval(2.0, 0.0, estimate.result)
    assert (low, high) == pytest.approx((2 * 0.4, 2 * 0.6)), "an exact size has the scale's interval"
    wide_low, wide_high = size_interval(2.0, 0.1, estimate.result)
    expected = math.hypot(math.log(SCALE / 0.4), 1.6449 * 0.1)
    assert wide_low == pytest.approx(2 * SCALE * math.exp(-expected), rel=1e-4)
    assert wide_high > high


def test_a_frame_is_enlarged_and_drawn_upon(estimate: SceneEstimate) -> None:
    picture = np.full((240, 320, 3), GREY, dtype=np.uint8)
    drawn = overlay(estimate, 1, picture)
    assert drawn.shape == (1228, 1600, 3)
    assert (drawn == UNUSED).all(axis=2).sum() > 300, "the outlier's sizes are red"
    assert (np.abs(drawn.astype(int) - GREY) <= 2).all(axis=2).mean() > 0.5, "most of the picture is still there"
    bare = overlay(replace(estimate, measurements=None), 1, picture)
    assert (np.abs(bare.astype(int) - GREY) <= 2).all()


def test_only_objects_with_a_mask_in_the_frame_are_drawn(estimate: SceneEstimate) -> None:
    assert estimate.measurements is not None
    elsewhere = tuple(replace(item, members=item.members[-1:]) for item in estimate.measurements.objects)
    seen_once = replace(estimate, measurements=replace(estimate.measurements, objects=elsewhere))
    picture = np.full((240, 320, 3), GREY, dtype=np.uint8)
    assert (np.abs(overlay(seen_once, 1, picture).astype(int) - GREY) <= 2).all()


def test_every_frame_with_a_picture_is_written(estimate: SceneEstimate, tmp_path: Path) -> None:
    target = tmp_path / "deep" / "overlay"
    assert write_overlays(estimate, target) == 7
    assert sorted(file.name for file in target.iterdir()) == sorted(view.name for view in estimate.scene.views[1:])
    assert [path.name for path in target.parent.iterdir()] == ["overlay"]
    with pytest.raises(InputError, match="a folder that is not there yet"):
        write_overlays(estimate, target)


def test_a_scene_without_pictures_is_one_line(folder: Path, tmp_path: Path) -> None:
    for file in folder.glob("*"):
        if file.is_file():
            (tmp_path / file.name).write_bytes(file.read_bytes())
    with pytest.raises(InputError, match="--overlay: expected the images of the views"):
        write_overlays(drawn_estimate(tmp_path), tmp_path / "overlay")
    assert not (tmp_path / "overlay").exists()


def test_an_unreadable_picture_is_one_line_and_leaves_nothing(folder: Path, tmp_path: Path) -> None:
    scene = shutil.copytree(folder, tmp_path / "scene")
    picture = max((scene / "images").rglob("*.*"))
    picture.write_bytes(picture.read_bytes()[:20])
    with pytest.raises(InputError, match=f"{picture.name}: image: expected an image that OpenCV reads"):
        write_overlays(drawn_estimate(scene), tmp_path / "overlay")
    assert [path.name for path in tmp_path.iterdir()] == ["scene"]


def test_an_unknown_size_has_no_label_and_an_unresolved_one_no_interval(estimate: SceneEstimate) -> None:
    assert estimate.measurements is not None
    item, report = estimate.measurements.objects[0], estimate.result.objects[0]
    unknown = replace(item, extents=np.array([1.0, np.nan, 2.0]))
    assert [label.axis for label in dimension_labels(unknown, report, estimate.result, {})] == [0, 2]
    unresolved = replace(estimate.result, scale=None, interval=None)
    assert len(dimension_labels(item, report, unresolved, {})) == 3
    assert dimension_labels(item, report, replace(unresolved, modes=()), {}) == ()
    with pytest.raises(ValueError, match="a resolved result"):
        size_interval(1.0, 0.1, unresolved)

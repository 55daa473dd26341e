"""The geometry on a real office. No constant was tuned on it."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from sklearn.metrics import adjusted_rand_score

from estimator.instances.instance_reader import read_instances
from estimator.pipeline import measure_objects
from estimator.reconstructions.scene_reader import read_scene
from estimator.records.objects import Measurements
from estimator.records.options import PAPER, MeasurementOptions
from estimator.records.scene import Instance

pytestmark = pytest.mark.real_data


@pytest.fixture(scope="module")
def office(shared: Path):
    folder = shared / "data/scenes/tum_office"
    if not folder.is_dir():
        pytest.skip(f"{folder} does not exist")
    scene = read_scene(folder)
    instances = read_instances(folder / "instances.json", scene)
    truth = json.loads((folder / "truth.json").read_text())
    return scene, instances, truth


@pytest.fixture(scope="module")
def measured(office) -> Measurements:
    scene, instances, _ = office
    return measure_objects(scene, instances)


def owner(instances: list[Instance], members: tuple[int, ...]) -> str:
    return Counter(str(instances[row].track) for row in members).most_common(1)[0][0]


def metres(measured: Measurements, office, name: str) -> np.ndarray:
    _, instances, truth = office
    track_id = next(str(entry["track_id"]) for entry in truth["objects"] if entry["track_name"] == name)
    items = [item for item in measured.objects if owner(instances, item.members) == track_id]
    return max(items, key=lambda item: item.points).extents * truth["metres_per_unit"]


def test_tracks_agree_with_the_annotated_ones(measured, office):
    _, instances, _ = office
    track_of = np.zeros(len(instances), dtype=int)
    for index, track in enumerate(measured.tracks):
        track_of[list(track.members)] = index
        views = [instances[row].view for row in track.members]
        assert len(set(views)) == len(views)
    assert adjusted_rand_score([instance.track for instance in instances], track_of) > 0.95


def test_up_is_within_three_sigma_and_floor_and_desk_are_found(measured, office):
    _, _, truth = office
    up = np.array(truth["up_in_scene"]) / np.linalg.norm(truth["up_in_scene"])
    error_deg = np.degrees(np.arccos(up @ measured.up.vector))
    assert error_deg < 3 * measured.up.sigma_deg
    floor = np.array(truth["floor_point_in_scene"]) @ measured.up.vector
    heights = [(plane.height - floor) * truth["metres_per_unit"] for plane in measured.planes]
    assert any(abs(height) < 0.05 for height in heights)
    assert any(abs(height - 0.716) < 0.05 for height in heights)


@pytest.mark.parametrize(
    ("name", "dimension", "truth", "within"),
    [
        ("dice", 0, 0.155, 0.1),
        ("dice", 2, 0.155, 0.1),
        ("magazine", 0, 0.290, 0.08),
        ("magazine", 1, 0.204, 0.08),
        ("bottle_B", 2, 0.294, 0.08),
        ("bottle_green", 2, 0.342, 0.08),
        ("box_on_desk", 0, 0.985, 0.12),
        ("box_on_desk", 2, 0.433, 0.08),
        ("book_striped", 0, 0.239, 0.08),
        ("chair_wood", 2, 0.860, 0.1),
        ("chair_purple", 2, 0.950, 0.1),
        ("desk_right", 2, 0.716, 0.15),
        ("desk_left", 2, 0.716, 0.15),
    ],
)
def test_sizes_of_completely_visible_objects_are_true(measured, office, name, dimension, truth, within):
    assert abs(np.log(metres(measured, office, name)[dimension] / truth)) < within


def test_desk_with_a_mask_of_its_top_only_is_measured_from_the_floor(office, measured):
    scene, instances, _ = office
    unsupported = measure_objects(scene, instances, MeasurementOptions(supports=False))
    assert metres(unsupported, office, "desk_left")[2] < 0.3 * metres(measured, office, "desk_left")[2]


def test_height_of_a_poster_on_a_wall_is_true(measured, office):
    assert abs(np.log(metres(measured, office, "poster")[2] / 0.418)) < 0.08


def test_most_objects_are_measured_from_sparse_points_and_by_the_papers_method(office):
    scene, instances, _ = office
    sparse = measure_objects(scene, instances, MeasurementOptions(dense=False))
    assert sum(item.skipped is None for item in sparse.objects) >= 20
    paper = measure_objects(scene, [item for item in instances if item.category in {"bottle", "dice"}], PAPER)
    assert sum(item.skipped is None for item in paper.objects) >= 5


def test_heights_of_bottles_from_detected_boxes_are_plausible(office, shared):
    scene, _, truth = office
    folder = shared / "data/scenes/tum_office"
    boxes = read_instances(folder / "detections_yolo.json", scene, folder / "detections_yolo_categories.json")
    assert all(box.from_box for box in boxes)
    objects = measure_objects(scene, boxes).objects
    heights = [
        item.extents[2] * truth["metres_per_unit"]
        for item in objects
        if item.category == "bottle" and item.skipped is None and item.views >= 5
    ]
    assert heights
    assert all(0.2 < height < 0.45 for height in heights)
    assert all(item.skipped for item in objects if item.views < 3)

"""The geometry on the real office: that it works there. No constant was chosen on it."""

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
        pytest.skip(f"no real office at {folder}")
    scene = read_scene(folder)
    instances = read_instances(folder / "instances.json", scene)
    truth = json.loads((folder / "truth.json").read_text())
    return scene, instances, truth


@pytest.fixture(scope="module")
def found(office) -> Measurements:
    scene, instances, _ = office
    return measure_objects(scene, instances)


def owner(instances: list[Instance], members: tuple[int, ...]) -> str:
    return Counter(str(instances[row].track) for row in members).most_common(1)[0][0]


def metres(found: Measurements, office, name: str) -> np.ndarray:
    _, instances, truth = office
    number = next(str(one["track_id"]) for one in truth["objects"] if one["track_name"] == name)
    items = [one for one in found.objects if owner(instances, one.members) == number]
    return max(items, key=lambda one: one.points).extents * truth["metres_per_unit"]


def test_tracks_are_the_annotators(found, office):
    _, instances, _ = office
    given = np.zeros(len(instances), dtype=int)
    for number, track in enumerate(found.tracks):
        given[list(track.members)] = number
        views = [instances[row].view for row in track.members]
        assert len(set(views)) == len(views)
    assert adjusted_rand_score([instance.track for instance in instances], given) > 0.95


def test_up_and_the_two_planes(found, office):
    _, _, truth = office
    up = np.array(truth["up_in_scene"]) / np.linalg.norm(truth["up_in_scene"])
    off = np.degrees(np.arccos(up @ found.up.vector))
    assert off < 3 * found.up.sigma_deg
    floor = np.array(truth["floor_point_in_scene"]) @ found.up.vector
    heights = [(plane.height - floor) * truth["metres_per_unit"] for plane in found.planes]
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
def test_sizes_of_plain_objects(found, office, name, dimension, truth, within):
    assert abs(np.log(metres(found, office, name)[dimension] / truth)) < within


def test_desks_of_which_only_the_slab_is_masked_reach_the_floor(office, found):
    scene, instances, _ = office
    bare = measure_objects(scene, instances, MeasurementOptions(supports=False))
    assert metres(bare, office, "desk_left")[2] < 0.3 * metres(found, office, "desk_left")[2]


def test_the_poster_stays_on_its_wall(found, office):
    assert abs(np.log(metres(found, office, "poster")[2] / 0.418)) < 0.08


def test_sparse_points_and_the_papers_arm_run(office):
    scene, instances, _ = office
    without = measure_objects(scene, instances, MeasurementOptions(dense=False))
    assert sum(one.skipped is None for one in without.objects) >= 20
    paper = measure_objects(scene, [one for one in instances if one.category in {"bottle", "dice"}], PAPER)
    assert sum(one.skipped is None for one in paper.objects) >= 5


def test_raw_boxes_run(office, shared):
    scene, _, truth = office
    folder = shared / "data/scenes/tum_office"
    boxes = read_instances(folder / "detections_yolo.json", scene, folder / "detections_yolo_categories.json")
    assert all(one.from_box for one in boxes)
    found = measure_objects(scene, boxes)
    heights = [
        one.extents[2] * truth["metres_per_unit"]
        for one in found.objects
        if one.category == "bottle" and one.skipped is None and one.views >= 5
    ]
    assert heights
    assert all(0.2 < height < 0.45 for height in heights)
    assert all(one.skipped for one in found.objects if one.views < 3)

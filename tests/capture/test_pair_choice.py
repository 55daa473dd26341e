"""Which frames are matched: all of up to 150; of more, neighbours in order and candidates for a loop."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from capture.mapping.features import MAIN
from capture.mapping.incremental import verify_with_camera
from capture.mapping.pairs import all_pairs, chosen_pairs, coarse_scores
from estimator.reconstructions.pycolmap_library import pycolmap


def test_up_to_150_frames_are_matched_each_with_each() -> None:
    assert MAIN.exhaustive == 150
    assert len(all_pairs(MAIN.exhaustive)) == 150 * 149 // 2
    assert set(all_pairs(4)) == {(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)}


def test_more_frames_are_matched_as_colmap_matches_a_sequence(tmp_path: Path) -> None:
    """Held to COLMAP's own list of pairs for an overlap of ten, quadratic."""
    n = 130
    with pycolmap.Database.open(str(tmp_path / "d.db")) as database:
        camera = database.write_camera(pycolmap.Camera(model="SIMPLE_PINHOLE", width=9, height=9, params=[9, 4, 4]))
        ids = [database.write_image(pycolmap.Image(name=f"{k:03d}.jpg", camera_id=camera)) for k in range(n)]
        pycolmap.logging.minloglevel = 1
        options = pycolmap.SequentialPairingOptions(overlap=10, quadratic_overlap=True)
        of_colmap = pycolmap.SequentialPairGenerator(options, database).all_pairs()
    pairs = chosen_pairs(np.zeros((n, n), dtype=np.int64), in_order=True)
    assert {tuple(sorted((ids.index(a), ids.index(b)))) for a, b in of_colmap} == set(pairs)
    assert len(pairs) == len(set(pairs)) == sum(n - (1 << k) for k in range(8))


def test_a_loop_is_tried_where_frames_far_apart_agree() -> None:
    """A camera that returns: the last frames show the content of the first ones."""
    generator = np.random.default_rng(3)
    n, places = 130, 125
    of_place = generator.normal(size=(places, 40, 128)).astype(np.float32)
    frames = [of_place[k % places] + generator.normal(0, 0.05, (40, 128)).astype(np.float32) for k in range(n)]
    units = [frame / np.linalg.norm(frame, axis=1, keepdims=True) for frame in frames]
    scores = coarse_scores(units)
    assert scores[0, places] > 30
    assert scores[0, 60] < 4
    without = set(chosen_pairs(np.zeros((n, n), dtype=np.int64), in_order=True))
    assert set(chosen_pairs(scores, in_order=True)) - without == {(k, k + places) for k in range(n - places)}
    # at most six partners, four frames apart, are tried for a frame that looks like all others
    alike = set(chosen_pairs(np.full((n, n), 100, dtype=np.int64), in_order=True)) - without
    assert 0 < len(alike) <= 6 * n


def test_pictures_in_any_order_are_matched_with_those_that_look_alike() -> None:
    n = 110
    scores = np.zeros((n, n), dtype=np.int64)
    scores[7, 90:] = scores[90:, 7] = 40
    of_seven = {pair for pair in chosen_pairs(scores, in_order=False) if 7 in pair}
    assert {(7, k) for k in range(90, 108)} <= of_seven  # eighteen at most, next to each other or not
    assert (7, 109) in of_seven  # the seventh of the last is this one, too


def test_pictures_whose_names_hold_spaces_are_verified(tmp_path: Path) -> None:
    """COLMAP's lists part two names by a space: `IMG 7 (1).jpg` was two names, and no pair of a telephone's passed."""
    options = pycolmap.SyntheticDatasetOptions(num_rigs=1, num_cameras_per_rig=1, num_frames_per_rig=4)
    file = str(tmp_path / "matches.db")
    with pycolmap.Database.open(file) as database:
        model = pycolmap.synthesize_dataset(options, database)
        for image in database.read_all_images():
            image.name = f"IMG {image.image_id} (1) – Kopie.jpg"
            database.update_image(image)
        names = sorted(image.name for image in database.read_all_images())
        inliers = database.num_inlier_matches()
    (camera,) = model.cameras.values()
    lens = {"model": camera.model.name, "params": list(camera.params), "held": True}
    verify_with_camera(Path(file), lens)
    with pycolmap.Database.open(file) as database:
        assert database.num_inlier_matches() > 0.9 * inliers > 0
        assert sorted(image.name for image in database.read_all_images()) == names
    assert not list(tmp_path.glob("*.txt"))


@pytest.mark.parametrize(("ratio", "is_match"), [(0.79, True), (0.81, False)])
def test_a_feature_matches_the_nearest_if_the_second_is_farther_by_a_quarter(ratio: float, is_match: bool) -> None:
    """Unit vectors in a plane at these angles: the nearest at 0.1 radian, the second at 0.1 / ratio."""

    def at(*angles: float) -> NDArray[np.float32]:
        return np.array([[np.cos(angle), np.sin(angle)] for angle in angles], dtype=np.float32)

    scores = coarse_scores([at(0.0, 2.0), at(0.1, -0.1 / ratio)])
    assert bool(scores[0, 1]) == is_match


@pytest.mark.parametrize(("n_first", "n_second", "score"), [(2, 2, 2), (1, 2, 0), (2, 1, 0), (0, 2, 0), (0, 0, 0)])
def test_frames_with_a_single_feature_match_nothing(n_first: int, n_second: int, score: int) -> None:
    features = np.eye(128, dtype=np.float32)
    assert coarse_scores([features[:n_first], features[:n_second]]).tolist() == [[0, score], [score, 0]]


@pytest.mark.parametrize(("ratio", "score"), [(0.78, 2), (0.82, 1)])
def test_a_match_is_nearer_than_the_next_by_a_fifth(ratio: float, score: int) -> None:
    """MAX_RATIO of the angles to the nearest and the next feature of the other frame; one match is exact."""
    angle = np.radians(20)
    plane = np.array([[1.0, 0], [np.cos(angle), np.sin(angle)]])
    between = ratio * angle / (1 + ratio)
    turned = np.array([[np.cos(between), np.sin(between)]])
    first, second = np.zeros((2, 128), dtype=np.float32), np.zeros((3, 128), dtype=np.float32)
    first[0, :2], first[1, 5] = turned[0], 1
    second[:2, :2], second[2, 5] = plane, 1
    assert coarse_scores([first, second])[0, 1] == score


@pytest.mark.parametrize(("n", "score"), [(400, 2), (401, 0)])
def test_every_frame_of_up_to_400_is_compared(n: int, score: int) -> None:
    """MAX_COMPARED: of more frames, every second one is; the others have no features here."""
    empty = np.empty((0, 128), dtype=np.float32)
    features = np.eye(128, dtype=np.float32)[:2]
    assert coarse_scores([features, features, *[empty] * (n - 2)])[0, 1] == score


@pytest.mark.parametrize(("n_common", "is_tried"), [(3, False), (4, True)])
def test_candidates_of_a_loop_have_four_common_features(n_common: int, is_tried: bool) -> None:
    scores = np.zeros((60, 60), dtype=np.int64)
    scores[0, 50] = scores[50, 0] = n_common
    assert ((0, 50) in chosen_pairs(scores, in_order=True)) == is_tried
    assert ((0, 50) in chosen_pairs(scores, in_order=False)) == is_tried

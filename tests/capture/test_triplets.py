"""Frames taken three at a time: they agree with a right model and contradict one with a wrong piece."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from capture.mapping.incremental import finish
from capture.mapping.triplets import (
    MAX_PART_RATIO,
    MAX_RESIDUAL_PX,
    Triplet,
    TripletAgreement,
    agreement,
    broken_frames,
    model_triplets,
    triplet_residuals,
    triplet_stretch,
)
from estimator.reconstructions.pycolmap_library import pycolmap
from tests.synthetic.wrong_pieces import move_frames


@pytest.fixture
def made(tmp_path: Path) -> tuple[Any, str]:
    """A model of ten frames and the database of its exact matches."""
    options = pycolmap.SyntheticDatasetOptions(num_rigs=10, num_cameras_per_rig=1, num_frames_per_rig=1)
    options.num_points3D = 200
    pycolmap.set_random_seed(0)
    file = str(tmp_path / "matches.db")
    with pycolmap.Database.open(file) as database:
        return pycolmap.synthesize_dataset(options, database), file


def test_a_right_model_is_one_piece(made: tuple[Any, str]) -> None:
    model, file = made
    agreed = agreement(model_triplets(model, file))
    assert agreed.triplets >= 10
    assert (agreed.contradicted, len(agreed.parts), len(agreed.parts[0])) == (0, 1, 10)


@pytest.mark.parametrize(
    ("turn_deg", "shift", "factor", "right"),
    [(0.0, 0.5, 1.0, 7), (4.0, 0.0, 1.0, 7), (0.0, 0.0, 1.3, 8)],  # the frame that it grows about stays right
    ids=["moved", "turned", "grown"],
)
def test_a_wrong_piece_is_taken_out(
    made: tuple[Any, str], turn_deg: float, shift: float, factor: float, right: int
) -> None:
    model, file = made
    names = sorted(image.name for image in model.images.values())
    move_frames(model, set(names[7:]), Rotation.from_euler("y", turn_deg, degrees=True).as_matrix(), shift, factor)
    agreed = agreement(model_triplets(model, file))
    assert agreed.parts[0] == tuple(names[:right])
    assert agreed.loose == tuple(names[right:])
    output = Path(file).parent / "models"
    (output / "0").mkdir(parents=True)
    model.write_binary(str(output / "0"))
    shutil.copyfile(file, output / "0.db")
    measured = finish({"output": str(output), "images": str(output), "fixed": False, "free": False})
    assert list(measured["model"]["names"]) == names[:right]
    assert list(measured["model"]["pieces"]) == [len(part) for part in agreed.parts]
    assert measured["model"]["focal_deviation"] is not None
    kept = pycolmap.Reconstruction(measured["folder"])
    assert sorted(image.name for image in kept.images.values()) == names[:right]


def test_pieces_are_joined_by_two_frames_and_not_by_one() -> None:
    def fitting(*names: str) -> Triplet:
        return Triplet((names[0], names[1], names[2]), 20, 0.5)

    chain = [fitting(*"abc"), fitting(*"bcd"), fitting(*"def"), fitting(*"efg")]
    assert agreement(chain).parts == (("a", "b", "c", "d"), ("d", "e", "f", "g"))
    assert len(agreement([*chain, fitting(*"cde")]).parts) == 1
    against = agreement([*chain, Triplet(("c", "d", "e"), 20, MAX_RESIDUAL_PX + 1)])
    assert (against.contradicted, against.loose, len(against.parts)) == (0, ("e", "f", "g"), 2)
    inside = agreement([*chain, Triplet(("b", "c", "d"), 20, MAX_RESIDUAL_PX + 1)])
    assert (inside.contradicted, inside.triplets) == (1, 3)
    assert agreement([]).parts == ()


@pytest.mark.parametrize(("factor", "shown"), [(1.0, 0.0), (1.3, np.log(1.3)), (0.8, np.log(0.8))])
def test_a_step_that_is_too_long_straight_ahead_is_seen_by_the_depths(factor: float, shown: float) -> None:
    generator = np.random.default_rng(0)
    points = generator.uniform([-3, -2, 6], [3, 2, 12], (60, 3))
    poses = np.tile(np.eye(3, 4), (3, 1, 1))
    poses[:, 2, 3] = [0, -1, -2]
    seen = points[:, None] + poses[:, :, 3]
    rays = seen / np.linalg.norm(seen, axis=2, keepdims=True) + generator.normal(0, 1e-4, seen.shape)
    poses[2, 2, 3] = -1 - factor
    stretch, noise = triplet_stretch(poses, rays / np.linalg.norm(rays, axis=2, keepdims=True), np.radians(0.8))
    assert stretch == pytest.approx(shown, abs=0.01)
    assert 0 < noise < 0.1
    assert triplet_stretch(poses, rays[:5], np.radians(0.8)) == (0, np.inf)  # too few


def test_a_frame_is_broken_where_most_of_what_would_show_it_does() -> None:
    def about(middle: str, stretch: float, noise: float) -> Triplet:
        return Triplet(("a", middle, "z"), 20, 0.5, stretch, noise)

    sure = [about("m", 0.0, 0.05), about("m", 0.9, 0.05), about("m", -0.9, 0.3), about("n", 0.0, 0.05)]
    silent = [about(middle, 0.0, np.inf) for middle in "mno" for _ in range(9)]
    assert broken_frames(sure + silent) == ("m",)
    assert broken_frames([*sure, about("m", 0.0, 0.02)]) == ()  # two against two
    # removing a separate piece does not break the others
    held = [Triplet(("a", "b", "c"), 20, 0.5), Triplet(("b", "c", "d"), 20, 0.5)]
    assert agreement([*held, Triplet(("b", "c", "d"), 20, 0.5, 0.9, 0.1)]).broken == ("c",)
    assert agreement([*held, Triplet(("b", "c", "e"), 20, 0.5, 0.9, 0.1)]).broken == ()


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.5, 1e6))
def test_exact_rays_leave_nothing_at_any_distance(seed: int, distance: float) -> None:
    generator = np.random.default_rng(seed)
    rotations = Rotation.from_rotvec(generator.normal(0, 0.2, (3, 3))).as_matrix()
    poses = np.concatenate([rotations, generator.normal(0, 0.1, (3, 3, 1))], axis=2)
    points = generator.normal(0, 0.2, (12, 3)) * distance + [0, 0, 2 * distance]
    seen = np.einsum("kij,nj->nki", poses[:, :, :3], points) + poses[:, :, 3]
    rays = seen / np.linalg.norm(seen, axis=2, keepdims=True)
    assert triplet_residuals(poses, rays).max() < 1e-6
    turned = poses.copy()
    turned[2, :, :3] = Rotation.from_euler("x", 5, degrees=True).as_matrix() @ turned[2, :, :3]
    assert np.median(triplet_residuals(turned, rays)) > 1e-3
    assert triplet_residuals(poses, rays[:0]).shape == (0,)


@pytest.mark.parametrize(("second", "is_split"), [(5, False), (6, True)])
def test_a_second_part_of_more_than_half_the_first_splits_a_model(second: int, is_split: bool) -> None:
    first = tuple("abcdefghij")
    assert TripletAgreement(parts=(first, first[:second])).is_split == is_split
    assert MAX_PART_RATIO * len(first) == 5


@pytest.mark.parametrize(
    ("changes", "fits", "compares"),
    [
        ({"residual_px": 2.4}, True, True),  # MAX_RESIDUAL_PX of 2.5
        ({"residual_px": 2.6}, False, True),
        ({"stretch": -0.09}, True, True),  # MAX_STRETCH of 0.1
        ({"stretch": -0.11}, False, True),
        ({"stretch": 0.11, "noise": 1.0}, False, True),
        ({"noise": 0.09}, True, True),
        ({"noise": 0.11}, True, False),
    ],
)
def test_both_sides_of_the_limits_of_a_triplet(changes: dict[str, float], fits: bool, compares: bool) -> None:
    triplet = replace(Triplet(("a", "b", "c"), 20, 0.5, 0.0, 0.05), **changes)
    assert (triplet.fits, triplet.compares_size) == (fits, compares)

"""Masks that are of the model's views agree; masks of other frames rule themselves out."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_array

from estimator.association.mask_checks import (
    MaskAgreement,
    mask_agreement,
    mask_contradictions,
    rim_warnings,
    track_agreement,
    track_contradictions,
)
from estimator.association.point_labels import PointLabels, sparse_labels
from estimator.pipeline import measure_objects
from estimator.records.scene import Instance
from tests.synthetic.shapes import box, floor, orbit, synthetic_scene


@pytest.fixture(scope="module")
def synthetic():
    objects = [
        floor(6),
        box("cabinet", (0.6, 0.4, 0.8), (-0.9, 0, 0)),
        box("chair", (0.5, 0.5, 0.9), (0.9, 0.2, 0)),
        box("bottle", (0.3, 0.3, 0.5), (0, 0.9, 0)),
        box("table", (0.7, 0.4, 0.3), (0, -1.0, 0)),
    ]
    return synthetic_scene(objects, orbit(8, 3.0, 1.6, size=(200, 150), focal=150.0), dense=1500, sparse=1500)


def verdict(synthetic, instances):
    """Number of warnings and of fatal problems."""
    problems = mask_contradictions(mask_agreement(sparse_labels(synthetic.scene, instances), instances))
    return sum(not problem.is_fatal for problem in problems), sum(problem.is_fatal for problem in problems)


def test_masks_of_the_views_agree(synthetic):
    agreement = mask_agreement(sparse_labels(synthetic.scene, synthetic.instances), synthetic.instances)
    assert agreement.cover > 0.9
    assert agreement.names > 0.95
    assert verdict(synthetic, synthetic.instances) == (0, 0)


@pytest.mark.parametrize("other", [[3, 4, 5, 6, 7, 0, 1, 2], [5, 6, 7, 0, 1, 2, 3, 4]])
def test_masks_of_other_frames_are_ruled_out(synthetic, other):
    assert verdict(synthetic, [replace(mask, view=other[mask.view]) for mask in synthetic.instances]) == (0, 1)


def test_a_detector_that_misses_most_objects_is_not_doubted(synthetic):
    random = np.random.default_rng(1)
    seen = [mask for mask in synthetic.instances if random.random() < 0.4]
    assert verdict(synthetic, seen) == (0, 0)


def test_boxes_and_one_category_say_nothing(synthetic):
    boxes = [replace(mask, from_box=True) for mask in synthetic.instances]
    assert mask_agreement(sparse_labels(synthetic.scene, boxes), boxes).pairs == 0
    same = [replace(mask, category="chair", view=(mask.view + 3) % 8) for mask in synthetic.instances]
    assert np.isnan(mask_agreement(sparse_labels(synthetic.scene, same), same).names)
    assert verdict(synthetic, same) == (0, 0)


def test_masks_of_a_crop_hold_few_of_each_other_s_points(synthetic):
    """The middle four fifths of each image, stated of the whole."""

    def cropped(item):
        whole = np.zeros((150, 200), dtype=bool)
        (x, y), (h, w) = item.origin, item.mask.shape
        whole[y : y + h, x : x + w] = item.mask
        inner = whole[15:135, 20:180]
        rows, columns = (np.arange(150) * 0.8).astype(int), (np.arange(200) * 0.8).astype(int)
        return replace(item, mask=inner[np.ix_(rows, columns)], origin=(0, 0))

    for instances, wrong in ((synthetic.instances, False), ([cropped(item) for item in synthetic.instances], True)):
        tracks: dict[str, list[int]] = {}
        for row, item in enumerate(instances):
            tracks.setdefault(item.category, []).append(row)
        labels = sparse_labels(synthetic.scene, instances)
        for shown in (list(tracks.values()), [tracks["chair"], tracks["bottle"]]):  # of two no median states anything
            share = track_agreement(labels, instances, shown)
            assert bool(track_contradictions(share)) == wrong, share


def test_masks_that_stand_twice_under_two_categories_are_said(synthetic):
    twice = [*synthetic.instances, *(replace(mask, category="lamp", id=f"{mask.id}b") for mask in synthetic.instances)]
    found = measure_objects(synthetic.scene, twice)
    assert found.objects == ()
    assert any("pairs of equal masks" in problem.message for problem in found.problems)


@pytest.mark.parametrize(
    ("cover", "names", "pairs", "fatal"),
    [
        (0.59, 0.79, 200, False),  # a warning: below MIN_COVER and MIN_NAMES
        (0.61, 0.79, 200, None),
        (0.59, 0.81, 200, None),
        (0.59, 0.79, 199, None),  # too few pairs
        (0.44, 0.64, 200, True),  # below MIN_VALID_COVER and MIN_VALID_NAMES
        (0.46, 0.64, 200, False),
        (0.44, 0.66, 200, False),
        (0.24, 0.79, 200, True),  # below NO_COVER
        (0.26, 0.79, 200, False),
    ],
)
def test_both_sides_of_the_thresholds_of_mask_agreement(cover, names, pairs, fatal):
    problems = mask_contradictions(MaskAgreement(cover, names, pairs))
    assert [problem.is_fatal for problem in problems] == ([] if fatal is None else [fatal])
    assert all(problem.is_doubtful for problem in problems)


@pytest.mark.parametrize(("agreement", "fatal"), [(0.73, None), (0.71, False), (0.63, False), (0.61, True)])
def test_both_sides_of_the_thresholds_of_track_agreement(agreement, fatal):
    problems = track_contradictions(agreement)
    assert [problem.is_fatal for problem in problems] == ([] if fatal is None else [fatal])
    assert all(problem.is_doubtful for problem in problems)


@pytest.mark.parametrize(
    ("inside", "outside", "warned"), [(0.79, 0.1, True), (0.81, 0.1, False), (0.7, 0.16, True), (0.7, 0.17, False)]
)
def test_both_sides_of_the_thresholds_of_rims(inside, outside, warned):
    """MIN_RIM_AGREEMENT of 0.8, MIN_RIM_RATIO of 1.8."""
    assert bool(rim_warnings((inside, outside))) == warned


@pytest.mark.parametrize(
    ("tracks", "expected"),
    [
        ([(30, 0), (30, 0), (18, 8)], 1.0),  # the median of three tracks, the last with 44 pairs
        ([(30, 0), (30, 0), (14, 8)], 148 / 156),  # the last has 36 pairs: all pairs together
        ([(30, 0), (10, 40)], 80 / 120),  # two tracks
        ([(10, 2), (10, 0)], 40 / 42),
        ([(8, 2), (10, 0)], np.nan),  # 38 pairs
        ([(30, 30)], np.nan),  # one track
    ],
)
def test_both_sides_of_the_numbers_of_tracks_and_pairs(tracks, expected):
    """MIN_TRACKS of 3, MIN_TRACK_PAIRS of 40, MIN_POOLED_TRACKS of 2; points in both masks of a track and in one."""
    n = sum(map(sum, tracks))
    inside = np.zeros((2 * len(tracks), n))
    start = 0
    for track, (both, one) in enumerate(tracks):
        inside[2 * track, start : start + both + one] = inside[2 * track + 1, start : start + both] = 1
        start += both + one
    member, seen = csr_array(inside), csr_array(np.ones((2, n)))
    labels = PointLabels(np.zeros((n, 3)), np.arange(n), member, seen, seen, member)
    pixel = np.ones((1, 1), dtype=bool)
    masks = [
        Instance(f"{track}{view}", view, "chair", pixel, (0, 0)) for track in range(len(tracks)) for view in (0, 1)
    ]
    members = [(2 * track, 2 * track + 1) for track in range(len(tracks))]
    assert track_agreement(labels, masks, members) == pytest.approx(expected, nan_ok=True)

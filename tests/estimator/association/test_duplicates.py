"""Two masks on one object in one image: the better one stays, or none."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimator.association.mask_checks import mask_iou as overlap
from estimator.association.mask_checks import without_duplicates as distinct_rows
from estimator.records.scene import Instance
from tests.support.processor_time import processor_seconds


def mask(x, y, width, height, category="chair", score=0.9, view=0):
    return Instance("1", view, category, np.ones((height, width), dtype=bool), (x, y), score)


def test_the_better_of_two_masks_stays():
    assert distinct_rows([mask(0, 0, 20, 20, score=0.6), mask(1, 0, 20, 20, score=0.9)]).tolist() == [1]


def test_of_equal_masks_the_first_stays():
    assert distinct_rows([mask(0, 0, 20, 20), mask(0, 0, 20, 20)]).tolist() == [0]


def test_of_two_names_with_equal_scores_neither_stays():
    assert distinct_rows([mask(0, 0, 20, 20), mask(0, 0, 20, 20, "couch")]).tolist() == []


def test_of_two_names_the_one_of_the_higher_score_stays():
    assert distinct_rows([mask(0, 0, 20, 20), mask(0, 0, 20, 20, "couch", 0.95)]).tolist() == [1]


@pytest.mark.parametrize("other", [mask(15, 0, 20, 20), mask(5, 5, 8, 8, "cup"), mask(0, 0, 20, 20, view=1)])
def test_neighbours_parts_and_other_pictures_stay(other):
    assert distinct_rows([mask(0, 0, 20, 20), other]).tolist() == [0, 1]


@given(st.tuples(*[st.integers(0, 12)] * 2), st.tuples(*[st.integers(1, 12)] * 2))
def test_overlap_is_symmetric_and_right_for_rectangles(place, size):
    one, two = mask(3, 4, 8, 6), mask(*place, *size)
    whole = np.zeros((2, 40, 40), dtype=bool)
    for image, item in zip(whole, (one, two), strict=True):
        (x, y), (height, width) = item.origin, item.mask.shape
        image[y : y + height, x : x + width] = True
    assert overlap(one, two) == overlap(two, one) == (whole[0] & whole[1]).sum() / (whole[0] | whole[1]).sum()


def test_empty_masks_overlap_nothing():
    empty = replace(mask(0, 0, 4, 4), mask=np.zeros((4, 4), dtype=bool))
    assert overlap(empty, empty) == 0


@pytest.mark.parametrize(("shift", "count"), [(3, 1), (4, 2)])
def test_masks_with_an_iou_of_seven_tenths_are_duplicates(shift, count):
    """Masks 20 wide have an IoU of 17 / 23 = 0.74 with a shift of 3, and of 16 / 24 = 0.67 with a shift of 4."""
    assert len(distinct_rows([mask(0, 0, 20, 20), mask(shift, 0, 20, 20)])) == count


def test_thousands_of_boxes_in_an_image_take_little_time():
    equal = [mask(0, 0, 10, 10)] * 20_000
    apart = [mask(12 * (index % 100), 12 * (index // 100), 10, 10) for index in range(5_000)]

    def rows() -> None:
        assert distinct_rows(equal).tolist() == [0]
        assert len(distinct_rows(apart)) == len(apart)

    assert processor_seconds(rows, 5) < 5


@given(
    st.lists(
        st.tuples(
            *[st.integers(0, 6)] * 2, *[st.integers(1, 9)] * 2, st.sampled_from("ab"), st.sampled_from([0.5, 0.9])
        ),
        max_size=12,
    )
)
def test_boxes_select_the_pairs_that_are_compared_without_loss(rows):
    masks, dropped = [mask(*row) for row in rows], set()
    order = sorted(range(len(masks)), key=lambda row: (-masks[row].score, row))
    for rank, row in enumerate(order):
        for other in order[rank + 1 :]:
            if not {row, other} & dropped and overlap(masks[row], masks[other]) >= 0.7:
                is_clear = masks[row].category == masks[other].category or masks[row].score > masks[other].score
                dropped |= {other} if is_clear else {row, other}
    assert distinct_rows(masks).tolist() == [row for row in range(len(masks)) if row not in dropped]

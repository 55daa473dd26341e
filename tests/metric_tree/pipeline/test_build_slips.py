"""Sizes that stand a unit's factor away from their class."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from metric_tree.checks.unit_errors import FACTORS, Reference, class_reference, sibling_reference, unit_error_factors

TYPICAL = np.array([2000.0, 900.0, 850.0])


def extents(n: int = 60, spread: float = 0.12) -> np.ndarray:
    return -np.sort(-TYPICAL * np.exp(np.random.default_rng(0).normal(0, spread, (n, 3))), axis=1)


@given(factor=st.sampled_from(FACTORS), down=st.booleans(), row=st.integers(0, 59))
@settings(max_examples=40, deadline=None)
def test_a_row_in_another_unit_is_found_with_its_factor(factor, down, row):
    factor = 1 / factor if down else factor
    sizes = extents()
    sizes[row] = np.exp(class_reference(sizes).centre)  # the typical one of its class
    sizes[row] *= factor
    found = unit_error_factors(sizes, class_reference(sizes))
    assert found[row] == pytest.approx(factor)
    assert np.all(np.delete(found, row) == 1.0)


def test_one_axis_in_another_unit_is_found():
    sizes = extents()
    sizes[5] = [8500.0, 2000.0, 900.0]  # the height has a zero too many
    assert unit_error_factors(sizes, class_reference(sizes))[5] != 1.0


def test_one_axis_in_another_unit_is_no_slip_where_another_axis_is_odd_too():
    """Both others must be ordinary: of an odd object nobody can tell which number is wrong."""
    typical = np.exp(class_reference(extents()).centre)
    known = Reference(np.log(typical), np.full(3, 0.12))
    ordinary, odd = typical * [10.0, 1.0, 1.0], typical * [10.0, np.exp(4 * 0.12), 1.0]
    assert unit_error_factors(np.array([ordinary, odd]), known).tolist() == [pytest.approx(10.0), np.inf]


def test_a_small_one_of_its_kind_is_no_slip():
    sizes = extents(spread=0.3)
    sizes[5] = [900.0, 700.0, 650.0]  # a doll's sofa would be; a child's is not
    assert unit_error_factors(sizes, class_reference(sizes))[5] == 1.0


def test_rows_of_few_numbers_are_read_in_every_way():
    sizes = extents()
    sizes[3] = [900.0, 850.0, np.nan]
    sizes[4] = [850.0, np.nan, np.nan]
    sizes[5] = [85.0, np.nan, np.nan]
    found = unit_error_factors(sizes, class_reference(sizes))
    assert found[3:5].tolist() == [1.0, 1.0]
    assert found[5] == pytest.approx(0.1)


def test_a_wide_class_refuses_nothing():
    sizes = extents(spread=0.9)
    assert (unit_error_factors(sizes, class_reference(sizes)) != 1.0).sum() <= 1


def test_far_out_and_unexplained_is_reported_as_such():
    sizes = extents()
    sizes[7] *= 60.0
    assert np.isinf(unit_error_factors(sizes, class_reference(sizes))[7])


def test_a_thin_class_is_measured_against_its_siblings():
    assert class_reference(extents(5)) is None
    medians = np.log(TYPICAL) + np.random.default_rng(0).normal(0, 0.3, (6, 3))
    metres = extents(3) / 1000
    found = unit_error_factors(metres, sibling_reference(medians))
    assert found == pytest.approx([1 / 1000] * 3)
    assert sibling_reference(medians[:3]) is None


def test_axes_that_no_row_states_are_not_suspect():
    sizes = extents()
    sizes[:, 2] = np.nan
    assert np.all(unit_error_factors(sizes, class_reference(sizes)) == 1.0)


@pytest.mark.parametrize(
    ("deviation", "offsets", "factor"),
    [
        (0.75, np.full(3, np.log(10)), 10.0),  # 3.07 standard deviations
        (0.78, np.full(3, np.log(10)), 1.0),  # 2.95
        (0.1, np.full(3, 0.80), 2.54),  # a factor of 2.23
        (0.1, np.full(3, 0.785), 1.0),  # 2.19
        (0.1, [1.40, 0.0, 0.0], np.inf),  # a factor of 4.06
        (0.1, [1.37, 0.0, 0.0], 1.0),  # 3.94
        (0.25, [2.05, 0.6, 0.0], np.inf),  # 8.2 standard deviations
        (0.25, [1.95, 0.6, 0.0], 1.0),  # 7.8
        (0.25, [2.30, 0.49, 0.0], 10.0),  # another axis deviates by 1.96 standard deviations
        (0.25, [2.30, 0.51, 0.0], np.inf),  # 2.04
        (0.45, [2.30, 0.0, 0.0], 10.0),  # 5.1 standard deviations of a single axis
        (0.47, [2.30, 0.0, 0.0], 1.0),  # 4.9
    ],
)
def test_thresholds_of_an_error_of_the_unit(deviation: float, offsets: np.ndarray, factor: float) -> None:
    reference = Reference(np.log(TYPICAL), np.full(3, deviation))
    assert unit_error_factors((TYPICAL * np.exp(offsets))[None], reference)[0] == pytest.approx(factor)


def test_numbers_of_rows_and_siblings_of_a_reference() -> None:
    assert class_reference(extents(7)) is None
    assert class_reference(extents(8)) is not None
    medians = np.log(TYPICAL) + np.random.default_rng(0).normal(0, 0.3, (4, 3))
    assert sibling_reference(medians[:3]) is None
    assert sibling_reference(medians) is not None

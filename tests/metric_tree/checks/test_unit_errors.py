"""Both sides of each threshold of sizes that differ from their class by the factor of a unit."""

from __future__ import annotations

import numpy as np
import pytest

from metric_tree.checks.unit_errors import Reference, class_reference, sibling_reference, unit_error_factors

CENTRE = np.log([1000.0, 500.0, 250.0])
TEN = np.log(10.0)


@pytest.mark.parametrize(
    ("offsets", "deviation", "factor"),
    [
        ([TEN, TEN, TEN], TEN / 3.05, 10.0),  # MIN_DEVIATIONS of 3
        ([TEN, TEN, TEN], TEN / 2.95, 1.0),
        (np.log([2.3, 2.3, 2.3]), 0.12, 2.54),  # MIN_ERROR_FACTOR of 2.2
        (np.log([2.15, 2.15, 2.15]), 0.12, 1.0),
        ([TEN, 0.0, 0.0], TEN / 5.05, 10.0),  # MIN_SINGLE_DEVIATIONS of 5
        ([TEN, 0.0, 0.0], TEN / 4.95, 1.0),
        ([TEN, 0.0, 0.3 * 1.9], 0.3, 10.0),  # MAX_OTHER_DEVIATIONS of 2
        ([TEN, 0.0, 0.3 * 2.1], 0.3, 1.0),
        ([TEN + 0.28, TEN + 0.28, TEN + 0.28], 0.2, 10.0),  # MAX_CORRECTED_DEVIATIONS of 1.5
        ([TEN + 0.32, TEN + 0.32, TEN + 0.32], 0.2, np.inf),
        ([TEN + 0.09, TEN + 0.09, TEN + 0.09], 0.05, 10.0),  # CORRECTED_LOG_TOLERANCE of 0.1
        ([TEN + 0.11, TEN + 0.11, TEN + 0.11], 0.05, np.inf),
        ([1.65, 0.0, 0.0], 0.2, np.inf),  # FAR_DEVIATIONS of 8
        ([1.55, 0.0, 0.0], 0.2, 1.0),
        (np.log([4.1, 1.0, 1.0]), 0.1, np.inf),  # FAR_FACTOR of 4
        (np.log([3.9, 1.0, 1.0]), 0.1, 1.0),
    ],
)
def test_both_sides_of_the_thresholds_of_unit_errors(offsets: list[float], deviation: float, factor: float) -> None:
    """Offsets of ln size from the class, whose robust standard deviation is equal on all axes."""
    rows = np.exp(CENTRE + offsets)[None]
    assert unit_error_factors(rows, Reference(CENTRE, np.full(3, deviation))).tolist() == [pytest.approx(factor)]


def test_eight_rows_or_four_siblings_are_a_reference_with_a_minimum_deviation() -> None:
    rows = np.tile(np.exp(CENTRE), (8, 1))
    own, siblings = class_reference(rows), sibling_reference(np.log(rows[:4]))
    assert own is not None
    assert siblings is not None
    assert own.deviation == pytest.approx([0.1] * 3)
    assert siblings.deviation == pytest.approx([np.log(2.2)] * 3)
    assert (class_reference(rows[:7]), sibling_reference(np.log(rows[:3]))) == (None, None)

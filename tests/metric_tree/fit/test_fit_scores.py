"""Held-out scores and the moments of sorted extents, compared with theory."""

from __future__ import annotations

import numpy as np
import pytest

from metric_tree.fit.class_prior import NewSource, best_mixture, class_prior
from metric_tree.fit.moments import VAGUE, extent_moments
from metric_tree.fit.rows import weighted_rows
from tests.metric_tree.fit.test_fit import MEANS, NONE, class_rows, two_kinds

SD = 0.15


def one_kind(n: int, seed: int = 3) -> np.ndarray:
    return MEANS[0] + np.random.default_rng(seed).normal(0, SD, (n, 3))


@pytest.mark.parametrize("n", [150, 400])
def test_the_held_out_score_is_the_entropy_of_what_the_rows_are_drawn_from(n: int) -> None:
    """Each row is scored once, by a fit that did not see it: -E ln p is 3/2 ln(2 pi e) + 3 ln sd, and a little more."""
    prior = class_prior(class_rows(one_kind(n)), VAGUE, NONE, seed=0, new_source=NewSource(0.0))
    entropy = 1.5 * np.log(2 * np.pi * np.e) + 3 * np.log(SD)
    assert prior.heldout_log_density is not None
    assert -0.25 < prior.heldout_log_density + entropy < 0.15


def test_extents_of_few_rows_lean_on_what_is_believed_of_anything() -> None:
    """The variance of equal rows is the general one, weighted by its rows over all rows."""
    for n in (1, 2, 5):
        alike = extent_moments(class_rows(np.repeat([[7.6, 6.8, 6.5]], n, axis=0)))
        share = VAGUE.covariance_rows / (n + VAGUE.covariance_rows)
        assert alike.within == pytest.approx(share * VAGUE.covariance)
        assert alike.mean == pytest.approx([7.6, 6.8, 6.5])
    x = -np.sort(-one_kind(400), axis=1)
    assert np.diag(extent_moments(class_rows(x)).within) == pytest.approx(x.var(axis=0), rel=0.1)


def test_ten_complete_rows_have_a_held_out_score() -> None:
    scores = [class_prior(class_rows(one_kind(n)), VAGUE, NONE).heldout_log_density for n in (9, 10)]
    assert scores[0] is None
    assert scores[1] is not None


def test_a_component_needs_fifteen_rows() -> None:
    for n, components in ((29, 1), (30, 2)):
        rows, _, _ = weighted_rows(class_rows(two_kinds(n)))
        assert best_mixture(rows, VAGUE, seed=0)[1] == components

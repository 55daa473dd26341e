from __future__ import annotations

import numpy as np

from tests.synthetic.rooms.sizes import TYPICAL_MM, drawn_sizes, plausible_sizes


def test_plausible_sizes_drop_incomplete_and_oversized_rows_and_sort_the_others() -> None:
    typical = np.array(TYPICAL_MM["chair"], dtype=float)
    rows = np.array([typical, typical * 3, [np.nan, 400, 900], typical[[1, 0, 2]]])
    assert np.allclose(plausible_sizes("chair", rows), [typical, typical])


def test_drawn_sizes_use_rows_of_the_pool_and_typical_sizes_without_rows() -> None:
    typical = np.array(TYPICAL_MM["chair"], dtype=float)
    draw = drawn_sizes({"chair": typical[None]})
    assert np.allclose(draw("chair", np.random.default_rng(0)), typical)
    assert np.allclose(draw("couch", np.random.default_rng(0)), TYPICAL_MM["couch"], rtol=0.6)

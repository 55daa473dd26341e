from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.metrics import adjusted_rand_score

from estimator.records.objects import Track
from tests.synthetic.rooms.quick import SyntheticScene
from tests.synthetic.rooms.scores import Score, adjusted_rand_index, association_score, height_error, summary
from tests.synthetic.rooms.sizes import TYPICAL_MM, drawn_sizes, plausible_sizes

labels = st.lists(st.tuples(st.sampled_from("abc"), st.sampled_from("abc")), min_size=2, max_size=30)


@given(labels)
def test_rand_index_is_sklearns(pairs: list[tuple[str, str]]) -> None:
    first, second = [a for a, _ in pairs], [b for _, b in pairs]
    assert adjusted_rand_index(first, second) == pytest.approx(adjusted_rand_score(first, second), abs=1e-9)


def true_tracks(synthetic: SyntheticScene) -> list[Track]:
    rows: dict[str, list[int]] = {}
    for row, instance in enumerate(synthetic.instances):
        rows.setdefault(str(instance.track), []).append(row)
    return [Track(tuple(members), name) for name, members in rows.items()]


def test_true_tracks_score_full_and_a_split_and_a_merge_are_counted(synthetic: SyntheticScene) -> None:
    tracks = true_tracks(synthetic)
    assert association_score(synthetic.instances, tracks).ari == 1
    long = max(tracks, key=lambda track: len(track.members))
    rest = [track for track in tracks if track is not long]
    split = [*rest, Track(long.members[:5], "a"), Track(long.members[5:], "b")]
    assert association_score(synthetic.instances, split).splits == 1
    merged = [*rest[1:], Track(long.members + rest[0].members, "a")]
    found = association_score(synthetic.instances, merged)
    assert (found.merges, found.splits) == (1, 0)
    assert found.ari < 1


def test_heights_at_the_true_scale_have_no_error(synthetic: SyntheticScene) -> None:
    true = synthetic.truth
    heights = [item.size[2] / true.metres_per_unit for item in true.objects.values()]
    assert height_error(true.metres_per_unit, heights, list(true.objects), true) == pytest.approx(0, abs=1e-12)
    assert height_error(1.1 * true.metres_per_unit, heights, list(true.objects), true) == pytest.approx(0.1)


def test_summary_leaves_the_refused_out_of_the_error_and_counts_them() -> None:
    scores = [Score("a", "m", 0.1, 0.1, 0.2, True, 1.2, 0.0), Score("b", "m", None, None, None, None, None, 0.0)]
    found = summary(scores)
    assert (found.refused, found.median, found.coverage) == (0.5, 0.1, 1.0)


def test_implausible_rows_are_no_furniture() -> None:
    typical = np.array(TYPICAL_MM["chair"], dtype=float)
    rows = np.array([typical, typical * 3, [np.nan, 400, 900], typical[[1, 0, 2]]])
    kept = plausible_sizes("chair", rows)
    assert np.allclose(kept, [typical, typical])
    draw = drawn_sizes({"chair": kept})
    assert np.allclose(draw("chair", np.random.default_rng(0)), typical)
    assert np.allclose(draw("couch", np.random.default_rng(0)), TYPICAL_MM["couch"], rtol=0.6)

"""Common deviation of the objects of a room, recovered from synthetic rooms."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from metric_tree.fit.intraclass_correlation import (
    IntraclassCorrelation,
    axis_correlation,
    class_correlation,
    shrunk_correlations,
)
from metric_tree.pipeline.hierarchy import Hierarchy
from tests.synthetic.priors import prior

# Published values, written out so that a changed rule fails a test.
DEFAULT_MEAN = 0.45


def rooms(share: float, n: int = 60, objects: int = 5, seed: int = 0):
    """Ln sizes (n objects, 2), source and scene of objects in rooms that share a part of the variance."""
    generator = np.random.default_rng(seed)
    room = np.repeat(generator.normal(0, np.sqrt(share), (n, 2)), objects, axis=0)
    x = 6 + 0.2 * (room + generator.normal(0, np.sqrt(1 - share), room.shape))
    return x, np.full(len(x), "rooms"), np.array([f"rooms/{number}" for number in np.repeat(np.arange(n), objects)])


@pytest.mark.parametrize("share", [0.0, 0.3, 0.8])
def test_the_share_is_recovered(share: float) -> None:
    found = class_correlation(*rooms(share))
    assert found is not None
    assert abs(found.value - share) < 3 * found.sd + 0.03
    assert 0 < found.sd < 0.15


def test_sets_that_hold_the_same_objects_twice_are_no_evidence() -> None:
    x, source, scene = rooms(0.0)
    twice = np.concatenate([source, np.full(len(source) - 5, "again")])
    found = class_correlation(np.concatenate([x, x[5:]]), twice, np.concatenate([scene, scene[5:]]))
    assert found is not None
    assert found.value < 0.15


def test_few_rooms_say_nothing() -> None:
    assert class_correlation(*rooms(0.5, n=5)) is None
    x, source, _ = rooms(0.5)
    assert class_correlation(x, source, np.full(len(x), "")) is None


def test_an_uncertain_class_leans_on_the_others() -> None:
    classes = {f"c{n}": IntraclassCorrelation(0.5 + 0.02 * n, 0.05) for n in range(5)} | {
        "thin": IntraclassCorrelation(0.0, 0.4)
    }
    shrunk, other = shrunk_correlations(classes)
    assert shrunk["thin"].value > 0.3
    assert shrunk["c0"].value == pytest.approx(0.5, abs=0.05)
    assert other.value == pytest.approx(0.54, abs=0.05)
    assert shrunk_correlations({})[1].value == DEFAULT_MEAN


def test_another_class_is_as_uncertain_as_the_known_ones_differ() -> None:
    """Of classes known exactly the variance between them is the sample's; the mean of k adds a k-th of it."""
    shares = np.array([0.2, 0.4, 0.6, 0.8])
    shrunk, other = shrunk_correlations(
        {f"c{row}": IntraclassCorrelation(share, 1e-4) for row, share in enumerate(shares)}
    )
    assert other.value == pytest.approx(0.5)
    assert other.sd == pytest.approx(np.sqrt(shares.var(ddof=1) * (1 + 1 / 4)), rel=1e-3)
    assert [shrunk[f"c{row}"].value for row in range(4)] == pytest.approx(shares, abs=1e-3)


def test_only_the_source_with_most_rooms_counts() -> None:
    x, source, scene = rooms(0.8)
    y, _, other = rooms(0.0, n=20, seed=1)
    sources, scenes = (
        np.concatenate([source, np.full(len(y), "few")]),
        np.concatenate([scene, np.char.add("few ", other)]),
    )
    both = class_correlation(np.concatenate([x, y]), sources, scenes)
    assert both == class_correlation(x, source, scene)


def test_eight_rooms_with_several_objects_are_enough() -> None:
    assert class_correlation(*rooms(0.5, n=7)) is None
    assert class_correlation(*rooms(0.5, n=8)) is not None


def test_three_classes_determine_their_common_mean() -> None:
    classes = {name: IntraclassCorrelation(0.7, 0.05) for name in "abc"}
    known, default = shrunk_correlations(classes)
    assert (len(known), default.value) == (3, pytest.approx(0.7))
    assert shrunk_correlations({name: classes[name] for name in "ab"}) == ({}, IntraclassCorrelation(DEFAULT_MEAN, 0.2))


def test_rooms_without_a_size_or_a_difference_are_no_evidence() -> None:
    scene = np.repeat(np.arange(9), 2).astype(str)
    assert axis_correlation(np.full(18, np.nan), scene) is None
    assert axis_correlation(np.full(18, 6.0), scene) is None
    assert axis_correlation(np.r_[np.zeros(17), 1e-3], scene) is not None


def test_an_inner_node_has_the_correlation_of_its_classes_by_their_items(monkeypatch: pytest.MonkeyPatch) -> None:
    def category(node_id: str, parent: str | None) -> Any:
        return SimpleNamespace(node_id=node_id, parent_id=parent)

    categories = [category("r", None), category("k", "r"), category("a", "k"), category("b", "k"), category("c", "r")]
    known = {"a": IntraclassCorrelation(0.2, 0.1), "b": IntraclassCorrelation(0.6, 0.1)}
    default = IntraclassCorrelation(0.45, 0.2)
    monkeypatch.setattr("metric_tree.pipeline.hierarchy.shrunk_correlations", lambda _: (known, default))
    classes: Any = {
        node_id: SimpleNamespace(correlation=None, n_by_source={"s": n})
        for node_id, n in (("a", 30), ("b", 10), ("c", 5))
    }
    priors: Any = {one.node_id: [prior(one.node_id, [[1.0, 1.0, 1.0]])] for one in categories}
    found = Hierarchy.of(categories).with_correlations(priors, classes)
    sameness = {node_id: (one.sameness, one.sameness_sd) for node_id, (one,) in found.items()}
    assert sameness["a"] == (0.2, pytest.approx(0.1))
    assert sameness["c"] == (0.45, 0.2)
    mean, sd = 0.75 * 0.2 + 0.25 * 0.6, (0.01 + 0.75 * 0.1**2 + 0.25 * 0.3**2) ** 0.5
    assert sameness["k"] == sameness["r"] == (pytest.approx(mean), pytest.approx(sd))

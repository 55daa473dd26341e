"""What looks wrong about a leaf next to its range, its siblings and its sources, and how it is settled."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from metric_tree.checks import leaves
from metric_tree.checks.leaves import LeafSize, leaf_findings
from metric_tree.checks.release_files import CODES
from metric_tree.curated.sizes import BadRange, settled_findings
from metric_tree.release.registry import release_directory
from metric_tree.release.release import open_release

LWH = ("length", "width", "height")


def leaf(
    node_id: str = "a", size: tuple[float, ...] = (400, 300, 200), pose: str = "upright", **more: object
) -> LeafSize:
    frame = LWH if pose != "any" else ("extent1", "extent2", "extent3")
    return LeafSize(node_id, "family", pose, frame, np.array(size, float), **more)  # type: ignore[arg-type]


def codes(*leaves_: LeafSize) -> list[tuple[str, str]]:
    return [(one.code, one.subject) for one in leaf_findings(leaves_)]


def test_each_finding_and_its_settlement() -> None:
    assert codes(leaf(typical=np.array([410, 310, 90.0]))) == [("W411", "a")]
    assert codes(leaf(typical=np.array([410, np.nan, 190.0]))) == []
    assert codes(leaf(pose="any", typical=np.array([200, 310, 390.0]))) == []
    assert codes(leaf(size=(300, 400, 200)), leaf("b", (400, 100, 200), "flat")) == [("W413", "a"), ("W413", "b")]
    doors = [leaf(str(n), (900, 50, 2000)) for n in range(6)]
    assert codes(leaf(size=(900, 600, 110))) == codes(leaf(size=(900, 400, 150)), *doors) == [("W413", "a")]
    assert codes(leaf(size=(900, 400, 150))) == codes(*doors) == []
    same = {name: np.array([400, 300, 200.0]) for name in ("x", "y")}
    assert codes(leaf(sources=same | {"toys": np.array([40, 30, 20.0])})) == [("W414", "a"), ("W415", "a")]
    halves = {"x": same["x"], "halves": 0.45 * same["x"]}
    assert codes(leaf(sources=halves)) == []  # which of two is right?
    small = {"shop": same["x"], "toys": np.array([100, 90, 70.0])}
    assert codes(leaf(sources=small)) == codes(leaf(titles=["Toy locomotive"])) == [("W415", "a")]
    assert codes(leaf(sources=small, titles=["Toy locomotive"], family="plaything.n.01")) == []
    thin = {"x": same["x"], "thin": np.array([410, 90, 70.0])}
    assert codes(leaf(titles=["Clock, model 500"], sources=thin)) == []
    odd = [*(leaf(str(n), (400 + n, 300, 200)) for n in range(5)), leaf("toy", (40, 30, 20))]
    assert codes(*odd) == [("W412", "toy")]
    assert leaf_findings(odd, {("W412", "toy")}) == []


@given(st.floats(0.01, 100), st.lists(st.floats(100, 900), min_size=6, max_size=9))
def test_findings_do_not_depend_on_the_unit(scale: float, sizes: list[float]) -> None:
    at = lambda factor: [  # noqa: E731
        leaf(str(n), (3 * s * factor, 2 * s * factor, s * factor), typical=factor * np.array([900, 600, 300.0]))
        for n, s in enumerate(sizes)
    ]
    near = lambda ones: {(one.code, one.subject) for one in leaf_findings(ones) if one.code != "W412"}  # noqa: E731
    edge = any(abs(abs(np.log(s / 300)) - np.log(2)) < 1e-9 for s in sizes)
    assert edge or near(at(1.0)) == near(at(scale))


def test_the_shipped_release_has_every_finding_settled_with_a_reason(tmp_path: Path) -> None:
    release = open_release(release_directory(None))
    tables = [release.table(name) for name in ("nodes", "items", "priors")]
    assert [one.subject for one in leaves.findings(*tables, release.manifest)] == []
    assert {code for code, _ in settled_findings()} <= set(CODES)
    (empty := tmp_path / "settled.csv").write_text("code,node_id,reason,reviewer,written\nW412,a,,b,2026-11-22\n")
    with pytest.raises(BadRange, match="reason"):
        settled_findings(empty)


def test_thresholds_of_the_findings() -> None:
    same = np.array([400, 300, 200.0])
    for factor, found in ((1.99, []), (2.01, [("W411", "a")])):
        assert codes(leaf(typical=same * [1, 1, factor])) == codes(leaf(typical=same / [1, 1, factor])) == found
    for width, found in ((407, []), (409, [("W413", "a")])):
        assert codes(leaf(size=(400, width, 200))) == codes(leaf(size=(900, 400, width), pose="flat")) == found
    for depth, found in ((499, []), (501, [("W413", "a")])):
        assert codes(leaf(size=(900, depth, 100))) == found
    for factor, found in ((0.41, []), (0.39, [("W415", "a")])):
        assert codes(leaf(sources={"shop": same, "toys": factor * same})) == found
    pair, trio = (dict.fromkeys(names, same) | {"large": 2.01 * same} for names in ("x", "xy"))
    assert (codes(leaf(sources=pair)), codes(leaf(sources=trio))) == ([], [("W414", "a")])
    assert codes(leaf(sources=dict.fromkeys("xy", same) | {"large": 1.99 * same})) == []


def test_a_round_object_lies_while_a_sibling_stands() -> None:
    """Of light bulbs, `length` 110 and diameter 60 mm, some stand and some lie."""
    standing = leaf("b", (61, 60, 110))
    assert codes(leaf(size=(110, 60, 60)), standing) == [("W413", "a")]
    assert codes(leaf(size=(110, 60, 60))) == codes(leaf(size=(110, 60, 60), pose="any"), standing) == []
    for height, found in ((61.7, [("W413", "a")]), (62.1, [])):  # `MAX_ROUND_DIFFERENCE`
        assert codes(leaf(size=(110, 60, height)), standing) == found
    for length, found in ((71, []), (73, [("W413", "a")])):  # `MIN_ROUND_RATIO`
        assert codes(leaf(size=(length, 60, 60)), standing) == found


def test_a_sibling_deviates_by_three_and_a_half_times_the_scatter() -> None:
    """Logarithms of the sizes of the siblings; their median absolute deviation from 0.15 is 0.35."""
    for offset, found in ((0.15 + 3.4 * 0.35 / 0.6745, []), (0.15 + 3.6 * 0.35 / 0.6745, [("W412", "5")])):
        offsets = (-0.4, -0.3, 0.0, 0.3, 0.4, offset)
        sizes = [np.array([400, 300, 200]) * np.exp(one) for one in offsets]
        assert codes(*(leaf(str(n), tuple(size)) for n, size in enumerate(sizes))) == found
    siblings = [leaf(str(n)) for n in range(3)]
    assert codes(*siblings, leaf("large", (4000, 3000, 2000))) == []  # too few siblings for a scatter
    assert codes(*siblings, leaf("3"), leaf("large", (4000, 3000, 2000))) == [("W412", "large")]

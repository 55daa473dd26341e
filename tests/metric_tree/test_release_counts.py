"""The counts of a release, on a small one that was built for the occasion."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace

import pytest

from benchmarks.metric_tree.release_counts import counted, dated, funnel, random_paths, refused
from metric_tree.build.steps import Options, build_release
from metric_tree.build.tables import evidence_counts
from metric_tree.fit.evidence import EVIDENCE
from metric_tree.tree import open_tree
from tests.synthetic.raw_fixture import SOURCES, synthetic_items, written
from tests.synthetic.small_taxonomy import small_taxonomy


@pytest.fixture(scope="module")
def raw(tmp_path_factory):
    """Synthetic items, one of them twice, one of a curated range, one of no known category; two refused rows beside."""
    folder = tmp_path_factory.mktemp("counts")
    items = synthetic_items()
    items[0], items[4] = replace(items[0], year=2001, region="NO"), replace(items[4], year=None)
    items += [replace(items[0], source_id="again"), replace(items[1], source_id="odd", category_path=("gizmo",))]
    path = written(folder / "raw.jsonl", items)
    reasons = ({"reason": "no_size"}, {"reason": "no_size"}, {"reason": "unreadable"})
    path.with_name("raw.quarantine.jsonl").write_text("".join(f"{json.dumps(r)}\n" for r in reasons), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def tree(raw):
    options = Options(version="0.0.1", created="2026-11-21", heldout=False)
    out = raw.with_name("release")
    build_release([raw], out, options, taxonomy=small_taxonomy, declared=SOURCES)
    return open_tree(out)


@pytest.fixture(scope="module")
def found(raw, tree):
    return counted([raw], tree.release.manifest, taxonomy=small_taxonomy, curated=())


def test_the_counts_are_those_of_the_build(tree, found):
    manifest = tree.release.manifest
    counts = evidence_counts(found.classes)
    assert counts == manifest["evidence"]
    assert counts["any"]["items"] == manifest["counts"]["n_fit"]
    assert [counts["any"][f"leaves_{n}"] for n in (1, 10, 30)] == [
        manifest["counts"][f"leaves_{n}"] for n in (1, 10, 30)
    ]
    assert found.reasons["duplicate"] >= 1
    assert found.reasons["no_category"] == 1


def test_weaker_evidence_is_left_out_kind_by_kind(found):
    by_kind = Counter()
    for one in found.classes:
        by_kind.update(one.n_by_kind)
    counts = evidence_counts(found.classes)
    assert counts["strong"]["items"] == by_kind["product"] + by_kind["measured"] < counts["any"]["items"]
    assert counts["any"]["items"] - counts["strong"]["items"] == by_kind["asset"] > 0


def test_curated_ranges_and_category_values_are_no_strong_evidence():
    assert "judged" not in EVIDENCE["any"]
    assert EVIDENCE["strong"] < EVIDENCE["physical"] < EVIDENCE["any"]
    assert EVIDENCE["physical"] - EVIDENCE["strong"] == {"museum"}


def test_the_funnel_narrows(tree, found, raw):
    paths = {item_id: ("Things", node_id) for item_id, node_id in found.leaves.items()}
    steps = dict(funnel(found, paths | {"shop:odd": ("gizmo",)}, tree))
    assert steps["matched to a leaf"] == steps["raw categories with sizes, a source and a path each"] - 1
    assert steps["merged concepts: leaves they reach"] == 6
    assert steps["leaves with items after repeats and slips"] == 6


def test_refused_rows_are_counted_by_reason(raw):
    assert refused([raw.parent / "raw.jsonl"]) == {"no_size": 2, "unreadable": 1}


def test_items_with_year_and_region_are_counted_by_source(raw):
    rows = {row.source: row for row in dated([raw])}
    assert {name: row.region for name, row in rows.items()} == {"shop": 2, "lab": 0, "games": 0, "club": 0}
    missing = {name: row.items - row.year for name, row in rows.items()}
    assert missing == {"shop": 1, "lab": 0, "games": 0, "club": 0}


def test_random_leaves_are_the_same_for_the_same_seed(tree):
    assert random_paths(tree, 3) == random_paths(tree, 3)
    assert random_paths(tree, 3) != random_paths(tree, 3, seed=1)
    assert all(n > 0 for _, n in random_paths(tree, 100))

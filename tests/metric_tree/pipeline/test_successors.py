"""Every id of an earlier release leads to a node."""

from __future__ import annotations

import pytest

from metric_base.errors import InputError
from metric_tree.pipeline.companion_files import FormerNode, former_nodes, successor_table
from metric_tree.release.release import sha256
from metric_tree.tree import open_tree

FORMER = [
    FormerNode("1.0.0", "entity.n.01", None),
    FormerNode("1.0.0", "chair.n.01", "entity.n.01"),
    FormerNode("1.0.0", "mt:gone", "chair.n.01"),
    FormerNode("1.0.0", "mt:renamed", "entity.n.01"),
]


def test_an_id_leads_to_itself_its_replacement_or_its_parent() -> None:
    nodes = {"entity.n.01", "chair.n.01", "mt:new/other"}
    table = successor_table(FORMER, nodes, {"mt:renamed": "mt:new"})
    leads = dict(zip(table["old_id"].to_pylist(), table["node_id"].to_pylist(), strict=True))
    assert leads == {
        "entity.n.01": "entity.n.01",
        "chair.n.01": "chair.n.01",
        "mt:gone": "chair.n.01",
        "mt:renamed": "mt:new/other",
    }
    with pytest.raises(InputError, match="has a successor"):
        successor_table(FORMER, {"mouse.n.04"}, {})


def test_every_id_of_earlier_releases_resolves_in_the_shipped_one() -> None:
    tree = open_tree()
    former = {one.node_id for one in former_nodes()}
    assert len(former) > 4000
    assert all(tree.has_node(tree.node(node_id).node_id) for node_id in former)
    gone = next(node_id for node_id in sorted(former) if not tree.has_node(node_id))
    assert tree.find(gone) is tree.node(gone)


def test_texts_and_successors_have_checksums() -> None:
    release = open_tree().release
    extras = release.manifest["extras"]
    assert {"README.md", "LICENSE", "successors.parquet"} <= set(extras)
    for name in ("README.md", "LICENSE", "successors.parquet"):
        assert sha256(release.directory / name) == extras[name]
    assert {one["table"] for one in release.manifest["judged_by"]} == {"norms.csv", "ranges.csv"}
    assert all(one["date"] and one["writer"] for one in release.manifest["judged_by"])

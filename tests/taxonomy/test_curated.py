"""Curated ranges: each row is in order, has a reason and a leaf, and becomes a raw item that carries its range."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crawler.items import RawItem
from metric_tree.curated.sizes import (
    BadRange,
    blind_ranges,
    curated_heights,
    curated_ranges,
    curated_states,
    judged_items,
    norm_items,
    norms,
)
from taxonomy.catalogue import default_catalogue

HEADER = (
    "node_id,length_low,length_typical,length_high,width_low,width_typical,width_high,"
    "height_low,height_typical,height_high,reason,reviewer,written\n"
)


def test_every_shipped_range_has_a_leaf_a_reason_and_a_reader():
    catalogue = default_catalogue()
    nodes = {category.node_id for category in catalogue.categories}
    rows = curated_ranges()
    assert len(rows) > 1000
    assert len({row.node_id for row in rows}) == len(rows)
    for row in rows:
        assert catalogue.leaf_of(row.node_id) is not None, row.node_id
        assert row.reason
        assert row.reviewer
    assert all(row.node_id in nodes for row in blind_ranges())


def test_length_is_the_longer_horizontal_extent():
    for row in curated_ranges():
        length, width, _ = row.typical
        assert length is None or width is None or length >= width, row.node_id


def test_items_carry_their_range_and_survive_a_line():
    item = next(item for item in judged_items() if item.source_id == "mug.n.04")
    assert item.kind == "judged"
    low, high = item.ranges_mm["height"]
    assert low < (item.dimensions_mm["height"] or 0) < high
    assert RawItem.from_line(item.line()).synset == "mug.n.04"
    disc = next(item for item in norm_items() if item.synset == "compact_disk.n.01")
    assert (disc.kind, disc.dimensions_mm["length"], disc.title[:9]) == ("norm", 120.0, "IEC 60908")


def test_every_norm_has_a_leaf_a_document_and_a_clause_and_no_range_beside_it():
    catalogue = default_catalogue()
    poses = {category.node_id: category.pose for category in catalogue.categories}
    ranges = {row.node_id for row in curated_ranges()}
    assert len(norms()) > 100
    for row in norms():
        leaf = catalogue.leaf_of(row.node_id)
        assert leaf is not None, row.node_id
        assert poses[leaf] != "any" or None not in row.typical, row.node_id  # a lone size would be of an open axis
        assert row.document
        assert row.clause
        assert row.node_id not in ranges


def test_sizes_of_one_norm_state_the_same_axes(tmp_path):
    table = tmp_path / "norms.csv"
    header = HEADER.replace("node_id,", "node_id,size,").replace("reason,", "document,clause,region,share,")
    rows = ["n,A,1,2,3,1,2,3,,,,ISO 1,1,,,program,2026", "n,B,1,2,3,,,,,,,ISO 1,1,,,program,2026"]
    table.write_text(header + "\n".join(rows) + "\n")
    with pytest.raises(BadRange, match=r"norms.csv:3: axes: expected those of the class's other sizes"):
        norms(table)
    rows = ["n,A,1,2,3,1,2,3,,,,ISO 1,1,,0.6,program,2026", "n,B,1,2,3,1,2,3,,,,ISO 1,1,,,program,2026"]
    (other := tmp_path / "shares.csv").write_text(header + "\n".join(rows) + "\n")
    with pytest.raises(BadRange, match=r"shares.csv:3: axes: expected .* a share for all of them or none"):
        norms(other)


@given(st.lists(st.floats(0.1, 1e6), min_size=3, max_size=3).map(sorted))
def test_a_row_reads_as_it_is_written(tmp_path_factory, ends):
    table = tmp_path_factory.mktemp("ranges") / "ranges.csv"
    table.write_text(HEADER + f"mug.n.04,{ends[0]},{ends[1]},{ends[2]},,,,,,,a hand,program,2026\n")
    (row,) = curated_ranges(table)
    assert row.spans[0] == tuple(ends)
    assert row.typical[1:] == (None, None)


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        ("3,2,1,,,,,,", "length: expected low, typical and high in order"),
        ("1,2,,,,,,,", "length: expected low, typical and high in order"),
        ("one,2,3,,,,,,", "length_low: expected a number, found 'one'"),
        ("-1,2,3,,,,,,", "length_low: expected a number > 0.0, found '-1'"),
        (",,,,,,,,", "expected at least one axis"),
    ],
)
def test_a_bad_row_is_named_with_its_line(tmp_path, cells, message):
    table = tmp_path / "ranges.csv"
    table.write_text(HEADER + f"mug.n.04,{cells},a hand,program,2026\n")
    with pytest.raises(BadRange, match=f"ranges.csv:2: .*{message}"):
        curated_ranges(table)


def test_a_persons_range_outranks_a_programs(tmp_path: Path) -> None:
    lines = [
        f"mug.n.04,1,{size},900,,,,,,,why,{name},2026-11-22"
        for size, name in ((90, "Ada"), (95, "program: x"), (99, "Grace"), (2, "program: y"))
    ]
    (file := tmp_path / "ranges.csv").write_text(HEADER + "\n".join([*lines, ""]))
    assert [(one.typical[0], one.reviewer) for one in curated_ranges(file)] == [(99.0, "Grace")]


def test_a_state_is_named_once_for_each_node(tmp_path: Path) -> None:
    header = HEADER.replace("node_id,", "node_id,state,plain,")
    row = "chair.n.01,{},open,400,490,600,,,,,,,leans,program: x,2026-11-22"
    (file := tmp_path / "states.csv").write_text(header + "\n".join([row.format("folded"), row.format("stacked"), ""]))
    assert [(one.state, one.typical[0]) for one in curated_states(file)] == [("folded", 490.0), ("stacked", 490.0)]
    assert len({(one.node_id, one.plain) for one in curated_states()}) == len({one.node_id for one in curated_states()})
    assert curated_states(tmp_path / "none.csv") == ()
    for name in ("folded", ""):
        (wrong := tmp_path / f"wrong{name}.csv").write_text(
            header + "\n".join([row.format("folded"), row.format(name)])
        )
        with pytest.raises(BadRange, match=r":3: state: expected "):
            curated_states(wrong)


def test_a_height_is_said_once_for_each_node(tmp_path: Path) -> None:
    header = "node_id,height,underside,extent_low,extent_typical,extent_high,reason,reviewer,written\n"
    header += "sink.n.01,the bowl,unseen,,,,why,Ada,2026-11-23\n"
    (file := tmp_path / "heights.csv").write_text(f"{header}dog.n.01,withers,seen,1,1.2,1.4,why,Ada,2026-11-28\n")
    one, dog = curated_heights(file)
    assert (one.height, one.underside, one.extent, dog.extent) == ("the bowl", "unseen", [], [1.0, 1.2, 1.4])
    assert curated_heights(tmp_path / "none.csv") == ()
    wrong = {
        "node_id": "sink.n.01,x,seen,,,,why,Ada,2026",
        "underside": "bowl,x,no,,,,why,Ada,2026",
        "height": "cup,,seen,,,,a,b,c",
        "extent": "dog,x,seen,1,1.4,1.2,a,b,c",
        "extent_low": "dog,x,seen,0.4,1,1.2,a,b,c",
    }
    for column, row in wrong.items():
        (bad := tmp_path / f"{column}.csv").write_text(f"{header}{row}\n")
        with pytest.raises(BadRange, match=f":3: {column}: expected"):
            curated_heights(bad)


def test_a_comma_that_nobody_quoted_is_found(tmp_path: Path) -> None:
    (file := tmp_path / "ranges.csv").write_text(f"{HEADER}mug.n.04,1,9,90,,,,,,,one, and more,Ada,2026-11-22\n")
    with pytest.raises(BadRange, match=r":2.*written"):
        curated_ranges(file)

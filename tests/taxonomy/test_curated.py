"""Curated ranges: each row is in order, has a reason and a leaf, and becomes a raw item that carries its range."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crawler.items import RawItem
from taxonomy.catalogue import default_catalogue
from taxonomy.curated import BadRange, blind_ranges, curated_items, curated_ranges

HEADER = (
    "node_id,length_low,length_typical,length_high,width_low,width_typical,width_high,"
    "height_low,height_typical,height_high,reason,standard,reviewer\n"
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
    item = next(item for item in curated_items() if item.source_id == "tennis_ball.n.01")
    assert item.kind == "curated"
    assert item.ranges_mm["length"] == (65.4, 68.6)
    assert RawItem.from_line(item.line()).synset == "tennis_ball.n.01"


@given(st.lists(st.floats(0.1, 1e6), min_size=3, max_size=3).map(sorted))
def test_a_row_reads_as_it_is_written(tmp_path_factory, ends):
    table = tmp_path_factory.mktemp("ranges") / "ranges.csv"
    table.write_text(HEADER + f"mug.n.04,{ends[0]},{ends[1]},{ends[2]},,,,,,,a hand,,program\n")
    (row,) = curated_ranges(table)
    assert (row.low[0], row.typical[0], row.high[0]) == tuple(ends)
    assert row.typical[1:] == (None, None)


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        ("3,2,1,,,,,,", "length: expected low, typical and high in order"),
        ("1,2,,,,,,,", "length: expected low, typical and high in order"),
        ("one,2,3,,,,,,", "length_low: expected millimetres, found 'one'"),
        ("-1,2,3,,,,,,", "length_low: expected millimetres"),
        (",,,,,,,,", "expected at least one axis"),
    ],
)
def test_a_bad_row_is_named_with_its_line(tmp_path, cells, message):
    table = tmp_path / "ranges.csv"
    table.write_text(HEADER + f"mug.n.04,{cells},a hand,,program\n")
    with pytest.raises(BadRange, match=f"ranges.csv:2: .*{message}"):
        curated_ranges(table)

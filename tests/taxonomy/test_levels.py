"""The frozen levels' rules and the placing rule."""

import pytest

from metric_base.errors import FieldError
from metric_base.parsing import table_rows
from taxonomy.levels import BadLevels, InnerNode, Levels, frozen_levels


def inner(node_id, level, parent=None, claims=()):
    return InnerNode(
        node_id=node_id, name=node_id, level=level, parent_id=parent, pose="upright", dims=("height",), claims=claims
    )


ROOT = inner("entity.n.01", 1)
FURNITURE = inner("furniture.n.01", 2, "entity.n.01")
SEAT = inner("seat.n.03", 3, "furniture.n.01")
CHAIR = inner("chair.n.01", 4, "seat.n.03", ("chair.n.01",))
OTHER_SEAT = inner("mt:seat_other", 4, "seat.n.03", ("mt:seat_other", "seat.n.03"))
NODES = (ROOT, FURNITURE, SEAT, CHAIR, OTHER_SEAT)


def test_unspecified_items_of_a_family_hang_on_the_kind_that_claims_it():
    levels = Levels(NODES)
    assert levels.home_of("chair.n.01") == "chair.n.01"
    assert levels.home_of("seat.n.03") == "mt:seat_other"
    assert levels.home_of("mt:seat_other") is None
    assert levels.home_of("furniture.n.01") is None


@pytest.mark.parametrize(
    ("nodes", "message"),
    [
        ((ROOT, ROOT), "a new id"),
        ((ROOT, inner("other.n.01", 1)), "one root"),
        ((ROOT, inner("chair.n.01", 4, "entity.n.01")), "level: expected 2"),
        ((*NODES, inner("stool.n.01", 4, "seat.n.03", ("chair.n.01",))), "each once"),
        ((ROOT, inner("chair.n.01", 2, "nowhere.n.01")), "level: expected 1"),
    ],
)
def test_a_broken_rule_is_named(nodes, message):
    with pytest.raises(FieldError, match=message):
        Levels(nodes)


def test_a_bad_table_is_named_in_one_line(tmp_path):
    table = tmp_path / "levels.csv"
    table.write_text("node_id,name\nentity.n.01,entity\n")
    with pytest.raises(BadLevels, match=r"levels.csv: header: expected columns .*, found no claims, dims"):
        frozen_levels(table)
    table.write_text("node_id,name,level,parent_id,pose,dims,claims\nentity.n.01,entity,1,,sideways,LWH,\n")
    with pytest.raises(BadLevels, match=r"levels.csv:2: pose: expected one of"):
        frozen_levels(table)
    with pytest.raises(BadLevels, match="expected a table"):
        list(table_rows(tmp_path / "none.csv", ("a",), BadLevels))


def test_cells_that_a_row_leaves_out_at_its_end_are_empty(tmp_path):
    table = tmp_path / "table.csv"
    table.write_text("a,b,c,d,e\n1,2\n1,2,3,4,5\n", encoding="utf-8")
    rows = [row for _, row in table_rows(table, ("a", "b", "c", "e"), BadLevels)]
    assert rows == [{"a": "1", "b": "2", "c": "", "e": ""}, {"a": "1", "b": "2", "c": "3", "e": "5"}]

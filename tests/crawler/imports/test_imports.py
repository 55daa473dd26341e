"""One small made-up table for each way in which open data can be misread."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from crawler.imports.table_files import BadTable
from crawler.items import RawItem
from tests.crawler.imports.invented_tables import made_up, reasons, sizes


def test_semicolons_decimal_commas_and_missing_axes(tmp_path: Path) -> None:
    result = made_up(
        tmp_path,
        """
        [[tables]]
        files = ["table.csv"]
        delimiter = ";"
        decimal = ","
        unit = "cm"
        id = "{no}"
        title = "{name}: {what}"
        category = ["{room}", "{what|head}"]
        axes = { width = "w", depth = "d", height = "h" }
        """,
        table_csv="no;name;room;what;w;d;h\n7;BORG;Kitchen;Bar stool, oak, 40 cm;40,5;;98\n"
        "8;BORG;Kitchen;Bar stool;;;\n",
    )
    (stool,) = result.items
    assert stool.dimensions_mm == {"length": None, "width": 405, "height": 980, "diameter": None, "depth": None}
    assert stool.extents_mm == (980, 405)
    assert stool.category_path == ("Kitchen", "Bar stool")
    assert (stool.source_id, stool.year, stool.region, stool.licence) == ("7", 2001, "NO", "CC0-1.0")
    assert reasons(result) == [("no_size", "dimensions")]
    assert result.rejected[0].row == "table:2"


def test_a_table_without_header_in_inches(tmp_path: Path) -> None:
    result = made_up(
        tmp_path,
        '[[tables]]\nfiles = ["table.csv"]\ncolumns = ["width", "depth", "height"]\nunit = "in"\n'
        'category = ["chair"]\n'
        "bounds_mm = [100, 1150]",
        table_csv="20,18,35\n47.2,23,29\n",
    )
    assert sizes(result) == [{"width": 508.0, "depth": 457.2, "height": 889.0}]
    assert reasons(result) == [("out_of_bounds", "extents_mm")]


def test_a_constant_column_that_is_no_axis_word_is_left_out(tmp_path: Path) -> None:
    result = made_up(
        tmp_path,
        '[[tables]]\nfiles = ["table.csv"]\ncolumns = ["width", "thickness", "height"]\n'
        'unit = "mm"\ncategory = ["door"]',
        table_csv="762,50,1981\n",
    )
    assert sizes(result) == [{"width": 762, "height": 1981}]


def test_nested_json_of_a_box_with_y_up(tmp_path: Path) -> None:
    shelf = {"assetId": "TallShelf_3", "box": {"x": 0.8, "y": 1.9, "z": 0.3}}
    result = made_up(
        tmp_path,
        """
        [[tables]]
        files = ["table.json"]
        format = "json"
        each = "*/*"
        unit = "m"
        id = "{assetId}"
        title = "{assetId|words}"
        category = ["{key|words}"]
        axes = { width = "box.x", height = "box.y", depth = "box.z" }
        """,
        table_json=json.dumps({"BookShelf": [shelf]}),
    )
    (item,) = result.items
    assert item.category_path == ("book shelf",)
    assert item.title == "tall shelf 3"
    assert item.dimensions_mm["height"] == 1900


def test_the_two_sides_of_a_box_give_its_length(tmp_path: Path) -> None:
    result = made_up(
        tmp_path,
        '[[tables]]\nfiles = ["table.jsonl"]\nformat = "jsonl"\nunit = "m"\ncategory = ["crate"]\nsynset = "{wnid}"\n'
        '[tables.axes]\nwidth = { column = "right", minus = "left" }\n[tables.names.wnid]\nn1 = "crate.n.01"',
        table_jsonl='{"right": 0.25, "left": -0.35, "wnid": "n1"}\n{"right": "?", "left": 1, "wnid": "n1"}\n',
    )
    assert sizes(result) == [{"width": 600}]
    assert result.items[0].synset == "crate.n.01"
    assert reasons(result) == [("unreadable", "right")]


def test_units_in_the_cell_win_over_the_declared_one(tmp_path: Path) -> None:
    result = made_up(
        tmp_path,
        '[[tables]]\nfiles = ["table.csv"]\nunit = "mm"\ncategory = ["car"]\naxes = { length = "l", width = "w" }\n'
        "bounds_mm = [1000, 7000]",
        table_csv='l,w\n"4,640 mm",184.5 cm\n4.64 mm,1.8 m\nlong,1.8 m\n',
    )
    assert sizes(result) == [{"length": 4640, "width": 1845}]
    assert reasons(result) == [("out_of_bounds", "extents_mm"), ("unreadable", "l")]


def test_an_odd_unit_is_a_factor_and_zero_is_missing(tmp_path: Path) -> None:
    result = made_up(
        tmp_path,
        '[[tables]]\nfiles = ["table.csv"]\nunit = "mm"\ncategory = ["shell"]\n'
        'axes = { length = { column = "l", factor = 200 }, height = { column = "h", factor = 200 } }',
        table_csv="l,h\n0.5,0\n",
    )
    assert sizes(result) == [{"length": 100}]


def test_a_size_in_one_text_ranges_states_and_order(tmp_path: Path) -> None:
    result = made_up(
        tmp_path,
        """
        [[tables]]
        files = ["table.csv"]
        unit = "mm"
        category = ["telephone"]
        text = "{size}"
        order = ["height", "width", "depth"]
        reject = [{ column = "size", matches = "fold", outcome = "several_states" }]
        """,
        table_csv='size\n"150 x 70 x 8 mm (5.9 x 2.8 x 0.3 in)"\n"150 x 70 x 8-12 mm, 88 cc"\n'
        '"Unfolded: 150 x 140 x 6 mm"\n"150 x 70 x 8 x 9 mm"\n"light"\n',
    )
    assert sizes(result) == [{"height": 150, "width": 70, "depth": 8}, {"height": 150, "width": 70, "depth": 10}]
    assert [item.flags for item in result.items] == [(), ("range",)]
    assert [reason for reason, _ in reasons(result)] == ["several_states", "several_states", "no_size"]


def test_unlabelled_sides_are_extents_alone(tmp_path: Path) -> None:
    result = made_up(
        tmp_path,
        """
        [[tables]]
        files = ["table.csv"]
        unit = "in"
        category = ["{trail}"]
        category_separator = "|"
        text = "{spec}"
        text_pattern = "Dimensions: *([\\\\d. x]+inches)"
        labelled = false
        flag = [{ column = "trail", matches = "^toys", outcome = "suspect_package" }]
        """,
        table_csv="trail,spec\nToys | Puzzles,Weight: 9 pounds|Dimensions:8x0x2.5inches|Weight: 3\n",
    )
    (puzzle,) = result.items
    assert puzzle.category_path == ("Toys", "Puzzles")
    assert dict(puzzle.dimensions_mm) == {}
    assert puzzle.extents_mm == (203.2, 63.5)
    assert puzzle.flags == ("suspect_package",)


def test_the_longer_side_is_found_in_the_title_where_its_column_lacks(tmp_path: Path) -> None:
    result = made_up(
        tmp_path,
        """
        [[tables]]
        files = ["table.csv"]
        unit = "cm"
        category = ["table"]
        only = [{ column = "{d}|{what}", matches = "^\\\\|.* \\\\d+x\\\\d+ cm" }]
        axes = { length = { column = "what", pattern = "(\\\\d+)x\\\\d+ cm" }, width = "w" }

        [[tables]]
        files = ["table.csv"]
        unit = "cm"
        category = ["table"]
        only = [{ column = "{d}|{what}", matches = "^(?!\\\\|.* \\\\d+x\\\\d+ cm)" }]
        axes = { width = "w", depth = "d" }
        """,
        table_csv='what,w,d\n"Table, 120x60 cm",60,\n"Table, 120x60 cm",120,60\n',
    )
    assert sizes(result) == [{"length": 1200, "width": 600}, {"width": 1200, "depth": 600}]


def test_rows_are_told_apart_refused_and_flagged_by_rules(tmp_path: Path) -> None:
    result = made_up(
        tmp_path,
        """
        [[tables]]
        files = ["table.csv"]
        unit = "mm"
        category = ["piano", "digital piano"]
        only = [{ column = "h", below = 300 }]
        axes = { height = "h" }

        [[tables]]
        files = ["table.csv"]
        unit = "mm"
        category = ["piano"]
        only = [{ column = "h", above = 299 }]
        reject = [{ column = "what", matches = "cover", outcome = "not_an_object" }]
        flag = [{ column = "what", matches = "pair", outcome = "pair" }]
        axes = { height = "h" }

        [[tables]]
        files = ["grid.csv"]
        refused = "grid_not_sample"
        note = "even heights"
        """,
        table_csv="h,what\n90,keys\n1200,upright\n1200,Cover\n1300,pair\n",
        grid_csv="h\n1500\n1525\n",
    )
    assert [item.category_path[-1] for item in result.items] == ["digital piano", "piano", "piano"]
    assert [item.flags for item in result.items] == [(), (), ("pair",)]
    assert result.reasons == {"grid_not_sample": 2, "not_an_object": 1}


def test_a_column_is_read_out_of_others_by_the_first_case_that_fits(tmp_path: Path) -> None:
    result = made_up(
        tmp_path,
        """
        [[tables]]
        files = ["table.csv"]
        unit = "cm"
        category = ["{what}", "{kind}"]
        axes = { height = "h" }
        [tables.read.kind]
        column = "{what}: {text}"
        default = "{what}"
        cases = [["^lamp: .*pendant", "pendant lamp"], ["^lamp: .*floor", "floor lamp"]]
        """,
        table_csv="what,text,h\nlamp,A Pendant for the floor,40\nlamp,floor lamp,150\nchair,pendant,80\n",
    )
    assert [i.category_path for i in result.items] == [("lamp", "pendant lamp"), ("lamp", "floor lamp"), ("chair",)]


def test_the_rest_of_the_files_is_accounted_for(tmp_path: Path) -> None:
    result = made_up(
        tmp_path,
        '[[tables]]\nfiles = ["nuts.csv"]\nunit = "mm"\ncategory = ["nut"]\naxes = { width = "s" }\n'
        '[[tables]]\nfiles = ["*.csv"]\nrest = true\nrefused = "part_not_whole"\nnote = "heads"',
        nuts_csv="s\n13\n",
        heads_csv="k\n5\n6\n",
    )
    assert sizes(result) == [{"width": 13}]
    assert [row.row for row in result.rejected] == ["heads:1", "heads:2"]


def test_a_diameter_counts_twice_and_the_widest_of_several_wins(tmp_path: Path) -> None:
    result = made_up(
        tmp_path,
        '[[tables]]\nfiles = ["table.csv"]\ncategory = ["cup"]\n'
        'text = "Diam {rim} x Diam {neck} x Diam {body} x H {h} cm"',
        table_csv="rim,neck,body,h\n11.1,10,10.3,5.5\n",
    )
    assert result.items[0].extents_mm == (111, 111, 55)


def test_other_formats_properties_and_yaml(tmp_path: Path) -> None:
    result = made_up(
        tmp_path,
        """
        [[tables]]
        files = ["table.properties"]
        format = "properties"
        unit = "cm"
        category = ["{name}"]
        axes = { width = "width" }

        [[tables]]
        files = ["*.yml"]
        format = "yaml"
        each = ""
        unit = "m"
        id = "{file}"
        category = ["airplane"]
        axes = { length = "hull.length" }
        """,
        table_properties="# made up\nname#1=Stool\nwidth#1=33\nname#2=Sofa\nwidth#2=210\n",
        b999_yml="aircraft: Made-up 999\nhull:\n  length: 31.5\n",
    )
    assert [(item.category_path[0], item.extents_mm) for item in result.items] == [
        ("Stool", (330,)),
        ("Sofa", (2100,)),
        ("airplane", (31500,)),
    ]
    assert result.items[2].source_id == "b999"


def test_a_table_that_is_not_of_its_encoding_or_not_there_is_named(tmp_path: Path) -> None:
    declaration = '[[tables]]\nfiles = ["table.csv"]\nunit = "mm"\ncategory = ["box"]\naxes = { width = "w" }'
    with pytest.raises(BadTable, match=r"expected table\.csv; found no such file"):
        made_up(tmp_path, declaration)
    (tmp_path / "table.csv").write_bytes("w,wo\n3,Zürich\n".encode("latin-1"))
    with pytest.raises(BadTable, match=r"table\.csv: expected csv in utf-8-sig; found"):
        made_up(tmp_path, declaration)
    result = made_up(tmp_path, declaration.replace("unit", 'encoding = "latin-1"\nunit'))
    assert sizes(result) == [{"width": 3}]


@pytest.mark.parametrize(
    ("name", "form", "damage"),
    [
        ("table.csv", "csv", b""),
        ("table.csv", "csv", b"w,\xff\xfe\n1,2\n"),
        ("table.json", "json", b'[{"w": 3}, {"w"'),
        ("table.json", "json", b"17"),
        ("table.jsonl", "jsonl", b'{"w": 3}\nnot json\n'),
        ("table.yml", "yaml", b"a: [1, 2\nb: }"),
        ("table.xls", "xls", b"PK\x03\x04 no old Excel file"),
        ("table.xls", "xls", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1 cut short"),
    ],
)
def test_a_damaged_file_is_one_clear_line(tmp_path: Path, name: str, form: str, damage: bytes) -> None:
    (tmp_path / name).write_bytes(damage)
    with pytest.raises(BadTable, match=f"{name}: expected .*; found ") as caught:
        made_up(tmp_path, f'[[tables]]\nfiles = ["{name}"]\nformat = "{form}"\nunit = "mm"\naxes = {{ width = "w" }}')
    assert "\n" not in str(caught.value)


WEIGHED = """
[[tables]]
files = ["table.csv"]
unit = "mm"
category = ["{object}"]
axes = { height = "h" }
mass_kg = { column = "grams", factor = 0.001 }
volume_l = { column = "litres" }
"""


def test_rows_state_mass_and_volume_where_they_have_them(tmp_path: Path) -> None:
    head = "object,h,grams,litres\n"
    rows = "coin,20,7.08,\nbox,30,N/A,45.6\npan,40,0,inf\njar,50,900,1\njar,50,950,1\ncup,60,300,.2\ncup,60,300,.2\n"
    items = made_up(tmp_path, WEIGHED, table_csv=head + rows).items
    amounts = {item.category_path[0]: (item.mass_kg, item.volume_l) for item in items}
    # equal jars with two masses are one item, which has none
    assert amounts == {
        "coin": (0.00708, None), "box": (None, 45.6), "pan": (None, None), "jar": (None, None), "cup": (0.3, 0.2),
    }  # fmt: skip
    assert '"mass_kg": 0.00708' in items[0].line()
    assert "volume_l" not in items[0].line()
    assert RawItem.from_line(items[0].line()) == items[0]


MEASURED = r"""
[[tables]]
files = ["table.csv"]
unit = "mm"
id = "{no}"
category = ["{object}"]
scene = "{room}"
statistic = "{statistic}"
relative_sd = "{sd}"
attribution = "{who}"
kind = "{kind}"
axes = { height = "h" }
read.room = { column = "{no}", cases = [["^(scene\\d+)_", "scans/\\1"]] }
"""


def test_rows_of_measured_objects_say_their_scene_and_whether_they_are_a_statistic(tmp_path: Path) -> None:
    head = "no,object,h,statistic,sd,who,kind\n"
    rows = head + "scene1_00/4,chair,800,instance,,A,measured\n7,man,1750,mean,0.04,,standard\n"
    chair, man = made_up(tmp_path, MEASURED, table_csv=rows).items
    assert (chair.scene, chair.statistic, chair.attribution, chair.kind) == ("scans/scene1", None, "A", "measured")
    assert (man.scene, man.statistic, man.relative_sd, man.kind) == (None, "mean", 0.04, "standard")

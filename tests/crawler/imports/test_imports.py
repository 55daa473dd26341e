"""One small made-up table for each way in which open data trap their reader."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from crawler.imports import Import, import_items, readings
from crawler.imports.rows import BadTable
from crawler.imports.source_files import source_folder
from crawler.imports.sources import source
from crawler.items import RawItem

HEAD = """
id = "made_up"
title = "Made-up things"
url = "https://example.org"
licence = "CC0-1.0"
licence_basis = "we made them up"
attribution = "us"
kind = "product"
year = 2001
region = "NO"
ship = true
"""


def made_up(folder: Path, declaration: str, **files: str) -> Import:
    """The import of files written for the occasion; `things_csv` becomes `things.csv`."""
    for name, text in files.items():
        folder.joinpath(".".join(name.rsplit("_", 1))).write_text(text, encoding="utf-8")
    (folder / "made_up.toml").write_text(HEAD + declaration, encoding="utf-8")
    declared = source("made_up", folder)
    return import_items(declared, readings(declared, folder))


def sizes(result: Import) -> list[dict[str, float]]:
    return [{axis: value for axis, value in item.dimensions_mm.items() if value} for item in result.items]


def reasons(result: Import) -> list[tuple[str, str]]:
    return [(refusal.reason, refusal.field) for refusal in result.refusals]


def test_semicolons_decimal_commas_and_missing_axes(tmp_path: Path) -> None:
    result = made_up(
        tmp_path,
        """
        [[tables]]
        files = ["things.csv"]
        delimiter = ";"
        decimal = ","
        unit = "cm"
        id = "{no}"
        title = "{name}: {what}"
        category = ["{room}", "{what|head}"]
        axes = { width = "w", depth = "d", height = "h" }
        """,
        things_csv="no;name;room;what;w;d;h\n7;BORG;Kitchen;Bar stool, oak, 40 cm;40,5;;98\n"
        "8;BORG;Kitchen;Bar stool;;;\n",
    )
    (stool,) = result.items
    assert stool.dimensions_mm == {"length": None, "width": 405, "height": 980, "diameter": None, "depth": None}
    assert stool.extents_mm == (980, 405)
    assert stool.category_path == ("Kitchen", "Bar stool")
    assert (stool.source_id, stool.year, stool.region, stool.licence) == ("7", 2001, "NO", "CC0-1.0")
    assert reasons(result) == [("no_size", "dimensions")]
    assert result.refusals[0].row == "things:2"


def test_a_table_without_header_in_inches(tmp_path: Path) -> None:
    result = made_up(
        tmp_path,
        '[[tables]]\nfiles = ["things.csv"]\ncolumns = ["width", "depth", "height"]\nunit = "in"\n'
        'category = ["chair"]\n'
        "bounds_mm = [100, 1150]",
        things_csv="20,18,35\n47.2,23,29\n",
    )
    assert sizes(result) == [{"width": 508.0, "depth": 457.2, "height": 889.0}]
    assert reasons(result) == [("out_of_bounds", "extents_mm")]


def test_a_constant_column_that_is_no_axis_word_is_left_out(tmp_path: Path) -> None:
    result = made_up(
        tmp_path,
        '[[tables]]\nfiles = ["things.csv"]\ncolumns = ["width", "thickness", "height"]\n'
        'unit = "mm"\ncategory = ["door"]',
        things_csv="762,50,1981\n",
    )
    assert sizes(result) == [{"width": 762, "height": 1981}]


def test_nested_json_of_a_box_with_y_up(tmp_path: Path) -> None:
    shelf = {"assetId": "TallShelf_3", "box": {"x": 0.8, "y": 1.9, "z": 0.3}}
    result = made_up(
        tmp_path,
        """
        [[tables]]
        files = ["things.json"]
        format = "json"
        each = "*/*"
        unit = "m"
        id = "{assetId}"
        title = "{assetId|words}"
        category = ["{key|words}"]
        axes = { width = "box.x", height = "box.y", depth = "box.z" }
        """,
        things_json=json.dumps({"BookShelf": [shelf]}),
    )
    (item,) = result.items
    assert item.category_path == ("book shelf",)
    assert item.title == "tall shelf 3"
    assert item.dimensions_mm["height"] == 1900


def test_the_two_sides_of_a_box_give_its_length(tmp_path: Path) -> None:
    result = made_up(
        tmp_path,
        '[[tables]]\nfiles = ["things.jsonl"]\nformat = "jsonl"\nunit = "m"\ncategory = ["crate"]\nsynset = "{wnid}"\n'
        '[tables.axes]\nwidth = { column = "right", minus = "left" }\n[tables.names.wnid]\nn1 = "crate.n.01"',
        things_jsonl='{"right": 0.25, "left": -0.35, "wnid": "n1"}\n{"right": "?", "left": 1, "wnid": "n1"}\n',
    )
    assert sizes(result) == [{"width": 600}]
    assert result.items[0].synset == "crate.n.01"
    assert reasons(result) == [("unreadable", "right")]


def test_units_in_the_cell_win_over_the_declared_one(tmp_path: Path) -> None:
    result = made_up(
        tmp_path,
        '[[tables]]\nfiles = ["things.csv"]\nunit = "mm"\ncategory = ["car"]\naxes = { length = "l", width = "w" }\n'
        "bounds_mm = [1000, 7000]",
        things_csv='l,w\n"4,640 mm",184.5 cm\n4.64 mm,1.8 m\nlong,1.8 m\n',
    )
    assert sizes(result) == [{"length": 4640, "width": 1845}]
    assert reasons(result) == [("out_of_bounds", "extents_mm"), ("unreadable", "l")]


def test_an_odd_unit_is_a_factor_and_zero_is_missing(tmp_path: Path) -> None:
    result = made_up(
        tmp_path,
        '[[tables]]\nfiles = ["things.csv"]\nunit = "mm"\ncategory = ["shell"]\n'
        'axes = { length = { column = "l", factor = 200 }, height = { column = "h", factor = 200 } }',
        things_csv="l,h\n0.5,0\n",
    )
    assert sizes(result) == [{"length": 100}]


def test_a_size_in_one_text_ranges_states_and_order(tmp_path: Path) -> None:
    result = made_up(
        tmp_path,
        """
        [[tables]]
        files = ["things.csv"]
        unit = "mm"
        category = ["telephone"]
        text = "{size}"
        order = ["height", "width", "depth"]
        reject = [{ column = "size", matches = "fold", outcome = "several_states" }]
        """,
        things_csv='size\n"150 x 70 x 8 mm (5.9 x 2.8 x 0.3 in)"\n"150 x 70 x 8-12 mm, 88 cc"\n'
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
        files = ["things.csv"]
        unit = "in"
        category = ["{trail}"]
        category_separator = "|"
        text = "{spec}"
        text_pattern = "Dimensions: *([\\\\d. x]+inches)"
        labelled = false
        flag = [{ column = "trail", matches = "^toys", outcome = "suspect_package" }]
        """,
        things_csv="trail,spec\nToys | Puzzles,Weight: 9 pounds|Dimensions:8x0x2.5inches|Weight: 3\n",
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
        files = ["things.csv"]
        unit = "cm"
        category = ["table"]
        only = [{ column = "{d}|{what}", matches = "^\\\\|.* \\\\d+x\\\\d+ cm" }]
        axes = { length = { column = "what", pattern = "(\\\\d+)x\\\\d+ cm" }, width = "w" }

        [[tables]]
        files = ["things.csv"]
        unit = "cm"
        category = ["table"]
        only = [{ column = "{d}|{what}", matches = "^(?!\\\\|.* \\\\d+x\\\\d+ cm)" }]
        axes = { width = "w", depth = "d" }
        """,
        things_csv='what,w,d\n"Table, 120x60 cm",60,\n"Table, 120x60 cm",120,60\n',
    )
    assert sizes(result) == [{"length": 1200, "width": 600}, {"width": 1200, "depth": 600}]


def test_rows_are_told_apart_refused_and_flagged_by_rules(tmp_path: Path) -> None:
    result = made_up(
        tmp_path,
        """
        [[tables]]
        files = ["things.csv"]
        unit = "mm"
        category = ["piano", "digital piano"]
        only = [{ column = "h", below = 300 }]
        axes = { height = "h" }

        [[tables]]
        files = ["things.csv"]
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
        things_csv="h,what\n90,keys\n1200,upright\n1200,Cover\n1300,pair\n",
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
        files = ["things.csv"]
        unit = "cm"
        category = ["{what}", "{thing}"]
        axes = { height = "h" }
        [tables.read.thing]
        column = "{what}: {text}"
        default = "{what}"
        cases = [["^lamp: .*pendant", "pendant lamp"], ["^lamp: .*floor", "floor lamp"]]
        """,
        things_csv="what,text,h\nlamp,A Pendant for the floor,40\nlamp,floor lamp,150\nchair,pendant,80\n",
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
    assert [refusal.row for refusal in result.refusals] == ["heads:1", "heads:2"]


def test_a_diameter_counts_twice_and_the_widest_of_several_wins(tmp_path: Path) -> None:
    result = made_up(
        tmp_path,
        '[[tables]]\nfiles = ["things.csv"]\ncategory = ["cup"]\n'
        'text = "Diam {rim} x Diam {neck} x Diam {body} x H {h} cm"',
        things_csv="rim,neck,body,h\n11.1,10,10.3,5.5\n",
    )
    assert result.items[0].extents_mm == (111, 111, 55)


def test_other_formats_properties_and_yaml(tmp_path: Path) -> None:
    result = made_up(
        tmp_path,
        """
        [[tables]]
        files = ["things.properties"]
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
        things_properties="# made up\nname#1=Stool\nwidth#1=33\nname#2=Sofa\nwidth#2=210\n",
        b999_yml="aircraft: Made-up 999\nhull:\n  length: 31.5\n",
    )
    assert [(item.category_path[0], item.extents_mm) for item in result.items] == [
        ("Stool", (330,)),
        ("Sofa", (2100,)),
        ("airplane", (31500,)),
    ]
    assert result.items[2].source_id == "b999"


def test_a_table_that_is_not_of_its_encoding_or_not_there_is_named(tmp_path: Path) -> None:
    declaration = '[[tables]]\nfiles = ["things.csv"]\nunit = "mm"\ncategory = ["box"]\naxes = { width = "w" }'
    with pytest.raises(BadTable, match=r"expected things\.csv; found no such file"):
        made_up(tmp_path, declaration)
    (tmp_path / "things.csv").write_bytes("w,wo\n3,Zürich\n".encode("latin-1"))
    with pytest.raises(BadTable, match=r"things\.csv: expected csv in utf-8-sig; found"):
        made_up(tmp_path, declaration)
    result = made_up(tmp_path, declaration.replace("unit", 'encoding = "latin-1"\nunit'))
    assert sizes(result) == [{"width": 3}]


@pytest.mark.parametrize(
    ("name", "form", "damage"),
    [
        ("things.csv", "csv", b""),
        ("things.csv", "csv", b"w,\xff\xfe\n1,2\n"),
        ("things.json", "json", b'[{"w": 3}, {"w"'),
        ("things.json", "json", b"17"),
        ("things.jsonl", "jsonl", b'{"w": 3}\nnot json\n'),
        ("things.yml", "yaml", b"a: [1, 2\nb: }"),
        ("things.xls", "xls", b"PK\x03\x04 no old Excel file"),
        ("things.xls", "xls", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1 cut short"),
    ],
)
def test_a_damaged_file_is_one_clear_line(tmp_path: Path, name: str, form: str, damage: bytes) -> None:
    (tmp_path / name).write_bytes(damage)
    with pytest.raises(BadTable, match=f"{name}: expected .*; found ") as caught:
        made_up(tmp_path, f'[[tables]]\nfiles = ["{name}"]\nformat = "{form}"\nunit = "mm"\naxes = {{ width = "w" }}')
    assert "\n" not in str(caught.value)


REPEATED = """
[[tables]]
files = ["things.csv"]
unit = "mm"
id = "{no}"
title = "{name}"
category = ["laptop"]
axes = { width = "w" }
"""


def test_identical_rows_become_one_with_their_number_and_ids_stay_unique(tmp_path: Path) -> None:
    rows = "no,name,w\n1,A,300\n2,A,300\n3,A,310\n3,B,300\n"
    result = made_up(tmp_path, REPEATED, things_csv=rows)
    assert [(item.source_id, item.count) for item in result.items] == [("1", 2), ("3", 1), ("3#2", 1)]
    kept = made_up(tmp_path, "collapse = false\n" + REPEATED, things_csv=rows)
    assert [item.count for item in kept.items] == [1, 1, 1, 1]


def test_of_several_sizes_under_one_title_the_middle_one_stands_for_all(tmp_path: Path) -> None:
    rows = "no,name,w\n1,A,900\n2,A,300\n3,A,310\n"
    result = made_up(tmp_path, "one_per_title = true\n" + REPEATED, things_csv=rows)
    assert [(item.source_id, item.count) for item in result.items] == [("3", 3)]


def test_a_large_category_is_drawn_down_the_same_way_every_time(tmp_path: Path) -> None:
    rows = "no,name,w\n" + "".join(f"{n},N{n},{300 + n}\n" for n in range(50))
    result = made_up(tmp_path, "per_category = 10\n" + REPEATED, things_csv=rows)
    assert (len(result.items), result.n_sampled_out, result.n_rows) == (10, 40, 50)
    assert all(item.flags == ("sampled",) for item in result.items)
    backwards = "no,name,w\n" + "".join(f"{n},N{n},{300 + n}\n" for n in reversed(range(50)))
    again = made_up(tmp_path, "per_category = 10\n" + REPEATED, things_csv=backwards)
    assert {item.source_id for item in again.items} == {item.source_id for item in result.items}


def test_an_excluded_source_has_no_items(tmp_path: Path) -> None:
    result = made_up(tmp_path, 'excluded = "parcels, not things"')
    assert (result.items, result.refusals, result.n_rows) == ((), (), 0)


def walters(folder: Path, *objects: dict[str, Any]) -> Import:
    blank = {"ObjectName": "vases", "Title": "Vase", "Classification": "Ceramics", "DateText": "ca. 1710"}
    lines = [json.dumps(blank | {"ObjectID": n} | given) for n, given in enumerate(objects)]
    (folder / "walters_dims.jsonl").write_text("\n".join(lines), encoding="utf-8")
    declared = source("walters")
    return import_items(declared, readings(declared, folder))


def test_museum_sentences(tmp_path: Path) -> None:
    result = walters(
        tmp_path,
        {"Dimensions": "H: 12 1/2 x Max. Diam: 6 in. (31.8 x 15.2 cm); Diam at rim: 3 in. (7.6 cm)"},
        {"Dimensions": "2 x 10 in. (5.1 x 25.4 cm) (h. x max. diam.)"},
        {"Dimensions": "Bezel H: 1/2 in. (1.3 cm); Ring H: 1 in. (2.5 cm)", "ObjectName": "finger rings; jewelry"},
        {"Dimensions": "15/16 x 2 1/2 in. (2.4 x 6.4 cm)"},
        {"Dimensions": "H with handles: 8 in. (20.3 cm)", "ObjectName": "boxes (containers)"},
        {"Dimensions": "H: 8 x Diam at base: 12 in. (20.3 x 30.5 cm)"},
        {"Dimensions": "H without mount: 2 x W: 1 in. (5.1 x 2.5 cm); Mount H: 9 in. (22.9 cm)"},
    )
    assert sizes(result) == [
        {"height": 317.5, "diameter": 152.4},
        {"height": 50.8, "diameter": 254.0},
        {"height": 25.4},
        {},
        {"height": 203.2},
        {"height": 203.2},
        {"height": 50.8, "width": 25.4},
    ]
    assert result.items[3].extents_mm == (63.5, 23.812)
    assert result.items[2].category_path == ("Ceramics", "finger rings")
    assert result.items[4].category_path == ("Ceramics", "boxes")
    assert result.items[0].year == 1710


def test_museum_sheets_parts_and_silences_are_refused(tmp_path: Path) -> None:
    result = walters(
        tmp_path,
        {"Dimensions": "H: 9 x W: 6 in.", "ObjectName": "illuminated manuscripts; folios (leaves)"},
        {"Dimensions": "H: 9 x W: 6 in.", "Classification": "Prints"},
        {"Dimensions": "H: 9 in.", "ObjectName": "figures; fragments"},
        {"Dimensions": "Diam of medallion: 2 in."},
        {"Dimensions": None},
        {"Dimensions": "unknown"},
        {"Dimensions": "H: 9 in.", "ObjectName": None},
    )
    assert [reason for reason, _ in reasons(result)] == [
        "flat_picture",
        "flat_picture",
        "part_not_whole",
        "part_not_whole",
        "no_size",
        "unreadable",
        "no_category",
    ]


def test_tables_of_a_standard_part(tmp_path: Path) -> None:
    (tmp_path / "made.blt").write_text(
        """
classes:
  - id: hexagonnut9
    names: {name: Made-up nut}
    parameters:
      types: {s: Length (in), m_max: Length (in)}
      tables:
        - {index: key, columns: [s, m_max], data: {"1/2 in": [0.75, 0.4375]}}
        - {index: type, columns: [finish], data: {black: ["BK"]}}
  - id: ibeam_made_up
    parameters:
      types: {h: Length (mm)}
      tables: {index: key, columns: [h], data: {"I100": [100]}}
""",
        encoding="utf-8",
    )
    declared = source("bolts")
    result = import_items(declared, readings(declared, tmp_path))
    assert sizes(result) == [{"width": 19.05, "height": 11.112}]
    assert result.items[0].title == "Made-up nut 1/2 in"
    assert reasons(result) == [("part_not_whole", "class")]


@pytest.mark.parametrize("damage", ["classes: 3", "[1, 2", ""])
def test_a_damaged_table_of_standard_parts_is_one_clear_line(tmp_path: Path, damage: str) -> None:
    (tmp_path / "made.blt").write_text(damage, encoding="utf-8")
    with pytest.raises(BadTable, match=r"made\.blt: .*expected .*; found "):
        list(readings(source("bolts"), tmp_path))


def test_every_item_is_a_raw_item_that_survives_its_line(tmp_path: Path) -> None:
    result = made_up(tmp_path, REPEATED, things_csv="no,name,w\n1,Ä Ö “x”,300\n")
    assert [RawItem.from_line(item.line()) for item in result.items] == list(result.items)


RECORDS = """
[[tables]]
files = ["things.jsonl"]
records = "things/*.json"
format = "jsonl"
unit = "cm"
id = "{no}"
category = ["box"]
axes = { width = "w" }
"""


def test_the_records_of_a_repository_stand_for_the_file_made_of_them(tmp_path: Path) -> None:
    records = [{"no": "2", "w": "4"}, {"no": "1", "w": None}, {"no": "3", "w": "5"}]
    joined, repository = tmp_path / "joined", tmp_path / "repository"
    joined.mkdir()
    (repository / "things").mkdir(parents=True)
    for name, record in zip("abc", records, strict=True):
        (repository / "things" / f"{name}.json").write_text(json.dumps(record, indent=2), encoding="utf-8")
    lines = "".join(json.dumps(record) + "\n" for record in records)
    of_file, of_folder = made_up(joined, RECORDS, things_jsonl=lines), made_up(repository, RECORDS)
    assert [item.source_id for item in of_folder.items] == ["2", "3"]
    assert (of_folder.items, of_folder.refusals) == (of_file.items, of_file.refusals)


def test_a_repository_with_a_folder_of_the_source_name_is_read_from_its_root(tmp_path: Path) -> None:
    (tmp_path / "made_up").mkdir()
    (tmp_path / "made_up.toml").write_text(HEAD + RECORDS.replace("things/*", "made_up/*"), encoding="utf-8")
    declared = source("made_up", tmp_path)
    assert source_folder(declared, tmp_path) == tmp_path / "made_up"
    (tmp_path / "made_up" / "a.json").write_text("{}", encoding="utf-8")
    assert source_folder(declared, tmp_path) == tmp_path


@pytest.mark.parametrize(
    ("record", "line"),
    [(None, "expected things.jsonl or things/*.json; found no such"), ("{", "a.json: expected json")],
)
def test_records_that_are_missing_or_none_are_named(tmp_path: Path, record: str | None, line: str) -> None:
    if record is not None:
        (tmp_path / "things").mkdir()
        (tmp_path / "things" / "a.json").write_text(record, encoding="utf-8")
    with pytest.raises(BadTable, match=re.escape(line)):
        made_up(tmp_path, RECORDS)


MEASURED = r"""
[[tables]]
files = ["things.csv"]
unit = "mm"
id = "{no}"
category = ["{thing}"]
scene = "{room}"
statistic = "{statistic}"
relative_sd = "{sd}"
attribution = "{who}"
kind = "{kind}"
axes = { height = "h" }
read.room = { column = "{no}", cases = [["^(scene\\d+)_", "scans/\\1"]] }
"""


def test_rows_of_measured_things_say_their_scene_and_whether_they_are_a_statistic(tmp_path: Path) -> None:
    rows = (
        "no,thing,h,statistic,sd,who,kind\nscene1_00/4,chair,800,instance,,A,measured\n7,man,1750,mean,0.04,,standard\n"
    )
    chair, man = made_up(tmp_path, MEASURED, things_csv=rows).items
    assert (chair.scene, chair.statistic, chair.attribution, chair.kind) == ("scans/scene1", None, "A", "measured")
    assert (man.scene, man.statistic, man.relative_sd, man.kind) == (None, "mean", 0.04, "standard")

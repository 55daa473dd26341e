from __future__ import annotations

import gzip
import json
import re
from importlib.util import find_spec
from pathlib import Path

import pytest

from crawler.imports.declaration import OPEN_LICENCES, REASONS, Source, UnknownSource, source, sources
from crawler.items import BadRawItem, RawItem, raw_items
from metric_base.errors import FieldError
from metric_base.records import BadDeclaration

ROOT = Path(__file__).resolve().parents[3]
SHA = "0" * 64

DECLARATION = f"""
id = "{{id}}"
title = "Made-up lamps"
url = "https://example.org/lamps"
licence = "CC0-1.0"
licence_basis = "we made them up"
attribution = "us"
kind = "measured"
ship = true

[[tables]]
files = ["lamps.csv"]
unit = "cm"
category = ["lamp"]
axes = {{{{ height = "h" }}}}

[[files]]
path = "lamps.csv"
sha256 = "{SHA}"
url = "https://example.org/lamps.csv"
"""


def declared(folder: Path, text: str = DECLARATION, name: str = "lamps") -> Source:
    (folder / f"{name}.toml").write_text(text.format(id=name), encoding="utf-8")
    return source(name, folder)


def test_a_declaration_is_read(tmp_path: Path) -> None:
    lamps = declared(tmp_path)
    assert (lamps.id, lamps.kind, lamps.ship, lamps.files[0].sha256) == ("lamps", "measured", True, SHA)
    assert lamps.tables[0].axes["height"].column == "h"


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ('id = "{id}"', 'id = "other"', "id"),
        ('kind = "measured"', 'kind = "guess"', "kind"),
        ('licence = "CC0-1.0"', 'licence = "GPL-3.0-or-later"', "ship"),
        ("ship = true", "ship = true\nnoncommercial = true", "ship"),
        ("ship = true", "ship = true\ncolour = 3", "colour: expected a known field"),
        ('attribution = "us"', "", "attribution"),
        ("ship = true", 'ship = true\nexcluded = "no objects"', "one of tables, reader, excluded"),
        ('unit = "cm"', 'unit = "cubit"', "tables[0].unit"),
        ('unit = "cm"', 'unit = "cm"\nshade = "red"', "tables"),
        ("height = ", "girth = ", "tables[0].axes"),
        ('unit = "cm"', "", "tables[0].unit"),
        ('category = ["lamp"]', 'category = ["lamp"]\nrefused = "dull"', "tables[0].reject"),
        (
            'category = ["lamp"]',
            'category = ["lamp"]\nreject = [{{ column = "h", matches = "(", outcome = "no_size" }}]',
            "reject[0].matches: expected a regular expression",
        ),
        ('category = ["lamp"]', 'category = ["lamp"]\nreject = [{{ column = "h", outcome = "no_size" }}]', "rule"),
        (SHA, "abc", "files[0].sha256"),
        ('path = "lamps.csv"', 'path = "../../x"', "files[0].path: expected a path inside"),
        ('path = "lamps.csv"', 'path = "/etc/passwd"', "files[0].path: expected a path inside"),
        ('["lamps.csv"]', '["../*.csv"]', "tables[0].files: expected a path inside"),
        ('url = "https://example.org/lamps.csv"', "", "files[0].url"),
        ('url = "https://example.org/lamps.csv"', 'note = "drawn by hand"', "fetch"),
        (
            'url = "https://example.org/lamps.csv"',
            'url = "https://example.org/x"\nform = "tar"',
            "files[0].form: expected one of json-line, ",
        ),
        ('title = "Made-up lamps"', "title = ", "found"),
    ],
)
def test_an_error_of_a_declaration_is_named_at_the_door(tmp_path: Path, old: str, new: str, field: str) -> None:
    assert old in DECLARATION
    with pytest.raises(BadDeclaration, match=f"lamps.toml: .*{re.escape(field)}"):
        declared(tmp_path, DECLARATION.replace(old, new))


def test_all_missing_fields_are_named_at_once(tmp_path: Path) -> None:
    (tmp_path / "lamps.toml").write_text('id = "lamps"\nkind = "measured"\n', encoding="utf-8")
    with pytest.raises(BadDeclaration, match=r"found no title, url, licence, licence_basis, ship$"):
        source("lamps", tmp_path)


def test_a_rule_may_name_a_file_of_texts(tmp_path: Path) -> None:
    listed = 'category = ["lamp"]\nreject = [{{ column = "no", listed = "gone.txt", outcome = "superseded" }}]'
    text = DECLARATION.replace('category = ["lamp"]', listed)
    with pytest.raises(BadDeclaration, match=r"gone.txt: file: expected a readable file"):
        declared(tmp_path, text)
    (tmp_path / "gone.txt").write_text("1\n3\n", encoding="utf-8")
    assert declared(tmp_path, text).tables[0].reject[0].texts == {"1", "3"}


def test_an_unknown_source_names_those_there_are(tmp_path: Path) -> None:
    declared(tmp_path)
    with pytest.raises(UnknownSource, match="expected one of lamps; found 'lamp'"):
        source("lamp", tmp_path)


def test_all_declarations_pass_the_door() -> None:
    assert len(sources()) >= 38
    assert [s.id for s in sources()] == sorted(s.id for s in sources())


@pytest.mark.parametrize("one", sources(), ids=lambda s: s.id)
def test_a_source_says_whose_terms_hold_and_what_is_done_about_its_traps(one: Source) -> None:
    assert one.url.startswith("https://")
    assert len(one.licence_basis) > 20
    assert one.traps
    assert one.files or one.fetch
    assert all(re.fullmatch(r"[0-9a-f]{64}", file.sha256) for file in one.files)
    assert all(file.url.startswith("https://") or file.note for file in one.files)
    assert one.fetch if one.downloads == "no" else one.address
    assert all("/HEAD/" not in file.url for file in one.files) or one.downloads == "while unchanged"
    assert not one.reader or find_spec(f"crawler.imports.{one.reader}")


def test_only_open_licences_ship_and_no_copyleft_is_open() -> None:
    assert not any(re.search("GPL|EPL|NC|SA", licence) for licence in OPEN_LICENCES)
    for name in (
        "ikea_sa_2020",
        "gsmarena_2021",
        "ev_specs_2025",
        "3dfuture_respace",
        "amazon_us_2020_sample",
        "bolts",
    ):
        assert not source(name).ship
    assert source("3dfuture_respace").noncommercial


def test_the_shipped_items_are_those_of_the_sources_that_ship() -> None:
    shipped = {path.name.removesuffix(".jsonl.gz"): path for path in (ROOT / "data" / "raw").glob("*.jsonl.gz")}
    assert set(shipped) == {s.id for s in sources() if s.ship and s.files}  # a set without files was never at hand
    assert sum(path.stat().st_size for path in shipped.values()) < 8_000_000
    for name, path in shipped.items():
        with gzip.open(path, "rt", encoding="utf-8") as lines:
            first = RawItem.from_line(next(lines))
        assert first.source == name
        assert first.licence in (source(name).licence or "").split(" AND ")


def test_the_page_of_sources_lists_every_source_and_reason() -> None:
    page = (ROOT / "data" / "sources" / "README.md").read_text(encoding="utf-8")
    assert all(f"[{s.id}]({s.url})" in page for s in sources())
    assert all(f"`{code}`" in page for code in REASONS)


def test_a_region_is_a_country_or_one_of_the_list() -> None:
    assert RawItem(source="a", source_id="1", region="europe").region == "europe"
    with pytest.raises(FieldError, match="region: expected two letters"):
        RawItem(source="a", source_id="1", region="Central Europe")


def test_fields_of_measured_objects_are_in_a_line_only_where_they_are_set() -> None:
    bare = RawItem(source="a", source_id="1")
    assert not {"scene", "statistic", "relative_sd", "attribution"} & set(json.loads(bare.line()))
    full = RawItem(
        source="a", source_id="1", scene="room/1", statistic="mean", relative_sd=0.04, attribution="A. Nyone"
    )
    assert RawItem.from_line(full.line()) == full
    with pytest.raises(FieldError, match="mass_kg, volume_l: expected positive numbers, found"):
        RawItem(source="a", source_id="1", mass_kg=-1.0)
    with pytest.raises(FieldError, match="statistic: expected one of max, mean, median, min"):
        RawItem(source="a", source_id="1", statistic="sd")  # type: ignore[arg-type]


def test_a_row_without_a_page_of_its_own_has_that_of_its_file_or_its_set(tmp_path: Path) -> None:
    assert declared(tmp_path).page == "https://example.org/lamps.csv"
    raw = "https://raw.githubusercontent.com/a/b/0123abc/data/lamps.csv"
    text = DECLARATION.replace("https://example.org/lamps.csv", raw)
    assert declared(tmp_path, text).page == "https://github.com/a/b/blob/0123abc/data/lamps.csv"
    text = DECLARATION.replace('url = "https://example.org/lamps.csv"', 'note = "typed"')
    text = text.replace('kind = "measured"', 'kind = "measured"\nfetch = "lamps.csv"')
    assert declared(tmp_path, text).page == "https://example.org/lamps"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": "metric-tree/raw/9"}, "schema: expected metric-tree/raw/1, found 'metric-tree/raw/9'"),
        ({"source": ""}, "source: expected a name"),
        ({"kind": "guess"}, "kind: expected one of asset, curated, default, judged"),
        ({"year": "2001"}, "year: expected int | null, found str"),
        ({"extents_mm": [1, -2]}, "dimensions_mm: expected positive lengths"),
        ({"dimensions_mm": {"length": "long"}}, "dimensions_mm[...]: expected float | null, found str"),
    ],
)
def test_a_bad_raw_item_is_named_with_its_line(tmp_path: Path, change: dict[str, object], message: str) -> None:
    record = {"schema": "metric-tree/raw/1", "source": "a", "source_id": "1"}
    file = tmp_path / "raw.jsonl"
    file.write_text(f"{json.dumps(record)}\n\n{json.dumps(record | change)}\n", encoding="utf-8")
    items = raw_items(file)
    assert next(items).identity == "a:1"
    with pytest.raises(BadRawItem, match=re.escape(f"raw.jsonl:3: {message}")):
        next(items)

"""Listings of Amazon Berkeley Objects, written after the set's own README: its field names, forms and units."""

from __future__ import annotations

import gzip
import io
import json
import tarfile
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

from crawler.imports import Import, import_source, row_items
from crawler.imports.declaration import source
from crawler.imports.table_files import BadTable
from tests.crawler.imports.invented_tables import reasons, sizes


def axis(value: float, unit: str = "inches", inches: float | None = None) -> dict[str, Any]:
    return {"value": value, "unit": unit, "normalized_value": {"value": inches or value, "unit": "inches"}}


def listing(item_id: str, code: str = "CHAIR", **fields: Any) -> dict[str, Any]:
    return {
        "item_id": item_id,
        "domain_name": "amazon.com",
        "country": "US",
        "product_type": [{"value": code}],
        "item_name": [{"language_tag": "en_US", "value": "Oak chair"}],
        "item_dimensions": {"height": axis(30), "length": axis(20), "width": axis(18)},
        "node": [{"node_id": 1, "node_name": "/Categories/Chairs"}],
    } | fields


def imported(folder: Path, *listings: dict[str, Any]) -> Import:
    metadata = folder / "listings" / "metadata"
    metadata.mkdir(parents=True)
    lines = "".join(f"{json.dumps(one)}\n" for one in listings).encode()
    (metadata / "listings_0.json.gz").write_bytes(gzip.compress(lines))
    declared = source("abo")
    return import_source(declared, folder)


def test_sizes_titles_and_categories_in_every_language(tmp_path: Path) -> None:
    german = [{"language_tag": "de_DE", "value": "Bürostuhl"}]
    both = [*german, {"language_tag": "en_GB", "value": "Office chair"}]
    result = imported(
        tmp_path,
        listing("A1"),
        listing("A2", item_name=both, domain_name="amazon.de", country="DE"),
        listing("A3", "CELLULAR_PHONE_CASE", item_name=german, item_dimensions={"length": axis(15.24, "cm", 6.0)}),
        listing("A4", item_dimensions={"height": {"value": 80, "unit": "centimeters"}}),
    )
    assert sizes(result) == [
        {"length": 508.0, "width": 457.2, "height": 762.0},
        {"length": 508.0, "width": 457.2, "height": 762.0},
        {"length": 152.4},
        {"height": 800.0},
    ]
    assert [one.title for one in result.items] == ["Oak chair", "Office chair", "Bürostuhl", "Oak chair"]
    assert [one.category_path for one in result.items][1:3] == [("chair",), ("cellular phone case",)]
    assert result.items[1].url == "https://www.amazon.de/dp/A2"
    assert (result.items[1].region, result.items[1].licence) == ("DE", "CC-BY-NC-4.0")


def test_what_is_no_objects_size_is_refused(tmp_path: Path) -> None:
    ones = {name: axis(1) for name in ("length", "width", "height")}
    result = imported(
        tmp_path,
        listing("B1"),
        listing("B1", domain_name="amazon.ca"),
        listing("B2", "GROCERY"),
        listing("B3", item_dimensions=None),
        listing("B4", item_dimensions=ones),
        listing("B5", item_dimensions={"height": axis(3, "pixels") | {"normalized_value": None}}),
        listing("B6", item_dimensions={"height": axis(30), "length": axis(9000)}),
        listing("B7", product_type=[]),
    )
    assert [one.source_id for one in result.items] == ["B1"]
    assert [reason for reason, _ in reasons(result)] == [
        "superseded", "not_an_object", "no_size", "marked_unusable", "unreadable", "out_of_bounds", "no_category",
    ]  # fmt: skip


def test_the_published_archive_and_damaged_files(tmp_path: Path) -> None:
    declared, archive = source("abo"), tmp_path / "abo-listings.tar"
    lines = gzip.compress(json.dumps(listing("C1")).encode())
    with tarfile.open(archive, "w") as tar:
        for name in ("listings/metadata/listings_a.json.gz", "listings/README.md"):
            entry = tarfile.TarInfo(name)
            entry.size = len(lines)
            tar.addfile(entry, io.BytesIO(lines))
    assert [one.source_id for one in import_source(declared, archive).items] == ["C1"]
    deep, half = b'{"a":' + b"[" * 200_000, b'{"item_id": "\\ud800"}\n'
    broken = (lines[:-9], b"[1]\n", b"{\n", deep, half)
    for name, data in zip(("listings_0.json.gz", *(f"listings_{k}.json" for k in range(1, 5))), broken, strict=True):
        (damaged := tmp_path / name).write_bytes(data)
        with pytest.raises(BadTable):
            list(row_items(declared, damaged))
    (empty := tmp_path / "listings_6.json.gz").write_bytes(gzip.compress(b"\n" * 1_000_000 + lines))
    with pytest.raises(BadTable, match="1000 empty lines in a row"):
        list(row_items(declared, empty))
    with pytest.raises(BadTable, match="no such file"):
        list(row_items(declared, tmp_path / "none"))


@pytest.mark.parametrize("value", ["NaN", "Infinity", "-1e308", "1" + "0" * 400])
def test_a_number_that_is_no_length_is_a_refused_row(tmp_path: Path, value: str) -> None:
    lines = [json.dumps(listing("A1")), json.dumps(listing("A2")).replace('"value": 30', f'"value": {value}')]
    (tmp_path / "listings_1.json").write_text("\n".join(lines))
    result = import_source(source("abo"), tmp_path)
    assert [one.source_id for one in result.items] == ["A1"]
    assert [reason for reason, _ in reasons(result)] == ["unreadable"]


def test_a_listing_without_id_has_that_of_its_line(tmp_path: Path) -> None:
    result = imported(tmp_path, listing("G1"), listing("", "DESK"))
    assert [one.source_id for one in result.items] == ["G1", "listings_0.json.gz:2"]


@pytest.mark.parametrize(
    ("sides", "is_filled_in"),
    [
        ((1.0, 1, 1.0), False),
        ((1.0, 1, 2.0), True),
        ((0.77, 1, 1), True),
        ((0.769231,) * 3, True),
        ((1.3,) * 3, True),
        ((1, 1), True),
    ],
)
def test_a_box_of_one_by_one_by_one_is_a_form_that_was_not_filled_in(
    sides: tuple[float, ...], is_filled_in: bool, tmp_path: Path
) -> None:
    stated = {name: axis(side) for name, side in zip(("length", "width", "height"), sides, strict=False)}
    assert bool(imported(tmp_path, listing("B1", item_dimensions=stated)).items) == is_filled_in


@pytest.mark.parametrize(("n", "is_read"), [(1000, True), (1001, False)])
def test_at_most_a_thousand_empty_lines_follow_each_other(n: int, is_read: bool, tmp_path: Path) -> None:
    text = json.dumps(listing("A1")) + "\n" * n + "\n" + json.dumps(listing("A2")) + "\n \n" + json.dumps(listing("A3"))
    (tmp_path / "listings_0.json").write_text(text)
    with nullcontext() if is_read else pytest.raises(BadTable, match="found 1000 empty lines in a row"):
        assert import_source(source("abo"), tmp_path).n_rows == 3


@pytest.mark.parametrize(("value", "reason"), [(9e8, "out_of_bounds"), (1e9, "unreadable"), (-1e9, "unreadable")])
def test_a_number_of_a_listing_is_below_a_billion(value: float, reason: str, tmp_path: Path) -> None:
    result = imported(tmp_path, listing("A1", item_dimensions={"height": axis(value, "millimeters")}))
    assert reasons(result)[0][0] == reason

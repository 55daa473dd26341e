"""The contact sheet: one scale for all, a true size bar, licences, and `metric-tree query --images --sheet`."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from metric_base.length_units import bar_length
from metric_cli.subcommands import main
from metric_tree.cutouts.backend import Settings
from metric_tree.cutouts.release_cutouts import cut_release
from metric_tree.reports.contact_sheet import (
    MARGIN,
    MAX_SIDE_PX,
    Tile,
    image_rows,
    scaled_image,
    sheet_image,
    spread_rows,
    tiles,
)
from metric_tree.tree import open_tree
from tests.synthetic.hostile_pictures import shop_picture
from tests.synthetic.picture_fixture import HOSTILE, release_with, wallpaper


@pytest.fixture(scope="module")
def release(tmp_path_factory):
    folder = tmp_path_factory.mktemp("release")
    old = release_with(
        folder / "old",
        [
            *(shop_picture(seed) for seed in range(20)),
            wallpaper(),
            HOSTILE["bomb: header of 50,000 x 50,000"][0],
        ],
    )
    return cut_release(old, folder / "new", Settings("plain"), version="1.0.0", created="2026-11-21")


def query(release, *words):
    return main(["query", *map(str, (*words, "--tree", release.directory))])


def test_query_draws_a_sheet_whose_bar_is_true(release, tmp_path, capsys):
    assert query(release, "furniture", "--images", 9, "--sheet", tmp_path / "sheet.png", "--json") == 0
    rows = json.loads(capsys.readouterr().out)["images"]
    assert len(rows) == 9
    assert all(row["licence"] == "CC0-1.0" and row["source_url"] for row in rows)
    mm_per_px = max(max(row["extents_mm"]) for row in rows) / MAX_SIDE_PX
    with Image.open(tmp_path / "sheet.png") as image:
        pixels = np.asarray(image.convert("L"))
    bar = np.flatnonzero(pixels[MARGIN + 50, : MARGIN + 240] < 50)
    bar = bar[: np.argmax(np.diff(bar, append=10_000) > 1) + 1]  # the text next to it is not included
    assert np.ptp(bar) * mm_per_px == pytest.approx(bar_length(mm_per_px), abs=4 * mm_per_px)
    assert [path.name for path in tmp_path.glob(".*")] == []


def test_objects_are_as_large_as_their_longest_extent(release, tmp_path, capsys):
    assert query(release, "swivel chair", "--images", 2, "--sheet", tmp_path / "sheet.png", "--json") == 0
    rows = json.loads(capsys.readouterr().out)["images"]
    longest = [max(row["extents_mm"]) for row in rows]
    with Image.open(tmp_path / "sheet.png") as image:
        pixels = np.asarray(image.convert("RGB")).astype(int)
    coloured = (pixels.max(axis=2) - pixels.min(axis=2) > 25).any(axis=0)  # the boxes; text and lines are grey
    starts = np.flatnonzero(np.diff(coloured.astype(int), prepend=0) == 1)
    ends = np.flatnonzero(np.diff(coloured.astype(int), append=0) == -1)
    widths = [end - start + 1 for start, end in zip(starts, ends, strict=True) if end - start > 20]
    assert len(widths) == 2
    assert widths[0] / widths[1] == pytest.approx(longest[0] / longest[1], rel=0.03)


def test_a_rendered_picture_has_its_own_scale_and_credit(tmp_path):
    """Two views of an object, the second narrow: each has the size given by its pixels per metre."""
    file = tmp_path / "a.png"
    Image.new("RGBA", (100, 50), "red").save(file)
    row = {"path": "a.png", "cutout_path": "a.png", "extents_mm": [300.0, 100.0], "title": "t", "source": "s"}
    row |= {"licence": "CC-BY-4.0", "attribution": "by Ada", "pixels_per_metre": 500.0}
    (rendered, cut) = tiles(tmp_path, [row, row | {"pixels_per_metre": None, "attribution": None}])
    assert scaled_image(rendered, 2.0).size == (100, 50)  # 200 mm
    assert scaled_image(cut, 2.0).size == (150, 75)  # 300 mm
    assert (rendered.credit, cut.credit) == ("by Ada", "s (CC-BY-4.0)")


def test_a_second_view_comes_after_one_of_each_item():
    rows = [{"item_id": item, "image_id": f"{item}{view}", "extents_mm": [100.0]} for item in "ab" for view in range(4)]
    assert [row["item_id"] for row in spread_rows(rows, 2)] == ["a", "b"]
    assert sorted(row["item_id"] for row in spread_rows(rows, 4)) == ["a", "a", "b", "b"]
    assert len({row["image_id"] for row in spread_rows(rows, 99)}) == 8


def test_cut_pictures_come_first_and_spread_over_sizes(release):
    node = open_tree(release.directory).find("entity")
    rows = image_rows(node, 22)
    assert [row["cutout_path"] is not None for row in rows] == [True] * 20 + [False] * 2
    few = [max(row["extents_mm"]) for row in image_rows(node, 3)]
    assert few == sorted(few)
    assert few[0] < few[-1]


def test_pictures_that_are_none_are_left_out_and_uncut_ones_framed(release, tmp_path, capsys):
    assert query(release, "entity", "--images", 40, "--sheet", tmp_path / "sheet.png") == 0
    capsys.readouterr()
    with Image.open(tmp_path / "sheet.png") as image:
        colours = {colour for _, colour in image.getcolors(1 << 24)}
    assert (0xCC, 0x88, 0x44) in colours


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("rat", "--sheet", "x.png"), "rat.n.01: expected pictures of items with a size; found none"),
        (("seat", "--sheet", "x.jpg"), "--sheet: expected a name that ends in .png; found x.jpg"),
        (("seat", "--images", "0"), "--images: expected a number from 1; found 0"),
    ],
)
def test_errors_are_one_line(release, words, message, capsys):
    assert query(release, *words) == 2
    assert message in capsys.readouterr().err


@given(st.floats(1e-3, 1e6))
def test_the_bar_is_round_and_fits(mm_per_px):
    length = bar_length(mm_per_px)
    assert 75 <= length / mm_per_px <= 200.001
    digits = f"{length:.10e}"[0]
    assert digits in "125"
    assert float(f"{length:.0e}") == pytest.approx(length)


def test_shelves_titles_and_small_objects_of_a_sheet(tmp_path):
    """Eight narrow objects are in a row, nine are not; a title of 20 letters is whole; a speck has 3 pixels."""
    Image.new("RGBA", (10, 100), "red").save(tmp_path / "a.png")
    tile = Tile(tmp_path / "a.png", True, 500.0, None, "t", "1 mm", "by Ada")
    row_of_objects = 340 + 46 + 30  # object, label, gap
    empty = 2 * 40 + 50 + 40 + 20
    assert [sheet_image([tile] * n, "").height - empty for n in (1, 8, 9)] == [
        row_of_objects,
        row_of_objects,
        2 * row_of_objects,
    ]
    drawn = {name: sheet_image([replace(tile, title=name)], "") for name in ("x" * 20, "x" * 21, "x" * 19 + "…")}
    assert drawn["x" * 21] == drawn["x" * 19 + "…"] != drawn["x" * 20]
    assert max(scaled_image(replace(tile, longest_mm=1.0), 1.0).size) == 3

"""Contents of pages and charts: which rows, charts and images a page shows, and the limits of each."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from explorer.catalogue import ReleaseCatalogue
from explorer.charts.axis import LogAxis, length_text
from explorer.charts.distributions import distribution, scatter
from explorer.charts.size_comparison import DrawnBox, size_comparison
from explorer.everyday_sizes import product_text
from explorer.pages.node_page import (
    category_bars,
    drawn_box,
    images_to_scale,
    items_by_size,
    node_page,
    whole_percents,
)
from explorer.pages.release_pages import change_tables, icicle, median_offset, source_page, vocabulary_page
from explorer.pages.templating import cell_html, environment, link_html, numeric_columns, web_address
from explorer.responses import node_response, prior_response
from explorer.tables import csv_bytes, node_sizes_csv, parquet_bytes, sizes_table
from metric_tree.prior import INTERVAL_QUANTILES
from metric_tree.reports.diff import MovedPrior, ReleaseDiff
from metric_tree.tree import Tree, open_tree
from tests.synthetic import minitree


@pytest.mark.parametrize(("limit", "n_rows"), [(1, 1), (2, 2), (3, 2)])
def test_bars_show_at_most_this_number_of_categories(
    catalogue: ReleaseCatalogue, monkeypatch: pytest.MonkeyPatch, limit: int, n_rows: int
) -> None:
    monkeypatch.setattr("explorer.pages.node_page.MAX_ROWS", limit)
    stool = catalogue.by_slug["mt-bar_stool"]
    bars = category_bars(catalogue, catalogue.nodes["chair.n.01"].children, stool)
    assert bars is not None
    assert len(bars["rows"]) == n_rows
    assert bars["more"] == 2 - n_rows
    assert stool.node_id in {row["node"] for row in bars["rows"]}, "the category of the page is always shown"


def test_bars_have_the_quantiles_of_the_height_on_an_axis_from_0_to_100(catalogue: ReleaseCatalogue) -> None:
    chair = catalogue.nodes["chair.n.01"]
    bars = category_bars(catalogue, chair.children, chair)
    assert bars is not None
    assert bars["dim"] == "height"
    assert [row["node"] for row in bars["rows"]] == ["swivel_chair.n.01", "mt:bar_stool"], "most items first"
    for row in bars["rows"]:
        node = catalogue.nodes[row["node"]]
        span = catalogue.quantiles(node)[::2, catalogue.dims(node).index("height")]
        axis = LogAxis(bars["low"], bars["high"], 0, 100)
        assert row["bar"] == [f"{axis.at(mm):.1f}" for mm in span]
        assert row["median"] == span[1]
    assert min(float(row["bar"][0]) for row in bars["rows"]) == 0.0
    assert category_bars(catalogue, [chair], chair) is None, "a category without a size has no bar"


@pytest.mark.parametrize(("fraction", "dim"), [(0.5, "height"), (0.51, "extent1")])
def test_the_axis_is_a_dimension_of_enough_categories(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fraction: float, dim: str
) -> None:
    names = dict(zip(("length", "width", "height"), ("extent1", "extent2", "extent3"), strict=True))
    rows = minitree.rows()
    for row in rows["priors.parquet"]:
        if row["node_id"] != "swivel_chair.n.01":
            row["dims"] = [names[dim] for dim in row["dims"]]
    catalogue = ReleaseCatalogue([Tree(minitree.release(tmp_path / "r", rows))])
    monkeypatch.setattr("explorer.pages.node_page.MIN_AXIS_FRACTION", fraction)
    nodes = [catalogue.nodes[node_id] for node_id in ("swivel_chair.n.01", "mt:bar_stool", "mouse.n.04")]
    bars = category_bars(catalogue, nodes, nodes[0])
    assert bars is not None
    assert bars["dim"] == dim


@pytest.mark.parametrize("change", [0, 1])
def test_a_scatter_chart_needs_enough_items(
    catalogue: ReleaseCatalogue, monkeypatch: pytest.MonkeyPatch, change: int
) -> None:
    node = catalogue.nodes["swivel_chair.n.01"]
    monkeypatch.setattr("explorer.pages.node_page.MIN_SCATTER_ITEMS", len(catalogue.rows(node)) + change)
    assert ("width against height" in node_page(catalogue, node).decode()) == (change == 0)


def test_items_are_from_the_largest_to_the_smallest(
    catalogue: ReleaseCatalogue, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = catalogue.rows(catalogue.nodes["swivel_chair.n.01"])
    heights = sorted(catalogue.items["height_mm"].take(rows).to_pylist(), reverse=True)
    monkeypatch.setattr("explorer.pages.node_page.MAX_ITEMS", len(rows))
    assert [item["height_mm"] for item in items_by_size(catalogue, rows, catalogue.sizes[rows])] == heights
    monkeypatch.setattr("explorer.pages.node_page.MAX_ITEMS", 2)
    shown = items_by_size(catalogue, rows, catalogue.sizes[rows])
    assert [item["height_mm"] for item in shown] == [heights[0], heights[-1]]
    assert items_by_size(catalogue, rows[:0], catalogue.sizes[rows[:0]]) == []


def test_ranges_and_defaults_are_no_listed_items(catalogue: ReleaseCatalogue, monkeypatch: pytest.MonkeyPatch) -> None:
    node = catalogue.nodes["swivel_chair.n.01"]
    rows = catalogue.rows(node)
    kinds = catalogue.kinds.copy()
    kinds[rows[0]] = "judged"
    monkeypatch.setitem(catalogue.__dict__, "kinds", kinds)
    page = node_page(catalogue, node).decode()
    assert f"</span> of {len(rows) - 1} shipped items, from the largest to the smallest. 1 rows with" in page
    kinds[:] = "judged"
    page = node_page(catalogue, node).decode()
    assert f"</span> of {len(rows)} shipped items" in page
    assert '<path class="kind-judged"' not in page, "the middle of a range is no item"


def test_axes_have_the_names_of_everyday_use(catalogue: ReleaseCatalogue) -> None:
    chair, rat = catalogue.nodes["swivel_chair.n.01"], catalogue.nodes["rat.n.01"]
    heads = [node_page(catalogue, node).decode().partition('<table class="sortable items"')[2] for node in (chair, rat)]
    assert '<th scope="col">width</th><th scope="col">depth</th><th scope="col">height</th>' in heads[0]
    assert '<th scope="col">length</th><th scope="col">width</th><th scope="col">height</th>' in heads[1]
    assert node_response(catalogue, chair).axis_names == {"length": "width", "width": "depth"}
    assert node_response(catalogue, rat).axis_names == {}
    assert prior_response(catalogue, chair).axis_names == {"length": "width", "width": "depth"}  # type: ignore[union-attr]


def test_a_page_without_items_offers_none(catalogue: ReleaseCatalogue, monkeypatch: pytest.MonkeyPatch) -> None:
    node = catalogue.nodes["swivel_chair.n.01"]
    monkeypatch.setattr(ReleaseCatalogue, "rows", lambda *_: np.zeros(0, dtype=int))
    monkeypatch.setattr(ReleaseCatalogue, "images", lambda *_: [])
    page = node_page(catalogue, node).decode()
    assert "items.json" not in page
    assert "items.parquet" not in page
    assert not {"items", "csv", "parquet", "images"} & set(node_response(catalogue, node).links)


def test_the_axis_of_bars_has_the_unit_of_its_table(catalogue: ReleaseCatalogue) -> None:
    page = node_page(catalogue, catalogue.nodes["chair.n.01"]).decode()
    for table in re.findall(r'<table class="bars".*?</table>', page, re.DOTALL):
        assert len(set(re.findall(r">[\d.,]+ (mm|cm|m)<", table))) == 1


def _image(item_id: str, width: int, height: int, scale: float | None, credit: str | None = None) -> dict[str, object]:
    return {
        "item_id": item_id, "cutout_path": None, "path": f"{item_id}.webp", "width_px": width, "height_px": height,
        "pixels_per_metre": scale, "attribution": credit, "licence": None, "source_url": "ftp://x",
    }  # fmt: skip


def test_images_of_different_items_are_drawn_to_the_same_scale(
    catalogue: ReleaseCatalogue, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = catalogue.nodes["swivel_chair.n.01"]
    items = [f"made:swivel_chair.n.01-{k}" for k in range(3)]
    images = [_image(items[0], 100, 200, 100.0), _image(items[1], 200, 100, 200.0), _image(items[2], 50, 50, 5000.0)]
    images.append(_image(items[0], 7, 7, 100.0))  # another view of the first item
    monkeypatch.setattr(ReleaseCatalogue, "images", lambda *_: images)
    drawn = {image["title"]: image for image in images_to_scale(catalogue, node)}
    sizes = {title: (image["width"], image["height"]) for title, image in drawn.items()}
    titles = catalogue.items["title"].take([catalogue.item_rows[item] for item in items]).to_pylist()
    assert sizes == dict(zip(titles, [(90, 180), (90, 45), (12, 12)], strict=True))
    assert {image["url"] for image in drawn.values()} == {""}
    assert {image["credit"] for image in drawn.values()} == {"made (no licence stated)"}
    monkeypatch.setattr("explorer.pages.node_page.MAX_IMAGES", 2)
    assert len(images_to_scale(catalogue, node)) == 2


def test_a_photograph_of_a_judged_category_does_not_have_its_size() -> None:
    shipped = ReleaseCatalogue([open_tree()])
    (avocado, *_) = images_to_scale(shipped, shipped.nodes["avocado.n.01"])
    assert avocado["size"].endswith(" cm, a typical size and not that of this object")
    assert "typical" not in images_to_scale(shipped, shipped.nodes["armchair.n.01"])[0]["size"]


def test_the_first_image_is_of_the_item_closest_to_the_median(
    catalogue: ReleaseCatalogue, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = catalogue.nodes["swivel_chair.n.01"]
    rows = catalogue.items.take(catalogue.rows(node)).to_pylist()
    median = max(catalogue.quantiles(node)[2])
    closest = min(rows, key=lambda row: abs(np.log(max(row["extents_mm"]) / median)))
    images = [_image(row["item_id"], 200, 100, None) for row in rows]
    monkeypatch.setattr(ReleaseCatalogue, "images", lambda *_: images)
    drawn = images_to_scale(catalogue, node)
    assert drawn[0]["size"] == product_text(closest["extents_mm"])
    page = node_page(catalogue, node).decode()
    assert page.index('class="hero"') < page.index("<h1>")
    assert f"One of them: {drawn[0]['size'].replace(' m', chr(160) + 'm')}." in page, "no break before the unit"


@pytest.mark.parametrize(("length", "shown"), [(159, 159), (160, 158)])
def test_a_long_credit_is_cut(
    catalogue: ReleaseCatalogue, monkeypatch: pytest.MonkeyPatch, length: int, shown: int
) -> None:
    image = _image("made:swivel_chair.n.01-0", 10, 10, None, "c" * length)
    monkeypatch.setattr(ReleaseCatalogue, "images", lambda *_: [image])
    (drawn,) = images_to_scale(catalogue, catalogue.nodes["swivel_chair.n.01"])
    assert len(drawn["credit"]) == shown


def test_the_drawn_box_is_length_by_height_and_width_deep(catalogue: ReleaseCatalogue) -> None:
    node = catalogue.nodes["swivel_chair.n.01"]
    prior = catalogue.prior(node)
    assert prior is not None
    assert drawn_box(prior, catalogue.quantiles(node), {}).names == ("length", "height", "width")
    named = drawn_box(prior, catalogue.quantiles(node), {"length": "width", "width": "depth"})
    assert named.names == ("width", "height", "depth")
    extents = replace(prior, dims=("extent1", "extent2", "extent3"))
    assert drawn_box(extents, catalogue.quantiles(node), {}).names == ("extent1", "extent2", "extent3")
    height = prior.marginal(("height",))
    box = drawn_box(height, height.quantiles((0.05, 0.25, 0.5, 0.75, 0.95)), {})
    assert box.names == ("height", "height", "")
    assert box.deep is None
    assert box.up == tuple(height.quantiles(INTERVAL_QUANTILES)[:, 0])


def test_a_small_object_is_next_to_a_hand_and_a_large_one_next_to_a_person_and_a_door() -> None:
    def references(mm: float) -> str:
        drawing = size_comparison("thing", DrawnBox((mm,) * 3, (mm,) * 3, None, ("length", "height", "")))
        return drawing.partition("to scale")[2].partition(":")[0]

    assert references(2) == ""
    assert references(22) == " beside hand"  # 190 mm is under 9 times 22 mm
    assert references(300) == " beside hand"
    assert references(449) == " beside hand"
    assert references(450) == " beside person, door, hand"
    assert references(451) == " beside person, door, hand"
    assert references(190 / 0.0349) == " beside person, door"
    assert references(190 / 0.0351) == " beside person, door, hand"


@pytest.mark.parametrize("mm", [3.0, 4.0, 7.0, 11.0, 90.0, 450.0, 2000.0, 7000.0])
def test_the_scale_bar_has_a_round_length_of_at_most_90_pixels(mm: float) -> None:
    drawing = size_comparison("cup", DrawnBox((mm,) * 3, (mm,) * 3, (mm,) * 3, ("length", "height", "width")))
    match = re.search(r'class="bar" d="M10 [\d.]+v4h([\d.]+)v', drawing)
    assert match is not None
    assert 36 <= float(match[1]) <= 90, "the longest of 1, 2 and 5 times a power of ten"
    assert re.search(r">(?:0\.)?[125]0*(?:\.0)? (?:mm|cm|m)</text></svg>", drawing) is not None


def test_a_histogram_needs_8_items_and_a_median_is_drawn(catalogue: ReleaseCatalogue) -> None:
    prior = catalogue.prior(catalogue.nodes["swivel_chair.n.01"])
    assert prior is not None
    height = replace(prior.marginal(("height",)), share_by_kind={"product": 0.7, "measured": 0.1, "judged": 0.2})
    interval = height.quantiles(INTERVAL_QUANTILES)[:, 0]
    for n, has_bars in ((7, False), (8, True)):
        sizes, kinds = np.full(n, 1050.0), np.array(["product"] * (n - 1) + ["measured"], dtype=object)
        drawing = distribution("height", height, interval, sizes, kinds)
        assert ('class="kind-product"' in drawing) == has_bars
        assert f"median 1.05 m, 90 % interval 0.94 to 1.17 m, {n} shipped items" in drawing
    bars = re.findall(r'kind-(\w+)" d="M[\d.]+ ([\d.]+)v-([\d.]+)h', drawing)
    assert [kind for kind, *_ in bars] == ["measured", "product"], "the strongest kind is at the bottom"
    assert float(bars[0][1]) == 118.0
    assert float(bars[1][1]) == pytest.approx(118.0 - float(bars[0][2]), abs=0.11)
    assert float(bars[1][2]) == pytest.approx(7 * float(bars[0][2]), rel=0.05), "as high as the shares of the kinds"


def test_a_norm_has_lines_for_its_sizes_and_no_curve(catalogue: ReleaseCatalogue) -> None:
    prior = catalogue.prior(catalogue.nodes["swivel_chair.n.01"])
    assert prior is not None
    height = prior.marginal(("height",))
    sizes, kinds = np.full(9, 1050.0), np.array(["norm"] * 9, dtype=object)
    for weight, lines in ((0.0051, 2), (0.0049, 1)):
        weights, means = np.array([1 - weight, weight]), np.concatenate([height.means[:1], height.means[:1] + 0.05])
        covariances = np.repeat(height.covariances[:1], 2, axis=0)
        mixture = replace(height, weights=weights, means=means, covariances=covariances)
        drawing = distribution("height", mixture, np.array([900.0, 1000.0, 1100.0]), sizes, kinds, is_norm=True)
        match = re.search(r'class="curve" d="([^"]+)"', drawing)
        assert match is not None
        assert re.fullmatch(r"(M[\d.]+ 8V118)+", match[1])
        assert match[1].count("M") == lines
        assert "kind-" not in drawing
        assert drawing.count("data-mm") >= 2, "round ticks"


def test_charts_draw_kinds_of_one_percent_of_the_weight(
    catalogue: ReleaseCatalogue, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = catalogue.nodes["swivel_chair.n.01"]
    prior = catalogue.prior(node)
    assert prior is not None
    drawn = {}
    for share in (0.0101, 0.0099):
        shares = dict.fromkeys(prior.share_by_kind, share) | {"judged": 1 - share}
        monkeypatch.setattr(catalogue, "prior", lambda _, shares=shares: replace(prior, share_by_kind=shares))
        text = node_page(catalogue, node).decode()
        drawn[share] = ("Bars: shipped items" in text, "Not drawn, because their kind weighs under 1 %" in text)
    assert drawn == {0.0101: (True, False), 0.0099: (False, True)}


@pytest.mark.parametrize(("weight", "contours"), [(0.05, 2), (0.049, 1)])
def test_components_of_enough_weight_have_a_contour(catalogue: ReleaseCatalogue, weight: float, contours: int) -> None:
    prior = catalogue.prior(catalogue.nodes["swivel_chair.n.01"])
    assert prior is not None
    pair = prior.marginal(("length", "height"))
    pair = replace(
        pair,
        weights=np.array([1 - weight, weight]),
        means=np.repeat(pair.means, 2, axis=0),
        covariances=np.repeat(pair.covariances, 2, axis=0),
    )
    sizes = np.exp(pair.means[:1]) * np.ones((6, 1))
    drawing = scatter(pair, sizes, np.array(["product"] * 6, dtype=object))
    assert drawing.count('class="contour"') == contours
    assert drawing.count("h0") == 6
    assert "length (across) against height (up), 6 of 6 items" in drawing


def test_the_icicle_names_high_nodes_and_leaves_out_thin_ones(
    catalogue: ReleaseCatalogue, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = catalogue.tree.root
    assert icicle(root, catalogue.tier).count("<rect") == len(catalogue.nodes)
    rat = 1400 * 4 / 40 * 2 / 4  # the height of a node with two of 40 items
    monkeypatch.setattr("explorer.pages.release_pages.MIN_NODE_HEIGHT_PX", rat + 0.1)
    assert icicle(root, catalogue.tier).count("<rect") == len(catalogue.nodes) - 2
    monkeypatch.setattr("explorer.pages.release_pages.MIN_NODE_HEIGHT_PX", 1.0)
    monkeypatch.setattr("explorer.pages.release_pages.MIN_NAMED_HEIGHT_PX", rat + 0.1)
    assert icicle(root, catalogue.tier).count("<text") == len(catalogue.nodes) - 2


def test_lengths_have_the_usual_unit() -> None:
    assert [length_text(mm) for mm in (19.9, 20.0, 999.0, 1000.0, 1.9e6, 2e6)] == [
        "19.9 mm", "2 cm", "99.9 cm", "1 m", "1,900 m", "2 km",
    ]  # fmt: skip


def test_an_axis_has_at_most_6_ticks_at_a_distance() -> None:
    assert len(LogAxis(1, 1e9, 0, 1e4).ticks()) == 6
    axis = LogAxis(100, 1000, 0, 100)
    ticks = axis.ticks()
    assert {100, 1000} <= set(ticks)
    assert min(np.diff([axis.at(tick) for tick in ticks])) >= 38.0
    assert LogAxis(100, 1000, 0, 38).ticks() == [100, 1000]
    assert len(LogAxis(100, 1000, 0, 37.9).ticks()) == 1
    assert axis.at(10) == 0.0
    assert axis.at(1e5) == 100.0


@pytest.mark.parametrize("change", [0, 1])
def test_the_offset_of_a_source_needs_enough_sizes(
    catalogue: ReleaseCatalogue, monkeypatch: pytest.MonkeyPatch, change: int
) -> None:
    node = catalogue.nodes["swivel_chair.n.01"]
    rows = catalogue.rows(node)
    monkeypatch.setattr("explorer.pages.release_pages.MIN_OFFSET_ROWS", len(rows) + change)
    offset = median_offset(catalogue, node, rows)
    page = source_page(catalogue, "made").decode()
    if change:
        assert offset is None
        assert "Over " not in page
    else:
        ratios = np.median(catalogue.sizes[rows][:, :3], axis=0) / catalogue.quantiles(node)[2]
        assert offset == pytest.approx(np.exp(np.log(ratios).mean()) - 1, abs=1e-4)
        assert f"Over 1 category its median size is {abs(offset):.0%}" in page


def test_cells_are_numbers_links_and_text() -> None:
    assert str(cell_html(1200)) == "1,200"
    assert str(cell_html(link_html("<a>", "https://x"))) == '<a href="https://x">&lt;a&gt;</a>'
    assert [str(link_html("a", url)) for url in ("data:x", "", None)] == ["a"] * 3
    assert numeric_columns([("1", "70 (59%)", "a"), ("-3 %", 1200, "1")], 3) == [True, True, False]
    assert numeric_columns([], 1) == [False]
    assert web_address("http://x") == "http://x"
    assert web_address("data:x") == ""


def test_releases_of_one_version_are_refused(tmp_path: Path) -> None:
    tree = open_tree(minitree.release(tmp_path / "r").directory)
    with pytest.raises(ValueError, match="--tree: expected releases of different versions; found"):
        ReleaseCatalogue([tree, tree])


def test_a_label_list_has_one_unit_and_no_break_before_it(catalogue: ReleaseCatalogue) -> None:
    page = vocabulary_page(catalogue, "coco_80").decode()
    units = {text.rpartition(" ")[2] for text in re.findall(r"<data [^>]*>([^<]+)</data>", page)}
    assert len(units) == 1
    assert product_text([2000, 876, 97]) == "2.00 × 0.88 × 0.10 m"
    unbroken, licence = (environment().filters[name] for name in ("unbroken", "licence"))
    assert unbroken("8 to 12 cm wide") == "8 to 12\u00a0cm wide"
    assert [licence(text) for text in ("none", None, "MIT")] == ["no licence stated"] * 2 + ["MIT"]


def test_both_sizes_of_a_change_have_the_unit_of_the_smaller_one() -> None:
    moved = MovedPrior("a", "height", 0.3, 128.0, 425.7, 0.1, {})
    empty: dict[str, Any] = {name: {} for name in ReleaseDiff.__dataclass_fields__}
    diff = ReleaseDiff(**{**empty, "priors": [moved], "nodes_before": 1, "nodes_after": 1, "removed": []})
    rows = next(rows for title, _, rows, _ in change_tables(diff, str) if title == "Priors that moved")
    assert rows[0][2:4] == ("0.300 mm", "128.000 mm")


def test_the_drawing_of_a_flat_object_is_low() -> None:
    def height(mm: float) -> float:
        box = DrawnBox((9000.0,) * 3, (mm,) * 3, None, ("length", "height", ""))
        return float(size_comparison("thing", box).partition('viewBox="0 0 340 ')[2].partition('"')[0])

    assert height(20_000) == 236  # 186 px and the margins
    assert height(2000) < 130


def test_a_single_dimension_is_a_bar_and_not_a_square() -> None:
    height = (1500.0, 1680.0, 1850.0)
    drawing = size_comparison("person", DrawnBox(height, height, None, ("height", "height", "")))
    widths, heights = (
        [float(v) for v in re.findall(rf'<rect [^>]* {name}="([^"]+)"', drawing)] for name in ("width", "height")
    )
    assert max(widths) < 0.05 * max(heights)
    assert ": height 1.68 m" in drawing
    assert ">height</text>" in drawing


@pytest.mark.parametrize(
    ("shares", "percents"),
    [
        ({"a": 0.645, "b": 0.355}, {"a": 65, "b": 35}),
        ({"a": 1 / 3, "b": 1 / 3, "c": 1 / 3}, {"a": 34, "b": 33, "c": 33}),
        ({"a": 0.998, "b": 0.002}, {"a": 100, "b": 0}),
        ({}, {}),
    ],
)
def test_shares_are_whole_percents_that_sum_to_100(shares: dict[str, float], percents: dict[str, int]) -> None:
    assert whole_percents(shares) == percents


@pytest.mark.parametrize(
    ("mm", "typical", "text"),
    [
        (1240, 914, "124.0 cm"),
        (85, 914, "8.5 cm"),
        (85, 1000, "0.09 m"),
        (12, 19.9, "12.0 mm"),
        (0.012, 0.012, "0.0120 mm"),
    ],
)
def test_lengths_of_a_table_have_one_unit_and_fixed_decimals(mm: float, typical: float, text: str) -> None:
    assert length_text(mm, typical) == text


def test_tables_of_sizes_have_the_quantiles_of_all_categories(catalogue: ReleaseCatalogue) -> None:
    node = catalogue.nodes["swivel_chair.n.01"]
    (head, *lines) = node_sizes_csv(catalogue, node).decode().splitlines()
    assert head == "dimension,everyday_name,q05_mm,q25_mm,q50_mm,q75_mm,q95_mm"
    assert [line.split(",")[0] for line in lines] == list(catalogue.dims(node))
    table = pq.read_table(io.BytesIO(parquet_bytes(sizes_table(catalogue))))
    rows = {row["node_id"]: row for row in table.to_pylist()}
    assert set(rows) == {one.node_id for one in catalogue.nodes.values() if catalogue.dims(one)}
    assert rows[node.node_id]["height_q50_mm"] == 1050.0
    assert rows[node.node_id]["extent1_q50_mm"] is None
    assert len(csv_bytes(sizes_table(catalogue)).decode().splitlines()) == len(rows) + 1


def test_a_page_names_the_withheld_sources_and_the_share_of_judged_weight(
    catalogue: ReleaseCatalogue, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = replace(catalogue.nodes["swivel_chair.n.01"], sources=("made", "shut"))
    prior = catalogue.prior(node)
    assert prior is not None
    changed = replace(prior, n_sources=3, share_by_kind={"product": 0.4, "judged": 0.6})
    monkeypatch.setattr(ReleaseCatalogue, "prior", lambda *_: changed)
    withheld = {"id": "shut", "title": "Shut source", "licence": "own terms", "withheld": True, "n_fit": 9}
    monkeypatch.setitem(catalogue.sources, "shut", withheld)
    page = node_page(catalogue, node).decode()
    assert "is copyleft, missing or restricts redistribution, or because the source states only statistics" in page
    assert "Shut source</a> (own terms)" in page
    assert "60 % of the weight is a language model's range" in page
    assert "ships no rows of 1 of its 3 sources" in page
    assert "and 3 sources." in page  # as many as the page names or counts
    assert "sizes.csv" in page


def test_the_default_release_states_all_sources_of_its_priors() -> None:
    tree = open_tree()
    known = {source["id"] for source in tree.release.manifest["sources"]}
    for node in tree:
        assert set(node.sources) <= known
        n_sources = max(tree.prior(node.node_id, dims).n_sources for dims in node.prior_dims[:1])
        assert n_sources <= len(node.sources), node.node_id

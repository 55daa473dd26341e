"""Limits of responses, the cache, jobs and pages, in numbers on each side."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pyarrow as pa
import pytest
from starlette.responses import Response
from starlette.testclient import TestClient

from explorer.catalogue import ReleaseCatalogue
from explorer.charts.axis import number_text, range_text
from explorer.pages.node_page import category_bars, context_table, images_to_scale, items_by_size, node_page
from explorer.responses import images_response, items_response, node_response, queried_prior
from explorer.schemas import ItemsQuery, KnownLength, ScaleRequest, SearchQuery
from explorer.server.app import application
from explorer.server.delivery import CompressionMiddleware
from explorer.server.scale_jobs import ScaleJobs, ServiceUnavailable, scale_record
from metric_base.arrays import IntArray
from metric_base.errors import InputError
from metric_tree.context import KnownContexts
from metric_tree.node import Node
from metric_tree.prior import MEDIAN, Prior
from metric_tree.tree import Tree

NODE = "swivel_chair.n.01"
OBJECT = {"id": "a", "category": "swivel chair", "dimensions": {"height": 0.5}}


def repeat_rows(monkeypatch: pytest.MonkeyPatch, n: int) -> None:
    """Let every node of a catalogue with items have `n` rows."""
    rows_of = ReleaseCatalogue.rows

    def rows(catalogue: ReleaseCatalogue, node: Node) -> IntArray:
        return np.resize(rows_of(catalogue, node), n)

    monkeypatch.setattr(ReleaseCatalogue, "rows", rows)


@pytest.mark.parametrize(
    ("size", "media_type", "is_compressed"),
    [
        (499, "text/html", False),
        (500, "text/html", True),
        (9000, "image/webp", False),
        (9000, "application/vnd.apache.parquet", False),
    ],
)
def test_responses_of_500_bytes_are_compressed_unless_they_are_images(
    size: int, media_type: str, is_compressed: bool
) -> None:
    headers = {"accept-encoding": "gzip"}
    client = TestClient(CompressionMiddleware(Response(b"x" * size, media_type=media_type)))
    assert ("content-encoding" in client.get("/", headers=headers).headers) == is_compressed


def test_a_page_may_be_kept_for_5_minutes_and_a_preflight_for_a_day(trees: list[Tree]) -> None:
    client = TestClient(application(trees))
    assert client.get("/index.html").headers["cache-control"] == "public, max-age=300"
    asked = {"origin": "https://example.org", "access-control-request-method": "GET"}
    preflight = client.options("/index.html", headers=asked)
    assert (preflight.status_code, preflight.headers["access-control-max-age"]) == (200, "86400")
    assert client.get("/v1/search?q=a&limit=50").status_code == 200
    assert client.get("/v1/search?q=" + "a" * 300).status_code == 200


def test_an_image_may_be_kept_for_a_year(trees: list[Tree], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / f"{'0' * 64}.webp"
    file.write_bytes(b"RIFF")
    monkeypatch.setattr("explorer.server.app.stored_file", lambda *_: file)
    response = TestClient(application(trees)).get(f"/pictures/00/{file.name}")
    assert response.headers["cache-control"].split(", ")[:2] == ["public", "max-age=31536000"]


@pytest.mark.parametrize(("size", "status"), [(1_000_000, 200), (1_000_001, 413)])
def test_a_body_has_at_most_1_mb(trees: list[Tree], monkeypatch: pytest.MonkeyPatch, size: int, status: int) -> None:
    async def result(_: ScaleJobs, received: bytes) -> bytes:
        assert len(received) == size
        return b"{}"

    monkeypatch.setattr(ScaleJobs, "result", result)
    answer = TestClient(application(trees)).post(
        "/v1/scale", content=b" " * size, headers={"content-type": "application/json"}
    )
    assert answer.status_code == status


def test_the_eleventh_job_at_once_is_refused(trees: list[Tree]) -> None:
    jobs = ScaleJobs(trees[0].release.directory)

    async def results() -> list[Any]:
        return list(await asyncio.gather(*(jobs.result(b"{") for _ in range(11)), return_exceptions=True))

    try:
        errors = asyncio.run(results())
    finally:
        jobs.stop()
    assert [type(error) for error in errors] == [InputError] * 10 + [ServiceUnavailable]


def test_a_job_takes_at_most_20_seconds(trees: list[Tree], monkeypatch: pytest.MonkeyPatch) -> None:
    jobs = ScaleJobs(trees[0].release.directory)

    async def wait_for(_: object, seconds: float) -> None:
        assert seconds == 20
        raise TimeoutError

    monkeypatch.setattr(asyncio, "wait_for", wait_for)
    try:
        with pytest.raises(ServiceUnavailable, match="took longer than 20 s"):
            asyncio.run(jobs.result(b"{"))
    finally:
        jobs.stop()


def test_a_scale_request_may_have_500_objects_and_100_lengths(trees: list[Tree]) -> None:
    objects = [{**OBJECT, "id": str(index)} for index in range(500)]
    lengths = [KnownLength(1.0, 2.0)] * 100
    assert len(scale_record(ScaleRequest(objects=objects), trees[0])["objects"]) == 500
    assert len(scale_record(ScaleRequest(objects=[OBJECT], known_lengths=lengths), trees[0])["evidence"]) == 100


def test_a_known_length_has_an_error_of_1_percent_by_default(trees: list[Tree]) -> None:
    default, same, other = (
        scale_record(ScaleRequest(objects=[OBJECT], known_lengths=[length]), trees[0])
        for length in (KnownLength(1.0, 2.0), KnownLength(1.0, 2.0, 0.01), KnownLength(1.0, 2.0, 0.012))
    )
    assert default == same
    assert default["interval"] != other["interval"]


@pytest.mark.parametrize(("n", "more"), [(9, 0), (10, 1)])
def test_a_comparison_of_categories_has_9_rows(catalogue: ReleaseCatalogue, n: int, more: int) -> None:
    node = catalogue.nodes[NODE]
    bars = category_bars(catalogue, [node] * n, node)
    assert bars is not None
    assert (len(bars["rows"]), bars["more"]) == (9, more)


@pytest.mark.parametrize(("n", "n_shown"), [(15, 15), (16, 16), (17, 16)])
def test_a_page_shows_16_items(catalogue: ReleaseCatalogue, n: int, n_shown: int) -> None:
    rows = np.resize(catalogue.rows(catalogue.nodes[NODE]), n)
    assert len(items_by_size(catalogue, rows, catalogue.sizes[rows])) == n_shown


@pytest.mark.parametrize(("n", "has_chart"), [(4, False), (5, True)])
def test_a_scatter_chart_needs_5_items(
    catalogue: ReleaseCatalogue, monkeypatch: pytest.MonkeyPatch, n: int, has_chart: bool
) -> None:
    repeat_rows(monkeypatch, n)
    assert ("width against height" in node_page(catalogue, catalogue.nodes[NODE]).decode()) == has_chart


@pytest.mark.parametrize(("n", "n_shown"), [(11, 11), (12, 12), (13, 12)])
def test_a_page_and_a_response_have_12_images(
    catalogue: ReleaseCatalogue, monkeypatch: pytest.MonkeyPatch, n: int, n_shown: int
) -> None:
    image = {
        "cutout_path": None, "path": "a.webp", "width_px": 9, "height_px": 9,
        "pixels_per_metre": 9.0, "attribution": "a", "licence": None, "source_url": "",
    }  # fmt: skip
    node = catalogue.nodes[NODE]
    items = catalogue.items["item_id"].take(catalogue.rows(node)).to_pylist()[:n]
    monkeypatch.setattr(ReleaseCatalogue, "images", lambda *_: [{**image, "item_id": item} for item in items])
    assert len(images_to_scale(catalogue, node)) == n_shown
    response = images_response(catalogue, node)
    assert (len(response.images), response.n_images) == (n_shown, n)


@pytest.mark.parametrize(("n", "has_parquet", "has_next"), [(49, False, False), (50, True, False), (51, True, True)])
def test_50_items_fill_a_page_and_make_a_parquet_file(
    catalogue: ReleaseCatalogue, monkeypatch: pytest.MonkeyPatch, n: int, has_parquet: bool, has_next: bool
) -> None:
    repeat_rows(monkeypatch, n)
    node = catalogue.nodes[NODE]
    assert ("parquet" in node_response(catalogue, node).links) == has_parquet
    page = items_response(catalogue, node)
    assert page is not None
    assert (len(page.items), page.next is not None) == (min(n, 50), has_next)


def test_nodes_of_all_levels_with_items_have_a_csv_file(catalogue: ReleaseCatalogue) -> None:
    nodes = list(catalogue.nodes.values())
    has_items = [len(catalogue.rows(node)) > 0 for node in nodes]
    assert {node.level for node, has in zip(nodes, has_items, strict=True) if has} == {1, 2, 3, 4, 5}
    assert ["csv" in node_response(catalogue, node).links for node in nodes] == has_items


@pytest.mark.parametrize(("n", "is_shown"), [(5000, True), (5001, False)])
def test_the_browser_loads_at_most_5000_items(
    catalogue: ReleaseCatalogue, monkeypatch: pytest.MonkeyPatch, n: int, is_shown: bool
) -> None:
    repeat_rows(monkeypatch, n)
    assert ('id="all-items"' in node_page(catalogue, catalogue.nodes[NODE]).decode()) == is_shown


@pytest.mark.parametrize(("page", "is_valid"), [(0, False), (1, True), (999_999, True), (1_000_000, False)])
def test_cursors_have_a_range(catalogue: ReleaseCatalogue, page: int, is_valid: bool) -> None:
    if is_valid:
        query = msgspec.convert({"cursor": f"p{page}"}, ItemsQuery)
        assert (items_response(catalogue, catalogue.nodes[NODE], query) is not None) == (page == 1)
    else:
        with pytest.raises(msgspec.ValidationError, match=r"at `\$\.cursor`"):
            msgspec.convert({"cursor": f"p{page}"}, ItemsQuery)


@pytest.mark.parametrize(("n", "found"), [(6, "found 2, 2, 2, 2, 2, 2$"), (7, "found 7 numbers$")])
def test_a_message_shows_at_most_6_numbers(catalogue: ReleaseCatalogue, n: int, found: str) -> None:
    with pytest.raises(InputError, match=found):
        queried_prior(catalogue, catalogue.nodes[NODE], quantiles=[2.0] * n)


@pytest.mark.parametrize(
    ("last", "years"),
    [
        (1907, [*range(1900, 1908)]),
        (1908, [1900, 1902, 1904, 1906, 1908]),
        (1979, [1900, 1910, 1920, 1930, 1940, 1950, 1960, 1970, 1980]),
        (1980, [1900, 1920, 1940, 1960, 1980]),
    ],
)
def test_years_of_a_page_have_round_steps(last: int, years: list[int]) -> None:
    prior = SimpleNamespace(dims=("height",), quantiles=lambda probabilities: np.ones((1, len(probabilities))))
    contexts = KnownContexts(("DE", "europe"), (1900, last))
    node = SimpleNamespace(tree=SimpleNamespace(context_model=object()), prior=lambda *_: prior, contexts=contexts)
    table = context_table(cast(Node, node), cast(Prior, prior))
    assert table is not None
    assert (table["years"], table["regions"]) == (years, ["world", "europe", "DE"])
    assert len(table["table"]["europe"]) == len(years)


def test_defaults_of_requests() -> None:
    assert SearchQuery("chair").limit == 10
    assert ScaleRequest(objects=[]).level == 0.9


@pytest.mark.parametrize(
    ("extents_mm", "sizes"),
    [([3.0, 2.0, 1.0], [3.0, 2.0, 1.0]), ([3.0], [3.0, None, None]), (None, [None, None, None])],
)
def test_an_item_has_three_sizes_and_a_title_of_90_characters(
    extents_mm: list[float] | None, sizes: list[float | None]
) -> None:
    fields = {"extents_mm": extents_mm, "title": "t" * 91, "item_id": "a", "url": "ftp://x"}
    item = {**fields, "length_mm": None, "width_mm": None, "height_mm": None}
    catalogue = cast(ReleaseCatalogue, SimpleNamespace(items=pa.Table.from_pylist([item])))
    (shown,) = items_by_size(catalogue, np.array([0]), np.full((1, 6), np.nan))
    assert (shown["sizes"], shown["title"], shown["url"]) == (sizes, "t" * 90, "")


def test_numbers_from_100_have_no_decimals() -> None:
    assert [number_text(value) for value in (99.94, 100.4, 0.012345, 12345.6)] == ["99.9", "100", "0.0123", "12,346"]
    assert range_text(80, 19.9) == "80 to 19.9 mm"
    assert range_text(80, 20) == "8 to 2 cm"


def test_each_model_of_a_judged_item_has_an_image() -> None:
    """Four views of two horses, one item: an image of each horse."""
    views = [
        {"item_id": "judged:horse.n.01", "attribution": name, "path": f"{name}{view}", "cutout_path": None}
        | {"width_px": 100, "height_px": 100, "pixels_per_metre": 50.0, "source_url": "https://a.b/c"}
        for name in ("Anna", "Bert")
        for view in (0, 1)
    ]
    item = {"item_id": "judged:horse.n.01", "title": "ponies", "extents_mm": [2300.0, 1750.0, 620.0], "kind": "judged"}
    catalogue = SimpleNamespace(
        images=lambda node: views,
        item_rows={"judged:horse.n.01": 0},
        items=pa.Table.from_pylist([item]),
        quantiles=lambda node: {MEDIAN: [2300.0]},
    )
    images = images_to_scale(cast(ReleaseCatalogue, catalogue), cast(Node, None))
    assert [image["path"] for image in images] == ["Anna0", "Bert0"]

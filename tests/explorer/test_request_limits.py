"""Limits of requests: comparisons, queries of priors, known lengths and the size of a body."""

from __future__ import annotations

import re
from typing import Any

import msgspec
import pytest
from starlette.testclient import TestClient

from explorer.catalogue import ReleaseCatalogue
from explorer.responses import comparison, items_response, numbers, queried_prior
from explorer.schemas import ItemsQuery, ScaleRequest
from explorer.server.app import application
from explorer.server.scale_jobs import ScaleJobs, scale_record
from metric_base.errors import InputError
from metric_tree.tree import Tree

NODE = "swivel_chair.n.01"
OBJECT = {"id": "a", "category": "swivel chair", "dimensions": {"height": 0.5}}


@pytest.mark.parametrize(("n", "is_valid"), [(0, False), (1, True), (6, True), (7, False)])
def test_a_comparison_has_1_to_6_categories(catalogue: ReleaseCatalogue, n: int, is_valid: bool) -> None:
    if is_valid:
        nodes = comparison(catalogue, [NODE] * n).nodes
        assert [node.quantiles_mm["height"]["0.5"] for node in nodes] == [1050.0] * n
    else:
        with pytest.raises(InputError, match=f"nodes: expected 1 to 6 names; found {n}"):
            comparison(catalogue, [NODE] * n)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"quantiles": [0.5] * 50}, None),
        ({"quantiles": [0.5] * 51}, "quantiles: expected at most 50 numbers between 0 and 1; found 51 numbers"),
        ({"quantiles": [0.0]}, "quantiles"),
        ({"quantiles": [1.0]}, "quantiles"),
        ({"dims": ("height", "height")}, "dims: expected each dimension once"),
        ({"dims": ("height",), "density_at": [900.0] * 100}, None),
        ({"dims": ("height",), "density_at": [900.0] * 101}, "density_at: expected sizes in mm with 1 numbers each"),
        ({"density_at": [900.0, 800.0]}, "with 3 numbers each, at most 100; found 900, 800"),
        ({"dims": ("height",), "density_at": [1e-6]}, "density_at"),
        ({"dims": ("height",), "density_at": [1.1e-6]}, None),
        ({"dims": ("height",), "density_at": [1e12]}, "density_at"),
        ({"dims": ("height",), "density_at": [0.99e12]}, None),
    ],
)
def test_numbers_of_a_query_have_limits(catalogue: ReleaseCatalogue, fields: dict[str, Any], message: str) -> None:
    node = catalogue.nodes[NODE]
    if message is None:
        assert queried_prior(catalogue, node, **fields).node == NODE
    else:
        with pytest.raises(InputError, match=message):
            queried_prior(catalogue, node, **fields)


@pytest.mark.parametrize(("n", "is_valid"), [(2000, True), (2001, False)])
def test_a_list_of_numbers_has_at_most_4000_characters(n: int, is_valid: bool) -> None:
    if is_valid:
        assert numbers("1," * n, "q") == [1.0] * n
    else:
        with pytest.raises(InputError, match="q: expected at most 4,000 characters; found 4,002"):
            numbers("1," * n, "q")


@pytest.mark.parametrize(
    ("length", "is_valid"),
    [
        ({"units": 1.0, "metres": 2.0}, True),
        ({"units": 1.0, "metres": 2.0, "sigma": 1e-6}, False),
        ({"units": 1.0, "metres": 2.0, "sigma": 1.1e-6}, True),
        ({"units": 1.0, "metres": 2.0, "sigma": 10.0}, False),
        ({"units": 1.0, "metres": 2.0, "sigma": 9.9}, True),
        ({"units": 1e-12, "metres": 2.0}, False),
        ({"units": 1.0, "metres": 1e12}, False),
        ({"metres": 2.0}, False),
        ({"units": 1.0, "metres": 2.0, "error": 0.1}, False),
    ],
)
def test_known_lengths_have_ranges(trees: list[Tree], length: dict[str, float], is_valid: bool) -> None:
    fields = {"objects": [OBJECT], "known_lengths": [length]}
    if is_valid:
        assert scale_record(msgspec.convert(fields, ScaleRequest), trees[0])["schema"] == "metric-tree/scale/1"
    else:
        with pytest.raises(msgspec.ValidationError, match=r"at `\$\.known_lengths\[0\]"):
            msgspec.convert(fields, ScaleRequest)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"objects": []}, "length >= 1 - at `$.objects`"),
        ({"objects": [OBJECT] * 501}, "length <= 500 - at `$.objects`"),
        ({"level": 0.0}, "`float` > 0.0 - at `$.level`"),
        ({"level": 1.0}, "`float` < 1.0 - at `$.level`"),
        ({"known_lengths": [{"units": 1.0, "metres": 2.0}] * 101}, "length <= 100 - at `$.known_lengths`"),
    ],
)
def test_a_scale_request_has_limits(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=re.escape(message)):
        msgspec.convert({"objects": [OBJECT], **fields}, ScaleRequest)


@pytest.mark.parametrize(("change", "status"), [(0, 200), (1, 413)])
def test_a_body_has_a_maximum_size(
    trees: list[Tree], monkeypatch: pytest.MonkeyPatch, change: int, status: int
) -> None:
    body = b'{"objects": []}'

    async def result(_: ScaleJobs, received: bytes) -> bytes:
        assert received == body
        return b"{}"

    monkeypatch.setattr(ScaleJobs, "result", result)
    monkeypatch.setattr("explorer.server.app.MAX_BODY_BYTES", len(body) - change)
    answer = TestClient(application(trees)).post(
        "/v1/scale", content=body, headers={"content-type": "application/json"}
    )
    assert answer.status_code == status


def test_there_is_no_page_of_items_after_the_last(catalogue: ReleaseCatalogue, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("explorer.responses.PAGE_ROWS", 10)
    node = catalogue.nodes[NODE]  # 14 items
    first, second = (items_response(catalogue, node, ItemsQuery(f"p{page}")) for page in (1, 2))
    assert first is not None
    assert second is not None
    assert (len(first.items), len(second.items), second.next) == (10, 4, None)
    assert first.next == "items?cursor=p2"
    assert items_response(catalogue, node, ItemsQuery("p3")) is None

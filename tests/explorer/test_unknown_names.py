"""Responses to unknown names and addresses, by HTTP, as a page and as a tool; conditions of a server and a site."""

from __future__ import annotations

import asyncio
import json
import logging
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from starlette.testclient import TestClient

from explorer import static_site
from explorer.catalogue import ReleaseCatalogue
from explorer.fit import fit_response
from explorer.pages import report_page
from explorer.queries import search_response, shorter_texts
from explorer.responses import outside_links, size_answer, vocabulary_response
from explorer.routes import render
from explorer.schemas import FitQuery, SearchQuery
from explorer.server import scale_jobs
from explorer.server.app import application
from explorer.server.delivery import accepts_gzip
from metric_base.errors import InputError
from metric_tree.checks.finding import Finding
from metric_tree.tree import Tree
from tests.synthetic import minitree

NODE = "swivel_chair.n.01"


@pytest.mark.parametrize(
    ("address", "status", "text"),
    [
        ("/v1/nodes/swivl_chiar", 404, "no node is called"),
        (f"/v1/nodes/{NODE}/prior?dims=colour", 422, "dims"),
        (f"/v1/nodes/{NODE}/prior?where=atlantis", 422, "atlantis"),
        (f"/v1/nodes/{NODE}?limit=1", 422, "parameters of this address: none"),
        ("/v1/search", 422, "parameters of this address: q, limit"),
        ("/v1/search?q=%20", 422, "q: expected a text; found spaces only"),
        ("/v1/search?q=chair&limit=51", 422, "limit"),
        ("/v1/fit?object=sofa&into=door&how=over", 422, "how"),
        ("/v1/vocabularies/absent", 404, "nothing is at /v1/vocabularies/absent"),
        ("/nodes/absent.html", 404, "nothing is at /nodes/absent.html"),
        ("/v1/scale", 405, "GET /v1/scale"),
    ],
)
def test_an_unknown_name_is_404_and_an_invalid_value_422(
    trees: list[Tree], address: str, status: int, text: str
) -> None:
    response = TestClient(application(trees)).get(address)
    assert (response.status_code, response.headers["content-type"]) == (status, "application/problem+json")
    assert text in response.json()["detail"]


def test_a_search_of_an_unknown_name_has_similar_names_and_no_answer(catalogue: ReleaseCatalogue) -> None:
    unknown = search_response(catalogue, SearchQuery("qqqq"))
    assert (unknown.answer, unknown.hits) == (None, [])
    known = search_response(catalogue, SearchQuery("how tall is a swivel chair?", limit=1))
    assert known.answer is not None
    assert known.answer.startswith("swivel chair: about ")
    assert [hit.node for hit in known.hits] == [NODE]
    assert size_answer(catalogue, catalogue.nodes[NODE], True).startswith("Taken as swivel chair: about ")
    assert size_answer(catalogue, catalogue.nodes["entity.n.01"], False) == "entity: nothing is known of its size."


@pytest.mark.parametrize(
    ("query", "texts"),
    [
        ("what is the height of a door?", ["what is the height of a door", "the height of a door", "height of a door",
                                            "a door", "door"]),
        ("tv 55 inch", ["tv 55 inch", "tv 55", "tv"]),
        ("door", ["door"]),
    ],
)  # fmt: skip
def test_words_about_sizes_are_removed_one_by_one(query: str, texts: list[str]) -> None:
    assert list(shorter_texts(query)) == texts


@pytest.mark.parametrize(("address", "page"), [("/", "/index.html"), ("/sources/", "/sources/index.html")])
def test_a_folder_is_its_index(trees: list[Tree], address: str, page: str) -> None:
    client = TestClient(application(trees))
    assert client.get(address).text == client.get(page).text


def test_a_request_is_a_line_of_json(trees: list[Tree], caplog: pytest.LogCaptureFixture) -> None:
    client = TestClient(application(trees))
    with caplog.at_level(logging.WARNING, "metric-tree.serve"):
        client.get("/v1/releases")
    assert caplog.messages == []
    with caplog.at_level(logging.INFO, "metric-tree.serve"):
        size = len(client.get("/v1/releases", headers={"accept-encoding": "identity"}).content)
    entry = json.loads(caplog.messages[0])
    assert {name: entry[name] for name in ("method", "path", "status", "bytes")} == {
        "method": "GET", "path": "/v1/releases", "status": 200, "bytes": size,
    }  # fmt: skip


@pytest.mark.parametrize("preload", [False, True])
def test_a_server_is_prepared_if_requested(trees: list[Tree], monkeypatch: pytest.MonkeyPatch, preload: bool) -> None:
    calls: list[str] = []
    monkeypatch.setattr("explorer.server.app.ReleaseServer.prepare", lambda _: calls.append("prepare"))
    monkeypatch.setattr(scale_jobs.ScaleJobs, "preload", lambda _: calls.append("preload"))
    with TestClient(application(trees, preload=preload)) as client:
        health = client.get("/healthz").json()
    assert (health["status"], [*health["releases"]]) == ("ok", [tree.version for tree in trees])
    assert calls == ["prepare", "preload"] * preload


def test_two_processes_load_the_estimator(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bodies: list[bytes] = []
    jobs = scale_jobs.ScaleJobs(tmp_path)
    pool = SimpleNamespace(submit=lambda _function, _directory, body: bodies.append(body))
    monkeypatch.setattr(jobs, "_processes", lambda: pool)
    jobs.preload()
    assert [json.loads(body)["objects"][0]["category"] for body in bodies] == ["chair", "chair"]


def test_a_dead_process_of_a_job_is_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    jobs, stops = scale_jobs.ScaleJobs(tmp_path), []

    async def broken(*_: Any) -> bytes:
        raise scale_jobs.BrokenProcessPool

    monkeypatch.setattr("explorer.server.scale_jobs.asyncio.wait_for", broken)
    monkeypatch.setattr("explorer.server.scale_jobs.asyncio.shield", lambda _: None)
    monkeypatch.setattr(jobs, "_processes", lambda: None)
    monkeypatch.setattr(jobs, "stop", lambda: stops.append(1))

    async def request() -> None:
        with pytest.raises(scale_jobs.ServiceUnavailable, match="ended unexpectedly; try again"):
            await jobs.result(b"{}")

    monkeypatch.setattr("asyncio.base_events.BaseEventLoop.run_in_executor", lambda *_: None)
    asyncio.run(request())
    assert stops == [1]
    assert jobs._jobs == 0


@pytest.mark.parametrize(
    ("accepted", "is_accepted"),
    [("gzip", True), ("br, *", True), ("gzip;q=0", False), ("*;q=0.0", False), ("gzip;q=0, *", False),
     ("gzip;q=0.5", True), ("br", False), ("", False)],
)  # fmt: skip
def test_gzip_is_accepted_by_name_or_by_an_asterisk(accepted: str, is_accepted: bool) -> None:
    assert accepts_gzip(accepted) == is_accepted


def test_ids_that_are_equal_as_file_names_have_no_site(tmp_path: Path) -> None:
    rows = minitree.rows()
    tree: Any = SimpleNamespace(version="1", release=SimpleNamespace(directory=tmp_path))
    nodes = [SimpleNamespace(node_id=row["node_id"]) for row in rows["nodes.parquet"]]

    class Nodes(SimpleNamespace):
        def __iter__(self) -> Any:
            return iter(self.nodes)

    ReleaseCatalogue([Nodes(**vars(tree), nodes=nodes)])  # type: ignore[list-item]
    twice = [*nodes, SimpleNamespace(node_id=NODE.upper())]
    with pytest.raises(InputError, match="node_id: expected ids that differ as file names"):
        ReleaseCatalogue([Nodes(**vars(tree), nodes=twice)])  # type: ignore[list-item]


def test_an_unknown_label_list_names_the_others(catalogue: ReleaseCatalogue) -> None:
    with pytest.raises(InputError, match=r"vocabulary: expected one of .*coco_80.*; found 'absent'"):
        vocabulary_response(catalogue, "absent")
    assert render(catalogue, "vocabularies/absent.csv") is None


def test_links_of_a_node_are_its_codes_or_a_search(
    catalogue: ReleaseCatalogue, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = catalogue.nodes[NODE]
    monkeypatch.setitem(vars(catalogue), "codes", {NODE: ["n04373704", "/m/0x"]})
    assert outside_links(catalogue, node) == {
        "WordNet": "http://wordnet-rdf.princeton.edu/pwn30/04373704-n",
        "Wikidata": "https://www.wikidata.org/w/index.php?search=haswbstatement:P646=/m/0x",
    }
    monkeypatch.setitem(vars(catalogue), "codes", {})
    assert outside_links(catalogue, node) == {
        "WordNet": "https://en-word.net/lemma/swivel%20chair",
        "Wikidata": "https://www.wikidata.org/w/index.php?search=swivel%20chair",
    }
    assert "WordNet" not in outside_links(catalogue, catalogue.nodes["mt:bar_stool"])


def test_an_opening_has_its_length_and_its_height(catalogue: ReleaseCatalogue, monkeypatch: pytest.MonkeyPatch) -> None:
    """Through a category, its width (the depth of a door) does not count; into it, all three sides do."""
    sizes = {"swivel_chair.n.01": [620.0, 10.0, 1050.0]}
    monkeypatch.setattr("explorer.fit.random_sizes", lambda *_: np.array([sizes["swivel_chair.n.01"]]))
    through = fit_response(catalogue, FitQuery("60 x 100 x 300 cm", "swivel chair", "through"))
    assert (through.how, through.probability, through.is_upper_bound) == ("through", 1.0, False)
    assert "tilting is not considered" in through.reason
    inside = fit_response(catalogue, FitQuery("60 x 100 x 300 cm", "swivel chair"))
    assert (inside.how, inside.probability, inside.is_upper_bound) == ("in", 0.0, True)
    assert "outer sides of swivel chair" in inside.reason
    opening = fit_response(catalogue, FitQuery("60 x 100 x 300 cm", "90 x 200 cm"))
    assert (opening.how, opening.nodes) == ("through", [None, None])


@pytest.mark.parametrize(("code", "is_breaking"), [("E201", True), ("E401", True), ("E305", False)])
def test_a_release_that_breaks_the_format_has_no_report(
    mini: Tree, monkeypatch: pytest.MonkeyPatch, code: str, is_breaking: bool
) -> None:
    monkeypatch.setattr(report_page, "findings", lambda _: [Finding(code, "a.n.01", "is wrong")])
    if is_breaking:
        with pytest.raises(InputError, match=rf"{code}: a.n.01: is wrong .metric-tree validate."):
            report_page.page(mini)
    else:
        assert "is wrong" in report_page.page(mini)


@pytest.mark.parametrize(("chunk", "workers", "has_pool"), [(400, 2, False), (1, 1, False), (40, 2, True)])
def test_a_site_of_several_chunks_is_written_by_processes(
    chunk: int, workers: int, has_pool: bool, mini: Tree, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pools: list[int] = []

    class Pool:
        def __init__(self, n: int, *_: Any) -> None:
            pools.append(n)
            static_site._start_worker([mini.release.directory], 0)

        def __enter__(self) -> Any:
            return SimpleNamespace(submit=lambda *call: SimpleNamespace(result=lambda: call[0](*call[1:])))

        def __exit__(self, *_: object) -> None:
            pass

    monkeypatch.setattr(static_site, "ProcessPoolExecutor", Pool)
    monkeypatch.setattr(static_site, "end_with_parent", lambda: None)
    monkeypatch.setattr(static_site, "CHUNK", chunk)
    monkeypatch.setattr(static_site, "site_addresses", lambda _: [f"a{k}.html" for k in range(60)] + ["none.csv"])
    monkeypatch.setattr(static_site, "render", lambda _, address: None if address == "none.csv" else address.encode())
    size = static_site.write_site(tmp_path / "site", [mini], workers)
    assert (size.files, size.bytes) == (60, sum(len(f"a{k}.html") for k in range(60)))
    assert pools == [2] * has_pool

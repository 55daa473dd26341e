"""The HTTP server: questions, errors in one shape, caching, bounds, and the tools of the Model Context Protocol."""

from __future__ import annotations

import json
import math
import os
import signal
import socket
import subprocess
import sys
from argparse import ArgumentParser
from importlib.metadata import version
from pathlib import Path
from typing import Any
from urllib.parse import urljoin

import msgspec
import numpy as np
import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from schemathesis.specs.openapi.checks import positive_data_acceptance
from starlette.testclient import TestClient

from explorer.catalogue import ReleaseCatalogue
from explorer.routes import find_route
from explorer.schemas import NodeAnswer, PriorAnswer, Problem, SearchAnswer
from explorer.server.app import PREPARED, ReleaseServer, application, content_digest
from metric_base.errors import InputError
from metric_cli.subcommands.release import serve
from metric_tree.tree import Tree
from tests.explorer.conftest import WEB
from tests.support.processes import started

OBJECTS = {
    "schema": "metric-tree/objects/1",
    "objects": [
        {"id": f"chair {k}", "category": "swivel chair", "dimensions": {"length": 0.31, "width": 0.3, "height": 0.525}}
        for k in range(3)
    ],
}


def test_questions_answer_as_the_tree_does(base: str, catalogue: ReleaseCatalogue) -> None:
    node = msgspec.json.decode(WEB.get(f"{base}/v1/nodes/mt:bar_stool").content, type=NodeAnswer)
    assert (node.node, node.level, node.n_shipped) == ("mt:bar_stool", 5, 9)
    asked = {"dims": "height,length", "quantiles": "0.1,0.9", "density_at": "760,420,700,400"}
    answered = WEB.get(f"{base}/v1/nodes/mt-bar_stool/prior", params=asked)
    answer = msgspec.json.decode(answered.content, type=PriorAnswer)
    prior = catalogue.tree.find("bar stool").prior(("height", "length"))
    assert answer.dims == ["height", "length"]
    assert answer.quantiles_mm["height"]["0.9"] == pytest.approx(prior.quantile(0.9)[0], rel=1e-4)
    assert answer.log_density == pytest.approx(prior.log_density(np.array([[760, 420], [700, 400]])))
    hits = msgspec.json.decode(WEB.get(f"{base}/v1/search", params={"q": "mouse"}).content, type=SearchAnswer).hits
    assert [hit.node for hit in hits[:2]] == ["mouse.n.04", "mouse.n.01"]
    assert "coco_80" in hits[0].labels


def test_items_come_a_page_at_a_time(base: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("explorer.responses.PAGE_ROWS", 4)
    address, following, titles = f"{base}/v1/nodes/pointer.n.01/", "items?page=p1", []
    while following:
        address = urljoin(address, following)
        page = WEB.get(address).json()
        titles += [item["title"] for item in page["items"]]
        following = page["next"]
    assert len(titles) == len(set(titles)) == page["n_shipped"] == 13


@pytest.mark.parametrize(
    ("path", "status", "text"),
    [
        ("/nowhere", 404, "nothing is at"),
        ("/v1/nodes/none", 404, "none"),
        ("/releases/9.9.9/index.html", 404, "nothing is at /releases/9.9.9/"),
        ("/v1/search", 422, "required field `q`"),
        ("/v1/search?q=", 422, "length >= 1"),
        ("/v1/search?q=%20", 422, "spaces only"),
        ("/v1/search?q=" + "a" * 301, 422, "length <= 300"),
        ("/v1/search?q=a&limit=0", 422, "`int` >= 1"),
        ("/v1/search?q=a&limit=51", 422, "`int` <= 50"),
        ("/v1/search?q=a&limti=3", 422, "limti"),
        ("/v1/nodes/rat.n.01/prior?dims=depth", 422, "expected a prior that holds depth"),
        ("/v1/nodes/rat.n.01/prior?dims=height,height", 422, "each dimension once"),
        ("/v1/nodes/rat.n.01/prior?quantiles=2", 422, "between 0 and 1"),
        ("/v1/nodes/rat.n.01/prior?quantiles=a", 422, "expected numbers"),
        ("/v1/nodes/rat.n.01/prior?density_at=1,2", 422, "3 numbers each"),
        ("/v1/nodes/rat.n.01/prior?where=region=mars", 422, "region"),
        ("/v1/nodes/rat.n.01/items?cursor=x", 422, "cursor"),
        ("/pictures/aa/" + "a" * 64 + ".webp", 404, "nothing is at"),
    ],
)
def test_errors_have_one_shape(base: str, path: str, status: int, text: str) -> None:
    answer = WEB.get(base + path)
    problem = msgspec.json.decode(answer.content, type=Problem)
    assert answer.headers["content-type"] == "application/problem+json"
    assert (answer.status_code, problem.status) == (status, status)
    assert text in problem.detail


def test_each_release_has_its_description_and_scale(base: str, trees: list[Tree]) -> None:
    for prefix, tree in zip(("", f"/releases/{trees[1].version}"), trees, strict=True):
        assert WEB.get(f"{base}{prefix}/openapi.json").json()["info"]["version"] == tree.version
        assert WEB.post(f"{base}{prefix}/v1/scale", json=OBJECTS).json()["schema"] == "metric-tree/scale/1"
        assert WEB.get(f"{base}{prefix}/v1/nodes/rat.n.01").status_code == (404 if prefix else 200)
    assert WEB.get(f"{base}/releases/{trees[0].version}/index.html").status_code == 404


def test_a_method_that_is_not_taken(base: str) -> None:
    for answer in (WEB.delete(f"{base}/v1/releases"), WEB.get(f"{base}/v1/scale"), WEB.put(f"{base}/v1/scale")):
        assert answer.status_code == 405
        assert answer.headers["content-type"] == "application/problem+json"
    assert answer.headers["allow"] == "POST"


def test_caching_compression_and_other_origins(base: str) -> None:
    first = WEB.get(f"{base}/nodes/rat.n.01.html", headers={"accept-encoding": "gzip"})
    assert first.headers["content-encoding"] == "gzip"
    assert "max-age" in first.headers["cache-control"]
    assert first.headers["access-control-allow-origin"] == "*"
    again = WEB.get(f"{base}/nodes/rat.n.01.html", headers={"if-none-match": first.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    asked = {"origin": "https://example.org", "access-control-request-method": "POST"}
    assert "POST" not in WEB.options(f"{base}/v1/scale", headers=asked).headers["access-control-allow-methods"]
    assert WEB.head(f"{base}/index.html").content == b""


@pytest.mark.parametrize(
    ("accepted", "is_compressed"),
    [
        ("gzip", True),
        ("br, GZIP;q=0.5", True),
        ("*", True),
        ("gzip;q=0", False),
        ("gzip; q=0.000, *", False),
        ("", False),
    ],
)
def test_gzip_is_used_only_if_the_client_accepts_it(base: str, accepted: str, is_compressed: bool) -> None:
    answer = WEB.get(f"{base}/nodes/rat.n.01.html", headers={"accept-encoding": accepted})
    assert ("content-encoding" in answer.headers) == is_compressed


def test_compressed_and_plain_responses_have_different_etags(base: str) -> None:
    address, tags = f"{base}/nodes/rat.n.01.html", {}
    for coding in ("gzip", "identity"):
        tags[coding] = WEB.get(address, headers={"accept-encoding": coding}).headers["etag"]
    assert tags["gzip"] != tags["identity"]
    for coding, tag, status in (
        ("gzip", f'"x", {tags["gzip"]}', 304),
        ("identity", tags["gzip"], 304),  # a weak comparison
        ("identity", '"x"', 200),
        ("identity", "*", 304),
    ):
        headers = {"accept-encoding": coding, "if-none-match": tag}
        assert WEB.get(address, headers=headers).status_code == status


@pytest.mark.parametrize(
    ("asked", "status", "part"),
    [
        ("bytes=0-3", 206, slice(0, 4)),
        ("bytes=-8", 206, slice(-8, None)),
        ("bytes=4-", 206, slice(4, None)),
        ("bytes=4-99999999", 206, slice(4, None)),
        ("bytes=99999999-", 416, None),
        ("bytes=-0", 416, None),
        ("items=0-3", 200, slice(None)),
    ],
)
def test_ranges_of_bytes_for_remote_readers(
    base: str, monkeypatch: pytest.MonkeyPatch, asked: str, status: int, part: slice | None
) -> None:
    monkeypatch.setattr("explorer.tables.MIN_PARQUET_ROWS", 1)
    address = f"{base}/v1/nodes/pointer.n.01/items.parquet"
    whole = WEB.get(address)
    answer = WEB.get(address, headers={"range": asked})
    assert (answer.status_code, whole.headers["accept-ranges"]) == (status, "bytes")
    if part is None:
        assert answer.headers["content-range"] == f"bytes */{len(whole.content)}"
    else:
        assert answer.content == whole.content[part]
    for tag, expected in ((whole.headers["etag"], status), ('"other"', 200)):
        assert WEB.get(address, headers={"range": asked, "if-range": tag}).status_code == expected


@pytest.mark.parametrize("name", ["bar stool", "mt-bar_stool", "mt:bar_stool"])
def test_an_address_may_have_the_name_of_a_node(base: str, name: str) -> None:
    assert WEB.get(f"{base}/v1/nodes/{name}").json()["node"] == "mt:bar_stool"
    assert WEB.get(f"{base}/v1/nodes/{name}/prior").json()["node"] == "mt:bar_stool"


@pytest.mark.parametrize(
    ("media_type", "status"),
    [
        ("application/json", 200),
        ("APPLICATION/JSON; charset=utf-8", 200),
        ("text/plain;json", 415),
        ("application/jsonp", 415),
        ("text/plain; application/json", 415),
        ("", 415),
    ],
)
def test_only_json_is_a_scale_request(base: str, media_type: str, status: int) -> None:
    answer = WEB.post(f"{base}/v1/scale", content=json.dumps(OBJECTS), headers={"content-type": media_type})
    assert answer.status_code == status


@pytest.mark.parametrize(("origin", "status"), [("BASE", 200), ("https://example.org", 403), ("null", 403)])
def test_a_scale_request_from_a_page_of_another_host_is_refused(base: str, origin: str, status: int) -> None:
    answer = WEB.post(f"{base}/v1/scale", json=OBJECTS, headers={"origin": origin.replace("BASE", base)})
    assert answer.status_code == status


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("localhost:8000", 200),
        ("sizes.example.org", 200),
        ("[::1]:8000", 200),
        ("example.org", 400),
        ("localhost.org", 400),
    ],
)
def test_only_allowed_hosts_are_served(trees: list[Tree], host: str, status: int) -> None:
    served = TestClient(application(trees, allowed_hosts=["localhost", "[::1]", "*.example.org"]))
    assert served.get("/healthz", headers={"host": host}).status_code == status


@pytest.mark.parametrize(
    ("sent", "reply"),
    [
        (b"GET /healthz HTTP/1.1\r\nhost: a\r\n", b""),
        (b"", b""),
        (b"GET /healthz HTTP/1.1\r\nhost: a\r\n\r\nGET /", b"HTTP/1.1 200 OK"),
        (
            b"POST /v1/scale HTTP/1.1\r\nhost: a\r\ncontent-type: application/json\r\ncontent-length: 9\r\n\r\n{",
            b"HTTP/1.1 408 Request Timeout",
        ),
    ],
)
def test_slow_clients_are_disconnected(base: str, monkeypatch: pytest.MonkeyPatch, sent: bytes, reply: bytes) -> None:
    monkeypatch.setattr("explorer.server.connections.MAX_HEAD_S", 0.2)
    monkeypatch.setattr("explorer.server.app.MAX_BODY_S", 0.2)
    host, _, port = base.removeprefix("http://").partition(":")
    with socket.create_connection((host, int(port)), timeout=60) as client:
        client.sendall(sent)
        received = b"".join(iter(lambda: client.recv(65536), b""))  # ends when the server closes the connection
    assert received.partition(b"\r\n")[0] == reply


def test_the_scale_of_objects(base: str) -> None:
    answer = WEB.post(f"{base}/v1/scale", json=OBJECTS)
    record = answer.json()
    assert record["schema"] == "metric-tree/scale/1"
    assert record["scale"] == pytest.approx(2, rel=0.1)
    assert answer.content == WEB.post(f"{base}/v1/scale", json=OBJECTS).content
    known = {**OBJECTS, "known_lengths": [{"units": 1.0, "metres": 2.05}]}
    with_length = WEB.post(f"{base}/v1/scale", json=known).json()
    widths = [math.log(one["interval"]["high"] / one["interval"]["low"]) for one in (record, with_length)]
    assert widths[1] < widths[0]


@pytest.mark.parametrize(
    ("body", "status", "text"),
    [
        (b"{", 422, "expected metric-tree/objects/1"),
        (b'{"objects": []}', 422, "length >= 1"),
        (json.dumps({"objects": [{"category": "rat", "dimensions": {"height": -1}}]}).encode(), 422, "height"),
        (json.dumps({**OBJECTS, "known_lengths": [{"units": 0}]}).encode(), 422, "known_lengths[0]"),
        (json.dumps({**OBJECTS, "level": 2}).encode(), 422, "level"),
        (b" " * 1_000_001, 413, "1,000,000"),
    ],
)
def test_a_request_of_the_scale_is_checked(base: str, body: bytes, status: int, text: str) -> None:
    answer = WEB.post(f"{base}/v1/scale", content=body, headers={"content-type": "application/json"})
    assert (answer.status_code, text in answer.json()["detail"]) == (status, True), answer.json()


def test_too_many_jobs_are_refused_at_once(base: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("explorer.server.scale_jobs.MAX_JOBS", 0)
    answer = WEB.post(f"{base}/v1/scale", json=OBJECTS)
    assert (answer.status_code, answer.headers["retry-after"]) == (503, "5")


def test_the_description_fits_the_answers(base: str) -> None:
    """Requests made from the server's own OpenAPI description: no internal error, and every answer as described.

    That all requests of the described form are accepted is not checked: no form tells which names a release has.
    """
    schema = schemathesis.openapi.from_url(f"{base}/openapi.json")
    seen = set()
    for operation in schema.get_all_operations():

        @settings(deadline=None, suppress_health_check=list(HealthCheck), phases=[Phase.generate])
        @given(case=operation.ok().as_strategy())
        def check(case: Any) -> None:
            case.call_and_validate(timeout=300, excluded_checks=[positive_data_acceptance])
            seen.add(case.path)

        check()
    assert len(seen) == 10


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_the_command_serves_logs_and_stops(catalogue: ReleaseCatalogue) -> None:
    code = "import sys; from metric_cli.subcommands import main; sys.exit(main(sys.argv[1:]))"
    words = ["serve", "--port", "0", "--tree", str(catalogue.tree.release.directory)]
    with started([sys.executable, "-c", code, *words], stderr=subprocess.PIPE, text=True) as server:
        assert server.stderr is not None
        address = next(line.split()[-5] for line in server.stderr if "running on" in line)
        assert WEB.get(f"{address}/healthz").json()["releases"] == {"0.0.2": catalogue.etag}
        assert json.loads(next(server.stderr))["path"] == "/healthz"
        os.kill(server.pid, signal.SIGTERM)
    assert server.returncode == 128 + signal.SIGTERM


def test_a_prepared_server_has_its_tables_before_the_first_request(
    trees: list[Tree], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    outdated = tmp_path / f"{trees[0].version}-0" / "index.html"
    outdated.parent.mkdir()
    outdated.write_bytes(b"of another program")
    server = ReleaseServer(ReleaseCatalogue(trees), tmp_path)
    assert "sizes" not in vars(server.catalogue)
    server.prepare()
    assert {"items", "sizes", "kinds"} <= set(vars(server.catalogue))
    assert not outdated.exists()
    # the next server of the release makes no table
    for name in ("name_index", "size_index", "tables.sizes_table"):
        monkeypatch.setattr(f"explorer.routes.{name}", None)
    again = ReleaseServer(ReleaseCatalogue(trees), tmp_path)
    again.prepare()
    for address in PREPARED:
        found = find_route(again.catalogue, address)
        assert found is not None
        assert again.file(*found) == server.folder / address
        assert (server.folder / address).stat().st_size > 100


def test_files_of_another_release_or_program_are_not_served(
    catalogue: ReleaseCatalogue, trees: list[Tree], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    digest = content_digest(catalogue)
    assert content_digest(ReleaseCatalogue(trees)) == digest
    assert content_digest(ReleaseCatalogue(trees[:1])) != digest, "other releases are on the home page"
    assert content_digest(ReleaseCatalogue(trees[::-1])) != digest
    monkeypatch.setattr("explorer.server.app.taxonomy_directory", lambda: tmp_path)
    before = content_digest(catalogue)
    (tmp_path / "names.csv").write_text("a")
    assert content_digest(catalogue) != before


def test_tools_of_the_model_context_protocol(catalogue: ReleaseCatalogue) -> None:
    """By the protocol's own client, over standard input and output."""
    import asyncio

    from mcp import ClientSession, StdioServerParameters
    from mcp.client.stdio import stdio_client

    code = "import sys; from metric_cli.subcommands import main; sys.exit(main(sys.argv[1:]))"
    words = ["-c", code, "serve", "--mcp", "--tree", str(catalogue.tree.release.directory)]

    async def ask() -> dict[str, Any]:
        server = StdioServerParameters(command=sys.executable, args=words)
        async with stdio_client(server) as (read, write), ClientSession(read, write) as session:
            assert (await session.initialize()).server_info.version == version("metric-tree")
            listed = (await session.list_tools()).tools
            assert all(tool.annotations and tool.annotations.read_only_hint for tool in listed)
            assert all("description" in field for tool in listed for field in tool.input_schema["properties"].values())
            tools = {tool.name for tool in listed}
            limit = next(tool for tool in listed if tool.name == "vocabulary").input_schema["properties"]["limit"]
            assert (limit["minimum"], limit["maximum"], limit["default"]) == (1, 100, 100)
            asked = {
                "search": {"query": "mouse"},
                "node": {"name": "mouse", "vocabulary": "coco_80"},
                "prior": {"name": "rat", "dims": ["height"]},
                "compare": {"names": ["rat", "trackball"]},
                "fit": {"object": "rat", "into": "2 x 2 x 2 m"},
                "vocabulary": {"name": "coco_80", "offset": 70, "limit": 6},
                "scale": {"objects": OBJECTS["objects"]},
            }
            answers = {name: await session.call_tool(name, given) for name, given in asked.items()}
            rest = await session.call_tool("vocabulary", {"name": "coco_80", "offset": 76, "limit": 6})
            page = json.loads(rest.content[0].text)
            assert (len(page["labels"]), page["next_offset"]) == (4, None)
            refused = await session.call_tool("node", {"name": "no such thing"})
            return {"tools": tools, "answers": answers, "refused": refused}

    replies = asyncio.run(ask())
    assert replies["tools"] == {"search", "node", "prior", "compare", "fit", "vocabulary", "scale"}
    records = {name: json.loads(answer.content[0].text) for name, answer in replies["answers"].items()}
    assert records["node"]["node"] == "mouse.n.04"
    assert (len(records["vocabulary"]["labels"]), records["vocabulary"]["next_offset"]) == (6, 76)
    assert list(records["prior"]["quantiles_mm"]) == ["height"]
    assert (records["fit"]["how"], records["fit"]["probability"]) == ("in", 1.0)
    assert [row["node"] for row in records["compare"]["nodes"]] == ["rat.n.01", "trackball.n.01"]
    assert records["scale"]["scale"] == pytest.approx(2, rel=0.1)
    assert "no such thing" in replies["refused"].content[0].text


def test_serve_prepare_writes_the_tables_to_the_cache(
    trees: list[Tree], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    parser = ArgumentParser()
    serve.add_arguments(parser)
    arguments = parser.parse_args(["--prepare", "--tree", str(trees[0].release.directory)])
    monkeypatch.setenv("METRIC_TREE_CACHE", str(tmp_path / "cache"))
    serve.run(arguments)
    (folder,) = (tmp_path / "cache" / "pages").iterdir()
    assert folder.name.startswith(trees[0].version)
    assert all((folder / address).is_file() for address in PREPARED)
    (tmp_path / "file").write_bytes(b"")
    monkeypatch.setenv("METRIC_TREE_CACHE", str(tmp_path / "file"))
    with pytest.raises(InputError, match=r"pages: expected a folder that can be written"):
        serve.run(arguments)

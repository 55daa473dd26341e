"""The bytes of the site, of the server and of the functions behind both are the same."""

from __future__ import annotations

import gzip
import json
import re
from pathlib import Path

import pytest

import metric_tree
from explorer.catalogue import ReleaseCatalogue
from explorer.responses import sentence
from explorer.routes import ROUTES, find_route, render, site_addresses
from explorer.static_site import write_site
from metric_base.errors import InputError
from metric_tree.node import UnknownName
from metric_tree.tree import Tree
from tests.explorer.conftest import WEB
from tests.synthetic import minitree

#: One address of each kind.
KINDS = [
    "index.html", "tree.html", "about.html", "compare.html", "scale.html", "sources/index.html", "sources/made.html",
    "vocabularies/index.html", "vocabularies/coco_80.html", "vocabularies/coco_80.csv", "changes/0.0.1.html",
    "nodes/swivel_chair.n.01.html", "nodes/mt-bar_stool.html", "nodes/entity.n.01.html", "assets/names.js",
    "assets/sizes.js", "assets/style.css", "v1/releases.json", "v1/nodes/swivel_chair.n.01.json",
    "v1/nodes/swivel_chair.n.01/prior.json", "v1/nodes/swivel_chair.n.01/items.json",
    "v1/nodes/swivel_chair.n.01/items.csv", "v1/vocabularies/coco_80.json",
]  # fmt: skip


@pytest.mark.parametrize("prefix", ["", "releases/0.0.1/"])
@pytest.mark.parametrize("address", KINDS)
def test_site_and_server_have_the_same_bytes(base: str, site: Path, address: str, prefix: str) -> None:
    if prefix and address.startswith("changes"):
        address = "changes/0.0.2.html"
    served = WEB.get(f"{base}/{prefix}{address}")
    assert served.status_code == 200
    assert served.content == (site / prefix / address).read_bytes()


def test_every_address_of_the_site_has_an_answer_and_every_link_leads_to_one(
    catalogue: ReleaseCatalogue, site: Path
) -> None:
    addresses = set(site_addresses(catalogue))
    assert len(addresses) > 100
    broken = set()
    for page in site.rglob("*.html"):
        for link in re.findall(r'(?:href|src)="([^"#?]*)', page.read_text(encoding="utf-8")):
            if link and not link.startswith(("http:", "https:")) and not (page.parent / link).resolve().is_file():
                broken.add((str(page.relative_to(site)), link))
    assert broken == set()


def test_a_page_loads_nothing_from_outside(site: Path) -> None:
    loading = re.compile(r'<(?:script|img|link|iframe)[^>]+(?:src|href)="(?:https?:)?//')
    assert [page for page in site.rglob("*.html") if loading.search(page.read_text(encoding="utf-8"))] == []


def test_text_of_a_source_is_escaped(trees: list[Tree]) -> None:
    catalogue = ReleaseCatalogue(trees)
    rows = catalogue.items.to_pylist()
    rows[0]["title"], rows[0]["url"] = "<script>alert(1)</script>", "javascript:alert(1)"
    catalogue.__dict__["items"] = type(catalogue.items).from_pylist(rows, schema=catalogue.items.schema)
    page = render(catalogue, f"nodes/{rows[0]['node_id']}.html")
    assert page is not None
    assert b"<script>alert" not in page
    assert b"javascript:" not in page
    assert b"&lt;script&gt;alert" in page


def test_a_page_says_which_height_is_meant() -> None:
    tree = metric_tree.open()
    said = sentence(ReleaseCatalogue([tree]), tree.find("bathtub"))
    assert said.startswith("Objects of the category bath and pool are about 53 cm high")
    assert said.endswith("Height: rim to floor, outside.")


def test_a_page_says_the_tier_then_the_size(catalogue: ReleaseCatalogue) -> None:
    page = render(catalogue, "nodes/swivel_chair.n.01.html")
    assert page is not None
    text = page.decode()
    assert (
        text.index('class="tier')
        < text.index('<p class="sentence">A swivel chair is about 1.1\u00a0m high')
        < text.index("<h2")
    )
    assert text.count('<svg viewBox="0 0 340') == 5  # to scale, three dimensions, one against another
    assert len(gzip.compress(page)) < 60_000


def test_the_index_of_names_means_what_the_resolver_means(catalogue: ReleaseCatalogue) -> None:
    synthetic = render(catalogue, "assets/names.js")
    assert synthetic is not None
    content = json.loads(synthetic.decode().removeprefix("var MT_NAMES=").rstrip(";\n"))
    nodes = [line.split("\t")[0] for line in content["nodes"].split("\n")]
    shared = dict(line.split("\t") for line in content["shared"].split("\n"))
    owners = [nodes[int(place)] for place in shared["mouse"].split(",")]
    assert owners[0] == catalogue.tree.resolve("mouse").node.node_id == "mouse.n.04"
    assert set(owners) == {"mouse.n.04", "mouse.n.01"}
    line = content["labels"].split("\n")[nodes.index("mouse.n.04")]
    assert chr(97 + content["lists"].index("coco_80")) in line.split("@")[1]


def test_what_changed(catalogue: ReleaseCatalogue) -> None:
    page = render(catalogue, "changes/0.0.1.html")
    assert page is not None
    text = page.decode()
    assert "bar stool" in text.partition("New categories")[0]
    assert "-18%" in text  # exp(-.2) - 1
    assert "track ball" in text
    assert "rat</a>" in text.partition("New categories")[2]


@pytest.mark.parametrize(
    "address",
    ["nodes/none.html", "v1/nodes/none/items.csv", "../manifest.json", "assets/../x", "vocabularies/x.csv", ""],
)
def test_nothing_is_elsewhere(catalogue: ReleaseCatalogue, address: str) -> None:
    assert render(catalogue, address) is None


@pytest.mark.parametrize("address", ["v1/nodes/none.json", "v1/nodes/a/b/c.json", "v1/nodes/none/prior"])
def test_an_unknown_node_is_an_error_with_its_name(catalogue: ReleaseCatalogue, address: str) -> None:
    with pytest.raises(UnknownName, match=r"none|a/b/c"):
        render(catalogue, address)


def test_every_address_of_the_site_belongs_to_the_route_that_lists_it(catalogue: ReleaseCatalogue) -> None:
    """No earlier route with a wider pattern takes an address, and every static route has addresses."""
    served = set()
    for address in site_addresses(catalogue):
        found = find_route(catalogue, address)
        assert found is not None, address
        route, text, value = found
        assert route.path.replace(f"{{{route.parameter}}}", text) == address
        if route.content(catalogue, value) is not None:
            served.add(route.path)
    assert {route.path for route in ROUTES if route.is_static} - served == {"v1/nodes/{slug}/items.parquet"}


@pytest.mark.parametrize("change", [-1, 0])
def test_nodes_with_enough_items_have_a_parquet_file(
    catalogue: ReleaseCatalogue, monkeypatch: pytest.MonkeyPatch, change: int
) -> None:
    node = catalogue.by_slug["mt-bar_stool"]
    monkeypatch.setattr("explorer.tables.MIN_PARQUET_ROWS", len(catalogue.rows(node)) - change)
    assert (render(catalogue, "v1/nodes/mt-bar_stool/items.parquet") is not None) == (change == 0)


def test_a_site_replaces_nothing(trees: list[Tree], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected a folder that is not there yet"):
        write_site(tmp_path, trees)
    with pytest.raises(InputError, match="different versions"):
        write_site(tmp_path / "site", [trees[0], trees[0]])
    assert list(tmp_path.iterdir()) == []


def test_spreadsheets_run_no_cell() -> None:
    from metric_base.records import csv_text

    assert csv_text(["a"], [["=1+1"], ["plain"], [None], [[1.5, 2.0]]]) == b'a\n\'=1+1\nplain\n""\n1.5 2.0\n'
    formulas = ["=1", "+1", "-1", "@a", "\n=1", "\t@a", " \r\n-1", "a\x1b[2J\u202e"]
    lines = csv_text(["a"], [[text] for text in [*formulas, "", -1.5]]).decode().split("\n")
    shown = ["'=1", "'+1", "'-1", "'@a", "'\\n=1", "'\\t@a", "' \\r\\n-1", r"a\x1b[2J\u202e"]
    assert lines == ["a", *shown, '""', "-1.5", ""]


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [("node_id", "nobody", "ids of nodes; found nobody"), ("length_mm", -5.0, "positive sizes; found -5"),
     ("height_mm", float("inf"), "positive sizes; found inf")],
)  # fmt: skip
def test_items_of_no_node_or_no_size_have_no_site(field: str, value: object, message: str, tmp_path: Path) -> None:
    content = minitree.rows()
    content["items.parquet"][3][field] = value
    tree = Tree(minitree.release(tmp_path / "r", content))
    with pytest.raises(InputError, match=message):
        write_site(tmp_path / "site", [tree], workers=1)
    assert not (tmp_path / "site").exists()

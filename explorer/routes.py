"""From a release and an address to bytes: the one function behind the files of a site and the answers of a server."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import msgspec

from explorer.catalogue import ReleaseCatalogue
from explorer.pages.node_page import node_page
from explorer.pages.release_pages import (
    about_page,
    change_page,
    compare_page,
    home_page,
    scale_page,
    source_page,
    sources_page,
    tree_page,
    vocabularies_page,
    vocabulary_page,
)
from explorer.responses import (
    images_answer,
    items_answer,
    node_answer,
    prior_answer,
    releases_answer,
    vocabulary_answer,
)
from explorer.search_index import name_index, size_index
from explorer.tables import items_csv, items_parquet, vocabulary_csv
from explorer.urls import (
    LEAST_PARQUET,
    LISTED_LEVEL,
    csv_of,
    images_of,
    items_of,
    json_of,
    page_of,
    parquet_of,
    prior_of,
)
from metric_tree.node import Node

_TYPES = {
    "html": "text/html; charset=utf-8",
    "json": "application/json",
    "js": "text/javascript; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "svg": "image/svg+xml",
    "csv": "text/csv; charset=utf-8",
    "parquet": "application/vnd.apache.parquet",
    "webp": "image/webp",
    "jpg": "image/jpeg",
    "png": "image/png",
}

#: Pages of the whole release.
_PAGES: dict[str, Callable[[ReleaseCatalogue], bytes]] = {
    "index.html": home_page,
    "tree.html": tree_page,
    "about.html": about_page,
    "compare.html": compare_page,
    "scale.html": scale_page,
    "sources/index.html": sources_page,
    "vocabularies/index.html": vocabularies_page,
    "assets/names.js": name_index,
    "assets/sizes.js": size_index,
    "v1/releases.json": lambda catalogue: msgspec.json.encode(releases_answer(catalogue)),
}

_ASSETS = ("style.css", "page.js", "search.js", "compare.js", "scale.js", "view3d.js", "icon.svg")


def _prior(catalogue: ReleaseCatalogue, node: Node) -> bytes | None:
    prior = catalogue.prior(node)
    return None if prior is None else msgspec.json.encode(prior_answer(catalogue, node, prior))


#: What there is of each node, by the end of its address after `v1/nodes/SLUG`.
_NODE_FILES: dict[str, Callable[[ReleaseCatalogue, Node], bytes | None]] = {
    ".json": lambda catalogue, node: msgspec.json.encode(node_answer(catalogue, node)),
    "/prior.json": _prior,
    "/items.json": lambda catalogue, node: msgspec.json.encode(items_answer(catalogue, node)),
    "/images.json": lambda catalogue, node: msgspec.json.encode(images_answer(catalogue, node)),
    "/items.csv": items_csv,
    "/items.parquet": items_parquet,
}

#: Pages and files of label lists: folder and ending.
_LISTS: dict[tuple[str, str], Callable[[ReleaseCatalogue, str], bytes]] = {
    ("vocabularies", "html"): vocabulary_page,
    ("vocabularies", "csv"): vocabulary_csv,
    ("v1/vocabularies", "json"): lambda catalogue, name: msgspec.json.encode(vocabulary_answer(catalogue, name)),
}

_NODE_FILE = re.compile(
    r"v1/nodes/(?P<slug>[^/]+?)(?P<rest>(?:/(?:prior|items|images))?\.json|/items\.(?:csv|parquet))"
)
_NAMED = re.compile(r"(?P<folder>nodes|sources|changes|(?:v1/)?vocabularies)/(?P<name>[^/]+)\.(?P<kind>html|json|csv)")


@dataclass(frozen=True, slots=True)
class Answer:
    """The bytes at an address, and their media type."""

    body: bytes
    media_type: str


def answer(catalogue: ReleaseCatalogue, address: str) -> Answer | None:
    """What is at an address of a release; None if nothing is.

    Parameters
    ----------
    address : relative to the release, as `explorer.urls` writes them: `nodes/chair.n.01.html`
    """
    body = _body(catalogue, address)
    return None if body is None else Answer(body, _TYPES[address.rpartition(".")[2]])


def site_addresses(catalogue: ReleaseCatalogue) -> Iterator[str]:
    """Every address of the static site but the images; those of the nodes last."""
    yield from _PAGES
    yield from (f"assets/{name}" for name in _ASSETS)
    yield from (f"sources/{source}.html" for source in catalogue.sources)
    yield from (f"changes/{tree.version}.html" for tree in catalogue.others)
    for name in catalogue.vocabularies:
        yield from (f"vocabularies/{name}.html", f"vocabularies/{name}.csv", f"v1/vocabularies/{name}.json")
    for node in catalogue.nodes.values():
        yield from _node_addresses(catalogue, node.node_id)


def _node_addresses(catalogue: ReleaseCatalogue, node_id: str) -> Iterator[str]:
    node, rows = catalogue.nodes[node_id], len(catalogue.rows(catalogue.nodes[node_id]))
    yield from (page_of(node_id), json_of(node_id), items_of(node_id), images_of(node_id))
    if catalogue.prior(node) is not None:
        yield prior_of(node_id)
    listed = node.level >= LISTED_LEVEL
    if rows and listed:
        yield csv_of(node_id)
    if rows >= LEAST_PARQUET and listed:
        yield parquet_of(node_id)


def _body(catalogue: ReleaseCatalogue, address: str) -> bytes | None:
    if address in _PAGES:
        return _PAGES[address](catalogue)
    folder, _, name = address.partition("/")
    if folder == "assets":
        return _asset(name) if name in _ASSETS else None
    if folder == "v1" and (match := _NODE_FILE.fullmatch(address)):
        known = match["slug"] in catalogue.by_slug
        return _NODE_FILES[match["rest"]](catalogue, catalogue.node(match["slug"])) if known else None
    match = _NAMED.fullmatch(address)
    return _named(catalogue, match["folder"], match["name"], match["kind"]) if match else None


@cache
def _asset(name: str) -> bytes:
    return files("explorer.pages").joinpath("assets", name).read_bytes()


def _named(catalogue: ReleaseCatalogue, folder: str, name: str, kind: str) -> bytes | None:
    if folder == "nodes":
        return node_page(catalogue, catalogue.node(name)) if kind == "html" and name in catalogue.by_slug else None
    if folder == "sources":
        return source_page(catalogue, name) if kind == "html" and name in catalogue.sources else None
    if folder == "changes":
        other = next((tree for tree in catalogue.others if tree.version == name), None)
        return change_page(catalogue, other) if kind == "html" and other is not None else None
    made = _LISTS.get((folder, kind))
    return made(catalogue, name) if made and name in catalogue.vocabularies else None

"""Readers of the inputs of crawls, imports and builds: pages, images, raw items, declarations, releases."""

from __future__ import annotations

import gzip
import json
import shutil
from contextlib import suppress
from functools import cache
from pathlib import Path

import crawler.sites.registry
from crawler.fetch.item_images import picture
from crawler.imports import import_source
from crawler.imports.declaration import source
from crawler.items import RawItem, raw_items
from crawler.page.page import page, saved_page
from crawler.page.urls import absolute_url
from crawler.sites.listing import listed_items
from crawler.sites.registry import SITES, item_of, use_site
from metric_base.folders import data_folder
from metric_tree.checks.release_files import findings
from metric_tree.node import UnknownName
from metric_tree.release.release import MANIFEST, sha256
from metric_tree.tree import Tree, open_tree
from tests.fuzz.reader import Reader
from tests.synthetic.hostile_pictures import shop_picture
from tests.synthetic.minitree import release
from tests.synthetic.raw_fixture import synthetic_items

__all__ = ["WEB_READERS", "write_web_seeds"]

#: Shipped examples: a page with the declaration of its site, and a table with the declaration of its source.
EXAMPLES = data_folder() / "examples"
#: Six of the synthetic shop pages, with tables, lists and structured data.
SHOP_PAGES = sorted((Path(__file__).parents[1] / "crawler" / "page" / "shops").glob("*.html"))[::50]
#: Maximum number of lines that are read from a file of names, because an unknown name takes up to a second.
MAX_LINES = 3
URL = "https://www.lamps.example/p/17"


def _page(file: Path, _seeds: Path) -> None:
    read = saved_page(file, URL)
    _check_item(item_of(read).line())
    for address in read.links:
        absolute_url(URL, address)
    for item in listed_items(read, SITES[1]):
        _check_item(item.line())


def _check_item(line: str) -> None:
    """Assert that a raw item is unchanged after it is written and read."""
    assert RawItem.from_line(line.encode()).line() == line, "item changes when it is written and read"


def _raw_items(file: Path, _seeds: Path) -> None:
    for item in raw_items(file):
        _check_item(item.line())


def _site(folder: Path, _seeds: Path) -> None:
    try:
        site = use_site(folder / "lamps.toml")
        read = page((folder / "page.html").read_bytes(), URL)
        item_of(read)
        list(listed_items(read, site))
        list(site.addresses("a lamp", "lamps/table"))
        site.canonical_url(URL + "?colour=red")
        site.may_store(URL)
    finally:
        crawler.sites.registry._GIVEN.clear()
        crawler.sites.registry._site_of_host.cache_clear()


def _source(folder: Path, _seeds: Path) -> None:
    declared = source("lamps", folder)
    for item in import_source(declared, folder).items:
        _check_item(item.line())


def _release(folder: Path, _seeds: Path) -> None:
    _sign(folder)
    findings(folder)
    tree = open_tree(folder)
    for node in tree:
        node.items()
        for dims in node.prior_dims:
            node.prior(dims).interval(0.9)
    tree.search("chair")


def _sign(folder: Path) -> None:
    """Write the sizes and checksums of the tables to the manifest, if it is valid JSON, as an attacker can do."""
    path = folder / MANIFEST
    try:
        manifest = json.loads(path.read_bytes())
        for table in folder.glob("*.parquet"):
            manifest["files"][table.name] |= {"bytes": table.stat().st_size, "sha256": sha256(table)}
    except (ValueError, KeyError, TypeError, RecursionError):
        return
    path.write_text(json.dumps(manifest))


@cache
def _tree() -> Tree:
    return open_tree()


def _words(folder: Path, _seeds: Path) -> None:
    text = (folder / "words.txt").read_bytes().decode("utf-8", "surrogateescape")
    for line in text.split("\n")[:MAX_LINES]:
        with suppress(UnknownName):
            assert _tree().resolve(line).node.node_id in _tree(), "node is not in the tree"
        _tree().search(line, 3)


def _crawl_image(file: Path, _seeds: Path) -> None:
    folder = file.parent / "kept"
    result = picture(file.read_bytes(), URL, "a:b", folder)
    assert isinstance(result, str) or (folder / result.path).is_file(), "no file of an accepted image"
    shutil.rmtree(folder, ignore_errors=True)


WEB_READERS = (
    Reader("page", "pages", ("page*",), _page, alone=True),
    Reader("raw-items", "raw", ("*.jsonl", "*.gz"), _raw_items, alone=True),
    Reader("site", "site", ("lamps.toml",), _site),
    Reader("source", "source", ("lamps.toml", "lamps.csv"), _source),
    Reader("release", "release", ("manifest.json", "*.parquet"), _release),
    Reader("words", "words", ("words.txt",), _words),
    Reader("crawl-picture", "pictures", ("picture.*",), _crawl_image, alone=True),
)


def write_web_seeds(folder: Path) -> None:
    """Write a folder of intact files in each format."""
    for part in ("pages", "raw", "words", "pictures"):
        (folder / part).mkdir(parents=True)
    for index, path in enumerate(SHOP_PAGES):
        text = path.read_text(encoding="utf-8").replace('<meta charset="utf-8">', "")
        body = text.encode("utf-16" if index == 0 else "utf-8")
        (folder / "pages" / f"page{index}").write_bytes(gzip.compress(body) if index == 1 else body)
    lines = "".join(item.line() + "\n" for item in synthetic_items(2))
    (folder / "raw" / "made.jsonl").write_text(lines)
    (folder / "raw" / "packed.jsonl.gz").write_bytes(gzip.compress(lines.encode()))
    for part in ("site", "source"):
        shutil.copytree(EXAMPLES / part, folder / part)
    release(folder / "release")
    words = 'black office chair\nmouse\nStühle aus Holz, 4er-Set\nthe left half of a 19" monitor stand (used)\n扶手椅\n'
    (folder / "words" / "words.txt").write_text(words, encoding="utf-8")
    for kind in ("JPEG", "PNG", "WEBP"):
        (folder / "pictures" / f"picture.{kind.lower()}").write_bytes(shop_picture(0, (80, 72), kind))

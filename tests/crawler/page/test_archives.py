"""Pages of WARC files and N-Quads, written after the specifications (ISO 28500; RDF 1.1 N-Quads)."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

import brotli
import pytest

from crawler.items import raw_items
from crawler.page import archives
from crawler.page.archives import archived_pages
from crawler.page.page import page
from crawler.sites.registry import item_of
from metric_base.errors import InputError
from metric_cli.subcommands import main
from tests.support.processor_time import processor_seconds

TABLE = "<html lang='en'><title>{}</title><table><tr><th>Dimensions</th><td>{}</td></tr></table></html>"
PROSE = "<html lang='en'><title>News</title><p>No product is described here.</p></html>"
PRODUCT = """\
_:n1 <http://www.w3.org/1999/02/22-rdf-syntax-ns#type> <http://schema.org/Product> <https://shop.example/{0}> .
_:n1 <http://schema.org/{3}name> "Oak \\"{0}\\" \\u00e9"@en <https://shop.example/{0}> .
_:n1 <http://schema.org/{3}sku> "{0}-7" <https://shop.example/{0}> .
_:n1 <http://schema.org/{3}category> "Furniture > Shelves"@en <https://shop.example/{0}> .
_:n1 <http://schema.org/{3}width> _:n2 <https://shop.example/{0}> .
_:n2 <http://schema.org/value> "{1}"^^<http://www.w3.org/2001/XMLSchema#decimal> <https://shop.example/{0}> .
_:n2 <http://schema.org/unitCode> "CMT" <https://shop.example/{0}> .
_:n1 <http://schema.org/{3}height> "{2}"@en <https://shop.example/{0}> .
_:n1 <http://schema.org/isRelatedTo> _:n1 <https://shop.example/{0}> .
"""


def record(kind: str, url: str, content: bytes) -> bytes:
    fields = f"WARC/1.0\r\nWARC-Type: {kind}\r\nWARC-Target-URI: {url}\r\nWARC-Date: 2026-01-02T03:04:05Z\r\n"
    fields += f"WARC-Record-ID: <urn:uuid:{len(content)}>\r\nContent-Length: {len(content)}\r\n\r\n"
    return fields.encode() + content + b"\r\n\r\n"


def response(url: str, body: bytes, fields: str = "", status: str = "200 OK") -> bytes:
    head = f"HTTP/1.1 {status}\r\nContent-Type: text/html; charset=utf-8\r\n{fields}\r\n"
    return record("response", url, head.encode() + body)


def warc_records() -> list[bytes]:
    """Return the records of a file: six pages with a size, one without, one damaged, and records that are not pages."""
    pages = [TABLE.format(f"Shelf {number}", f"80 x 24 x 1{number} cm").encode() for number in range(6)]
    packed = gzip.compress(pages[1])
    chunked = b"%x\r\n%s\r\n0\r\n\r\n" % (len(pages[2]), pages[2])
    return [
        record("warcinfo", "", b"software: a test\r\n"),
        record("request", "https://shop.example/0", b"GET /0 HTTP/1.1\r\nHost: shop.example\r\n\r\n"),
        response("https://shop.example/0", pages[0], f"Content-Length: {len(pages[0])}\r\n"),
        response("<https://shop.example/1>", packed, f"Content-Encoding: gzip\r\nContent-Length: {len(packed)}\r\n"),
        response("https://shop.example/2", chunked, "Transfer-Encoding: chunked\r\n"),
        response("https://shop.example/3", pages[3], "Content-Length: 99999\r\n"),  # of the packed transfer
        response("https://shop.example/4", brotli.compress(pages[4]), "Content-Encoding: br\r\n"),
        response("https://shop.example/5", pages[5], "Content-Encoding: br\r\n"),  # unpacked by the archive
        response("https://shop.example/6", b"\xff" * 99, "Content-Encoding: br\r\n"),  # damaged
        response("https://shop.example/news", PROSE.encode()),
        response("https://shop.example/gone", pages[0], status="404 Not Found"),
        record("response", "dns:shop.example", b"20260102030405\nshop.example. 300 IN A 192.0.2.1\n"),
    ]


@pytest.mark.parametrize("form", ["warc", "warc.gz"])
def test_pages_of_a_web_archive_with_a_size_become_raw_items(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], form: str
) -> None:
    path, out = tmp_path / f"crawl.{form}", tmp_path / "items.jsonl"
    path.write_bytes(b"".join(gzip.compress(one) if form.endswith("gz") else one for one in warc_records()))
    assert main(["extract", str(path), "--out", str(out), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert (printed["pages"], printed["read"], printed["items"], printed["kept"]) == (8, 6, 6, 0.75)
    assert printed["ms_per_page"] > 0
    found = {item.url: item for item in raw_items(out)}
    assert sorted(found) == [f"https://shop.example/{number}" for number in range(6)]
    assert found["https://shop.example/2"].extents_mm == (800.0, 240.0, 120.0)
    assert found["https://shop.example/1"].title == "Shelf 1"


@pytest.mark.parametrize(("form", "prefix"), [("nq", ""), ("nq.gz", "Product/")])  # prefix : of dumps before 2016
def test_products_of_n_quads_become_raw_items(tmp_path: Path, form: str, prefix: str) -> None:
    path, out = tmp_path / f"products.{form}", tmp_path / "items.jsonl"
    other = '_:n9 <http://schema.org/name> "A person"@en <https://shop.example/about> .\n'
    text = "# a comment\n" + "".join(PRODUCT.format(f"shelf{n}", 80 + n, "120 cm", prefix) for n in range(2)) + other
    path.write_bytes(gzip.compress(text.encode()) if form.endswith("gz") else text.encode())
    assert main(["extract", str(path), "--out", str(out)]) == 0
    first, second = raw_items(out)
    assert (first.title, first.source_id, first.url) == ('Oak "shelf0" é', "shelf0-7", "https://shop.example/shelf0")
    assert first.category_path == ("Furniture", "Shelves")
    assert (first.extents_mm, second.extents_mm) == ((1200.0, 800.0), (1200.0, 810.0))


def test_a_page_of_a_million_quads_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The quads of a page after its maximum size are omitted; those of the next page are read."""
    many = '_:n1 <http://schema.org/keywords> "word" <https://shop.example/many> .\n'
    path = tmp_path / "products.nq"
    text = PRODUCT.format("many", 80, "120 cm", "") + many * 20_000 + PRODUCT.format("next", 80, "120 cm", "")
    path.write_text(text)
    monkeypatch.setattr(archives, "MAX_BYTES", 10_000)
    first, second = archived_pages(path)
    assert first is not None
    assert second is not None
    assert len(first.linked_data[0]) < 10_000
    assert second.url == "https://shop.example/next"
    assert item_of(first).extents_mm == item_of(second).extents_mm


def test_objects_of_n_quads_that_refer_to_each_other_are_bounded(tmp_path: Path) -> None:
    """Each of 60 products refers to all: 60 to the fourth power values without the bound."""
    url, n = "<https://shop.example/1>", 60
    kind = "<http://www.w3.org/1999/02/22-rdf-syntax-ns#type> <http://schema.org/Product>"
    lines = [f"_:n{one} {kind} {url} ." for one in range(n)]
    lines += [f"_:n{a} <http://schema.org/isRelatedTo> _:n{b} {url} ." for a in range(n) for b in range(n)]
    (tmp_path / "a.nq").write_text("\n".join(lines))
    assert processor_seconds(lambda: list(archived_pages(tmp_path / "a.nq")), 5.0) < 5.0


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.warc", b"<html>no archive</html>", "record 1: expected the header of a WARC record; found b'<html>no"),
        ("a.warc", b"WARC/1.0\r\nWARC-Type: response\r\n\r\n", "a WARC record; found Content-Length: none"),
        ("a.warc", b"WARC/1.0\r\nContent-Length: -5\r\n\r\n", "a WARC record; found Content-Length: -5"),
        ("a.warc.gz", gzip.compress(b"WARC/1.0\r\n" * 100, mtime=0)[:20], "expected gzip data; found"),
        ("a.nq", b"no quads\n", "expected a quad (subject, predicate, object, graph); found another line"),
    ],
)
def test_a_damaged_archive_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, content: bytes, message: str
) -> None:
    (tmp_path / name).write_bytes(content)
    assert main(["extract", str(tmp_path / name), "--out", str(tmp_path / "items.jsonl")]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (tmp_path / "items.jsonl").exists()


@pytest.mark.parametrize(
    "words", [["--url", "https://a.example/1"], ["--url", "https://a.example/1", "--out", "x"], []]
)
def test_an_archive_needs_a_file_of_items_and_no_url(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str]
) -> None:
    (tmp_path / "a.warc").write_bytes(b"")
    assert main(["extract", str(tmp_path / "a.warc"), *words]) == 2
    assert "expected --out, and no --url, with an archive" in capsys.readouterr().err


def test_every_page_with_a_size_is_parsed(tmp_path: Path) -> None:
    """The pages that are searched for bytes are those of all tests of the page reader."""
    n_sizes = 0
    for path in sorted((Path(__file__).parent / "shops").glob("*.html")):
        body = path.read_bytes()
        archive = tmp_path / "a.warc"
        archive.write_bytes(response("https://shop.example/1", body, f"Content-Length: {len(body)}\r\n"))
        has_size = item_of(page(body, "https://shop.example/1")).extents_mm is not None
        n_sizes += has_size
        assert not has_size or list(archived_pages(archive)) != [None], path.name
    assert n_sizes > 250


@pytest.mark.parametrize("body", ["1<a>" * 20_000, "1" + "&nbsp;" * 60_000, "1 " * 60_000, '"1' * 60_000])
def test_the_search_for_a_size_in_a_hostile_page_is_fast(tmp_path: Path, body: str) -> None:
    path = tmp_path / "a.warc"
    path.write_bytes(response("https://shop.example/1", f"<p>{body}".encode()))
    assert processor_seconds(lambda: list(archived_pages(path)), 2.0) < 2.0


def test_no_page_of_an_empty_archive(tmp_path: Path) -> None:
    (tmp_path / "a.warc").write_bytes(b"")
    assert list(archived_pages(tmp_path / "a.warc")) == []
    (tmp_path / "a.nq").write_bytes(b"")
    assert list(archived_pages(tmp_path / "a.nq")) == []
    (tmp_path / "a.nq.gz").write_bytes(b"no gzip")
    with pytest.raises(InputError, match="expected gzip data"):
        list(archived_pages(tmp_path / "a.nq.gz"))


@pytest.mark.parametrize(("length", "is_read"), [(1 << 20, True), ((1 << 20) + 2, False)])
def test_a_line_of_n_quads_has_at_most_a_mebibyte(length: int, is_read: bool, tmp_path: Path) -> None:
    head, end = '_:n1 <http://schema.org/material> "', '" <https://shop.example/1> .\n'
    line = head + "x" * (length - len(head) - len(end)) + end
    (tmp_path / "a.nq").write_text(PRODUCT.format("1", 80, "120 cm", "") + line)
    (found,) = archived_pages(tmp_path / "a.nq")
    assert found is not None
    assert ("material" in found.linked_data[0]) == is_read


def test_objects_of_a_product_are_three_deep(tmp_path: Path) -> None:
    lines = [f"_:n{k} <http://schema.org/p{k}> _:n{k + 1} <https://shop.example/1> .\n" for k in range(2, 6)]
    kind = "<http://www.w3.org/1999/02/22-rdf-syntax-ns#type> <http://schema.org/Product>"
    lines += [
        f"_:n2 {kind} <https://shop.example/1> .\n",
        '_:n2 <http://schema.org/width> "3 cm" <https://shop.example/1> .\n',
    ]
    (tmp_path / "a.nq").write_text("".join(lines) + '_:n6 <http://schema.org/p6> "deep" <https://shop.example/1> .\n')
    (found,) = archived_pages(tmp_path / "a.nq")
    assert found is not None
    (product,) = json.loads(found.linked_data[0])
    assert product["p2"]["p3"]["p4"]["p5"] == "_:n6"

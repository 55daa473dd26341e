"""Downloads from a server of this machine: verified, kept, refused when other bytes come, taken up again."""

from __future__ import annotations

import hashlib
import io
import json
import shutil
import threading
import zipfile
from collections import Counter
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from crawler.imports import downloads, import_source
from crawler.imports.declaration import Source, SourceFile, source
from crawler.imports.downloads import NoInput, download

TABLE = b"no,w\n1,12.5\n2,40\n"

DECLARATION = """
id = "{id}"
title = "Made-up table"
url = "https://example.org/table"
licence = "none"
licence_basis = "we made them up"
kind = "measured"
ship = false
[[tables]]
files = ["table.csv"]
unit = "cm"
id = "{{no}}"
category = ["box"]
axes = {{ width = "w" }}
[[files]]
path = "table.csv"
sha256 = "{sha}"
url = "{url}"
form = "{form}"
"""


class Site:
    """Responses of a small server by path, and the number of requests."""

    def __init__(self) -> None:
        self.pages: dict[str, bytes] = {}
        self.asked: Counter[str] = Counter()
        site = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                site.asked[self.path] += 1
                data = site.pages.get(self.path)
                self.send_response(404 if data is None else 200)
                self.send_header("Content-Length", str(len(data or b"")))
                self.end_headers()
                self.wfile.write(data or b"")

            def log_message(self, *_: object) -> None:
                """Say nothing."""

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)

    def url(self, path: str) -> str:
        return f"http://127.0.0.1:{self.server.server_port}{path}"


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Site]:
    """A server on this machine, and a cache of our own."""
    monkeypatch.setenv(downloads.CACHE_VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setattr(downloads, "MAX_RETRIES", 0)
    served = Site()
    threading.Thread(target=served.server.serve_forever, daemon=True).start()
    yield served
    served.server.shutdown()
    served.server.server_close()


def declared(folder: Path, url: str, data: bytes = TABLE, form: str = "same") -> Source:
    text = DECLARATION.format(id="table", sha=hashlib.sha256(data).hexdigest(), url=url, form=form)
    (folder / "table.toml").write_text(text, encoding="utf-8")
    return source("table", folder)


def zipped(members: dict[str, bytes]) -> bytes:
    sink = io.BytesIO()
    with zipfile.ZipFile(sink, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return sink.getvalue()


def test_a_download_is_verified_kept_and_read(site: Site, tmp_path: Path) -> None:
    site.pages["/table.csv"] = TABLE
    table = declared(tmp_path, site.url("/table.csv"))
    folder = download(table)
    assert (folder / "table.csv").read_bytes() == TABLE
    assert folder.is_relative_to(tmp_path / "cache")
    assert [item.extents_mm for item in import_source(table, folder).items] == [(125.0,), (400.0,)]
    download(table)
    assert site.asked["/table.csv"] == 1


def test_other_bytes_are_refused_and_nothing_is_kept(site: Site, tmp_path: Path) -> None:
    site.pages["/table.csv"] = TABLE.replace(b"40", b"41")
    table = declared(tmp_path, site.url("/table.csv"))
    with pytest.raises(NoInput, match=r"table: expected a download of http.*or --input; found .*hash"):
        download(table)
    assert not list((tmp_path / "cache").rglob("table.csv"))
    site.pages["/table.csv"] = TABLE
    assert (download(table) / "table.csv").read_bytes() == TABLE


def test_a_cached_file_that_was_spoilt_is_fetched_again(site: Site, tmp_path: Path) -> None:
    site.pages["/table.csv"] = TABLE
    table = declared(tmp_path, site.url("/table.csv"))
    cached = download(table) / "table.csv"
    cached.write_bytes(b"no,w\n1,99\n")
    assert (download(table) / "table.csv").read_bytes() == TABLE
    assert site.asked["/table.csv"] == 2


def test_a_stutter_is_tried_once_more(site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(downloads, "MAX_RETRIES", 1)
    table = declared(tmp_path, site.url("/table.csv"))
    with pytest.raises(NoInput, match="404"):
        download(table)
    assert site.asked["/table.csv"] == 2


@pytest.mark.parametrize(
    ("form", "public", "made"),
    [
        ("zip", zipped({"a/": b"", "a/readme.txt": b"no", "a/list.csv": TABLE}), TABLE),
        ("json-line", b'{ "a":\n [1,  2] }\n', b'{"a": [1, 2]}'),
        ("json-lines", b'{ "a": [1, 2] }', b'{\n"a": [\n1,\n2\n]\n}'),
    ],
)
def test_a_file_is_made_of_what_lies_at_the_address(
    site: Site, tmp_path: Path, form: str, public: bytes, made: bytes
) -> None:
    table = declared(tmp_path, site.url("/public"), made, form)
    site.pages["/public"] = public
    kept = download(table) / "table.csv"
    assert kept.read_bytes() == made
    shutil.rmtree(kept.parent / ".public")
    assert download(table) == kept.parent
    assert site.asked["/public"] == 1, "the file is there"
    kept.write_bytes(b"spoilt")
    assert (download(table) / "table.csv").read_bytes() == made


@pytest.mark.parametrize(
    ("form", "wrong"),
    [("zip", b"no archive"), ("zip", zipped({"list.csv": b"other"})), ("json-line", b"{"), ("json-line", b"[1]")],
)
def test_what_it_cannot_be_made_of_is_refused_and_fetched_again(
    site: Site, tmp_path: Path, form: str, wrong: bytes
) -> None:
    right, made = (zipped({"list.csv": TABLE}), TABLE) if form == "zip" else (b"[2]", json.dumps([2]).encode())
    table = declared(tmp_path, site.url("/public"), made, form)
    site.pages["/public"] = wrong
    with pytest.raises(
        NoInput, match=r"table: expected a download of http://127.0.0.1:\d+/public or --input; found no"
    ):
        download(table)
    assert not list((tmp_path / "cache").rglob("table.csv"))
    site.pages["/public"] = right
    assert (download(table) / "table.csv").read_bytes() == made


@pytest.mark.parametrize(("limit", "value"), [("MAX_MEMBERS", 3), ("MAX_ARCHIVE_BYTES", len(TABLE) + 2)])
def test_an_archive_beyond_its_budget_is_not_unpacked(
    site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: str, value: int
) -> None:
    table = declared(tmp_path, site.url("/public"), TABLE, "zip")
    site.pages["/public"] = zipped({"a": b"1", "b": b"2", "list.csv": TABLE, "c": b"3"})
    monkeypatch.setattr(downloads, limit, value)
    with pytest.raises(NoInput, match=f"files of .* bytes in all; found 4 of {len(TABLE) + 3}"):
        download(table)
    monkeypatch.setattr(downloads, limit, value + 1)
    assert (download(table) / "table.csv").read_bytes() == TABLE


@pytest.mark.parametrize(("size", "is_read"), [(1 << 30, True), ((1 << 30) + 1, False)])
def test_a_file_of_an_archive_has_at_most_a_gibibyte(
    size: int, is_read: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.zip").write_bytes(zipped({"list.csv": TABLE}))
    members = zipfile.ZipFile.infolist

    def stated(archive: zipfile.ZipFile) -> list[zipfile.ZipInfo]:
        infos = members(archive)
        infos[0].file_size = size
        return infos

    monkeypatch.setattr(zipfile.ZipFile, "infolist", stated)
    file = SourceFile(path="list.csv", sha256="0" * 64, url="https://example.org/a.zip", form="zip")
    assert list(downloads._contents(file, tmp_path / "a.zip")) == ([TABLE] if is_read else [])

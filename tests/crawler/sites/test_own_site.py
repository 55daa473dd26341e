"""A user's site, declared outside the package."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path

import pytest

import crawler.sites.registry
from crawler.fetch.frontier import task_key
from crawler.sites.registry import canonical_url, site_of, use_site
from crawler.sites.site import Site
from metric_base.errors import FieldError
from metric_base.records import BadDeclaration
from metric_cli.subcommands import main
from tests.crawler.fetch.test_crawl_errors import ROOT, items, words
from tests.synthetic.synthetic_site import Shop, SyntheticSite

FOLDER = ROOT / "data" / "examples" / "site"


@pytest.fixture(autouse=True)
def forget() -> Iterator[None]:
    """The site of a test is that test's alone."""
    yield
    crawler.sites.registry._GIVEN.clear()
    crawler.sites.registry._site_of_host.cache_clear()


def test_a_page_is_read_by_the_rules_of_the_declaration(capsys: pytest.CaptureFixture[str]) -> None:
    page, site = str(FOLDER / "page.html"), str(FOLDER / "lamps.toml")
    assert main(["extract", page, "--url", "https://www.lamps.example/p/17?x=1", "--site", site, "--json"]) == 0
    item = json.loads(capsys.readouterr().out)
    assert (item["source"], item["source_id"], item["title"]) == ("lamps", "17", "Aurora table lamp")
    assert (item["category_path"], item["extents_mm"]) == (["Lamps", "Table lamps"], [480, 300, 300])


def test_its_addresses_are_its_own() -> None:
    assert site_of("https://lamps.example/p/1").name == "generic"
    use_site(FOLDER / "lamps.toml")
    assert site_of("https://lamps.example/p/1").name == "lamps"
    assert canonical_url("https://lamps.example/p/1?colour=red&x=1") == "https://lamps.example/p/1?x=1"
    assert task_key("https://lamps.example/p/1?colour=red") == task_key("https://lamps.example/p/1?colour=blue")
    assert site_of("https://www.amazon.com/dp/B0ABCDEFGH").name == "amazon"


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", "fields: expected name, hosts, found no name, hosts"),
        ('name = "lamps"', "fields: expected name, hosts, found no hosts"),
        ('name = "Our Lamps"\nhosts = ["a"]', "name: expected small letters"),
        ('name = "lamps"\nhosts = ["("]', "hosts: expected a regular expression"),
        ('name = "lamps"\nhosts = ["a"]\nid = "["', "id: expected a regular expression"),
        ('name = "lamps"\nhosts = ["a"]\ntitle = "//["', "title: expected an XPath"),
        ('name = "lamps"\nhosts = "a"', "hosts: expected array, found str"),
        ('name = "lamps"\nhosts = ["a"]\ncolour = "red"', "colour: expected a known field"),
    ],
)
def test_an_error_of_the_declaration_is_one_line(tmp_path: Path, text: str, line: str) -> None:
    path = tmp_path / "site.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(BadDeclaration, match=r"site\.toml: ") as caught:
        use_site(path)
    assert line in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_crawl_of_a_site_of_ones_own(tmp_path: Path) -> None:
    declaration = tmp_path / "made.toml"
    declaration.write_text('name = "made"\nhosts = ["127\\\\.0\\\\.0\\\\.1"]\n', encoding="utf-8")
    with SyntheticSite(Shop(products=5, errors=False)) as site:
        more = ["--private", "--site", str(declaration), "--start-url", f"{site.base}/list/0"]
        done = subprocess.run(
            words("made", tmp_path / "out", *more), cwd=ROOT, capture_output=True, text=True, timeout=180, check=False
        )
    assert (done.returncode, items(tmp_path / "out")) == (0, 5), done.stderr
    lines = [line for path in (tmp_path / "out").glob("items-*.jsonl") for line in path.read_text().splitlines()]
    assert {json.loads(line)["source"] for line in lines} == {"made"}


@pytest.mark.parametrize(
    ("xpath", "is_valid"),
    [
        ("//a" + "a" * 297, True),
        ("//a" + "a" * 298, False),
        ("//a" + "[b]" * 5, True),
        ("//a" + "[b]" * 6, False),
        ("count(//a)", False),
    ],
)
def test_an_xpath_is_short_and_selects_elements(xpath: str, is_valid: bool) -> None:
    with nullcontext() if is_valid else pytest.raises(FieldError, match=r"title: expected an? (short )?XPath"):
        assert Site(name="lamps", hosts=("a",), title=xpath).title == xpath

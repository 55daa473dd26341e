"""The cost of a page is linear in its size, and bounded for any page."""

from __future__ import annotations

import re
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from crawler.page.page import page
from crawler.page.time_limit import SlowPage, processor_budget
from crawler.page.urls import absolute_url
from crawler.sites.registry import item_of
from metric_cli.subcommands import main
from tests.support.processor_time import processor_seconds

Body = Callable[[int], str]

#: Bodies with n equal parts.
BODIES: dict[str, Body] = {
    "rows": lambda n: f"<table>{''.join(f'<tr><td>Width {i}</td><td>{i} cm</td></tr>' for i in range(n))}</table>",
    "cells": lambda n: f"<table><tr>{''.join(f'<td>{i} cm</td>' for i in range(4 * n))}</tr></table>",
    "list entries": lambda n: f"<ul>{''.join(f'<li>Height: {i} cm</li>' for i in range(n))}</ul>",
    "definitions": lambda n: f"<dl><dt>Width</dt>{''.join(f'<dd>{i} cm</dd>' for i in range(4 * n))}</dl>",
    "terms": lambda n: f"<dl>{''.join(f'<dt>Width</dt><dd>{i} cm</dd>' for i in range(n))}</dl>",
    "paragraphs": lambda n: "".join(f"<p>{i} cm x 2 cm</p>" for i in range(4 * n)),
    "nested tags": lambda n: ("<div>" * 100 + "<i>3 cm</i> 4 cm" + "</div>" * 100) * (n // 8),
    "empty rows": lambda n: (
        f"<table>{'<tr><td></td></tr>' * n}{'<tr><td>a</td><td>1 m</td><td>2 m</td></tr>' * n}</table>"
    ),
    "empty boxes": lambda n: f"<div>{'<i></i>' * 4 * n}{''.join(f'<b>{i} cm</b>' for i in range(4 * n))}</div>",
    "spans": lambda n: f"<div>{''.join(f'<span>Width</span><span>{i} cm</span>' for i in range(2 * n))}</div>",
    "lines": lambda n: f"<p>{''.join(f'Width: {i} cm<br>' for i in range(n))}</p>",
    "headings": lambda n: "".join(f"<h2>Size {i}</h2><p>{i} x 3 cm</p>" for i in range(n)),
    "classes": lambda n: "".join(f'<div class="{"a" * 50} c{i}"><p>{i} cm</p></div>' for i in range(2 * n)),
    "pairs of JSON": lambda n: "<script>" + '{"name":"Width","value":"30 cm"},' * n + "</script>",
    "linked data": lambda n: '<script type="application/ld+json">[' + "{}," * 40 * n + "1]</script>",
}
WIDE = ("rows", "cells", "list entries", "definitions", "paragraphs", "nested tags")
CASES = [(name, "utf-8") for name in BODIES] + [(name, "utf-16") for name in WIDE]


def seconds(body: str, encoding: str) -> float:
    """Minimum processor time of three runs over a page."""
    whole = f"<html><body><h1>Item</h1>{body}</body></html>".encode(encoding)
    times = []
    for _ in range(3):
        start = time.process_time()
        item_of(page(whole, "https://shop.example/p"))
        times.append(time.process_time() - start)
    return min(times)


@pytest.mark.parametrize(("name", "encoding"), CASES)
def test_twice_the_page_is_twice_the_work(name: str, encoding: str) -> None:
    body = BODIES[name]
    once, twice = seconds(body(200), encoding), seconds(body(800), encoding)
    assert twice < 4 * 1.8 * once + 0.02  # of four times the page; a quadratic page would take sixteen times


def _work(swallowing: int = 0) -> None:
    """Work without an end that swallows so many interruptions."""
    while True:
        try:
            while True:
                pass
        except SlowPage:
            swallowing -= 1
            if swallowing < 0:
                raise


@pytest.mark.parametrize("swallowing", [0, 2])
def test_work_over_the_budget_is_interrupted_and_the_timer_is_gone(swallowing: int) -> None:
    def work() -> None:
        with pytest.raises(SlowPage), processor_budget(0.05):
            _work(swallowing)

    assert processor_seconds(work, 2) < 2
    assert signal.getitimer(signal.ITIMER_PROF) == (0.0, 0.0)


def test_there_is_no_limit_in_other_threads_and_on_systems_without_a_timer(monkeypatch: pytest.MonkeyPatch) -> None:
    def work() -> None:
        with processor_budget(1e-3):
            until = time.thread_time() + 0.01
            while time.thread_time() < until:
                pass
            done.append(signal.getitimer(signal.ITIMER_PROF))

    done: list[tuple[float, float]] = []
    thread = threading.Thread(target=work)
    thread.start()
    thread.join(60)
    monkeypatch.delattr(signal, "setitimer")
    work()
    assert done == [(0.0, 0.0)] * 2


def test_a_search_without_an_end_is_interrupted() -> None:
    with pytest.raises(SlowPage), processor_budget(0.05):
        re.fullmatch(r"(a|aa)+b", "a" * 200)


def test_extract_says_that_a_page_is_too_slow(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("crawler.sites.registry.item_of", lambda _: _work())
    monkeypatch.setattr("crawler.page.time_limit.processor_budget", lambda: processor_budget(0.05))
    path = tmp_path / "page.html"
    path.write_text("<p>3 cm</p>")
    assert main(["extract", str(path), "--url", "https://shop.example/p"]) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert "page.html: expected a page that is read in" in message


def test_a_file_without_measure_is_not_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "page.html"
    with path.open("wb") as file:
        file.truncate(200_000_000_000)  # a file of holes, which takes no room
    assert main(["extract", str(path), "--url", "https://shop.example/p"]) == 2
    assert "expected at most 32000000 bytes; found 200000000000" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("address", "url"),
    [
        ("/b", "https://a.example/b"),
        ("c?x=1#y", "https://a.example/x/c?x=1"),
        ("//b.example/z", "https://b.example/z"),
        (" https://b.example:8080/ ", "https://b.example:8080/"),
        ("http://[link]/x", ""),
        ("http://b.example:port/x", ""),
        ("http://b.example:99999/x", ""),
        ("mailto:a@b.example", ""),
        ("javascript:void(0)", ""),
        ("http:///x", ""),
    ],
)
def test_a_link_is_an_address_of_the_web_or_nothing(address: str, url: str) -> None:
    assert absolute_url("https://a.example/x/y", address) == url

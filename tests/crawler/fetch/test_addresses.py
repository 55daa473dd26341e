"""Addresses that are not public, whatever they are dressed in; the address that was checked is the one connected to."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from crawler.fetch.network_limits import is_literal, is_public
from tests.crawler.fetch.test_crawl_errors import CONTACT, ROOT
from tests.synthetic.synthetic_site import Shop, SyntheticSite


@pytest.mark.parametrize("address", ["93.184.216.34", "2606:2800:220:1:248:1893:25c8:1946", "8.8.8.8"])
def test_an_address_of_the_web_is_public(address: str) -> None:
    assert is_literal(address)
    assert is_public(address)


@pytest.mark.parametrize(
    "address",
    [
        "127.0.0.1", "10.1.2.3", "172.16.0.1", "192.168.1.1", "169.254.169.254", "100.64.0.1", "0.0.0.0", "224.0.0.1",
        "240.0.0.1", "255.255.255.255", "192.88.99.1", "198.18.0.1", "::1", "::", "fe80::1%eth0", "fc00::1", "ff02::1",
        "fec0::1", "::ffff:127.0.0.1", "::ffff:93.184.216.34", "::127.0.0.1", "64:ff9b::7f00:1", "64:ff9b:1::7f00:1",
        "2002:7f00:1::", "2002:5db8:d822::1", "2001:0:5ef5:79fd::1", "2001:db8::1",
    ],
)  # fmt: skip
def test_an_address_that_is_local_or_carries_another_is_not(address: str) -> None:
    assert is_literal(address)
    assert not is_public(address)


@pytest.mark.parametrize("host", ["localhost", "a.example", "127.1", "0x7f.0.0.1", ""])
def test_a_name_is_no_literal(host: str) -> None:
    assert not is_literal(host)


#: A server of names that answers a first question with a public address and every later one with this machine's.
REBINDING = """
import socket
answers = {ANSWERS}
public = lambda *_, **__: [(socket.AF_INET, socket.SOCK_STREAM, 6, "", ("93.184.216.34", 0))]
socket.getaddrinfo = public
socket.gethostbyname = lambda name: answers.pop(0) if len(answers) > 1 else answers[0]
from metric_cli.subcommands import main
raise SystemExit(main())
"""


def crawl(base: str, out: Path, host: str) -> tuple[int, Any, str]:
    code = REBINDING.replace("{ANSWERS}", repr(["127.0.0.1"]))
    start = base.replace("127.0.0.1", host) + "/list/0"
    words = [sys.executable, "-c", code, "crawl", "generic", "--out", str(out), *CONTACT, "--start-url", start]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=180, check=False)
    return done.returncode, json.loads(done.stdout) if done.stdout else None, done.stderr


@pytest.mark.parametrize("host", ["rebinding.example", "127.1", "[::ffff:127.0.0.1]"])
def test_a_name_that_leads_home_is_refused_at_the_connection(tmp_path: Path, host: str) -> None:
    with SyntheticSite(Shop(products=3, errors=False)) as site:
        status, summary, message = crawl(site.base, tmp_path / "out", host)
        assert not site.fetched
    assert (status, summary["failed"]) == (2, {"private address": 1})
    assert "--private allows addresses of this machine" in message

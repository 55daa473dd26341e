"""Absolute and canonical addresses of pages."""

from __future__ import annotations

import hashlib
import re
from urllib.parse import urljoin, urlsplit, urlunsplit

from crawler.page.page import BadPage

#: Query parameters that identify only the origin of a visitor.
_TRACKING = re.compile(r"utm_\w+|gclid|fbclid")


def web_address(url: str, field: str) -> str:
    """The address, if it is one of the web.

    Raises
    ------
    BadPage
        The scheme is another than http and https, no host is named, or it has a blank.
    """
    try:
        parts = urlsplit(url)
        sound = parts.scheme in {"http", "https"} and bool(parts.hostname) and parts.port != 0
    except ValueError:  # an invalid port, or a bracket that is not closed
        sound = False
    if not sound or re.search(r"\s", url):
        raise BadPage(f"{field}: expected an http(s) address; found {url!r}")
    return url


def absolute_url(base: str, address: str) -> str:
    """Return the absolute address of a link without fragment; empty if it is malformed or not a web address."""
    try:
        url = _joined_url(base, address.strip()).partition("#")[0]
        parts = urlsplit(url)
        sound = parts.scheme in {"http", "https"} and bool(parts.hostname) and parts.port != 0
    except ValueError:  # an invalid port, or a bracket that is not closed
        return ""
    return url if sound else ""


def _joined_url(base: str, address: str) -> str:
    """Most links name a path from the root, for which `urljoin` is slow."""
    if address.startswith("/") and not address.startswith("//") and "/." not in address:
        scheme, _, rest = base.partition("//")
        return f"{scheme}//{rest.partition('/')[0]}{address}"
    return urljoin(base, address)


def canonical_url(url: str, ignored: str = "") -> str:
    """The address without fragment, port of the scheme, and tracking parameters; host in small letters.

    Parameters
    ----------
    ignored : a regular expression of the names of further parameters that do not change the page.

    Raises
    ------
    ValueError
        The address is malformed: an invalid port, or a bracket that is not closed.
    """
    parts = urlsplit(url)
    names = _TRACKING if not ignored else re.compile(f"{_TRACKING.pattern}|{ignored}")
    kept = "&".join(part for part in parts.query.split("&") if part and not names.fullmatch(part.partition("=")[0]))
    host = (parts.hostname or "") + (f":{parts.port}" if parts.port and parts.port not in {80, 443} else "")
    return urlunsplit((parts.scheme.lower(), host, parts.path or "/", kept, ""))


def source_id(url: str) -> str:
    """Return the id of a page without a product id: the SHA-256 of its canonical address."""
    return hashlib.sha256(canonical_url(url).encode()).hexdigest()

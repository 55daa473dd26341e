"""Absolute and canonical addresses of pages."""

from __future__ import annotations

import hashlib
import re
from urllib.parse import urljoin, urlsplit, urlunsplit

from crawler.page.page import BadPage

#: Query parameters that identify only the origin of a visitor.
_TRACKING = re.compile(r"utm_\w+|gclid|fbclid")


def web_address(url: str, field: str) -> str:
    """Return an address if it is a web address.

    Raises
    ------
    BadPage
        The scheme is not http or https, the host is missing, or the address contains white space.
    """
    if not _is_web_address(url) or re.search(r"\s", url):
        raise BadPage(f"{field}: expected an http(s) address; found {url!r}")
    return url


def absolute_url(base: str, address: str) -> str:
    """Return the absolute address of a link without fragment; empty if it is malformed or not a web address."""
    address = address.strip()
    if address.startswith("/") and not address.startswith("//") and "/." not in address:
        # most links are paths from the root, for which `urljoin` is slow
        scheme, _, rest = base.partition("//")
        url = f"{scheme}//{rest.partition('/')[0]}{address}"
    else:
        try:
            url = urljoin(base, address)
        except ValueError:  # a bracket that is not closed
            return ""
    url = url.partition("#")[0]
    return url if _is_web_address(url) else ""


def _is_web_address(url: str) -> bool:
    try:
        parts = urlsplit(url)
        return parts.scheme in {"http", "https"} and bool(parts.hostname) and parts.port != 0
    except ValueError:  # an invalid port, or a bracket that is not closed
        return False


def canonical_url(url: str, ignored: str = "") -> str:
    """Return an address with its host in lower case and without fragment, default port and tracking parameters.

    Parameters
    ----------
    url : str
    ignored : str
        Regular expression on the names of further parameters that do not change the page.

    Raises
    ------
    ValueError
        The address is malformed: an invalid port, or a bracket that is not closed.
    """
    parts = urlsplit(url)
    names = _TRACKING if not ignored else re.compile(f"{_TRACKING.pattern}|{ignored}")
    query = "&".join(part for part in parts.query.split("&") if part and not names.fullmatch(part.partition("=")[0]))
    host = (parts.hostname or "") + (f":{parts.port}" if parts.port and parts.port not in {80, 443} else "")
    return urlunsplit((parts.scheme.lower(), host, parts.path or "/", query, ""))


def source_id(url: str) -> str:
    """Return the id of a page without a product id: the SHA-256 of its canonical address."""
    return hashlib.sha256(canonical_url(url).encode()).hexdigest()

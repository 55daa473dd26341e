"""Registry of the declared sites; a new site is one TOML file."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from urllib.parse import urlsplit

from crawler.items import RawItem
from crawler.page.page import Page
from crawler.sites.site import Site
from metric_base.records import toml_record

#: Rules of undeclared sites; users who store images are responsible for the terms of the site.
GENERIC = Site(name="generic", hosts=(), pictures="")

#: Declared sites of this folder; the first match counts.
SITES: tuple[Site, ...] = tuple(toml_record(path, Site) for path in sorted(Path(__file__).parent.glob("*.toml")))


#: Declared site of a user (`use_site`), which takes precedence.
_GIVEN: list[Site] = []


def use_site(path: Path) -> Site:
    """Register the site of a TOML file, which takes precedence over the shipped sites.

    Raises
    ------
    BadDeclaration
        The file is not TOML, or fields are missing (all are named), unknown or invalid.
    """
    site = toml_record(path, Site)
    _GIVEN[:] = [site]
    _site_of_host.cache_clear()
    return site


def site_of(url: str) -> Site:
    """Return the site of an address, or the generic site."""
    return _site_of_host(urlsplit(url).hostname or "")


@lru_cache(maxsize=4096)  # called for every link of every page
def _site_of_host(host: str) -> Site:
    return next((site for site in (*_GIVEN, *SITES) if site.owns_host(host)), GENERIC)


def canonical_url(url: str) -> str:
    """Return the canonical address of a page by the rules of its site.

    Raises
    ------
    ValueError
        The address is malformed.
    """
    return site_of(url).canonical_url(url)


def item_of(page: Page) -> RawItem:
    """Return the raw item of a page by the rules of its site."""
    return site_of(page.url).item(page)

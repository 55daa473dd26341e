"""Sites whose pages the common reader needs help with; a new site is one TOML file."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from urllib.parse import urlsplit

from crawler.items import RawItem
from crawler.page.page import Page
from crawler.sites.site import Site
from metric_base.records import toml_record

#: Any site: schema.org data, Open Graph, breadcrumbs, tables. The user who asks for images knows its terms.
GENERIC = Site(name="generic", hosts=(), pictures="")

#: Sites with rules of their own, first match wins: the declarations in this folder.
SITES: tuple[Site, ...] = tuple(toml_record(path, Site) for path in sorted(Path(__file__).parent.glob("*.toml")))


#: The site of a declaration outside the package, where a command was given one: it goes before all others.
_GIVEN: list[Site] = []


def use_site(path: Path) -> Site:
    """The site that a TOML file declares; from now on its addresses are its own.

    Raises
    ------
    BadDeclaration
        The file is no TOML, or fields are missing (all are named), unknown or not what they must be.
    """
    site = toml_record(path, Site)
    _GIVEN[:] = [site]
    _site_of_host.cache_clear()
    return site


def site_of(url: str) -> Site:
    """The site that owns an address, else the generic one."""
    return _site_of_host(urlsplit(url).hostname or "")


@lru_cache(maxsize=4096)  # asked for every link of every page
def _site_of_host(host: str) -> Site:
    return next((site for site in (*_GIVEN, *SITES) if site.owns_host(host)), GENERIC)


def canonical_url(url: str) -> str:
    """The address by which a page is known, by the rules of its site.

    Raises
    ------
    ValueError
        The address is malformed.
    """
    return site_of(url).canonical_url(url)


def item_of(page: Page) -> RawItem:
    """The raw item of a page, by the rules of its site."""
    return site_of(page.url).item(page)

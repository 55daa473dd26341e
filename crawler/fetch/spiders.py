"""Spiders: what a crawl fetches, and which of it it reads. Each is one small file or one `Site`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from crawler.sites import GENERIC, SITES, Site
from metric_base.errors import InputError

if TYPE_CHECKING:
    from scrapy import Spider

__all__ = ["SPIDERS", "UnknownSpider", "spider_class"]

#: Names that `metric-tree crawl` takes; each site has one, Wikidata has its own interface.
SPIDERS = (*(site.name for site in SITES), "wikidata", GENERIC.name)


class UnknownSpider(InputError):
    """A name that no spider has."""


def spider_class(name: str, given: Site | None = None) -> type[Spider]:
    """The spider of a name, or of the site of a declaration; Scrapy is loaded only here."""
    if name == "wikidata":
        from crawler.fetch.wikidata_spider import WikidataSpider

        return WikidataSpider
    from crawler.fetch.site_spider import SiteSpider

    for site in (*([given] if given else []), *SITES, GENERIC):
        if site.name == name:
            return type(f"{name.title()}Spider", (SiteSpider,), {"name": name, "site": site})
    known = ", ".join([*([given.name] if given else []), *SPIDERS])
    raise UnknownSpider(f"spider: expected one of {known}; found {name!r}")

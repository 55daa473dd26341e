"""Crate & Barrel: its address scheme and schema.org data. Not yet verified on a real page."""

from crawler.sites.site import Site

__all__ = ["SITE"]

SITE = Site(
    name="crate_and_barrel",
    hosts=(r"(.*\.)?(crateandbarrel|cb2)\.(com|ca)",),
    product_page=r"/s\d{5,}(?:[/?]|$)",
    listing_page=r"/\d+(?:[/?]|$)|/search",
    templates=("https://www.crateandbarrel.com/search?query={query}", "https://www.crateandbarrel.com/{category}/1"),
    id=r"/s(\d{5,})",
    title="//h1",
)

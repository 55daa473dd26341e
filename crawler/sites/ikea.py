"""IKEA: product numbers in the address; everything else is in its structured data."""

from crawler.sites.site import Site

__all__ = ["SITE"]

SITE = Site(
    name="ikea",
    hosts=(r"(.*\.)?ikea\.com",),
    id=r"-(s?\d{8})/?(?:[?#]|$)",
    product_page=r"/p/",
    listing_page=r"/cat/|/search",
    templates=("https://www.ikea.com/gb/en/search/?q={query}", "https://www.ikea.com/gb/en/cat/{category}/"),
    title="//h1",
)

"""IKEA: product numbers in the address; everything else stands in its structured data."""

from crawler.sites.site import Site

__all__ = ["SITE"]

SITE = Site(
    name="ikea",
    hosts=(r"(.*\.)?ikea\.com",),
    id=r"-(s?\d{8})/?(?:[?#]|$)",
    title="//h1",
)

"""Wayfair: overall, seat and base sizes are in one definition list; the common reader keeps them apart."""

from crawler.sites.site import Site

__all__ = ["SITE"]

SITE = Site(
    name="wayfair",
    hosts=(r"(.*\.)?wayfair\.(com|co\.uk|ca|de|ie)",),
    product_page=r"/pdp/",
    listing_page=r"/sb\d|/cat/|keyword\.php",
    templates=("https://www.wayfair.com/keyword.php?keyword={query}", "https://www.wayfair.com/{category}"),
    id=r"-([a-z]{1,4}\d{3,})\.html",
    title="//h1",
)

"""Dimensions.com: drawings of everyday items with their sizes. Not yet verified on a real page."""

from crawler.sites.site import Site

__all__ = ["SITE"]

SITE = Site(
    name="dimensions_com",
    hosts=(r"(.*\.)?dimensions\.(com|guide)",),
    product_page=r"/element/",
    listing_page=r"/collection/|/category/",
    templates=("https://www.dimensions.com/search?query={query}", "https://www.dimensions.com/collection/{category}"),
    id=r"/element/([^/?#]+)",
    title="//h1",
)

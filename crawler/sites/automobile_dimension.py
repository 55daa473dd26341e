"""Listing pages of car dimensions (automobiledimension.com and its like). Not yet verified on a real page."""

from crawler.sites.site import Site

__all__ = ["SITE"]

SITE = Site(
    name="automobile_dimension",
    hosts=(r"(.*\.)?(automobiledimension|carsized|ultimatespecs)\.com",),
    id=r"/models?/([^?#]+)",
    product_page=r"/models?/[^/]+/[^/]+",
    listing_page=r"-(?:car-)?dimensions|/brands?/|/makes?/|\.html$",
    templates=("https://www.automobiledimension.com/{category}-car-dimensions.html",),
    title="//h1",
    listed_order="L x W x H",
)

"""Amazon in all its countries: table, bullet, overview and book layouts are read by the common reader."""

from crawler.sites.site import Site

__all__ = ["SITE"]

SITE = Site(
    name="amazon",
    hosts=(r"(.*\.)?amazon\.(com|co\.uk|de|fr|it|es|ca|nl|com\.au|com\.mx|com\.br|in|co\.jp|se|pl|be)",),
    id=r"/(?:dp|gp/product|gp/aw/d)/([A-Z0-9]{10})(?:[/?]|$)",
    product_page=r"/(?:dp|gp/product)/[A-Z0-9]{10}(?:[/?]|$)",
    listing_page=r"/s\?|/b/|/b\?|/gp/bestsellers|/gp/browse|[?&]node=",
    templates=("https://www.amazon.com/s?k={query}", "https://www.amazon.com/b?node={category}"),
    ignored_parameters="ref_?|tag|psc|th",
    # id() looks an id up; //*[@id=...] would walk through megabytes for each.
    title="id('productTitle ebooksProductTitle')",
    category="id('wayfinding-breadcrumbs_feature_div')//a",
    brand="id('bylineInfo')",
    images="id('landingImage imgBlkFront ebooksImgBlkFront')/@data-old-hires"
    " | id('landingImage imgBlkFront')/@src[starts-with(., 'http')]",
)

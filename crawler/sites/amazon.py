"""Amazon in all its countries: table, bullet, overview and book layouts are read by the common reader."""

from crawler.sites.site import Site

__all__ = ["SITE"]

SITE = Site(
    name="amazon",
    hosts=(r"(.*\.)?amazon\.(com|co\.uk|de|fr|it|es|ca|nl|com\.au|com\.mx|com\.br|in|co\.jp|se|pl|be)",),
    id=r"/(?:dp|gp/product|gp/aw/d)/([A-Z0-9]{10})(?:[/?]|$)",
    title="//*[@id='productTitle' or @id='ebooksProductTitle']",
    category="//*[@id='wayfinding-breadcrumbs_feature_div']//a",
    brand="//*[@id='bylineInfo']",
    images="//*[@id='landingImage' or @id='imgBlkFront' or @id='ebooksImgBlkFront']/@data-old-hires"
    " | //*[@id='landingImage' or @id='imgBlkFront']/@src[starts-with(., 'http')]",
)

"""Wikipedia: the infobox of cars, ships, animals, buildings and people. Not yet verified on a real page."""

from crawler.sites.site import Site

__all__ = ["SITE"]

SITE = Site(
    name="wikipedia",
    hosts=(r"[a-z-]+(\.m)?\.wikipedia\.org",),
    product_page=r"/(?:wiki|api/rest_v1/page/html)/(?!(?:Category|List_of|File|Help|Talk|Special|Portal|Template)[:_])[^?#]+$",
    listing_page=r"/wiki/(?:Category:|List_of_)",
    templates=("https://en.wikipedia.org/wiki/Category:{category}",),
    id=r"/(?:wiki|html)/([^?#]+)",
    title="//*[@id='firstHeading'] | //h1",
    category="//*[@id='mw-normal-catlinks']//li/a",
    # What Commons holds is free; what a Wikipedia holds itself is mostly there by fair use.
    pictures=r"//upload\.wikimedia\.org/wikipedia/commons/",
    images="//*[contains(concat(' ', @class, ' '), ' infobox ')]//img/@src",
)

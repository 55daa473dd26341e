"""What to fetch and when: the frontier, Scrapy's scheduler, spiders, segments of raw items."""

__all__ = ["DELAY_SECONDS"]

#: Between two requests to one site, where neither the site nor AutoThrottle asks for more: what people browse at.
DELAY_SECONDS = 1.0

"""What to fetch and when: the frontier, Scrapy's scheduler, spiders, segments of raw items."""

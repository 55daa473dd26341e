"""Crawls: frontier, scheduler and settings of Scrapy, spiders, and segments of raw items."""

"""Settings of Scrapy for a polite and safe crawl."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scrapy.settings import default_settings

from crawler.page.page import MAX_BYTES
from crawler.sites.site import DELAY_SECONDS

#: Name of the resolver setting, which differs between versions of Scrapy.
_RESOLVER_SETTING = "TWISTED_DNS_RESOLVER" if hasattr(default_settings, "TWISTED_DNS_RESOLVER") else "DNS_RESOLVER"
#: Maximum duration of a download in seconds.
DOWNLOAD_SECONDS = 30
#: Maximum link depth (`DEPTH_LIMIT`): stops crawler traps, but allows a category of 100 consecutive listing pages.
MAX_DEPTH = 120
#: Components of Scrapy that a crawl uses. Scrapy imports every component of its own lists, even a disabled one; those
#: of the others (aiohttp, requests) take a third of the start of a crawl. The guard also checks redirects and
#: addresses, unlike OffsiteMiddleware. Without the handler of LogCount, Python prints warnings to standard error.
_EXTENSIONS = (
    "corestats.CoreStats",
    "logcount.LogCount",
    "closespider.CloseSpider",
    "spiderstate.SpiderState",
    "throttle.AutoThrottle",
)
_UNUSED_MIDDLEWARES = ("offsite.OffsiteMiddleware", "cookies.CookiesMiddleware", "httpauth.HttpAuthMiddleware")


def user_agent(contact: str) -> str:
    """Return the user agent with the contact."""
    return f"metric-tree/1 (object sizes for research; {contact})"


def crawl_settings(
    *, contact: str, cache: Path | None = None, private: bool = False, delay: float = DELAY_SECONDS
) -> dict[str, Any]:
    """Return the settings of Scrapy for a polite crawl that can run unattended.

    Parameters
    ----------
    contact : str
        E-mail address or page of the person responsible, for owners of sites.
    cache : Path, optional
        Folder of the HTTP cache; pages are fetched again only if they have changed (RFC 9111, conditional requests).
    private : bool
        Permit addresses of this machine and its network (tests, a mirror).
    delay : float
        Minimum delay between two requests to a site in seconds; AutoThrottle may increase it.
    """
    guards = {
        "crawler.fetch.middlewares.GuardMiddleware": 40,
        "crawler.fetch.middlewares.BanMiddleware": 560,
        "crawler.fetch.middlewares.RefusedHostMiddleware": 570,  # closer to the download than Scrapy's retries
    }
    own = {
        "METRIC_TREE_PRIVATE": private,
        "SCHEDULER": "crawler.fetch.scheduler.FrontierScheduler",
        "SPIDER_MIDDLEWARES": {"crawler.fetch.scheduler.CommitMiddleware": 10},
        "DOWNLOADER_MIDDLEWARES": guards,
        "DOWNLOADER_MIDDLEWARES_BASE": {
            name: order
            for name, order in default_settings.DOWNLOADER_MIDDLEWARES_BASE.items()
            if not name.endswith(_UNUSED_MIDDLEWARES)
        },
        **({} if private else {_RESOLVER_SETTING: "crawler.fetch.network_limits.PublicResolver"}),
        "EXTENSIONS_BASE": {
            name: order for name, order in default_settings.EXTENSIONS_BASE.items() if name.endswith(_EXTENSIONS)
        },
    }
    manners = {
        "ROBOTSTXT_OBEY": True,
        "ROBOTSTXT_PARSER": "crawler.fetch.middlewares.BoundedRobotParser",
        "USER_AGENT": user_agent(contact),
        "AUTOTHROTTLE_ENABLED": delay > 0,
        "AUTOTHROTTLE_START_DELAY": delay,
        "AUTOTHROTTLE_MAX_DELAY": 60.0,
        "DOWNLOAD_DELAY": delay,
        "RANDOMIZE_DOWNLOAD_DELAY": False,  # otherwise the delay would be 0.5 to 1.5 times the declared minimum
        "CONCURRENT_REQUESTS": 16,
        "CONCURRENT_REQUESTS_PER_DOMAIN": 4 if delay > 0 else 16,
        "RETRY_TIMES": 3,
        "RETRY_HTTP_CODES": [500, 502, 504, 522, 524, 408],
        "REDIRECT_MAX_TIMES": 6,
    }
    bounds = {
        "DOWNLOAD_TIMEOUT": DOWNLOAD_SECONDS,
        "DOWNLOAD_MAXSIZE": MAX_BYTES,
        "DOWNLOAD_HANDLERS": dict.fromkeys(("http", "https"), "crawler.fetch.network_limits.LimitedHandler"),
        "DOWNLOAD_WARNSIZE": 0,
        "DEPTH_LIMIT": MAX_DEPTH,
        "URLLENGTH_LIMIT": 2000,
        "LOG_ENABLED": False,
    }
    cached = {
        "HTTPCACHE_ENABLED": cache is not None,
        "HTTPCACHE_DIR": str(cache or ""),
        "HTTPCACHE_STORAGE": "crawler.fetch.response_cache.JsonCacheStorage",
        "HTTPCACHE_POLICY": "scrapy.extensions.httpcache.RFC2616Policy",
    }
    return {**own, **manners, **bounds, **cached}

"""Frontier of a crawl: waiting, leased, finished and failed pages, durable at every moment.

A page is one transaction: its items, its links and its completion are written together. If a process is killed, no page
is lost or repeated: pages that it had leased are fetched again, finished pages are not. (The JOBDIR of Scrapy does not
contain requests in flight.)

`FailFastFrontier` ends the crawl at the first storage error: afterwards no task waits and nothing is written, so that
Scrapy finishes, and the error is raised where the crawl was started.
"""

from __future__ import annotations

import errno
import hashlib
import json
import sqlite3
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, TypeVar

from crawler.sites.registry import canonical_url
from metric_base.errors import InputError, StorageError

#: Refusals because of options of the crawl: a resume with other options adds these tasks again.
OFF_SITE, PRIVATE = "off the site", "private address"
REFUSALS = (OFF_SITE, PRIVATE)
Result = TypeVar("Result")
#: Errors of the system after which files cannot be written.
FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO})
_ZERO_COUNTS = dict.fromkeys(("waiting", "leased", "done", "failed", "items", "pictures"), 0)


@dataclass(frozen=True, slots=True)
class Task:
    """An address to fetch."""

    url: str
    callback: str = "parse"  #: Name of the method of the spider that parses the response.
    meta: Mapping[str, Any] = field(default_factory=dict)  #: Values that accompany the request.
    priority: int = 0
    key: str = ""

    def text(self) -> str:
        """Return the task as JSON; a pickle from a shared frontier could execute code."""
        return json.dumps([self.url, self.callback, dict(self.meta), self.priority, self.key], ensure_ascii=False)

    @classmethod
    def from_text(cls, text: str) -> Task:
        """Return the task of a JSON text."""
        url, callback, meta, priority, key = json.loads(text)
        return cls(url, callback, meta, priority, key)


def task_key(url: str, callback: str = "parse") -> str:
    """Return the identity of a task: a canonical address is fetched once per callback."""
    return hashlib.sha256(f"{callback} {canonical_url(url)}".encode()).hexdigest()[:32]


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of a task. A response has items or an image, never both, so that one number counts the new ones."""

    key: str
    items: Sequence[tuple[str, str]] = ()  #: Ids and JSON lines.
    tasks: Sequence[Task] = ()  #: Links.
    failure: str | None = None
    pictures: Sequence[tuple[str, str]] = ()  #: Ids and JSON lines.
    #: Maximum number of new items; None: no limit. A page with further items waits to be fetched again.
    max_items: int | None = None

    def __post_init__(self) -> None:
        if self.items and self.pictures:
            raise ValueError(f"{self.key}: expected items or pictures; found both")

    def is_whole(self, new: int) -> bool:
        """Return True if all items are stored after `new` new ones."""
        return self.max_items is None or new < self.max_items or len(self.items) <= new


class Frontier(Protocol):
    """Interface of a frontier: `SqliteFrontier` for one process, `RedisFrontier` for several."""

    def add(self, tasks: Iterable[Task]) -> int:
        """Add the tasks whose keys are new; return their number."""

    def lease(self) -> Task | None:
        """Lease the next task to this process; None if no task waits."""

    def renew(self) -> None:
        """Extend the leases of the tasks of this process, if they expire."""

    def reserve(self, host: str, delay: float) -> float:
        """Reserve a moment `delay` seconds after the last one of a host over all workers; return the seconds to it."""

    def put_back(self, task: Task) -> None:
        """Return a leased task, perhaps with another address (a redirect) or other values (a retry)."""

    def commit(self, outcome: Outcome) -> int:
        """Write the result of a leased task in one transaction; return the number of new items or images."""

    def is_exhausted(self) -> bool:
        """Return True if no task waits and no worker has a leased task."""

    def counts(self) -> dict[str, int]:
        """Tasks by state, items, and images."""

    def origin(self) -> dict[str, Any]:
        """Return the stored start addresses, query and category; empty if they are missing."""

    def remember(self, origin: Mapping[str, Any]) -> None:
        """Store start addresses, query and category for a resume."""

    def reopen(self, reason: str) -> int:
        """Let the tasks that were refused for a reason of `REFUSALS` wait again; return their number."""

    def start_over(self) -> None:
        """Remove all tasks of a crawl without result."""

    def lines(self, after: int = 0, kind: Literal["items", "pictures"] = "items") -> Iterable[tuple[int, str]]:
        """Return numbers and JSON lines of the items or images of this process after a number, in order."""

    def close(self) -> None:
        """Release files and connections."""


def has_no_result(counts: Mapping[str, int]) -> bool:
    """Return True if a crawl ended without a page, so that its folder can be used again."""
    return not any(counts[state] for state in ("waiting", "leased", "done", "items"))


def store_errors() -> tuple[type[Exception], ...]:
    """Return the error types of SQLite, of the system, and of Redis if it is imported."""
    redis = sys.modules.get("redis")
    return (sqlite3.Error, OSError, StorageError, *([] if redis is None else [redis.RedisError]))


class FailFastFrontier:
    """Wrap a frontier so that its first storage error ends the crawl and is reported once.

    Parameters
    ----------
    frontier : Frontier
    place : str
        File or server, for the message.
    """

    def __init__(self, frontier: Frontier, place: str) -> None:
        self._frontier = frontier
        self._place = place
        #: Called at the first error; ends the crawl.
        self.on_error: Callable[[], object] = lambda: None
        #: The first error, or None.
        self.error: StorageError | None = None

    def fail(self, error: Exception) -> None:
        """Store the first error, and end the crawl."""
        if self.error is None:
            self.error = _storage_error(error, self._place)
            self.on_error()

    def call_or(self, default: Result, call: Callable[[], Result]) -> Result:
        """Return `call()`, or `default` if this call or an earlier one failed."""
        if self.error is not None:
            return default
        try:
            return call()
        except store_errors() as error:
            self.fail(error)
            return default

    def add(self, tasks: Iterable[Task]) -> int:
        """Add the tasks whose keys are new; return their number."""
        return self.call_or(0, lambda: self._frontier.add(tasks))

    def lease(self) -> Task | None:
        """Lease the next task; None if no task waits or the frontier failed."""
        return self.call_or(None, self._frontier.lease)

    def renew(self) -> None:
        """Extend the leases of the tasks of this process."""
        self.call_or(None, self._frontier.renew)

    def reserve(self, host: str, delay: float) -> float:
        """Reserve the next moment for a request to a host; return the seconds until then."""
        return self.call_or(0.0, lambda: self._frontier.reserve(host, delay))

    def put_back(self, task: Task) -> None:
        """Return a leased task."""
        self.call_or(None, lambda: self._frontier.put_back(task))

    def commit(self, outcome: Outcome) -> int:
        """Write the result of a leased task; return the number of new items or images."""
        return self.call_or(0, lambda: self._frontier.commit(outcome))

    def is_exhausted(self) -> bool:
        """Return True if no task is left or the frontier failed."""
        return self.call_or(True, self._frontier.is_exhausted)

    def counts(self) -> dict[str, int]:
        """Tasks by state, items, and images."""
        return self.call_or(dict(_ZERO_COUNTS), self._frontier.counts)

    def origin(self) -> dict[str, Any]:
        """Return the stored start addresses, query and category."""
        return self._frontier.origin()

    def lines(self, after: int = 0, kind: Literal["items", "pictures"] = "items") -> Iterable[tuple[int, str]]:
        """Return numbers and JSON lines of the items or images after a number."""
        return self._frontier.lines(after, kind)

    def close(self) -> None:
        """Release files and connections."""
        try:
            self._frontier.close()
        except store_errors() as error:
            self.fail(error)


@contextmanager
def storage_errors(place: str) -> Iterator[None]:
    """Convert storage errors of the block to a `StorageError` that names the place."""
    try:
        yield
    except InputError:
        raise
    except store_errors() as error:
        raise _storage_error(error, place) from None


def _storage_error(error: Exception, place: str) -> StorageError:
    if isinstance(error, StorageError):
        return error
    message = " ".join(str(error).split())
    # a resume does not repair a damaged file
    advice = "" if "not a database" in message or "malformed" in message else "; --resume continues the crawl"
    return StorageError(f"{place}: expected a frontier that can be read and written, found: {message}{advice}")

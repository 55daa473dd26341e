"""The frontier of a crawl: what is to be fetched, what is being fetched, what came of it. Durable at every moment.

A page is one transaction: its items, its links and the mark that it is done are written together or not at all. A
process that is killed therefore loses nothing and repeats nothing: what it had leased is fetched again, what it had
finished is not. (Scrapy's JOBDIR keeps no such promise: it forgets requests in flight and what it had not yet flushed.)

A frontier that is watched: when it can no longer be written or asked, the crawl ends and says so.

A crawl that went on without its frontier would fetch pages and lose them, or sit on pages that it has leased. So the
first error ends it: from then on nothing waits and nothing is written, Scrapy finds the crawl finished, and the error
is raised where the crawl was started. What was leased is fetched again by the resumed crawl.
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

#: Refusals that come of a crawl's options and not of the page: a resume with other options offers these tasks again.
OFF_SITE, PRIVATE = "off the site", "private address"
REFUSALS = (OFF_SITE, PRIVATE)
Answer = TypeVar("Answer")
#: What a system says where nothing more can be written.
FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO})
_NOTHING = dict.fromkeys(("waiting", "leased", "done", "failed", "items", "pictures"), 0)


@dataclass(frozen=True, slots=True)
class Task:
    """One address to fetch: the name of the spider's method for it, small facts that travel along, its priority."""

    url: str
    callback: str = "parse"
    meta: Mapping[str, Any] = field(default_factory=dict)
    priority: int = 0
    key: str = ""

    def text(self) -> str:
        """The task as JSON; no pickle, since a shared frontier must not run what it is given."""
        return json.dumps([self.url, self.callback, dict(self.meta), self.priority, self.key], ensure_ascii=False)

    @classmethod
    def from_text(cls, text: str) -> Task:
        """The task of its JSON."""
        url, callback, meta, priority, key = json.loads(text)
        return cls(url, callback, meta, priority, key)


def task_key(url: str, callback: str = "parse") -> str:
    """The identity of a task: one canonical address is fetched once for one purpose."""
    return hashlib.sha256(f"{callback} {canonical_url(url)}".encode()).hexdigest()[:32]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a task: `items` and `pictures` as JSON lines by their ids, tasks it led to, why it failed.

    most : new items to take at most, None for all; a page of which items were left over waits to be fetched again.
    An answer is a page with items or a picture, never both, so that what was new of either is one number.
    """

    key: str
    items: Sequence[tuple[str, str]] = ()
    tasks: Sequence[Task] = ()
    failure: str | None = None
    pictures: Sequence[tuple[str, str]] = ()
    most: int | None = None

    def __post_init__(self) -> None:
        if self.items and self.pictures:
            raise ValueError(f"{self.key}: expected items or pictures; found both")

    def is_whole(self, new: int) -> bool:
        """Whether no item was left over, where `new` were taken."""
        return self.most is None or new < self.most or len(self.items) <= new


class Frontier(Protocol):
    """What the scheduler asks of a frontier; `frontier_sqlite` is one process's, `frontier_redis` everyone's."""

    def add(self, tasks: Iterable[Task]) -> int:
        """Add the tasks whose keys are new; the number of them."""

    def lease(self) -> Task | None:
        """The next task, now in this process's hands; None where nothing waits."""

    def put_back(self, task: Task) -> None:
        """Return a leased task, perhaps with another address (a redirect) or other facts (a retry)."""

    def commit(self, outcome: Outcome) -> int:
        """Write what came of a leased task, in one transaction; the number of items and pictures that were new."""

    def is_exhausted(self) -> bool:
        """Whether nothing waits, and nothing is in any worker's hands and might come back."""

    def counts(self) -> dict[str, int]:
        """Tasks by state, items, and pictures."""

    def origin(self) -> dict[str, Any]:
        """What the crawl began with, as it was remembered; empty if nothing was."""

    def remember(self, origin: Mapping[str, Any]) -> None:
        """Keep what the crawl began with, for a resume that does not name it."""

    def reopen(self, reason: str) -> int:
        """Let the tasks that were refused for a reason (of `REFUSALS`) wait again; the number of them."""

    def start_over(self) -> None:
        """Forget all tasks: those of a crawl that came to nothing."""

    def lines(self, after: int = 0, kind: Literal["items", "pictures"] = "items") -> Iterable[tuple[int, str]]:
        """Numbers and JSON lines of this process's items or pictures behind a number, in the order they came."""

    def close(self) -> None:
        """Release files and connections."""


def has_no_result(counts: Mapping[str, int]) -> bool:
    """Whether a crawl ended and no page came home; its folder may be used as if it were free."""
    return not any(counts[state] for state in ("waiting", "leased", "done", "items"))


def store_errors() -> tuple[type[Exception], ...]:
    """What the libraries below a frontier raise: SQLite's errors, the system's, Redis' where it is in use."""
    redis = sys.modules.get("redis")
    return (sqlite3.Error, OSError, StorageError, *([] if redis is None else [redis.RedisError]))


class FailFastFrontier:
    """A frontier whose first error is kept and reported once.

    Parameters
    ----------
    place : the file or server, for the message.
    """

    def __init__(self, frontier: Frontier, place: str) -> None:
        self._frontier = frontier
        self._place = place
        #: What ends the crawl; whoever runs it sets this.
        self.on_error: Callable[[], object] = lambda: None
        #: Why the crawl cannot go on; None as long as it can.
        self.error: StorageError | None = None

    def fail(self, error: Exception) -> None:
        """Keep the first error, and end the crawl."""
        if self.error is None:
            self.error = _storage_error(error, self._place)
            self.on_error()

    def watch(self, call: Callable[[], Answer], otherwise: Answer) -> Answer:
        """What the call returns; `otherwise` where it fails, or a call before it did."""
        if self.error is not None:
            return otherwise
        try:
            return call()
        except store_errors() as error:
            self.fail(error)
            return otherwise

    def add(self, tasks: Iterable[Task]) -> int:
        """Add the tasks whose keys are new; the number of them."""
        return self.watch(lambda: self._frontier.add(tasks), 0)

    def lease(self) -> Task | None:
        """The next task; None where nothing waits, or the frontier failed."""
        return self.watch(self._frontier.lease, None)

    def put_back(self, task: Task) -> None:
        """Return a leased task."""
        self.watch(lambda: self._frontier.put_back(task), None)

    def commit(self, outcome: Outcome) -> int:
        """Write what came of a leased task; the number of items and pictures that were new."""
        return self.watch(lambda: self._frontier.commit(outcome), 0)

    def is_exhausted(self) -> bool:
        """Whether nothing is left to do, or the frontier failed."""
        return self.watch(self._frontier.is_exhausted, True)

    def counts(self) -> dict[str, int]:
        """Tasks by state, items, and pictures."""
        return self.watch(self._frontier.counts, dict(_NOTHING))

    def origin(self) -> dict[str, Any]:
        """What the crawl began with."""
        return self._frontier.origin()

    def remember(self, origin: Mapping[str, Any]) -> None:
        """Keep what the crawl began with."""
        self._frontier.remember(origin)

    def reopen(self, reason: str) -> int:
        """Let the tasks that were refused for a reason wait again; the number of them."""
        return self._frontier.reopen(reason)

    def start_over(self) -> None:
        """Forget all tasks."""
        self._frontier.start_over()

    def lines(self, after: int = 0, kind: Literal["items", "pictures"] = "items") -> Iterable[tuple[int, str]]:
        """Numbers and JSON lines of the items or pictures behind a number."""
        return self._frontier.lines(after, kind)

    def close(self) -> None:
        """Release files and connections; a frontier that failed may fail again, which says nothing new."""
        try:
            self._frontier.close()
        except store_errors() as error:
            self.fail(error)


@contextmanager
def storage_errors(place: str) -> Iterator[None]:
    """What the libraries below a frontier raise inside the block, as a `StorageError` that names the place."""
    try:
        yield
    except InputError:
        raise
    except store_errors() as error:
        raise _storage_error(error, place) from None


def _storage_error(error: Exception, place: str) -> StorageError:
    if isinstance(error, StorageError):
        return error
    said = " ".join(str(error).split())
    # a damaged file is not healed by another try
    advice = "" if "not a database" in said or "malformed" in said else "; --resume goes on"
    return StorageError(f"{place}: expected a frontier that can be written and asked, found: {said}{advice}")

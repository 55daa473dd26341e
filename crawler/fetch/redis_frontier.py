"""Frontier of several processes or machines: Redis, with leases that expire.

A worker renews the leases of its pages as long as it runs. Leases of a killed worker expire by the clock of the server,
and other workers fetch its pages. Items are stored by the worker that read them in an
SQLite file before the task is marked as done; after a kill between the two, the page is read again and gives the same
ids. scrapy-redis is not used, because it removes a request before it is fetched, so that a killed worker loses its
requests, and because it pickles requests.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from crawler.fetch.frontier import REFUSALS, Outcome, Task, task_key
from crawler.fetch.sqlite_frontier import SqliteFrontier
from metric_base.errors import InputError, StorageError

#: Time without a renewal after which another worker may fetch a leased page in seconds. Workers renew every second, and
#: read a page in at most 2 s of processor time; an idle worker looks for a page every 5 s.
LEASE_SECONDS = 30.0


class NoRedis(InputError):
    """A Redis server does not respond."""


#: Scripts that the server runs as one transaction each: `frontier_NAME.lua`.
_SCRIPTS = ("add", "lease", "reopen", "reserve")
#: Keys of a crawl in Redis; `refused` has the reasons of tasks that a resume with other options adds again.
_PARTS = ("seen", "tasks", "queue", "leases", "done", "failed", "refused", "origin")


class RedisFrontier:
    """A shared frontier. `name` separates crawls on one server; `folder` contains the items of this worker."""

    def __init__(self, url: str, name: str, folder: Path, lease_seconds: float = LEASE_SECONDS) -> None:
        import redis

        try:
            self._redis: Any = redis.Redis.from_url(url, decode_responses=True, socket_timeout=30)
            seconds, microseconds = self._redis.time()
        except (redis.RedisError, ValueError) as error:  # a malformed address is a ValueError
            raise NoRedis(f"{url}: expected a Redis server; found {error}") from None
        self._keys = {part: f"metric-tree:{name}:{part}" for part in _PARTS}
        scripts = [Path(__file__).with_name(f"frontier_{name}.lua").read_text("utf-8") for name in _SCRIPTS]
        self._add, self._lease, self._reopen, self._reserve = map(self._redis.register_script, scripts)
        self._lease_seconds = lease_seconds
        self._clock_offset: float = seconds + microseconds / 1e6 - time.monotonic()
        self._leased: set[str] = set()
        self._url, self._is_begun = url, False
        self._items = SqliteFrontier(folder / "frontier.sqlite")

    def add(self, tasks: Iterable[Task]) -> int:
        """Add the tasks whose keys are new; return their number."""
        arguments: list[Any] = []
        for task in tasks:
            key = task.key or task_key(task.url, task.callback)
            arguments += [key, -task.priority, replace(task, key=key).text()]
        keys = [self._keys[part] for part in ("seen", "tasks", "queue", "leases")]
        return int(self._add(keys=keys, args=arguments)) if arguments else 0

    def lease(self) -> Task | None:
        """Lease the next task; tasks with an expired lease wait."""
        keys = [self._keys[part] for part in ("tasks", "queue", "leases")]
        now = self._now()
        text = self._lease(keys=keys, args=[now, now + self._lease_seconds])
        task = Task.from_text(text) if text else None
        if task:
            self._leased.add(task.key)
        return task

    def renew(self) -> None:
        """Extend the leases of the tasks of this worker, but not of those that another worker has finished."""
        if self._leased:
            ends = dict.fromkeys(self._leased, self._now() + self._lease_seconds)
            self._redis.zadd(self._keys["leases"], ends, xx=True)

    def _now(self) -> float:
        """Return the time of the server in seconds, so that the clocks of the workers may differ."""
        return time.monotonic() + self._clock_offset

    def reserve(self, host: str, delay: float) -> float:
        """Reserve the next moment for a request to a host over all workers; return the seconds until then."""
        keys = [f"{self._keys['origin']}:{host}"]
        return int(self._reserve(keys=keys, args=[round(1000 * self._now()), round(1000 * delay)])) / 1000

    def put_back(self, task: Task) -> None:
        """Return a leased task, perhaps changed."""
        self._leased.discard(task.key)
        pipe = self._redis.pipeline(transaction=True)
        pipe.hset(self._keys["tasks"], task.key, task.text())
        pipe.zrem(self._keys["leases"], task.key)
        pipe.zadd(self._keys["queue"], {task.key: -task.priority})
        pipe.execute()

    def commit(self, outcome: Outcome) -> int:
        """Write the items to the file of this worker, then the links and the completion to Redis."""
        new = self._items.commit(replace(outcome, tasks=(), failure=None))
        self.add(outcome.tasks)
        self._leased.discard(outcome.key)
        pipe = self._redis.pipeline(transaction=True)
        pipe.zrem(self._keys["leases"], outcome.key)
        pipe.zrem(self._keys["queue"], outcome.key)  # it is there again if its lease has expired
        if not outcome.is_whole(new):
            pipe.zadd(self._keys["queue"], {outcome.key: 0})
        else:
            if outcome.failure in REFUSALS:  # a resume with other options may add it again
                pipe.hset(self._keys["refused"], outcome.key, outcome.failure)
            else:
                pipe.hdel(self._keys["tasks"], outcome.key)
            pipe.hincrby(self._keys["done" if outcome.failure is None else "failed"], outcome.failure or "pages", 1)
        pipe.execute()
        return new

    def is_exhausted(self) -> bool:
        """Return True if no task waits or is leased.

        Raises
        ------
        StorageError
            The server has lost the crawl, because it was restarted without its data.
        """
        if self._redis.zcard(self._keys["queue"]) or self._redis.zcard(self._keys["leases"]):
            return False
        if self._is_begun and not self._redis.exists(self._keys["origin"]):
            raise StorageError(
                f"{self._url}: expected the tasks of the crawl, found a server that has lost them;"
                " --resume with the same start addresses continues the crawl"
            )
        return True

    def counts(self) -> dict[str, int]:
        """Return tasks by state over all workers, and the numbers of items and images of this worker."""
        done = sum(map(int, self._redis.hvals(self._keys["done"])))
        failed = sum(map(int, self._redis.hvals(self._keys["failed"])))
        leased = int(self._redis.zcard(self._keys["leases"]))
        expired = int(self._redis.zcount(self._keys["leases"], "-inf", self._now()))
        waiting = int(self._redis.zcard(self._keys["queue"])) + expired
        counts = {"waiting": waiting, "leased": leased, "done": done, "failed": failed}
        return counts | {kind: count for kind, count in self._items.counts().items() if kind in {"items", "pictures"}}

    def lines(self, after: int = 0, kind: Literal["items", "pictures"] = "items") -> Iterable[tuple[int, str]]:
        """Return numbers and JSON lines of the items or images of this worker."""
        return self._items.lines(after, kind)

    def origin(self) -> dict[str, Any]:
        """Return the stored start addresses, query and category; empty if they are missing."""
        return dict(json.loads(self._redis.get(self._keys["origin"]) or "{}"))

    def remember(self, origin: Mapping[str, Any]) -> None:
        """Store start addresses, query and category for all workers."""
        self._redis.set(self._keys["origin"], json.dumps(dict(origin)))
        self._is_begun = True

    def reopen(self, reason: str) -> int:
        """Let the tasks that were refused for a reason wait again; return their number."""
        return int(self._reopen(keys=[self._keys[part] for part in ("refused", "queue", "failed")], args=[reason]))

    def start_over(self) -> None:
        """Remove all tasks and their results."""
        self._redis.delete(*(key for part, key in self._keys.items() if part != "origin"))

    def close(self) -> None:
        """Close the connection and this worker's file."""
        self._items.close()
        self._redis.close()

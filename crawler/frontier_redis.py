"""The frontier that several processes or machines share: Redis, with leases that run out.

scrapy-redis was looked at and not taken: it pops a request before it is fetched, so that a killed worker loses what it
held, and it pickles requests. Here a lease names its worker and its end; a worker that dies lets its leases run out and
another takes them up. Items stay with the worker that read them, in its own SQLite file, written before the task is
marked done: a worker killed between the two leaves an item that the next one reads again under the same id.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from crawler.faults import InputFault
from crawler.frontier import Outcome, Task, task_key
from crawler.frontier_sqlite import SqliteFrontier

__all__ = ["LEASE_SECONDS", "NoRedis", "RedisFrontier"]

#: A page that is not done after this time is given to another worker: the longest download (see `crawler.manners`),
#: with its delays, fits in many times over.
LEASE_SECONDS = 180.0


class NoRedis(InputFault):
    """A Redis server that does not answer."""


# KEYS: seen, tasks, queue, leases. ARGV: triples of key, score, text.
_ADD = """
local added = 0
for i = 1, #ARGV, 3 do
  if redis.call('SADD', KEYS[1], ARGV[i]) == 1 then
    redis.call('HSET', KEYS[2], ARGV[i], ARGV[i + 2])
    redis.call('ZADD', KEYS[3], ARGV[i + 1], ARGV[i])
    added = added + 1
  end
end
return added
"""

# KEYS: tasks, queue, leases. ARGV: now, the lease's end.
_LEASE = """
for _, key in ipairs(redis.call('ZRANGEBYSCORE', KEYS[3], '-inf', ARGV[1])) do
  redis.call('ZREM', KEYS[3], key)
  redis.call('ZADD', KEYS[2], 0, key)
end
local found = redis.call('ZPOPMIN', KEYS[2])
if #found == 0 then return false end
redis.call('ZADD', KEYS[3], ARGV[2], found[1])
return redis.call('HGET', KEYS[1], found[1])
"""


class RedisFrontier:
    """A shared frontier. `name` keeps crawls on one server apart; `folder` is where this worker keeps its items."""

    def __init__(self, url: str, name: str, folder: Path, lease_seconds: float = LEASE_SECONDS) -> None:
        import redis

        self._redis: Any = redis.Redis.from_url(url, decode_responses=True, socket_timeout=30)
        try:
            self._redis.ping()
        except redis.RedisError as error:
            raise NoRedis(f"{url}: expected a Redis server; found {error}") from None
        self._keys = {
            part: f"metric-tree:{name}:{part}" for part in ("seen", "tasks", "queue", "leases", "done", "failed")
        }
        self._add = self._redis.register_script(_ADD)
        self._lease = self._redis.register_script(_LEASE)
        self._lease_seconds = lease_seconds
        self._items = SqliteFrontier(folder / "frontier.sqlite")

    def add(self, tasks: Iterable[Task]) -> int:
        """Add the tasks whose keys are new; the number of them."""
        arguments: list[Any] = []
        for task in tasks:
            key = task.key or task_key(task.url, task.callback)
            whole = Task(task.url, task.callback, task.meta, task.priority, key)
            arguments += [key, -task.priority, whole.text()]
        keys = [self._keys[part] for part in ("seen", "tasks", "queue", "leases")]
        return int(self._add(keys=keys, args=arguments)) if arguments else 0

    def lease(self) -> Task | None:
        """The next task; leases that ran out count as waiting."""
        now = time.time()
        keys = [self._keys[part] for part in ("tasks", "queue", "leases")]
        text = self._lease(keys=keys, args=[now, now + self._lease_seconds])
        return Task.of_text(text) if text else None

    def put_back(self, task: Task) -> None:
        """Return a leased task, perhaps changed."""
        pipe = self._redis.pipeline(transaction=True)
        pipe.hset(self._keys["tasks"], task.key, task.text())
        pipe.zrem(self._keys["leases"], task.key)
        pipe.zadd(self._keys["queue"], {task.key: -task.priority})
        pipe.execute()

    def commit(self, outcome: Outcome) -> int:
        """Items to this worker's file first, then the links and the mark to Redis."""
        new = self._items.commit(Outcome(outcome.key, outcome.items))
        self.add(outcome.tasks)
        pipe = self._redis.pipeline(transaction=True)
        pipe.zrem(self._keys["leases"], outcome.key)
        pipe.hdel(self._keys["tasks"], outcome.key)
        pipe.hincrby(self._keys["done" if outcome.failure is None else "failed"], outcome.failure or "pages", 1)
        pipe.execute()
        return new

    def is_exhausted(self) -> bool:
        """Whether no task waits or is leased by anyone."""
        return not (self._redis.zcard(self._keys["queue"]) or self._redis.zcard(self._keys["leases"]))

    def counts(self) -> dict[str, int]:
        """Tasks by state over all workers, and this worker's items."""
        done = sum(map(int, self._redis.hvals(self._keys["done"])))
        failed = sum(map(int, self._redis.hvals(self._keys["failed"])))
        own = {"items": self._items.counts()["items"]}
        leased, late = (
            self._redis.zcard(self._keys["leases"]),
            self._redis.zcount(self._keys["leases"], "-inf", time.time()),
        )
        waiting = int(self._redis.zcard(self._keys["queue"])) + int(late)  # leases that ran out wait again
        return {"waiting": waiting, "leased": int(leased), "done": done, "failed": failed} | own

    def failures(self) -> dict[str, int]:
        """Failed tasks by their reason, over all workers."""
        return {reason: int(count) for reason, count in self._redis.hgetall(self._keys["failed"]).items()}

    def lines(self, after: int = 0) -> Iterable[tuple[int, str]]:
        """Numbers and JSON lines of this worker's items."""
        return self._items.lines(after)

    def close(self) -> None:
        """Close the connection and this worker's file."""
        self._items.close()
        self._redis.close()

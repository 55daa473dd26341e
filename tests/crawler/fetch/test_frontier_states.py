"""Both frontiers against a plain model, with kills, full disks and lost answers at random moments."""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, ClassVar

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule, run_state_machine_as_test

from crawler.fetch.frontier import Outcome, Task, task_key
from crawler.fetch.redis_frontier import RedisFrontier
from crawler.fetch.sqlite_frontier import SqliteFrontier
from tests.crawler.conftest import RedisServer

NUMBERS = st.integers(0, 12)
QUICK = settings(max_examples=25, stateful_step_count=30, deadline=None, suppress_health_check=list(HealthCheck))


def url(number: int) -> str:
    return f"http://a.example/{number}"


def lines(frontier: Any) -> dict[str, str]:
    return {line.split()[0]: line for _, line in frontier.lines()}


class SqliteStates(RuleBasedStateMachine):
    """Committed pages are stored once and completely; other pages are fetched again."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = Path(tempfile.mkdtemp())
        self.frontier = SqliteFrontier(self.folder / "f.sqlite")
        self.waiting: set[str] = set()
        self.leased: dict[str, Task] = {}
        self.done: set[str] = set()
        self.failed: set[str] = set()
        self.items: set[str] = set()

    def known(self) -> set[str]:
        return self.waiting | set(self.leased) | self.done | self.failed

    @rule(numbers=st.lists(NUMBERS, max_size=5))
    def add(self, numbers: list[int]) -> None:
        keys = {task_key(url(number)) for number in numbers}
        assert self.frontier.add([Task(url(number)) for number in numbers]) == len(keys - self.known())
        self.waiting |= keys - self.known()

    @rule()
    def lease(self) -> None:
        task = self.frontier.lease()
        assert (task is None) == (not self.waiting)
        if task is not None:
            self.waiting.remove(task.key)
            self.leased[task.key] = task

    @precondition(lambda self: self.leased)
    @rule(data=st.data())
    def put_back(self, data: st.DataObject) -> None:
        key = data.draw(st.sampled_from(sorted(self.leased)))
        self.frontier.put_back(self.leased.pop(key))
        self.waiting.add(key)

    @precondition(lambda self: self.leased)
    @rule(data=st.data(), items=st.lists(NUMBERS, max_size=4), links=st.lists(NUMBERS, max_size=4), fails=st.booleans())
    def commit(self, data: st.DataObject, items: list[int], links: list[int], fails: bool) -> None:
        key = data.draw(st.sampled_from(sorted(self.leased)))
        found = {f"shop:{number}" for number in items}
        new = self.frontier.commit(self._outcome(key, items, links, "http 500" if fails else None))
        assert new == len(found - self.items)
        self._committed(key, found, links, fails)

    @precondition(lambda self: self.leased)
    @rule(data=st.data(), items=st.lists(NUMBERS, min_size=1, max_size=4), links=st.lists(NUMBERS, max_size=4))
    def commit_on_a_full_disk(self, data: st.DataObject, items: list[int], links: list[int]) -> None:
        key = data.draw(st.sampled_from(sorted(self.leased)))
        connection = self.frontier._connection
        connection.execute("PRAGMA max_page_count = 1")  # rounded up to the pages in use
        try:
            self.frontier.commit(self._outcome(key, items, links, None, "x" * 9000))
        except sqlite3.OperationalError:
            return  # no part of it is stored, as the invariants require
        finally:
            connection.execute("PRAGMA max_page_count = 1000000")
        self._committed(key, {f"shop:{number}" for number in items}, links, False)

    @rule()
    def kill(self) -> None:
        self.frontier = SqliteFrontier(self.folder / "f.sqlite")  # the old one is not closed
        self.waiting |= set(self.leased)
        self.leased.clear()

    @invariant()
    def the_counts_are_the_model_s(self) -> None:
        counts = self.frontier.counts()
        assert [counts[name] for name in ("waiting", "leased", "done", "failed")] == [
            len(states) for states in (self.waiting, self.leased, self.done, self.failed)
        ]
        assert set(lines(self.frontier)) == self.items
        assert self.frontier.is_exhausted() == (not self.waiting and not self.leased)

    def teardown(self) -> None:
        self.frontier.close()
        shutil.rmtree(self.folder)

    def _outcome(self, key: str, items: list[int], links: list[int], failure: str | None, more: str = "") -> Outcome:
        entries = [(f"shop:{number}", f"shop:{number} {more}") for number in items]
        return Outcome(key, entries, [Task(url(number)) for number in links], failure)

    def _committed(self, key: str, items: set[str], links: list[int], fails: bool) -> None:
        del self.leased[key]
        (self.failed if fails else self.done).add(key)
        self.items |= items
        self.waiting |= {task_key(url(number)) for number in links} - self.known()


def test_the_frontier_of_one_process_keeps_what_it_promised() -> None:
    run_state_machine_as_test(SqliteStates, settings=QUICK)


@contextmanager
def _lost_answer(frontier: RedisFrontier, command: int) -> Iterator[None]:
    """Every answer from the `command`th on is lost: the server has done it, or has not been asked any more."""
    connection = frontier._redis.connection_pool.connection_class
    whole, count = connection.read_response, 0

    def read_response(self: Any, *given: Any, **named: Any) -> Any:
        nonlocal count
        count += 1
        if count > command:
            self.disconnect()
            raise ConnectionResetError("the line is cut")
        return whole(self, *given, **named)

    connection.read_response = read_response
    try:
        yield
    finally:
        connection.read_response = whole
        frontier._redis.connection_pool.disconnect()


class RedisStates(RuleBasedStateMachine):
    """Two workers; whichever dies or loses the server, no page and no item is lost, and every page ends."""

    address: ClassVar[str]

    def __init__(self) -> None:
        super().__init__()
        import redis

        redis.Redis.from_url(self.address).flushall()
        self.folder = Path(tempfile.mkdtemp())
        self.workers = [self._worker(number) for number in range(2)]
        self.hands: list[list[Task]] = [[], []]
        self.added: set[str] = set()
        self.committed: set[str] = set()

    def _worker(self, number: int) -> RedisFrontier:
        return RedisFrontier(self.address, "states", self.folder / str(number), lease_seconds=-1.0)

    @rule(which=st.integers(0, 1), numbers=st.lists(NUMBERS, max_size=5), cut=st.integers(0, 3))
    def add(self, which: int, numbers: list[int], cut: int) -> None:
        tasks = [Task(url(number)) for number in numbers]
        with suppress(Exception):
            if cut < 2:
                with _lost_answer(self.workers[which], cut):
                    self.workers[which].add(tasks)
        self.workers[which].add(tasks)  # a page whose links were not taken is fetched again and offers them again
        self.added |= {task_key(url(number)) for number in numbers}

    @rule(which=st.integers(0, 1))
    def lease(self, which: int) -> None:
        task = self.workers[which].lease()
        if task is not None:
            assert task.key in self.added
            self.hands[which].append(task)

    @rule(which=st.integers(0, 1))
    def lose_the_answer_to_a_lease(self, which: int) -> None:
        with suppress(Exception), _lost_answer(self.workers[which], 0):
            self.workers[which].lease()  # leased, and nobody knows

    @precondition(lambda self: any(self.hands))
    @rule(which=st.integers(0, 1), links=st.lists(NUMBERS, max_size=3), cut=st.integers(0, 6))
    def commit(self, which: int, links: list[int], cut: int) -> None:
        if not self.hands[which]:
            return
        task = self.hands[which].pop()
        outcome = Outcome(task.key, [(f"page:{task.url}", f"page:{task.url}")], [Task(url(number)) for number in links])
        if cut < 3:
            try:
                with _lost_answer(self.workers[which], cut):
                    self.workers[which].commit(outcome)
            except Exception:  # noqa: BLE001 - the worker stops here; another takes the page up
                self.kill(which)
                return
        else:
            self.workers[which].commit(outcome)
        self.committed.add(f"page:{task.url}")
        self.added |= {task_key(url(number)) for number in links}

    @rule(which=st.integers(0, 1))
    def kill(self, which: int) -> None:
        self.hands[which].clear()
        self.workers[which] = self._worker(which)

    def teardown(self) -> None:
        """Whoever is left finishes: every page that was added is done, every item is in some worker's file."""
        for _ in range(200):
            task = self.workers[0].lease()
            if task is None:
                break
            self.workers[0].commit(Outcome(task.key, [(f"page:{task.url}", f"page:{task.url}")]))
        assert self.workers[0].is_exhausted()
        items = {item for worker in self.workers for item in lines(worker)}
        assert self.committed <= items
        assert {task_key(item.removeprefix("page:")) for item in items} >= self.added
        for worker in self.workers:
            worker.close()
        shutil.rmtree(self.folder)


@pytest.fixture(scope="module")
def redis_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a server for all examples."""
    if shutil.which("redis-server") is None:
        pytest.skip("redis-server is not installed")
    server = RedisServer(tmp_path_factory.mktemp("redis"))
    yield server.url
    server.stop()


def test_the_shared_frontier_loses_nothing(redis_server: str) -> None:
    RedisStates.address = redis_server
    run_state_machine_as_test(RedisStates, settings=QUICK)

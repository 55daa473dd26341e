from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crawler.fetch.crawl import SEGMENT_ITEMS, TICK_SECONDS, last_written, write_segments
from crawler.fetch.frontier import OFF_SITE, PRIVATE, Outcome, Task, task_key
from crawler.fetch.redis_frontier import LEASE_SECONDS, NoRedis, RedisFrontier
from crawler.fetch.sqlite_frontier import SqliteFrontier


def _item(number: int) -> tuple[str, str]:
    return (f"shop:{number}", json.dumps({"schema": "metric-tree/raw/1", "source_id": str(number)}))


@given(st.text(max_size=30), st.dictionaries(st.text(max_size=5), st.integers()), st.integers(-9, 9))
def test_a_task_survives_its_text(url: str, meta: dict[str, int], priority: int) -> None:
    task = Task(url, "parse", meta, priority, "key")
    assert Task.from_text(task.text()) == task


def test_what_is_known_is_not_added_again(tmp_path: Path) -> None:
    frontier = SqliteFrontier(tmp_path / "f.sqlite")
    assert (
        frontier.add([Task("http://a.example/1"), Task("http://a.example/1?utm_source=x"), Task("http://a.example/2")])
        == 2
    )
    assert task_key("http://a.example/1#top") == task_key("http://a.example/1")
    assert task_key("http://a.example/p?ref=1001") != task_key("http://a.example/p?ref=1002")
    assert task_key("https://www.amazon.de/dp/B0ABCDEF01?th=1&ref=a") == task_key("https://www.amazon.de/dp/B0ABCDEF01")
    assert task_key("http://a.example/1", "picture") != task_key("http://a.example/1")


def test_priority_first_then_age(tmp_path: Path) -> None:
    frontier = SqliteFrontier(tmp_path / "f.sqlite")
    frontier.add(
        [Task("http://a.example/old"), Task("http://a.example/high", priority=5), Task("http://a.example/new")]
    )
    leased = [frontier.lease() for _ in range(4)]
    assert [task.url.rpartition("/")[2] if task else None for task in leased] == ["high", "old", "new", None]


def test_what_a_killed_process_held_is_waiting_again(tmp_path: Path) -> None:
    frontier = SqliteFrontier(tmp_path / "f.sqlite")
    frontier.add([Task("http://a.example/1"), Task("http://a.example/2")])
    done = frontier.lease()
    assert done is not None
    frontier.lease()
    frontier.commit(Outcome(done.key, [_item(1)], [Task("http://a.example/3")]))
    again = SqliteFrontier(tmp_path / "f.sqlite")  # the first is not closed: it was killed
    assert again.counts() == {"waiting": 2, "leased": 0, "done": 1, "failed": 0, "items": 1, "pictures": 0}


def test_an_item_comes_once(tmp_path: Path) -> None:
    frontier = SqliteFrontier(tmp_path / "f.sqlite")
    frontier.add([Task("http://a.example/1")])
    task = frontier.lease()
    assert task is not None
    assert frontier.commit(Outcome(task.key, [_item(1), _item(1), _item(2)])) == 2
    assert frontier.commit(Outcome(task.key, [_item(2)], failure="late")) == 0
    assert frontier.reopen("late") == 1


def test_a_task_put_back_keeps_its_key(tmp_path: Path) -> None:
    frontier = SqliteFrontier(tmp_path / "f.sqlite")
    frontier.add([Task("http://a.example/1")])
    task = frontier.lease()
    assert task is not None
    frontier.put_back(Task("http://a.example/moved", key=task.key))
    moved = frontier.lease()
    assert moved is not None
    assert (moved.url, moved.key) == ("http://a.example/moved", task.key)


def test_segments_hold_every_item_once_whatever_is_interrupted(tmp_path: Path) -> None:
    frontier = SqliteFrontier(tmp_path / "f.sqlite")
    frontier.add([Task("http://a.example/1"), Task("http://a.example/2")])
    for first in (0, SEGMENT_ITEMS + 10):
        task = frontier.lease()
        assert task is not None
        frontier.commit(Outcome(task.key, [_item(first + number) for number in range(SEGMENT_ITEMS + 10)]))
        assert write_segments(frontier, tmp_path) == SEGMENT_ITEMS + 10
    assert write_segments(frontier, tmp_path) == 0
    (tmp_path / ".items-000099999-000099999.jsonl.123").write_text("half")  # state after a kill
    assert last_written(tmp_path) == 2 * (SEGMENT_ITEMS + 10)
    lines = [line for path in sorted(tmp_path.glob("items-*.jsonl")) for line in path.read_text().splitlines()]
    assert len(lines) == len(set(lines)) == 2 * (SEGMENT_ITEMS + 10)


def test_pictures_go_to_segments_of_their_own(tmp_path: Path) -> None:
    frontier = SqliteFrontier(tmp_path / "f.sqlite")
    frontier.add([Task("http://a.example/1"), Task("http://a.example/2")])
    page, seen = frontier.lease(), frontier.lease()
    assert page is not None
    assert seen is not None
    assert frontier.commit(Outcome(page.key, [_item(1)])) == 1
    pictures = [("picture:x", "{}"), ("picture:y", "{}")]
    assert frontier.commit(Outcome(seen.key, pictures=pictures)) == 2
    assert write_segments(frontier, tmp_path) == 1
    names = ["items-000000001-000000001.jsonl", "pictures-000000001-000000002.jsonl"]
    assert sorted(path.name for path in tmp_path.glob("*.jsonl")) == names
    assert write_segments(frontier, tmp_path) == 0


def test_an_answer_is_a_page_or_a_picture() -> None:
    with pytest.raises(ValueError, match="items or pictures"):
        Outcome("key", [_item(1)], pictures=[("picture:x", "{}")])


def test_a_page_of_which_items_are_left_over_waits_again(tmp_path: Path) -> None:
    frontier = SqliteFrontier(tmp_path / "f.sqlite")
    frontier.add([Task("http://a.example/1")])
    task = frontier.lease()
    assert task is not None
    assert frontier.commit(Outcome(task.key, [_item(1), _item(2)], max_items=1)) == 1
    assert (frontier.counts()["waiting"], frontier.counts()["items"]) == (1, 1)
    assert frontier.lease() == task
    assert frontier.commit(Outcome(task.key, [_item(1), _item(2)])) == 1
    assert frontier.counts()["done"] == 1


@pytest.mark.parametrize("kind", ["sqlite", "redis"])
def test_a_refused_task_is_offered_again_and_a_failed_one_is_not(
    tmp_path: Path, kind: str, request: pytest.FixtureRequest
) -> None:
    frontier: SqliteFrontier | RedisFrontier = SqliteFrontier(tmp_path / "f.sqlite")
    if kind == "redis":
        frontier = RedisFrontier(request.getfixturevalue("redis_url"), "test", tmp_path)
    frontier.remember({"start": ["http://a.example/1"]})
    frontier.add([Task(f"http://a.example/{number}") for number in range(3)])
    for failure in (OFF_SITE, PRIVATE, "http 404"):
        task = frontier.lease()
        assert task is not None
        frontier.commit(Outcome(task.key, failure=failure))
    assert frontier.reopen(PRIVATE) == 1
    again = frontier.lease()
    assert again is not None
    assert again.url == "http://a.example/1"
    assert frontier.lease() is None
    assert frontier.counts()["failed"] == 2
    assert frontier.origin() == {"start": ["http://a.example/1"]}
    frontier.start_over()
    assert frontier.is_exhausted()
    assert frontier.add([Task("http://a.example/0")]) == 1
    frontier.close()


def test_a_lease_that_is_renewed_does_not_expire(tmp_path: Path, redis_url: str) -> None:
    alive, other = (RedisFrontier(redis_url, "test", tmp_path / name, lease_seconds=-1.0) for name in ("one", "two"))
    alive.add([Task("http://a.example/1")])
    task = alive.lease()
    alive._lease_seconds = LEASE_SECONDS
    alive.renew()
    assert other.lease() is None
    assert task is not None
    alive.put_back(task)
    alive.renew()  # it has no task any more
    assert other.lease() == task
    alive.commit(Outcome(task.key))
    other.renew()  # the task is finished, and does not return
    assert other.is_exhausted()
    alive.close()
    other.close()


def test_workers_reserve_moments_of_a_site_one_after_another(tmp_path: Path, redis_url: str) -> None:
    one, two = (RedisFrontier(redis_url, "test", tmp_path / name) for name in ("one", "two"))
    seconds = [worker.reserve("a.example", 10.0) for worker in (one, two, one, two)]
    assert seconds[0] == 0.0
    assert all(10.0 * place - 5.0 < wait <= 10.0 * place for place, wait in enumerate(seconds))
    assert two.reserve("b.example", 10.0) == 0.0
    one.close()
    two.close()


def test_work_of_a_killed_worker_resumes_within_a_minute() -> None:
    from scrapy.core.engine import ExecutionEngine

    poll_s = ExecutionEngine._SLOT_HEARTBEAT_INTERVAL  # an idle worker looks for a task at this interval
    assert LEASE_SECONDS + 2 * poll_s < 60
    assert LEASE_SECONDS >= 10 * TICK_SECONDS


def test_an_address_of_another_kind_is_no_server(tmp_path: Path) -> None:
    with pytest.raises(NoRedis, match=r"http://x\.example: expected a Redis server"):
        RedisFrontier("http://x.example", "crawl", tmp_path)

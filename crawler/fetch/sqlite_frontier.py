"""Frontier of one process: an SQLite file that also stores the items until they are written to segments."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal
from urllib.parse import quote

from crawler.fetch.frontier import Outcome, Task, task_key

WAITING, LEASED, DONE, FAILED = range(4)
_STATES = ("waiting", "leased", "done", "failed")

#: Tables of results, which have the same columns.
_KINDS = ("items", "pictures")


class SqliteFrontier:
    """A frontier in one file. When it is opened, tasks that a killed process had leased wait again."""

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self._connection = sqlite3.connect(path, isolation_level=None)
        # in this mode, a killed process loses no committed transaction; a power cut may lose the last ones
        self._connection.executescript("PRAGMA journal_mode=WAL; PRAGMA synchronous=NORMAL;")
        self._connection.executescript(Path(__file__).with_name("frontier.sql").read_text("utf-8"))
        self._connection.execute("UPDATE tasks SET state=? WHERE state=?", (WAITING, LEASED))
        row = self._connection.execute("SELECT coalesce(max(number), 0) FROM tasks").fetchone()
        self._number = int(row[0])

    def add(self, tasks: Iterable[Task]) -> int:
        """Add the tasks whose keys are new; return their number."""
        with self._transaction():
            return self._insert(tasks)

    def lease(self) -> Task | None:
        """Lease the next task by priority, then age."""
        row = self._connection.execute(
            "UPDATE tasks SET state=? WHERE key=(SELECT key FROM tasks WHERE state=? ORDER BY priority DESC, number"
            " LIMIT 1) RETURNING text",
            (LEASED, WAITING),
        ).fetchone()
        return Task.from_text(row[0]) if row else None

    def renew(self) -> None:
        """Do nothing: leases end with the process."""

    def reserve(self, _host: str, _delay: float) -> float:
        """Return 0: Scrapy respects the delay of one process."""
        return 0.0

    def put_back(self, task: Task) -> None:
        """Return a leased task, perhaps changed."""
        self._connection.execute(
            "UPDATE tasks SET state=?, text=?, priority=? WHERE key=?", (WAITING, task.text(), task.priority, task.key)
        )

    def commit(self, outcome: Outcome) -> int:
        """Write items, links and the completion of a task in one transaction."""
        with self._transaction():
            new = self._store("items", outcome.items, outcome.max_items)
            state = DONE if outcome.is_whole(new) else WAITING
            new += self._store("pictures", outcome.pictures)
            self._insert(outcome.tasks)
            self._connection.execute(
                "UPDATE tasks SET state=?, failure=? WHERE key=?",
                (state if outcome.failure is None else FAILED, outcome.failure, outcome.key),
            )
        return new

    def is_exhausted(self) -> bool:
        """Return True if no task waits or is leased; a fast query, because it runs before every request."""
        query = "SELECT EXISTS (SELECT 1 FROM tasks WHERE state IN (?, ?))"
        return not self._connection.execute(query, (WAITING, LEASED)).fetchone()[0]

    def counts(self) -> dict[str, int]:
        """Return tasks by state, and the numbers of items and images."""
        return _counts(self._connection)

    def origin(self) -> dict[str, Any]:
        """Return the stored start addresses, query and category; empty if they are missing."""
        row = self._connection.execute("SELECT text FROM origin").fetchone()
        return dict(json.loads(row[0])) if row else {}

    def remember(self, origin: Mapping[str, Any]) -> None:
        """Store start addresses, query and category."""
        self._connection.execute("INSERT OR REPLACE INTO origin VALUES (1, ?)", (json.dumps(dict(origin)),))

    def reopen(self, reason: str) -> int:
        """Let the tasks that were refused for a reason wait again; return their number."""
        query = "UPDATE tasks SET state=?, failure=NULL WHERE state=? AND failure=?"
        return self._connection.execute(query, (WAITING, FAILED, reason)).rowcount

    def start_over(self) -> None:
        """Remove all tasks."""
        self._connection.execute("DELETE FROM tasks")

    def lines(self, after: int = 0, kind: Literal["items", "pictures"] = "items") -> Iterator[tuple[int, str]]:
        """Return numbers and JSON lines of the items or images after a number, in order."""
        yield from self._connection.execute(
            f"SELECT number, line FROM {kind} WHERE number > ? ORDER BY number",  # noqa: S608 - a table of `_KINDS`
            (after,),
        )

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def _insert(self, tasks: Iterable[Task]) -> int:
        added = 0
        for task in tasks:
            key = task.key or task_key(task.url, task.callback)
            self._number += 1
            added += self._connection.execute(
                "INSERT OR IGNORE INTO tasks (key, state, priority, number, text) VALUES (?, ?, ?, ?, ?)",
                (key, WAITING, task.priority, self._number, replace(task, key=key).text()),
            ).rowcount
        return added

    def _store(self, kind: str, entries: Sequence[tuple[str, str]], max_new: int | None = None) -> int:
        """Insert entries until `max_new` were new; return the number of new ones."""
        query = f"INSERT OR IGNORE INTO {kind} (id, line) VALUES (?, ?)"  # noqa: S608 - a table of `_KINDS`
        new = 0
        for entry in entries:
            if new == max_new:
                break
            new += self._connection.execute(query, entry).rowcount
        return new

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        """Begin a transaction, and commit it, or roll it back if the block or the commit raises an error."""
        self._connection.execute("BEGIN IMMEDIATE")
        try:
            yield
            self._connection.execute("COMMIT")
        finally:  # a full disk may have ended the transaction already
            if self._connection.in_transaction:
                self._connection.execute("ROLLBACK")


def stored_counts(path: Path) -> dict[str, int]:
    """Return the counts of a frontier file without a change; another process may have it open."""
    connection = sqlite3.connect(f"file:{quote(str(path))}?mode=ro", uri=True)
    try:
        return _counts(connection)
    except sqlite3.OperationalError:  # killed before its tables were created, or without a table of images
        return dict.fromkeys((*_STATES, *_KINDS), 1)
    finally:
        connection.close()


def _counts(connection: sqlite3.Connection) -> dict[str, int]:
    rows = dict(connection.execute("SELECT state, count(*) FROM tasks GROUP BY state").fetchall())
    states = {name: int(rows.get(state, 0)) for state, name in enumerate(_STATES)}
    for kind in _KINDS:
        states[kind] = int(connection.execute(f"SELECT count(*) FROM {kind}").fetchone()[0])  # noqa: S608
    return states

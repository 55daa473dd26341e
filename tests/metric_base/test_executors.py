"""Processes of a pool end with their parent, also if it is killed."""

from __future__ import annotations

import sys
import time
from concurrent.futures import CancelledError, Executor
from contextlib import nullcontext
from pathlib import Path
from typing import cast

import pytest
from distributed.comm import CommClosedError

from metric_base.errors import InputError
from metric_base.executors import executor_of
from tests.support.processes import started

#: Seconds within which the processes start and end; it is long because of other load on the machine.
LIMIT_S = 120.0
#: Programs that start processes and wait, by their purpose.
PROGRAMS = {
    "scales of the server": "from explorer.server.scale_jobs import ScaleJobs; ScaleJobs(Path('none')).preload()",
    "models": "from models3d.formats import read_assets; models = read_assets([Path('none.glb')]); next(models)",
    "shards": "from metric_base.executors import executor_of; "
    "manager = executor_of(2, None); pool = manager.__enter__(); pool.submit(abs, 1).result(60)",
}


@pytest.mark.parametrize("program", PROGRAMS.values(), ids=PROGRAMS)
def test_processes_end_with_a_killed_parent(program: str, tmp_path: Path) -> None:
    code = f"import time; from pathlib import Path; {program}; Path('ready').touch(); time.sleep(600)"
    until = time.monotonic() + LIMIT_S
    with started([sys.executable, "-c", code], cwd=tmp_path) as process:
        tasks = Path(f"/proc/{process.pid}/task")
        while not (tmp_path / "ready").exists() or len(children := _children(tasks)) < 2:  # one is the tracker
            assert time.monotonic() < until
            assert process.poll() is None
            time.sleep(0.05)
        time.sleep(2)  # the processes read their first task
        process.kill()
    while any(Path(f"/proc/{child}/task").exists() for child in children):
        assert time.monotonic() < until, "processes wait for ever"
        time.sleep(0.05)


def _children(tasks: Path) -> list[str]:
    return [child for task in tasks.glob("*/children") for child in task.read_text().split()]


class LostClient(nullcontext):
    """A client whose scheduler ends while a result is fetched, or before."""

    def __init__(self, error: Exception) -> None:
        super().__init__(self)
        self.error = error

    def submit(self, *_: object, **__: object) -> LostClient:
        return self

    def result(self, timeout: float) -> None:  # noqa: ARG002
        raise self.error


@pytest.mark.parametrize("error", [CancelledError(), CommClosedError("in <TCP ...>")], ids=["before", "meanwhile"])
def test_a_lost_scheduler_is_one_line(error: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    """The executor of Dask's client has futures that never become done if their result is lost while it is fetched."""
    monkeypatch.setattr("distributed.Client", lambda *_, **__: LostClient(error))
    lost = "--scheduler: the connection to tcp://a:1 was lost"
    with pytest.raises(InputError, match=lost), executor_of(2, "tcp://a:1") as executor:
        cast(Executor, executor).submit(len, "a").result(timeout=5)

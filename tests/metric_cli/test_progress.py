"""Progress: every item passes, bars on a terminal, a line every ten seconds elsewhere."""

from __future__ import annotations

import os
import pty
import select
import subprocess
import sys
from contextlib import suppress

import pytest

from metric_cli.progress import progress_bars, progress_lines, track
from tests.support.processes import started

CODE = """
from metric_cli.progress import progress_bars, track
print(sum(track([1, 2, 3], "adding")))
with progress_bars() as shown:
    shown("counting", 1, None)
    shown("counting", 2, 4)
"""


def test_short_work_says_nothing_where_nobody_looks(capsys: pytest.CaptureFixture[str]) -> None:
    assert list(track(iter("abc"), "letters", 3)) == ["a", "b", "c"]
    with progress_bars() as shown:
        shown("one", 1, 2)
    assert capsys.readouterr().err == ""


def test_long_work_says_a_line_every_ten_seconds() -> None:
    now, lines = 0.0, []
    shown = progress_lines(lines.append, lambda: now)
    for second in range(26):
        now = float(second)
        shown("inserting", second, 26 if second < 20 else None)
    assert lines == ["inserting: 10 of 26 (10 s, 16 s left)\n", "inserting: 20 (20 s)\n"]


def test_a_terminal_shows_steps_counts_and_the_time_left() -> None:
    master, slave = pty.openpty()
    environment = os.environ | {"TERM": "xterm", "COLUMNS": "100"}
    with started([sys.executable, "-c", CODE], stdout=subprocess.PIPE, stderr=slave, env=environment) as child:
        os.close(slave)
        shown = _all_of(master).decode()  # while it writes: a terminal holds 4 kB
        assert child.stdout is not None
        assert child.stdout.read() == b"6\n"
    assert child.returncode == 0
    assert all(words in shown for words in ("adding", "3/3", "counting", "2/4", "left:")), shown


def _all_of(terminal: int) -> bytes:
    """Text that is written to a terminal until its last writer has closed it."""
    parts = []
    with suppress(OSError):  # Linux reports the end as an error of input
        while select.select([terminal], [], [], 300.0)[0] and (part := os.read(terminal, 1 << 16)):
            parts.append(part)
    os.close(terminal)
    return b"".join(parts)

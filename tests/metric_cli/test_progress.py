"""Progress: every item passes, bars on a terminal, a line every ten seconds elsewhere."""

from __future__ import annotations

import os
import pty
import subprocess
import sys

import pytest

from metric_cli.progress import progress_bars, progress_lines, with_bar

CODE = """
from metric_cli.progress import progress_bars, with_bar
print(sum(with_bar([1, 2, 3], "adding")))
with progress_bars() as shown:
    shown("counting", 1, None)
    shown("counting", 2, 4)
"""


def test_short_work_says_nothing_where_nobody_looks(capsys: pytest.CaptureFixture[str]) -> None:
    assert list(with_bar(iter("abc"), "letters", 3)) == ["a", "b", "c"]
    with progress_bars() as shown:
        shown("one", 1, 2)
    assert capsys.readouterr().err == ""


def test_long_work_says_a_line_every_ten_seconds() -> None:
    now, lines = 0.0, []
    shown = progress_lines(lines.append, lambda: now)
    for second in range(26):
        now = float(second)
        shown("inserting", second, 26 if second < 20 else None)
    assert lines == ["inserting: 10 of 26\n", "inserting: 20\n"]


def test_a_terminal_shows_steps_counts_and_the_time_left() -> None:
    master, slave = pty.openpty()
    environment = os.environ | {"TERM": "xterm", "COLUMNS": "100"}
    done = subprocess.run(
        [sys.executable, "-c", CODE], stdout=subprocess.PIPE, stderr=slave, env=environment, timeout=60, check=True
    )
    os.close(slave)
    shown = os.read(master, 100_000).decode()
    os.close(master)
    assert done.stdout == b"6\n"
    assert all(words in shown for words in ("adding", "3/3", "counting", "2/4", "left:")), shown

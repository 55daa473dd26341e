"""Progress: every item passes, bars on a terminal, nothing elsewhere."""

from __future__ import annotations

import os
import pty
import subprocess
import sys

import pytest

from metric_cli.progress import progress_bars, with_bar

CODE = """
from metric_cli.progress import progress_bars, with_bar
print(sum(with_bar([1, 2, 3], "adding")))
with progress_bars() as shown:
    shown("counting", 1, None)
    shown("counting", 2, 4)
"""


def test_nothing_is_shown_where_nobody_looks(capsys: pytest.CaptureFixture[str]) -> None:
    assert list(with_bar(iter("abc"), "letters", 3)) == ["a", "b", "c"]
    with progress_bars() as shown:
        shown("one", 1, 2)
    assert capsys.readouterr().err == ""


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

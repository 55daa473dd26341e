"""Output of a command at a terminal, and its end."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pyarrow as pa
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from metric_base.escaping import visible, visible_json
from metric_cli import programs, tables
from metric_cli.errors import exit_status
from metric_cli.subcommands import main
from metric_cli.tables import print_table, warn
from tests.support.processes import started

HIDDEN = ["\x1b", "\x07", "\x7f", "\x9b", "\u202e", "\u2066", "\u200f", "\ud800", "\U000e0041", "\r", "\n"]


@given(st.text(st.characters() | st.sampled_from(HIDDEN)))
def test_nothing_hidden_stays(text: str) -> None:
    shown = visible(text)
    assert not any(sign in shown for sign in HIDDEN)
    assert visible(shown) == shown


@given(st.text(st.characters() | st.sampled_from(HIDDEN)))
def test_escaped_json_means_the_same(text: str) -> None:
    shown = visible_json(json.dumps([text], ensure_ascii=False, indent=1))
    assert json.loads(shown) == [text]
    assert not any(sign in shown for sign in HIDDEN[:-1])


def test_tables_and_warnings_are_escaped(capsys: pytest.CaptureFixture[str]) -> None:
    print_table(["name"], [["\x1b[31mred[bold]"]])
    warn("\x1b]0;title\x07 of\na window", "estimate-scale")
    out, err = capsys.readouterr()
    assert "\\x1b[31mred[bold]" in out
    assert err == "estimate-scale: warning: \\x1b]0;title\\x07 of a window\n"


def test_a_table_is_as_wide_as_columns_says(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    print_table(["words"], [["many words " * 20]])
    assert max(map(len, capsys.readouterr().out.splitlines())) <= 40


@given(
    st.integers(1, 4).flatmap(
        lambda n: st.lists(
            st.lists(st.text("ab c1.,%–×[", max_size=9).map(str.strip), min_size=n, max_size=n), min_size=1, max_size=4
        )
    )
)
def test_a_table_of_plain_words_is_as_rich_draws_it(lines: list[list[str]]) -> None:
    assume(all(map(any, zip(*lines, strict=True))))  # a column of nothing is as wide as rich likes
    head = [column.replace("[", "(") for column in lines[0]]  # rich reads markup in the names of columns
    plain = tables.table_text(head, lines[1:], 200)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tables, "GAP", 1000)  # too wide for the plain form
        assert tables.table_text(head, lines[1:], 200) == plain


def _program(body: str) -> list[str]:
    return [
        sys.executable,
        "-c",
        f"import sys\nfrom metric_cli.errors import *\nfrom metric_cli.tables import *\n{body}",
    ]


def _run(body: str, **options: object) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(_program(body), capture_output=True, timeout=300, check=False, **options)  # type: ignore[call-overload, no-any-return]


def test_every_encoding_of_standard_output_is_served() -> None:
    body = "sys.exit(exit_status('x', lambda: print('2 × 3 ± 1 チ') or 0))"
    done = _run(body, env={**os.environ, "PYTHONIOENCODING": "ascii"})
    assert (done.returncode, done.stdout, done.stderr) == (0, b"2 x 3 +- 1 \\u30c1\n", b"")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no /dev/full")
def test_a_full_disk_is_one_line() -> None:
    with Path("/dev/full").open("wb") as full:
        body = "sys.exit(exit_status('x', lambda: print('much') or 0))"
        done = subprocess.run(_program(body), stdout=full, stderr=subprocess.PIPE, timeout=300, check=False)
    assert done.returncode == 2
    assert done.stderr.count(b"\n") == 1


def test_closed_streams_are_quiet() -> None:
    body = "sys.exit(exit_status('x', lambda: print('much') or print_table(['a'], [['b']]) or 0))"
    closed = ["sh", "-c", 'exec "$@" >&- 2>&-', "sh", *_program(body)]
    assert subprocess.run(closed, timeout=300, check=False).returncode == 0
    head = [
        "sh",
        "-c",
        '("$@"; echo "status $?" >&2) | head -c 1',
        "sh",
        *_program(body.replace("'much'", "'m' * 10**7")),
    ]
    done = subprocess.run(head, capture_output=True, timeout=300, check=False)
    assert done.stderr == b"status 0\n"


@pytest.mark.parametrize(
    ("number", "status", "word"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")]
)
def test_a_signal_is_one_line_and_leaves_nothing(
    number: signal.Signals, status: int, word: str, tmp_path: Path
) -> None:
    body = f"""
import time
from pathlib import Path
from metric_base.files import whole_folder
def run():
    with whole_folder(Path({str(tmp_path / "out")!r})) as work:
        (work / "a").write_text("x")
        print("ready", flush=True)
        time.sleep(600)
sys.exit(exit_status("x", run))
"""
    with started(_program(body), stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        process.send_signal(number)
        _, err = process.communicate()
    assert (process.returncode, err.decode()) == (status, f"x: {word}\n")
    assert not list(tmp_path.iterdir())


def test_the_statuses(capsys: pytest.CaptureFixture[str]) -> None:
    def error() -> int:
        raise RuntimeError("\x1b[2J")

    assert exit_status("x", lambda: 3) == 3
    assert exit_status("x", error) == 1
    assert capsys.readouterr().err == "x: internal error: RuntimeError: \\x1b[2J\n"
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_an_interruption_while_a_command_is_imported_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "interrupted_import.py").write_text("raise KeyboardInterrupt\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert programs._start("interrupted_import", "a-command") == 130
    assert capsys.readouterr().err == "a-command: interrupted\n"


def test_the_console_scripts_are_there() -> None:
    declared = tomllib.loads((Path(__file__).resolve().parents[2] / "pyproject.toml").read_text(encoding="utf-8"))
    for script in declared["project"]["scripts"].values():
        module, _, name = script.partition(":")
        assert (module, callable(getattr(programs, name))) == ("metric_cli.programs", True)


def test_percentages_and_signed_numbers_are_aligned_to_the_right() -> None:
    rows = [("5 %", "-1.5", "a5"), ("10 %", "+10", "b")]
    lines = tables.table_text(["part", "change", "name"], rows, 80).splitlines()
    assert lines[3:5] == [" 5 %".rjust(5) + "-1.5".rjust(9) + "   a5", "10 %".rjust(5) + "+10".rjust(9) + "   b"]


def test_a_table_of_priors_runs_no_formula_and_moves_no_cursor(
    monkeypatch: pytest.MonkeyPatch, capsysbinary: pytest.CaptureFixture[bytes]
) -> None:
    table = pa.table({"label": ["=1+1", "\n@a", "\x1b[2J", "mug"], "n_items": [1, 2, 3, 4]})
    monkeypatch.setattr(
        "metric_cli.subcommands.release.priors.open_tree", lambda _: SimpleNamespace(priors=lambda _: table)
    )
    assert main(["priors", "--csv"]) == 0
    lines = capsysbinary.readouterr().out.splitlines()
    assert lines[1:] == [b'"\'=1+1",1', b'"\'\\n@a",2', b'"\\x1b[2J",3', b'"mug",4']

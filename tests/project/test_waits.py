"""Every wait of the tests for a process, a thread or a server has a time limit: a test fails, but no run hangs."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support import processes
from tests.support.browser import Browser

ROOT = Path(__file__).resolve().parents[2]

#: Functions of the library that wait without a limit unless `timeout` is an argument, by module.
WITH_TIMEOUT = {"subprocess": {"run", "call", "check_call", "check_output"}, "request": {"urlopen"}}
#: Methods that wait without a limit if they have no argument.
WITH_ARGUMENT = {"join", "wait", "result", "acquire"}
#: Files without such a text need not be parsed, which takes seconds for all.
CANDIDATE = re.compile(r"subprocess\.|urlopen\(|\.(?:join|wait|result|acquire)\(\)|while .*\n.*readouterr")


def unlimited_waits(source: str) -> Iterator[int]:
    """Yield the lines of the calls of a module that may wait forever."""
    tree = ast.parse(source)
    for loop in (node for node in ast.walk(tree) if isinstance(node, ast.While)):
        # what another thread prints between the reading and the clearing of the captured text is lost
        if any(isinstance(node, ast.Attribute) and node.attr == "readouterr" for node in ast.walk(loop)):
            yield loop.lineno
    for call in ast.walk(tree):
        if not isinstance(call, ast.Call) or not isinstance(call.func, ast.Attribute):
            continue
        module = call.func.value
        name = module.attr if isinstance(module, ast.Attribute) else module.id if isinstance(module, ast.Name) else ""
        if call.func.attr in WITH_TIMEOUT.get(name, ()):
            if all(keyword.arg != "timeout" for keyword in call.keywords):
                yield call.lineno
        elif (call.func.attr in WITH_ARGUMENT and not call.args and not call.keywords) or (
            (name, call.func.attr) == ("subprocess", "Popen")  # `tests.support.processes.started` has a limit
        ):
            yield call.lineno


@pytest.mark.parametrize(
    ("source", "is_limited"),
    [
        ("subprocess.run(['x'])", False),
        ("subprocess.run(['x'], timeout=300)", True),
        ("urllib.request.urlopen('x')", False),
        ("thread.join()", False),
        ("thread.join(60)", True),
        ("process.wait(timeout=60)", True),
        ("subprocess.Popen(['x'])", False),
        ("started(['x'])", True),
        ("while thread.is_alive():\n    text += capsys.readouterr().err", False),
    ],
)
def test_a_wait_without_a_limit_is_found(source: str, is_limited: bool) -> None:
    assert list(unlimited_waits(source)) == ([] if is_limited else [1])


def test_every_wait_has_a_limit() -> None:
    exempt = {"support/processes.py", "support/browser.py", "crawler/conftest.py", "fuzz/__main__.py"}
    files = {path.relative_to(ROOT / "tests").as_posix(): path for path in (ROOT / "tests").rglob("*.py")}
    found = [
        f"tests/{name}:{line}"
        for name, path in files.items()
        if name not in exempt
        if CANDIDATE.search(text := path.read_text(encoding="utf-8"))
        for line in unlimited_waits(text)
    ]
    assert found == []


SLEEP = [sys.executable, "-c", "import time; time.sleep(600)"]


def test_a_process_ends_with_a_failed_block() -> None:
    with pytest.raises(ZeroDivisionError), processes.started(SLEEP) as process:
        raise ZeroDivisionError
    assert process.returncode == -9


def test_a_process_that_does_not_end_fails_its_test(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "LIMIT_S", 0.1)
    with pytest.raises(AssertionError, match=r"not ended after 0\.1 s"), processes.started(SLEEP):
        pass


def test_a_browser_that_ended_fails_its_test(tmp_path: Path) -> None:
    with Browser(tmp_path) as browser:
        browser._process.kill()
        with pytest.raises((AssertionError, BrokenPipeError)):
            browser.run("1")

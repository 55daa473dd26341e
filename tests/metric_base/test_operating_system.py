"""Commands run where modules and functions of Linux are missing, as on Windows and macOS; limits are reported once."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from metric_base import operating_system
from metric_base.operating_system import growth_limit, interrupts_blocked, is_alive, limit_memory, link_or_copy, lock
from tests.support.processes import started
from tests.synthetic.detectors import hue_graph

ROOT = Path(__file__).resolve().parents[2]
#: Run at the start of every process, also of those that the commands start.
BLOCK = """
import os, pathlib, signal, sys
for name in ("resource", "fcntl", "pwd", "grp", "termios"):
    sys.modules[name] = None
for name in ("link", "O_NONBLOCK", "O_CLOEXEC", "getuid", "fork"):
    if hasattr(os, name):
        delattr(os, name)
for name in ("pthread_sigmask", "setitimer", "SIGXCPU", "SIGPROF"):
    if hasattr(signal, name):
        delattr(signal, name)
"""
SCRIPT = "import sys; from metric_cli.programs import {0}; sys.exit({0}())"
NO_LIMIT = "this operating system has no limit of memory for files of unknown origin"


@pytest.fixture(scope="module")
def blocked(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The environment in which the modules are blocked."""
    folder = tmp_path_factory.mktemp("blocked")
    (folder / "sitecustomize.py").write_text(BLOCK)
    return os.environ | {"PYTHONPATH": f"{folder}{os.pathsep}{ROOT}"}


def run(blocked: dict[str, str], program: str, *words: str | Path) -> subprocess.CompletedProcess[str]:
    """Run a program with the modules blocked."""
    command = [sys.executable, "-c", SCRIPT.format(program), *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, env=blocked, cwd=ROOT, timeout=300, check=False)


def test_the_modules_are_blocked(blocked: dict[str, str]) -> None:
    code = "import resource"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=blocked, check=False, timeout=300
    )
    assert "ModuleNotFoundError" in done.stderr


def test_a_query(blocked: dict[str, str]) -> None:
    done = run(blocked, "metric_tree", "query", "swivel chair", "--json")
    assert (done.returncode, done.stderr) == (0, "")


def test_the_scale_of_a_reconstruction(blocked: dict[str, str], tmp_path: Path) -> None:
    target = tmp_path / "metric"
    done = run(blocked, "estimate_scale", "data/scenes/lund_street", "--write-scaled", target)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("scale ")
    assert (target / "metric_transform.txt").is_file()


def test_a_detector_states_once_that_its_memory_is_not_limited(blocked: dict[str, str], tmp_path: Path) -> None:
    (tmp_path / "labels.txt").write_text("car\nbus\n")
    graph = hue_graph(tmp_path / "hue.onnx")
    words = ("data/scenes/lund_street", "--detector", graph, "--detector-labels", tmp_path / "labels.txt")
    done = run(blocked, "estimate_scale", *words)
    assert done.returncode in {0, 3}, done.stderr
    assert done.stderr.count(NO_LIMIT) == 1


def test_a_model_is_checked(blocked: dict[str, str]) -> None:
    done = run(blocked, "metric_tree", "check-asset", "data/models/rocking_horse.glb", "--json")
    assert done.returncode in {0, 3}, done.stderr
    assert '"verdict"' in done.stdout
    assert done.stderr.count(NO_LIMIT) == 1


EXPLORER = """
import asyncio, httpx, metric_tree
from explorer.server.app import application
from metric_base.executors import executor_of

async def statuses(*paths):
    transport = httpx.ASGITransport(app=application([metric_tree.open()]))
    async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
        return [(await client.get(path)).status_code for path in paths]

if __name__ == "__main__":
    print(asyncio.run(statuses("/healthz", "/v1/search?q=chair", "/v1/nodes/chair.n.01/prior")))
    with executor_of(2, None) as pool:
        print(list(pool.map(abs, [-1, 2])))
"""


def test_the_explorer_and_workers(blocked: dict[str, str], tmp_path: Path) -> None:
    (tmp_path / "explorer_run.py").write_text(EXPLORER)
    words = [sys.executable, str(tmp_path / "explorer_run.py")]
    done = subprocess.run(words, capture_output=True, text=True, env=blocked, cwd=ROOT, timeout=300, check=False)
    assert (done.returncode, done.stdout) == (0, "[200, 200, 200]\n[1, 2]\n"), done.stderr


def test_missing_limits_are_reported_once(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    operating_system._report_missing.cache_clear()
    for name in ("resource", "fcntl"):
        monkeypatch.setitem(sys.modules, name, None)
    with caplog.at_level(logging.WARNING):
        for _ in range(2):
            limit_memory(1 << 30)
            with growth_limit(1 << 30):
                lock(0)
    no_lock = "this operating system has no lock of a folder against a second run"
    assert [record.getMessage() for record in caplog.records] == [NO_LIMIT, no_lock]
    operating_system._report_missing.cache_clear()


def test_links_are_copies_where_there_are_none(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "a").write_text("x")
    link_or_copy(tmp_path / "a", tmp_path / "b")
    assert (tmp_path / "b").samefile(tmp_path / "a")
    monkeypatch.delattr(os, "link")
    link_or_copy(tmp_path / "a", tmp_path / "c")
    assert (tmp_path / "c").read_text() == "x"
    assert not (tmp_path / "c").samefile(tmp_path / "a")


def test_windows_sends_no_signal_to_see_a_process(monkeypatch: pytest.MonkeyPatch) -> None:
    with started([sys.executable, "-c", ""]) as process:
        pass
    assert (is_alive(os.getpid()), is_alive(process.pid)) == (True, False)
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(os, "kill", lambda *_: pytest.fail("a signal"))
    assert is_alive(process.pid)


def test_graphics_use_egl_on_linux_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    assert operating_system.gl_settings() == {"backend": "egl"}
    monkeypatch.setattr(sys, "platform", "darwin")
    assert operating_system.gl_settings() == {}


def test_windows_locks_and_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[tuple[int, ...]] = []

    def locking(*words: int) -> None:
        calls.append(words)
        if len(calls) > 1:
            raise PermissionError(13, "locked")

    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setitem(sys.modules, "msvcrt", SimpleNamespace(LK_NBLCK=2, locking=locking))  # type: ignore[arg-type]
    lock(7)
    with pytest.raises(BlockingIOError, match="locked"):
        lock(7)
    assert calls == [(7, 2, 1)] * 2
    monkeypatch.setattr(os, "kill", lambda *_: pytest.fail("signal 0 is Ctrl-C on Windows"))
    assert is_alive(1)


def test_a_number_that_is_no_process(monkeypatch: pytest.MonkeyPatch) -> None:
    assert is_alive(os.getpid())
    assert is_alive(10**30), "the system cannot tell"
    for error, alive in ((ProcessLookupError, False), (PermissionError, True)):
        monkeypatch.setattr(os, "kill", lambda *_, error=error: (_ for _ in ()).throw(error))
        assert is_alive(1) is alive


def test_interrupts_are_blocked_within_a_block_where_the_system_can(monkeypatch: pytest.MonkeyPatch) -> None:
    def blocked() -> bool:
        return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ())

    with interrupts_blocked():
        assert blocked()
    assert not blocked()
    mask = signal.pthread_sigmask
    monkeypatch.delattr(signal, "pthread_sigmask")
    with interrupts_blocked():
        assert signal.SIGINT not in mask(signal.SIG_BLOCK, ())


@pytest.mark.parametrize(("hard", "expected"), [(-1, 1000), (2000, 1000), (500, 500)])
def test_a_limit_of_memory_is_at_most_that_of_the_system(
    hard: int, expected: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    import resource

    given: list[tuple[int, int]] = []
    monkeypatch.setattr(resource, "getrlimit", lambda _: (-1, hard))
    monkeypatch.setattr(resource, "setrlimit", lambda _, limits: given.append(limits))
    limit_memory(1000)
    assert given == [(expected, hard)]

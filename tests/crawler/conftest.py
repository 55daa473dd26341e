"""A Redis server of a test's own."""

from __future__ import annotations

import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest


class RedisServer:
    """A server on loopback that can be stopped, and started again with the data it had or without."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        for _ in range(10):  # another program may take the port between the two steps
            with socket.socket() as probe:
                probe.bind(("127.0.0.1", 0))
                self._port = int(probe.getsockname()[1])
            self.url = f"redis://127.0.0.1:{self._port}/0"
            if self.start():
                return
        raise AssertionError("redis-server finds no port")

    def start(self) -> bool:
        """Start it with the data in its folder; return whether its port was free."""
        words = ["redis-server", "--port", str(self._port), "--save", "", "--appendonly", "yes"]
        words += ["--dir", str(self._folder)]
        self._process = subprocess.Popen(words, stdout=subprocess.DEVNULL)
        return _answers(self._process, self._port)

    def stop(self, keep: bool = False) -> None:
        """Kill it without notice; its data stay in the folder or are removed."""
        self._process.kill()
        self._process.wait(timeout=60)
        if not keep:
            shutil.rmtree(self._folder / "appendonlydir")


@pytest.fixture
def redis_server(tmp_path: Path) -> Iterator[RedisServer]:
    """A server that keeps nothing unless it is requested to."""
    if shutil.which("redis-server") is None:
        pytest.skip("redis-server is not installed")
    folder = tmp_path / "redis"
    folder.mkdir()
    server = RedisServer(folder)
    try:
        yield server
    finally:
        server.stop()


@pytest.fixture
def redis_url(redis_server: RedisServer) -> str:
    """The address of a server that keeps nothing."""
    return redis_server.url


def _answers(process: subprocess.Popen[bytes], port: int) -> bool:
    """Wait until the server answers; False if it ended."""
    import redis

    end = time.monotonic() + 120
    while process.poll() is None:
        try:
            if redis.Redis(port=port, socket_timeout=60).info("server")["process_id"] == process.pid:
                return True
        except redis.RedisError:
            assert time.monotonic() < end, "redis-server does not answer"
        time.sleep(0.05)
    return False

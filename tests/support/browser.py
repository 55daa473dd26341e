"""A real browser without a screen, driven through Chromium's own protocol over a pipe: no driver to install."""

from __future__ import annotations

import json
import os
import select
import shutil
import subprocess
import time
from pathlib import Path
from types import TracebackType
from typing import Any

import pytest

__all__ = ["Browser", "PageError", "chromium"]

#: How long a condition may take to hold: an error ends a test that waits, not the load of the machine.
TIMEOUT_S = 180.0


def chromium() -> str:
    """The browser's path; the test is skipped where there is none."""
    path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if path is None:
        pytest.skip("no chromium; .ci/system-packages says how to install it")
    return path


class PageError(AssertionError):
    """The page or the browser refused: an expression threw, or its page was left meanwhile."""


class Browser:
    """One page; a context manager."""

    def __init__(self, profile: Path) -> None:
        to_browser, self._write = os.pipe()
        self._read, from_browser = os.pipe()
        self._left = b""
        self._number = 0

        def wire() -> None:  # Chromium reads from descriptor 3 and writes to 4
            one, two = os.dup(to_browser), os.dup(from_browser)
            os.dup2(one, 3)
            os.dup2(two, 4)

        self._process = subprocess.Popen(
            [
                chromium(),
                "--headless=new",
                "--no-sandbox",
                "--disable-gpu",
                "--no-first-run",
                "--disable-dev-shm-usage",
                f"--user-data-dir={profile}",
                "--window-size=1280,900",
                "--remote-debugging-pipe",
                "about:blank",
            ],
            preexec_fn=wire,  # noqa: PLW1509 - one thread here
            close_fds=False,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_browser)
        os.close(from_browser)
        self._session: str | None = None
        self._session = self.call("Target.attachToTarget", targetId=self._first_page(), flatten=True)["sessionId"]

    def _first_page(self) -> str:
        """The id of the page, which may open after the browser answers."""
        until = time.monotonic() + TIMEOUT_S
        while True:
            targets = self.call("Target.getTargets")["targetInfos"]
            pages = [str(target["targetId"]) for target in targets if target["type"] == "page"]
            if pages:
                return pages[0]
            assert time.monotonic() < until, "the browser opens no page"
            time.sleep(0.05)

    def __enter__(self) -> Browser:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._write)
        os.close(self._read)

    def open(self, url: str, ready: str = "document.readyState === 'complete'") -> None:
        """Go to an address and wait until an expression holds there, and not on the page that was shown before."""
        self.run("window.isLeft = true")
        answer = self.call("Page.navigate", url=url)
        assert "errorText" not in answer, answer
        self.wait(f"!window.isLeft && ({ready})" if "loaderId" in answer else ready)

    def run(self, expression: str) -> Any:
        """The value of a JavaScript expression on the page; promises are awaited."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise PageError(answer["exceptionDetails"])
        return answer["result"].get("value")

    def wait(self, expression: str) -> None:
        """Wait until an expression holds; it may fail while a page is loaded or left."""
        until = time.monotonic() + TIMEOUT_S
        while True:
            try:
                seen = self.run(f"Boolean({expression})")
            except PageError as error:
                seen = error
            if seen is True:
                return
            assert time.monotonic() < until, f"never: {expression}; last: {seen}"
            time.sleep(0.05)

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Press the mouse at one place of the window, move, release at another."""
        self._mouse("mousePressed", start)
        self._mouse("mouseMoved", end)
        self._mouse("mouseReleased", end)

    def click(self, place: tuple[float, float]) -> None:
        """Press and release the mouse."""
        self.drag(place, place)

    def type(self, text: str) -> None:
        """Type into what has the focus."""
        self.call("Input.insertText", text=text)

    def press(self, key: str) -> None:
        """Press a named key such as `Enter`."""
        extra = {"text": "\r", "windowsVirtualKeyCode": 13} if key == "Enter" else {}
        self.call("Input.dispatchKeyEvent", type="keyDown", key=key, code=key, **extra)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key, code=key)

    def _mouse(self, kind: str, place: tuple[float, float]) -> None:
        self.call("Input.dispatchMouseEvent", type=kind, x=place[0], y=place[1], button="left", buttons=1, clickCount=1)

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """One call of the DevTools protocol."""
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": params}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        until = time.monotonic() + TIMEOUT_S
        while True:
            answer = self._message(until)
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise PageError(method, answer["error"])
                result: dict[str, Any] = answer["result"]
                return result

    def _message(self, until: float) -> dict[str, Any]:
        while b"\0" not in self._left:
            readable, _, _ = select.select([self._read], [], [], max(0.0, until - time.monotonic()))
            assert readable, "the browser is silent"
            self._left += os.read(self._read, 1 << 16)
        line, _, self._left = self._left.partition(b"\0")
        message: dict[str, Any] = json.loads(line)
        return message

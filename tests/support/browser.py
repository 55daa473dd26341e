"""Control a headless Chromium through its DevTools protocol over a pipe, without a driver."""

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

#: Time limit of a condition in seconds. It is long, so that other load on the machine does not fail a test.
TIMEOUT_S = 180.0


def chromium() -> str:
    """Return the browser's path, or skip the test if no browser is installed."""
    path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if path is None:
        pytest.skip("no chromium; .ci/system-packages installs it")
    return path


class PageError(AssertionError):
    """A call failed: an expression raised an error, or the page was replaced during its evaluation."""


class Browser:
    """A browser with one page; a context manager."""

    def __init__(self, profile: Path) -> None:
        to_browser, self._write = os.pipe()
        self._read, from_browser = os.pipe()
        os.set_blocking(self._write, False)
        self._left = b""
        self._number = 0
        self._process = subprocess.Popen(
            [
                # Chromium reads from descriptor 3 and writes to 4. A shell connects them: Python code between fork and
                # exec could wait forever for a lock that another thread of this process holds.
                *("bash", "-c", f'exec "$0" "$@" 3<&{to_browser} 4>&{from_browser}'),
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
            pass_fds=(to_browser, from_browser),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_browser)
        os.close(from_browser)
        self._session: str | None = None
        try:
            self._session = self.call("Target.attachToTarget", targetId=self._first_page(), flatten=True)["sessionId"]
        except BaseException:
            self._end()
            raise

    def _first_page(self) -> str:
        """Return the id of the page, which may open after the browser's first response."""
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
        self._end()

    def _end(self) -> None:
        self._process.kill()
        self._process.wait(timeout=TIMEOUT_S)
        os.close(self._write)
        os.close(self._read)

    def open(self, url: str, ready: str = "document.readyState === 'complete'") -> None:
        """Open an address and wait until an expression is true on the new page."""
        self.run("window.isLeft = true")
        response = self.call("Page.navigate", url=url)
        assert "errorText" not in response, response
        self.wait(f"!window.isLeft && ({ready})" if "loaderId" in response else ready)

    def run(self, expression: str) -> Any:
        """Evaluate a JavaScript expression on the page; promises are awaited."""
        response = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in response:
            raise PageError(response["exceptionDetails"])
        return response["result"].get("value")

    def wait(self, expression: str) -> None:
        """Wait until an expression is true. It may raise errors while a page is loaded or replaced."""
        until = time.monotonic() + TIMEOUT_S
        while True:
            try:
                value = self.run(f"Boolean({expression})")
            except PageError as error:
                value = error
            if value is True:
                return
            assert time.monotonic() < until, f"never true: {expression}; last: {value}"
            time.sleep(0.05)

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Press the mouse button at one position (x, y) of the window, and release it at another."""
        self._mouse("mousePressed", start)
        self._mouse("mouseMoved", end)
        self._mouse("mouseReleased", end)

    def click(self, position: tuple[float, float]) -> None:
        """Press and release the mouse button."""
        self.drag(position, position)

    def type(self, text: str) -> None:
        """Type text into the focused element."""
        self.call("Input.insertText", text=text)

    def press(self, key: str) -> None:
        """Press a named key such as `Enter`."""
        extra = {"text": "\r", "windowsVirtualKeyCode": 13} if key == "Enter" else {}
        self.call("Input.dispatchKeyEvent", type="keyDown", key=key, code=key, **extra)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key, code=key)

    def _mouse(self, kind: str, position: tuple[float, float]) -> None:
        x, y = position
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """Call a method of the DevTools protocol and return its result."""
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": params}
        if self._session is not None:
            message["sessionId"] = self._session
        until = time.monotonic() + TIMEOUT_S
        unsent = json.dumps(message).encode() + b"\0"
        while unsent:
            _, writable, _ = select.select([], [self._write], [], max(0.0, until - time.monotonic()))
            assert writable, "the browser reads no message"
            unsent = unsent[os.write(self._write, unsent) :]
        while True:
            response = self._message(until)
            if response.get("id") == self._number:
                if "error" in response:
                    raise PageError(method, response["error"])
                result: dict[str, Any] = response["result"]
                return result

    def _message(self, until: float) -> dict[str, Any]:
        while b"\0" not in self._left:
            readable, _, _ = select.select([self._read], [], [], max(0.0, until - time.monotonic()))
            assert readable, "no message from the browser"
            part = os.read(self._read, 1 << 16)
            assert part, f"the browser ended with status {self._process.poll()}"
            self._left += part
        line, _, self._left = self._left.partition(b"\0")
        message: dict[str, Any] = json.loads(line)
        return message

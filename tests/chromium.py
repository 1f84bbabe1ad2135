"""A headless Chromium, driven through a pipe by its own devtools protocol."""

from __future__ import annotations

import base64
import json
import os
import shutil
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

PROGRAMS = ("chromium-headless-shell", "chromium", "google-chrome", "chrome")


def program() -> str | None:
    """The path of a Chromium, None where there is none."""
    return next(filter(None, map(shutil.which, PROGRAMS)), None)


class Tab:
    """One page: what it says of itself, and what it asked of the network or complained of."""

    def __init__(self, asks: int, answers: int):
        self._write = os.fdopen(asks, "wb", buffering=0)
        self._read = os.fdopen(answers, "rb")
        self._numbers = count(1)
        self._session: str | None = None
        self.events: list[dict[str, Any]] = []
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        attached = self.ask("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.ask(f"{domain}.enable")

    def ask(self, method: str, **params: Any) -> dict[str, Any]:
        """What the browser answers; events that come before it are kept."""
        number = next(self._numbers)
        request: dict[str, Any] = {"id": number, "method": method, "params": params}
        if self._session:
            request["sessionId"] = self._session
        self._write.write(json.dumps(request).encode() + b"\0")
        while (message := self._message()).get("id") != number:
            self.events.append(message)
        assert "error" not in message, message
        return message["result"]

    def open(self, page: Path, width: int, height: int = 800) -> None:
        """Load a page in a window of this size, and wait until it is loaded."""
        self.ask(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        self.events.clear()
        self.ask("Page.navigate", url=page.resolve().as_uri())
        while not self.heard("Page.loadEventFired"):
            self.events.append(self._message())

    def heard(self, method: str) -> list[Mapping[str, Any]]:
        """The parameters of the events of this name since the page was opened."""
        return [one["params"] for one in self.events if one.get("method") == method]

    def value(self, expression: str) -> Any:
        """What an expression of JavaScript is on the page."""
        found = self.ask("Runtime.evaluate", expression=expression, returnByValue=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def screenshot(self, path: Path) -> None:
        """The whole page, written as PNG."""
        found = self.ask("Page.captureScreenshot", captureBeyondViewport=True)
        path.write_bytes(base64.b64decode(found["data"]))

    def _message(self) -> dict[str, Any]:
        data = bytearray()
        while (byte := self._read.read(1)) != b"\0":
            assert byte, "the browser has ended"
            data += byte
        return json.loads(data)


@contextmanager
def tab(chromium: str, profile: Path) -> Iterator[Tab]:
    """A tab of a browser that ends with the block."""
    their_end, ask = os.pipe()
    answer, our_end = os.pipe()
    words = [chromium, "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
    words += [f"--user-data-dir={profile}", "--remote-debugging-pipe", "--no-first-run"]
    shell = f'exec "$@" 3<&{their_end} 4>&{our_end}'
    browser = subprocess.Popen(
        ["bash", "-c", shell, "bash", *words],
        pass_fds=(their_end, our_end),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(their_end)
    os.close(our_end)
    try:
        yield Tab(ask, answer)
    finally:
        browser.terminate()
        browser.wait(10)

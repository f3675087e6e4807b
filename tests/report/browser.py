"""A headless Chromium, driven over its debugging pipe: no port, no other package."""

import base64
import contextlib
import json
import os
import select
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
_ANSWER_S = 60.0

# Chromium reads commands from descriptor 3 and answers on 4.
_START = (
    "import os, sys; os.dup2(int(sys.argv[1]), 3); os.dup2(int(sys.argv[2]), 4); os.execv(sys.argv[3], sys.argv[3:])"
)


def chromium_or_skip() -> str:
    program = next(filter(None, map(shutil.which, _NAMES)), None)
    if program is None:
        pytest.skip("no Chromium here to open the report in (Debian and Ubuntu: apt-get install chromium)")
    return program


class Page:
    """One page, and everything it complained about or asked for."""

    def __init__(self, to_browser: int, from_browser: int) -> None:
        self._to, self._from = to_browser, from_browser
        self._buffer = b""
        self._number = 0
        self._session: str | None = None
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self._events: list[str] = []
        target = self._ask("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self._ask(f"{domain}.enable")

    def open(
        self, path: Path, *, width: int = 1200, height: int = 900, colors: str = "light", media: str = "screen"
    ) -> None:
        self.look(width=width, height=height, colors=colors, media=media)
        self._events.clear()
        self._ask("Page.navigate", url=path.resolve().as_uri())
        while "Page.loadEventFired" not in self._events:
            self._take()
        self.run("new Promise(done => setTimeout(done, 400))")

    def look(self, *, width: int = 1200, height: int = 900, colors: str = "light", media: str = "screen") -> None:
        self._ask(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600
        )
        self._ask(
            "Emulation.setEmulatedMedia", media=media, features=[{"name": "prefers-color-scheme", "value": colors}]
        )

    def run(self, script: str) -> Any:
        """The value of a JavaScript expression; waits for a promise."""
        answer = self._ask("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in answer:
            raise AssertionError(f"{script}: {answer['exceptionDetails']}")
        return answer["result"].get("value")

    def screenshot(self, png: Path, *, selector: str | None = None) -> Path:
        """The whole page, or one element of it."""
        options: dict[str, Any] = {"captureBeyondViewport": True}
        if selector is not None:
            box = self.run(
                f"(() => {{ const b = document.querySelector({selector!r}).getBoundingClientRect();"
                " return [b.x + scrollX, b.y + scrollY, b.width, b.height] })()"
            )
            options["clip"] = dict(zip(("x", "y", "width", "height"), box, strict=True)) | {"scale": 1}
        png.write_bytes(base64.b64decode(self._ask("Page.captureScreenshot", **options)["data"]))
        return png

    def view(self) -> str:
        """What is on the screen, as a PNG in base64."""
        return str(self._ask("Page.captureScreenshot")["data"])

    def print_pdf(self) -> bytes:
        return base64.b64decode(self._ask("Page.printToPDF", printBackground=True)["data"])

    def _ask(self, method: str, **parameters: Any) -> Any:
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._take()
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise AssertionError(f"{method}: {answer['error']}")
                return answer["result"]

    def _take(self) -> dict[str, Any]:
        deadline = time.monotonic() + _ANSWER_S
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._from], [], [], max(0.0, deadline - time.monotonic()))
            part = os.read(self._from, 1 << 16) if ready else b""
            if not part:
                raise AssertionError(f"Chromium fell silent after {_ANSWER_S:g} s, or ended")
            self._buffer += part
        line, self._buffer = self._buffer.split(b"\0", 1)
        message: dict[str, Any] = json.loads(line)
        self._note(message.get("method", ""), message.get("params", {}))
        return message

    def _note(self, method: str, details: dict[str, Any]) -> None:
        self._events.append(method)
        match method:
            case "Runtime.consoleAPICalled":
                if details["type"] in {"error", "warning", "assert"}:
                    self.complaints.append(str(details["args"]))
            case "Runtime.exceptionThrown":
                self.complaints.append(str(details["exceptionDetails"]))
            case "Log.entryAdded":
                self.complaints.append(str(details["entry"]))
            case "Network.requestWillBeSent":
                if not details["request"]["url"].startswith("data:"):
                    self.requests.append(details["request"]["url"])


@contextlib.contextmanager
def chromium_page(profile: Path) -> Iterator[Page]:
    """A page in a Chromium of its own, which ends with the block."""
    program = chromium_or_skip()
    browser_reads, we_write = os.pipe()
    we_read, browser_writes = os.pipe()
    # High numbers, so that neither is overwritten while the other takes its place.
    ends = [os.dup(end) for end in (browser_reads, browser_writes)]
    process = subprocess.Popen(
        [
            sys.executable, "-c", _START, *map(str, ends), program, "--headless=new", "--remote-debugging-pipe",
            "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-dev-shm-usage", "--hide-scrollbars",
            "--disable-background-networking", f"--user-data-dir={profile}", "about:blank",
        ],
        pass_fds=ends, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    for end in (browser_reads, browser_writes, *ends):
        os.close(end)
    try:
        yield Page(we_write, we_read)
    finally:
        process.terminate()
        try:
            process.wait(timeout=10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        os.close(we_write)
        os.close(we_read)

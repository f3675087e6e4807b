"""A page in Debian's Chromium, for tests that drive it as a person would."""

import shutil
import time
from typing import Any

from tests.extras.app.conftest import Client

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
SOFTWARE = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
LIMIT_S = 180.0


class Page:
    """A page, and what went wrong on it."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.errors: list[str] = []
        self.foreign: list[str] = []
        page.on("console", lambda message: self.errors.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("dialog", lambda dialog: self.errors.append(f"a dialog: {dialog.message}"))
        page.on("request", lambda request: self._observed(request.url))

    def _observed(self, url: str) -> None:
        if not url.startswith(("http://127.0.0.1:", "ws://127.0.0.1:", "data:", "blob:http://127.0.0.1:")):
            self.foreign.append(url)

    def until(self, expression: str) -> Any:
        """Wait until an expression of the page is true; the page's policy forbids Playwright's own way."""
        end_s = time.monotonic() + LIMIT_S
        while time.monotonic() < end_s:
            found = self.page.evaluate(f"() => {{ try {{ return {expression}; }} catch {{ return false; }} }}")
            if found:
                return found
            self.page.wait_for_timeout(50)
        raise AssertionError(f"not within {LIMIT_S:g} s: {expression}; {self.errors}; {self.messages()}")

    def messages(self) -> str:
        return str(self.page.inner_text("#messages"))

    def at(self, lon: float, lat: float) -> tuple[float, float]:
        """Where a place is on the screen."""
        x, y = self.page.evaluate(
            "([lon, lat]) => { const m = window.uavcover.map.map, p = m.project([lon, lat]),"
            " r = m.getCanvas().getBoundingClientRect(); return [p.x + r.x, p.y + r.y]; }",
            [lon, lat],
        )
        return x, y

    def job_ended(self, kind: str, count: int = 1) -> Any:
        return self.until(
            f"[...window.uavcover.state.jobs.values()].filter(j => j.kind === '{kind}' && j.code !== null).length >= {count}"
        )


def opened(browser: Any, served: Client, width: int = 1400, height: int = 900, **more: Any) -> Page:
    """The page at its first step. Its sockets are in ``window.sockets``, for tests that cut them."""
    page = Page(browser.new_page(viewport={"width": width, "height": height}, **more))
    page.page.add_init_script(
        "window.sockets = []; window.WebSocket = class extends WebSocket"
        " { constructor(...given) { super(...given); window.sockets.push(this); } };"
    )
    page.page.goto(served.url)
    page.until("document.documentElement.dataset.ready === 'yes'")
    return page

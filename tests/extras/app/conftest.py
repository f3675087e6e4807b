"""A server of the page on a port of its own, in this process, and a client that asks as the page does."""

import http.client
import json
import shutil
import signal
import socket
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import uvicorn

from uavcover.extras.app.command import Guard
from uavcover.extras.app.server import Server
from uavcover.extras.app.workspace import Workspace

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"
WATCHDOG_S = 300.0


@dataclass
class Client:
    """Asks the server.

    Attributes:
        port: of the server.
        token: of this start.
        root: the server's folder.
        server: what the routes share.
    """

    port: int
    token: str
    root: Path
    server: Server
    headers: dict[str, str] = field(default_factory=dict)

    @property
    def host(self) -> str:
        return f"127.0.0.1:{self.port}"

    @property
    def url(self) -> str:
        return f"http://{self.host}/?token={self.token}"

    def ask(self, method: str, path: str, body: Any = None, **headers: str | None) -> tuple[int, dict[str, str], bytes]:
        """Status, headers and body of an answer; headers given as None are left out."""
        given: dict[str, str | None] = {
            "Host": self.host, "Origin": f"http://{self.host}", "Cookie": f"uavcover-{self.port}={self.token}",
            **{name.replace("_", "-"): value for name, value in headers.items()},
        }  # fmt: skip
        raw = body if isinstance(body, bytes) or body is None else json.dumps(body).encode()
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=WATCHDOG_S)
        try:
            connection.request(method, path, raw, {name: value for name, value in given.items() if value is not None})
            answer = connection.getresponse()
            return answer.status, {name.lower(): value for name, value in answer.getheaders()}, answer.read()
        finally:
            connection.close()

    def get(self, path: str) -> Any:
        status, _, raw = self.ask("GET", path)
        assert status == 200, raw
        return json.loads(raw)

    def post(self, path: str, body: Any) -> Any:
        status, _, raw = self.ask("POST", path, body)
        assert status == 200, raw
        return json.loads(raw)

    def error(self, method: str, path: str, body: Any = None) -> str:
        status, _, raw = self.ask(method, path, body)
        assert 400 <= status < 500, (status, raw)
        return str(json.loads(raw)["error"])


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Client]:
    """A server in an own folder with the examples of the documentation."""
    root = tmp_path / "served"
    shutil.copytree(EXAMPLES, root)
    yield from serving(root)


def serving(root: Path) -> Iterator[Client]:
    """A server of a folder for as long as it is needed."""
    listening = socket.create_server(("127.0.0.1", 0))
    port, token = listening.getsockname()[1], "a-token-of-the-tests"
    server = Server(Workspace(root))
    guard = Guard(server.app(), token=token, hosts=frozenset({f"127.0.0.1:{port}"}), port=port)
    running = uvicorn.Server(
        uvicorn.Config(guard, log_level="warning", ws="websockets-sansio", lifespan="off", ws_max_size=1 << 16)
    )
    thread = threading.Thread(target=running.run, kwargs={"sockets": [listening]}, daemon=True)
    thread.start()
    # The socket listens already: a request waits there until the server takes it.
    yield Client(port, token, root, server)
    running.should_exit = True
    thread.join(WATCHDOG_S)
    listening.close()
    for job in server.jobs.all():
        if job.code is None:
            job.signal(signal.SIGKILL)


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """Debian's Chromium with the software renderer."""
    playwright = pytest.importorskip("playwright.sync_api")
    from tests.extras.app.browser import CHROMIUM, SOFTWARE

    if CHROMIUM is None:
        pytest.skip("no Chromium; Debian has it as the package chromium")
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
        yield browser
        browser.close()


@pytest.fixture
def browser(chromium: Any) -> Iterator[Any]:
    """The browser; a page of an earlier test draws no more."""
    yield chromium
    for context in chromium.contexts:
        context.close()

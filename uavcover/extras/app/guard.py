"""Refusal of every request that has not the token of this start, or comes from another origin.

Every answer forbids other origins to read, frame or script it.
"""

import base64
import hashlib
import hmac
import re
from collections.abc import Awaitable, Callable, MutableMapping
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

_IMPORT_MAP = re.compile(r'<script type="importmap">(.*?)</script>', re.DOTALL)


def _hash_of_import_map() -> str:
    """The page's one inline script, an import map, by its hash: a browser runs no other."""
    page = (Path(__file__).parent / "page" / "index.html").read_text(encoding="utf-8")
    found = _IMPORT_MAP.search(page)
    return "" if found is None else base64.b64encode(hashlib.sha256(found[1].encode()).digest()).decode()


POLICY = (
    f"default-src 'none'; script-src 'self' 'sha256-{_hash_of_import_map()}'; worker-src 'self' blob:; "
    "style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; connect-src 'self' data: blob:; font-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
"""MapLibre sets styles of its own elements, and makes images of data and blobs; scripts come from this server alone."""
_HEADERS = (
    (b"content-security-policy", POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"permissions-policy", b"camera=(), microphone=()"),
)


class Guard:
    """Lets requests through that have the token and come from the page's own origin.

    Args:
        app: what is guarded.
        token: of this start.
        hosts: values of the Host header that are this server's own; others are a name that was pointed at it.
        port: part of the cookie's name: servers of one machine share their cookies.
    """

    def __init__(self, app: App, *, token: str, hosts: frozenset[str], port: int) -> None:
        self._app, self._token, self._hosts = app, token, hosts
        self.cookie = f"uavcover-{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """An ASGI call."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope.get("headers", [])}
        asked = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[-1]
        by_query = (
            self._is_token(asked) and scope["type"] == "http" and scope["method"] == "GET" and scope["path"] == "/"
        )
        why = self._refusal(scope, headers, by_query=by_query)
        if why is not None:
            await _refuse(scope, receive, send, why)
            return

        async def guarded(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", []), *_HEADERS]
                if by_query:
                    cookie = f"{self.cookie}={self._token}; Path=/; HttpOnly; SameSite=Strict"
                    message["headers"].append((b"set-cookie", cookie.encode()))
            await send(message)

        await self._app(scope, receive, guarded)

    def _refusal(self, scope: Scope, headers: dict[str, str], *, by_query: bool) -> str | None:
        host = headers.get("host", "")
        if host not in self._hosts:
            return "this host name does not belong to the server"
        origin = headers.get("origin")
        changes = scope["type"] == "websocket" or scope["method"] not in ("GET", "HEAD")
        if origin is not None and origin not in (f"http://{host}", f"https://{host}"):
            return "the request has a different origin"
        if changes and origin is None:
            return "the Origin header is missing"
        if headers.get("sec-fetch-site", "same-origin") not in ("same-origin", "none"):
            return "the request comes from a different site"
        if not by_query and not self._is_token(self._of_cookie(headers.get("cookie", ""))):
            return "the token is missing or wrong; open the address that uavcover serve printed"
        return None

    def _of_cookie(self, text: str) -> str:
        for part in text.split(";"):
            name, _, value = part.strip().partition("=")
            if name == self.cookie:
                return value
        return ""

    def _is_token(self, text: str) -> bool:
        return hmac.compare_digest(text.encode("latin-1", "replace"), self._token.encode())


async def _refuse(scope: Scope, receive: Receive, send: Send, why: str) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008, "reason": why})
        return
    body = f"403: {why}\n".encode()
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"content-length", str(len(body)).encode()), *_HEADERS]
    await send({"type": "http.response.start", "status": 403, "headers": headers})
    await send({"type": "http.response.body", "body": body})

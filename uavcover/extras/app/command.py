"""``uavcover serve``: the page in a browser, on this machine."""

import base64
import contextlib
import hashlib
import hmac
import json
import re
import secrets
import socket
import sys
import time
import webbrowser
from collections.abc import Awaitable, Callable, MutableMapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any
from urllib.parse import parse_qs

import typer

from uavcover.cli import options
from uavcover.cli.options import option

if TYPE_CHECKING:
    from uavcover.cli.console import Console
    from uavcover.extras.app.workspace import Workspace

# ``uavcover edit``: a plan with the user's own waypoints, checked and written as any other.


def edit(
    run: Annotated[Path, typer.Argument(help="Run folder with the original route, which stays unchanged.")],
    waypoints: Annotated[
        Path,
        typer.Argument(
            help="JSON file with a list of [longitude, latitude, height above ground in m], in flying order."
        ),
    ],
    out: Annotated[Path, option("-o", "--out", "Folder for the results (the run folder).", "RUN")],
    *,
    autopilot: options.Autopilot = None,
    force: options.ForcePlan = False,
    output: options.Output,
) -> int:
    """Check a plan with your own waypoints, and write it with its mission files.

    The command checks every leg, the transit and the return. The new plan states that it was edited.
    """
    from uavcover.errors import InfeasibleError, InputError
    from uavcover.extras.app.scene import Scene
    from uavcover.missions.flights import compile_flights, one_or_several
    from uavcover.missions.objectives import judge_route
    from uavcover.model.route import Plan, Route
    from uavcover.model.vehicle import autopilot_name
    from uavcover.planner.plan_files import save_plan
    from uavcover.run.documents import read_planned
    from uavcover.run.folder import OF_A_PLAN, PLAN_FILES, RunFolder
    from uavcover.run.user import to_paste
    from uavcover.scenario.vehicles import groups_of

    console = output.console()
    began_s = time.monotonic()
    site, planned = read_planned(RunFolder(run))
    if groups_of(site.scenario):
        raise InputError(f"{run}: cannot edit a plan that divides the area among vehicles; plan with one vehicle")
    try:
        given: Any = json.loads(waypoints.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(
            f"{waypoints}: cannot read the file as JSON ({error}); write a list of waypoints, each as "
            "[longitude, latitude, height above ground in m]"
        ) from error
    route = Route(Scene(site, run).enu(given))
    member = judge_route(site, route, "edited", margin_m=0.0)
    if member.violation > 0.0:
        from uavcover.planner.front import why_infeasible

        raise InfeasibleError(why_infeasible(site, [member]))
    name = autopilot_name(autopilot, site.scenario.vehicle.autopilot)
    flights = compile_flights(site, route, autopilot=name) if site.frame is not None and site.home_m is not None else ()
    plan = Plan(
        chosen=member, members=(member,), baselines=(), rule="edited", rule_met=True, algorithm="edited", evaluations=0,
        wall_s=time.monotonic() - began_s,
    )  # fmt: skip
    folder = RunFolder(out)
    compiled, sorties = one_or_several(site, flights)
    with folder.reserved((*PLAN_FILES, *OF_A_PLAN), force=force):
        save_plan(
            folder, site, plan, compiled=compiled, autopilot=name, seed=site.scenario.planner.seed, command=sys.argv,
            sorties=sorties,
        )  # fmt: skip
    metrics = member.metrics
    console.say(
        f"edited: {100.0 * metrics.coverage_of_coverable:.2f} % of the visible ground, {metrics.waypoint_count} "
        f"waypoints, {metrics.path_length_m:.0f} m; the previous plan has {len(planned.route)} waypoints"
    )
    console.suggest(to_paste("plan-upload", out, "--to", "udp:127.0.0.1:14550"))
    console.result(
        {
            "run": str(out), "coverage_of_coverable": metrics.coverage_of_coverable, "waypoint_count": metrics.waypoint_count,
            "path_length_m": metrics.path_length_m, "sorties": len(sorties), "mission_files": bool(flights),
        }
    )  # fmt: skip
    return 0


# Refusal of every request that has not the token of this start, or comes from another origin.
#
# Every answer forbids other origins to read, frame or script it.

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
    f"default-src 'none'; script-src 'self' 'sha256-{_hash_of_import_map()}'; worker-src 'self' blob:; style-src "
    "'self' 'unsafe-inline'; img-src 'self' data: blob:; connect-src 'self' data: blob:; font-src 'self'; base-uri "
    "'none'; form-action 'none'; frame-ancestors 'none'"
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
        app: the guarded application.
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
        requested = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[-1]
        by_query = (
            self._is_token(requested) and scope["type"] == "http" and scope["method"] == "GET" and scope["path"] == "/"
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
            return "the host name in the request does not belong to this server"
        origin = headers.get("origin")
        changes = scope["type"] == "websocket" or scope["method"] not in ("GET", "HEAD")
        if origin is not None and origin not in (f"http://{host}", f"https://{host}"):
            return "the request comes from a different origin"
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


_LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})


def serve(
    target: Annotated[
        Path | None,
        typer.Argument(
            help="Run folder, scenario or area to open, or a folder to work in; default: the current folder."
        ),
    ] = None,
    *,
    port: Annotated[int, option("Port to listen on. 0 selects a free port.", min=0, max=65535)] = 8800,
    host: Annotated[
        str,
        option(
            "Address to listen on. With an address other than 127.0.0.1, other computers that have the token can connect."
        ),
    ] = "127.0.0.1",
    browser: Annotated[bool, option("Open the page in the default browser.")] = True,
    allow_flight: Annotated[
        bool, option("--allow-flight", "Allow the page to arm real vehicles after a typed confirmation.")
    ] = False,
    output: options.Output,
) -> int:
    """Plan, fly and judge missions on a map in your browser, offline.

    The page works on the files of a folder and runs the commands of uavcover. Plans and flights are separate processes,
    so they continue when the server stops.
    """
    from uavcover.errors import InputError
    from uavcover.extras.app.workspace import Workspace

    console = output.console()
    target = Path() if target is None else target
    if not target.exists():
        raise InputError(f"{target}: no such file or folder")
    is_workspace = target.is_dir() and not (target / "plan.json").is_file()
    folder = target if is_workspace else target.resolve().parent
    workspace = Workspace(folder)
    first = "" if is_workspace else workspace.name(target)
    _serve(workspace, first, console, host=host, port=port, browser=browser, flights_allowed=allow_flight)
    return 0


def _serve(
    workspace: "Workspace",
    first: str,
    console: "Console",
    *,
    host: str,
    port: int,
    browser: bool,
    flights_allowed: bool,
) -> None:
    from uavcover.errors import InputError

    try:
        import uvicorn

        from uavcover.extras.app.server import Server
    except ModuleNotFoundError as error:
        raise InputError(f"serve: {error.name} is required; install it with: pip install 'uavcover[app]'") from error
    try:
        listening = socket.create_server((host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET)
    except OSError as error:
        raise InputError(
            f"--port {port}: {error.strerror or error}; use another port, or 0 for any free port"
        ) from error
    with listening:
        port = listening.getsockname()[1]
        shown = f"[{host}]" if ":" in host else host
        token = secrets.token_urlsafe(24)
        names = {shown, "127.0.0.1", "localhost"} if host in _LOOPBACK or host in ("0.0.0.0", "::") else {shown}
        server = Server(workspace, flights_allowed=flights_allowed, first=first)
        guard = Guard(server.app(), token=token, hosts=frozenset(f"{name}:{port}" for name in names), port=port)
        address = f"http://{'127.0.0.1' if host in ('0.0.0.0', '::') else shown}:{port}/?token={token}"
        console.say(f"{workspace.root}: {address}")
        if host not in _LOOPBACK:
            console.warn(
                f"--host {host}: other computers can reach the page without encryption; only the token protects it"
            )
        if flights_allowed:
            console.warn("--allow-flight: the page can arm real vehicles")
        console.say("Ctrl-C stops the server; plans and flights that it started continue")
        console.result({"url": address, "port": port, "folder": str(workspace.root)})
        if browser:
            webbrowser.open(address)
        config = uvicorn.Config(
            guard, log_level="warning", ws="websockets-sansio", ws_max_size=1 << 16, ws_max_queue=8, server_header=False,
            timeout_graceful_shutdown=1, lifespan="off",
        )  # fmt: skip
        with contextlib.suppress(KeyboardInterrupt):
            uvicorn.Server(config).run(sockets=[listening])
        console.say("the server has stopped")

"""The server of the page: its routes, and the events for a browser during a command or a flight."""

import asyncio
import contextlib
import json
import logging
import signal
import threading
import time
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import Any

from anyio import to_thread
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route as HttpRoute
from starlette.routing import WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from uavcover.errors import InputError, UavcoverError
from uavcover.extras.app import survey, tiles
from uavcover.extras.app.commands import command_of, photo_document, refusal, take_file, text_in
from uavcover.extras.app.jobs import Jobs
from uavcover.extras.app.live import LiveFlight, Observed
from uavcover.extras.app.scene import Scene, Scenes, route_check, route_coverage, scene_document
from uavcover.extras.app.workspace import Workspace, free_name, position_of
from uavcover.terrain.terrain_source import TerrainSource

_log = logging.getLogger(__name__)
PAGE, VENDOR = Path(__file__).parent / "page", Path(__file__).parent / "vendor"
MOST_JSON_BYTES = 4 << 20
_LIVE_S, _SLOW_S = 0.1, 1.0
"""Samples are sent ten times a second, jobs and coverage once."""
_MOST_MESSAGES, _MOST_MESSAGE_BYTES = 20, 4096
"""A browser's messages in a second, and their size; the connection of one that sends more is closed."""
_MOST_SAMPLES_SENT = 2000


class Server:
    """State that the routes share.

    Args:
        workspace: the folder.
        flights_allowed: whether vehicles that are not simulated may be flown.
        first: scenario, area or run that the page opens with, relative to the folder; empty for none.
    """

    def __init__(self, workspace: Workspace, *, flights_allowed: bool = False, first: str = "") -> None:
        self.workspace, self.flights_allowed, self.first = workspace, flights_allowed, first
        self.jobs, self.scenes = Jobs(workspace.root), Scenes()
        workspace.busy = lambda: {job.run for job in self.jobs.all() if job.code is None}
        self._starting = threading.RLock()  # of two pages at once, each gets a name of its own
        self._live: dict[str, LiveFlight] = {}
        self._observed: dict[Path, Observed] = {}

    def app(self) -> Starlette:
        """The ASGI application, without its guard."""
        routes = [
            HttpRoute("/", self._index),
            HttpRoute("/api/state", _json(self._state)),
            HttpRoute("/api/scene", _json(self._scene)),
            HttpRoute("/api/contours", _json(self._contours)),
            HttpRoute("/api/area", _json(self._area)),
            HttpRoute("/api/heights", _json(self._heights_of)),
            HttpRoute("/api/photos", _json(self._photos)),
            HttpRoute("/api/place", _json(_position)),
            HttpRoute("/api/design", _json(partial(survey.designed, self.workspace)), methods=["POST"]),
            HttpRoute("/api/scenarios", _json(partial(survey.written, self.workspace)), methods=["POST"]),
            HttpRoute("/api/route/check", _json(partial(self._edited, route_check)), methods=["POST"]),
            HttpRoute("/api/route/coverage", _json(partial(self._edited, route_coverage)), methods=["POST"]),
            HttpRoute("/api/route/save", _json(self._save_route), methods=["POST"]),
            HttpRoute("/api/jobs", _json(self._start), methods=["POST"]),
            HttpRoute("/api/jobs/{id}", _json(self._job)),
            HttpRoute("/api/jobs/{id}/{action}", _json(self._signal), methods=["POST"]),
            HttpRoute("/api/files/{name:path}", self._upload, methods=["PUT"]),
            HttpRoute("/files/{name:path}", self._file),
            HttpRoute("/tiles/heights/{z:int}/{x:int}/{y:int}.png", self._heights),
            HttpRoute("/tiles/background/{z:int}/{x:int}/{y:int}", self._background),
            WebSocketRoute("/ws", self._socket),
        ]
        app = Starlette(routes=routes, exception_handlers={UavcoverError: _refused, OSError: _failed})
        app.mount("/page", StaticFiles(directory=PAGE))
        app.mount("/vendor", StaticFiles(directory=VENDOR))
        return app

    async def _index(self, request: Request) -> Response:
        del request
        return FileResponse(
            PAGE / "index.html", media_type="text/html; charset=utf-8", headers={"cache-control": "no-store"}
        )

    def _state(self, requested: dict[str, Any]) -> dict[str, Any]:
        del requested
        jobs = [job.document(with_events=False) for job in self.jobs.all()[:20]]
        return {
            "folder": self.workspace.root.name, "first": self.first, "flightsAllowed": self.flights_allowed,
            "files": self.workspace.listing(), "jobs": jobs, **survey.choices(),
        }  # fmt: skip

    def _scene_of(self, requested: dict[str, Any], key: str = "name") -> Scene:
        return self.scenes.of(self.workspace.path(text_in(requested, key)))

    def _scene(self, requested: dict[str, Any]) -> dict[str, Any]:
        return scene_document(self._scene_of(requested))

    def _contours(self, requested: dict[str, Any]) -> dict[str, Any]:
        return {"lines": tiles.contours(self._scene_of(requested))}

    def _area(self, requested: dict[str, Any]) -> dict[str, Any]:
        return survey.area_document(self.workspace, text_in(requested, "name"))

    def _edited(self, look: Callable[[Scene, Any], dict[str, Any]], requested: dict[str, Any]) -> dict[str, Any]:
        return look(self._scene_of(requested, "run"), requested.get("waypoints") or [])

    def _save_route(self, requested: dict[str, Any]) -> dict[str, Any]:
        """Keep the waypoints in a file, and let ``uavcover edit`` check and write the plan."""
        run = self.workspace.path(text_in(requested, "run"))
        self.scenes.of(run).enu(requested.get("waypoints") or [])
        with self._starting:
            path = free_name(self.workspace.root, f"{run.name}-waypoints", ".json")
            path.write_text(json.dumps(requested["waypoints"]), encoding="utf-8")
            return self._start(
                {"kind": "edit", "run": self.workspace.name(run), "waypoints": self.workspace.name(path)}
            )

    def _start(self, requested: dict[str, Any]) -> dict[str, Any]:
        kind = str(requested.get("kind") or "")
        with self._starting:
            run, words = command_of(kind, requested, self.workspace, flights_allowed=self.flights_allowed)
            return self.jobs.start(kind, words, run=run).document()

    def _job(self, requested: dict[str, Any]) -> dict[str, Any]:
        return self.jobs.get(text_in(requested, "id")).document()

    def _signal(self, requested: dict[str, Any]) -> dict[str, Any]:
        """Stop: as Ctrl-C; leave: as Ctrl-C twice; pause: the flight waits, or goes on."""
        signals = {"stop": [signal.SIGINT], "leave": [signal.SIGINT] * 2, "pause": [signal.SIGUSR1]}
        action = text_in(requested, "action")
        if action not in signals:
            raise InputError(f"the action must be stop, leave or pause, not {action}")
        job, sent = self.jobs.get(text_in(requested, "id")), False
        for number, one in enumerate(signals[action]):
            time.sleep(0.5 if number else 0.0)  # two signals at once are one
            sent = job.signal(one) or sent
        return {"sent": sent}

    async def _upload(self, request: Request) -> Response:
        return await take_file(request, self.workspace)

    def _photos(self, requested: dict[str, Any]) -> dict[str, Any]:
        return photo_document(self.workspace.path(text_in(requested, "name")))

    async def _file(self, request: Request) -> Response:
        path = self.workspace.path(request.path_params["name"])
        if not path.is_file():
            return refusal(404, f"{path.name}: no such file")
        # Never shown as a page of this origin: a report or a foreign file could script it.
        return FileResponse(path, media_type="application/octet-stream", filename=path.name)

    async def _heights(self, request: Request) -> Response:
        z, x, y = (request.path_params[name] for name in "zxy")

        def make() -> bytes:
            return tiles.height_tile(self._elevation(dict(request.query_params)), z, x, y)

        return Response(
            await to_thread.run_sync(make), media_type="image/png", headers={"cache-control": "private, max-age=600"}
        )

    def _elevation(self, requested: dict[str, Any]) -> TerrainSource | Scene:
        """The elevation file of a query, or the scene where its ground is made from a formula."""
        if name := requested.get("dem"):
            return TerrainSource((self.workspace.path(name),))
        scene = self._scene_of(requested)
        return scene.terrain or scene

    def _heights_of(self, requested: dict[str, Any]) -> dict[str, Any]:
        return {"finestZoom": tiles.finest_zoom(self._elevation(requested))}

    async def _background(self, request: Request) -> Response:
        z, x, y = (request.path_params[name] for name in "zxy")
        path = self.workspace.path(request.query_params.get("file", ""))
        found = await to_thread.run_sync(tiles.background_tile, path, z, x, y)
        return Response(status_code=204) if found is None else Response(found[0], media_type=found[1])

    async def _socket(self, socket: WebSocket) -> None:
        await socket.accept()
        watcher = _Watcher(self, socket)
        tasks = [asyncio.create_task(watcher.send()), asyncio.create_task(watcher.receive())]
        # Where one ends, so does the connection, and the page connects anew: it never waits for news that cannot come.
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in tasks:
            task.cancel()
        for error in await asyncio.gather(*tasks, return_exceptions=True):
            if isinstance(error, Exception) and not isinstance(error, WebSocketDisconnect | RuntimeError):
                _log.warning("a connection from the page ended: %s", error)
        with contextlib.suppress(RuntimeError, WebSocketDisconnect):
            await socket.close(1011)

    def live(self, run: str) -> LiveFlight:
        """The track of a run folder, or of a sortie in one, shared by all that watch it.

        Raises:
            UavcoverError: it is no run folder.
        """
        if run not in self._live:
            path = self.workspace.path(run)
            plan = path.parent if (path.parent / "plan.json").is_file() and path.parent != self.workspace.root else path
            if plan not in self._observed:
                self._observed[plan] = Observed(self.scenes.of(plan))
            self._live[run] = LiveFlight(self._observed[plan], path)
        return self._live[run]


class _Watcher:
    """One browser: the job or flight that it watches, and its progress. A slow one gets larger pieces, not more."""

    def __init__(self, server: Server, socket: WebSocket) -> None:
        self._server, self._socket = server, socket
        self._runs: dict[str, int] = {}
        self._versions: dict[Observed, int] = {}
        self._lines: dict[str, tuple[str, str]] = {}
        self._events: dict[str, int] = {}
        self._codes: dict[str, int | None] = {}

    async def receive(self) -> None:
        """Take messages: ``{"watch": RUN, "from": N}``, ``{"leave": RUN}``, ``{"job": ID, "from": BYTE}``."""
        begin_s, count = time.monotonic(), 0
        while True:
            text = await self._socket.receive_text()
            if time.monotonic() - begin_s > 1.0:
                begin_s, count = time.monotonic(), 0
            count += 1
            if count > _MOST_MESSAGES or len(text) > _MOST_MESSAGE_BYTES:
                await self._socket.close(1008, "the page sent too many messages, or messages that are too long")
                return
            try:
                requested = json.loads(text)
                begin = max(0, int(requested.get("from", 0)))
                if "watch" in requested:
                    await to_thread.run_sync(self._server.live, str(requested["watch"]))
                    self._runs[str(requested["watch"])] = begin
                    self._versions.pop(self._server.live(str(requested["watch"])).observed, None)
                    self._lines.pop(str(requested["watch"]), None)
                elif "leave" in requested:
                    self._runs.pop(str(requested["leave"]), None)
                elif "job" in requested:
                    self._events[self._server.jobs.get(str(requested["job"])).id] = begin
            except UavcoverError as error:
                await self._socket.send_json({"error": str(error)})
            except (ValueError, TypeError, AttributeError, RecursionError):
                await self._socket.send_json({"error": "unknown message"})

    async def send(self) -> None:
        """Send what is new, for as long as the connection lasts."""
        slow_s = 0.0
        while True:
            await asyncio.sleep(_LIVE_S)
            slow = time.monotonic() - slow_s >= _SLOW_S
            if slow:
                slow_s = time.monotonic()
                await self._jobs()
            for run in list(self._runs):
                live = self._server.live(run)
                live.poll()
                begin = self._runs.get(run, 0)
                new = live.samples[begin : begin + _MOST_SAMPLES_SENT]
                if begin > len(live.samples):  # the track was replaced
                    begin, new = 0, live.samples[:_MOST_SAMPLES_SENT]
                if new:
                    self._runs[run] = begin + len(new)
                    await self._socket.send_json({"run": run, "from": begin, "samples": new})
                if self._lines.get(run, ("", "")) != (live.line, live.warning):
                    self._lines[run] = live.line, live.warning
                    await self._socket.send_json({"run": run, "line": live.line, "warning": live.warning})
                if slow:
                    await to_thread.run_sync(live.look)
                    await self._cells(live.observed)

    async def _cells(self, observed: Observed) -> None:
        known = self._versions.get(observed, 0)
        if observed.version != known:
            coverage = await to_thread.run_sync(observed.since, known)
            self._versions[observed] = coverage["version"]
            name = self._server.workspace.name(observed.scene.path)
            await self._socket.send_json({"run": name, "coverage": coverage})

    async def _jobs(self) -> None:
        for job in self._server.jobs.all()[:20]:
            if job.id in self._events:
                events, end = job.events(self._events[job.id])
                if events:
                    self._events[job.id] = end
                    await self._socket.send_json({"job": job.id, "events": events, "end": end})
            code = job.code
            if self._codes.get(job.id, "new") != code:
                self._codes[job.id] = code
                await self._socket.send_json({"job": job.id, "state": job.document(with_events=False)})


def _json(handler: Callable[[dict[str, Any]], dict[str, Any]]) -> Callable[[Request], Awaitable[Response]]:
    """A route that answers with JSON; ``handler`` gets the query, the path and the body in one, and runs in a thread."""

    async def route(request: Request) -> Response:
        requested: dict[str, Any] = dict(request.query_params)
        if request.method == "POST":
            raw = bytearray()
            async for chunk in request.stream():
                raw += chunk
                if len(raw) > MOST_JSON_BYTES:
                    return refusal(413, "the request is too large")
            try:
                body = json.loads(bytes(raw) or b"{}")
            except (ValueError, RecursionError):
                body = None
            if not isinstance(body, dict):
                return refusal(400, "the request is not a JSON object")
            requested |= body
        requested |= request.path_params
        return JSONResponse(await to_thread.run_sync(handler, requested))

    return route


def _position(requested: dict[str, Any]) -> dict[str, Any]:
    lat, lon = position_of(text_in(requested, "text"))
    return {"place": [lon, lat]}


async def _failed(request: Request, error: Exception) -> Response:
    """A file went away, or cannot be written."""
    del request
    assert isinstance(error, OSError)
    where = Path(str(error.filename or "a file")).name
    return refusal(507, f"{where}: {error.strerror or error}; free some disk space, or open another scenario or run")


async def _refused(request: Request, error: Exception) -> Response:
    del request
    return refusal(400, str(error), field=survey.field_of(str(error)))

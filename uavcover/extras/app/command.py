"""``uavcover serve``: the page in a browser, on this machine."""

import contextlib
import secrets
import socket
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from uavcover.cli import options

if TYPE_CHECKING:
    from uavcover.cli.console import Console

_LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})


def serve(
    target: Annotated[
        Path | None,
        typer.Argument(
            help=("Run folder, scenario or area to open, or a folder to work in; default: the current folder.")
        ),
    ] = None,
    *,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port to listen on. 0 selects a free port.")] = 8800,
    host: Annotated[
        str,
        typer.Option(
            help=("Address to listen on. An address other than 127.0.0.1 admits other computers that have the token.")
        ),
    ] = "127.0.0.1",
    browser: Annotated[bool, typer.Option(help="Open the page in the default browser.")] = True,
    allow_flight: Annotated[
        bool,
        typer.Option("--allow-flight", help="Allow the page to arm real vehicles, after a typed confirmation."),
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
    workspace: object, first: str, console: "Console", *, host: str, port: int, browser: bool, flights_allowed: bool
) -> None:
    from uavcover.errors import InputError

    try:
        import uvicorn

        from uavcover.extras.app.guard import Guard
        from uavcover.extras.app.server import Server
    except ModuleNotFoundError as error:
        raise InputError(f"serve: this needs {error.name}; install it with: pip install 'uavcover[app]'") from error
    from uavcover.extras.app.workspace import Workspace

    assert isinstance(workspace, Workspace)
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
        console.say("Ctrl-C ends the server; plans and flights that it started continue")
        console.result({"url": address, "port": port, "folder": str(workspace.root)})
        if browser:
            webbrowser.open(address)
        config = uvicorn.Config(
            guard, log_level="warning", ws="websockets-sansio", ws_max_size=1 << 16, ws_max_queue=8, server_header=False,
            timeout_graceful_shutdown=1, lifespan="off",
        )  # fmt: skip
        with contextlib.suppress(KeyboardInterrupt):
            uvicorn.Server(config).run(sockets=[listening])
        console.say("the server has ended")

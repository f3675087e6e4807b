"""``uavcover``: the commands in groups."""

import os
from collections.abc import Callable

import typer

from uavcover.cli.demo import demo
from uavcover.cli.doctor import doctor
from uavcover.cli.download import download
from uavcover.cli.ending import ending_well, show_traces
from uavcover.cli.export import export
from uavcover.cli.fly import fly
from uavcover.cli.inspect import inspect
from uavcover.cli.mock_vehicle import mock_vehicle
from uavcover.cli.plan import plan
from uavcover.cli.plan_upload import plan_upload
from uavcover.cli.upload import upload
from uavcover.cli.verify import verify

app = typer.Typer(
    name="uavcover",
    help="Plan flights that see all of a rugged terrain, fly them over MAVLink, and prove from the track what was seen.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

_GROUPS: dict[str, dict[str, Callable[..., int]]] = {
    "Start here": {"demo": demo, "doctor": doctor},
    "Plan": {"plan": plan, "export": export},
    "Vehicle": {
        "plan-upload": plan_upload,
        "upload": upload,
        "download": download,
        "fly": fly,
        "mock-vehicle": mock_vehicle,
    },
    "After the flight": {"verify": verify, "inspect": inspect},
}

for _title, _commands in _GROUPS.items():
    for _name, _command in _commands.items():
        app.command(_name, rich_help_panel=_title)(ending_well(_command))


@app.callback()
def _root(debug: bool = typer.Option(False, "--debug", help="Show the trace of an error.")) -> None:
    show_traces(debug)


def run() -> None:
    """Entry point of the ``uavcover`` command."""
    # numpy's threads would fight the planner's own for the cores.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    app()

"""``uavcover``: the commands in groups."""

import os
import sys
from collections.abc import Callable
from importlib import metadata

import typer

from uavcover.cli.bench import bench
from uavcover.cli.clear import clear
from uavcover.cli.demo import demo
from uavcover.cli.doctor import doctor
from uavcover.cli.download import download
from uavcover.cli.ending import ending_well, run_app, show_traces
from uavcover.cli.export import export
from uavcover.cli.fly import fly
from uavcover.cli.gaps import gaps
from uavcover.cli.inspect import inspect
from uavcover.cli.mock_vehicle import mock_vehicle
from uavcover.cli.overview import Overview
from uavcover.cli.pareto import pareto
from uavcover.cli.plan import plan
from uavcover.cli.plan_upload import plan_upload
from uavcover.cli.report import report
from uavcover.cli.select import select
from uavcover.cli.upload import upload
from uavcover.cli.verify import verify

app = typer.Typer(
    name="uavcover",
    cls=Overview,
    help="Plan flights that see all of a rugged terrain, fly them, prove what was seen.",
    add_completion=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

_GROUPS: dict[str, dict[str, tuple[Callable[..., int], str]]] = {
    "Start": {
        "demo": (demo, "the whole chain on real terrain, with a mock vehicle"),
        "doctor": (doctor, "what is installed, what works, what is missing"),
    },
    "Plan": {
        "plan": (plan, "a route that sees the area, and its mission files"),
        "pareto": (pareto, "the trade-off of a plan, as a table or a picture"),
        "select": (select, "another route of that trade-off, and its mission files"),
        "export": (export, "the mission as one file for other software"),
    },
    "Vehicle": {
        "plan-upload": (plan_upload, "plan if needed, check, upload, read back, compare"),
        "upload": (upload, "send any .waypoints or .plan file, read it back"),
        "download": (download, "a vehicle's mission, fence or rally as a file"),
        "clear": (clear, "empty a vehicle's mission, fence or rally points"),
        "fly": (fly, "arm, start, follow, record, land"),
        "mock-vehicle": (mock_vehicle, "a MAVLink vehicle for any ground station"),
    },
    "After": {
        "verify": (verify, "coverage and safety of what was flown"),
        "gaps": (gaps, "what was not seen, and a mission that flies only that"),
        "report": (report, "one HTML file about a run, opens offline"),
        "inspect": (inspect, "look at the recording in 3D, as text or picture"),
    },
}

for _title, _commands in _GROUPS.items():
    for _name, (_command, _short) in _commands.items():
        app.command(_name, short_help=_short, rich_help_panel=_title)(ending_well(_command))

app.add_typer(bench, name="bench", short_help="the benchmarks of this project", rich_help_panel="Measure")


def _tell_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"uavcover {metadata.version('uavcover')}")
        raise typer.Exit


@app.callback()
def _root(
    debug: bool = typer.Option(False, "--debug", help="Show the trace of an error."),
    _: bool = typer.Option(
        False, "--version", help="Show the version.", callback=_tell_version, is_eager=True, expose_value=False
    ),
) -> None:
    show_traces(debug)


def run() -> None:
    """Entry point of the ``uavcover`` command."""
    # numpy's threads would fight the planner's own for the cores.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(run_app(app, sys.argv[1:] or ["--help"]))

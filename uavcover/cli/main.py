"""``uavcover``: the commands in groups."""

import os
import sys
from importlib import metadata

import typer

from uavcover.cli.ending import run_app
from uavcover.cli.on_demand import Entry, Groups, overview_of
from uavcover.plugins import loaded

_CORE: dict[str, dict[str, Entry]] = {
    "Start": {
        "demo": (
            "uavcover.cli.demo",
            "plan, fly and verify a mission with a mock vehicle",
            ("uavcover demo", "uavcover demo -o RUN --autopilot px4"),
        ),
        "doctor": (
            "uavcover.cli.doctor",
            "check the installation",
            ("uavcover doctor", "uavcover doctor --compile"),
        ),
    },
    "Plan": {
        "new": (
            "uavcover.cli.new",
            "create a scenario from an area and a camera",
            (
                "uavcover new area.kml --dem dem.tif --camera dji-m3e --gsd 2.5cm -o survey.toml",
                "uavcover new --camera list",
            ),
        ),
        "plan": (
            "uavcover.cli.plan",
            "plan a route and write its mission files",
            (
                "uavcover plan jacksboro -o RUN --budget 30s",
                "uavcover plan area.kml --dem dem.tif --camera dji-m3e --gsd 2.5cm -o RUN",
            ),
        ),
        "pareto": (
            "uavcover.cli.pareto",
            "list the routes of a plan; select chooses one",
            ("uavcover pareto RUN", "uavcover pareto RUN --plot tradeoff.png"),
        ),
        "select": (
            "uavcover.cli.select",
            "",
            ("uavcover select RUN knee", 'uavcover select RUN "coverage>=0.98"'),
        ),
    },
    "Vehicle": {
        "plan-upload": (
            "uavcover.cli.plan_upload",
            "check the mission, upload it and read it back",
            (
                "uavcover plan-upload RUN --to udp:127.0.0.1:14550",
                "uavcover plan-upload area.toml --to /dev/ttyACM0 --link telemetry-radio",
            ),
        ),
        "upload": (
            "uavcover.cli.upload",
            "upload a .waypoints or .plan file and read it back",
            (
                "uavcover upload mission.waypoints --to udp:127.0.0.1:14550",
                "uavcover upload fence.plan --type fence --to tcp:127.0.0.1:5760",
            ),
        ),
        "download": (
            "uavcover.cli.download",
            "download the mission, fence or rally points; clear",
            (
                "uavcover download --from udp:127.0.0.1:14550 -o mission.waypoints",
                "uavcover download --from tcp:127.0.0.1:5760 --type all -o all.plan",
            ),
        ),
        "clear": (
            "uavcover.cli.clear",
            "",
            ("uavcover clear --to udp:127.0.0.1:14550", "uavcover clear --to udp:127.0.0.1:14550 --type fence"),
        ),
        "fly": (
            "uavcover.cli.fly",
            "arm, fly the mission, record the flight and land",
            ("uavcover fly RUN --to mock:", "uavcover fly RUN --to udp:127.0.0.1:14550 --resume"),
        ),
        "mock-vehicle": (
            "uavcover.cli.mock_vehicle",
            "simulate a MAVLink vehicle for any ground station",
            (
                "uavcover mock-vehicle --listen udpin://127.0.0.1:14550",
                "uavcover mock-vehicle --listen tcpin://127.0.0.1:5760 --autopilot px4 --loss 0.2",
            ),
        ),
    },
    "After": {
        "verify": (
            "uavcover.cli.verify",
            "judge coverage and safety of a flight",
            (
                "uavcover verify RUN --log flight.bin",
                "uavcover verify flight.bin --photos DCIM/ --area area.kml --dem dem.tif",
            ),
        ),
        "gaps": (
            "uavcover.cli.gaps",
            "plan a mission for unobserved cells",
            ("uavcover gaps RUN", "uavcover gaps RUN --target 0.98 --min-area 50"),
        ),
        "report": (
            "uavcover.cli.report",
            "write an HTML report of a run",
            ("uavcover report RUN", "uavcover report RUN -o flight.html"),
        ),
        "inspect": (
            "uavcover.cli.inspect",
            "show the recording in 3D, as text or as an image",
            ("uavcover inspect RUN", "uavcover inspect RUN --screenshot flight.png"),
        ),
    },
}
"""By group and name: the module that has the command under its name, what the overview says of it, and examples."""


def _with_extras(core: Groups) -> Groups:
    """The commands of the core with those of every installed extra; a name of the core cannot be taken."""
    groups = {title: dict(entries) for title, entries in core.items()}
    own = {name for entries in core.values() for name in entries}
    for added in loaded("uavcover.commands").values():
        for title, entries in added.items():
            groups.setdefault(title, {}).update({name: entry for name, entry in entries.items() if name not in own})
    return groups


_GROUPS: Groups = _with_extras(_CORE)

app = typer.Typer(
    name="uavcover",
    cls=overview_of(_GROUPS),
    help="Plan flights that cover rugged terrain, fly them, and verify the coverage.",
    add_completion=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _tell_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"uavcover {metadata.version('uavcover')}")
        raise typer.Exit


@app.callback()
def _root(
    debug: bool = typer.Option(False, "--debug", help="Show the traceback of an error."),
    _: bool = typer.Option(
        False, "--version", help="Show the version.", callback=_tell_version, is_eager=True, expose_value=False
    ),
) -> None:
    """Every command reads ``--debug`` from its context; see :func:`ending_well`."""
    del debug


def run() -> None:
    """Entry point of the ``uavcover`` command."""
    # numpy's threads would fight the planner's own for the cores.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(run_app(app, sys.argv[1:] or ["--help"]))

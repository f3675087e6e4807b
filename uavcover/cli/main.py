"""``uavcover``: the commands in groups."""

import os
import sys
from collections.abc import Callable
from importlib import metadata

import typer

from uavcover.cli.bench import bench
from uavcover.cli.check import check
from uavcover.cli.clear import clear
from uavcover.cli.demo import demo
from uavcover.cli.doctor import doctor
from uavcover.cli.download import download
from uavcover.cli.ending import ending_well, run_app
from uavcover.cli.export import export
from uavcover.cli.fly import fly
from uavcover.cli.gaps import gaps
from uavcover.cli.get_file import get_file
from uavcover.cli.inspect import inspect
from uavcover.cli.mock_vehicle import mock_vehicle
from uavcover.cli.new import new
from uavcover.cli.options import Overview, one_by_one
from uavcover.cli.pareto import pareto
from uavcover.cli.plan import plan
from uavcover.cli.plan_upload import plan_upload
from uavcover.cli.report import report
from uavcover.cli.select import select
from uavcover.cli.send_file import send_file
from uavcover.cli.terrain import terrain
from uavcover.cli.terrain_server import terrain_server
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

_GROUPS: dict[str, dict[str, tuple[Callable[..., int], str, tuple[str, str]]]] = {
    "Start": {
        "demo": (
            demo,
            "the whole chain on real terrain, with a mock vehicle",
            ("uavcover demo", "uavcover demo -o RUN --autopilot px4"),
        ),
        "doctor": (
            doctor,
            "what is installed, what works, what is missing",
            ("uavcover doctor", "uavcover doctor --compile"),
        ),
    },
    "Plan": {
        "terrain": (
            terrain,
            "the elevation data that an area needs, and where it is",
            ("uavcover terrain area.kml", "uavcover terrain area.kml --dem tiles/ --dat TERRAIN"),
        ),
        "new": (
            new,
            "a scenario from your area, elevation data and camera",
            (
                "uavcover new area.kml --dem dem.tif --camera dji-m3e --gsd 2.5cm -o survey.toml",
                "uavcover new --camera list",
            ),
        ),
        "plan": (
            plan,
            "a route that sees the area, and its mission files",
            (
                "uavcover plan jacksboro -o RUN --budget 30s",
                "uavcover plan area.kml --dem dem.tif --camera dji-m3e --gsd 2.5cm -o RUN",
            ),
        ),
        "pareto": (
            pareto,
            "the trade-off of a plan; select takes another route",
            ("uavcover pareto RUN", "uavcover pareto RUN --plot tradeoff.png"),
        ),
        "select": (
            select,
            "",
            ("uavcover select RUN knee", 'uavcover select RUN "coverage>=0.98"'),
        ),
        "check": (
            check,
            "any mission, judged over the terrain before flight",
            (
                "uavcover check mission.plan --dem dem.tif --no-fly zones.json --return-height 60m",
                "uavcover check survey.waypoints --dem tiles/ --vehicle dji-m350-rtk --battery 30min --map found.geojson",
            ),
        ),
        "export": (
            export,
            "the mission for other software: DJI, Litchi, ROS, GPX",
            (
                "uavcover export RUN --format wpml --drone dji-m3e -o survey.kmz",
                "uavcover export RUN --format litchi -o survey.csv",
            ),
        ),
    },
    "Vehicle": {
        "plan-upload": (
            plan_upload,
            "plan if needed, check, upload, read back, compare",
            (
                "uavcover plan-upload RUN --to udp:127.0.0.1:14550",
                "uavcover plan-upload area.toml --to /dev/ttyACM0 --link telemetry-radio",
            ),
        ),
        "upload": (
            upload,
            "send any .waypoints or .plan file, read it back",
            (
                "uavcover upload mission.waypoints --to udp:127.0.0.1:14550",
                "uavcover upload fence.plan --type fence --to tcp:127.0.0.1:5760",
            ),
        ),
        "download": (
            download,
            "a vehicle's mission, fence or rally as a file",
            (
                "uavcover download --from udp:127.0.0.1:14550 -o mission.waypoints",
                "uavcover download --from tcp:127.0.0.1:5760 --type all -o all.plan",
            ),
        ),
        "clear": (
            clear,
            "empty a vehicle's mission, fence or rally points",
            ("uavcover clear --to udp:127.0.0.1:14550", "uavcover clear --to udp:127.0.0.1:14550 --type fence"),
        ),
        "fly": (
            fly,
            "arm, start, follow, record, land",
            ("uavcover fly RUN --to mock:", "uavcover fly RUN --to udp:127.0.0.1:14550 --resume"),
        ),
        "send-file": (
            send_file,
            "files onto the vehicle's card; get-file reads one",
            (
                "uavcover send-file TERRAIN/N36W085.DAT --to udp:127.0.0.1:14550",
                "uavcover send-file script.lua --folder /APM/scripts --to tcp:127.0.0.1:5760",
            ),
        ),
        "get-file": (
            get_file,
            "",
            (
                "uavcover get-file /APM/LOGS/ --to udp:127.0.0.1:14550",
                "uavcover get-file @MISSION/mission.dat --to tcp:127.0.0.1:5760 -o mission.dat",
            ),
        ),
        "terrain-server": (
            terrain_server,
            "answer a vehicle's requests for terrain heights",
            (
                "uavcover terrain-server --dem dem.tif --to udp:127.0.0.1:14550",
                "uavcover terrain-server --dem tiles/ --to tcp:127.0.0.1:5760",
            ),
        ),
        "mock-vehicle": (
            mock_vehicle,
            "a MAVLink vehicle for any ground station",
            (
                "uavcover mock-vehicle --listen udpin://127.0.0.1:14550",
                "uavcover mock-vehicle --listen tcpin://127.0.0.1:5760 --autopilot px4 --loss 0.2",
            ),
        ),
    },
    "After": {
        "verify": (
            verify,
            "coverage and safety of what was flown",
            ("uavcover verify RUN", "uavcover verify RUN --log flight.bin"),
        ),
        "gaps": (
            gaps,
            "what was not seen, and a mission that flies only that",
            ("uavcover gaps RUN", "uavcover gaps RUN --target 0.98 --min-area 50"),
        ),
        "report": (
            report,
            "one HTML file about a run, opens offline",
            ("uavcover report RUN", "uavcover report RUN -o flight.html"),
        ),
        "inspect": (
            inspect,
            "look at the recording in 3D, as text or picture",
            ("uavcover inspect RUN", "uavcover inspect RUN --screenshot flight.png"),
        ),
    },
}

for _title, _commands in _GROUPS.items():
    for _name, (_command, _short, _examples) in _commands.items():
        _epilog = "\b\nExamples:\n" + "\n".join(f"  {example}" for example in _examples)
        app.command(_name, short_help=_short, rich_help_panel=_title, epilog=_epilog)(ending_well(one_by_one(_command)))

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
    """Every command reads ``--debug`` from its context; see :func:`ending_well`."""
    del debug


def run() -> None:
    """Entry point of the ``uavcover`` command."""
    # numpy's threads would fight the planner's own for the cores.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(run_app(app, sys.argv[1:] or ["--help"]))

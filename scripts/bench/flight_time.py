"""Compare planned flight times with flown ones: 20 missions on the mock, ArduCopter and PX4, each with its autopilot's defaults.

Usage: .venv/bin/python scripts/bench/flight_time.py -o PAGE.md [--logs DIR] [--vehicles mock-ardupilot,px4]
                                                    [--missions square,zigzag-30]

ArduCopter and PX4 are flown where UAVCOVER_ARDUCOPTER and UAVCOVER_PX4 name their builds (docs/how-to/sitl.md). The table beside
the Markdown file, with the suffix ``.csv``, keeps what was flown: a mission that is in it, item by item the same, is not flown
again, and a run that was stopped goes on. Planned times are always computed anew.

Flown is vehicle time from the last moment lower than 0.5 m above home before the flight's top to the first one behind it. Made
routes are flown over flat ground, the others are plans of bundled scenarios. Speeds up and down are the autopilot's defaults.
"""

import argparse
import csv
import dataclasses
import datetime
import hashlib
import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType

import numpy as np
import shapely

from mission_io.client.client import Client
from mission_io.links.opening import open_link
from scripts.options import file_to_write, names_of
from sitl_tests.errors import MissingSimulatorError
from sitl_tests.simulators import ardupilot, px4
from sitl_tests.simulators.running import RunningVehicle, Start, StartRequest
from uavcover.flight.fly import fly
from uavcover.flight.monitor import Monitor
from uavcover.flight.orders import FlightPlan, FlightTimeouts, OnBreach, Orders, Precautions
from uavcover.kernels.arrays import FloatArray
from uavcover.missions.mission_compiler import AUTOPILOTS, CompiledMission, compile_mission
from uavcover.mock.behaviour import Settings
from uavcover.mock.server import BackgroundMock
from uavcover.mock.vehicle import MockConfig, MockVehicle
from uavcover.model.limits import FlightLimits
from uavcover.model.route import Route
from uavcover.model.track import TrackSample
from uavcover.model.vehicle import AutopilotName, Vehicle
from uavcover.scenario.site import Site, load_site
from uavcover.terrain.ground import grid_ground

AIRBORNE_M = 0.5
FIRST_HEARTBEAT_S = 60.0
EVALUATIONS = 400
HEIGHT_M = 40.0
NOTES = "\n## How it is counted"
"""What follows in the page is written by hand, and kept."""
LIMITS: Mapping[AutopilotName, dict[str, float]] = MappingProxyType(
    {
        # WPNAV_SPEED_UP, WPNAV_SPEED_DN, WPNAV_RADIUS
        "ardupilot": {"max_climb_m_s": 2.5, "max_descent_m_s": 1.5, "acceptance_radius_m": 2.0},
        # MPC_Z_V_AUTO_UP, MPC_Z_V_AUTO_DN, NAV_ACC_RAD of a multirotor
        "px4": {"max_climb_m_s": 3.0, "max_descent_m_s": 1.5, "acceptance_radius_m": 2.0},
    }
)


@dataclass(frozen=True, slots=True)
class Flier:
    """A vehicle to fly with.

    Attributes:
        autopilot: whose ways it has.
        start: starts it.
        speed: vehicle seconds per second.
        most: the largest difference allowed, as a share.
    """

    autopilot: AutopilotName
    start: Start
    speed: float
    most: float


def mock_starter(autopilot: AutopilotName) -> Start:
    """A mock vehicle with an autopilot's own limits."""

    @contextmanager
    def start(request: StartRequest) -> Iterator[RunningVehicle]:
        own = Vehicle(autopilot=autopilot, **LIMITS[autopilot])
        config = MockConfig(settings=Settings.for_vehicle(own), speed=request.speed)
        with BackgroundMock(
            MockVehicle(AUTOPILOTS[autopilot], request.home, config), speed=request.speed
        ) as background:
            url = f"udpout://127.0.0.1:{background.port}"
            yield RunningVehicle(
                url=url, second_url=url, home=request.home, version=f"mock {autopilot}", log_files=lambda: ()
            )

    return start


FLIERS: Mapping[str, Flier] = MappingProxyType(
    {
        "mock-ardupilot": Flier("ardupilot", mock_starter("ardupilot"), 100.0, 0.03),
        "mock-px4": Flier("px4", mock_starter("px4"), 100.0, 0.03),
        "arducopter": Flier("ardupilot", ardupilot.starter(ardupilot.COPTER), 15.0, 0.05),
        "px4": Flier("px4", px4.start, 8.0, 0.05),
    }
)


@dataclass(frozen=True, slots=True)
class Made:
    """A route over flat ground: (n, 3) east, north, up from home, and the cruise speed."""

    route_m: FloatArray
    cruise_m_s: float = 10.0


def lines(
    count: int, length_m: float, spacing_m: float, *, step_m: float | None = None, cruise_m_s: float = 10.0
) -> Made:
    """Lines to and fro; with a waypoint every ``step_m`` where that is given."""
    parts = []
    for n in range(count):
        norths = np.linspace(20.0, 20.0 + length_m, 2 if step_m is None else 1 + round(length_m / step_m))
        parts.append(np.column_stack([np.full_like(norths, spacing_m * n), norths[:: -1 if n % 2 else 1]]))
    return level(np.vstack(parts), cruise_m_s=cruise_m_s)


def level(east_north_m: FloatArray, *, cruise_m_s: float = 10.0) -> Made:
    """All at one height."""
    return Made(np.column_stack([east_north_m, np.full(len(east_north_m), HEIGHT_M)]), cruise_m_s)


def zigzag(count: int, leg_m: float, turn_deg: float) -> Made:
    """Legs of one length, each turned against the one before by so much, to and fro."""
    course = np.radians(np.where(np.arange(count) % 2, 0.5 * turn_deg, -0.5 * turn_deg))
    steps = leg_m * np.column_stack([np.sin(course), np.cos(course)])
    return level(np.vstack([[0.0, 20.0], 20.0 * np.array([0.0, 1.0]) + np.cumsum(steps, axis=0)]))


def circle(count: int, radius_m: float) -> Made:
    """A polygon of many corners."""
    angle = np.linspace(0.0, math.tau, count + 1)
    return level(radius_m * np.column_stack([np.sin(angle), 1.0 - np.cos(angle)]) + [0.0, 20.0])


def spiral(count: int) -> Made:
    """Outwards, the legs grow."""
    angle = np.linspace(0.0, 3.0 * math.tau, count)
    return level(np.column_stack([6.0 * angle * np.sin(angle), 6.0 * angle * np.cos(angle)]))


def waves(count: int, step_m: float, rise_m: float) -> Made:
    """Straight ahead, up and down as over hills."""
    norths = 20.0 + step_m * np.arange(count)
    return Made(np.column_stack([np.zeros(count), norths, HEIGHT_M + rise_m * (np.arange(count) % 2)]))


def stairs(count: int, step_m: float, rise_m: float) -> Made:
    """Up in steps and down again, to and fro."""
    k = np.arange(count)
    up = HEIGHT_M + rise_m * np.minimum(k, count - 1 - k)
    return Made(np.column_stack([step_m * (k % 2), 20.0 + 15.0 * k, up]))


def scattered(count: int, size_m: float, seed: int, *, rise_m: float = 0.0) -> Made:
    """Places at random."""
    rng = np.random.default_rng(seed)
    positions = rng.uniform(0.0, size_m, (count, 2))
    return Made(np.column_stack([positions, HEIGHT_M + rng.uniform(0.0, 1.0, count) * rise_m]))


MADE: Mapping[str, Callable[[], Made]] = MappingProxyType(
    {
        "lines-400": lambda: lines(4, 400.0, 40.0),
        "lines-150": lambda: lines(8, 150.0, 20.0),
        "lines-300-step-25": lambda: lines(4, 300.0, 30.0, step_m=25.0),
        "lines-200-step-10": lambda: lines(3, 200.0, 30.0, step_m=10.0),
        "lines-200-at-5": lambda: lines(4, 200.0, 30.0, cruise_m_s=5.0),
        "lines-300-at-8": lambda: lines(4, 300.0, 50.0, cruise_m_s=8.0),
        "zigzag-30": lambda: zigzag(24, 30.0, 90.0),
        "zigzag-60": lambda: zigzag(16, 60.0, 60.0),
        "zigzag-sharp": lambda: zigzag(12, 80.0, 150.0),
        "square": lambda: level(np.array([[0.0, 20.0], [80.0, 20.0], [80.0, 100.0], [0.0, 100.0], [0.0, 20.0]])),
        "circle-24": lambda: circle(24, 60.0),
        "circle-60": lambda: circle(60, 80.0),
        "spiral": lambda: spiral(50),
        "waves": lambda: waves(24, 40.0, 10.0),
        "waves-low": lambda: waves(24, 30.0, 3.0),
        "stairs": lambda: stairs(16, 60.0, 6.0),
        "scattered-15": lambda: scattered(15, 300.0, 1),
        "scattered-30": lambda: scattered(30, 200.0, 2, rise_m=20.0),
    }
)
BUNDLED = ("jacksboro", "ridge-obstacles")
MISSIONS = (*MADE, *BUNDLED)


def mission(name: str, autopilot: AutopilotName, folder: Path) -> tuple[Site, CompiledMission]:
    """A mission by its name, with the limits of an autopilot as it comes."""
    site, route_m, cruise_m_s = bundled(name, folder) if name in BUNDLED else made(name)
    vehicle = Vehicle(cruise_speed_m_s=cruise_m_s, takeoff_height_m=HEIGHT_M, autopilot=autopilot, **LIMITS[autopilot])
    site = dataclasses.replace(site, scenario=dataclasses.replace(site.scenario, vehicle=vehicle))
    return site, compile_mission(site, Route(route_m), autopilot=autopilot)


def made(name: str) -> tuple[Site, FloatArray, float]:
    """A made route, on flat ground around a home at the demo's origin."""
    route = MADE[name]()
    base = load_site("jacksboro")
    ground = grid_ground(
        np.zeros((401, 401)), east0_m=-2000.0, north0_m=-2000.0, step_m=10.0, source="flat", vertical_datum="EGM96"
    )
    limits = FlightLimits(min_height_agl_m=20.0, max_height_agl_m=300.0, max_climb_angle_deg=80.0)
    scenario = dataclasses.replace(base.scenario, limits=limits)
    fence = shapely.box(-1500.0, -1500.0, 1500.0, 1500.0)
    site = dataclasses.replace(base, scenario=scenario, ground=ground, fence=fence, home_m=np.zeros(3))
    return site, route.route_m, route.cruise_m_s


@cache
def bundled(name: str, folder: Path) -> tuple[Site, FloatArray, float]:
    """A bundled scenario and the route that is planned for it."""
    run = folder / f"plan-{name}"
    if not (run / "plan.json").exists():
        plan = [sys.executable, "-m", "uavcover", "plan", name, "-o", str(run), "--force", "-q"]
        subprocess.run([*plan, "--evaluations", str(EVALUATIONS), "--seed", "1"], check=True)
    waypoints = json.loads((run / "plan.json").read_text(encoding="utf-8"))["waypoints"]
    site = load_site(name)
    return (
        site,
        np.array([[position["east_m"], position["north_m"], position["up_m"]] for position in waypoints]),
        site.scenario.vehicle.cruise_speed_m_s,
    )


def key_of(compiled: CompiledMission) -> str:
    """What tells a mission from another one."""
    return hashlib.sha256(repr(compiled.mission).encode()).hexdigest()[:16]


def flown_s(flier: Flier, site: Site, compiled: CompiledMission, folder: Path) -> tuple[float, str]:
    """Fly a mission; seconds from take-off to touch-down, and what flew it."""
    folder.mkdir(parents=True, exist_ok=True)
    home = compiled.mission.home
    if home is None or site.frame is None:
        raise ValueError("a mission without a home")
    with flier.start(StartRequest(folder, home, flier.speed, {})) as vehicle:
        samples = fly_it(vehicle, site, compiled)
    return airborne_s(samples), vehicle.version


def airborne_s(samples: Sequence[TrackSample]) -> float:
    """From leaving the ground to coming back to it; estimates of height drift, so it is no matter what they say later.

    Raises:
        ValueError: the record does not begin and end on the ground.
    """
    above_m = np.array([sample.up_m - samples[0].up_m for sample in samples])
    low = np.flatnonzero(above_m < AIRBORNE_M)
    top = int(np.argmax(above_m))
    before, behind = low[low < top], low[low > top]
    if not (len(before) and len(behind)):
        raise ValueError("the record does not begin and end on the ground")
    return samples[int(behind[0])].time_s - samples[int(before[-1])].time_s


def fly_it(vehicle: RunningVehicle, site: Site, compiled: CompiledMission) -> list[TrackSample]:
    """Upload, fly, and keep the track."""
    samples: list[TrackSample] = []
    monitor = Monitor()
    home = compiled.mission.home
    if home is None or site.frame is None:
        raise ValueError("a mission without a home")
    plan = FlightPlan(
        mission=compiled.mission,
        first_waypoint_item=compiled.first_waypoint_item,
        waypoint_count=compiled.waypoint_count,
        frame=site.frame,
        home=home,
    )
    orders = Orders(
        on_sample=samples.append,
        confirmed=True,
        timeouts=FlightTimeouts(),
        precautions=Precautions(on_breach=OnBreach.TELL),
    )

    def no_return(lat_deg: float, lon_deg: float, alt_amsl_m: float) -> None:
        raise NotImplementedError

    with Client(open_link(vehicle.url), system_id=255, listener=monitor) as client:
        monitor.listen_to(client.wait_for_vehicle(FIRST_HEARTBEAT_S).address)
        if not client.upload_and_verify(compiled.mission).passed:
            raise RuntimeError("the mission was read back changed")
        fly(client, monitor, plan, orders, plan_return=no_return)
    return samples


@dataclass(frozen=True, slots=True)
class Flight:
    """A row of the table.

    Attributes:
        mission: its name.
        vehicle: what flew it, of FLIERS.
        key: of the mission's items.
        waypoints: how many are planned.
        length_m: of the path from above home to above home.
        flown_s: from take-off to touch-down.
        version: of the vehicle.
    """

    mission: str
    vehicle: str
    key: str
    waypoints: int
    length_m: float
    flown_s: float
    version: str


def kept(path: Path) -> dict[tuple[str, str], Flight]:
    """What was flown before."""
    if not path.exists():
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {
        (row["mission"], row["vehicle"]): Flight(
            row["mission"], row["vehicle"], row["key"], int(row["waypoints"]), float(row["length_m"]),
            float(row["flown_s"]), row["version"],
        )
        for row in rows
    }  # fmt: skip


def fly_all(
    names: Sequence[str], fliers: Sequence[str], table: Path, logs: Path
) -> dict[tuple[str, str], tuple[Flight, float]]:
    """Fly what is not in the table; each flight with its planned time."""
    flown, known = kept(table), dict[tuple[str, str], tuple[Flight, float]]()
    for who in fliers:
        flier = FLIERS[who]
        for name in names:
            site, compiled = mission(name, flier.autopilot, logs)
            flight = flown.get((name, who))
            if flight is None or flight.key != key_of(compiled):
                folder = logs / f"{who}-{name}-{key_of(compiled)}"
                try:
                    seconds, version = flown_s(flier, site, compiled, folder)
                except MissingSimulatorError as error:
                    print(f"{who}: {error}", file=sys.stderr)
                    break
                length_m = float(np.linalg.norm(np.diff(compiled.path_m, axis=0), axis=1).sum())
                flight = Flight(name, who, key_of(compiled), compiled.waypoint_count, length_m, seconds, version)
                flown[name, who] = flight
                write_rows(table, flown)
            known[name, who] = (flight, compiled.flight_time_s)
            print(
                f"{who} {name}: planned {compiled.flight_time_s:.1f} s, flown {flight.flown_s:.1f} s", file=sys.stderr
            )
    return known


def write_rows(table: Path, flown: Mapping[tuple[str, str], Flight]) -> None:
    """The table of what was flown."""
    with table.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([field.name for field in dataclasses.fields(Flight)])
        writer.writerows(dataclasses.astuple(flight) for _, flight in sorted(flown.items()))


def page(known: Mapping[tuple[str, str], tuple[Flight, float]], command: str) -> str:
    """The page in Markdown."""
    fliers = [who for who in FLIERS if any(flier == who for _, flier in known)]
    lines = [
        "# Planned and flown time",
        "",
        f"Command: `{command}`, {datetime.datetime.now(datetime.UTC):%Y-%m-%d}. Each mission is planned with the speeds that the",
        "autopilot has by default (ArduCopter climbs with 2.5 m/s and descends with 1.5, PX4 with 3.0 and 1.5) and its",
        "acceleration and jerk ([scenario keys](../reference/scenario_keys.md)); each is flown once, in calm air. Flown is",
        "vehicle time from take-off to touch-down. A cell has seconds planned, seconds flown and the difference.",
        "",
        "| mission | waypoints | m | " + " | ".join(fliers) + " |",
        "|---|---:|---:|" + "---:|" * len(fliers),
    ]
    for name in MISSIONS:
        row = [known.get((name, who)) for who in fliers]
        first = next((entry[0] for entry in row if entry is not None), None)
        if first is None:
            continue
        cells = [
            "-"
            if entry is None
            else f"{entry[1]:.0f}, {entry[0].flown_s:.0f}, {entry[1] / entry[0].flown_s - 1.0:+.1%}"
            for entry in row
        ]
        lines.append(f"| {name} | {first.waypoints} | {first.length_m:.0f} | " + " | ".join(cells) + " |")
    lines += ["", "| | missions | mean difference | largest | asked | within it |", "|---|---:|---:|---:|---:|---:|"]
    for who in fliers:
        off = [planned / flight.flown_s - 1.0 for (_, flier), (flight, planned) in known.items() if flier == who]
        most = FLIERS[who].most
        inside = sum(abs(one) <= most for one in off)
        lines.append(
            f"| {who} | {len(off)} | {np.mean(off):+.1%} | {max(off, key=abs):+.1%} | {most:.0%} | {inside} of {len(off)} |"
        )
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str]) -> int:
    """Fly, and write table and page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("-o", "--output", type=file_to_write, required=True)
    parser.add_argument("--logs", help="folder for plans and logs; by default a temporary one")
    parser.add_argument("--vehicles", type=names_of(FLIERS), default=",".join(FLIERS))
    parser.add_argument("--missions", type=names_of(MISSIONS), default=",".join(MISSIONS))
    options = parser.parse_args(arguments)
    output: Path = options.output
    notes = output.read_text(encoding="utf-8").partition(NOTES)[2] if output.exists() else ""
    logs = Path(options.logs or tempfile.mkdtemp(prefix="uavcover-flight-time-"))
    known = fly_all(options.missions, options.vehicles, output.with_suffix(".csv"), logs)
    command = " ".join([".venv/bin/python scripts/bench/flight_time.py", *arguments])
    output.write_text(page(known, command) + (f"{NOTES}{notes}" if notes else ""), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""Fly missions as other ground stations make them, and compare the flown track with the path that `uavcover check` predicts.

Usage: .venv/bin/python scripts/fly_foreign.py OUT.csv [--missions copter-splines,plane-corners] [--logs DIR]

ArduCopter, ArduPlane and PX4 fly where their variables name the builds (docs/how-to/sitl.md); a mission whose simulator is
missing is left out, and said. Distances are in space, from a flown place to the nearest place of the legs, and of legs and turns.
Clearances are over the bundled elevation model (the simulators' own ground is flat), without take-off and landing.
"""

import argparse
import csv
import dataclasses
import itertools
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import nan
from pathlib import Path
from types import MappingProxyType

import numpy as np

from mission_io.client.terrain import answer_terrain_requests
from mission_io.model.items import Command, Frame, GeoPoint, Mission, MissionItem, delay, land, takeoff, waypoint
from mission_io.protocol.terrain import TerrainAnswers
from scripts.options import file_to_write, names_of
from sitl_tests.case import Case
from sitl_tests.errors import MissingSimulatorError
from sitl_tests.flying import frame_at, take_off
from sitl_tests.run import home as demo_home
from sitl_tests.simulators import ardupilot, px4
from sitl_tests.simulators.running import Start, StartRequest
from uavcover.extras.check.aircraft import Kind, default_aircraft, radius_of_bank_m
from uavcover.extras.check.check import Checked, CheckRequest, check_mission
from uavcover.extras.check.limits import Limits
from uavcover.extras.check.segments import Segment
from uavcover.extras.check.turns import turns_of
from uavcover.kernels.arrays import FloatArray
from uavcover.model.vehicle import AutopilotName
from uavcover.scenario.ground import Ground, grid_ground
from uavcover.scenario.site import load_site

_FLIGHT_S = 1500.0
_ON_THE_GROUND: tuple[str, ...] = ("take-off", "landing")
Items = tuple[MissionItem, ...]


@dataclass(frozen=True, slots=True)
class Flier:
    """Who flies: its autopilot, how it moves, what starts it, vehicle seconds per second, and what it has of its own."""

    autopilot: AutopilotName
    kind: Kind
    start: Start
    speed: float
    own: Mapping[str, float] = field(default_factory=dict)


_PLANE = MappingProxyType(
    {
        "cruise_speed_m_s": 22.0,
        "turn_radius_m": radius_of_bank_m(22.0, 65.0),
        "acceptance_m": 79.0,
        "loiter_radius_m": 80.0,
    }
)
"""Of the simulated plane: AIRSPEED_CRUISE, ROLL_LIMIT_DEG, the L1 distance (NAVL1_PERIOD 15 s), WP_LOITER_RAD."""
FLIERS: Mapping[str, Flier] = MappingProxyType(
    {
        "copter": Flier("ardupilot", "multirotor", ardupilot.starter(ardupilot.COPTER), 8.0),
        "plane": Flier("ardupilot", "fixed-wing", ardupilot.starter(ardupilot.PLANE), 8.0, _PLANE),
        "px4": Flier("px4", "multirotor", px4.start, 5.0),
    }
)


def place(east_m: float, north_m: float) -> tuple[float, float]:
    """Latitude and longitude of metres from home."""
    lat, lon, _ = frame_at(demo_home()).geodetic_from_enu((east_m, north_m, 0.0))
    return float(lat[0]), float(lon[0])


def at(
    command: Command, east_m: float, north_m: float, height_m: float, *params: float, frame: Frame = Frame.ABOVE_HOME
) -> MissionItem:
    """An item at metres from home."""
    numbers = (*params, *(0.0,) * (4 - len(params)))
    return MissionItem(
        command, frame, (numbers[0], numbers[1], numbers[2], numbers[3]), *place(east_m, north_m), height_m
    )


def to(east_m: float, north_m: float, height_m: float = 60.0, *, frame: Frame = Frame.ABOVE_HOME) -> MissionItem:
    """A waypoint that leaves the heading to the vehicle."""
    return replace(waypoint(*place(east_m, north_m), height_m, frame=frame), params=(0.0, 0.0, 0.0, nan))


def spline(east_m: float, north_m: float, height_m: float = 60.0, wait_s: float = 0.0) -> MissionItem:
    """A spline waypoint."""
    return at(Command.NAV_SPLINE_WAYPOINT, east_m, north_m, height_m, wait_s)


def jump(number: int, times: int) -> MissionItem:
    """To an item, so often."""
    return MissionItem(Command.DO_JUMP, Frame.COMMAND, (float(number), float(times), 0.0, 0.0))


def return_home() -> MissionItem:
    """The autopilot's own return."""
    return MissionItem(Command.NAV_RETURN_TO_LAUNCH, Frame.COMMAND)


def up(height_m: float = 60.0) -> MissionItem:
    """Take-off at home."""
    return takeoff(*place(0.0, 0.0), height_m, frame=Frame.ABOVE_HOME)


def down() -> MissionItem:
    """Landing at home."""
    return land(*place(0.0, 0.0), 0.0, frame=Frame.ABOVE_HOME)


def over(east_m: float, north_m: float) -> MissionItem:
    """Fifty metres above the terrain."""
    return to(east_m, north_m, 50.0, frame=Frame.ABOVE_TERRAIN)


CORNERS = ((200.0, 100.0, 60.0), (200.0, 260.0, 80.0), (60.0, 200.0, 55.0), (260.0, 160.0, 60.0))
RUNWAY: Items = (at(Command.NAV_TAKEOFF, 0.0, 250.0, 60.0, 15.0),)
APPROACH: Items = (
    at(Command.NAV_LOITER_TO_ALT, -500.0, -300.0, 50.0, 0.0, 80.0),
    to(-300.0, 0.0, 25.0),
    at(Command.NAV_LAND, 0.0, 0.0, 0.0),
)
JUMPS: Items = (
    up(), to(60.0, 80.0), to(180.0, 60.0, 75.0), delay(5.0), to(160.0, 220.0), jump(2, 2), to(0.0, 120.0)
)  # fmt: skip
MISSIONS: Mapping[str, Callable[[], Items]] = MappingProxyType(
    {
        "copter-splines": lambda: (
            up(), to(40.0, 60.0), spline(120.0, 160.0, 70.0), spline(240.0, 60.0, 55.0), spline(300.0, 200.0),
            spline(120.0, 280.0, 80.0, 3.0), spline(20.0, 180.0), to(0.0, 60.0), down(),
        ),
        "copter-jumps": lambda: (*JUMPS, return_home()),
        "copter-terrain": lambda: (
            up(80.0), over(150.0, 150.0), over(340.0, 240.0), over(100.0, 600.0), over(-200.0, 300.0), to(0.0, 0.0, 120.0),
            down(),
        ),
        "copter-circles": lambda: (
            up(), at(Command.NAV_LOITER_TURNS, 150.0, 100.0, 60.0, 2.0, 0.0, 30.0), to(250.0, 250.0, 70.0),
            at(Command.NAV_LOITER_TURNS, 80.0, 250.0, 80.0, 1.0, 0.0, -20.0),
            at(Command.NAV_LOITER_TIME, 0.0, 150.0, 50.0, 8.0), return_home(),
        ),
        "plane-corners": lambda: (
            *RUNWAY, to(300.0, 500.0, 90.0), to(700.0, 500.0, 110.0), to(400.0, 150.0, 110.0), to(800.0, 0.0, 90.0),
            to(100.0, -300.0, 80.0), *APPROACH,
        ),
        "plane-circles": lambda: (
            *RUNWAY, to(200.0, 500.0, 90.0), at(Command.NAV_LOITER_TURNS, 500.0, 300.0, 110.0, 2.0, 0.0, 90.0),
            to(0.0, 100.0, 100.0), at(Command.NAV_LOITER_TIME, -300.0, 200.0, 90.0, 20.0, 0.0, -70.0), *APPROACH,
        ),
        "px4-corners": lambda: (up(), *(to(*corner) for corner in CORNERS), return_home()),
        "px4-jumps": lambda: (*JUMPS, down()),
    }
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Row:
    """What came of one mission; NaN where nothing was flown there.

    Attributes:
        mission: its name.
        seconds: in the air.
        off_legs_m: the largest distance from the predicted legs.
        off_path_m: the same from legs and turns.
        worst: where that was: metres east, north and up from home.
        clearance_predicted_m: the least height above ground of legs and turns.
        clearance_flown_m: the least height above ground of the track.
    """

    mission: str
    seconds: float
    off_legs_m: float
    off_path_m: float
    worst: str
    clearance_predicted_m: float
    clearance_flown_m: float


def ground_model() -> tuple[GeoPoint, Ground]:
    """The demo's home and the ground around it, in a frame whose origin is there."""
    home = demo_home()
    site = load_site("jacksboro")
    frame = frame_at(home)
    steps = np.arange(-1500.0, 1501.0, 10.0)
    east, north = np.meshgrid(steps, steps)
    flat = frame.geodetic_from_enu(np.column_stack([east.ravel(), north.ravel(), np.zeros(east.size)]))
    if site.frame is None:
        raise ValueError("the scenario has no place")
    above = site.ground.heights_agl_m(site.frame.enu_from_geodetic(flat[0], flat[1], 2000.0))
    alts = (2000.0 - above).reshape(east.shape)
    alts -= (east**2 + north**2) / 2.0 / 6.371e6 + home.alt_amsl_m  # heights in a plane that touches the Earth at home
    return home, grid_ground(
        alts, east0_m=-1500.0, north0_m=-1500.0, step_m=10.0, source="jacksboro", vertical_datum="EGM96"
    )


def fly(name: str, mission: Mission, flier: Flier, home: GeoPoint, folder: Path) -> tuple[FloatArray, float]:
    """The flown places, (n, 3) metres from home, and how long it took."""
    folder.mkdir(parents=True)
    site = load_site("jacksboro")
    unknown = home.alt_amsl_m
    with flier.start(StartRequest(folder, home, flier.speed, {})) as vehicle:
        case = Case(vehicle=vehicle, autopilot=flier.autopilot, client="native", folder=folder, seed=1)
        with case.station() as station:
            if name == "copter-terrain":
                heights = lambda places: [site.ground_alt_amsl_m(*p) or unknown for p in places]  # noqa: E731
                answer_terrain_requests(station.client, TerrainAnswers(heights, parts_per_s=1000.0))
            path = take_off(case, station, mission)
            station.wait(lambda: not station.client.vehicle.armed, within_s=_FLIGHT_S, what="it does not land")
    return np.array(path.enu_m), path.times_s[-1] - path.times_s[0]


def distances_m(places: FloatArray, line: FloatArray) -> FloatArray:
    """(n,) distances of places (n, 3) from a line of points (m, 3)."""
    best = np.full(len(places), np.inf)
    line = line[np.isfinite(line).all(axis=1)]
    for begin, end in itertools.pairwise(line):
        way = end - begin
        length = float(way @ way)
        share = np.clip((places - begin) @ way / length, 0.0, 1.0) if length > 0.0 else np.zeros(len(places))
        best = np.minimum(best, np.linalg.norm(places - begin - share[:, None] * way, axis=1))
    return best


def compared(name: str, flown_m: FloatArray, seconds: float, checked: Checked, turns: Sequence[Segment]) -> Row:
    """A track beside what was predicted."""
    if checked.path is None or checked.world is None:
        raise ValueError(f"{name}: nothing was predicted")
    legs, ground = checked.path.distinct, checked.world.ground
    off = np.array([distances_m(flown_m, segment.enu_m) for segment in legs])
    nearest = off.argmin(axis=0)
    on_route = np.array([legs[k].phase not in _ON_THE_GROUND for k in nearest])
    beside = np.array([distances_m(flown_m, segment.enu_m) for segment in turns] or [np.full(len(flown_m), np.inf)])
    off_legs, off_path = off.min(axis=0), np.minimum(off.min(axis=0), beside.min(axis=0))
    worst = int(np.argmax(np.where(on_route, off_path, -1.0)))
    judged = [segment for segment in (*legs, *turns) if segment.phase not in _ON_THE_GROUND]
    lowest = np.concatenate([ground.leg_height_ranges_m(segment.enu_m)[:, 0] for segment in judged])
    predicted = float(np.nanmin(lowest))
    flown_agl = ground.heights_agl_m(flown_m[on_route])
    return Row(
        name, seconds, float(off_legs[on_route].max()), float(off_path[on_route].max()),
        " ".join(f"{value:.0f}" for value in flown_m[worst]), predicted, float(np.nanmin(flown_agl)),
    )  # fmt: skip


def main(arguments: Sequence[str]) -> int:
    """Fly all missions and write the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("output", type=file_to_write)
    parser.add_argument("--missions", type=names_of(MISSIONS), default=",".join(MISSIONS))
    parser.add_argument("--logs", help="folder for logs and tracks; a track that is there is not flown again")
    options = parser.parse_args(arguments)
    logs = Path(options.logs or tempfile.mkdtemp(prefix="uavcover-foreign-"))
    home, ground = ground_model()
    rows = []
    for name in options.missions:
        flier = FLIERS[name.split("-")[0]]
        mission = Mission(home, MISSIONS[name]())
        aircraft = replace(default_aircraft(flier.autopilot, flier.kind), **flier.own)
        request = CheckRequest(mission=mission, aircraft=aircraft, limits=Limits(min_height_agl_m=10.0))
        checked = check_mission(
            request, lambda lat, _: np.full(np.shape(lat), home.alt_amsl_m), lambda *_: ground, lambda _: []
        )
        track = logs / name / "track.npy"
        try:
            if not track.exists():
                flown_m, seconds = fly(name, mission, flier, home, logs / name)
                np.save(track, np.vstack([flown_m, [seconds, 0.0, 0.0]]))
        except MissingSimulatorError as error:
            print(f"{name}: {error}", file=sys.stderr)
            continue
        kept = np.load(track)
        if checked.path is None:
            raise ValueError(f"{name}: nothing was predicted")
        turns = turns_of(checked.path, mission, aircraft).segments
        rows.append(compared(name, kept[:-1], float(kept[-1, 0]), checked, turns))
        print(rows[-1], file=sys.stderr)
    with options.output.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([field.name for field in dataclasses.fields(Row)])
        writer.writerows(dataclasses.astuple(row) for row in rows)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

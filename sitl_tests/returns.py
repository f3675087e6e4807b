"""Seeded failsafes in flight over ridged terrain: cases, what the prediction says of them, and how a flight compares with it."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mission_io.autopilots.autopilot import Mode
from mission_io.autopilots.mission_lists import wire_items
from mission_io.model.items import (
    Command,
    Frame,
    FramedPoint,
    GeoPoint,
    Mission,
    MissionItem,
    MissionType,
    RallyPoints,
    change_speed,
    items_from_rally,
    land,
    takeoff,
    waypoint,
)
from mission_io.wire import messages as m
from sitl_tests.flying import frame_at
from uavcover.kernels.arrays import FloatArray
from uavcover.missions.failsafe_path import predict
from uavcover.missions.failsafes import Destinations, FailsafePaths, FlightStates, Response, failsafe_settings
from uavcover.missions.mission_compiler import AUTOPILOTS
from uavcover.mock.behaviour import Settings
from uavcover.mock.vehicle import MockConfig, MockVehicle
from uavcover.model.vehicle import MOTIONS, AutopilotName

SPEED_M_S = 7.0
_TICK_S = 0.1
_LONGEST_S = 400.0
_SETTLED_S = 12.0
HOME_ALT_M = 300.0
HOME = GeoPoint(36.51234567, -84.21234567, HOME_ALT_M)
Point = tuple[float, float, float]
Ending = Literal["home", "beside", "pattern", "return"]
_BESIDE_M = (-45.0, 70.0)


@dataclass(frozen=True, slots=True)
class Ridges:
    """Terrain: Gaussian ridges on a slope, 0 at home.

    Attributes:
        slope: rise per metre towards east and north.
        ridges: direction in radians in which it lies, distance from home, offset along it, half width, half length, height, each
            in metres.
    """

    slope: tuple[float, float]
    ridges: tuple[tuple[float, float, float, float, float, float], ...]

    def heights_m(self, east_north_m: FloatArray) -> FloatArray:
        """Heights above home (n,) at (n, 2) positions."""
        return np.asarray(self._raw(east_north_m) - self._raw(np.zeros((1, 2))), float)

    def _raw(self, east_north_m: FloatArray) -> FloatArray:
        up = east_north_m @ np.array(self.slope)
        for angle, distance, offset, width, length, height in self.ridges:
            across = east_north_m @ np.array([math.cos(angle), math.sin(angle)]) - distance
            along = east_north_m @ np.array([-math.sin(angle), math.cos(angle)]) - offset
            up = up + height * np.exp(-((across / width) ** 2) - (along / length) ** 2)
        return np.asarray(up, float)


@dataclass(frozen=True, slots=True)
class FailsafeCase:
    """One flight.

    Attributes:
        seed: that made it.
        autopilot: who flies.
        terrain: over what.
        route_m: waypoints, east, north, up from home.
        rally: rally points, in the same metres, and whether they are given above sea level.
        parameters: set before the flight.
        trigger: "commanded", "ground station", "fence" or "battery".
        in_flight: parameters whose change triggers it.
        leg: waypoint that it flies to when it is triggered.
        after_s: so long after it has begun to fly there.
        ends: how the mission ends: with a landing at home or beside it, with a landing pattern from its last waypoint on
            (DO_LAND_START), or with a return (without a landing).
    """

    seed: int
    autopilot: AutopilotName
    terrain: Ridges
    route_m: tuple[Point, ...]
    rally: tuple[tuple[Point, bool], ...]
    parameters: Mapping[str, float]
    trigger: str
    in_flight: Mapping[str, float]
    leg: int
    after_s: float
    ends: Ending = "home"

    @property
    def landing(self) -> int | None:
        """Vertex of the route where the mission's landing begins for PX4; none without one."""
        last = len(self.route_m) + 1
        return {"home": last, "beside": last, "pattern": last - 1, "return": None}[self.ends]

    @property
    def lands_at_m(self) -> tuple[float, float]:
        """Where the mission ends."""
        return _BESIDE_M if self.ends == "beside" else (0.0, 0.0)

    @property
    def all_parameters(self) -> dict[str, float]:
        """As they are when it has been triggered."""
        return {**self.parameters, **self.in_flight}


def make_case(seed: int, autopilot: AutopilotName, *, triggers: Sequence[str]) -> FailsafeCase:
    """A case by its seed."""
    rng = np.random.default_rng([seed, 31968])
    terrain = Ridges(
        (float(rng.uniform(-0.08, 0.08)), float(rng.uniform(-0.08, 0.08))),
        tuple(
            (float(rng.uniform(0.0, math.tau)), float(rng.uniform(90.0, 260.0)), float(rng.uniform(-80.0, 80.0)),
             float(rng.uniform(15.0, 40.0)), float(rng.uniform(30.0, 100.0)), float(rng.uniform(20.0, 120.0)))
            for _ in range(rng.integers(5, 11))
        ),
    )  # fmt: skip
    positions = [
        (float(rng.uniform(60.0, 320.0)), float(rng.uniform(0.0, math.tau))) for _ in range(rng.integers(3, 6))
    ]
    route_en = np.array([(r * math.cos(a), r * math.sin(a)) for r, a in positions])
    route = _above(terrain, route_en, float(rng.uniform(10.0, 30.0)))
    rally = []
    for _ in range(rng.integers(0, 4)):
        r, a = float(rng.uniform(40.0, 320.0)), float(rng.uniform(0.0, math.tau))
        en = np.array([[r * math.cos(a), r * math.sin(a)]])
        up = float(terrain.heights_m(en)[0]) + float(rng.choice([0.0, 3.0, 20.0, 45.0]))
        rally.append(((float(en[0, 0]), float(en[0, 1]), float(round(up))), bool(rng.integers(2))))
    trigger = triggers[seed // 2 % len(triggers)]
    parameters, in_flight = (_copter if autopilot == "ardupilot" else _px4)(rng, trigger, route)
    return FailsafeCase(
        seed, autopilot, terrain, route, tuple(rally), parameters, trigger, in_flight,
        int(rng.integers(1, len(route))), float(rng.uniform(0.5, 8.0)),
    )  # fmt: skip


def make_return_case(seed: int, autopilot: AutopilotName, *, kind: float) -> FailsafeCase:
    """A case whose return goes along the mission or the flown path, by its seed.

    Args:
        seed: of everything else.
        autopilot: who flies.
        kind: PX4's RTL_TYPE; of ArduCopter 1 is SmartRTL or RTL, 2 SmartRTL or LAND.
    """
    rng = np.random.default_rng([seed, 21])
    case = make_case(seed, autopilot, triggers=("ground station", "fence", "battery"))
    if autopilot == "px4":
        case = make_case(seed, autopilot, triggers=("commanded", "ground station", "fence", "battery"))
        ends: Ending = ("home", "beside", "pattern", "return")[rng.integers(4)]
        action = {
            "ground station": {"NAV_DLL_ACT": 2.0},
            "battery": {"COM_LOW_BAT_ACT": 3.0},
            "fence": {"GF_ACTION": 3.0},
        }
        parameters = {**case.parameters, "RTL_TYPE": kind, **action.get(case.trigger, {})}
        return replace(case, parameters=parameters, ends=ends)
    values = {
        "ground station": ("FS_GCS_ENABLE", 3.0, 4.0), "battery": ("BATT_FS_LOW_ACT", 3.0, 4.0),
        "fence": ("FENCE_ACTION", 3.0, 5.0),
    }  # fmt: skip
    name, otherwise_return, otherwise_land = values[case.trigger]
    srtl = {
        "SRTL_ACCURACY": float(rng.choice([2.0, 2.0, 5.0])),
        "SRTL_POINTS": float(rng.choice([300, 300, 300, 40, 0])),
    }
    value = otherwise_return if kind == 1.0 else otherwise_land
    return replace(case, parameters={**case.parameters, name: value, **srtl})


def _above(terrain: Ridges, route_en: FloatArray, clearance_m: float) -> tuple[Point, ...]:
    """A route at one height that clears the terrain below it and the ways from and to home."""
    line = np.vstack([[0.0, 0.0], route_en, [0.0, 0.0]])
    at = np.vstack([a + t * (b - a) for a, b in itertools.pairwise(line) for t in np.linspace(0.0, 1.0, 100)])
    up = float(terrain.heights_m(at).max()) + clearance_m
    return tuple((float(e), float(n), round(up, 1)) for e, n in route_en)


def _copter(
    rng: np.random.Generator, trigger: str, route_m: tuple[Point, ...]
) -> tuple[dict[str, float], dict[str, float]]:
    def pick(*values: float) -> float:
        return float(rng.choice(values))

    parameters = {
        "RTL_ALT": pick(1500, 3000, 6000, 9000), "RTL_ALT_FINAL": pick(0, 0, 0, 500, 2000),
        "RTL_CLIMB_MIN": pick(0, 0, 1500), "RTL_CONE_SLOPE": pick(0, 1, 3), "RTL_LOIT_TIME": pick(0, 3000),
        "RALLY_LIMIT_KM": pick(0, 0.1, 0.3), "RALLY_INCL_HOME": pick(0, 1), "WPNAV_SPEED": 700.0,
    }  # fmt: skip
    if rng.random() < 0.3:
        parameters |= {
            "FENCE_ENABLE": 1.0,
            "FENCE_TYPE": 1.0,
            "FENCE_ALT_MAX": route_m[0][2] + pick(20, 60),
            "FENCE_ACTION": 1.0,
        }
    if trigger == "ground station":
        return parameters | {"FS_GCS_ENABLE": pick(1, 1, 5), "FS_GCS_TIMEOUT": 12.0}, {}
    if trigger == "battery":
        return parameters | {"BATT_FS_LOW_ACT": pick(1, 2, 2)}, {"BATT_LOW_MAH": 1e6}
    if trigger == "fence":
        # A ceiling below the route: more than 100 m outside of a fence, ArduCopter lands whatever FENCE_ACTION says.
        fence = {"FENCE_ENABLE": 1.0, "FENCE_TYPE": 1.0, "FENCE_ALT_MAX": 400.0, "FENCE_ACTION": pick(1, 1, 2)}
        return parameters | fence, {"FENCE_ALT_MAX": route_m[0][2] - 8.0}
    return parameters, {}


def _px4(
    rng: np.random.Generator, trigger: str, route_m: tuple[Point, ...]
) -> tuple[dict[str, float], dict[str, float]]:
    def pick(*values: float) -> float:
        return float(rng.choice(values))

    parameters = {
        "RTL_RETURN_ALT": pick(15, 30, 60), "RTL_DESCEND_ALT": pick(5, 10, 30), "RTL_LAND_DELAY": pick(0, 0, 5, -1),
        "RTL_MIN_DIST": pick(5, 10, 100), "RTL_CONE_ANG": pick(0, 25, 45, 65), "RTL_TYPE": 0.0, "MPC_XY_CRUISE": 7.0,
    }  # fmt: skip
    if trigger == "ground station":
        return parameters | {"NAV_DLL_ACT": pick(2, 2, 3)}, {}
    if trigger == "battery":
        return parameters | {"COM_LOW_BAT_ACT": pick(2, 3, 3)}, {"BAT_CRIT_THR": 1.0}
    if trigger == "fence":
        return parameters | {"GF_ACTION": pick(3, 3, 5)}, {"GF_MAX_VER_DIST": route_m[0][2] - 8.0}
    return parameters, {}


def mission_of(case: FailsafeCase) -> Mission:
    """Take off, the route, above where it ends, land or return."""
    up = case.route_m[0][2]
    end = _waypoint((*case.lands_at_m, up))
    points = [_waypoint(point) for point in case.route_m]
    if case.ends == "pattern":
        points.insert(len(points) - 1, MissionItem(Command.DO_LAND_START, Frame.COMMAND))
    first = (takeoff(HOME.lat_deg, HOME.lon_deg, up, frame=Frame.ABOVE_HOME), change_speed(SPEED_M_S))
    last = land(end.lat_deg, end.lon_deg, 0.0, frame=Frame.ABOVE_HOME)
    if case.ends == "return":
        last = MissionItem(Command.NAV_RETURN_TO_LAUNCH, Frame.COMMAND)
    return Mission(HOME, (*first, *points, end, last))


def first_seq_of(case: FailsafeCase, leg: int) -> int:
    """Wire number of the item that makes a waypoint of the route."""
    marker = case.ends == "pattern" and leg == len(case.route_m) - 1
    return leg + 2 + marker + (1 if AUTOPILOTS[case.autopilot].home_in_item_0 else 0)


def leg_of(case: FailsafeCase, seq: int) -> int:
    """Waypoint of the route that a vehicle flies to, of the wire number of its current item; one more is where it ends."""
    legs = len(case.route_m)
    return next((leg for leg in range(legs) if seq <= first_seq_of(case, leg)), legs)


def rally_of(case: FailsafeCase) -> RallyPoints:
    """The rally points as they are uploaded."""
    points = []
    for (east, north, up), is_amsl in case.rally:
        lat, lon, _ = frame_at(HOME).geodetic_from_enu((east, north, up))
        height, frame = (up + HOME_ALT_M, Frame.AMSL) if is_amsl else (up, Frame.ABOVE_HOME)
        points.append(FramedPoint(float(lat[0]), float(lon[0]), height, frame))
    return RallyPoints(tuple(points))


def _waypoint(point: Point):  # type: ignore[no-untyped-def]
    lat, lon, _ = frame_at(HOME).geodetic_from_enu(point)
    item = waypoint(float(lat[0]), float(lon[0]), point[2], frame=Frame.ABOVE_HOME)
    return replace(item, params=(*item.params[:3], math.nan))


def predicted(
    case: FailsafeCase, position_m: Point, velocity_m_s: tuple[float, float], leg: int, *, flat: bool
) -> list[FailsafePaths]:
    """The paths from a moment of a leg; on flat ground, as simulators have it, or on the case's terrain."""
    settings = failsafe_settings(case.autopilot, case.all_parameters)
    up = case.route_m[0][2]
    route = np.array([(0.0, 0.0, up), *case.route_m, (*case.lands_at_m, up)])
    landing = case.landing if case.autopilot == "px4" else None
    to = Destinations(np.zeros(3), np.array([point for point, _ in case.rally]).reshape(-1, 3), route, landing=landing)
    states = FlightStates(np.array([position_m]), np.array([velocity_m_s]), np.zeros(1), np.array([leg + 1]))
    ground = (lambda en: np.zeros(len(en))) if flat else case.terrain.heights_m
    paths = predict(settings, states, to, ground)
    return [one for one in paths if any(_is_of(response, case) for response in one.responses)]


def _is_of(response: Response, case: FailsafeCase) -> bool:
    if case.trigger == "commanded":
        return not response.parameter
    names = {
        "ground station": ("FS_GCS_ENABLE", "NAV_DLL_ACT"), "battery": ("BATT_FS_LOW_ACT", "COM_LOW_BAT_ACT"),
        "fence": ("FENCE_ACTION", "GF_ACTION"),
    }[case.trigger]  # fmt: skip
    return response.parameter in names and response.trigger != "battery emergency"


@dataclass(frozen=True, slots=True)
class Flown:
    """What was flown from the moment on that it was triggered.

    Attributes:
        position_m: where it was then.
        velocity_m_s: how fast.
        leg: waypoint of the route that it flew to; the number of waypoints on the way to its end.
        track_m: (n, 3) from then on.
        crashed: whether it hit the ground.
        version: what flew.
    """

    position_m: Point
    velocity_m_s: tuple[float, float]
    leg: int
    track_m: FloatArray
    crashed: bool = False
    version: str = "mock"


def fly_on_mock(case: FailsafeCase) -> Flown:
    """Fly a case on the mock vehicle, without a link: vehicle time as fast as it goes."""
    frame, is_px4 = frame_at(HOME), case.autopilot == "px4"

    def ground(lat_deg: float, lon_deg: float) -> float:
        enu = frame.enu_from_geodetic(lat_deg, lon_deg, HOME_ALT_M)
        return HOME_ALT_M + float(case.terrain.heights_m(enu[:, :2])[0])

    motion = MOTIONS[case.autopilot]
    settings = Settings(
        cruise_m_s=SPEED_M_S, climb_m_s=2.5, descent_m_s=1.5, land_m_s=motion.land_m_s, motion=motion,
        acceptance_radius_m=2.0,
    )  # fmt: skip
    vehicle = MockVehicle(AUTOPILOTS[case.autopilot], HOME, MockConfig(settings=settings), ground=ground)
    vehicle.advance(5.0)
    for name, value in case.parameters.items():
        vehicle.parameters.put(name, value)
    autopilot = AUTOPILOTS[case.autopilot]
    vehicle.missions.load(MissionType.MISSION, wire_items(mission_of(case), autopilot))
    vehicle.missions.load(MissionType.RALLY, items_from_rally(rally_of(case)))
    vehicle.control.apply_mission_changes()
    vehicle.control.set_mode(Mode.MISSION if is_px4 else Mode.GUIDED)
    vehicle.control.arm()
    if not is_px4:
        vehicle.control.set_mode(Mode.MISSION)
        vehicle.control.start_mission()
    now, since_s, beaten_s, triggered, seq = 5.0, math.inf, -math.inf, False, 0
    while vehicle.mode is Mode.MISSION and now < _LONGEST_S:
        now += _TICK_S
        seq = vehicle.current_seq
        if (not triggered or case.trigger != "ground station") and now >= beaten_s + 1.0:
            vehicle.receive(m.Received(m.Heartbeat(8, 6), 255, 190), now)
            beaten_s = now
        vehicle.advance(now)
        if math.isinf(since_s) and vehicle.current_seq >= first_seq_of(case, case.leg):
            since_s = now
        if not triggered and now >= since_s + case.after_s:
            triggered = True
            for name, value in case.in_flight.items():
                vehicle.parameters.put(name, value)
            if case.trigger == "commanded":
                vehicle.control.set_mode(Mode.RETURN)
    body = vehicle.body
    (vx, vy, _), position = body.point.velocity_m_s, body.point.position_m
    track, still_s = [position], 0.0
    while vehicle.flying and still_s < _SETTLED_S and now < 3.0 * _LONGEST_S:
        now += _TICK_S
        if case.trigger != "ground station":
            vehicle.receive(m.Received(m.Heartbeat(8, 6), 255, 190), now)
        vehicle.advance(now)
        still_s = still_s + _TICK_S if math.dist(track[-1], body.point.position_m) < 0.005 else 0.0
        track.append(body.point.position_m)
    return Flown(position, (vx, vy), leg_of(case, seq), np.array(track), body.crashed)

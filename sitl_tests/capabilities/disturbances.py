"""The minutes when something else happens: a dark link, a fall, glitches, wind, other stations, a pilot, a hold."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from mission_io.autopilots.autopilot import Mode
from mission_io.model.items import Command, Frame
from mission_io.wire import messages as m
from mission_io.wire.codec import Codec
from sitl_tests.case import Case, Finding
from sitl_tests.errors import require
from sitl_tests.flying import Path, fly_mission, frame_at
from sitl_tests.missions import HEIGHT_M, SPEED_M_S, route_mission
from sitl_tests.relay import Relay
from uavcover.flight.orders import FlightPlan, OnBreach, OperatingVolume, PlanNeeds, custom_mode
from uavcover.kernels.flight_time import Pace
from uavcover.model.track import Ending, EventKind, FlightEvent, FlightOutcome

_AWAY_M = ((0.0, 30.0), (0.0, 500.0), (40.0, 500.0))
_FAILSAFE_S, _THEN_DARK_S = {"ardupilot": 20.0, "px4": 10.0}, 4.0
"""The failsafe's time-out in ``matrix.toml``, and for how long after it the link stays dark."""
_BAND_M = (HEIGHT_M - 8.0, HEIGHT_M + 8.0)
_ASIDE_M = 93.0
_STEERING = frozenset(
    {Command.DO_SET_MODE, Command.MISSION_START, Command.DO_SET_MISSION_CURRENT, Command.COMPONENT_ARM_DISARM}
)
_PACE = Pace(SPEED_M_S, 2.5, 1.5, 25.0, 0.0, 0.0, 2.5, 2.5, 5.0, 0, 2.0)


@dataclass(frozen=True, slots=True)
class Disturbance:
    """One way to disturb a flight.

    Attributes:
        fault: the mock vehicle's fault.
        parameters: what a second station sets on a simulated autopilot, by autopilot; none where it cannot be simulated.
        over: what ends it, as ``fault`` and ``parameters``, once it is named; empty where it never ends.
        expected: the kinds of incidents that name it.
        never: the kinds that would name a wrong cause.
        route_m: what is flown.
    """

    fault: str
    parameters: Mapping[str, Mapping[str, float]]
    expected: tuple[Ending, ...]
    never: tuple[Ending, ...] = ()
    over: tuple[str, Mapping[str, float]] | None = None
    route_m: tuple[tuple[float, float], ...] = _AWAY_M


_MOTOR = Disturbance(
    "motor-failure@0s",
    {"ardupilot": {"SIM_ENGINE_MUL": 0.0, "SIM_ENGINE_FAIL": 3.0}, "px4": {"SIH_T_MAX": 0.5}},
    (Ending.CRASHED,),
    (Ending.WIND_ABOVE_LIMITS, Ending.OFF_ROUTE),
)
_GLITCH = Disturbance(
    "gps-glitch:80@0s",
    {"ardupilot": {"SIM_GPS1_GLTCH_Y": 0.001}},
    (Ending.OFF_ROUTE, Ending.GPS_LOST, Ending.FAILSAFE),
    (Ending.WIND_ABOVE_LIMITS, Ending.PILOT_TOOK_OVER),
)
_WIND = Disturbance(
    "strong-wind:25@0s",
    {"ardupilot": {"SIM_WIND_SPD": 25.0, "SIM_WIND_DIR": 270.0, "SIM_WIND_T": 1.0}},
    (Ending.WIND_ABOVE_LIMITS,),
    (Ending.OFF_ROUTE, Ending.PILOT_TOOK_OVER),
    over=("strong-wind:0.1@0s", {"SIM_WIND_SPD": 0.0}),
)


def motor_failure(case: Case) -> Finding:
    """Motors give no thrust in flight: it falls, and lies there, armed or not."""
    return _disturbed(case, _MOTOR)


def gps_glitch(case: Case) -> Finding:
    """The satellite position jumps by 80 m."""
    return _disturbed(case, _GLITCH)


def strong_wind(case: Case) -> Finding:
    """A wind of 25 m/s comes up."""
    return _disturbed(case, _WIND)


def blackout(case: Case) -> Finding:
    """The link is dark, both ways, while the vehicle returns by its failsafe, above the height band; then it is back."""
    # Simulated ArduCopter counts silence in vehicle time; PX4 multiplies its time-out by the speed, as the mock does.
    in_vehicle_time = case.autopilot == "ardupilot" and case.vehicle.inject is None
    failsafe_s = _FAILSAFE_S[case.autopilot] / (case.speed if in_vehicle_time else 1.0)
    on_breach, dark_s = OnBreach.HOLD, failsafe_s + _THEN_DARK_S
    dark: list[int] = []
    with Relay(case.vehicle.url, seed=case.seed) as relay, case.station(relay.url) as station:

        def cut(event: FlightEvent) -> None:
            if event.kind is EventKind.WAYPOINT and event.waypoint == 1 and not dark:
                relay.go_dark(dark_s)
                dark.append(len(relay.sent))

        outcome, path = fly_mission(
            case, station, route_mission(case.vehicle.home, _AWAY_M), on_event=cut, on_breach=on_breach, plan=_in_band
        )
        sent = [received.message for data in relay.sent[dark[0] :] for received in _READER.decode(data)] if dark else []
    require(bool(dark), f"it never flew to the second waypoint: {case.events[-1]}")
    steered = [message for message in sent if _steers(message)]
    require(not steered, f"after the dark it was commanded: {steered[:2]}; it ended with {outcome.ending.key}")
    east, north, up = path.last_m
    return Finding(
        outcome.ending.key,
        f"dark for {dark_s:g} s of the link; the last position is {east:.0f} m east, {north:.0f} m north, {up:.0f} m up",
    )


def item_set_back(case: Case) -> Finding:
    """Another station sets the first waypoint again while the vehicle flies to the third."""
    with case.station() as first, case.second_station() as second:

        def set_back() -> None:
            second.client.set_current(first.session.autopilot.home_in_item_0 + 2)

        outcome, _ = fly_mission(case, first, route_mission(case.vehicle.home, _AWAY_M), on_event=_once_at(2, set_back))
    _require_named(case, outcome, (Ending.MISSION_CHANGED,), (Ending.OFF_ROUTE, Ending.WIND_ABOVE_LIMITS))
    return Finding(outcome.ending.key, _incidents(outcome))


def slowed_down(case: Case) -> Finding:
    """Another station commands 2 m/s: the flight is late, and says so."""
    with case.station() as first, case.second_station() as second:

        def slow_down() -> None:
            second.client.command(Command.DO_CHANGE_SPEED, 1.0, 2.0, -1.0)

        outcome, _ = fly_mission(
            case,
            first,
            route_mission(case.vehicle.home, ((0.0, 30.0), (0.0, 300.0))),
            on_event=_once_at(1, slow_down),
            plan=lambda plan: replace(plan, needs=PlanNeeds(pace=_PACE, return_height_m=15.0, fence=False)),
        )
    _require_named(case, outcome, (Ending.LATE,), (Ending.OFF_ROUTE, Ending.PILOT_TOOK_OVER))
    return Finding(outcome.ending.key, _incidents(outcome))


def hold_ends(case: Case) -> Finding:
    """The fence is left for 3 s of vehicle time: the vehicle holds, and goes on when that is over."""
    began: list[float] = []
    with case.station() as station:

        def outside(_east: float, north: float) -> float:
            now_s = station.monitor.time_s or 0.0
            if north > 60.0 and not began:
                began.append(now_s)
            return 5.0 if began and now_s < began[0] + 3.0 else 0.0

        outcome, path = fly_mission(
            case,
            station,
            route_mission(case.vehicle.home, ((0.0, 30.0), (0.0, 200.0))),
            on_breach=OnBreach.HOLD,
            plan=lambda plan: replace(plan, volume=_volume(outside_fence_m=outside)),
        )
    require(any("now holds its position" in event for event in case.events), "it did not hold")
    require(
        any("the reason for the hold is gone" in event for event in case.events),
        f"the hold did not end: {case.events[-1]}",
    )
    return Finding(outcome.ending.key, f"farthest {max(north for _, north, _ in path.enu_m):.0f} m north")


def pilot_gives_back(case: Case) -> Finding:
    """A pilot takes the vehicle, flies it 93 m aside and gives it back in its mission: it is not stopped."""
    aside = Path(case.vehicle.home)  # ours reads nothing while the other station flies it
    with case.station() as first, case.second_station() as second:
        second.client.request_message_interval(m.GlobalPositionInt, 0.1)
        second.monitor.on_position = aside.take

        def take_aside() -> None:
            autopilot = first.session.autopilot
            second.session.listen(0.5)  # until what has waited in its buffer is read, its clock is old
            hold = Mode.GUIDED if case.autopilot == "ardupilot" else Mode.HOLD
            second.client.set_mode(custom_mode(autopilot, hold))
            lat, lon, alt = frame_at(case.vehicle.home).geodetic_from_enu((_ASIDE_M, 150.0, HEIGHT_M))
            to = second.client.vehicle
            second.client.send(
                m.CommandInt(
                    to.system_id,
                    to.component_id,
                    int(Frame.AMSL),
                    Command.DO_REPOSITION,
                    (-1.0, 1.0, 0.0, math.nan),
                    round(float(lat[0]) * 1e7),
                    round(float(lon[0]) * 1e7),
                    float(alt[0]),
                )
            )
            second.wait(
                lambda: bool(aside.enu_m) and aside.last_m[0] > 0.9 * _ASIDE_M,
                within_s=90.0,
                what="the pilot's station does not fly it aside",
            )
            second.client.set_mode(custom_mode(autopilot, Mode.MISSION))

        outcome, _ = fly_mission(
            case,
            first,
            route_mission(case.vehicle.home, ((0.0, 30.0), (0.0, 300.0))),
            on_event=_once_at(1, take_aside),
            on_breach=OnBreach.HOLD,
        )
    _require_named(case, outcome, (), (Ending.OFF_ROUTE, Ending.WIND_ABOVE_LIMITS))
    return Finding(outcome.ending.key, _incidents(outcome))


_READER = Codec(system_id=1, component_id=1)


def _steers(message: m.Message) -> bool:
    if isinstance(message, m.CommandLong):
        return message.command in _STEERING
    return isinstance(message, m.MissionCount | m.MissionItemInt | m.MissionSetCurrent | m.SetMode)


def _disturbed(case: Case, disturbance: Disturbance) -> Finding:
    """Fly, disturb the flight on the way to the second waypoint, and see what it is called."""
    if case.vehicle.inject is None and not disturbance.parameters.get(case.autopilot):
        return Finding("not-simulated", "this simulator has no such fault")
    with case.station() as first, case.second_station() as second:

        def act(fault: str, parameters: Mapping[str, float]) -> None:
            if case.vehicle.inject is not None:
                case.vehicle.inject(fault)
                return
            for name, value in parameters.items():
                second.client.set_parameter(name, value)

        begin = _once_at(1, lambda: act(disturbance.fault, disturbance.parameters.get(case.autopilot, {})))
        over = list[tuple[str, Mapping[str, float]]]([] if disturbance.over is None else [disturbance.over])

        def listen(event: FlightEvent) -> None:
            begin(event)
            if event.alarm and over and "the wind is too strong" in event.text:
                act(*over.pop())

        outcome, path = fly_mission(case, first, route_mission(case.vehicle.home, disturbance.route_m), on_event=listen)
    _require_named(case, outcome, disturbance.expected, disturbance.never)
    return Finding(outcome.ending.key, f"{_incidents(outcome)}; {_end(path)}")


def _once_at(waypoint: int, act: Callable[[], None]) -> Callable[[FlightEvent], None]:
    done: list[bool] = []

    def listen(event: FlightEvent) -> None:
        if event.kind is EventKind.WAYPOINT and event.waypoint == waypoint and not done:
            done.append(True)
            act()

    return listen


def _require_named(case: Case, outcome: FlightOutcome, expected: tuple[Ending, ...], never: tuple[Ending, ...]) -> None:
    kinds = {incident.kind for incident in outcome.incidents} | {outcome.ending}
    require(not expected or bool(kinds & set(expected)), f"no word of it: {_incidents(outcome)}; {case.events[-1]}")
    wrong = kinds & set(never)
    require(not wrong, f"a wrong cause, {', '.join(kind.key for kind in wrong)}: {_incidents(outcome)}")


def _incidents(outcome: FlightOutcome) -> str:
    return "; ".join(f"{i.kind.key}: {i.text}" for i in outcome.incidents) or "no incidents"


def _end(path: Path) -> str:
    east, north, up = path.last_m
    return f"last at {east:.0f} m east, {north:.0f} m north, {up:.0f} m up"


def _in_band(plan: FlightPlan) -> FlightPlan:
    return replace(plan, volume=_volume())


def _volume(outside_fence_m: Callable[[float, float], float] = lambda _east, _north: 0.0) -> OperatingVolume:
    return OperatingVolume(
        ground_up_m=lambda _east, _north: 0.0,
        outside_fence_m=outside_fence_m,
        min_height_agl_m=_BAND_M[0],
        max_height_agl_m=_BAND_M[1],
    )

"""Settings that change a mission, refused before arming; and what was checked, changed in flight by a second station."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from mission_io.model.items import Command
from sitl_tests.case import Case, Finding, Station
from sitl_tests.errors import require
from sitl_tests.flying import fly_mission, require_at_home
from sitl_tests.missions import fence_around, route_mission
from uavcover.flight.limits import set_parameter
from uavcover.flight.orders import FlightPlan, OnBreach, OperatingVolume, PlanNeeds
from uavcover.kernels.flight_time import Pace
from uavcover.model.track import Ending, EventKind, FlightEvent, FlightOutcome

_LOWER_M = 8.0
_NEAR_HOME_M, _HEIGHT_M = 3.0, 2.5
_BAND_M = (20.0, 30.0)
_WIDE_M, _OTHER_M = 300.0, 250.0
_NOT_FLOWN = frozenset({Ending.NOT_ARMED, Ending.NOT_READY, Ending.ARMING_REFUSED})
_HEADING = {"ardupilot": ("WP_YAW_BEHAVIOR", 0.0), "px4": ("MPC_YAW_MODE", 5.0)}


def refused_settings(case: Case) -> Finding:
    """The parameters of the case would spoil the mission: it is not flown."""
    with case.station() as station:
        outcome, _ = fly_mission(case, station, route_mission(case.vehicle.home), plan=_turning)
        armed = station.client.vehicle.armed
    if outcome.ending is Ending.LANDED:
        return Finding("flown", case.events[-1])
    require(outcome.ending in _NOT_FLOWN and not armed, f"it ended with {outcome.ending.key}, armed: {armed}")
    return Finding("refused", case.events[-1])


def other_station_minded(case: Case) -> Finding:
    """The vehicle listens to another ground station alone."""
    with case.station() as station:
        outcome, _ = fly_mission(case, station, route_mission(case.vehicle.home), upload=False)
    if outcome.ending is Ending.NOT_ARMED and "differs from the plan" in case.events[-1]:
        return Finding("heard", case.events[-1])
    require(outcome.ending is Ending.NOT_ARMED, f"it ended with {outcome.ending.key}: {case.events[-1]}")
    return Finding("refused", case.events[-1])


def home_moved(case: Case) -> Finding:
    """A second station moves home down in flight."""
    return _changed(case, partial(_lower, case))


def home_moved_return(case: Case) -> Finding:
    """The same, and our side flies it home: at the height at which it held, though heights above home are now others."""
    held_s: list[float] = []
    moved: list[float] = []
    with case.station() as first, case.second_station() as second:

        def interfere(event: FlightEvent) -> None:
            if event.kind is EventKind.WAYPOINT and event.waypoint == 2 and not moved:
                moved.append(event.time_s or 0.0)
                _lower(case, second)
            if "holds its position" in event.text:
                held_s.append(event.time_s or 0.0)

        mission = route_mission(case.vehicle.home)
        outcome, path = fly_mission(case, first, mission, on_event=interfere, on_breach=OnBreach.RETURN, plan=_turning)
    require(bool(held_s), f"it was not told to hold: {case.events[-1]}")
    require_at_home(path)
    after = [enu for time_s, enu in zip(path.times_s, path.enu_m, strict=True) if time_s > held_s[0]]
    arrived_m = max(up for east, north, up in after if math.hypot(east, north) < _NEAR_HOME_M)
    off_m = arrived_m - after[0][2]
    flown = f"it held at {after[0][2]:.1f} m and came home at {arrived_m:.1f} m above the planned home"
    require(abs(off_m) <= _HEIGHT_M, flown)
    return Finding(outcome.ending.key, flown)


def _lower(case: Case, second: Station) -> None:
    home = case.vehicle.home
    position = (home.lat_deg, home.lon_deg, home.alt_amsl_m - _LOWER_M)
    second.client.command(Command.DO_SET_HOME, 0.0, 0.0, 0.0, 0.0, *position)


def setting_changed(case: Case) -> Finding:
    """A second station changes in flight how the vehicle is headed, and the camera turns with it."""
    return _changed(case, lambda second: set_parameter(second.session, *_HEADING[case.autopilot]))


def fence_changed(case: Case) -> Finding:
    """A second station uploads another fence in flight."""
    with case.station() as station:
        fence = station.client.upload_and_verify(fence_around(case.vehicle.home, _WIDE_M))
        require(fence.passed, "the fence was read back changed")

    def smaller(second: Station) -> None:
        second.client.upload_and_verify(fence_around(case.vehicle.home, _OTHER_M), in_flight=True)

    return _changed(case, smaller)


def _changed(case: Case, change: Callable[[Station], object]) -> Finding:
    """Fly; on the way to the second waypoint the second station changes something."""
    changed_s: list[float] = []
    with case.station() as first, case.second_station() as second:

        def interfere(event: FlightEvent) -> None:
            if event.kind is EventKind.WAYPOINT and event.waypoint == 1 and not changed_s:
                changed_s.append(event.time_s or 0.0)
                change(second)

        outcome, _ = fly_mission(case, first, route_mission(case.vehicle.home), on_event=interfere, plan=_turning)
    require(bool(changed_s), f"it never flew to the second waypoint: {case.events[-1]}")
    return Finding(outcome.ending.key, _reported(outcome, changed_s[0]))


def _reported(outcome: FlightOutcome, changed_s: float) -> str:
    if not outcome.incidents:
        return "nothing was told"
    first = outcome.incidents[0]
    return f"told {(first.begin_s or 0.0) - changed_s:.1f} s after it was changed: {first.text}"


def _turning(plan: FlightPlan) -> FlightPlan:
    """With a camera that turns with the legs, over flat ground at home's height."""
    low_m, high_m = _BAND_M
    return replace(
        plan,
        needs=PlanNeeds(
            pace=Pace(5.0, 1.0, 1.0),
            return_height_m=1.0,
            fence=False,
            camera_turns=True,
        ),
        volume=OperatingVolume(
            ground_up_m=lambda _e, _n: 0.0,
            outside_fence_m=lambda _e, _n: 0.0,
            min_height_agl_m=low_m,
            max_height_agl_m=high_m,
        ),
    )

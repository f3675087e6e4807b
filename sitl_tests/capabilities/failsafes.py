"""What the vehicle does by itself when it leaves its fence or hears no ground station any more, and what we make of it."""

import numpy as np

from mission_io.autopilots.autopilot import Mode
from sitl_tests.case import Case, Finding, Station
from sitl_tests.errors import require
from sitl_tests.flying import fly_mission, require_at_home
from sitl_tests.missions import fence_around, rally_points, route_mission
from sitl_tests.relay import Relay
from uavcover.flight.orders import custom_mode
from uavcover.model.track import Ending, EventKind, FlightEvent

_FENCE_HALF_WIDTH_M = 60.0
_OUTWARD_M = ((0.0, 30.0), (0.0, 150.0))
_AWAY_M = ((0.0, 30.0), (0.0, 1000.0))
"""Long enough that the failsafe comes on the way, whatever the time after which it does."""
_RALLY_M = (60.0, 420.0)
_NEAR_M = 5.0
_NOT_FLOWN = frozenset({Ending.NOT_ARMED, Ending.NOT_READY, Ending.ARMING_REFUSED, Ending.NOT_STARTED})


def fence_breach(case: Case) -> Finding:
    """A mission leads out of the fence."""
    home = case.vehicle.home
    with case.station() as station:
        fence = station.client.upload_and_verify(fence_around(home, _FENCE_HALF_WIDTH_M))
        require(fence.passed, "the fence was read back changed")
        outcome, path = fly_mission(case, station, route_mission(home, _OUTWARD_M))
        reaction = _reaction(station)
    said = f"our side calls it {outcome.ending.key}"
    if outcome.ending in _NOT_FLOWN:
        return Finding("refuses", f"it does not take off with such a mission; {said}: {case.events[-1]}")
    farthest_m = max(north for _, north, _ in path.enu_m)
    if reaction == "returns":
        require_at_home(path)
        require(outcome.ending is Ending.FENCE_BREACHED, said)
    return Finding(reaction, f"fence at {_FENCE_HALF_WIDTH_M:g} m north, it came to {farthest_m:.0f} m; {said}")


def link_loss(case: Case) -> Finding:
    """On the way, nothing from any ground station reaches the vehicle any more; we still hear it."""
    lost_s: list[float] = []
    with Relay(case.vehicle.url, seed=case.seed) as relay, case.station(relay.url) as station:

        def cut(event: FlightEvent) -> None:
            if event.kind is EventKind.WAYPOINT and event.waypoint == 1 and not lost_s:
                lost_s.append(event.time_s or 0.0)
                relay.cut_to_vehicle()

        outcome, path = fly_mission(case, station, route_mission(case.vehicle.home, _AWAY_M), on_event=cut)
        reaction = _reaction(station)
    said = f"our side calls it {outcome.ending.key}"
    require(bool(lost_s), f"it did not come to the second waypoint; {said}: {case.events[-1]}")
    if reaction == "returns":
        require_at_home(path)
        require(outcome.ending is Ending.LINK_LOST, said)
    return Finding(reaction, f"cut off on the way to the second waypoint; {said}")


def rally_return(case: Case) -> Finding:
    """As ``link_loss``, and where it returns from a rally point is nearer than home."""
    with Relay(case.vehicle.url, seed=case.seed) as relay, case.station(relay.url) as station:
        rally = station.client.upload_and_verify(rally_points(case.vehicle.home, (_RALLY_M,)))
        require(rally.passed, "the rally point was read back changed")
        reported: list[FlightEvent] = []

        def cut(event: FlightEvent) -> None:
            if event.kind is EventKind.WAYPOINT and event.waypoint == 1 and not reported:
                reported.append(event)
                relay.cut_to_vehicle()

        outcome, path = fly_mission(case, station, route_mission(case.vehicle.home, _AWAY_M), on_event=cut)
        reaction = _reaction(station)
    east, north, up = path.last_m
    said = f"it {reaction} to {east:.0f} m east, {north:.0f} m north, {up:.0f} m up; our side calls it {outcome.ending.key}"
    positions = {"rally": _RALLY_M, "home": (0.0, 0.0), "flies-on": _AWAY_M[-1]}
    for word, position in positions.items():
        if np.hypot(east - position[0], north - position[1]) <= _NEAR_M and (up <= _NEAR_M or word == "flies-on"):
            return Finding(word, said)
    return Finding("elsewhere", said)


def _reaction(station: Station) -> str:
    """What the vehicle changed to by itself."""
    named = {Mode.RETURN: "returns", Mode.LAND: "lands", Mode.HOLD: "holds"}
    autopilot = station.session.autopilot
    mission = custom_mode(autopilot, Mode.MISSION)
    after = station.modes[station.modes.index(mission) :] if mission in station.modes else []
    for mode, word in named.items():
        if custom_mode(autopilot, mode) in after:
            return word
    return "flies-on"

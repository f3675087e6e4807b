"""Small flights, each compared with the mission that another station downloads from the vehicle."""

import math
from dataclasses import replace

from mission_io.client.client import answer_terrain_requests
from mission_io.errors import CommandRefusedError, MisuseError
from mission_io.model.items import Command, Frame, GeoPoint, Mission, MissionType
from mission_io.protocol.terrain import TerrainAnswers
from mission_io.wire.messages import GlobalPositionInt
from sitl_tests.case import Case, Finding, Station
from sitl_tests.errors import CheckFailedError, require
from sitl_tests.flying import (
    fly_mission,
    frame_at,
    require_at_home,
    require_flown,
    take_off,
    wait_for_waypoint,
    wait_until_landed,
    waypoints_held,
)
from sitl_tests.matrix import WORKS
from sitl_tests.missions import DIAMOND_M, FIRST_WAYPOINT_ITEM, route_mission
from uavcover.flight.arming import request_telemetry, wait_until_ready
from uavcover.flight.follow import hold
from uavcover.flight.orders import custom_mode
from uavcover.flight.session import first_seq, fly_from_item, hold_mode, set_mode
from uavcover.model.track import Ending, EventKind, FlightEvent, FlightOutcome

_ARM_TRIES = 10
_HOLDS_WITHIN_M = 3.0
_ELSEWHERE_DEG = 0.003
_PAUSE_S = 15.0
_COMES_TO_REST_S = 100.0
_AT_REST_M_S = 0.3


def arming(case: Case) -> Finding:
    """It gets ready, arms and disarms, and says when."""
    with case.station() as station:
        request_telemetry(station.session)
        wait_until_ready(station.session)
        ready_s = station.monitor.time_s
        set_mode(station.session, hold_mode(station.session))
        refusals = _arm(station)
        station.wait(lambda: station.client.vehicle.armed, within_s=10.0, what="the heartbeat does not show it armed")
        station.client.command(Command.COMPONENT_ARM_DISARM, 0.0)
        wait_until_landed(station)
    return Finding(WORKS, f"ready {ready_s:.1f} s after it was switched on, {refusals} refusals before it armed")


def fly_square(case: Case) -> Finding:
    """A small mission from arming to disarming by ``fly``; every waypoint of the downloaded mission is passed."""
    with case.station() as station:
        outcome, path = fly_mission(case, station, route_mission(case.vehicle.home))
    _require_landed(case, outcome)
    rate_hz = outcome.sample_count / outcome.duration_s
    worst_m = require_flown(path, waypoints_held(case))
    return Finding(
        WORKS, f"{outcome.duration_s:.0f} s, {rate_hz:.1f} samples a second, waypoints passed within {worst_m:.1f} m"
    )


def terrain_flight(case: Case) -> Finding:
    """It arms for a mission above terrain because our side answers its requests for the ground, and flies it."""
    home = case.vehicle.home
    # The simulator's ground is flat, and its time runs fast.
    answers = TerrainAnswers(lambda positions: [home.alt_amsl_m] * len(positions), parts_per_s=1000.0)
    mission = route_mission(home)
    above = tuple(
        replace(item, frame=Frame.ABOVE_TERRAIN) if item.command == Command.NAV_WAYPOINT else item
        for item in mission.items
    )
    with case.station() as station:
        answer_terrain_requests(station.client, answers)
        try:
            outcome, path = fly_mission(case, station, Mission(mission.home, above))
        except MisuseError as error:  # our own check knows who has no terrain frames
            return Finding("refused", str(error))
    _require_landed(case, outcome)
    held = [item for item in case.held(MissionType.MISSION) if item.frame is Frame.ABOVE_TERRAIN]
    require(bool(held), "the vehicle holds no item above terrain")
    positions = [frame_at(home).enu_from_geodetic(i.lat_deg, i.lon_deg, home.alt_amsl_m + i.alt_m)[0] for i in held]
    worst_m = require_flown(path, [(float(e), float(n), float(u)) for e, n, u in positions])
    counts = answers.counts
    require(counts.parts_sent > 0 and not counts.refused, f"its requests were not answered: {counts}")
    return Finding(
        WORKS,
        f"{counts.blocks} blocks, {counts.parts_sent} parts sent; waypoints above terrain passed within {worst_m:.1f} m",
    )


def second_flight(case: Case) -> Finding:
    """The same vehicle flies a second mission after it has landed; nothing of the first one is taken for the second."""
    with case.station() as station:
        first, _ = fly_mission(case, station, route_mission(case.vehicle.home))
        _require_landed(case, first)
    with case.station() as station:
        second, path = fly_mission(case, station, route_mission(case.vehicle.home, DIAMOND_M, height_m=30.0))
    _require_landed(case, second)
    worst_m = require_flown(path, waypoints_held(case))
    return Finding(WORKS, f"the second flight's waypoints passed within {worst_m:.1f} m")


def stop_and_return(case: Case) -> Finding:
    """The user stops on the way: it holds, takes the way home that is uploaded then, and lands at home."""
    stopped: list[str] = []
    with case.station() as station:

        def stop(event: FlightEvent) -> None:
            if event.kind is EventKind.WAYPOINT and event.waypoint == 2:
                stopped.append(event.text)

        outcome, path = fly_mission(
            case, station, route_mission(case.vehicle.home), on_event=stop, stop=lambda: len(stopped)
        )
    require(outcome.ending is Ending.RETURNED, f"it ended with {outcome.ending.key}: {case.events[-1]}")
    require_at_home(path)
    return Finding(WORKS, f"{outcome.waypoints_reached} waypoints flown before the stop, then home")


def wrong_home(case: Case) -> Finding:
    """The mission was planned for another place: the vehicle is not armed."""
    home = case.vehicle.home
    elsewhere = GeoPoint(home.lat_deg + _ELSEWHERE_DEG, home.lon_deg, home.alt_amsl_m)
    with case.station() as station:
        outcome, _ = fly_mission(case, station, route_mission(elsewhere), home=elsewhere)
        armed = station.client.vehicle.armed
    require(outcome.ending is Ending.NOT_ARMED and not armed, f"it ended with {outcome.ending.key}, armed: {armed}")
    return Finding("refused", case.events[-1])


def pause_and_resume(case: Case) -> Finding:
    """On the way it is told to wait where it is, comes to rest, stays, goes on, and flies the rest, all by ``fly``."""
    begun_s: list[float] = []
    at_rest_s: list[float] = []
    with case.station() as station:

        def begin(event: FlightEvent) -> None:
            if event.kind is EventKind.WAYPOINT and event.waypoint == 1 and not begun_s:
                begun_s.append(event.time_s or 0.0)

        def pause() -> bool:
            if not begun_s:
                return False
            position = station.monitor.latest(GlobalPositionInt)
            held = custom_mode(station.session.autopilot, hold_mode(station.session)) in station.modes[-1:]
            if position is not None and held and not at_rest_s and _speed_m_s(position) < _AT_REST_M_S:
                at_rest_s.append(position.time_boot_s)
            now_s = station.monitor.time_s or 0.0
            return now_s < at_rest_s[0] + _PAUSE_S if at_rest_s else now_s < begun_s[0] + _COMES_TO_REST_S

        outcome, path = fly_mission(case, station, route_mission(case.vehicle.home), on_event=begin, pause=pause)
    _require_landed(case, outcome)
    require(bool(at_rest_s), f"it did not come to rest within {_COMES_TO_REST_S:g} s")
    moved_m = path.moved_m(at_rest_s[0], at_rest_s[0] + _PAUSE_S)
    require(moved_m <= _HOLDS_WITHIN_M, f"it moved {moved_m:.1f} m while it was to wait")
    worst_m = require_flown(path, waypoints_held(case))
    return Finding(
        WORKS, f"moved {moved_m:.1f} m in {_PAUSE_S:g} s of waiting; waypoints passed within {worst_m:.1f} m"
    )


def _speed_m_s(position: GlobalPositionInt) -> float:
    return math.hypot(position.velocity_north_m_s, position.velocity_east_m_s, position.velocity_down_m_s)


def change_in_flight(case: Case) -> Finding:
    """It holds, another mission is uploaded in the air, read back, and flown from its first waypoint."""
    other = route_mission(case.vehicle.home, DIAMOND_M, height_m=30.0)
    with case.station() as station:
        path = take_off(case, station)
        wait_for_waypoint(station, 1)
        hold(station.session, "told to hold for another mission")
        checked = station.client.upload_and_verify(other, in_flight=True)
        require(checked.passed, "the new mission was read back changed")
        mode = station.session.mode_name
        fly_from_item(station.session, first_seq(station.session) + FIRST_WAYPOINT_ITEM)
        wait_until_landed(station)
    worst_m = require_flown(path, waypoints_held(case))
    return Finding(WORKS, f"after the upload it was in {mode}; the new waypoints passed within {worst_m:.1f} m")


def _arm(station: Station) -> int:
    """How often arming was refused before it was accepted."""
    for refusals in range(_ARM_TRIES):
        try:
            station.client.command(Command.COMPONENT_ARM_DISARM, 1.0)
        except CommandRefusedError:
            station.wait_s(1.0)
        else:
            return refusals
    raise CheckFailedError(f"arming was refused {_ARM_TRIES} times{station.session.recent_warnings}")


def _require_landed(case: Case, outcome: FlightOutcome) -> None:
    require(outcome.ending is Ending.LANDED, f"it ended with {outcome.ending.key}: {case.events[-1]}")

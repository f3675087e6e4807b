"""Small flights, each compared with the mission that another station downloads from the vehicle."""

import numpy as np

from mission_io.errors import CommandRefusedError
from mission_io.items import Command, Mission
from sitl_tests.case import Case, Finding, Station
from sitl_tests.errors import CheckFailedError, require
from sitl_tests.flying import (
    Path,
    plan_of,
    require_flown,
    take_off,
    wait_for_waypoint,
    wait_until_landed,
    waypoints_held,
)
from sitl_tests.matrix import WORKS
from sitl_tests.missions import DIAMOND_M, FIRST_WAYPOINT_ITEM, route_mission
from uavcover.errors import VehicleError
from uavcover.flight.fly import Ending, fly
from uavcover.flight.readiness import request_telemetry, wait_until_ready
from uavcover.flight.return_home import hold
from uavcover.flight.start import first_seq, hold_mode, set_current_item, set_mode, start_mission

_ARM_TRIES = 10
_HOLDS_WITHIN_M = 3.0
_PAUSE_S = 15.0


def arming(case: Case) -> Finding:
    """It gets ready, arms and disarms, and says when."""
    with case.station() as station:
        request_telemetry(station.conversation)
        wait_until_ready(station.conversation)
        ready_s = station.monitor.time_s
        set_mode(station.conversation, hold_mode(station.conversation))
        refusals = _arm(station)
        station.wait(lambda: station.client.vehicle.armed, within_s=10.0, what="the heartbeat does not show it armed")
        station.client.command(Command.COMPONENT_ARM_DISARM, 0.0)
        wait_until_landed(station)
    return Finding(WORKS, f"ready {ready_s:.1f} s after it was switched on, {refusals} refusals before it armed")


def fly_square(case: Case) -> Finding:
    """A small mission from arming to disarming by ``fly``; every waypoint of the downloaded mission is passed."""
    mission = route_mission(case.vehicle.home)
    path = Path(case.vehicle.home)
    with case.station() as station:
        require(station.client.upload_and_verify(mission).passed, "the mission was read back changed")
        outcome = fly(
            station.client, station.monitor, plan_of(mission, case.vehicle.home),
            on_sample=lambda sample: path.enu_m.append((sample.east_m, sample.north_m, sample.up_m)),
            on_event=lambda event: case.events.append(event.text),
            plan_return=_no_way_home, confirmed=True,
        )  # fmt: skip
    require(outcome.ending is Ending.LANDED, f"it ended: {outcome.ending.value}")
    rate_hz = outcome.sample_count / outcome.duration_s
    worst_m = require_flown(path, waypoints_held(case))
    return Finding(
        WORKS, f"{outcome.duration_s:.0f} s, {rate_hz:.1f} samples a second, waypoints passed within {worst_m:.1f} m"
    )


def pause_and_resume(case: Case) -> Finding:
    """On the way it is told to hold, stays, goes on, and flies the rest."""
    with case.station() as station:
        path = take_off(case, station)
        wait_for_waypoint(station, 1)
        hold(station.conversation)
        before = len(path.enu_m)
        station.wait_s(_PAUSE_S)
        still = np.array(path.enu_m[before:])
        moved_m = float(np.linalg.norm(still - still[0], axis=1).max())
        start_mission(station.conversation)
        wait_until_landed(station)
    require(moved_m <= _HOLDS_WITHIN_M, f"it moved {moved_m:.1f} m while it was to hold")
    worst_m = require_flown(path, waypoints_held(case))
    return Finding(WORKS, f"held within {moved_m:.1f} m for {_PAUSE_S:g} s; waypoints passed within {worst_m:.1f} m")


def change_in_flight(case: Case) -> Finding:
    """Another mission is uploaded in the air, read back, and flown from its first waypoint."""
    other = route_mission(case.vehicle.home, DIAMOND_M, height_m=30.0)
    with case.station() as station:
        path = take_off(case, station)
        wait_for_waypoint(station, 1)
        checked = station.client.upload_and_verify(other, in_flight=True)
        require(checked.passed, "the new mission was read back changed")
        set_current_item(station.conversation, first_seq(station.conversation) + FIRST_WAYPOINT_ITEM)
        mode = station.conversation.mode_name
        start_mission(station.conversation)
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
    raise CheckFailedError(f"arming was refused {_ARM_TRIES} times{station.conversation.complaints}")


def _no_way_home(lat_deg: float, lon_deg: float, alt_amsl_m: float) -> Mission:
    raise VehicleError(f"no way home was planned from {lat_deg:.6f}, {lon_deg:.6f}, {alt_amsl_m:.0f} m")

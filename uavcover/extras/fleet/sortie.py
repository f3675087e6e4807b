"""A sortie of a fleet: its ending, its vehicle's landing, its battery, and its return."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mission_io.autopilots.autopilot import wire_items
from mission_io.autopilots.comparison import compare_items, fault_text
from mission_io.errors import MissionIoError, VehicleSilentError
from mission_io.model.items import Frame, Mission, MissionType
from mission_io.wire.messages import HomePosition, SysStatus
from uavcover.errors import InputError, VehicleError
from uavcover.extras.fleet.clock import FleetClock
from uavcover.extras.fleet.jobs import Job
from uavcover.flight.connect import Connected, check_home
from uavcover.kernels.arrays import FloatArray
from uavcover.missions.mission_compiler import AUTOPILOTS, CompiledMission
from uavcover.model.outcome import Ending, FlightOutcome
from uavcover.scenario.site import Site

_LESS_AT_START = 5.0
"""Percent by which a battery may tell less than the whole sortie needs: whole numbers, and a while of standing ready. What it
lacks in the end is left to another sortie: a vehicle in flight goes home before it uses its reserve."""
_LATELY_S = 5.0
_KNOWS_HOME_S = 120.0
"""Time that a vehicle may take after power-up until it knows its position."""


@dataclass(slots=True)
class FlownSortie:
    """Ending of a sortie.

    Attributes:
        job: the sortie.
        vehicle: who flew it.
        began_s: its take-off, since the first take-off of all; none when it never began.
        outcome: how it ended; none when it failed before.
        error: why it failed, as text.
        down: whether the vehicle is known to be on the ground.
    """

    job: Job
    vehicle: int
    began_s: float | None = None
    outcome: FlightOutcome | None = None
    error: str = ""
    down: bool = True

    @property
    def planned_s(self) -> float:
        """Its planned take-off, since the first take-off of all."""
        return self.job.planned_s

    @property
    def keeps_reserve(self) -> bool:
        """Whether it ended early for its battery's reserve, and its vehicle can fly on with another one."""
        return self.outcome is not None and self.outcome.ending is Ending.RESERVE_KEPT

    def as_json(self) -> dict[str, Any]:
        """For ``--json``."""
        ended: dict[str, Any] = {"ending": None} if self.outcome is None else self.outcome.as_json()
        return {
            "sortie": self.job.sortie, "run": str(self.job.folder), "vehicle": self.vehicle, "began_s": self.began_s,
            "planned_s": self.job.planned_s, "error": self.error or None, **ended,
        }  # fmt: skip


def is_down(connected: Connected) -> bool:
    """Whether a vehicle is known to be on the ground, by its last messages, if they are recent."""
    client, monitor = connected.client, connected.monitor
    try:
        fresh = client.heartbeat_age_s < _LATELY_S and monitor.silence_s(client.clock.now()) < _LATELY_S
        return fresh and (not client.vehicle.armed or monitor.on_ground is True)
    except MissionIoError:
        return False


def wait_for_home(
    connected: Connected, site: Site, compiled: CompiledMission, clock: FleetClock, *, stopped: Callable[[], bool]
) -> None:
    """Check the vehicle's home as soon as it knows it: with a new battery that takes a while.

    Raises:
        VehicleSilentError: it does not tell it.
        VehicleError: it is not the planned one.
    """
    until_s = clock.now() + _KNOWS_HOME_S
    while True:
        try:
            return check_home(connected, site, compiled)
        except VehicleSilentError:
            if stopped() or clock.now() > until_s:
                raise


def whose_home(connected: Connected, sites: Mapping[int, Site]) -> int | None:
    """The vehicle of the nearest home in the sites to a vehicle's reported home; none where no site fits."""
    try:
        reported = connected.client.request_message(HomePosition)
    except MissionIoError:
        return None
    away_m = {}
    for number, site in sites.items():
        if site.frame is not None and site.home_m is not None:
            place_m = site.frame.enu_from_geodetic(reported.lat_deg, reported.lon_deg, reported.alt_amsl_m)[0]
            away_m[number] = float(np.hypot(*(place_m - site.home_m)[:2]))
    nearest = min(away_m, key=away_m.__getitem__, default=None)
    if nearest is None or away_m[nearest] > sites[nearest].scenario.limits.max_home_error_m:
        return None
    return nearest


def require_own_mission(connected: Connected, compiled: CompiledMission, urls: Sequence[str]) -> None:
    """Refuse a vehicle that two links lead to: it holds the sortie that it was given last.

    Args:
        connected: the vehicle.
        compiled: what it was given.
        urls: all links that lead to a vehicle of this system id.

    Raises:
        VehicleError: it does not hold its own.
    """
    if len(urls) < 2 or connected.url.startswith("mock:"):
        return
    autopilot = AUTOPILOTS[connected.autopilot]
    held = connected.client.download(MissionType.MISSION)
    fault = fault_text(compare_items(wire_items(compiled.mission, autopilot), held, autopilot))
    if fault is not None:
        raise VehicleError(
            f"system {connected.client.vehicle.system_id} at {connected.url} has another sortie than the assigned one ({fault}): "
            f"--to {', '.join(sorted(urls))} may lead to the same vehicle; nothing was armed"
        )


def lacking_battery(job: Job, connected: Connected) -> str | None:
    """Deficit of a battery for a sortie and its reserve; none where it is enough, or reports nothing."""
    vehicle, status = job.site.scenario.vehicle, connected.monitor.latest(SysStatus)
    percent = None if status is None else status.battery_remaining_percent
    if job.battery_used is None or percent is None:
        return None
    needed = 100.0 * (job.battery_used + vehicle.reserve_fraction)
    return None if percent + _LESS_AT_START >= min(needed, 100.0) else f"battery {percent:.0f} of {needed:.0f} %"


def pace_home_m_s(site: Site) -> tuple[float, float]:
    """Speeds of a vehicle on its return, over ground and vertically, with the slow last metres in it."""
    vehicle = site.scenario.vehicle
    return vehicle.cruise_speed_m_s, 0.5 * min(vehicle.max_climb_m_s, vehicle.max_descent_m_s)


def places_m(mission: Mission, site: Site) -> FloatArray:
    """(k, 3) ENU, the positions of a mission home; at least two."""
    if site.frame is None or mission.home is None:
        raise InputError(f"scenario {site.scenario.name}: has no position on Earth")
    places = [
        site.frame.enu_from_geodetic(
            item.lat_deg,
            item.lon_deg,
            item.alt_m + (mission.home.alt_amsl_m if item.frame is Frame.ABOVE_HOME else 0.0),
        )[0]
        for item in mission.items
        if item.has_position
    ]
    return np.array([places[0], *places])

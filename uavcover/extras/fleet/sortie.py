"""Sorties of a fleet, on the clock that all vehicles share: how each ends, and takes over what another has left."""

import math
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from mission_io.autopilots.comparison import compare_items, fault_text
from mission_io.autopilots.mission_lists import wire_items
from mission_io.errors import MissionIoError, VehicleSilentError
from mission_io.model.items import Frame, Mission, MissionType
from mission_io.wire.messages import GlobalPositionInt, HomePosition
from mission_io.wire.telemetry_messages import SysStatus
from uavcover.errors import InfeasibleError, InputError, UavcoverError, VehicleError
from uavcover.extras.fleet.board import Board
from uavcover.extras.fleet.jobs import Job, OnLoss, Queues, for_another, left_of, require_gain, rest_of, time_for
from uavcover.extras.fleet.traffic import FleetPhase, Traffic
from uavcover.extras.fleet.tuning import FLEET
from uavcover.flight.compiled_flight import check_home
from uavcover.flight.connect import Connected
from uavcover.flight.watch import RESERVE, BatteryUse
from uavcover.kernels.arrays import FloatArray
from uavcover.missions.mission_compiler import AUTOPILOTS, CompiledMission
from uavcover.missions.objectives import return_path
from uavcover.model.route import Route
from uavcover.model.track import Ending, FlightOutcome
from uavcover.scenario.site import Site


class FleetClock(Protocol):
    """The clock of the whole fleet, as the thread of one vehicle uses it."""

    def now(self) -> float:
        """Vehicle seconds; only differences mean something."""

    def wait(self, seconds: float) -> None:
        """Let so much time pass."""

    def taking_part(self) -> AbstractContextManager[None]:
        """As long as the calling thread follows a vehicle."""


class RealClock:
    """The computer's clock, as fast as the vehicles fly.

    Args:
        speed: vehicle seconds per second.
    """

    def __init__(self, speed: float = 1.0) -> None:
        self._speed = speed

    def now(self) -> float:
        """Vehicle seconds."""
        return time.monotonic() * self._speed

    def wait(self, seconds: float) -> None:
        """Sleep."""
        time.sleep(seconds / self._speed)

    @contextmanager
    def taking_part(self) -> Iterator[None]:
        """Nothing to do."""
        yield


@dataclass(slots=True)
class FlownSortie:
    """Ending of a sortie."""

    job: Job  # the sortie
    vehicle: int  # who flew it
    began_s: float | None = None  # its take-off, since the first take-off of all; None when it never began
    outcome: FlightOutcome | None = None  # how it ended; None when it failed before
    error: str = ""  # why it failed, as text
    down: bool = True  # whether the vehicle is known to be on the ground

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
        fresh = client.heartbeat_age_s < FLEET.recent_s and monitor.silence_s(client.clock.now()) < FLEET.recent_s
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
    until_s = clock.now() + FLEET.knows_home_s
    while True:
        try:
            return check_home(connected, site, compiled)
        except VehicleSilentError:
            if stopped() or clock.now() > until_s:
                raise


def whose_home(connected: Connected, sites: Mapping[int, Site]) -> int | None:
    """The vehicle of the nearest home in the sites to a vehicle's reported home; None where no site fits."""
    try:
        reported = connected.client.request_message(HomePosition)
    except MissionIoError:
        return None
    away_m = {}
    for number, site in sites.items():
        if site.frame is not None and site.home_m is not None:
            position_m = site.frame.enu_from_geodetic(reported.lat_deg, reported.lon_deg, reported.alt_amsl_m)[0]
            away_m[number] = float(np.hypot(*(position_m - site.home_m)[:2]))
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
            f"system {connected.client.vehicle.system_id} at {connected.url} does not have the assigned sortie "
            f"({fault}): the addresses --to {', '.join(sorted(urls))} may lead to one vehicle; no vehicle was armed"
        )


def lacking_battery(job: Job, connected: Connected) -> str | None:
    """Deficit of a battery for a sortie and its reserve; None where it is enough, or reports nothing."""
    vehicle, status = job.site.scenario.vehicle, connected.monitor.latest(SysStatus)
    percent = None if status is None else status.battery_remaining_percent
    if job.battery_used is None or percent is None:
        return None
    needed = 100.0 * (job.battery_used + vehicle.reserve_fraction)
    return None if percent + FLEET.less_at_start >= min(needed, 100.0) else f"battery {percent:.0f} of {needed:.0f} %"


def pace_home_m_s(site: Site) -> tuple[float, float]:
    """Speeds of a vehicle on its return, over ground and vertically, with the slow last metres in it."""
    vehicle = site.scenario.vehicle
    return vehicle.cruise_speed_m_s, 0.5 * min(vehicle.max_climb_m_s, vehicle.max_descent_m_s)


def positions_m(mission: Mission, site: Site) -> FloatArray:
    """(k, 3) ENU, the positions of a mission home; at least two."""
    if site.frame is None or mission.home is None:
        raise InputError(f"scenario {site.scenario.name} has no position on Earth; add an [origin]")
    positions = [
        site.frame.enu_from_geodetic(
            item.lat_deg,
            item.lon_deg,
            item.alt_m + (mission.home.alt_amsl_m if item.frame is Frame.ABOVE_HOME else 0.0),
        )[0]
        for item in mission.items
        if item.has_position
    ]
    return np.array([positions[0], *positions])


_STAYS_OUT = (
    "it receives no more sorties, because its state is unknown and its sorties were reassigned; check the vehicle, "
    "and fly the remaining sorties afterwards"
)


class LostVehicle:
    """Messages of a vehicle whose flight was given up because it was silent.

    Args:
        job: what it flew.
        connected: its link, still open.
        traffic: that keeps the others apart.
    """

    def __init__(self, job: Job, connected: Connected, traffic: Traffic) -> None:
        self._job, self._connected, self._traffic = job, connected, traffic
        self._heard = False

    def look(self, clock: FleetClock, seconds: float) -> str | None:
        """Listen for at most this time, and inform the others of each message.

        Returns:
            What the user must know: that it is heard again, or is down; None when there is nothing new.
        """
        client, monitor, site = self._connected.client, self._connected.monitor, self._job.site
        client.poll(seconds)
        now = clock.now()
        here = monitor.latest(GlobalPositionInt)
        if here is None or site.frame is None or monitor.silence_s(client.clock.now()) > FLEET.recent_s:
            return None
        position_m = site.frame.enu_from_geodetic(here.lat_deg, here.lon_deg, here.alt_amsl_m)[0]
        where = f"at {here.lat_deg:.6f}, {here.lon_deg:.6f}"
        if is_down(self._connected):
            self._traffic.landed(self._job.name, now)
            return f"sends messages again, on the ground {where}; {_STAYS_OUT}"
        self._traffic.moved(self._job.name, now, np.asarray(position_m))
        again = f"sends messages again, in the air {where}; the others keep their distance; {_STAYS_OUT}"
        message, self._heard = None if self._heard else again, True
        return message


class ReserveWatch:
    """Check repeatedly whether a vehicle in flight must return for its battery.

    Args:
        job: what it flies.
        connected: tells its battery.
        traffic: knows where it is.
    """

    def __init__(self, job: Job, connected: Connected, traffic: Traffic) -> None:
        self._job, self._connected, self._traffic = job, connected, traffic
        vehicle, flight_s = job.site.scenario.vehicle, job.timeline.duration_s
        self._use = BatteryUse(vehicle, 100.0 * (job.battery_used or 0.0) / flight_s)
        self._next_s = -math.inf

    def may_wait_s(self, now: float) -> float:
        """Time that its battery lets it hold before it flies its mission to the end."""
        return self._use.may_wait_s(self._traffic.lands_s(self._job.name) - now)

    def must_go_home(self, now: float, *, aloft_s: float) -> str | None:
        """Reason to return now, as text; none while it may fly on, or reports no battery.

        Its return is given to it before it stops. While others are in that way it flies on: the mission is kept apart from
        theirs and brings it home, too; to hold and wait would only empty the battery.

        Args:
            now: present time.
            aloft_s: time since its take-off.
        """
        status = self._connected.monitor.latest(SysStatus)
        percent = None if status is None else status.battery_remaining_percent
        if percent is None or self._use.vehicle.endurance_s is None or now < self._next_s:
            return None
        self._next_s = now + FLEET.reserve_every_s
        use, rest_s = self._use, self._traffic.lands_s(self._job.name) - now
        use.take(percent, aloft_s=aloft_s)
        if use.lasts_home(rest_s) or use.lasts_on(rest_s):  # the return is shorter than that
            return None
        try:
            path_m, home_s = return_path(self._job.site, self._traffic.position_m(self._job.name))
        except UavcoverError:  # the ground below the way is not known
            return None
        if use.allows_on(rest_s=rest_s, home_s=home_s):
            return None
        if not self._traffic.give_return(self._job.name, now, path_m, within_s=home_s + RESERVE.to_turn_s):
            return None
        reserve = 100.0 * use.vehicle.reserve_fraction
        return (
            f"the battery has {percent:.0f} % left and loses {60.0 * use.each_s:.1f} % per minute: the return takes "
            f"{home_s:.0f} s and the remaining sortie {rest_s:.0f} s, which would use the reserve of {reserve:.0f} "
            "%; the vehicle flies home, and another sortie continues here"
        )


class FleetWork:
    """The sorties of a fleet that are flown, wait, or are left.

    Args:
        jobs: the sorties.
        traffic: keeps the vehicles apart.
        board: tells the user.
        on_loss: what becomes of what a lost vehicle was to see.

    Attributes:
        flyers: the vehicles that have a sortie when all begin.
        queues: the sorties that no vehicle has begun.
        current: what each vehicle flies, or is about to fly.
        free_s: when each vehicle that has flown is ready with a new battery.
        left: names of sorties, or of their rests, without a vehicle.
    """

    def __init__(self, jobs: Sequence[Job], traffic: Traffic, board: Board, on_loss: OnLoss) -> None:
        self._traffic, self._board, self._on_loss = traffic, board, on_loss
        self._sites: dict[int, Site] = {job.vehicle: job.site for job in reversed(jobs)}
        self.flyers = sorted(self._sites)
        self.queues = Queues(set(self.flyers))
        self.current: dict[int, Job] = {}
        self.free_s: dict[int, float] = {}
        self.left: list[str] = []
        for job in jobs:
            self._enqueue(job)

    def site_of(self, vehicle: int) -> Site:
        """The site of a vehicle that flies: its home and its settings."""
        return self._sites[vehicle]

    def _enqueue(self, job: Job) -> None:
        self._traffic.add(job.name, job.timeline, planned_s=job.planned_s, pace_m_s=pace_home_m_s(job.site))
        self.queues.add(job)

    def hand_over(self, record: FlownSortie, left: Sequence[Job], now: float) -> None:
        """Give the unflown parts of a sortie, each checked, to the vehicle that finishes first; or leave gaps.

        Args:
            record: the sortie that ended early.
            left: those that its vehicle had not begun.
            now: present time.
        """
        for part in left:
            self._traffic.drop(part.name)
        if self._on_loss is OnLoss.GAPS or not self.queues.vehicles:
            self.left += [part.name for part in (record.job, *left)]
            return
        self._give(record.job, now, record=record)
        for part in left:
            self._give(part, now)

    def _give(self, job: Job, now: float, *, record: FlownSortie | None = None) -> None:
        """Give an unflown sortie, or the rest of a recorded one, to another vehicle."""
        try:
            route = job.route if record is None else left_of(job)
            if route is None:
                return
            vehicle, ready_s = self._taker(job, route, now)
            site = self._sites[vehicle]
            part = for_another(job, site, sys.argv) if record is None else rest_of(job, site, sys.argv)
            if record is not None and record.keeps_reserve:
                require_gain(job, part)
        except (UavcoverError, MissionIoError) as error:
            what = "sortie" if record is None else "the remaining part of sortie"
            self._board.warn(f"{what} {job.sortie} remains unflown, as a gap: {error}")
            self.left.append(job.name)
            return
        since_s = self._traffic.since_first_s(now) + ready_s - now
        taken = part.of(vehicle, planned_s=max(part.planned_s, since_s))
        self._enqueue(taken)
        what = "the remaining part of sortie" if part.is_rest else "sortie"
        self._board.say(
            f"vehicle {vehicle} flies {what} {part.sortie} instead: {len(part.route)} waypoints, starting at about "
            f"{taken.planned_s:.0f} s"
        )

    def _taker(self, job: Job, route: Route, now: float) -> tuple[int, float]:
        """The first vehicle that can finish a route, and the time of its readiness.

        Raises:
            InfeasibleError: it is too far or too long for all that are left.
        """
        found: list[tuple[float, int, float]] = []
        refusal = InfeasibleError("no vehicle is left")
        for vehicle in sorted(self.queues.vehicles):
            ready_s = self._ready_s(vehicle, now)
            try:
                found.append((ready_s + time_for(job, route, self._sites[vehicle]), vehicle, ready_s))
            except InfeasibleError as error:
                refusal = error
        if not found:
            raise refusal
        _, vehicle, ready_s = min(found)
        return vehicle, ready_s

    def _ready_s(self, vehicle: int, now: float) -> float:
        """When a vehicle has flown what it has to fly already, and has a new battery."""
        ready_s = max(now, self.free_s.get(vehicle, now))
        flies = self.current.get(vehicle)
        waiting = self.queues.of(vehicle)
        if flies is not None and self._traffic.phase(flies.name) is not FleetPhase.DOWN:
            begun = self._traffic.phase(flies.name) is FleetPhase.FLYING
            begins_s = max(now, now + flies.planned_s - self._traffic.since_first_s(now))
            lands_s = self._traffic.lands_s(flies.name) if begun else begins_s + flies.timeline.duration_s
            ready_s = max(now, lands_s) + flies.site.scenario.fleet.turnaround_s
        for job in waiting:
            ready_s = max(ready_s, now + job.planned_s - self._traffic.since_first_s(now))
            ready_s += job.timeline.duration_s + job.site.scenario.fleet.turnaround_s
        return ready_s

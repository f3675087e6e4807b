"""The work of a fleet: each vehicle's sorties, its next readiness, and takeovers."""

import sys
from collections.abc import Sequence

from mission_io.errors import MissionIoError
from uavcover.errors import InfeasibleError, UavcoverError
from uavcover.extras.fleet.board import Board
from uavcover.extras.fleet.jobs import Job, OnLoss, Queues, for_another, left_of, require_gain, rest_of, time_for
from uavcover.extras.fleet.sortie import FlownSortie, pace_home_m_s
from uavcover.extras.fleet.traffic import FleetPhase, Traffic
from uavcover.model.route import Route
from uavcover.scenario.site import Site


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

"""The flight of a fleet: each vehicle flies its sorties in a thread, and takes over those of lost ones."""

import math
import sys
import threading
from collections.abc import Callable, Container, Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from mission_io.errors import MissionIoError
from mission_io.model.items import Mission
from uavcover.errors import UavcoverError, VehicleError
from uavcover.extras.fleet.board import Board, VehicleUser
from uavcover.extras.fleet.jobs import Job, OnLoss
from uavcover.extras.fleet.sortie import (
    FleetClock,
    FleetWork,
    FlownSortie,
    LostVehicle,
    ReserveWatch,
    is_down,
    lacking_battery,
    positions_m,
    require_own_mission,
    wait_for_home,
    whose_home,
)
from uavcover.extras.fleet.traffic import FleetPhase, Traffic
from uavcover.extras.fleet.tuning import FLEET
from uavcover.flight.command import FlightOptions, record_flight
from uavcover.flight.compiled_flight import UPLOAD_FILE, fly, upload, upload_document
from uavcover.flight.connect import Connected, VehicleLink
from uavcover.flight.orders import Clearance
from uavcover.missions.mission_compiler import CompiledMission, compile_mission
from uavcover.model.track import Ending, FlightFailedError, FlightOutcome, TrackSample
from uavcover.run.documents import TRACK
from uavcover.run.folder import FLIGHT_FILES, RunFolder
from uavcover.run.provenance import note_files
from uavcover.scenario.site import Site

Opening = Callable[[VehicleLink, Site], AbstractContextManager[Connected]]


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetOrders:
    """The user's orders for the fleet."""

    links: Sequence[VehicleLink]  # where each vehicle is, vehicle 1 first
    flight: FlightOptions  # options of each flight
    on_loss: OnLoss  # treatment of a lost vehicle's unobserved cells
    opening: Opening  # opens the link to a vehicle
    clocks: Sequence[FleetClock]  # of each vehicle
    stops: Callable[[], int]  # how often the user has asked to stop
    paused: Callable[[], bool]  # whether the user wants all to hold their places


_LOOK_EVERY_S, _POSITION_EVERY_S = 1.0, 0.5
_IN_ORDER = "give the --to options in the order of the vehicles, vehicle 1 first"


class FleetFlight:
    """The flight of a fleet; ``follow`` runs in a thread of its own for each vehicle.

    Args:
        jobs: the sorties.
        board: the table.
        orders: what the user wants.

    Attributes:
        traffic: keeps the vehicles apart.
        work: the sorties of each vehicle, and the sorties without a vehicle.
        flown: the sorties that have ended.
        faults: errors that are no vehicle's.
        called_off: whether no vehicle started because one was not ready.
        aborted: whether all are left as they are, at once.
    """

    def __init__(self, jobs: Sequence[Job], board: Board, orders: FleetOrders) -> None:
        self.board, self.orders = board, orders
        self.traffic = Traffic(jobs[0].site.scenario.fleet)
        self.flown: list[FlownSortie] = []
        self.faults: list[BaseException] = []
        self.called_off = self.aborted = False
        self.work = FleetWork(jobs, self.traffic, board, orders.on_loss)
        self._found: dict[int, int] = {}
        self._given: set[int] = set()
        self._ready: set[int] = set()
        self._next_look_s: dict[int, float] = {}
        self._holds: dict[int, bool] = {}
        self._reserves: dict[int, ReserveWatch] = {}
        self._lock = threading.RLock()
        for idle in set(board.rows) - set(self.work.flyers):
            board.rows[idle].does = "stays on the ground"

    def follow(self, vehicle: int) -> None:
        """Fly all sorties of a vehicle, and those that it takes over."""
        clock, row = self.orders.clocks[vehicle - 1], self.board.rows[vehicle]
        with clock.taking_part():
            try:
                while not self._stopped and vehicle in self.work.queues.vehicles:
                    job = self.work.queues.take(vehicle)
                    if job is None and not self.work.queues.work_may_come(vehicle):
                        break
                    if job is None:
                        row.does = "is ready"
                        clock.wait(_LOOK_EVERY_S)
                        continue
                    self.work.current[vehicle] = job
                    try:
                        self._fly_when_due(job, vehicle, clock)
                    finally:
                        del self.work.current[vehicle]
                        self.work.queues.done(vehicle)
            except BaseException as error:
                self.faults.append(error)
                self.aborted = self.aborted or not isinstance(error, Exception)
                self.called_off = True

    @property
    def _stopped(self) -> bool:
        return self.called_off or self.aborted or self.orders.stops() > 0

    def _stops(self) -> int:
        if self.aborted:
            raise KeyboardInterrupt
        return max(self.orders.stops(), 1 if self.called_off else 0)

    def _fly_when_due(self, job: Job, vehicle: int, clock: FleetClock) -> None:
        row = self.board.rows[vehicle]
        row.sortie, row.does = str(job.sortie), "waits"
        due_s = self.work.free_s.get(vehicle)
        while due_s is not None:
            now = clock.now()
            due_s = max(due_s, now + job.planned_s - self.traffic.since_first_s(now) - FLEET.ready_before_s)
            if now >= due_s:
                break
            if self._stopped:
                return
            clock.wait(_LOOK_EVERY_S)
        record = FlownSortie(job, vehicle)
        user = VehicleUser(self.board, vehicle, stops=self._stops, pauses=partial(self._pauses, job, vehicle, clock))
        try:
            with (
                job.folder.reserved(FLIGHT_FILES, force=self._may_replace(job)),
                self.orders.opening(self.orders.links[vehicle - 1], job.site) as connected,
            ):
                try:
                    self._fly(job, connected, user, record, clock)
                except (UavcoverError, MissionIoError) as error:
                    record.error = str(error) or type(error).__name__
                    user.warn(record.error)
                if self.traffic.phase(job.name) is FleetPhase.LOST and not self._stopped:
                    self._take_end(record, clock.now())
                    self._listen(record, connected, clock)
        except (UavcoverError, MissionIoError) as error:
            record.error = record.error or str(error) or type(error).__name__
            user.warn(str(error) or type(error).__name__)
        finally:
            if all(each is not record for each in self.flown):
                self._take_end(record, clock.now())

    def _listen(self, record: FlownSortie, connected: Connected, clock: FleetClock) -> None:
        """Listen to a lost vehicle while others fly or wait for it: its position counts again when messages arrive."""
        self.work.queues.done(record.vehicle)
        heard = LostVehicle(record.job, connected, self.traffic)
        while not self._stopped and self.work.queues.work_is_left and not record.down:
            message = heard.look(clock, _LOOK_EVERY_S)
            record.down = self.traffic.phase(record.job.name) is not FleetPhase.LOST
            if message is not None:
                self.board.say(f"vehicle {record.vehicle}: {message}")

    def _fly(self, job: Job, connected: Connected, user: VehicleUser, record: FlownSortie, clock: FleetClock) -> None:
        compiled = compile_mission(job.site, job.route, autopilot=connected.autopilot)
        self._wait_for_own_home(job, connected, compiled, clock)
        first = record.vehicle not in self.work.free_s
        others = self.work.flyers
        self._found[record.vehicle] = connected.client.vehicle.system_id
        # One after the other: were two of them one vehicle, their uploads would disturb each other.
        if first and not (
            self._meet(connected, self._found, others)
            and self._meet(connected, self._given, [k for k in others if k < record.vehicle])
        ):
            return
        results = upload(connected.client, compiled)
        job.folder.write_json(UPLOAD_FILE, upload_document(job.site, compiled, connected.url, results))
        note_files(job.folder, "upload", [UPLOAD_FILE], command=sys.argv)
        self._given.add(record.vehicle)
        if first:
            if not self._meet(connected, self._given, others):
                return
            urls = [link.url for link in self.orders.links]
            same = [k for k in others if self._found[k] == self._found[record.vehicle]]
            require_own_mission(connected, compiled, [urls[k - 1] for k in same])
        record.outcome, _ = record_flight(
            job.folder, job.site, job.route, user, connected,
            lambda orders: self._followed(record, connected, clock, partial(fly, connected, job.site, compiled, orders)),
            options=self._flight_options(job, connected, record, clock),
        )  # fmt: skip

    def _wait_for_own_home(self, job: Job, connected: Connected, compiled: CompiledMission, clock: FleetClock) -> None:
        """Wait until the vehicle knows its home, and refuse one that is at another vehicle's home, or of another autopilot.

        Raises:
            VehicleError: the vehicle is not the planned one.
        """
        sites = {k: self.work.site_of(k) for k in self.work.flyers}
        wanted = job.site.scenario.vehicle.autopilot
        if connected.autopilot != wanted and len({site.scenario.vehicle.autopilot for site in sites.values()}) > 1:
            raise VehicleError(
                f"{connected.url} leads to {connected.autopilot}, but vehicle {job.vehicle} is planned for {wanted}; {_IN_ORDER}"
            )
        try:
            wait_for_home(connected, job.site, compiled, clock, stopped=lambda: self._stopped)
        except VehicleError as error:
            stands_at = whose_home(connected, sites)
            if stands_at not in (None, job.vehicle):
                raise VehicleError(f"{error}; it stands at the home of vehicle {stands_at}; {_IN_ORDER}") from error
            raise

    def _followed(
        self, record: FlownSortie, connected: Connected, clock: FleetClock, begin: Callable[[], FlightOutcome]
    ) -> FlightOutcome:
        """Fly, and report the end to the others at once, because writing the record takes a while."""
        try:
            record.outcome = begin()
            return record.outcome
        except FlightFailedError as error:
            record.outcome = error.outcome
            raise
        finally:
            record.down = is_down(connected)
            self._tell_traffic(record, clock.now())

    def _tell_traffic(self, record: FlownSortie, now: float) -> None:
        job = record.job
        if self.traffic.phase(job.name) not in (FleetPhase.FLYING, FleetPhase.HOLDING, FleetPhase.HOMEWARD):
            return
        self.work.free_s[record.vehicle] = now + job.site.scenario.fleet.turnaround_s
        if record.down:
            self.traffic.landed(job.name, now)
            return
        left_there = record.outcome is not None and record.outcome.ending is Ending.LEFT_HOLDING
        endurance_s = job.site.scenario.vehicle.endurance_s or 2.0 * job.timeline.duration_s
        self.traffic.lost(job.name, down_by_s=now + endurance_s, stays=left_there)

    def _meet(self, connected: Connected, there: Container[int], vehicles: Iterable[int]) -> bool:
        """Wait until all of these vehicles are as far; False when the flight was called off meanwhile."""
        while not all(k in there for k in vehicles):
            if self._stopped:
                return False
            connected.client.poll(0.1)
        return True

    def _flight_options(self, job: Job, connected: Connected, record: FlownSortie, clock: FleetClock) -> FlightOptions:
        vehicle = record.vehicle
        row = self.board.rows[vehicle]
        reserve = self._reserves[vehicle] = ReserveWatch(job, connected, self.traffic)
        lacks_since_s: float | None = None

        def may_start() -> bool:
            nonlocal lacks_since_s
            if self._stopped:
                return False
            with self._lock:
                self._ready.add(vehicle)
                row.does = "ready to start"
                if not self._ready >= self.work.queues.vehicles:
                    return False
            if (lacks := lacking_battery(job, connected)) is not None:
                row.does = lacks
                if lacks_since_s is None:
                    lacks_since_s = clock.now()
                    self.board.warn(f"vehicle {vehicle}: {lacks} for sortie {job.sortie}; change the battery")
                elif clock.now() - lacks_since_s > FLEET.new_battery_s:
                    raise VehicleError(f"{lacks} for {FLEET.new_battery_s:.0f} s, so the vehicle was not armed")
                return False
            if not self.traffic.start(job.name, clock.now()):
                return False
            record.began_s = self.traffic.since_first_s(clock.now())
            row.does = "flies"
            return True

        def may_go_home(mission: Mission) -> bool:
            row.does = "holds"
            path_m = positions_m(mission, job.site)
            may = self.traffic.may_go_home(job.name, clock.now(), path_m, all_return=self.orders.stops() > 0)
            row.does = "returns" if may else "holds"
            return may

        def must_go_home() -> str | None:
            begun_s = self.traffic.since_first_s(clock.now()) - (record.began_s or 0.0)
            return reserve.must_go_home(clock.now(), aloft_s=begun_s)

        next_s = -math.inf

        def take(sample: TrackSample) -> None:
            nonlocal next_s
            now = clock.now()
            if now < next_s:
                return
            next_s = now + _POSITION_EVERY_S
            self.traffic.moved(job.name, now, np.array([sample.east_m, sample.north_m, sample.up_m]))
            row.late_s = self.traffic.late_s(job.name)
            row.nearest = self.traffic.nearest_m(job.name)

        return replace(
            self.orders.flight,
            clearance=Clearance(may_start=may_start, may_go_home=may_go_home, must_go_home=must_go_home),
            on_sample=take,
            force=self._may_replace(job),
        )

    def _may_replace(self, job: Job) -> bool:
        return self.orders.flight.force or job.is_rest

    def _pauses(self, job: Job, vehicle: int, clock: FleetClock) -> bool:
        """Whether a vehicle is to hold its position: the user wants it, or another one passes."""
        now = clock.now()
        if now >= self._next_look_s.get(vehicle, now):
            self._next_look_s[vehicle] = now + _LOOK_EVERY_S
            before, holds = self._holds.get(vehicle, False), self._must_hold(job, vehicle, now)
            self._holds[vehicle] = holds
            if holds is not before:
                self.board.rows[vehicle].does = "waiting for another vehicle" if holds else "flies"
        return self.orders.paused() or self._holds.get(vehicle, False)

    def _must_hold(self, job: Job, vehicle: int, now: float) -> bool:
        return self.traffic.must_hold(job.name, now, may_wait_s=self._reserves[vehicle].may_wait_s(now))

    def _take_end(self, record: FlownSortie, now: float) -> None:
        """Consequences of a finished sortie for the others."""
        job, vehicle = record.job, record.vehicle
        row = self.board.rows[vehicle]
        row.late_s, row.nearest = None, None
        self.flown.append(record)
        if self.traffic.phase(job.name) is FleetPhase.WAITING:
            self.traffic.drop(job.name)
            self.work.free_s[vehicle] = now + job.site.scenario.fleet.turnaround_s
        else:
            self._tell_traffic(record, now)
        if (
            job.is_rest and job.folder.file(TRACK).exists()
        ):  # the sortie knows its flights: one that is taken away is missed
            parent = RunFolder(job.folder.path.parent)
            note_files(parent, "fly", [f"{job.folder.path.name}/{TRACK}"], command=sys.argv)
        if record.outcome is not None and record.outcome.ending is Ending.LANDED:
            row.does = "landed"
            for following in self.work.queues.of(vehicle)[:1]:
                self.board.say(
                    f"vehicle {vehicle}: change the battery; sortie {following.sortie} at {following.planned_s:.0f} s"
                )
            return
        if record.keeps_reserve:
            row.does = "landed"
            if not self._stopped:
                with self._lock:
                    self.work.hand_over(record, [], now)
            return
        row.does = "out"
        if self._stopped:
            return
        with self._lock:
            left = self.work.queues.give_up(vehicle)
            if record.began_s is None and not self.traffic.begun:
                self.board.warn("one vehicle is not ready, so no vehicle was started")
                self.called_off = True
                return
            self.work.hand_over(record, left, now)

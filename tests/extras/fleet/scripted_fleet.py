"""The flight of a fleet whose vehicles do what a script says, without MAVLink: only who flies what when is tried."""

import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from tests.extras.fleet.lockstep import Lockstep
from tests.extras.fleet.test_fleet import Listener
from tests.extras.fleet.test_fleet_traffic import out_and_back
from uavcover.extras.fleet.board import Board, VehicleUser
from uavcover.extras.fleet.flight import FleetFlight, FleetOrders
from uavcover.extras.fleet.jobs import Job, OnLoss
from uavcover.extras.fleet.sortie import FleetClock, FlownSortie
from uavcover.flight.command import FlightOptions
from uavcover.flight.connect import Connected, VehicleLink
from uavcover.model.route import Route
from uavcover.model.track import Ending, FlightFailedError, FlightOutcome
from uavcover.model.vehicle import Fleet, Vehicle
from uavcover.run.folder import RunFolder

WATCHDOG_S = 120.0
FLEET = Fleet(
    vehicles=3, separation_m=20.0, path_error_m=2.0, timing_error_fraction=0.0, start_error_s=1.0, pad_s=10.0,
    turnaround_s=60.0,
)  # fmt: skip
ENDURANCE_S = 300.0
SITE: Any = SimpleNamespace(
    scenario=SimpleNamespace(fleet=FLEET, vehicle=Vehicle(endurance_s=ENDURANCE_S), home=None, sensor=None)
)


@dataclass(frozen=True)
class Ends:
    """How a sortie ends: after which share of its time, whether its vehicle is known to be down, and when it is heard again."""

    ending: Ending = Ending.LANDED
    fraction: float = 1.0
    down: bool = True
    heard_after_s: float | None = None


def job(folder: Path, sortie: int, vehicle: int, planned_s: float) -> Job:
    """200 m out and back from a place of the vehicle's own, 400 m from the next one."""
    timeline = out_and_back(150.0, home=(800.0 * vehicle, 0.0, 0.0))
    where = RunFolder(folder / f"sortie-{sortie}")
    where.path.mkdir(parents=True)
    route, used = Route(timeline.position_m[1:-1]), timeline.duration_s / ENDURANCE_S
    return Job(f"{sortie:03d}", sortie, vehicle, planned_s, where, SITE, route, timeline, used)


class ScriptedFlight(FleetFlight):
    """Vehicles that do what the script says of their sorties, by name; what it does not name is flown to the end."""

    script: Mapping[str, Ends]

    def _fly(self, job: Job, connected: Connected, user: VehicleUser, record: FlownSortie, clock: FleetClock) -> None:
        del user
        clearance = self._flight_options(job, connected, record, clock).clearance
        while not clearance.may_start():
            if self._stopped:
                return
            clock.wait(1.0)
        ends, began_s = self.script.get(job.name, Ends()), clock.now()
        try:
            while (aloft_s := clock.now() - began_s) < ends.fraction * job.timeline.duration_s:
                self.traffic.moved(job.name, clock.now(), job.timeline.positions_m(np.array([aloft_s]))[0])
                clock.wait(1.0)
            record.outcome = FlightOutcome(
                ending=ends.ending, waypoints_reached=0, sample_count=0, duration_s=aloft_s, simulated_by=None,
                incidents=(), vehicle_now="", limits=(),
            )  # fmt: skip
            if not ends.ending.good:
                raise FlightFailedError(ends.ending.value, record.outcome)
        finally:
            record.down = ends.down
            self._tell_traffic(record, clock.now())

    def _listen(self, record: FlownSortie, connected: Connected, clock: FleetClock) -> None:
        """It is heard again after so long, on the ground, or never."""
        del connected
        self.work.queues.done(record.vehicle)
        ends = self.script[record.job.name]
        if ends.heard_after_s is not None:
            clock.wait(ends.heard_after_s)
            self.traffic.landed(record.job.name, clock.now())


@dataclass
class Told:
    """What came of a flight."""

    flight: ScriptedFlight
    lines: list[str]

    def landed(self) -> set[str]:
        """Names of the sorties that were flown to the end."""
        return {r.job.name for r in self.flight.flown if r.outcome is not None and r.outcome.ending is Ending.LANDED}

    def record(self, name: str) -> FlownSortie:
        """How one ended."""
        return next(record for record in self.flight.flown if record.job.name == name)


def fly_script(
    jobs: Sequence[Job],
    script: Mapping[str, Ends],
    *,
    on_loss: OnLoss = OnLoss.SHARE,
    percent: Mapping[int, int] | None = None,
) -> Told:
    """Fly; ``percent`` has what the batteries of some vehicles tell."""
    vehicles = max(each.vehicle for each in jobs)
    lockstep, listener = Lockstep(vehicles), Listener()

    @contextmanager
    def opening(link: VehicleLink, _: Any) -> Iterator[Any]:
        left = (percent or {}).get(int(link.url.rpartition(":")[2]))
        status = None if left is None else SimpleNamespace(battery_remaining_percent=left)
        yield SimpleNamespace(monitor=SimpleNamespace(latest=lambda _: status))

    orders = FleetOrders(
        links=[VehicleLink(url=f"udp:127.0.0.1:{k}") for k in range(1, vehicles + 1)], flight=FlightOptions(),
        on_loss=on_loss, opening=opening, clocks=lockstep.seats, stops=lambda: 0, paused=lambda: False,
    )  # fmt: skip
    flight = ScriptedFlight(jobs, Board(listener, vehicles), orders)
    flight.script = script
    threads = [threading.Thread(target=flight.follow, args=(k,), daemon=True) for k in range(1, vehicles + 1)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(WATCHDOG_S)
    assert not any(thread.is_alive() for thread in threads), listener.lines
    assert flight.faults == []
    return Told(flight, listener.lines)

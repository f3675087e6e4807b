"""Several vehicles behind simulated links whose clocks go on together: a flight takes seconds and repeats exactly."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from random import Random

from mission_io.autopilots.autopilot import PX4
from mission_io.links.datagrams import WrappingLink
from mission_io.links.opening import LoggedLink
from mission_io.links.simulated import Conditions, ManualClock, SimulatedLink
from uavcover.flight.connect import Connected, VehicleLink
from uavcover.flight.monitor import open_vehicle
from uavcover.mock.server import InMemoryPeer
from uavcover.mock.vehicle import MockVehicle
from uavcover.scenario.site import Site

_SLACK_S = 0.25


class Lockstep:
    """One thread at a time goes on: the one whose clock is behind."""

    def __init__(self, seats: int) -> None:
        self.seats = [Seat(self, number) for number in range(seats)]
        self._inside = dict.fromkeys(range(seats), True)
        self._turn = 0
        self._condition = threading.Condition()

    def wait_for_turn(self, seat: "Seat", *, handing_over: bool = True) -> None:
        with self._condition:
            if handing_over:
                self._hand_over(seat)
            while self._turn != seat.number:
                self._condition.wait()

    def leave(self, seat: "Seat") -> None:
        with self._condition:
            del self._inside[seat.number]
            self._hand_over(None)

    def _hand_over(self, seat: "Seat | None") -> None:
        others = [self.seats[k] for k in self._inside if seat is None or k != seat.number]
        if not others:
            return
        first = min(others, key=lambda s: (s.clock.now(), s.number))
        if seat is None or seat.clock.now() > first.clock.now() + _SLACK_S:
            self._turn = first.number
            self._condition.notify_all()


class Seat:
    """The clock of one vehicle's thread."""

    def __init__(self, lockstep: Lockstep, number: int) -> None:
        self.number, self.clock = number, ManualClock()
        self.lockstep = lockstep

    def now(self) -> float:
        return self.clock.now()

    def wait(self, seconds: float) -> None:
        self.clock.advance_to(self.clock.now() + seconds)
        self.lockstep.wait_for_turn(self)

    @contextmanager
    def taking_part(self) -> Iterator[None]:
        self.lockstep.wait_for_turn(self, handing_over=False)
        try:
            yield
        finally:
            self.lockstep.leave(self)


class _SteppedLink(WrappingLink):
    def __init__(self, link: SimulatedLink, seat: Seat) -> None:
        super().__init__(link)
        self._seat = seat

    def send(self, data: bytes) -> None:
        self._link.send(data)

    def receive(self, timeout_s: float) -> bytes | None:
        self._seat.lockstep.wait_for_turn(self._seat)
        return self._link.receive(timeout_s)


MakeVehicle = Callable[[int, int, Site], MockVehicle]
"""Makes the mock of a vehicle, from 1, for its so manieth sortie, from 0."""


class Hangar:
    """Opens links to mocks; each sortie has a vehicle with a new battery."""

    def __init__(self, vehicles: int, make: MakeVehicle, *, seed: int = 1, delay_s: float = 0.05) -> None:
        self.lockstep = Lockstep(vehicles)
        self.flown: dict[int, list[MockVehicle]] = {}
        self._make, self._seed, self._delay_s = make, seed, delay_s

    @property
    def clocks(self) -> list[Seat]:
        return self.lockstep.seats

    def links(self) -> list[VehicleLink]:
        return [VehicleLink(url=f"udp:127.0.0.1:{number}") for number in range(1, len(self.lockstep.seats) + 1)]

    @contextmanager
    def open(self, link: VehicleLink, site: Site) -> Iterator[Connected]:
        number = int(link.url.rpartition(":")[2])
        seat = self.lockstep.seats[number - 1]
        before = self.flown.setdefault(number, [])
        vehicle = self._make(number, len(before), site)
        before.append(vehicle)
        peer = InMemoryPeer(vehicle)
        peer.hold_time(seat.now())
        conditions = Conditions(delay_s=self._delay_s, jitter_s=0.05)
        rng = Random(1000 * self._seed + 10 * number + len(before))
        simulated = SimulatedLink(peer, rng=rng, conditions=conditions, clock=seat.clock)
        logged = LoggedLink(_SteppedLink(simulated, seat))
        client, monitor = open_vehicle(logged)
        with client:
            found = client.wait_for_vehicle(30.0)
            monitor.listen_to(found.address)
            own = "px4" if vehicle.autopilot is PX4 else "ardupilot"
            yield Connected(client, monitor, own, logged, link.url)

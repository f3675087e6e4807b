"""What a capability works with: a running vehicle, a folder, and ground stations that speak to it."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from mission_io.client.client import Client
from mission_io.links.opening import open_link
from mission_io.model.enums import AutopilotId
from mission_io.model.items import MissionItem, MissionType
from mission_io.wire.messages import Heartbeat, Received
from sitl_tests.matrix import ClientName
from sitl_tests.simulators.running import RunningVehicle
from uavcover.errors import VehicleError
from uavcover.extras.mavsdk.client import MavsdkClient
from uavcover.flight.monitor import Monitor
from uavcover.flight.orders import FlightTimeouts
from uavcover.flight.session import Session
from uavcover.model.track import FlightEvent
from uavcover.model.vehicle import AutopilotName

_FIRST_HEARTBEAT_S = 60.0
_SECOND_STATION = 254


@dataclass(frozen=True, slots=True)
class Finding:
    """What came of a capability.

    Attributes:
        outcome: in one word, as ``matrix.toml`` has it.
        detail: the figures, for the table.
    """

    outcome: str
    detail: str


Judge = Callable[[], Finding]
"""What is left of a capability when the vehicle has been stopped."""


class Station:
    """A ground station that has found the vehicle.

    Attributes:
        client: speaks to it.
        monitor: hears all that the client hears.
        modes: the flight modes (``custom_mode``) that its heartbeats have told, one after the other.
        session: waits in vehicle time, with the wall clock as the watchdog behind it.
    """

    def __init__(
        self, client: Client, monitor: Monitor, modes: list[int], on_event: Callable[[FlightEvent], None]
    ) -> None:
        self.client, self.monitor, self.modes = client, monitor, modes
        self.session = Session(client, monitor, timeouts=FlightTimeouts(), on_event=on_event, stop=lambda: 0)

    def wait_s(self, duration_s: float) -> None:
        """Listen for a while of vehicle time."""
        begun_s = self._time_s()
        self.wait(
            lambda: self._time_s() >= begun_s + duration_s, within_s=10.0 * duration_s, what="its clock stands still"
        )

    def wait(self, done: Callable[[], bool], *, within_s: float, what: str) -> None:
        """Listen until something is so.

        Raises:
            VehicleError: it does not become so within so much vehicle time.
        """
        self.session.wait(done, timeout_s=within_s, what=lambda: what)

    def _time_s(self) -> float:
        if self.monitor.time_s is None:
            self.wait(lambda: self.monitor.time_s is not None, within_s=30.0, what="the vehicle does not tell its time")
        if self.monitor.time_s is None:
            raise VehicleError("the vehicle does not tell its time")
        return self.monitor.time_s


@dataclass(frozen=True, slots=True)
class Case:
    """One capability's run.

    Attributes:
        vehicle: it runs, on its own.
        autopilot: whose ways it has.
        client: which client speaks to it.
        folder: for what the case writes.
        seed: of everything random.
        speed: vehicle seconds per second.
        events: everything that was told, for the record.
    """

    vehicle: RunningVehicle
    autopilot: AutopilotName
    client: ClientName
    folder: Path
    seed: int
    speed: float
    events: list[str] = field(default_factory=list)

    @contextmanager
    def station(self, url: str | None = None) -> Iterator[Station]:
        """A ground station on the vehicle's first link, or on another."""
        with self._station(url or self.vehicle.url, 255) as station:
            yield station

    @contextmanager
    def second_station(self) -> Iterator[Station]:
        """Another ground station, with a system id of its own, on the vehicle's second link."""
        with self._station(self.vehicle.second_url, _SECOND_STATION) as station:
            yield station

    def held(self, mission_type: MissionType) -> tuple[MissionItem, ...]:
        """What a station that knows nothing finds on the vehicle."""
        with self.station() as station:
            return station.client.download(mission_type)

    @contextmanager
    def _station(self, url: str, system_id: int) -> Iterator[Station]:
        monitor = Monitor()
        modes: list[int] = []

        def listen(received: Received, now: float) -> None:
            monitor(received, now)
            beat = received.message
            if (
                isinstance(beat, Heartbeat)
                and beat.autopilot != AutopilotId.INVALID
                and beat.custom_mode not in modes[-1:]
            ):
                modes.append(beat.custom_mode)

        kind = MavsdkClient if self.client == "mavsdk" and system_id != _SECOND_STATION else Client
        with kind(open_link(url), system_id=system_id, listener=listen) as client:
            found = client.wait_for_vehicle(_FIRST_HEARTBEAT_S)
            monitor.listen_to(found.address)
            yield Station(client, monitor, modes, self.take_event)

    def take_event(self, event: FlightEvent) -> None:
        """Keep an event for the record."""
        at = "" if event.time_s is None else f"{event.time_s:9.1f} s  "
        self.events.append(f"{at}{event.kind.name.lower()}: {event.text}")


class Stopwatch:
    """Wall-clock seconds since it was made."""

    def __init__(self) -> None:
        self._begun_s = time.monotonic()

    @property
    def elapsed_s(self) -> float:
        """How long it has run."""
        return time.monotonic() - self._begun_s

"""The clients that are compared, and the vehicles that they transfer missions to.

A client transfers a mission over one link and says whether it believes that it worked. The vehicles only transfer missions,
many of them in one process, each behind a UDP port that loses datagrams.
"""

import contextlib
import select
import socket
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from random import Random
from typing import Any

from mission_io.autopilots.autopilot import Autopilot
from mission_io.client.client import Client
from mission_io.errors import MissionIoError, MisuseError
from mission_io.links.base import Link
from mission_io.links.simulated import Conditions, SimulatedLink, fate
from mission_io.links.udp import UdpLink
from mission_io.model.enums import VehicleClass
from mission_io.model.items import MissionItem, MissionType
from mission_io.protocol.server import MissionServer
from mission_io.protocol.timing import Timing
from mission_io.wire.codec import Codec
from mission_io.wire.messages import Address, Heartbeat
from uavcover.errors import VehicleError
from uavcover.extras.benchmarks.link.trials import AUTOPILOTS, TransferOutcome, Trial, items_on, mission_items
from uavcover.plugins import load

_LOCALHOST = "127.0.0.1"
_SYSTEM = Address(1, 1)


class MissionVehicle:
    """A vehicle on the ground: heartbeats and the mission protocol, as datagrams. A ``Peer`` of a simulated link."""

    def __init__(self, autopilot: Autopilot, items: tuple[MissionItem, ...], *, now: float) -> None:
        self._codec = Codec(system_id=_SYSTEM.system_id, component_id=_SYSTEM.component_id)
        self._heartbeat = Heartbeat(autopilot.mav_autopilot, VehicleClass.QUADROTOR, system_status=3)
        self._beat_at = now
        self._server = MissionServer(autopilot, local=_SYSTEM)
        self._server.set_items(MissionType.MISSION, items)

    @property
    def items(self) -> tuple[MissionItem, ...]:
        """The mission that it holds."""
        return self._server.items(MissionType.MISSION)

    def receive_datagram(self, data: bytes, now: float) -> None:
        """Take a datagram."""
        for received in self._codec.decode(data):
            self._server.receive(received, now)

    def datagrams_to_send(self, now: float) -> list[bytes]:
        """Datagrams to send by now."""
        messages = list(self._server.messages_to_send(now))
        if now >= self._beat_at:
            self._beat_at = now + 1.0
            messages.append(self._heartbeat)
        return [self._codec.encode(message) for message in messages]

    def next_timer(self) -> float:
        """Time of the next datagram without an incoming one."""
        timer = self._server.next_timer()
        return self._beat_at if timer is None else min(timer, self._beat_at)


def vehicle_for(trial: Trial, *, now: float) -> MissionVehicle:
    """A trial's vehicle: empty for an upload, with the mission for a download."""
    items = items_on(trial.vehicle, trial.items) if trial.direction == "download" else ()
    return MissionVehicle(AUTOPILOTS[trial.vehicle], items, now=now)


def conditions_of(trial: Trial) -> Conditions:
    """Link conditions of a trial, each way."""
    return Conditions(loss=trial.loss, delay_s=trial.delay_s)


class _LossyPort:
    """A vehicle behind a UDP socket; what comes in and what goes out is late, and gets lost by seed."""

    def __init__(self, trial: Trial, *, now: float) -> None:
        self.vehicle = vehicle_for(trial, now=now)
        self._conditions = conditions_of(trial)
        self._rng = Random(f"{trial.vehicle} {trial.direction} {trial.loss} {trial.seed}")
        self._ground: tuple[str, int] | None = None
        self._coming: deque[tuple[float, bytes]] = deque()
        self._going: deque[tuple[float, bytes]] = deque()
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self.socket.bind((_LOCALHOST, 0))
        self.port: int = self.socket.getsockname()[1]

    def receive(self) -> None:
        """Take one datagram off the socket, if it is not lost."""
        try:
            data, self._ground = self.socket.recvfrom(65535)
        except OSError:
            return  # the ground station has gone
        self._put(data, self._coming)

    def run_until_now(self) -> None:
        """Process everything due: incoming datagrams, the vehicle's, and outgoing ones."""
        now = time.monotonic()
        while self._coming and self._coming[0][0] <= now:
            self.vehicle.receive_datagram(self._coming.popleft()[1], now)
        if self._ground is None:
            return
        for data in self.vehicle.datagrams_to_send(now):
            self._put(data, self._going)
        while self._going and self._going[0][0] <= now:
            with contextlib.suppress(OSError):  # the ground station has gone
                self.socket.sendto(self._going.popleft()[1], self._ground)

    def next_timer(self) -> float:
        """Time of the next event."""
        queues = [queue[0][0] for queue in (self._coming, self._going) if queue]
        return min([self.vehicle.next_timer(), *queues])

    def _put(self, data: bytes, queue: deque[tuple[float, bytes]]) -> None:
        due = time.monotonic() + self._conditions.delay_s if self._conditions.delay_s else 0.0
        queue.extend((due, copy) for copy in fate(data, self._conditions, self._rng))


def serve(control: Connection) -> None:
    """Serve vehicles until ``control`` says None: a Trial opens one (answer: its port), a port closes it (answer: its items)."""
    ports: dict[int, _LossyPort] = {}
    while True:
        now = time.monotonic()
        wake = min((port.next_timer() for port in ports.values()), default=now + 1.0)
        sockets = {port.socket.fileno(): port for port in ports.values()}
        ready, _, _ = select.select([control.fileno(), *sockets], [], [], max(0.0, min(wake - now, 1.0)))
        for number in ready:
            if number in sockets:
                sockets[number].receive()
                sockets[number].run_until_now()
        for port in ports.values():
            if port.next_timer() <= time.monotonic():
                port.run_until_now()
        if control.fileno() not in ready:
            continue
        request: Trial | int | None = control.recv()
        if request is None:
            return
        if isinstance(request, Trial):
            port = _LossyPort(request, now=time.monotonic())
            ports[port.port] = port
            control.send(port.port)
        else:
            port = ports.pop(request)
            port.socket.close()
            control.send(port.vehicle.items)


_CONNECT_S = 60.0


@dataclass(frozen=True, slots=True)
class Transferred:
    """A transfer as its client saw it; ``received`` is what a download gave back."""

    claimed: bool
    time_s: float
    received: tuple[MissionItem, ...] = ()
    error: str = ""


def run_simulated(trial: Trial, timing: Timing | None = None) -> TransferOutcome:
    """Our client in simulated time."""
    vehicle = vehicle_for(trial, now=0.0)
    rng = Random(f"{trial.vehicle} {trial.direction} {trial.loss} {trial.seed}")
    link = SimulatedLink(vehicle, rng=rng, conditions=conditions_of(trial))
    return outcome_of(trial, _with_our_client(link, trial, timing), vehicle.items)


def run_native(trial: Trial, port: int) -> Transferred:
    """Our client over UDP."""
    return _with_our_client(UdpLink.connecting("127.0.0.1", port), trial, None)


def _with_our_client(link: Link, trial: Trial, timing: Timing | None) -> Transferred:
    with Client(link, timing=timing) as client:
        client.wait_for_vehicle(_CONNECT_S)
        items = mission_items(trial.items)
        start = client.clock.now()
        received: tuple[MissionItem, ...] = ()
        try:
            if trial.direction == "upload":
                client.upload(MissionType.MISSION, items)
            else:
                received = client.download(MissionType.MISSION)
        except MissionIoError as error:
            return Transferred(False, client.clock.now() - start, error=str(error))
        return Transferred(True, client.clock.now() - start, received)


def run_mavsdk(trial: Trial, port: int) -> Transferred:
    """MAVSDK's client over UDP."""
    from mavsdk.plugins.mission_raw import MissionRawError

    plugin = load("uavcover.clients", "mavsdk")
    with _mission_raw(port) as raw:
        items = plugin.raw_items(mission_items(trial.items), MissionType.MISSION)
        call: Callable[[], Any] = raw.download_mission
        if trial.direction == "upload":
            call = lambda: raw.upload_mission(items)  # noqa: E731
        start = time.perf_counter()
        try:
            result = call()
        except MissionRawError as error:
            return Transferred(False, time.perf_counter() - start, error=str(error).partition(";")[0])
        time_s = time.perf_counter() - start
        received = () if trial.direction == "upload" else plugin.items_from_raw(result, MissionType.MISSION)
        return Transferred(True, time_s, received)


def outcome_of(trial: Trial, transferred: Transferred, held: tuple[MissionItem, ...]) -> TransferOutcome:
    """Outcome of a transfer, from the final content of the vehicle."""
    there = held if trial.direction == "upload" else transferred.received
    return TransferOutcome(
        trial,
        transferred.claimed,
        there == items_on(trial.vehicle, trial.items),
        transferred.time_s,
        transferred.error,
    )


@contextmanager
def _mission_raw(port: int) -> Iterator[Any]:
    import mavsdk
    from mavsdk.plugins.mission_raw import MissionRaw

    mavsdk.log_subscribe(lambda *_: True)
    ground = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION))
    try:
        ground.add_any_connection(f"udpout://127.0.0.1:{port}")
        system = ground.first_autopilot(_CONNECT_S)
        if system is None:
            raise VehicleError(f"MAVSDK found no vehicle at port {port} within {_CONNECT_S:g} s")
        raw = MissionRaw(system)
        try:
            yield raw
        finally:
            raw.destroy()
    finally:
        ground.destroy()


REAL_CLIENTS: dict[str, Callable[[Trial, int], Transferred]] = {"native": run_native, "mavsdk": run_mavsdk}
"""The clients that need a vehicle at a UDP port."""


def run_real(trial: Trial, port: int) -> Transferred:
    """Run a trial's client against the vehicle at a port.

    Raises:
        MisuseError: a client that is none of ``REAL_CLIENTS``.
    """
    try:
        run = REAL_CLIENTS[trial.client]
    except KeyError:
        raise MisuseError(f"unknown client {trial.client!r}; choose from {', '.join(REAL_CLIENTS)}") from None
    return run(trial, port)

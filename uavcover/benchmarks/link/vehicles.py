"""Vehicles that only transfer missions, many of them in one process, each behind a UDP port that loses datagrams."""

import select
import socket
import time
from multiprocessing.connection import Connection
from random import Random

from mission_io.autopilots import Autopilot
from mission_io.codec import Codec
from mission_io.enums import VehicleClass
from mission_io.items import MissionItem, MissionType
from mission_io.messages import Heartbeat
from mission_io.protocol.exchange import Address
from mission_io.protocol.server import MissionServer
from mission_io.simulated import Conditions, fate
from uavcover.benchmarks.link.trials import AUTOPILOTS, Trial, items_on

_LOCALHOST = "127.0.0.1"
_SYSTEM = Address(1, 1)
_HEARTBEAT_S = 1.0


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
        """What it wants to send by now."""
        messages = list(self._server.messages_to_send(now))
        if now >= self._beat_at:
            self._beat_at = now + _HEARTBEAT_S
            messages.append(self._heartbeat)
        return [self._codec.encode(message) for message in messages]

    def next_timer(self) -> float:
        """When it wants to send something although nothing arrives."""
        timer = self._server.next_timer()
        return self._beat_at if timer is None else min(timer, self._beat_at)


def vehicle_for(trial: Trial, *, now: float) -> MissionVehicle:
    """A trial's vehicle: empty for an upload, with the mission for a download."""
    items = items_on(trial.vehicle) if trial.direction == "download" else ()
    return MissionVehicle(AUTOPILOTS[trial.vehicle], items, now=now)


class _LossyPort:
    """A vehicle behind a UDP socket; what comes in and what goes out gets lost by seed."""

    def __init__(self, trial: Trial, *, now: float) -> None:
        self.vehicle = vehicle_for(trial, now=now)
        self._conditions = Conditions(loss=trial.loss)
        self._rng = Random(f"{trial.vehicle} {trial.direction} {trial.loss} {trial.seed}")
        self._ground: tuple[str, int] | None = None
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self.socket.bind((_LOCALHOST, 0))
        self.port: int = self.socket.getsockname()[1]

    def receive(self) -> None:
        """Take one datagram, if it is not lost."""
        try:
            data, self._ground = self.socket.recvfrom(65535)
        except OSError:
            return  # the ground station has gone
        for copy in fate(data, self._conditions, self._rng):
            self.vehicle.receive_datagram(copy, time.monotonic())

    def send(self) -> None:
        """Send what is due, as far as it is not lost."""
        if self._ground is None:
            return
        for data in self.vehicle.datagrams_to_send(time.monotonic()):
            for copy in fate(data, self._conditions, self._rng):
                try:
                    self.socket.sendto(copy, self._ground)
                except OSError:
                    return


def serve(control: Connection) -> None:
    """Serve vehicles until ``control`` says None: a Trial opens one (answer: its port), a port closes it (answer: its items)."""
    ports: dict[int, _LossyPort] = {}
    while True:
        now = time.monotonic()
        wake = min((port.vehicle.next_timer() for port in ports.values()), default=now + 1.0)
        sockets = {port.socket.fileno(): port for port in ports.values()}
        ready, _, _ = select.select([control.fileno(), *sockets], [], [], max(0.0, min(wake - now, 1.0)))
        for number in ready:
            if number in sockets:
                sockets[number].receive()
                sockets[number].send()
        for port in ports.values():
            if port.vehicle.next_timer() <= time.monotonic():
                port.send()
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

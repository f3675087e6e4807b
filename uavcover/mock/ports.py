"""Where the mock vehicle listens: a UDP port that answers every sender, or a TCP port that accepts connections."""

import logging
import select
import socket
from collections.abc import Iterable, Iterator
from typing import Generic, TypeVar

from mission_io.clock import MonotonicClock
from mission_io.errors import LinkError
from mission_io.links.stream import FramedChannel, TcpChannel
from mission_io.wire.codec import Codec
from mission_io.wire.messages import Address, Message
from mission_io.wire.telemetry_messages import TimeSync
from uavcover.errors import VehicleError
from uavcover.mock.behaviour import LINK
from uavcover.mock.vehicle import MockVehicle

# The mock vehicle as bytes: its codec, its clock ratio, its pacing, and which ground station receives which message.
#
# Pacing limits how far a vehicle that flies faster than real time may run ahead of the ground stations that listen to it.

PlaceT = TypeVar("PlaceT")


class Pacing(Generic[PlaceT]):
    """Sends TIMESYNC requests after all other messages: the answer shows how far a ground station has read.

    A real vehicle sends no more than a ground station can process; at a hundred times real time a busy machine would lose
    messages that no real link loses. Ground stations that never answer, or have stopped answering, are not waited for.
    """

    def __init__(self) -> None:
        self._asked_s = 0.0
        self._asked_at = 0.0
        self._read_s: dict[PlaceT, float] = {}
        self._waits_since: float | None = None

    def questions(self, vehicle_s: float, now: float) -> list[TimeSync]:
        """The request to send at a vehicle time, and at ``now`` on the link's clock; empty when none is due."""
        due = vehicle_s - self._asked_s >= LINK.ask_every_s
        again = self._waits_since is not None and now - self._asked_at >= LINK.ask_again_s
        if not (due or again):
            return []
        self._asked_s, self._asked_at = vehicle_s, now
        return [TimeSync(answered_ns=0, asked_ns=round(vehicle_s * 1e9))]

    def take(self, place: PlaceT, answer: TimeSync) -> None:
        """Take a ground station's answer to a request of this vehicle; its own requests are ignored."""
        if answer.answered_ns == 0 or not 0 < answer.asked_ns <= round(self._asked_s * 1e9):
            return
        self._read_s[place] = max(self._read_s.get(place, 0.0), answer.asked_ns / 1e9)

    def forget(self) -> None:
        """Wait for no ground station until it answers again: none can hear the vehicle, or be heard."""
        self._read_s.clear()
        self._waits_since = None

    def waits(self, vehicle_s: float, now: float) -> bool:
        """Whether vehicle time must stand still because a ground station lags behind."""
        behind = [place for place, read_s in self._read_s.items() if vehicle_s - read_s > LINK.ahead_s]
        if not behind:
            self._waits_since = None
            return False
        if self._waits_since is None:
            self._waits_since = now
        if now - self._waits_since <= LINK.unanswered_s:
            return True
        for place in behind:
            del self._read_s[place]
        self._waits_since = None
        return False


class MockPeer(Generic[PlaceT]):
    """A mock vehicle behind datagrams; a ``Place`` is the address of a ground station.

    Answers go to the ground station they are for, everything else to all that have spoken. Messages that are ready at
    the same time share a datagram, or a vehicle at a hundred times real time would swamp its listeners' buffers. While the
    vehicle is cut off, no datagram comes in or goes out, those of the pacing included.

    Args:
        vehicle: the vehicle.
        speed: vehicle seconds per second of the link's clock.
        origin_s: the link's time at which the vehicle is switched on.
        paced: whether the vehicle's time waits for ground stations that do not keep up with it.
    """

    def __init__(self, vehicle: MockVehicle, *, speed: float = 1.0, origin_s: float = 0.0, paced: bool = False) -> None:
        self.vehicle = vehicle
        self.speed = speed
        self._pacing: Pacing[PlaceT] | None = Pacing() if paced else None
        self._codec = Codec(system_id=vehicle.address.system_id, component_id=vehicle.address.component_id)
        self._link_s, self._vehicle_s = origin_s, 0.0
        self._places: dict[PlaceT, None] = {}
        self._place_of: dict[Address, PlaceT] = {}

    def greet(self, place: PlaceT) -> None:
        """Treat an address as one that has sent something."""
        self._places[place] = None

    def receive_from(self, place: PlaceT, data: bytes, now: float) -> None:
        """Take a datagram that arrived from an address at ``now`` on the link's clock."""
        vehicle_now = self._vehicle_time(now)
        self.vehicle.advance(vehicle_now)
        if self.vehicle.cut_off:
            return
        for received in self._codec.decode(data):
            if isinstance(received.message, TimeSync) and self._pacing is not None:
                self._pacing.take(place, received.message)
            self._places.pop(place, None)
            self._places[place] = None
            self._place_of[received.sender] = place
            self.vehicle.receive(received, vehicle_now)
        while len(self._places) > LINK.most_places:
            oldest = next(iter(self._places))
            del self._places[oldest]

    def datagrams(self, now: float) -> list[tuple[PlaceT, bytes]]:
        """Datagrams to send by ``now``, with their destinations."""
        self.vehicle.advance(self._vehicle_time(now))
        cut_off = self.vehicle.cut_off
        if cut_off and self._pacing is not None:
            self._pacing.forget()
        waiting: dict[PlaceT, list[bytes]] = {}
        messages = list(self.vehicle.outgoing())
        if self._pacing is not None and not cut_off:
            messages += self._pacing.questions(self._vehicle_s, now)
        for message in messages:
            places = self._places_for(message)
            if places:
                data = self._codec.encode(message)
                for place in places:
                    waiting.setdefault(place, []).append(data)
        return [(place, datagram) for place, parts in waiting.items() for datagram in _joined(parts)]

    def hold_time(self, now: float) -> None:
        """Let the link's clock run to ``now`` while the vehicle's stands still."""
        self._link_s = max(self._link_s, now)

    def _vehicle_time(self, now: float) -> float:
        if self._pacing is not None and self._pacing.waits(self._vehicle_s, now):
            self.hold_time(now)
        elapsed = max(0.0, now - self._link_s)
        self._link_s += elapsed
        self._vehicle_s += elapsed * self.speed
        return self._vehicle_s

    def _places_for(self, message: Message) -> Iterable[PlaceT]:
        system = getattr(message, "target_system", 0)
        if system == 0:
            return list(self._places)
        place = self._place_of.get(Address(system, getattr(message, "target_component", 0)))
        return list(self._places) if place is None else [place]


class InMemoryPeer(MockPeer[None]):
    """The other end of a ``mission_io.links.simulated.SimulatedLink``: one ground station, on a clock that is simulated."""

    def __init__(self, vehicle: MockVehicle, *, speed: float = 1.0) -> None:
        super().__init__(vehicle, speed=speed)
        self._next_tick_s = 0.0

    def receive_datagram(self, data: bytes, now: float) -> None:
        """Take a datagram that arrived at ``now``."""
        self.receive_from(None, data, now)

    def datagrams_to_send(self, now: float) -> list[bytes]:
        """Datagrams of the vehicle at ``now``."""
        if now >= self._next_tick_s:
            self._next_tick_s = now + LINK.peer_tick_s / self.speed
        return [data for _, data in self.datagrams(now)]

    def next_timer(self) -> float:
        """When it must be polled again even if nothing arrives."""
        return self._next_tick_s


def _joined(parts: list[bytes]) -> list[bytes]:
    """The same bytes in as few datagrams as fit the size."""
    result: list[bytes] = []
    current = b""
    for part in parts:
        if current and len(current) + len(part) > LINK.datagram_bytes:
            result.append(current)
            current = b""
        current += part
    return [*result, current] if current else result


_log = logging.getLogger(__name__)

Place = tuple[str, int]
"""Host and port of a ground station."""


class Port:
    """A bound port that receives and sends datagrams or frames without waiting. Raises VehicleError: it cannot be bound."""

    def __init__(self, kind: socket.SocketKind, host: str, port: int) -> None:
        self._socket = socket.socket(socket.AF_INET, kind)
        tcp = kind is socket.SOCK_STREAM
        if tcp:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise VehicleError(
                f"cannot listen on {'TCP' if tcp else 'UDP'} {host}:{port}: {error.strerror}; is the port in use?"
            ) from None
        self._socket.setblocking(False)

    @property
    def number(self) -> int:
        """The port that was bound."""
        number: int = self._socket.getsockname()[1]
        return number

    def wait(self, timeout_s: float) -> None:
        """Wait for data, at most until the timeout."""
        select.select([self._socket], [], [], timeout_s)

    def newcomers(self) -> list[Place]:
        """Addresses that connected since the last call; UDP has no connections."""
        return []

    def take(self) -> Iterator[tuple[Place, bytes]]:
        """Received frames, each with its address."""
        raise NotImplementedError

    def send(self, place: Place, data: bytes) -> None:
        """Send to an address; refused data is lost."""
        raise NotImplementedError

    def close(self) -> None:
        """Let go of the port."""
        self._socket.close()


class UdpPort(Port):
    """A UDP port."""

    def __init__(self, host: str, port: int) -> None:
        super().__init__(socket.SOCK_DGRAM, host, port)

    def take(self) -> Iterator[tuple[Place, bytes]]:
        """The datagrams that are here."""
        while True:
            try:
                data, place = self._socket.recvfrom(65535)
            except BlockingIOError:
                return
            except ConnectionError:
                continue  # a ground station that has gone
            yield (place[0], place[1]), data

    def send(self, place: Place, data: bytes) -> None:
        """Send a datagram."""
        try:
            self._socket.sendto(data, place)
        except (BlockingIOError, ConnectionError):
            return  # lost, like any datagram
        except OSError as error:
            _log.debug("cannot send to %s:%d: %s", *place, error)


class TcpPort(Port):
    """A TCP port with the connections that were made to it."""

    def __init__(self, host: str, port: int) -> None:
        super().__init__(socket.SOCK_STREAM, host, port)
        self._socket.listen(LINK.most_connections)
        self._clock = MonotonicClock()
        self._connections: dict[Place, FramedChannel] = {}
        self._newcomers: list[Place] = []

    def wait(self, timeout_s: float) -> None:
        """Wait for a connection or bytes, at most until the timeout."""
        select.select(
            [self._socket.fileno(), *(c.channel.fileno() for c in self._connections.values())], [], [], timeout_s
        )

    def newcomers(self) -> list[Place]:
        """Addresses that connected since the last call."""
        self._accept()
        newcomers, self._newcomers = self._newcomers, []
        return newcomers

    def take(self) -> Iterator[tuple[Place, bytes]]:
        """The received frames; closed connections are removed."""
        for place, connection in list(self._connections.items()):
            try:
                frames = connection.take() + connection.frames_when_quiet()
            except LinkError as error:
                self._drop(place, error)
                continue
            for frame in frames:
                yield place, frame

    def send(self, place: Place, data: bytes) -> None:
        """Send frames; without room for them at the other end they are lost."""
        connection = self._connections.get(place)
        if connection is None:
            return
        try:
            connection.put(data)
        except LinkError as error:
            self._drop(place, error)

    def close(self) -> None:
        """Let go of the port and of every connection."""
        for connection in self._connections.values():
            connection.channel.close()
        self._connections.clear()
        super().close()

    def _accept(self) -> None:
        while len(self._connections) < LINK.most_connections:
            try:
                sock, address = self._socket.accept()
            except OSError:
                return  # no connection waits
            place = (address[0], address[1])
            self._connections[place] = FramedChannel(TcpChannel(sock, f"TCP {place[0]}:{place[1]}"), self._clock)
            self._newcomers.append(place)

    def _drop(self, place: Place, why: LinkError) -> None:
        _log.debug("%s", why)
        self._connections.pop(place).channel.close()

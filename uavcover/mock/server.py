"""Serve the mock vehicle: on a UDP or TCP port of a process or a thread, or in memory."""

import logging
import select
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from random import Random
from types import FrameType
from typing import Generic

from mission_io.errors import LinkError
from mission_io.links.datagrams import Closing, Link, MonotonicClock, UdpLink
from mission_io.links.opening import LinkUrl, parse_link_url
from mission_io.links.stream import FramedChannel, TcpChannel
from mission_io.wire.codec import Codec
from mission_io.wire.messages import Address, Message
from mission_io.wire.telemetry_messages import TimeSync
from uavcover.errors import InputError, VehicleError
from uavcover.mock.behaviour import LINK
from uavcover.mock.telemetry import EndpointT, Pacing
from uavcover.mock.vehicle import MockVehicle

_log = logging.getLogger(__name__)


class MockPeer(Generic[EndpointT]):
    """A mock vehicle behind datagrams; an ``Endpoint`` is the address of a ground station.

    Answers go to their ground station, everything else to all known stations. Messages that are ready at the same time share a
    datagram, or a vehicle at a hundred times real time would swamp its listeners' buffers. While the vehicle is cut off, no
    datagram comes in or goes out, those of the pacing included.

    Args:
        vehicle: the vehicle.
        speed: vehicle seconds per second of the link's clock.
        origin_s: the link's time at which the vehicle is switched on.
        paced: whether the vehicle's time waits for ground stations that do not keep up with it.
    """

    def __init__(self, vehicle: MockVehicle, *, speed: float = 1.0, origin_s: float = 0.0, paced: bool = False) -> None:
        self.vehicle = vehicle
        self.speed = speed
        self._pacing: Pacing[EndpointT] | None = Pacing() if paced else None
        self._codec = Codec(system_id=vehicle.address.system_id, component_id=vehicle.address.component_id)
        self._link_s, self._vehicle_s = origin_s, 0.0
        self._endpoints: dict[EndpointT, None] = {}
        self._endpoint_of: dict[Address, EndpointT] = {}

    def greet(self, endpoint: EndpointT) -> None:
        """Treat an address as one that has sent something."""
        self._endpoints[endpoint] = None

    def receive_from(self, endpoint: EndpointT, data: bytes, now: float) -> None:
        """Take a datagram that arrived from an address at ``now`` on the link's clock."""
        vehicle_now = self._vehicle_time(now)
        self.vehicle.advance(vehicle_now)
        if self.vehicle.cut_off:
            return
        for received in self._codec.decode(data):
            if isinstance(received.message, TimeSync) and self._pacing is not None:
                self._pacing.take(endpoint, received.message)
            self._endpoints.pop(endpoint, None)
            self._endpoints[endpoint] = None
            self._endpoint_of[received.sender] = endpoint
            self.vehicle.receive(received, vehicle_now)
        while len(self._endpoints) > LINK.most_endpoints:
            oldest = next(iter(self._endpoints))
            del self._endpoints[oldest]

    def datagrams(self, now: float) -> list[tuple[EndpointT, bytes]]:
        """Datagrams to send by ``now``, with their destinations."""
        self.vehicle.advance(self._vehicle_time(now))
        cut_off = self.vehicle.cut_off
        if cut_off and self._pacing is not None:
            self._pacing.forget()
        waiting: dict[EndpointT, list[bytes]] = {}
        messages = list(self.vehicle.outgoing())
        if self._pacing is not None and not cut_off:
            messages += self._pacing.questions(self._vehicle_s, now)
        for message in messages:
            endpoints = self._endpoints_for(message)
            if endpoints:
                data = self._codec.encode(message)
                for endpoint in endpoints:
                    waiting.setdefault(endpoint, []).append(data)
        return [(endpoint, datagram) for endpoint, parts in waiting.items() for datagram in _joined(parts)]

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

    def _endpoints_for(self, message: Message) -> Iterable[EndpointT]:
        system = getattr(message, "target_system", 0)
        if system == 0:
            return list(self._endpoints)
        endpoint = self._endpoint_of.get(Address(system, getattr(message, "target_component", 0)))
        return list(self._endpoints) if endpoint is None else [endpoint]


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


Endpoint = tuple[str, int]
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

    def newcomers(self) -> list[Endpoint]:
        """Addresses that connected since the last call; UDP has no connections."""
        return []

    def take(self) -> Iterator[tuple[Endpoint, bytes]]:
        """Received frames, each with its address."""
        raise NotImplementedError

    def send(self, endpoint: Endpoint, data: bytes) -> None:
        """Send to an address; refused data is lost."""
        raise NotImplementedError

    def close(self) -> None:
        """Let go of the port."""
        self._socket.close()


class UdpPort(Port):
    """A UDP port."""

    def __init__(self, host: str, port: int) -> None:
        super().__init__(socket.SOCK_DGRAM, host, port)

    def take(self) -> Iterator[tuple[Endpoint, bytes]]:
        """The datagrams that are here."""
        while True:
            try:
                data, endpoint = self._socket.recvfrom(65535)
            except BlockingIOError:
                return
            except ConnectionError:
                continue  # a ground station that has gone
            yield (endpoint[0], endpoint[1]), data

    def send(self, endpoint: Endpoint, data: bytes) -> None:
        """Send a datagram."""
        try:
            self._socket.sendto(data, endpoint)
        except (BlockingIOError, ConnectionError):
            return  # lost, like any datagram
        except OSError as error:
            _log.debug("cannot send to %s:%d: %s", *endpoint, error)


class TcpPort(Port):
    """A TCP port with the connections that were made to it."""

    def __init__(self, host: str, port: int) -> None:
        super().__init__(socket.SOCK_STREAM, host, port)
        self._socket.listen(LINK.most_connections)
        self._clock = MonotonicClock()
        self._connections: dict[Endpoint, FramedChannel] = {}
        self._newcomers: list[Endpoint] = []

    def wait(self, timeout_s: float) -> None:
        """Wait for a connection or bytes, at most until the timeout."""
        select.select(
            [self._socket.fileno(), *(c.channel.fileno() for c in self._connections.values())], [], [], timeout_s
        )

    def newcomers(self) -> list[Endpoint]:
        """Addresses that connected since the last call."""
        self._accept()
        newcomers, self._newcomers = self._newcomers, []
        return newcomers

    def take(self) -> Iterator[tuple[Endpoint, bytes]]:
        """The received frames; closed connections are removed."""
        for endpoint, connection in list(self._connections.items()):
            try:
                frames = connection.take() + connection.frames_when_quiet()
            except LinkError as error:
                self._drop(endpoint, error)
                continue
            for frame in frames:
                yield endpoint, frame

    def send(self, endpoint: Endpoint, data: bytes) -> None:
        """Send frames; without room for them at the other end they are lost."""
        connection = self._connections.get(endpoint)
        if connection is None:
            return
        try:
            connection.put(data)
        except LinkError as error:
            self._drop(endpoint, error)

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
            endpoint = (address[0], address[1])
            self._connections[endpoint] = FramedChannel(
                TcpChannel(sock, f"TCP {endpoint[0]}:{endpoint[1]}"), self._clock
            )
            self._newcomers.append(endpoint)

    def _drop(self, endpoint: Endpoint, why: LinkError) -> None:
        _log.debug("%s", why)
        self._connections.pop(endpoint).channel.close()


class MockServer(Closing):
    """Serves one vehicle on one port in real time times ``speed``; a context manager that lets go of the port.

    Raises:
        VehicleError: the port cannot be bound.
    """

    def __init__(
        self,
        vehicle: MockVehicle,  # the vehicle, made with the same ``speed``
        *,
        host: str = "127.0.0.1",  # address to bind
        port: int = 0,  # port to bind; 0 is any free one, see ``port``
        kind: Callable[[str, int], Port] = UdpPort,  # UDP, or TCP
        speed: float = 1.0,  # vehicle seconds per second
        loss: float = 0.0,  # fraction of the datagrams that are lost, each way
        rng: Random | None = None,  # decides which datagrams
        greet: Endpoint | None = None,  # an address that receives messages before it has sent any, or none
    ) -> None:
        if not speed > 0.0:
            raise InputError(f"speed: must be greater than 0, not {speed}")
        if not 0.0 <= loss < 1.0:
            raise InputError(f"loss: must be at least 0 and below 1, not {loss}")
        self._port = kind(host, port)
        self._loss, self._rng = loss, rng if rng is not None else Random(0)
        self._now = time.monotonic()
        self._peer: MockPeer[Endpoint] = MockPeer(vehicle, speed=speed, origin_s=self._now, paced=speed > 1.0)
        if greet is not None:
            self._peer.greet(greet)
        self._said_slow = False

    @property
    def port(self) -> int:
        """The port that was bound."""
        return self._port.number

    def serve(self, stopped: Callable[[], bool]) -> None:
        """Fly and answer until ``stopped`` is true."""
        while not stopped():
            self._port.wait(LINK.tick_s)
            now = time.monotonic()
            if now - self._now > LINK.longest_tick_s:
                self._peer.hold_time(now - LINK.longest_tick_s)
                if not self._said_slow:
                    self._said_slow = True
                    _log.info("this machine is too slow for the requested speed, so the vehicle's time runs slower")
            self._now = now
            for endpoint in self._port.newcomers():
                self._peer.greet(endpoint)
            for endpoint, data in self._port.take():
                if not self._lost():
                    self._peer.receive_from(endpoint, data, now)
            for endpoint, datagram in self._peer.datagrams(now):
                if not self._lost():
                    self._port.send(endpoint, datagram)

    def close(self) -> None:
        """Let go of the port."""
        self._port.close()

    def _lost(self) -> bool:
        return self._loss > 0.0 and self._rng.random() < self._loss


def run(
    # ``udpin://HOST:PORT`` answers every sender, port 0 is any; ``udpout://HOST:PORT`` also speaks first;
    # ``tcpin://HOST:PORT`` talks to every connection
    url: str,
    vehicle: MockVehicle,  # the vehicle, made with the same ``speed``
    *,
    speed: float = 1.0,  # vehicle seconds per second
    loss: float = 0.0,  # fraction of the datagrams that get lost, each way
    seed: int = 0,  # of the loss
    on_bound: Callable[[int], None] | None = None,  # called with the port once it is bound
    ended: Callable[[], bool] = lambda: False,  # asked a hundred times a second
) -> None:
    """Be a vehicle until SIGTERM or SIGINT, or until ``ended`` is true. To be called in the main thread of its process.

    Raises:
        InputError: a URL that is none of these, or a speed or loss out of range.
        VehicleError: the port cannot be bound.
        mission_io.errors.MisuseError: a URL that is not understood.
    """
    endpoint = parse_link_url(url)
    if endpoint.scheme not in ("udpin", "udpout", "tcpin"):
        raise InputError(
            f"{url!r}: the mock vehicle cannot listen at this URL; use udpin://HOST:PORT or tcpin://HOST:PORT"
        )
    stop = threading.Event()

    def end(number: int, frame: FrameType | None) -> None:
        del number, frame
        stop.set()

    inward = endpoint.scheme != "udpout"
    server = MockServer(
        vehicle,
        host=endpoint.host if inward else "0.0.0.0" if endpoint.host not in ("127.0.0.1", "localhost") else "127.0.0.1",
        port=endpoint.port if inward else 0,
        kind=TcpPort if endpoint.scheme == "tcpin" else UdpPort,
        speed=speed,
        loss=loss,
        rng=Random(seed),
        greet=None if inward else (endpoint.host, endpoint.port),
    )
    before = {number: signal.signal(number, end) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        with server:
            if on_bound is not None:
                on_bound(server.port)
            server.serve(lambda: stop.is_set() or ended())
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class BackgroundMock(Closing):
    """A mock vehicle in a thread, on a free port of 127.0.0.1; a context manager that ends it."""

    def __init__(self, vehicle: MockVehicle, *, speed: float = 1.0, loss: float = 0.0, seed: int = 0) -> None:
        self._server = MockServer(vehicle, speed=speed, loss=loss, rng=Random(seed))
        self._stop = threading.Event()
        self.port = self._server.port
        self._thread = threading.Thread(
            target=self._server.serve, args=(self._stop.is_set,), name="mock vehicle", daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """End the thread and let go of the port; closing twice is fine."""
        self._stop.set()
        self._thread.join()
        self._server.close()


class _MockLink(UdpLink):
    """A UDP link to a mock vehicle of its own, which ends with it."""

    background: BackgroundMock | None = None

    def close(self) -> None:
        """Let go of the port and end the vehicle."""
        super().close()
        if self.background is not None:
            self.background.close()


def mock_endpoint(make_vehicle: Callable[[], MockVehicle], *, speed: float) -> Callable[[LinkUrl], Link]:
    """The opener of ``mock:`` for ``open_link``: each link starts its own vehicle, which ends with it.

    Args:
        make_vehicle: makes the vehicle, with the same ``speed``.
        speed: vehicle seconds per second.
    """

    def open_mock(_: LinkUrl) -> Link:
        background = BackgroundMock(make_vehicle(), speed=speed)
        link = _MockLink.connecting("127.0.0.1", background.port)
        link.background = background
        return link

    return open_mock

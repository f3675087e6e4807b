"""Where the mock vehicle listens: a UDP port that answers every sender, or a TCP port that accepts connections."""

import logging
import select
import socket
from collections.abc import Iterator
from typing import Protocol

from mission_io.clock import MonotonicClock
from mission_io.errors import LinkError
from mission_io.links.stream import FramedChannel
from mission_io.links.tcp import TcpChannel
from uavcover.errors import VehicleError
from uavcover.mock.tuning import LINK

_log = logging.getLogger(__name__)

Place = tuple[str, int]
"""Host and port of a ground station."""


class Port(Protocol):
    """A bound port that receives and sends datagrams or frames without waiting."""

    @property
    def number(self) -> int:
        """The port that was bound."""

    def wait(self, timeout_s: float) -> None:
        """Wait for data, at most until the timeout."""

    def newcomers(self) -> list[Place]:
        """Addresses that connected since the last call."""

    def take(self) -> Iterator[tuple[Place, bytes]]:
        """Received frames, each with its address."""

    def send(self, place: Place, data: bytes) -> None:
        """Send to an address; refused data is lost."""

    def close(self) -> None:
        """Let go of the port."""


class UdpPort:
    """A UDP port.

    Raises:
        VehicleError: it cannot be bound.
    """

    def __init__(self, host: str, port: int) -> None:
        self._socket = _bound(socket.SOCK_DGRAM, host, port)

    @property
    def number(self) -> int:
        """The port that was bound."""
        number: int = self._socket.getsockname()[1]
        return number

    def wait(self, timeout_s: float) -> None:
        """Wait for a datagram, at most until the timeout."""
        select.select([self._socket], [], [], timeout_s)

    def newcomers(self) -> list[Place]:
        """None: UDP has no connections."""
        return []

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

    def close(self) -> None:
        """Let go of the port."""
        self._socket.close()


class TcpPort:
    """A TCP port with the connections that were made to it.

    Raises:
        VehicleError: it cannot be bound.
    """

    def __init__(self, host: str, port: int) -> None:
        self._socket = _bound(socket.SOCK_STREAM, host, port)
        self._socket.listen(LINK.most_connections)
        self._clock = MonotonicClock()
        self._connections: dict[Place, FramedChannel] = {}
        self._newcomers: list[Place] = []

    @property
    def number(self) -> int:
        """The port that was bound."""
        number: int = self._socket.getsockname()[1]
        return number

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
        self._socket.close()

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


def _bound(kind: socket.SocketKind, host: str, port: int) -> socket.socket:
    sock = socket.socket(socket.AF_INET, kind)
    name = "TCP" if kind is socket.SOCK_STREAM else "UDP"
    if kind is socket.SOCK_STREAM:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        sock.bind((host, port))
    except OSError as error:
        sock.close()
        raise VehicleError(f"cannot listen on {name} {host}:{port}: {error.strerror}; is the port taken?") from None
    sock.setblocking(False)
    return sock

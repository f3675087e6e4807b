"""The interface of a link, which carries datagrams, with its clock; and links over UDP."""

import logging
import select
import socket
import time
from abc import ABC, abstractmethod
from types import TracebackType
from typing import Final, Protocol, Self, runtime_checkable

from mission_io.errors import LinkError
from mission_io.wire.codec import FramingCounts, frames_of

DEFAULT_HOST: Final = "127.0.0.1"
DEFAULT_BAUD: Final = 57_600
"""What telemetry radios come with; a flight controller's own USB takes any."""


class Clock(Protocol):
    """Seconds from an arbitrary start that never go back."""

    def now(self) -> float:
        """The present time in seconds."""


class MonotonicClock:
    """The operating system's monotonic clock."""

    def now(self) -> float:
        """The present time in seconds; only differences mean something."""
        return time.monotonic()


class Link(Protocol):
    """Carries datagrams, unreliably. Its time-outs are measured by its own clock."""

    @property
    def clock(self) -> Clock:
        """The clock that ``receive`` waits by; simulated links have their own."""

    def send(self, data: bytes) -> None:
        """Send one datagram, which may get lost silently."""

    def receive(self, timeout_s: float) -> bytes | None:
        """The next datagram, or None when none arrived within ``timeout_s`` seconds."""

    def close(self) -> None:
        """Release the port; may be called twice."""


@runtime_checkable
class PeerLink(Protocol):
    """A link with several peers that can be restricted to one."""

    def keep_to(self, system_id: int, component_id: int) -> None:
        """Communicate with this sender's address only."""

    def let_go(self) -> None:
        """Communicate with everybody again."""


class Closing(ABC):
    """Something open; a context manager that closes it."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @abstractmethod
    def close(self) -> None:
        """Let go of it; may be called twice."""


def port_of(sock: socket.socket) -> int:
    """The port that a socket is bound to. Raises LinkError: it is closed."""
    try:
        port: int = sock.getsockname()[1]
    except OSError as error:
        raise LinkError(f"the link is closed: {error}") from None
    return port


class WrappingLink:
    """Base of links that wrap another one."""

    def __init__(self, link: Link) -> None:
        self._link = link

    @property
    def clock(self) -> Clock:
        """The clock of the link inside."""
        return self._link.clock

    def keep_to(self, system_id: int, component_id: int) -> None:
        """Communicate with this sender's address only, if the inner link can."""
        if isinstance(self._link, PeerLink):
            self._link.keep_to(system_id, component_id)

    def let_go(self) -> None:
        """Communicate with everybody again."""
        if isinstance(self._link, PeerLink):
            self._link.let_go()

    def close(self) -> None:
        """Close the link inside."""
        self._link.close()


@runtime_checkable
class StreamLink(Protocol):
    """A link that splits a byte stream into frames itself, and therefore counts the garbage."""

    @property
    def framing(self) -> FramingCounts:
        """Counts of bytes that were no frames."""


def framing_of(link: Link) -> FramingCounts:
    """Counts of bytes of a stream that were no frames; zero for a link of datagrams."""
    return link.framing if isinstance(link, StreamLink) else FramingCounts()


# The addresses that speak to a listening port, and the addresses to send to.

FORGOTTEN_AFTER_S: Final = 15.0
"""Silence after which an address is no longer sent to, unless it is the only one."""

MOST_PEERS: Final = 16

TAKE_OVER_S: Final = 3.0
"""Silence of its address after which a kept vehicle may speak from another one (it was switched off and on)."""

Endpoint = tuple[str, int]
"""Host and port."""

_HEARTBEAT = 0
_MOST_SENDERS = 256

_log = logging.getLogger(__name__)


class Endpoints:
    """The addresses that a listening port hears, until ``keep_to`` chooses the one of a vehicle.

    Attributes:
        latest: The place that was heard last; the vehicle's while one is kept to. None before that.
        strangers: How many datagrams came from elsewhere than the place that is kept to.
    """

    def __init__(self) -> None:
        self.latest: Endpoint | None = None
        self.strangers = 0
        self._heard_s: dict[Endpoint, float] = {}
        self._endpoint_of: dict[tuple[int, int], Endpoint] = {}
        self._kept: tuple[int, int] | None = None
        self._chosen: Endpoint | None = None
        self._twins: set[Endpoint] = set()  # where the kept vehicle's ids were heard while it spoke itself
        self._kept_heard_s = 0.0

    def hears(self, data: bytes, endpoint: Endpoint, now: float) -> bool:
        """Note the sender's address of a datagram; whether it is for us."""
        if self._kept is not None and endpoint != self.latest:
            is_early = now - self._kept_heard_s <= TAKE_OVER_S and endpoint != self._chosen
            is_same = self._kept in _heartbeats_in(data)
            if is_early or not is_same or endpoint in self._twins:
                self.strangers += 1
                if is_same and endpoint not in self._twins and len(self._twins) < MOST_PEERS:
                    self._twins.add(endpoint)
                    _log.warning("system %d also sends from %s:%d, which is ignored", self._kept[0], *endpoint)
                return False
            _log.warning("system %d now sends from %s:%d", self._kept[0], *endpoint)
        self.latest, self._kept_heard_s = endpoint, now
        self._heard_s.pop(endpoint, None)
        self._heard_s[endpoint] = now
        if self._kept is None:
            for sender in _heartbeats_in(data):
                if len(self._endpoint_of) < _MOST_SENDERS:
                    self._endpoint_of.setdefault(sender, endpoint)
        return True

    def to_send_to(self, now: float) -> tuple[Endpoint, ...]:
        """The address that is kept to, or all recently heard ones."""
        if self._kept is not None:
            return () if self.latest is None else (self.latest,)
        for endpoint, heard_s in list(self._heard_s.items())[:-1]:
            if now - heard_s > FORGOTTEN_AFTER_S or len(self._heard_s) > MOST_PEERS:
                del self._heard_s[endpoint]
        return tuple(self._heard_s)

    def keep_to(self, system_id: int, component_id: int, now: float) -> None:
        """From here on there is only the address of this sender's heartbeats, if they were heard.

        When nothing came from there for ``TAKE_OVER_S`` seconds, a heartbeat of the same sender from a place that was silent
        before moves it; the next one from here, where the other was another vehicle, moves it back at once.
        """
        endpoint = self._endpoint_of.get((system_id, component_id))
        if endpoint is None:
            return
        self._kept, self.latest, self._kept_heard_s = (system_id, component_id), endpoint, now
        self._chosen = endpoint

    def let_go(self) -> None:
        """Hear everybody again, and learn anew where each speaks from."""
        self._kept = None
        self._endpoint_of.clear()


def _heartbeats_in(data: bytes) -> set[tuple[int, int]]:
    """System and component of the heartbeats in a datagram."""
    return {(frame.system_id, frame.component_id) for frame in frames_of(data) if frame.message_id == _HEARTBEAT}


class UdpLink(Closing):
    """Datagrams over UDP. Made by ``listening`` or ``connecting``; a context manager.

    A connecting link sends to one address and port, and hears nothing else: the operating system drops what comes from
    elsewhere.

    A listening link learns its peers from their datagrams: each message goes to every address that was heard recently, since
    several vehicles may speak to one port and each knows by the ids in a message whether it is meant. A message
    before the first peer is lost, as with a radio without a listener. From ``keep_to`` on there is one peer: the place
    that the vehicle speaks from. Datagrams of others to the port are dropped, and nothing is sent to them.
    """

    def __init__(self, sock: socket.socket, peer: Endpoint | None, *, clock: Clock | None = None) -> None:
        self._socket, self._peer = sock, peer
        self._clock = clock if clock is not None else MonotonicClock()
        self._endpoints = Endpoints()
        sock.setblocking(False)

    @classmethod
    def listening(cls, host: str = DEFAULT_HOST, port: int = 0, *, clock: Clock | None = None) -> Self:
        """Wait on a port; 0 takes any free one (see ``local_port``)."""
        sock, address = _udp_socket(host, port)
        try:
            sock.bind(address)
        except OSError as error:
            sock.close()
            raise LinkError(f"cannot listen on UDP {host}:{port}: {error.strerror}; is the port in use?") from None
        return cls(sock, None, clock=clock)

    @classmethod
    def connecting(cls, host: str, port: int) -> Self:
        """Send to an address, and receive its answers."""
        sock, address = _udp_socket(host, port)
        try:
            sock.connect(address)
        except OSError as error:
            sock.close()
            raise LinkError(f"cannot reach UDP {host}:{port}: {error.strerror}") from None
        return cls(sock, address)

    @property
    def clock(self) -> Clock:
        """The operating system's monotonic clock."""
        return self._clock

    @property
    def local_port(self) -> int:
        """The UDP port of this end."""
        return port_of(self._socket)

    @property
    def learns_peers(self) -> bool:
        """Whether it listens, and so may have several peers."""
        return self._peer is None

    @property
    def peer(self) -> Endpoint | None:
        """Host and port of the other end, the one heard last if there are several; None before that."""
        return self._endpoints.latest if self._peer is None else self._peer

    @property
    def peers(self) -> tuple[Endpoint, ...]:
        """Where a datagram would be sent to now."""
        return self._endpoints.to_send_to(self._clock.now()) if self._peer is None else (self._peer,)

    @property
    def strangers(self) -> int:
        """Number of datagrams from other addresses than the one that is kept to."""
        return self._endpoints.strangers

    def send(self, data: bytes) -> None:
        """Send one datagram to the peers.

        Raises:
            LinkError: the operating system refuses; a peer that is not there yet is no error.
        """
        for peer in self.peers:
            self.send_to(peer, data)

    def send_to(self, endpoint: Endpoint, data: bytes) -> None:
        """Send one datagram to an address; a connecting link knows only one.

        Raises:
            LinkError: the operating system refuses.
        """
        try:
            if self._peer is None:
                self._socket.sendto(data, endpoint)
                return
            try:
                self._socket.send(data)
            except ConnectionRefusedError:  # an earlier datagram found no listener, which stopped this one
                self._socket.send(data)
        except (ConnectionRefusedError, BlockingIOError):
            return  # no listener yet, or the send buffer is full: lost, like any datagram
        except OSError as error:
            raise LinkError(f"cannot send to {endpoint[0]}:{endpoint[1]}: {error}") from None

    def keep_to(self, system_id: int, component_id: int) -> None:
        """From here on talk only to the address of this sender's frames; a connecting link always does.

        A stranger's datagrams on the port are dropped and counted in ``strangers``. When nothing came from the kept place for
        ``TAKE_OVER_S`` seconds, a heartbeat of the same sender from another place moves the link there.
        """
        if self._peer is None:
            self._endpoints.keep_to(system_id, component_id, self._clock.now())

    def let_go(self) -> None:
        """Hear everybody again, and learn anew where each speaks from."""
        self._endpoints.let_go()

    def receive(self, timeout_s: float) -> bytes | None:
        """The next datagram, or None after ``timeout_s`` seconds."""
        deadline = self._clock.now() + timeout_s
        while (arrived := self.receive_from(deadline - self._clock.now())) is not None:
            data, endpoint = arrived
            if self._peer is not None or self._endpoints.hears(data, endpoint, self._clock.now()):
                return data
        return None

    def receive_from(self, timeout_s: float) -> tuple[bytes, Endpoint] | None:
        """The next datagram from any address, with that address, or None after ``timeout_s`` seconds.

        Raises:
            LinkError: the link is closed, or the operating system refuses.
        """
        deadline = self._clock.now() + timeout_s
        while True:
            try:
                ready, _, _ = select.select([self._socket], [], [], max(0.0, deadline - self._clock.now()))
                if not ready:
                    return None
                data, address = self._socket.recvfrom(65535)
            except (ConnectionRefusedError, BlockingIOError):
                continue  # an earlier datagram found no listener
            except (OSError, ValueError) as error:
                raise LinkError(f"cannot receive datagrams: {error}") from None
            return data, (address[0], address[1])

    def close(self) -> None:
        """Let go of the port."""
        self._socket.close()


def _udp_socket(host: str, port: int) -> tuple[socket.socket, tuple[str, int]]:
    """A socket of the right family for a host, and the host's address.

    Raises:
        LinkError: the name of the host means nothing here.
    """
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    except (OSError, UnicodeError) as error:
        raise LinkError(f"cannot find the host {host!r}: {error}") from None
    return socket.socket(family, kind), (str(address[0]), int(address[1]))

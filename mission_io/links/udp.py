"""Datagrams over UDP."""

import logging
import select
import socket
from types import TracebackType
from typing import Final, Self

from mission_io.clock import Clock, MonotonicClock
from mission_io.errors import LinkError
from mission_io.links.base import DEFAULT_HOST
from mission_io.wire.framing import Framer

FORGOTTEN_AFTER_S: Final = 15.0
"""A listening link stops sending to a place that has been silent for so long, unless it is the only one."""

MOST_PEERS: Final = 16

TAKE_OVER_S: Final = 3.0
"""A vehicle that is kept to may speak from another place (it was switched off and on) when its own was silent for so long."""

_HEARTBEAT = 0
_MOST_SENDERS = 256

_log = logging.getLogger(__name__)


class UdpLink:
    """Datagrams over UDP. Made by ``listening`` or ``connecting``; a context manager.

    A connecting link sends to one address and port, and hears nothing else: the operating system drops what comes from
    elsewhere.

    A listening link learns its peers from their datagrams: what is sent goes to every place that was heard lately, since
    several vehicles may speak to one port and each knows by the ids in a message whether it is meant. What is sent
    before anybody was heard is lost, as with a radio that nobody listens to. From ``keep_to`` on there is one peer: the place
    that the vehicle speaks from. Whatever others send to the port is dropped, and nothing is sent to them.
    """

    def __init__(
        self,
        sock: socket.socket,
        peer: tuple[str, int] | None,
        *,
        learns_peer: bool,
        clock: Clock | None = None,
    ) -> None:
        self._socket, self._peer, self._learns_peer = sock, peer, learns_peer
        self._clock = clock if clock is not None else MonotonicClock()
        self._heard_s: dict[tuple[str, int], float] = {}
        self._place_of: dict[tuple[int, int], tuple[str, int]] = {}
        self._kept: tuple[int, int] | None = None
        self._kept_heard_s = 0.0
        self.strangers = 0
        sock.setblocking(False)

    @classmethod
    def listening(cls, host: str = DEFAULT_HOST, port: int = 0, *, clock: Clock | None = None) -> Self:
        """Wait on a port; 0 takes any free one (see ``local_port``)."""
        sock, address = _udp_socket(host, port)
        try:
            sock.bind(address)
        except OSError as error:
            sock.close()
            raise LinkError(f"cannot listen on UDP {host}:{port}: {error.strerror}; is the port taken?") from None
        return cls(sock, None, learns_peer=True, clock=clock)

    @classmethod
    def connecting(cls, host: str, port: int) -> Self:
        """Send to a place, and receive what comes back from there."""
        sock, address = _udp_socket(host, port)
        try:
            sock.connect(address)
        except OSError as error:
            sock.close()
            raise LinkError(f"cannot reach UDP {host}:{port}: {error.strerror}") from None
        return cls(sock, address, learns_peer=False)

    @property
    def clock(self) -> Clock:
        """The operating system's monotonic clock."""
        return self._clock

    @property
    def local_port(self) -> int:
        """The UDP port of this end."""
        try:
            port: int = self._socket.getsockname()[1]
        except OSError as error:
            raise LinkError(f"the link is closed: {error}") from None
        return port

    @property
    def peer(self) -> tuple[str, int] | None:
        """Host and port of the other end, the one heard last if there are several; None before that."""
        return self._peer

    @property
    def peers(self) -> tuple[tuple[str, int], ...]:
        """Where a datagram would be sent to now."""
        if self._learns_peer and self._kept is None:
            self._forget(self._clock.now())
            return tuple(self._heard_s)
        return () if self._peer is None else (self._peer,)

    def send(self, data: bytes) -> None:
        """Send one datagram to the peers.

        Raises:
            LinkError: the operating system refuses; a peer that is not there yet is no error.
        """
        for peer in self.peers:
            try:
                self._send_to(peer, data)
            except (ConnectionRefusedError, BlockingIOError):
                continue  # nobody there yet, or the send buffer is full: lost, like any datagram
            except OSError as error:
                raise LinkError(f"cannot send to {peer[0]}:{peer[1]}: {error}") from None

    def keep_to(self, system_id: int, component_id: int) -> None:
        """From here on talk only to the place that this sender's frames come from; a connecting link always does.

        A stranger's datagrams on the port are dropped and counted in ``strangers``. When nothing came from the kept place for
        ``TAKE_OVER_S`` seconds, a heartbeat of the same sender from another place moves the link there.
        """
        place = self._place_of.get((system_id, component_id))
        if not self._learns_peer or place is None:
            return
        self._kept, self._peer = (system_id, component_id), place
        self._kept_heard_s = self._clock.now()

    def let_go(self) -> None:
        """Hear everybody again, and learn anew where each speaks from."""
        self._kept = None
        self._place_of.clear()

    def _send_to(self, peer: tuple[str, int], data: bytes) -> None:
        if self._learns_peer:
            self._socket.sendto(data, peer)
            return
        try:
            self._socket.send(data)
        except ConnectionRefusedError:  # an earlier datagram found nobody there, and this one was not sent for it
            self._socket.send(data)

    def receive(self, timeout_s: float) -> bytes | None:
        """The next datagram, or None after ``timeout_s`` seconds."""
        deadline = self._clock.now() + timeout_s
        while True:
            try:
                ready, _, _ = select.select([self._socket], [], [], max(0.0, deadline - self._clock.now()))
                if not ready:
                    return None
                data, address = self._socket.recvfrom(65535)
            except (ConnectionRefusedError, BlockingIOError):
                continue  # an earlier datagram found nobody there
            except (OSError, ValueError) as error:
                raise LinkError(f"cannot receive: {error}") from None
            place = (address[0], address[1])
            if self._learns_peer and not self._is_from_peer(data, place):
                self.strangers += 1
                continue
            return data

    def close(self) -> None:
        """Let go of the port."""
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _is_from_peer(self, data: bytes, place: tuple[str, int]) -> bool:
        """Take note of where a datagram came from; whether it is for us to hear."""
        now = self._clock.now()
        if self._kept is not None and place != self._peer:
            if now - self._kept_heard_s <= TAKE_OVER_S or self._kept not in _heartbeats_in(data):
                return False
            _log.warning("system %d speaks from %s:%d now", self._kept[0], *place)
        self._peer, self._kept_heard_s = place, now
        self._heard_s.pop(place, None)
        self._heard_s[place] = now
        if self._kept is None:
            for sender in _heartbeats_in(data):
                if len(self._place_of) < _MOST_SENDERS:
                    self._place_of.setdefault(sender, place)
        return True

    def _forget(self, now: float) -> None:
        """Drop the places that were silent for long, or too many; the one heard last stays."""
        for place, heard_s in list(self._heard_s.items())[:-1]:
            if now - heard_s > FORGOTTEN_AFTER_S or len(self._heard_s) > MOST_PEERS:
                del self._heard_s[place]


def _heartbeats_in(data: bytes) -> set[tuple[int, int]]:
    """System and component of the heartbeats in a datagram."""
    framer = Framer()
    frames = [*framer.feed(data), *framer.end()]
    return {(frame.system_id, frame.component_id) for frame in frames if frame.message_id == _HEARTBEAT}


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

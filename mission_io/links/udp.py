"""Datagrams over UDP."""

import select
import socket
from types import TracebackType
from typing import Final, Self

from mission_io.clock import Clock, MonotonicClock
from mission_io.errors import LinkError
from mission_io.links.url import DEFAULT_HOST

FORGOTTEN_AFTER_S: Final = 15.0
"""A listening link stops sending to a place that has been silent for so long, unless it is the only one."""

MOST_PEERS: Final = 16


class UdpLink:
    """Datagrams over UDP. Made by ``listening`` or ``connecting``; a context manager.

    A listening link learns its peers from their datagrams: what is sent goes to every place that was heard lately, since
    several vehicles may speak to one port and each knows by the ids in a message whether it is meant. What is sent
    before anybody was heard is lost, as with a radio that nobody listens to.
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
        return cls(sock, address, learns_peer=False)

    @property
    def clock(self) -> Clock:
        """The operating system's monotonic clock."""
        return self._clock

    @property
    def local_port(self) -> int:
        """The UDP port of this end; 0 before a connecting link has sent anything."""
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
        if self._learns_peer:
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
                self._socket.sendto(data, peer)
            except (ConnectionRefusedError, BlockingIOError):
                continue  # nobody there yet, or the send buffer is full: lost, like any datagram
            except OSError as error:
                raise LinkError(f"cannot send to {peer[0]}:{peer[1]}: {error}") from None

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
            if self._learns_peer:
                self._peer = place
                self._heard_s.pop(place, None)
                self._heard_s[place] = self._clock.now()
            elif self._peer is not None and place[1] != self._peer[1]:
                continue  # a stranger
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

    def _forget(self, now: float) -> None:
        """Drop the places that were silent for long, or too many; the one heard last stays."""
        for place, heard_s in list(self._heard_s.items())[:-1]:
            if now - heard_s > FORGOTTEN_AFTER_S or len(self._heard_s) > MOST_PEERS:
                del self._heard_s[place]


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

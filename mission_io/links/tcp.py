"""Frames over TCP: to one address, or from everybody who connects."""

import logging
import socket
from collections import deque
from typing import Final

from mission_io.clock import Clock, MonotonicClock
from mission_io.errors import LinkError
from mission_io.links.base import DEFAULT_HOST, Closing, port_of
from mission_io.links.stream import ChannelLink, FramedChannel, OpenChannel, wait_for
from mission_io.wire.framing import FramingCounts

CONNECT_TIMEOUT_S: Final = 5.0
MOST_PEERS: Final = 16

_log = logging.getLogger(__name__)


class TcpChannel(OpenChannel):
    """One TCP connection, without waiting."""

    end = "the other side closed the connection"

    def __init__(self, sock: socket.socket, name: str) -> None:
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # a mission item must not wait for the next one
        super().__init__(name)
        self._socket = sock

    def fileno(self) -> int:
        """The number of its socket."""
        return self._socket.fileno()

    def receive(self, size: int) -> bytes:
        """Bytes that have arrived, as the socket has it."""
        return self._socket.recv(size)

    def send(self, data: bytes) -> int:
        """Send, as the socket does it."""
        return self._socket.send(data)

    def close(self) -> None:
        """Let go of it."""
        self._socket.close()


def connect_tcp(host: str, port: int, *, timeout_s: float = CONNECT_TIMEOUT_S) -> ChannelLink:
    """A link to an address that listens on TCP.

    Raises:
        LinkError: no listener there, or no answer within ``timeout_s`` seconds.
    """
    try:
        sock = socket.create_connection((host, port), timeout=timeout_s)
    except (OSError, UnicodeError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise LinkError(
            f"cannot connect to TCP {host}:{port}: {why}; is the vehicle switched on and listening at this address?"
        ) from None
    return ChannelLink(TcpChannel(sock, f"TCP {host}:{port}"))


class TcpListeningLink(Closing):
    """Everybody who connects to a TCP port, as one link; a context manager.

    What is sent goes to all of them, what they send comes in the order in which it arrives. One that connects or goes
    away is a line in the log and no error: the next one may come. Messages without a connection are lost.
    """

    def __init__(self, host: str = DEFAULT_HOST, port: int = 0) -> None:
        try:
            family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        except (OSError, UnicodeError) as error:
            raise LinkError(f"cannot find the host {host!r}: {error}") from None
        self._listener = socket.socket(family, kind)
        try:
            self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._listener.bind(address)
            self._listener.listen(MOST_PEERS)
        except OSError as error:
            self._listener.close()
            raise LinkError(f"cannot listen on TCP {host}:{port}: {error.strerror}; is the port in use?") from None
        self._listener.setblocking(False)
        self._clock = MonotonicClock()
        self._peers: dict[int, FramedChannel] = {}
        self._frames: deque[bytes] = deque()
        self._framing_before = FramingCounts()

    @property
    def clock(self) -> Clock:
        """The operating system's monotonic clock."""
        return self._clock

    @property
    def local_port(self) -> int:
        """The TCP port that was bound."""
        return port_of(self._listener)

    @property
    def peers(self) -> tuple[str, ...]:
        """The names of those who are connected."""
        return tuple(peer.channel.name for peer in self._peers.values())

    @property
    def framing(self) -> FramingCounts:
        """Bytes that were no frame, from all connections so far."""
        return sum((peer.framing for peer in self._peers.values()), self._framing_before)

    def send(self, data: bytes) -> None:
        """Send a frame to everybody who is connected. Raises LinkError: the link is closed."""
        self._serve(0.0)
        for peer in list(self._peers.values()):
            try:
                peer.put(data)
            except LinkError as error:
                self._drop(peer, error)

    def receive(self, timeout_s: float) -> bytes | None:
        """The next frame of any connection, or None after ``timeout_s`` seconds.

        Raises:
            LinkError: the link is closed.
        """
        deadline = self._clock.now() + timeout_s
        while not self._frames:
            quiet = [peer.quiet_at_s for peer in self._peers.values() if peer.quiet_at_s is not None]
            idle = self._serve(min([deadline, *quiet]) - self._clock.now())
            if idle and not self._frames and self._clock.now() >= deadline:
                return None
        return self._frames.popleft()

    def close(self) -> None:
        """Let go of the port and of everybody; closing twice is fine."""
        self._listener.close()
        for peer in self._peers.values():
            peer.channel.close()

    def _serve(self, timeout_s: float) -> bool:
        """Wait once, then accept, read and write what there is; whether there was nothing."""
        channels = {number: peer.channel for number, peer in self._peers.items()}
        writers = [peer.channel for peer in self._peers.values() if peer.has_to_send]
        readable, writable = wait_for([self._listener, *channels.values()], writers, timeout_s)
        for number, channel in channels.items():
            peer = self._peers[number]
            try:
                if channel in writable:
                    peer.flush()
                self._frames.extend(peer.take() if channel in readable else peer.frames_when_quiet())
            except LinkError as error:
                self._drop(peer, error)
        if self._listener in readable:
            self._accept()
        return not readable

    def _accept(self) -> None:
        try:
            sock, address = self._listener.accept()
        except OSError:
            return  # it has gone again already
        channel = TcpChannel(sock, f"TCP {address[0]}:{address[1]}")
        if len(self._peers) >= MOST_PEERS:
            _log.warning("rejected %s, because %d clients are already connected", channel.name, MOST_PEERS)
            channel.close()
            return
        _log.info("%s has connected", channel.name)
        self._peers[channel.fileno()] = FramedChannel(channel, self._clock)

    def _drop(self, peer: FramedChannel, why: LinkError) -> None:
        _log.warning("%s", why)
        self._framing_before += peer.framing
        self._peers = {number: other for number, other in self._peers.items() if other is not peer}
        peer.channel.close()

"""Links that carry datagrams to and from a vehicle, and the URLs that name them.

``udpin://HOST:PORT`` and ``udp:HOST:PORT`` wait on a port for the vehicle to speak first, ``udpout://HOST:PORT`` speaks
first. Nothing listens beyond this machine unless the URL names such a host.
"""

import select
import socket
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

from mission_io.clock import Clock, MonotonicClock
from mission_io.errors import LinkError, MisuseError


class Link(Protocol):
    """Carries datagrams, unreliably. Its clock is the one that its time-outs are measured with."""

    @property
    def clock(self) -> Clock:
        """The clock that ``receive`` waits by; simulated links have their own."""
        ...

    def send(self, data: bytes) -> None:
        """Send one datagram; it may get lost without a word."""
        ...

    def receive(self, timeout_s: float) -> bytes | None:
        """The next datagram, or None when none came within ``timeout_s`` seconds."""
        ...

    def close(self) -> None:
        """Let go of the port; closing twice is fine."""
        ...


@dataclass(frozen=True, slots=True)
class LinkUrl:
    """A link's URL in its parts; ``scheme`` is the canonical one, whichever form was written."""

    scheme: str
    host: str = ""
    port: int = 0
    rest: str = ""


_DEFAULT_HOST = "127.0.0.1"
_UDP_SCHEMES = {"udpin": "udpin", "udp": "udpin", "udpout": "udpout"}
_LATER_SCHEMES = ("tcp", "tcpin", "serial")
_SUPPORTED = "udpin://HOST:PORT, udpout://HOST:PORT or udp:HOST:PORT"

EndpointFactory = Callable[[LinkUrl], Link]
_endpoints: dict[str, EndpointFactory] = {}


def register_endpoint(scheme: str, factory: EndpointFactory) -> None:
    """Make ``scheme:`` a link URL that ``open_link`` gives to ``factory``; a second registration replaces the first."""
    if not scheme.isidentifier() or scheme in _UDP_SCHEMES or scheme in _LATER_SCHEMES:
        raise MisuseError(f"{scheme!r} cannot be registered as a link scheme")
    _endpoints[scheme] = factory


def parse_link_url(url: str) -> LinkUrl:
    """Take a link URL apart without opening anything.

    Raises:
        MisuseError: a scheme that is not supported, or a missing or impossible port; it says what is.
    """
    if url.startswith("/dev/"):
        return LinkUrl("serial", rest=url)
    scheme, colon, rest = url.partition(":")
    rest = rest.removeprefix("//")
    if colon and scheme in _endpoints:
        return LinkUrl(scheme, rest=rest)
    if colon and scheme in _LATER_SCHEMES:
        return LinkUrl(scheme, rest=rest)
    if not colon or scheme not in _UDP_SCHEMES:
        known = ", ".join([_SUPPORTED, *(f"{name}:" for name in sorted(_endpoints))])
        raise MisuseError(f"{url!r} is no link this version can open; use {known}")
    host, _, port_text = rest.rpartition(":")
    if not (port_text.isascii() and port_text.isdigit() and int(port_text) <= 65535):
        raise MisuseError(f"{url!r} has no port from 0 to 65535 after its last colon")
    port = int(port_text)
    if port == 0 and scheme == "udpout":
        raise MisuseError(f"{url!r}: nothing can be sent to port 0")
    return LinkUrl(_UDP_SCHEMES[scheme], host.strip("[]") or _DEFAULT_HOST, port)


def open_link(url: str) -> Link:
    """Open the link that a URL names.

    Raises:
        MisuseError: a URL that is not understood or not supported by this version.
        LinkError: the operating system refuses, for instance because the port is taken.
    """
    parsed = parse_link_url(url)
    if parsed.scheme in _endpoints:
        return _endpoints[parsed.scheme](parsed)
    if parsed.scheme == "udpin":
        return UdpLink.listening(parsed.host, parsed.port)
    if parsed.scheme == "udpout":
        return UdpLink.connecting(parsed.host, parsed.port)
    raise MisuseError(f"{url!r}: {parsed.scheme} links are not in this version; use {_SUPPORTED}")


class UdpLink:
    """Datagrams over UDP. Made by ``listening`` or ``connecting``; a context manager.

    A listening link learns its peer from the first datagram, follows it when it moves to another port, and drops what
    it is asked to send before it has a peer, as a radio that nobody listens to would.
    """

    def __init__(self, sock: socket.socket, peer: tuple[str, int] | None, *, learns_peer: bool) -> None:
        self._socket, self._peer, self._learns_peer = sock, peer, learns_peer
        self._clock = MonotonicClock()
        sock.setblocking(False)

    @classmethod
    def listening(cls, host: str = _DEFAULT_HOST, port: int = 0) -> Self:
        """Wait on a port; 0 takes any free one (see ``local_port``)."""
        sock, address = _udp_socket(host, port)
        try:
            sock.bind(address)
        except OSError as error:
            sock.close()
            raise LinkError(f"cannot listen on UDP {host}:{port}: {error.strerror}; is the port taken?") from None
        return cls(sock, None, learns_peer=True)

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
        """Host and port of the other end; None while a listening link has heard nobody."""
        return self._peer

    def send(self, data: bytes) -> None:
        """Send one datagram to the peer.

        Raises:
            LinkError: the operating system refuses; a peer that is not there yet is no error.
        """
        if self._peer is None:
            return
        try:
            self._socket.sendto(data, self._peer)
        except (ConnectionRefusedError, BlockingIOError):
            return  # nobody there yet, or the send buffer is full: lost, like any datagram
        except OSError as error:
            raise LinkError(f"cannot send to {self._peer[0]}:{self._peer[1]}: {error}") from None

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
            if self._learns_peer:
                self._peer = (address[0], address[1])
            elif self._peer is not None and address[1] != self._peer[1]:
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

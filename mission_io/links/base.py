"""The interface of a link, as the rest of the package sees it, and the URLs that name links.

URLs, including the short forms of pilots' tools, are parsed without opening anything.
"""

import re
import socket
from abc import ABC, abstractmethod
from dataclasses import dataclass
from types import TracebackType
from typing import Final, Protocol, Self, runtime_checkable

from mission_io.clock import Clock
from mission_io.errors import LinkError, MisuseError
from mission_io.wire.framing import FramingCounts

DEFAULT_HOST: Final = "127.0.0.1"
DEFAULT_BAUD: Final = 57_600
"""What telemetry radios come with; a flight controller's own USB takes any."""

LINK_FORMS: Final = (
    "udpin://HOST:PORT, udpout://HOST:PORT, udp:HOST:PORT (listens), tcp://HOST:PORT, tcpin://HOST:PORT, "
    "serial:///dev/tty...:BAUD or /dev/tty...,BAUD"
)

_SCHEMES: Final = {"udpin": "udpin", "udp": "udpin", "udpout": "udpout", "tcp": "tcp", "tcpin": "tcpin"}
_OUTWARD: Final = ("udpout", "tcp")
_DEVICE: Final = re.compile(r"(?P<device>/.*?)(?:[:,](?P<baud>[0-9]+))?", re.ASCII | re.DOTALL)
_LARGEST_BAUD = 20_000_000

BUILT_IN_SCHEMES: Final = frozenset({*_SCHEMES, "serial"})


@dataclass(frozen=True, slots=True)
class LinkUrl:
    """A link's URL in its parts; ``scheme`` is the canonical one, whichever form was written."""

    scheme: str  # ``udpin``, ``udpout``, ``tcp``, ``tcpin``, ``serial``, or one that was registered
    host: str = ""  # name or address, for UDP and TCP
    port: int = 0  # port, for UDP and TCP; 0 is any, where this side listens
    rest: str = ""  # the device of a serial link; what follows the colon of a registered scheme
    baud: int = 0  # bits per second of a serial link


def parse_url(url: str, *, registered: frozenset[str]) -> LinkUrl:
    """Take a link URL apart.

    Raises:
        MisuseError: a scheme that is not known, a missing or impossible port, or an impossible baud rate; it says which.
    """
    if url.startswith("/"):
        return _serial(url, url)
    scheme, colon, rest = url.partition(":")
    rest = rest.removeprefix("//")
    if colon and scheme in registered:
        return LinkUrl(scheme, rest=rest)
    if colon and scheme == "serial":
        return _serial(url, rest)
    if not colon or scheme not in _SCHEMES:
        known = ", ".join([LINK_FORMS, *(f"{name}:" for name in sorted(registered))])
        raise MisuseError(f"{url!r} is not a valid link; use {known}")
    host, _, port_text = rest.rpartition(":")
    if not (port_text.isascii() and port_text.isdigit() and int(port_text) <= 65535):
        raise MisuseError(f"{url!r} does not end in a colon and a port from 0 to 65535")
    port = int(port_text)
    if port == 0 and scheme in _OUTWARD:
        raise MisuseError(f"{url!r}: sending to port 0 is not possible; specify another port")
    return LinkUrl(_SCHEMES[scheme], host.strip("[]") or DEFAULT_HOST, port)


def _serial(url: str, rest: str) -> LinkUrl:
    """A device, and its baud rate behind the last colon or comma if there are only digits."""
    match = _DEVICE.fullmatch(rest)
    if match is None:
        raise MisuseError(f"{url!r} names no device; write serial:///dev/ttyUSB0:57600 or /dev/ttyUSB0,57600")
    baud = int(match["baud"]) if match["baud"] else DEFAULT_BAUD
    if not 0 < baud <= _LARGEST_BAUD:
        raise MisuseError(f"{url!r}: {baud} is not a valid baud rate; common rates are 57600 and 115200")
    return LinkUrl("serial", rest=match["device"], baud=baud)


class Link(Protocol):
    """Carries datagrams, unreliably. Its time-outs are measured by its own clock."""

    @property
    def clock(self) -> Clock:
        """The clock that ``receive`` waits by; simulated links have their own."""
        ...

    def send(self, data: bytes) -> None:
        """Send one datagram, which may get lost silently."""
        ...

    def receive(self, timeout_s: float) -> bytes | None:
        """The next datagram, or None when none arrived within ``timeout_s`` seconds."""
        ...

    def close(self) -> None:
        """Release the port; may be called twice."""
        ...


@runtime_checkable
class PeerLink(Protocol):
    """A link with several peers that can be restricted to one."""

    def keep_to(self, system_id: int, component_id: int) -> None:
        """Communicate with this sender's address only."""
        ...

    def let_go(self) -> None:
        """Communicate with everybody again."""
        ...


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
        ...


def framing_of(link: Link) -> FramingCounts:
    """Counts of bytes of a stream that were no frames; none for a link of datagrams."""
    return link.framing if isinstance(link, StreamLink) else FramingCounts()

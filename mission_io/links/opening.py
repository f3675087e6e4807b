"""Links that carry datagrams to and from vehicles, opened by their URLs.

``udpin://HOST:PORT``, ``udp:HOST:PORT`` and ``tcpin://HOST:PORT`` wait on a port for others to speak first,
``udpout://HOST:PORT`` and ``tcp://HOST:PORT`` speak first, ``serial:///dev/tty...:BAUD`` is a radio or a cable. Nothing
listens beyond this machine unless the URL names such a host. See docs/reference/links.md.
"""

import errno
import os
from collections.abc import Callable, Mapping
from types import MappingProxyType, ModuleType
from typing import Any, Final

from mission_io.errors import LinkError, MisuseError
from mission_io.links.base import (
    BUILT_IN_SCHEMES,
    DEFAULT_BAUD,
    LINK_FORMS,
    Link,
    LinkUrl,
    PeerLink,
    StreamLink,
    parse_url,
)
from mission_io.links.stream import ChannelLink, OpenChannel
from mission_io.links.tcp import TcpListeningLink, connect_tcp
from mission_io.links.udp import UdpLink

__all__ = [
    "LINK_FORMS",
    "EndpointFactory",
    "Link",
    "LinkUrl",
    "PeerLink",
    "StreamLink",
    "TcpListeningLink",
    "UdpLink",
    "open_link",
    "parse_link_url",
    "register_endpoint",
]

EndpointFactory = Callable[[LinkUrl], Link]

_endpoints: dict[str, EndpointFactory] = {}
_OPENERS: Final[dict[str, EndpointFactory]] = {
    "udpin": lambda url: UdpLink.listening(url.host, url.port),
    "udpout": lambda url: UdpLink.connecting(url.host, url.port),
    "tcp": lambda url: connect_tcp(url.host, url.port),
    "tcpin": lambda url: TcpListeningLink(url.host, url.port),
    "serial": lambda url: open_serial(url.rest, url.baud),
}


def register_endpoint(scheme: str, factory: EndpointFactory) -> None:
    """Make ``scheme:`` a link URL that ``open_link`` gives to ``factory``; a second registration replaces the first."""
    if not scheme.isidentifier() or scheme in BUILT_IN_SCHEMES:
        raise MisuseError(f"{scheme!r} cannot be registered as a link scheme")
    _endpoints[scheme] = factory


def parse_link_url(url: str) -> LinkUrl:
    """Parse a link URL without opening anything.

    Raises:
        MisuseError: an unknown scheme, or a missing or invalid port or baud rate.
    """
    return parse_url(url, registered=frozenset(_endpoints))


def open_link(url: str, *, schemes: Mapping[str, EndpointFactory] = MappingProxyType({})) -> Link:
    """Open the link that a URL names.

    Args:
        url: The URL.
        schemes: Further schemes for this call, beside those that are built in or registered.

    Raises:
        MisuseError: an invalid URL, or pyserial is missing for a serial one.
        LinkError: the operating system refuses, for instance because the port is taken or has no listener.
    """
    further = {**_endpoints, **schemes}
    parsed = parse_url(url, registered=frozenset(further))
    return (further | _OPENERS)[parsed.scheme](parsed)


_ADVICE = {
    errno.ENOENT: "is the device connected?",
    errno.EACCES: "does this user have access to serial ports (often through the group dialout)?",
    errno.EPERM: "does this user have access to serial ports (often through the group dialout)?",
    errno.EAGAIN: "another program uses the device",
    errno.EBUSY: "another program uses the device",
}


class SerialChannel(OpenChannel):
    """A non-blocking serial port.

    pyserial opens and configures it. Reading and writing is done here, since pyserial's ``write`` spins while a port accepts
    nothing, and its ``read`` discards data when the port disappears.
    """

    end = "the device was disconnected"

    def __init__(self, port: Any, name: str) -> None:
        super().__init__(name)
        self._port = port

    def fileno(self) -> int:
        """Its file descriptor; -1 when closed."""
        return int(self._port.fileno()) if self._port.is_open else -1

    def receive(self, size: int) -> bytes:
        """Bytes that have arrived, as the operating system has it."""
        return os.read(self.fileno(), size)

    def send(self, data: bytes) -> int:
        """Send, as the operating system does it."""
        return os.write(self.fileno(), data)

    def close(self) -> None:
        """Close the port."""
        self._port.close()


def open_serial(device: str, baud: int = DEFAULT_BAUD) -> ChannelLink:
    """Open a link over a serial port, for exclusive use.

    Raises:
        MisuseError: pyserial is not installed.
        LinkError: no such port, or it cannot be opened with this baud rate.
    """
    serial = _pyserial()
    try:
        port = serial.Serial(device, baud, timeout=0, write_timeout=0, exclusive=True)
    except (OSError, ValueError, OverflowError) as error:  # SerialException is an OSError
        number = getattr(error, "errno", None)
        why = os.strerror(number) if number else str(error)
        advice = f"; {_ADVICE[number]}" if number in _ADVICE else ""
        raise LinkError(f"cannot open the serial port {device} at {baud} baud: {why}{advice}") from None
    return ChannelLink(SerialChannel(port, f"serial port {device}"))


def _pyserial() -> ModuleType:
    try:
        import serial
    except ImportError:
        raise MisuseError("serial links require pyserial; install it with: pip install pyserial") from None
    module: ModuleType = serial
    return module

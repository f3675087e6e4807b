"""Links that carry datagrams to and from vehicles, opened by their URLs.

``udpin://HOST:PORT``, ``udp:HOST:PORT`` and ``tcpin://HOST:PORT`` wait on a port for others to speak first,
``udpout://HOST:PORT`` and ``tcp://HOST:PORT`` speak first, ``serial:///dev/tty...:BAUD`` is a radio or a cable. Nothing
listens beyond this machine unless the URL names such a host. See docs/reference/links.md.
"""

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from mission_io.errors import MisuseError
from mission_io.links.base import DEFAULT_BAUD, DEFAULT_HOST, Link
from mission_io.links.stream import TcpListeningLink, connect_tcp, open_serial
from mission_io.links.udp import UdpLink

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


def parse_link_url(url: str, *, further: Collection[str] = ()) -> LinkUrl:
    """Parse a link URL, also a short form of pilots' tools, without opening anything.

    Args:
        url: The URL.
        further: Schemes beside those that are built in or registered.

    Raises:
        MisuseError: a scheme that is not known, a missing or impossible port, or an impossible baud rate; it says which.
    """
    registered = {*_endpoints, *further}
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


def open_link(url: str, *, schemes: Mapping[str, EndpointFactory] = MappingProxyType({})) -> Link:
    """Open the link that a URL names.

    Args:
        url: The URL.
        schemes: Further schemes for this call, beside those that are built in or registered.

    Raises:
        MisuseError: an invalid URL, or pyserial is missing for a serial one.
        LinkError: the operating system refuses, for instance because the port is taken or has no listener.
    """
    parsed = parse_link_url(url, further=schemes)
    return {**_endpoints, **schemes, **_OPENERS}[parsed.scheme](parsed)

"""Links that carry datagrams to and from vehicles, opened by their URLs.

``udpin://HOST:PORT``, ``udp:HOST:PORT`` and ``tcpin://HOST:PORT`` wait on a port for others to speak first,
``udpout://HOST:PORT`` and ``tcp://HOST:PORT`` speak first, ``serial:///dev/tty...:BAUD`` is a radio or a cable. Nothing
listens beyond this machine unless the URL names such a host. See docs/reference/links.md.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

from mission_io.errors import MisuseError
from mission_io.links.base import BUILT_IN_SCHEMES, LINK_FORMS, Link, LinkUrl, PeerLink, StreamLink, parse_url
from mission_io.links.serial_port import open_serial
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
        LinkError: the operating system refuses, for instance because the port is taken or nobody listens there.
    """
    further = {**_endpoints, **schemes}
    parsed = parse_url(url, registered=frozenset(further))
    return (further | _OPENERS)[parsed.scheme](parsed)

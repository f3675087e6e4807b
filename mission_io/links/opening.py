"""Links that carry datagrams to and from vehicles: opened by their URLs, shared by several vehicles, and logged.

``udpin://HOST:PORT``, ``udp:HOST:PORT`` and ``tcpin://HOST:PORT`` wait on a port for others to speak first,
``udpout://HOST:PORT`` and ``tcp://HOST:PORT`` speak first, ``serial:///dev/tty...:BAUD`` is a radio or a cable. Nothing
listens beyond this machine unless the URL names such a host. See docs/reference/links.md.

A shared link (a radio, a router, or one port for all vehicles) is opened once, and each vehicle gets a link of its own over it.
Clients in several threads, one for each vehicle, hear what is for them, and none hears another one's vehicle.
"""

import contextlib
import logging
import os
import re
import threading
from collections import deque
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final

from mission_io.errors import LinkError, MisuseError
from mission_io.links.datagrams import (
    DEFAULT_BAUD,
    DEFAULT_HOST,
    Clock,
    Closing,
    Endpoint,
    Endpoints,
    Link,
    MonotonicClock,
    UdpLink,
    WrappingLink,
    framing_of,
)
from mission_io.links.stream import TcpListeningLink, connect_tcp, open_serial
from mission_io.wire.codec import FramingCounts, frames_by_length, frames_of
from mission_io.wire.signing import SystemClock, UnixClock

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


MOST_WAITING: Final = 4096
"""Datagrams that wait for a share without a reader; of more, the oldest are lost, as in a socket's buffer."""
_log = logging.getLogger(__name__)


class SharedLink:
    """A link for several vehicles: opened with its first share, closed with its last one, and so on again. Thread-safe."""

    def __init__(self, opener: Callable[[], Link], systems: Collection[int]) -> None:
        self._opener = opener
        self._systems = frozenset(systems)
        self._lock = threading.Condition()
        self._sending = threading.Lock()
        self._link: Link | None = None
        self._views: dict[int, LinkView] = {}
        self._reading = False
        self._error: LinkError | None = None

    def view(self, system_id: int) -> "LinkView":
        """A link to one of the vehicles.

        Raises:
            MisuseError: it is none of them, or its share is in use.
            LinkError: the link cannot be opened.
        """
        with self._lock:
            if system_id not in self._systems:
                raise MisuseError(
                    f"system {system_id} has no share of this link; the systems with a share are "
                    f"{sorted(self._systems)}"
                )
            if system_id in self._views:
                raise MisuseError(f"the share of system {system_id} is in use")
            if self._link is None:
                self._link, self._error = self._opener(), None
            found = LinkView(self, self._link, system_id, self._systems - {system_id})
            self._views[system_id] = found
            return found

    def give_up(self, system_id: int) -> None:
        """Close the share of a vehicle."""
        with self._lock:
            self._views.pop(system_id, None)
            if not self._views and self._link is not None:
                self._link.close()
                self._link = None

    def send(self, link: Link, endpoints: Collection[Endpoint], data: bytes) -> None:
        """Send a datagram of one share."""
        with self._sending:
            if isinstance(link, UdpLink) and link.learns_peers:
                for endpoint in endpoints:
                    link.send_to(endpoint, data)
            else:
                link.send(data)

    def receive(self, view: "LinkView", link: Link, deadline: float) -> bytes | None:
        """The next datagram of one share; whichever share waits first reads for all."""
        while True:
            with self._lock:
                data = view.take()
                if data is not None:
                    return data
                if self._error is not None:
                    raise self._error
                left_s = max(0.0, deadline - link.clock.now())
                if self._reading:
                    if left_s == 0.0:
                        return None
                    # while another share reads, this one looks this often for the end of its time
                    self._lock.wait(min(left_s, 0.02))
                    continue
                self._reading = True
            try:
                self._read(link, left_s)
            finally:
                with self._lock:
                    self._reading = False
                    self._lock.notify_all()
            if left_s == 0.0:
                with self._lock:
                    return view.take()

    def _read(self, link: Link, timeout_s: float) -> None:
        """Read the next datagram, and give it to its share."""
        endpoint = None
        try:
            if isinstance(link, UdpLink) and link.learns_peers:
                data, endpoint = link.receive_from(timeout_s) or (None, None)
            else:
                data = link.receive(timeout_s)
        except LinkError as error:
            with self._lock:
                self._error = error
            return
        if data is not None:
            with self._lock:
                for view in self._views.values():
                    view.put(data, endpoint)


class LinkView:
    """One vehicle's share of a link, made by :meth:`SharedLink.view`; a link itself.

    Attributes:
        dropped: How many datagrams were lost because no caller read them.
    """

    def __init__(self, shared: SharedLink, link: Link, system_id: int, others: Collection[int]) -> None:
        self._shared, self._link, self._system_id, self._others = shared, link, system_id, others
        self._endpoints = Endpoints()
        self._waiting: deque[bytes] = deque()
        self._closed = False
        self.dropped = 0

    @property
    def clock(self) -> Clock:
        """The clock of the link."""
        return self._link.clock

    @property
    def framing(self) -> FramingCounts:
        """Bytes of a stream that were no frame, for all shares together; zero for a link of datagrams."""
        return framing_of(self._link)

    def send(self, data: bytes) -> None:
        """Send one datagram: to the vehicle's address once it is known, otherwise to all addresses.

        Raises:
            LinkError: the link is closed or gone.
        """
        self._require_open()
        self._shared.send(self._link, self._endpoints.to_send_to(self.clock.now()), data)

    def receive(self, timeout_s: float) -> bytes | None:
        """The next datagram that is not another vehicle's, or None after ``timeout_s`` seconds.

        Raises:
            LinkError: the link is closed or gone.
        """
        self._require_open()
        return self._shared.receive(self, self._link, self.clock.now() + timeout_s)

    def keep_to(self, system_id: int, component_id: int) -> None:
        """From here on hear only the address of this sender; a link without addresses stays as it is."""
        self._endpoints.keep_to(system_id, component_id, self.clock.now())

    def let_go(self) -> None:
        """Hear all addresses again."""
        self._endpoints.let_go()

    def close(self) -> None:
        """Give up the share; the last one closes the link. Closing twice is fine."""
        if not self._closed:
            self._closed = True
            self._shared.give_up(self._system_id)

    def take(self) -> bytes | None:
        """The oldest datagram that waits."""
        return self._waiting.popleft() if self._waiting else None

    def put(self, data: bytes, endpoint: Endpoint | None) -> None:
        """Let a datagram wait, if it is for this vehicle's client to hear."""
        ours = _without(data, self._others)
        if not ours or (endpoint is not None and not self._endpoints.hears(ours, endpoint, self.clock.now())):
            return
        if len(self._waiting) >= MOST_WAITING:
            self._waiting.popleft()
            self.dropped += 1
            if self.dropped == 1:
                _log.warning("no client reads the datagrams of system %d; dropping the oldest ones", self._system_id)
        self._waiting.append(ours)

    def _require_open(self) -> None:
        if self._closed:
            raise LinkError("the link is closed")


def _without(data: bytes, systems: Collection[int]) -> bytes:
    """A datagram without the frames of some systems; other bytes stay where no frame is taken out."""
    frames = frames_of(data)
    if not any(frame.system_id in systems for frame in frames):
        return data
    return b"".join(frame.data for frame in frames if frame.system_id not in systems)


# Telemetry logs (``.tlog``), in the format of ground stations: each frame follows the time of day at which it was sent or
# received, microseconds since 1970-01-01 UTC as an unsigned 64-bit number, big-endian. Bytes between frames are omitted. Where
# the lengths in a datagram add up, as in nearly every one, checksums are left to the readers of the log.

FLUSH_S: Final = 0.2
"""Flush interval: a killed process loses at most this much."""


class TelemetryLogWriter(Closing):
    """Writes one log. A context manager.

    If the log cannot be written any more, for instance because the disk is full, it ends, ``error`` has the reason, and the link
    continues.

    Args:
        path: the file; one that is there is replaced.
        clock: the time of day; None takes the operating system's.
        flush_clock: times the flushes; None takes the monotonic clock.

    Attributes:
        path: where the file is.
        frames: how many are in it.
        error: why the log ended early; None as long as it goes on.

    Raises:
        LinkError: the file cannot be made.
    """

    def __init__(self, path: Path, *, clock: UnixClock | None = None, flush_clock: Clock | None = None) -> None:
        self.path = path
        self.frames = 0
        self.error: str | None = None
        self._clock = clock if clock is not None else SystemClock()
        self._flush_clock = flush_clock if flush_clock is not None else MonotonicClock()
        self._flushed_s = self._flush_clock.now()
        try:
            self._file = path.open("wb")
        except OSError as error:
            raise LinkError(f"{path}: the telemetry log cannot be written: {error.strerror}") from None

    def write(self, data: bytes) -> None:
        """Write the frames in a datagram, as of now."""
        if self.error is not None:
            return
        frames = frames_by_length(data) or [frame.data for frame in frames_of(data)]
        stamp = round(self._clock.unix_s() * 1e6).to_bytes(8, "big")
        try:
            for frame in frames:
                self._file.write(stamp + frame)
            self.frames += len(frames)
            self._flush()
        except (OSError, ValueError) as error:
            self._give_up(error)

    def keep_up(self) -> None:
        """Flush the log when due; call it while nothing arrives."""
        if self.error is None:
            try:
                self._flush()
            except (OSError, ValueError) as error:
                self._give_up(error)

    def move_to(self, path: Path) -> None:
        """Give the file another name, and go on in it."""
        if self.error is not None:
            return
        try:
            self._file.close()  # some systems do not rename an open file
            os.replace(self.path, path)
            self.path = path
            self._file = path.open("ab")
        except OSError as error:
            self._give_up(error)

    def close(self) -> None:
        """Close the file; closing twice is fine."""
        try:
            self._file.close()
        except OSError as error:
            self._give_up(error)

    def _flush(self) -> None:
        if (now := self._flush_clock.now()) - self._flushed_s >= FLUSH_S:
            self._flushed_s = now
            self._file.flush()

    def _give_up(self, error: OSError | ValueError) -> None:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        self.error = f"{self.path}: the telemetry log ends after {self.frames} frames: {reason}"
        with contextlib.suppress(OSError):
            self._file.close()


class LoggedLink(WrappingLink):
    """A :class:`~mission_io.links.datagrams.Link` that writes its datagrams into a log, from ``log_to`` on."""

    def __init__(self, link: Link) -> None:
        super().__init__(link)
        self._log: TelemetryLogWriter | None = None

    def log_to(self, log: TelemetryLogWriter | None) -> None:
        """Write all that is heard and sent from here on into a log, or no longer into any."""
        self._log = log

    @property
    def framing(self) -> FramingCounts:
        """Bytes of a stream that were no frame; zero for a link of datagrams."""
        return framing_of(self._link)

    def send(self, data: bytes) -> None:
        """Send one datagram."""
        self._link.send(data)
        if self._log is not None:
            self._log.write(data)

    def receive(self, timeout_s: float) -> bytes | None:
        """The next datagram, or None after ``timeout_s`` seconds."""
        data = self._link.receive(timeout_s)
        if self._log is not None:
            if data is None:
                self._log.keep_up()
            else:
                self._log.write(data)
        return data

"""Several vehicles on one link: a shared radio, a router, or one port that all speak to.

The link is opened once, and each vehicle has a share of it that is a link of its own: clients in several threads, one for each
vehicle, hear what is for them, and none hears another one's vehicle.
"""

import logging
import threading
from collections import deque
from collections.abc import Callable, Collection
from typing import Final

from mission_io.clock import Clock
from mission_io.errors import LinkError, MisuseError
from mission_io.links.base import Link, framing_of
from mission_io.links.udp import Place, Places, UdpLink
from mission_io.wire.framing import FramingCounts, frames_of

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
        self._shares: dict[int, LinkShare] = {}
        self._reading = False
        self._error: LinkError | None = None

    def share(self, system_id: int) -> "LinkShare":
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
            if system_id in self._shares:
                raise MisuseError(f"the share of system {system_id} is in use")
            if self._link is None:
                self._link, self._error = self._opener(), None
            found = LinkShare(self, self._link, system_id, self._systems - {system_id})
            self._shares[system_id] = found
            return found

    def give_up(self, system_id: int) -> None:
        """Close the share of a vehicle."""
        with self._lock:
            self._shares.pop(system_id, None)
            if not self._shares and self._link is not None:
                self._link.close()
                self._link = None

    def send(self, link: Link, places: Collection[Place], data: bytes) -> None:
        """Send a datagram of one share."""
        with self._sending:
            if isinstance(link, UdpLink) and link.learns_peers:
                for place in places:
                    link.send_to(place, data)
            else:
                link.send(data)

    def receive(self, share: "LinkShare", link: Link, deadline: float) -> bytes | None:
        """The next datagram of one share; whichever share waits first reads for all."""
        while True:
            with self._lock:
                data = share.take()
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
                    return share.take()

    def _read(self, link: Link, timeout_s: float) -> None:
        """Read the next datagram, and give it to its share."""
        place = None
        try:
            if isinstance(link, UdpLink) and link.learns_peers:
                data, place = link.receive_from(timeout_s) or (None, None)
            else:
                data = link.receive(timeout_s)
        except LinkError as error:
            with self._lock:
                self._error = error
            return
        if data is not None:
            with self._lock:
                for share in self._shares.values():
                    share.put(data, place)


class LinkShare:
    """One vehicle's share of a link, made by :meth:`SharedLink.share`; a link itself.

    Attributes:
        dropped: How many datagrams were lost because no caller read them.
    """

    def __init__(self, shared: SharedLink, link: Link, system_id: int, others: Collection[int]) -> None:
        self._shared, self._link, self._system_id, self._others = shared, link, system_id, others
        self._places = Places()
        self._waiting: deque[bytes] = deque()
        self._closed = False
        self.dropped = 0

    @property
    def clock(self) -> Clock:
        """The clock of the link."""
        return self._link.clock

    @property
    def framing(self) -> FramingCounts:
        """Bytes of a stream that were no frame, for all shares together; none for a link of datagrams."""
        return framing_of(self._link)

    def send(self, data: bytes) -> None:
        """Send one datagram: to the vehicle's address once it is known, otherwise to all addresses.

        Raises:
            LinkError: the link is closed or gone.
        """
        self._require_open()
        self._shared.send(self._link, self._places.to_send_to(self.clock.now()), data)

    def receive(self, timeout_s: float) -> bytes | None:
        """The next datagram that is not another vehicle's, or None after ``timeout_s`` seconds.

        Raises:
            LinkError: the link is closed or gone.
        """
        self._require_open()
        return self._shared.receive(self, self._link, self.clock.now() + timeout_s)

    def keep_to(self, system_id: int, component_id: int) -> None:
        """From here on hear only the address of this sender; a link without addresses stays as it is."""
        self._places.keep_to(system_id, component_id, self.clock.now())

    def let_go(self) -> None:
        """Hear all addresses again."""
        self._places.let_go()

    def close(self) -> None:
        """Give up the share; the last one closes the link. Closing twice is fine."""
        if not self._closed:
            self._closed = True
            self._shared.give_up(self._system_id)

    def take(self) -> bytes | None:
        """The oldest datagram that waits."""
        return self._waiting.popleft() if self._waiting else None

    def put(self, data: bytes, place: Place | None) -> None:
        """Let a datagram wait, if it is for this vehicle's client to hear."""
        ours = _without(data, self._others)
        if not ours or (place is not None and not self._places.hears(ours, place, self.clock.now())):
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

"""The addresses that speak to a listening port, and the addresses to send to."""

import logging
from typing import Final

from mission_io.wire.framing import Framer

FORGOTTEN_AFTER_S: Final = 15.0
"""Silence after which an address is no longer sent to, unless it is the only one."""

MOST_PEERS: Final = 16

TAKE_OVER_S: Final = 3.0
"""Silence of its address after which a kept vehicle may speak from another one (it was switched off and on)."""

Place = tuple[str, int]
"""Host and port."""

_HEARTBEAT = 0
_MOST_SENDERS = 256

_log = logging.getLogger(__name__)


class Places:
    """The addresses that a listening port hears, until ``keep_to`` chooses the one of a vehicle.

    Attributes:
        latest: The place that was heard last; the vehicle's while one is kept to. None before that.
        strangers: How many datagrams came from elsewhere than the place that is kept to.
    """

    def __init__(self) -> None:
        self.latest: Place | None = None
        self.strangers = 0
        self._heard_s: dict[Place, float] = {}
        self._place_of: dict[tuple[int, int], Place] = {}
        self._kept: tuple[int, int] | None = None
        self._kept_heard_s = 0.0

    def hears(self, data: bytes, place: Place, now: float) -> bool:
        """Note the sender's address of a datagram; whether it is for us."""
        if self._kept is not None and place != self.latest:
            if now - self._kept_heard_s <= TAKE_OVER_S or self._kept not in _heartbeats_in(data):
                self.strangers += 1
                return False
            _log.warning("system %d now sends from %s:%d", self._kept[0], *place)
        self.latest, self._kept_heard_s = place, now
        self._heard_s.pop(place, None)
        self._heard_s[place] = now
        if self._kept is None:
            for sender in _heartbeats_in(data):
                if len(self._place_of) < _MOST_SENDERS:
                    self._place_of.setdefault(sender, place)
        return True

    def to_send_to(self, now: float) -> tuple[Place, ...]:
        """The address that is kept to, or all recently heard ones."""
        if self._kept is not None:
            return () if self.latest is None else (self.latest,)
        for place, heard_s in list(self._heard_s.items())[:-1]:
            if now - heard_s > FORGOTTEN_AFTER_S or len(self._heard_s) > MOST_PEERS:
                del self._heard_s[place]
        return tuple(self._heard_s)

    def keep_to(self, system_id: int, component_id: int, now: float) -> None:
        """From here on there is only the address of this sender's heartbeats, if they were heard.

        When nothing came from there for ``TAKE_OVER_S`` seconds, a heartbeat of the same sender from another place moves it.
        """
        place = self._place_of.get((system_id, component_id))
        if place is None:
            return
        self._kept, self.latest, self._kept_heard_s = (system_id, component_id), place, now

    def let_go(self) -> None:
        """Hear everybody again, and learn anew where each speaks from."""
        self._kept = None
        self._place_of.clear()


def _heartbeats_in(data: bytes) -> set[tuple[int, int]]:
    """System and component of the heartbeats in a datagram."""
    framer = Framer()
    frames = [*framer.feed(data), *framer.end()]
    return {(frame.system_id, frame.component_id) for frame in frames if frame.message_id == _HEARTBEAT}

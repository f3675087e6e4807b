"""A link that can go dark, and a process of ours that can stand still, on the simulated clock."""

from collections import deque
from collections.abc import Callable

from mission_io.clock import Clock
from mission_io.links.simulated import SimulatedLink
from uavcover.mock.peer import InMemoryPeer
from uavcover.mock.vehicle import MockVehicle

_BUFFER = 270
"""Datagrams that a socket keeps while its process stands still; what comes later is lost."""


class DarkPeer(InMemoryPeer):
    """A mock vehicle behind a link that loses everything, both ways, between two times of the link's clock."""

    def __init__(self, vehicle: MockVehicle, *, speed: float = 1.0) -> None:
        super().__init__(vehicle, speed=speed)
        self.dark_until_s = 0.0
        self.now = 0.0

    def go_dark(self, seconds: float) -> None:
        """Lose everything from now on, for some seconds."""
        self.dark_until_s = self.now + seconds

    def receive_datagram(self, data: bytes, now: float) -> None:
        """Take a datagram that arrived at ``now``, or lose it."""
        self.now = now
        if now >= self.dark_until_s:
            super().receive_datagram(data, now)

    def datagrams_to_send(self, now: float) -> list[bytes]:
        """What arrives on this side; nothing in the dark, in which the vehicle flies on."""
        self.now = now
        sent = super().datagrams_to_send(now)
        return sent if now >= self.dark_until_s else []


class FreezingLink:
    """A link of a process that is stopped (SIGSTOP) for a while: its socket keeps the oldest datagrams meanwhile."""

    def __init__(self, link: SimulatedLink) -> None:
        self._link = link
        self._kept: deque[bytes] = deque()
        self._frozen_s = 0.0
        self.on_send: Callable[[bytes], None] = lambda _: None

    @property
    def clock(self) -> Clock:
        """The simulated clock."""
        return self._link.clock

    def freeze(self, seconds: float) -> None:
        """Stand still, from the next call on."""
        self._frozen_s = seconds

    def send(self, data: bytes) -> None:
        """Send one datagram."""
        self._stand_still()
        self.on_send(data)
        self._link.send(data)

    def receive(self, timeout_s: float) -> bytes | None:
        """The next datagram."""
        self._stand_still()
        return self._kept.popleft() if self._kept else self._link.receive(timeout_s)

    def close(self) -> None:
        """Close the link."""
        self._link.close()

    def _stand_still(self) -> None:
        until_s, self._frozen_s = self.clock.now() + self._frozen_s, 0.0
        while (left_s := until_s - self.clock.now()) > 0.0:
            data = self._link.receive(left_s)
            if data is not None and len(self._kept) < _BUFFER:
                self._kept.append(data)

"""Links that lose, delay, duplicate and corrupt datagrams on purpose, reproducibly by seed.

``SimulatedLink`` connects this side to a peer in the same process. Its clock advances only while ``receive`` waits, so
minutes of radio trouble take milliseconds and repeat exactly. ``LossyLink`` degrades a real link.
"""

import heapq
import itertools
import math
from collections import deque
from dataclasses import dataclass
from random import Random
from typing import Protocol

from mission_io.clock import Clock
from mission_io.errors import LinkError, MisuseError
from mission_io.links.base import WrappingLink
from mission_io.links.opening import Link


class ManualClock:
    """A clock that stands still until it is told to move."""

    def __init__(self, start_s: float = 0.0) -> None:
        self._now_s = start_s

    def now(self) -> float:
        """The present simulated time in seconds."""
        return self._now_s

    def advance_to(self, time_s: float) -> None:
        """Move on; a time that has passed already changes nothing."""
        self._now_s = max(self._now_s, time_s)


class Peer(Protocol):
    """The other end of a simulated link: it is told what arrives and asked what it sends."""

    def receive_datagram(self, data: bytes, now: float) -> None:
        """Take a datagram that arrived at ``now``."""
        ...

    def datagrams_to_send(self, now: float) -> list[bytes]:
        """What it wants to send at ``now``."""
        ...

    def next_timer(self) -> float | None:
        """When it wants to be asked again although nothing arrives; None for not at all."""
        ...


@dataclass(frozen=True, slots=True)
class Conditions:
    """What happens to datagrams in each direction; fractions from 0 to 1, times in seconds.

    Jitter adds up to that much to the delay of each datagram, so more jitter than the time between two datagrams
    means that some arrive in another order. With a limited ``bytes_per_s`` datagrams wait for those before them, and
    what finds more than ``queue_bytes`` waiting is dropped, as by a radio whose buffer is full.
    """

    loss: float = 0.0
    duplication: float = 0.0
    corruption: float = 0.0
    delay_s: float = 0.001
    jitter_s: float = 0.0
    bytes_per_s: float = math.inf
    queue_bytes: float = math.inf

    def __post_init__(self) -> None:
        """Refuse what is no fraction or no time."""
        for name in ("loss", "duplication", "corruption"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise MisuseError(f"{name} is {getattr(self, name)}, give a fraction from 0 to 1")
        if not (self.delay_s >= 0.0 and self.jitter_s >= 0.0):
            raise MisuseError(f"delay {self.delay_s} s and jitter {self.jitter_s} s must not be negative")
        if not (self.bytes_per_s > 0.0 and self.queue_bytes > 0.0):
            raise MisuseError(f"bytes_per_s {self.bytes_per_s} and queue_bytes {self.queue_bytes} must be above 0")


class _Direction:
    """One way of a link: when a datagram that is sent now arrives, if it does."""

    def __init__(self, conditions: Conditions, rng: Random) -> None:
        self._conditions, self._rng = conditions, rng
        self._free_at = -math.inf

    def arrivals(self, data: bytes, now: float) -> list[tuple[float, bytes]]:
        """The copies that arrive, with their times."""
        conditions = self._conditions
        leaves = max(now, self._free_at)
        if (leaves - now) * conditions.bytes_per_s > conditions.queue_bytes:
            return []
        self._free_at = leaves + len(data) / conditions.bytes_per_s
        return [
            (self._free_at + conditions.delay_s + self._rng.random() * conditions.jitter_s, copy)
            for copy in fate(data, conditions, self._rng)
        ]


def fate(data: bytes, conditions: Conditions, rng: Random) -> list[bytes]:
    """The copies of a datagram that arrive: none, one or two, perhaps damaged."""
    if rng.random() < conditions.loss:
        return []
    copies = [data, data] if rng.random() < conditions.duplication else [data]
    return [_damaged(copy, rng) if rng.random() < conditions.corruption else copy for copy in copies]


def _damaged(data: bytes, rng: Random) -> bytes:
    if not data:
        return data
    damaged = bytearray(data)
    damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
    return bytes(damaged)


class SimulatedLink:
    """A link to ``peer`` through bad conditions, on a clock of its own."""

    def __init__(
        self, peer: Peer, *, rng: Random, conditions: Conditions | None = None, clock: ManualClock | None = None
    ) -> None:
        self._peer = peer
        conditions = conditions if conditions is not None else Conditions()
        self._to_peer, self._from_peer = _Direction(conditions, rng), _Direction(conditions, rng)
        self._clock = clock if clock is not None else ManualClock()
        self._in_flight: list[tuple[float, int, bool, bytes]] = []
        self._order = itertools.count()
        self._arrived: deque[bytes] = deque()
        self._closed = False

    @property
    def clock(self) -> Clock:
        """The simulated clock that this link moves on."""
        return self._clock

    def send(self, data: bytes) -> None:
        """Send one datagram to the peer."""
        if self._closed:
            raise LinkError("the link is closed")
        self._dispatch(data, to_peer=True)

    def receive(self, timeout_s: float) -> bytes | None:
        """Let simulated time pass until a datagram arrives here, or ``timeout_s`` seconds are over."""
        if self._closed:
            raise LinkError("the link is closed")
        deadline = self._clock.now() + max(0.0, timeout_s)
        while not self._arrived:
            self._collect_from_peer()
            due = self._next_event()
            if due is None or due > deadline:
                self._clock.advance_to(deadline)
                return None
            self._clock.advance_to(due)
            self._deliver()
        return self._arrived.popleft()

    def close(self) -> None:
        """Stop carrying anything."""
        self._closed = True

    def _next_event(self) -> float | None:
        timer = self._peer.next_timer()
        times = [self._in_flight[0][0]] if self._in_flight else []
        return min([*times, timer] if timer is not None else times, default=None)

    def _deliver(self) -> None:
        now = self._clock.now()
        while self._in_flight and self._in_flight[0][0] <= now:
            _, _, to_peer, data = heapq.heappop(self._in_flight)
            if to_peer:
                self._peer.receive_datagram(data, now)
            else:
                self._arrived.append(data)
        self._collect_from_peer()

    def _collect_from_peer(self) -> None:
        for data in self._peer.datagrams_to_send(self._clock.now()):
            self._dispatch(data, to_peer=False)

    def _dispatch(self, data: bytes, *, to_peer: bool) -> None:
        direction = self._to_peer if to_peer else self._from_peer
        for arrival, copy in direction.arrivals(data, self._clock.now()):
            heapq.heappush(self._in_flight, (arrival, next(self._order), to_peer, copy))


class LossyLink(WrappingLink):
    """A real link that loses, repeats and damages datagrams both ways; delay, jitter and bandwidth are not applied."""

    def __init__(self, link: Link, *, rng: Random, conditions: Conditions) -> None:
        super().__init__(link)
        self._rng, self._conditions = rng, conditions
        self._waiting: deque[bytes] = deque()

    def send(self, data: bytes) -> None:
        """Send one datagram, or lose it."""
        for copy in fate(data, self._conditions, self._rng):
            self._link.send(copy)

    def receive(self, timeout_s: float) -> bytes | None:
        """The next datagram that was not lost, or None after ``timeout_s`` seconds."""
        deadline = self._link.clock.now() + timeout_s
        while not self._waiting:
            data = self._link.receive(max(0.0, deadline - self._link.clock.now()))
            if data is None:
                return None
            self._waiting.extend(fate(data, self._conditions, self._rng))
        return self._waiting.popleft()

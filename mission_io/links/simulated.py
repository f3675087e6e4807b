"""Links that lose, delay, duplicate and corrupt datagrams on purpose, by seed; and kinds of links by name.

``SimulatedLink`` connects this side to a peer in the same process. Its clock advances only while ``receive`` waits, so
minutes of radio trouble take milliseconds and repeat exactly. ``LossyLink`` degrades a real link.

A preset gives the timeouts of transfers on a kind of link, and its losses when it is simulated. Time-outs adapt to
the link by themselves; a preset saves the first seconds and gives slow links more time.
"""

import heapq
import itertools
import math
from collections import deque
from dataclasses import dataclass
from random import Random
from typing import Final, Protocol

from mission_io.errors import LinkError, MisuseError
from mission_io.links.datagrams import Clock, Link, WrappingLink
from mission_io.protocol.timing import Timing


class ManualClock:
    """A clock that stands still until a call moves it."""

    def __init__(self, start_s: float = 0.0) -> None:
        self._now_s = start_s

    def now(self) -> float:
        """The present simulated time in seconds."""
        return self._now_s

    def advance_to(self, time_s: float) -> None:
        """Move on; a time that has passed already changes nothing."""
        self._now_s = max(self._now_s, time_s)


class Peer(Protocol):
    """The other end of a simulated link: it receives datagrams, and returns those that it sends."""

    def receive_datagram(self, data: bytes, now: float) -> None:
        """Take a datagram that arrived at ``now``."""

    def datagrams_to_send(self, now: float) -> list[bytes]:
        """Datagrams that it sends at ``now``."""

    def next_timer(self) -> float | None:
        """Time of the next call without a message; None for none."""


@dataclass(frozen=True, slots=True)
class Conditions:
    """Losses and delays of datagrams in each direction; fractions from 0 to 1, times in seconds.

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
        """Refuse invalid fractions and times."""
        for name in ("loss", "duplication", "corruption"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise MisuseError(f"{name} must be between 0 and 1, not {getattr(self, name)}")
        if not (self.delay_s >= 0.0 and self.jitter_s >= 0.0):
            raise MisuseError(f"delay and jitter must not be negative, but are {self.delay_s} s and {self.jitter_s} s")
        if not (self.bytes_per_s > 0.0 and self.queue_bytes > 0.0):
            raise MisuseError(f"bytes_per_s and queue_bytes must be > 0, not {self.bytes_per_s} and {self.queue_bytes}")


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
        for arrival_s, copy in direction.arrivals(data, self._clock.now()):
            self._carry(copy, arrival_s, to_peer=to_peer)

    def _carry(self, data: bytes, arrival_s: float, *, to_peer: bool) -> None:
        heapq.heappush(self._in_flight, (arrival_s, next(self._order), to_peer, data))


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


@dataclass(frozen=True, slots=True)
class LinkPreset:
    """A kind of link."""

    name: str  # its name in options
    timing: Timing  # for ``Client(timing=...)``
    conditions: Conditions  # for ``SimulatedLink(conditions=...)``: such a link on a bad day, each way


DEFAULT: Final = LinkPreset("default", Timing(), Conditions(loss=0.01, delay_s=0.005, jitter_s=0.005))
"""A cable, a network, a good radio."""

TELEMETRY_RADIO: Final = LinkPreset(
    "telemetry-radio",
    Timing(resend_s=0.5, resend_shortest_s=0.05, resend_longest_s=1.5, stall_s=8.0, give_up_s=25.0, linger_s=2.0),
    Conditions(
        loss=0.05,
        duplication=0.01,
        corruption=0.02,
        delay_s=0.04,
        jitter_s=0.06,
        bytes_per_s=57_600 / 10,  # a start and a stop bit for each byte
        queue_bytes=2_000,
    ),
)
"""A serial radio at 57,600 baud."""

SATELLITE: Final = LinkPreset(
    "satellite",
    Timing(
        resend_s=1.0,
        resend_shortest_s=0.3,
        resend_longest_s=3.0,
        items_ahead=4,
        stall_s=12.0,
        give_up_s=40.0,
        busy_retry_s=1.5,
        busy_give_up_s=30.0,
        doubt_s=5.0,
        recheck_s=2.5,
        linger_s=2.5,
    ),
    Conditions(
        loss=0.03,
        duplication=0.01,
        corruption=0.01,
        delay_s=0.3,
        jitter_s=0.05,
        bytes_per_s=2_400.0,
        queue_bytes=4_000,
    ),
)
"""A satellite link: 600 ms round trip and little bandwidth."""

LINK_PRESETS: Final = {preset.name: preset for preset in (DEFAULT, TELEMETRY_RADIO, SATELLITE)}
"""By name."""


def link_preset(name: str) -> LinkPreset:
    """Look a preset up by name. Raises MisuseError: an unknown name; the message lists the known ones."""
    try:
        return LINK_PRESETS[name]
    except KeyError:
        raise MisuseError(f"unknown type of link {name!r}; use one of {', '.join(LINK_PRESETS)}") from None

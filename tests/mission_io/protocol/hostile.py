"""Vehicles that are wrong on purpose, by seed: an autopilot's own server, and tricks in front of it and behind it.

A trick sees what arrives before the server does, and changes what the server sends. A vehicle has one to three of them,
with parameters drawn by its seed, so that no two seeds are alike and the same seed is always the same vehicle.
"""

import heapq
import itertools
import math
import random
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

from mission_io.autopilots.autopilot import Autopilot
from mission_io.model.enums import MissionResult
from mission_io.model.items import (
    Fence,
    FencePolygon,
    Frame,
    FramedPoint,
    LatLon,
    MissionItem,
    MissionType,
    RallyPoints,
    items_from_fence,
    items_from_rally,
    waypoint,
)
from mission_io.wire import messages as m
from mission_io.wire.messages import degrees_on_wire
from tests.mission_io.vehicle import VehiclePeer

GROUND = (255, 190)
_ITEMS = (m.MissionItemInt, m.MissionItemFloat)
_REQUESTS = (m.MissionRequest, m.MissionRequestInt)
_RESULTS = (*range(16), 77)


class Trick:
    """What a hostile vehicle does. ``hears`` may swallow what arrived; ``says`` changes what goes out."""

    def __init__(self, rng: random.Random, mission_type: MissionType) -> None:
        self.rng, self.mission_type = rng, mission_type
        self.now = 0.0
        self.draw()

    def draw(self) -> None:
        """Draw what it does."""

    def hears(self, message: m.Message) -> Iterable[m.Message] | None:
        """What the vehicle says instead of letting its server answer; None lets it."""
        del message
        return None

    def says(self, message: m.Message) -> Iterable[m.Message]:
        """What goes out for a message of the server."""
        return [message]

    def ack(self, result: int | None = None) -> m.MissionAck:
        return m.MissionAck(*GROUND, self.rng.choice(_RESULTS) if result is None else result, self.mission_type)

    def request(self, seq: int) -> m.MissionRequestInt:
        return m.MissionRequestInt(*GROUND, seq, self.mission_type)

    def count(self, count: int) -> m.MissionCount:
        return m.MissionCount(*GROUND, count, self.mission_type)


class WrongCount(Trick):
    """Names another number of items than it has, always the same."""

    def draw(self) -> None:
        self.by = self.rng.choice([-2, -1, 1, 2, 500, 65535])

    def says(self, message: m.Message) -> Iterable[m.Message]:
        if isinstance(message, m.MissionCount):
            return [replace(message, count=min(65535, max(0, message.count + self.by)))]
        return [message]


class ChangingCount(Trick):
    """Names another number each time, or two at once."""

    def draw(self) -> None:
        self.twice = self.rng.random() < 0.5

    def says(self, message: m.Message) -> Iterable[m.Message]:
        if not isinstance(message, m.MissionCount):
            return [message]
        counts = [self.rng.randrange(1, 40) for _ in range(1 + self.twice)]
        return [replace(message, count=count) for count in counts]


class CountAfterItems(Trick):
    """Names a number of items after each item."""

    def says(self, message: m.Message) -> Iterable[m.Message]:
        return [message, self.count(self.rng.randrange(50))] if isinstance(message, _ITEMS) else [message]


class ErrorAtItem(Trick):
    """Has an error in place of one item, for ever or some times; and for one item that it is sent."""

    def draw(self) -> None:
        self.seq, self.result = self.rng.randrange(10), self.rng.choice(_RESULTS)
        self.left = self.rng.choice([2, 10_000_000])

    def hears(self, message: m.Message) -> Iterable[m.Message] | None:
        if isinstance(message, (*_REQUESTS, *_ITEMS)) and message.seq == self.seq and self.left:
            self.left -= 1
            return [self.ack(self.result)]
        return None


class EndlessRequests(Trick):
    """Asks for the same items over and over, one after the other, whatever it is told."""

    def draw(self) -> None:
        self.loop = itertools.cycle(self.rng.sample(range(12), self.rng.choice([1, 2, 3, 7])))

    def hears(self, message: m.Message) -> Iterable[m.Message] | None:
        return [self.request(next(self.loop))] if isinstance(message, (m.MissionCount, *_ITEMS)) else None


class LoopOfThree(Trick):
    """Asks 0, 1, 2, 0, 1, 2."""

    def hears(self, message: m.Message) -> Iterable[m.Message] | None:
        if isinstance(message, m.MissionCount):
            return [self.request(0)]
        return [self.request((message.seq + 1) % 3)] if isinstance(message, _ITEMS) else None


class WrongRequests(Trick):
    """Asks for items that do not exist, or skips and repeats."""

    def says(self, message: m.Message) -> Iterable[m.Message]:
        if isinstance(message, _REQUESTS) and self.rng.random() < 0.7:
            return [self.request(self.rng.choice([0, message.seq + 1, message.seq + 3, 40, 65535]))]
        return [message]


class Flood(Trick):
    """Many messages for each that it hears."""

    def hears(self, message: m.Message) -> Iterable[m.Message] | None:
        if isinstance(message, m.Heartbeat):
            return None
        makers: list[Callable[[], m.Message]] = [
            self.ack,
            lambda: self.request(self.rng.randrange(15)),
            lambda: self.count(self.rng.randrange(15)),
        ]
        return [self.rng.choice(makers)() for _ in range(20)]


class Silence(Trick):
    """Says nothing after some messages: for good, for a while, or from the beginning."""

    def draw(self) -> None:
        self.after, self.lasts_s = self.rng.choice([0, 1, 2, 5, 9]), self.rng.choice([4.0, 12.0, 30.0, math.inf])
        self.until = -math.inf

    def hears(self, message: m.Message) -> Iterable[m.Message] | None:
        if isinstance(message, m.Heartbeat):
            return None
        self.after -= 1
        if self.after == -1:
            self.until = self.now + self.lasts_s
        return [] if self.now < self.until else None


class BadNumbers(Trick):
    """Items with numbers that are none, or of nowhere."""

    def says(self, message: m.Message) -> Iterable[m.Message]:
        if not isinstance(message, m.MissionItemInt):
            return [message]
        bad = self.rng.choice([math.nan, math.inf, -math.inf, 2.0**120])
        changes: list[dict[str, Any]] = [
            {"z": bad},
            {"x": self.rng.choice([2**31 - 1, -(2**31), 910_000_000])},
            {"params": (bad, 0.0, bad, math.nan)},
            {"frame": self.rng.randrange(256)},
            {"command": self.rng.randrange(65536)},
        ]
        return [replace(message, **self.rng.choice(changes))]


class ForeignTypes(Trick):
    """Speaks of another list than it was asked for, always or now and then."""

    def draw(self) -> None:
        self.fraction = self.rng.choice([0.3, 1.0])

    def says(self, message: m.Message) -> Iterable[m.Message]:
        if hasattr(message, "mission_type") and self.rng.random() < self.fraction:
            return [replace(message, mission_type=(self.mission_type + self.rng.choice([1, 2, 7])) % 256)]  # type: ignore[call-arg]
        return [message]


class Shuffled(Trick):
    """Items again, in another order, out of range, of the float kind."""

    def draw(self) -> None:
        self.kept: list[m.Message] = []

    def says(self, message: m.Message) -> Iterable[m.Message]:
        if not isinstance(message, m.MissionItemInt):
            return [message]
        self.kept.append(message)
        out = [self.rng.choice(self.kept), replace(message, seq=self.rng.randrange(65536))]
        return [*out, message] if self.rng.random() < 0.8 else out


class StrayAcks(Trick):
    """Acknowledgements of any kind at any time."""

    def says(self, message: m.Message) -> Iterable[m.Message]:
        return [message, self.ack()] if self.rng.random() < 0.4 else [message]


class OnlyAcks(Trick):
    """Answers all that it is told with one acknowledgement, always the same kind."""

    def draw(self) -> None:
        self.result = self.rng.choice(_RESULTS)

    def hears(self, message: m.Message) -> Iterable[m.Message] | None:
        return None if isinstance(message, m.Heartbeat) else [self.ack(self.result)]


class EarlyAck(Trick):
    """Says ACCEPTED when it has only some of the items."""

    def draw(self) -> None:
        self.seq = self.rng.randrange(4)

    def hears(self, message: m.Message) -> Iterable[m.Message] | None:
        early = isinstance(message, _ITEMS) and message.seq >= self.seq
        return [self.ack(MissionResult.ACCEPTED)] if early else None


class SaysClearedAndIsNot(Trick):
    """Acknowledges that it emptied a list, or says anything else, and does nothing."""

    def draw(self) -> None:
        self.result = self.rng.choice([0, 0, *_RESULTS])

    def hears(self, message: m.Message) -> Iterable[m.Message] | None:
        return [self.ack(self.result)] if isinstance(message, m.MissionClearAll) else None


class SameItemForEver(Trick):
    """Serves one item whatever is asked for."""

    def hears(self, message: m.Message) -> Iterable[m.Message] | None:
        return (
            [m.MissionItemInt(*GROUND, 1, 3, 16, (0.0,) * 4, 461234567, 71234567, 1.0, mission_type=self.mission_type)]
            if (isinstance(message, _REQUESTS))
            else None
        )


class BreaksOffAndServes(Trick):
    """Serves so many items, then an error; the next time one more or one fewer."""

    def draw(self) -> None:
        self.served, self.room = 0, 1

    def hears(self, message: m.Message) -> Iterable[m.Message] | None:
        if isinstance(message, m.MissionRequestList | m.MissionCount):
            self.served, self.room = 0, self.rng.randrange(1, 8)
        if isinstance(message, (*_REQUESTS, *_ITEMS)):
            self.served += 1
            if self.served > self.room:
                return [self.ack(self.rng.choice([1, 4, 14]))]
        return None


TRICKS: tuple[type[Trick], ...] = (
    WrongCount, ChangingCount, CountAfterItems, ErrorAtItem, EndlessRequests, LoopOfThree, WrongRequests, Flood, Silence,
    BadNumbers, ForeignTypes, Shuffled, StrayAcks, OnlyAcks, EarlyAck, SaysClearedAndIsNot, SameItemForEver,
    BreaksOffAndServes,
)  # fmt: skip
"""Every seed begins with one of them in turn, and may have more."""


class HostileVehicle(VehiclePeer):
    """The vehicle of a seed.

    Attributes:
        sent_count: How many messages reached it, heartbeats aside.
        said: All that it sent, heartbeats aside.
    """

    def __init__(self, autopilot: Autopilot, seed: int, mission_type: MissionType, *, held: int) -> None:
        super().__init__(autopilot)
        rng = random.Random(f"{seed} {autopilot.name} {mission_type.name}")
        kinds = [TRICKS[seed % len(TRICKS)], *rng.choices(TRICKS, k=rng.choice([0, 0, 1, 2]))]
        self.tricks = [kind(rng, mission_type) for kind in dict.fromkeys(kinds)]
        self.delay_s = rng.choice([0.0, 0.0, 0.0, 0.05, 0.7, 3.0])
        self.server.set_items(mission_type, valid_items(held, mission_type))
        self.sent_count = 0
        self.said: list[m.Message] = []
        self._queue: list[tuple[float, int, m.Message]] = []
        self._order = itertools.count()

    @property
    def name(self) -> str:
        """What it does, for reports."""
        late = f" + {self.delay_s:g} s late" if self.delay_s else ""
        return " + ".join(type(trick).__name__ for trick in self.tricks) + late

    def receive_datagram(self, data: bytes, now: float) -> None:
        for received in self.codec.decode(data):
            if not isinstance(received.message, m.Heartbeat):
                self.sent_count += 1
            for trick in self.tricks:
                trick.now = now
                instead = trick.hears(received.message)
                if instead is not None:
                    self._put(instead, now)
                    break
            else:
                self.server.receive(received, now)
                self._serve(now)

    def datagrams_to_send(self, now: float) -> list[bytes]:
        self._serve(now)
        out: list[m.Message] = []
        while self._queue and self._queue[0][0] <= now:
            out.append(heapq.heappop(self._queue)[2])
        self.said += out
        if now >= self._beat_at:
            self._beat_at = now + 1.0
            out.append(m.Heartbeat(self.autopilot.mav_autopilot, 2, 0, 0, 3))
        return [self.codec.encode(message) for message in out]

    def next_timer(self) -> float | None:
        times = [self._beat_at, *([self._queue[0][0]] if self._queue else [])]
        timer = self.server.next_timer()
        return min(times if timer is None else [*times, timer])

    def _serve(self, now: float) -> None:
        for message in self.server.messages_to_send(now):
            out: list[m.Message] = [message]
            for trick in self.tricks:
                out = [said for one in out for said in trick.says(one)]
            self._put(out, now)

    def _put(self, messages: Iterable[m.Message], now: float) -> None:
        for message in messages:
            heapq.heappush(self._queue, (now + self.delay_s, next(self._order), message))


class SlowVehicle(VehiclePeer):
    """An honest vehicle that takes its time for every answer; what it was told meanwhile is forgotten."""

    def __init__(self, autopilot: Autopilot, answer_s: float) -> None:
        super().__init__(autopilot)
        self.answer_s = answer_s
        self._due: list[tuple[float, m.Message]] = []
        self._answered: set[tuple[type, int]] = set()

    def receive_datagram(self, data: bytes, now: float) -> None:
        for received in self.codec.decode(data):
            message = received.message
            key = (type(message), getattr(message, "seq", -1))
            if isinstance(message, m.Heartbeat) or key in self._answered:
                continue
            self._answered.add(key)
            self.server.receive(m.Received(message, received.system_id, received.component_id), now)
            self._due += [(now + self.answer_s, answer) for answer in self.server.messages_to_send(now)]

    def datagrams_to_send(self, now: float) -> list[bytes]:
        out = [message for due, message in self._due if due <= now]
        self._due = [(due, message) for due, message in self._due if due > now]
        if now >= self._beat_at:
            self._beat_at = now + 1.0
            out.append(m.Heartbeat(self.autopilot.mav_autopilot, 2, 0, 0, 3))
        return [self.codec.encode(message) for message in out]

    def next_timer(self) -> float | None:
        return min([self._beat_at, *(due for due, _ in self._due)])


def valid_items(count: int, mission_type: MissionType) -> tuple[MissionItem, ...]:
    """A list that both autopilots take, of about ``count`` items: for a fence whole triangles."""

    def at(i: int) -> tuple[float, float]:
        return degrees_on_wire(46.1 + i * 1e-3), degrees_on_wire(-7.2 - i * 2e-3)

    if mission_type is MissionType.MISSION:
        return tuple(waypoint(*at(i), 100.0 + i, frame=Frame.ABOVE_HOME) for i in range(count))
    if mission_type is MissionType.RALLY:
        return items_from_rally(RallyPoints(tuple(FramedPoint(*at(i), 100.0 + i) for i in range(count))))
    corners = [LatLon(*at(i)) for i in range(count)]
    triangles = [
        FencePolygon((corner, LatLon(corner.lat_deg, second.lon_deg), third))
        for corner, second, third in zip(corners[::3], corners[1::3], corners[2::3], strict=False)
    ]
    return items_from_fence(Fence(tuple(triangles)))

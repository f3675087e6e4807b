"""A case for a ground station: the trick that the vehicle plays, and evidence of the station's reaction."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from random import Random
from typing import Any, Final, TypeAlias

from mission_io.conformance.case import ITEMS, REQUESTS, ProtocolCase
from mission_io.model.enums import MissionResult
from mission_io.model.items import MissionItem, MissionType
from mission_io.wire import messages as m
from mission_io.wire.messages import Address, Message, float_message

# Faults of the fake vehicle: each trick swallows received messages, or changes sent ones.

OTHER_STATION: Final = Address(254, 190)
OTHER_VEHICLE: Final = Address(2, 1)


@dataclass(frozen=True, slots=True)
class Said:
    """A message that goes out, after a delay, perhaps in the name of another vehicle."""

    message: m.Message
    after_s: float = 0.0
    sender: Address | None = None


Kinds: TypeAlias = tuple[type[m.Message], ...]


class Trick:
    """Does nothing; the base of the others. Each case gets a new one."""

    def hears(self, message: m.Message, now: float) -> bool:
        """Whether the vehicle hears a message."""
        del message, now
        return True

    def forgets(self) -> bool:
        """Whether the vehicle drops the current upload now."""
        return False

    def says(self, message: m.Message, now: float) -> list[Said]:
        """Messages that go out for a message of the vehicle."""
        del now
        return [Said(message)]


class Deaf(Trick):
    """Does not hear the first ``times`` messages of some kinds."""

    def __init__(self, kinds: Kinds, times: float = float("inf"), seq: int | None = None) -> None:
        self._kinds, self._left, self._seq = kinds, times, seq

    def hears(self, message: m.Message, now: float) -> bool:
        """Swallow it, or not."""
        wanted = isinstance(message, self._kinds) and self._seq in (None, getattr(message, "seq", None))
        if wanted and self._left > 0:
            self._left -= 1
            return False
        return True


class EachOnceDeaf(Trick):
    """Hears each item, or each request of one, only the second time."""

    def __init__(self, kinds: Kinds) -> None:
        self._kinds = kinds
        self._heard: Counter[int] = Counter()

    def hears(self, message: m.Message, now: float) -> bool:
        """Swallow the first one of each number."""
        if isinstance(message, self._kinds):
            seq = getattr(message, "seq", 0)
            self._heard[seq] += 1
            return self._heard[seq] > 1
        return True


class Instead(Trick):
    """Replaces the first ``times`` messages of some kinds."""

    def __init__(
        self,
        applies: Callable[[Any], bool],
        other: Callable[[Any], Sequence[Said]],
        times: float = float("inf"),
    ) -> None:
        self._applies, self._other, self._left = applies, other, times

    def says(self, message: m.Message, now: float) -> list[Said]:
        """Say the other thing, or this one."""
        if self._left > 0 and self._applies(message):
            self._left -= 1
            return list(self._other(message))
        return [Said(message)]


class Loses(Trick):
    """Loses a fraction of everything, both ways, by a fixed seed."""

    def __init__(self, fraction: float) -> None:
        self._fraction, self._rng = fraction, Random(7)

    def hears(self, message: m.Message, now: float) -> bool:
        """Swallow it, or not."""
        return self._rng.random() >= self._fraction

    def says(self, message: m.Message, now: float) -> list[Said]:
        """Say it, or not."""
        return [] if self._rng.random() < self._fraction else [Said(message)]


class FallsSilent(Trick):
    """From item ``seq`` on it is silent; after ``for_s`` seconds it is back, without the upload."""

    def __init__(self, seq: int, for_s: float = float("inf")) -> None:
        self._seq, self._for_s = seq, for_s
        self._since: float | None = None
        self._drops = False

    def _silent(self, now: float) -> bool:
        return self._since is not None and now - self._since < self._for_s

    def hears(self, message: m.Message, now: float) -> bool:
        """Nothing while it is silent."""
        if self._since is None and isinstance(message, ITEMS) and message.seq == self._seq:
            self._since, self._drops = now, True
        return not self._silent(now)

    def forgets(self) -> bool:
        """Once, when it falls silent."""
        drops, self._drops = self._drops, False
        return drops

    def says(self, message: m.Message, now: float) -> list[Said]:
        """Nothing while it is silent."""
        return [] if self._silent(now) else [Said(message)]


def late(kinds: Kinds, delay_s: float) -> Trick:
    """Says some kinds of messages late."""
    return Instead(lambda got: isinstance(got, kinds), lambda got: [Said(got, delay_s)])


def again(kinds: Kinds, times: int) -> Trick:
    """Says some kinds of messages several times."""
    return Instead(lambda got: isinstance(got, kinds), lambda got: [Said(got)] * times)


def refusal(message: Any, result: MissionResult) -> m.MissionAck:
    """An acknowledgement with a result, to whom a message goes."""
    return m.MissionAck(message.target_system, message.target_component, result, message.mission_type)


def refuses(result: MissionResult, *, at: int = 1) -> Trick:
    """Answers each request for item ``at`` with an error."""
    return Instead(is_request(at), lambda got: [Said(refusal(got, result))])


def before(applies: Callable[[Any], bool], extra: Callable[[Any], Said], times: float = float("inf")) -> Trick:
    """Says something else first."""
    return Instead(applies, lambda got: [extra(got), Said(got, 0.3)], times)


def is_request(seq: int) -> Callable[[Any], bool]:
    """Whether a message requests an item."""
    return lambda got: isinstance(got, REQUESTS) and got.seq == seq


def is_item(seq: int) -> Callable[[Any], bool]:
    """Whether a message is an item."""
    return lambda got: isinstance(got, ITEMS) and got.seq == seq


def to_other_station(message: Any) -> m.Message:
    """The same message, to the second ground station."""
    other: m.Message = replace(
        message, target_system=OTHER_STATION.system_id, target_component=OTHER_STATION.component_id
    )
    return other


def of_other_list(message: Any) -> m.Message:
    """The same message, about the next list."""
    mission_type = (message.mission_type + 1) % 3
    other: m.Message = replace(message, mission_type=mission_type)
    return other


def as_float(message: m.Message) -> m.Message:
    """An item in the deprecated form; other messages as they are."""
    return float_message(message) if isinstance(message, m.MissionItemInt) else message


def with_count(by: int) -> Callable[[Any], Sequence[Said]]:
    """A count that is wrong by a number of items."""
    return lambda got: [Said(replace(got, count=got.count + by) if isinstance(got, m.MissionCount) else got)]


# Evidence of a ground station's behaviour in one case, and the case itself.


class Operation(Enum):
    """Operation that a ground station begins."""

    UPLOAD = "upload a list"
    EMPTY = "upload an empty list"
    CANCEL_UPLOAD = "upload a list and cancel it"
    DOWNLOAD = "download a list"
    CANCEL_DOWNLOAD = "download a list and cancel it"
    CLEAR = "clear a list"
    SET_CURRENT = "set the current item"


ON_REQUEST: Final = (Operation.CANCEL_UPLOAD, Operation.CANCEL_DOWNLOAD)
"""Run only if the case is named, because a ground station cannot know when to cancel."""


@dataclass(frozen=True, slots=True)
class HeardMessage:
    """A message of the ground station."""

    at_s: float
    message: Message


@dataclass(slots=True)
class StationEvidence:
    """Messages and states of one case."""

    operation: Operation  # the station's transfer
    mission_type: MissionType  # about which list
    station: Address  # its address
    vehicle: Address  # its correct recipient
    began_s: float
    old: tuple[MissionItem, ...]  # the list that the vehicle held before
    heard: list[HeardMessage] = field(default_factory=list)  # its messages in the mission protocol
    said: list[HeardMessage] = field(default_factory=list)  # the vehicle's messages
    held: tuple[MissionItem, ...] = ()  # the list that it holds now
    reported_success: bool | None = None  # the station's report to its user; None if unknown
    unending: bool = False  # whether the station was still at it when the time was up

    def of(self, *kinds: type[Message]) -> list[HeardMessage]:
        """The station's messages of some kinds, about the list."""
        return [h for h in self.heard if isinstance(h.message, kinds) and self._is_about(h.message)]

    def answered(self, *kinds: type[Message]) -> list[HeardMessage]:
        """The vehicle's messages of some kinds, about the list and to the station."""
        return [h for h in self.said if isinstance(h.message, kinds) and self._is_about(h.message)]

    def _is_about(self, message: Message) -> bool:
        return getattr(message, "mission_type", self.mission_type) == self.mission_type

    @property
    def lasted_s(self) -> float:
        """Seconds from the first to the last message of the station."""
        return self.heard[-1].at_s - self.began_s if self.heard else 0.0


@dataclass(frozen=True, slots=True)
class ClientCase(ProtocolCase[StationEvidence]):
    """A case for a ground station."""

    operation: Operation = Operation.UPLOAD  # the transfer that it must begin
    trick: Callable[[], Trick] = Trick  # misbehaves as the vehicle
    mission_type: MissionType | None = None  # the list that it has to be about; None for any

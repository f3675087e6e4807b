"""What the client's three conversations (upload, download, clear) have in common."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar, Generic, TypeVar

from mission_io.enums import MissionResult
from mission_io.errors import MisuseError
from mission_io.items import MissionType
from mission_io.messages import Message, MissionAck, Received, is_for
from mission_io.protocol.table import Table

StateT = TypeVar("StateT", bound=Enum)
EventT = TypeVar("EventT", bound=Enum)


@dataclass(frozen=True, slots=True)
class Address:
    """A system and one of its components."""

    system_id: int
    component_id: int


@dataclass(frozen=True, slots=True)
class Timing:
    """How patient a client is; all in seconds.

    Attributes:
        resend_s: First silence after which the last thing the vehicle waits for is sent again.
        resend_growth: Each further silence in a row is longer by this factor ...
        resend_longest_s: ... up to this. Any answer starts over.
        stall_s: Silence after which a conversation that had begun is begun anew. Longer than PX4 takes to drop one.
        give_up_s: Silence after which the vehicle counts as silent.
        busy_retry_s: Wait after "busy" or "no space" before asking again.
        busy_give_up_s: A vehicle that is busy for longer has refused. Longer than ArduPilot's own time-out.
        doubt_s: Wait after an ERROR that may only answer a duplicate, for a sign that the transfer goes on.
        linger_s: How long a cancelled transfer keeps telling the vehicle so.
    """

    resend_s: float = 0.05
    resend_growth: float = 1.5
    resend_longest_s: float = 0.4
    stall_s: float = 6.0
    give_up_s: float = 15.0
    busy_retry_s: float = 0.5
    busy_give_up_s: float = 15.0
    doubt_s: float = 2.5
    linger_s: float = 1.0

    def __post_init__(self) -> None:
        """Refuse times that would never end or never begin."""
        for name in ("resend_s", "stall_s", "give_up_s", "busy_retry_s", "busy_give_up_s", "doubt_s", "linger_s"):
            if not getattr(self, name) > 0.0:
                raise MisuseError(f"Timing.{name} is {getattr(self, name)}, give a positive number of seconds")
        if not (self.resend_growth >= 1.0 and self.resend_longest_s >= self.resend_s):
            raise MisuseError("Timing: resend_growth must be at least 1 and resend_longest_s at least resend_s")


class Exchange(ABC, Generic[StateT, EventT]):
    """One conversation with one vehicle about one list.

    Feed it with ``receive`` and ask ``messages_to_send`` after that and whenever ``next_timer`` is over, until
    ``finished``. Messages from others, for others, or about another list pass by without effect.
    """

    table: ClassVar[Table]  # type: ignore[type-arg]

    def __init__(
        self,
        start: StateT,
        *,
        mission_type: MissionType,
        local: Address,
        vehicle: Address,
        timing: Timing,
        now: float,
    ) -> None:
        self.state: StateT = start
        self.mission_type, self.local, self.vehicle, self.timing = mission_type, local, vehicle, timing
        self.last_result: MissionResult | int | None = None
        self._outbox: list[Message] = []
        self._last_heard = self._last_sent = now
        self._silences = 0
        self._busy_since: float | None = None
        self._waiting_since = now

    @property
    @abstractmethod
    def finished(self) -> bool:
        """Whether the conversation is over; ``state`` says how."""

    @abstractmethod
    def _event_of(self, message: Message) -> EventT | None:
        """What a message of the vehicle means; None when it is no part of this conversation."""

    @abstractmethod
    def _deadlines(self) -> list[tuple[float, EventT]]:
        """The times at which something happens in the present state although nothing arrives."""

    @abstractmethod
    def _actions(self) -> Mapping[str, Callable[[float], None]]:
        """What the table's actions do."""

    def receive(self, received: Received, now: float) -> None:
        """Take a message that arrived at ``now``."""
        message = received.message
        sender = Address(received.system_id, received.component_id)
        if self.finished or sender != self.vehicle:
            return
        if not is_for(message, system_id=self.local.system_id, component_id=self.local.component_id):
            return
        if getattr(message, "mission_type", None) != self.mission_type:
            return
        event = self._event_of(message)
        if event is None:
            return
        if isinstance(message, MissionAck):
            self.last_result = _named(message.result)
        self._last_heard = now
        self._silences = 0
        self._step(event, now)

    def messages_to_send(self, now: float) -> list[Message]:
        """Everything that has to be sent by ``now``."""
        while not self.finished:
            due, event = min(self._deadlines(), key=lambda deadline: deadline[0])
            if due > now:
                break
            self._step(event, now)
        outbox, self._outbox = self._outbox, []
        return outbox

    def next_timer(self) -> float | None:
        """When to ask ``messages_to_send`` again although nothing arrives; None when finished."""
        if self.finished:
            return None
        return min(due for due, _ in self._deadlines())

    def _step(self, event: EventT, now: float) -> None:
        row = self.table.row(self.state, event)
        if row.state is not row.next_state:
            self._waiting_since = now
        self.state = row.next_state
        if row.action:
            self._actions()[row.action](now)

    def _send(self, message: Message, now: float) -> None:
        self._outbox.append(message)
        self._last_sent = now

    def _count_silence(self) -> None:
        self._silences += 1

    def _resend_at(self) -> float:
        timing = self.timing
        return self._last_sent + min(timing.resend_s * timing.resend_growth**self._silences, timing.resend_longest_s)

    def _busy_until(self) -> float:
        since = self._busy_since if self._busy_since is not None else self._waiting_since
        return since + self.timing.busy_give_up_s

    def _note_busy(self, now: float) -> None:
        if self._busy_since is None:
            self._busy_since = now


def _named(result: int) -> MissionResult | int:
    return MissionResult(result) if result in MissionResult._value2member_map_ else result

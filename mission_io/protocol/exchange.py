"""The common part of the client's three exchanges: upload, download and clear."""

from abc import ABC, abstractmethod
from enum import Enum
from operator import itemgetter
from typing import ClassVar, Generic, Required, TypedDict, TypeVar, Unpack

from mission_io.model.enums import MissionResult
from mission_io.model.items import MissionType
from mission_io.protocol.tables import Row, Table, staying
from mission_io.protocol.timing import TRANSFERS, Departures, RetryLimits, Timing
from mission_io.wire.messages import Address, Message, MissionAck, MissionClearAll, Received, is_for

StateT = TypeVar("StateT", bound=Enum)


EventT = TypeVar("EventT", bound=Enum)


OPENING = -1
"""Represents the first message of an exchange (COUNT, REQUEST_LIST, CLEAR_ALL) among the item numbers."""


class ExchangeOptions(TypedDict, total=False):
    """Arguments of every exchange: its list, both ends, when it begins, and what is known of the link."""

    mission_type: Required[MissionType]
    local: Required[Address]
    vehicle: Required[Address]
    now: Required[float]
    timing: Timing | None
    retry_limits: RetryLimits | None


class Exchange(ABC, Generic[StateT, EventT]):
    """One exchange with one vehicle about one list.

    Call ``receive`` with every message, and ``messages_to_send`` after that and whenever ``next_timer`` expires, until
    ``finished``. Messages from others, for others, or about another list have no effect. An action of ``table`` is a method.

    Attributes:
        retry_limits: What was learnt about the link; pass it to the next exchange with the same vehicle.
        last_result: The last MissionResult of the vehicle that had an effect; None before the first.
        silences: Number of repetitions after a silence.
        restarts: Number of restarts of the exchange.
        list_id: The vehicle's id of the list that was transferred; 0 before the end, and from a vehicle without ids.
    """

    table: ClassVar[Table]  # type: ignore[type-arg]

    def __init__(
        self,
        start: StateT,
        *,
        mission_type: MissionType,
        local: Address,
        vehicle: Address,
        now: float,
        timing: Timing | None = None,
        retry_limits: RetryLimits | None = None,
    ) -> None:
        self.state: StateT = start
        self.mission_type, self.local, self.vehicle = mission_type, local, vehicle
        self.timing = timing if timing is not None else Timing()
        self.retry_limits = retry_limits if retry_limits is not None else RetryLimits()
        self.last_result: MissionResult | int | None = None
        self._outbox: list[Message] = []
        self._last_heard = self._last_sent = now
        self.silences = self.restarts = self.list_id = 0
        self._began_at = self._progress_at = now  # start of this attempt, and time of the last progress
        self._reached = -1  # furthest progress so far: items held, or the item requested
        self._regain_s = self._slowest_s = 0.0
        self._backed_off = 0
        self._departures = Departures()
        self._ahead = self.timing.items_ahead
        self._clean = 0
        self._busy_since: float | None = None
        self._waiting_since = now
        self._next_timer: float | None = None

    @property
    def finished(self) -> bool:
        """Whether the exchange is over; ``state`` says how."""
        return self.table.is_end(self.state)

    @abstractmethod
    def _event_of(self, message: Message, now: float) -> EventT | None:
        """The event of a vehicle's message; None when it is not part of this exchange."""

    @abstractmethod
    def _deadlines(self) -> list[tuple[float, EventT]]:
        """The times at which something happens in the current state although nothing arrives.

        One of them is ``_stuck_at``, or another that stray messages cannot postpone, so the exchange always ends.
        """

    def _event_when_due(self, event: EventT) -> EventT:
        """The event of a deadline at its time."""
        return event

    def receive(self, received: Received, now: float) -> None:
        """Process a message that arrived at ``now``."""
        message = received.message
        if self.finished or received.sender != self.vehicle:
            return
        if not is_for(message, system_id=self.local.system_id, component_id=self.local.component_id):
            return
        if getattr(message, "mission_type", None) != self.mission_type:
            return
        event = self._event_of(message, now)
        if event is None:
            return
        if isinstance(message, MissionAck) and self._means_something(event):
            self.last_result = _named(message.result)
        self._last_heard = now
        self._step(event, now)

    def _means_something(self, event: EventT) -> bool:
        """Whether an event has an effect now; an answer to a late duplicate is no reason for what follows."""
        row = self.table.row(self.state, event)
        return row.state is not row.next_state or bool(row.action)

    def messages_to_send(self, now: float) -> list[Message]:
        """The messages due by ``now``."""
        while not self.finished:
            due, event = min(self._deadlines(), key=_due)
            if due > now:
                self._next_timer = due
                break
            self._step(self._event_when_due(event), now)
        outbox, self._outbox = self._outbox, []
        return outbox

    def next_timer(self) -> float | None:
        """When to call ``messages_to_send`` again although nothing arrives; None when finished."""
        if self.finished:
            return None
        if self._next_timer is None:
            self._next_timer = min(self._deadlines(), key=_due)[0]
        return self._next_timer

    def _step(self, event: EventT, now: float) -> None:
        self._next_timer = None
        row = self.table.row(self.state, event)
        if row.state is not row.next_state:
            self._waiting_since = now
        self.state = row.next_state
        if row.action:
            getattr(self, f"_{row.action}")(now)

    def _send(self, message: Message, now: float, *, question: int | None = None) -> None:
        """Send; ``question`` is the number that ``_answered`` will get with the answer."""
        self._outbox.append(message)
        self._last_sent = now
        if question is not None:
            self._departures.sent(question, now)

    def _got_to(self, reached: int, now: float) -> None:
        """Note how far the exchange is; only getting further than ever counts as progress."""
        if reached > self._reached:
            self._reached = reached
            self._progress_at, self._regain_s = now, 0.0
            self._busy_since = None

    def _stuck_at(self) -> float:
        """When the exchange is given up unless there is progress."""
        return self._progress_at + self._regain_s + self.timing.no_progress_s

    def _stalled_at(self) -> float:
        """When a silence means a stalled exchange: later for a vehicle that answered slowly before."""
        return self._last_heard + max(self.timing.stall_s, 2.0 * self._slowest_s)

    def _silent_at(self) -> float:
        """Time after which a silence means that the vehicle is gone."""
        return self._stalled_at() + max(0.0, self.timing.give_up_s - self.timing.stall_s)

    def _note_restart(self, now: float) -> None:
        """The exchange restarts: allow the time to get as far again."""
        self.restarts += 1
        if self.restarts <= TRANSFERS.restarts:
            longest_s = (self._reached + 1) * self.timing.resend_longest_s
            self._regain_s += min(now - self._began_at, longest_s)
        self._began_at = now

    def _answered(self, question: int, now: float) -> None:
        """The vehicle answered a question: learn the round-trip time, and work further ahead."""
        answer = self._departures.answered(question, now)
        if answer is not None:
            self.retry_limits = self.retry_limits.after(answer)
            self._slowest_s = max(self._slowest_s, answer.since_first_s)
        self._backed_off = 0
        self._clean += 1
        if self._clean >= TRANSFERS.clean_answers:
            self._clean = 0
            self._ahead = min(self._ahead + 1, self.timing.items_ahead)

    def _count_silence(self) -> None:
        self.silences += 1
        self._backed_off += 1
        self._ahead = self._clean = 0

    def _send_result(self, result: MissionResult, now: float) -> None:
        self._send(MissionAck(*self.vehicle, result, self.mission_type), now)

    def _send_cancel(self, now: float) -> None:
        """Tell the vehicle that the transfer is cancelled. It is not answered: on a lossy link it is sent three times."""
        for _ in range(TRANSFERS.cancels_on_a_bad_link if self.silences else 1):
            self._send_result(MissionResult.OPERATION_CANCELLED, now)

    def _sent_within(self, round_trips: float, question: int, now: float) -> bool:
        """Whether a question was last sent less than a number of round trips ago."""
        age_s = self._departures.age_s(question, now)
        round_trip = self.retry_limits.round_trip
        return age_s is not None and round_trip is not None and age_s < round_trips * round_trip.smoothed_s

    def _resend_at(self) -> float:
        timing = self.timing
        round_trip = self.retry_limits.round_trip
        first_s = timing.resend_s if round_trip is None else round_trip.time_out_s
        first_s = max(first_s, timing.resend_shortest_s)
        wait_s = first_s * timing.resend_growth ** min(self._backed_off, 64)
        return self._last_sent + min(wait_s, max(timing.resend_longest_s, first_s))

    def _busy_until(self) -> float:
        since = self._busy_since if self._busy_since is not None else self._waiting_since
        return since + self.timing.busy_give_up_s

    def _note_busy(self, now: float) -> None:
        if self._busy_since is None:
            self._busy_since = now


_due = itemgetter(0)


def _named(result: int) -> MissionResult | int:
    return MissionResult(result) if result in MissionResult._value2member_map_ else result


# Clearing a list on a vehicle, as a state machine.


class ClearState(Enum):
    """State of a clear."""

    REQUESTED = "the client requested an empty list"
    BACKING_OFF = "the vehicle was busy, and the request is sent again later"
    CLEARED = "the vehicle cleared the list"
    REFUSED = "the vehicle refused"
    SILENT = "the vehicle stopped answering"
    STUCK = "the vehicle answers but makes no progress"


class ClearEvent(Enum):
    """Events of a clear."""

    ACK_ACCEPTED = "acknowledged"
    ACK_BUSY = "denied, or an error without a reason: busy"
    ACK_STRAY = "out of sequence, or cancelled: left over from a transfer"
    ACK_REFUSED = "any other result"
    RESEND = "silence: say it again"
    NO_PROGRESS = "for long only answers that mean nothing"
    GIVE_UP = "silence for good"
    RETRY = "waited long enough for a busy vehicle"
    EXHAUSTED = "busy for too long"


_S, _E = ClearState, ClearEvent

CLEAR_TABLE: Table[ClearState, ClearEvent] = Table(
    [
        Row(_S.REQUESTED, _E.ACK_ACCEPTED, _S.CLEARED, "finish"),
        Row(_S.REQUESTED, _E.ACK_BUSY, _S.BACKING_OFF, "note_busy"),
        Row(_S.REQUESTED, _E.ACK_REFUSED, _S.REFUSED),
        Row(_S.REQUESTED, _E.RESEND, _S.REQUESTED, "resend"),
        Row(_S.REQUESTED, _E.GIVE_UP, _S.SILENT),
        Row(_S.REQUESTED, _E.NO_PROGRESS, _S.STUCK),
        *staying(_S.REQUESTED, _E.ACK_STRAY),
        #
        Row(_S.BACKING_OFF, _E.ACK_ACCEPTED, _S.CLEARED),
        Row(_S.BACKING_OFF, _E.ACK_REFUSED, _S.REFUSED),
        Row(_S.BACKING_OFF, _E.RETRY, _S.REQUESTED, "ask_anew"),
        Row(_S.BACKING_OFF, _E.EXHAUSTED, _S.REFUSED),
        # ArduPilot answers a denied clear twice.
        *staying(_S.BACKING_OFF, _E.ACK_BUSY, _E.ACK_STRAY),
    ]
)
"""Every transition of a clear. A finished clear ignores everything."""

_ACK_EVENTS: dict[int, ClearEvent] = {
    MissionResult.ACCEPTED: _E.ACK_ACCEPTED,
    MissionResult.DENIED: _E.ACK_BUSY,
    # PX4 answers this while a download is unfinished, ArduPilot to a late duplicate of an item.
    MissionResult.ERROR: _E.ACK_BUSY,
    MissionResult.INVALID_SEQUENCE: _E.ACK_STRAY,
    MissionResult.OPERATION_CANCELLED: _E.ACK_STRAY,
}


class Clear(Exchange[ClearState, ClearEvent]):
    """One request to clear the list ``mission_type``."""

    table: ClassVar = CLEAR_TABLE

    def __init__(self, **options: Unpack[ExchangeOptions]) -> None:
        super().__init__(ClearState.REQUESTED, **options)
        self._ask(options["now"])

    def cancel(self, now: float) -> None:
        """No effect: the vehicle may have emptied the list already."""

    def _event_of(self, message: Message, now: float) -> ClearEvent | None:
        del now
        if isinstance(message, MissionAck):
            return _ACK_EVENTS.get(message.result, ClearEvent.ACK_REFUSED)
        return None

    def _deadlines(self) -> list[tuple[float, ClearEvent]]:
        timing = self.timing
        if self.state is ClearState.REQUESTED:
            return [
                (self._stuck_at(), ClearEvent.NO_PROGRESS),
                (self._silent_at(), ClearEvent.GIVE_UP),
                (self._resend_at(), ClearEvent.RESEND),
            ]
        return [
            (self._busy_until(), ClearEvent.EXHAUSTED),
            (self._waiting_since + timing.busy_retry_s, ClearEvent.RETRY),
        ]

    def _ask(self, now: float) -> None:
        self._send(MissionClearAll(*self.vehicle, self.mission_type), now, question=OPENING)

    def _finish(self, now: float) -> None:
        self._answered(OPENING, now)

    def _ask_anew(self, now: float) -> None:
        self._departures.clear()
        self._ask(now)

    def _resend(self, now: float) -> None:
        self._count_silence()
        self._ask(now)

"""Clearing a list on a vehicle, as a state machine."""

from collections.abc import Callable, Mapping
from enum import Enum
from typing import ClassVar, Unpack

from mission_io.model.enums import MissionResult
from mission_io.protocol.exchange import OPENING, Exchange, ExchangeOptions
from mission_io.protocol.tables import Row, Table, staying
from mission_io.wire.messages import Message, MissionAck, MissionClearAll


class ClearState(Enum):
    """State of a clear."""

    ASKED = "the client requested an empty list"
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
        Row(_S.ASKED, _E.ACK_ACCEPTED, _S.CLEARED, "finish"),
        Row(_S.ASKED, _E.ACK_BUSY, _S.BACKING_OFF, "note_busy"),
        Row(_S.ASKED, _E.ACK_REFUSED, _S.REFUSED),
        Row(_S.ASKED, _E.RESEND, _S.ASKED, "resend"),
        Row(_S.ASKED, _E.GIVE_UP, _S.SILENT),
        Row(_S.ASKED, _E.NO_PROGRESS, _S.STUCK),
        *staying([_S.ASKED], [_E.ACK_STRAY]),
        #
        Row(_S.BACKING_OFF, _E.ACK_ACCEPTED, _S.CLEARED),
        Row(_S.BACKING_OFF, _E.ACK_REFUSED, _S.REFUSED),
        Row(_S.BACKING_OFF, _E.RETRY, _S.ASKED, "ask_anew"),
        Row(_S.BACKING_OFF, _E.EXHAUSTED, _S.REFUSED),
        # ArduPilot answers a denied clear twice.
        *staying([_S.BACKING_OFF], [_E.ACK_BUSY, _E.ACK_STRAY]),
    ]
)
"""Every transition of a clear. A finished clear ignores everything."""

CLEAR_ENDS = frozenset({_S.CLEARED, _S.REFUSED, _S.SILENT, _S.STUCK})

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
        super().__init__(ClearState.ASKED, **options)
        self._ask(options["now"])

    @property
    def finished(self) -> bool:
        """Whether the clear is over; ``state`` says how."""
        return self.state in CLEAR_ENDS

    def cancel(self, now: float) -> None:
        """No effect: the vehicle may have emptied the list already."""

    def _event_of(self, message: Message, now: float) -> ClearEvent | None:
        del now
        if isinstance(message, MissionAck):
            return _ACK_EVENTS.get(message.result, ClearEvent.ACK_REFUSED)
        return None

    def _deadlines(self) -> list[tuple[float, ClearEvent]]:
        timing = self.timing
        if self.state is ClearState.ASKED:
            return [
                (self._stuck_at(), ClearEvent.NO_PROGRESS),
                (self._silent_at(), ClearEvent.GIVE_UP),
                (self._resend_at(), ClearEvent.RESEND),
            ]
        return [
            (self._busy_until(), ClearEvent.EXHAUSTED),
            (self._waiting_since + timing.busy_retry_s, ClearEvent.RETRY),
        ]

    def _actions(self) -> Mapping[str, Callable[[float], None]]:
        return {
            "finish": self._finish,
            "resend": self._resend,
            "ask_anew": self._ask_anew,
            "note_busy": self._note_busy,
        }

    def _ask(self, now: float) -> None:
        to = self.vehicle
        self._send(MissionClearAll(to.system_id, to.component_id, self.mission_type), now, question=OPENING)

    def _finish(self, now: float) -> None:
        self._answered(OPENING, now)

    def _ask_anew(self, now: float) -> None:
        self._departures.clear()
        self._ask(now)

    def _resend(self, now: float) -> None:
        self._count_silence()
        self._ask(now)

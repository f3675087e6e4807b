"""Fetching a list from a vehicle, as a state machine: ask for the list, then for each item, then say thanks.

Where the vehicle serves items in any order, one more is asked for before the last one is here; PX4 ends a download whose
requests come out of order, so there it is one after the other.
"""

from collections.abc import Callable, Mapping
from enum import Enum
from typing import ClassVar

from mission_io.enums import MissionResult
from mission_io.items import MissionItem, MissionType
from mission_io.messages import (
    Message,
    MissionAck,
    MissionCount,
    MissionItemFloat,
    MissionItemInt,
    MissionRequestInt,
    MissionRequestList,
)
from mission_io.protocol.exchange import OPENING, Address, Exchange, Timing
from mission_io.protocol.round_trip import Patience
from mission_io.protocol.table import Row, Table, staying
from mission_io.wire import item_from_message


class DownloadState(Enum):
    """Where a download is."""

    LISTING = "asked how many items there are"
    FETCHING = "asking for one item after the other"
    BACKING_OFF = "the vehicle was busy; the list is asked for again later"
    DONE = "every item is here"
    REFUSED = "the vehicle refused"
    VEHICLE_CANCELLED = "the vehicle cancelled"
    CANCELLED = "this side cancelled"
    SILENT = "the vehicle fell silent"


class DownloadEvent(Enum):
    """What can happen to a download."""

    COUNT = "the number of items"
    COUNT_ZERO = "the list is empty"
    COUNT_CHANGED = "another number of items than before"
    ITEM = "an item that was asked for"
    ITEM_LAST = "an item that was asked for, and none is missing now"
    ITEM_STRAY = "an item that was not asked for: a duplicate or a late one"
    ACK_ACCEPTED = "an acknowledgement, left over from before"
    ACK_BUSY = "busy, or the list changed meanwhile"
    ACK_SEQUENCE = "out of sequence"
    ACK_REFUSED = "a result that says what is wrong"
    ACK_CANCELLED = "the vehicle gave up"
    RESEND = "silence: say it again"
    STALL = "long silence: begin anew"
    GIVE_UP = "silence for good"
    RETRY = "waited long enough for a busy vehicle"
    EXHAUSTED = "busy for too long"
    CANCEL = "this side wants to stop"


_S, _E = DownloadState, DownloadEvent

DOWNLOAD_TABLE: Table[DownloadState, DownloadEvent] = Table(
    [
        Row(_S.LISTING, _E.COUNT, _S.FETCHING, "begin"),
        Row(_S.LISTING, _E.COUNT_ZERO, _S.DONE, "finish"),
        Row(_S.LISTING, _E.ACK_BUSY, _S.BACKING_OFF, "note_busy"),
        Row(_S.LISTING, _E.ACK_REFUSED, _S.REFUSED),
        Row(_S.LISTING, _E.RESEND, _S.LISTING, "resend_list"),
        Row(_S.LISTING, _E.GIVE_UP, _S.SILENT),
        *staying([_S.LISTING], [_E.ITEM_STRAY, _E.ACK_ACCEPTED, _E.ACK_SEQUENCE, _E.ACK_CANCELLED]),
        #
        Row(_S.FETCHING, _E.ITEM, _S.FETCHING, "store"),
        Row(_S.FETCHING, _E.ITEM_LAST, _S.DONE, "store_last"),
        # One of the two counts is a leftover of an earlier download: ask again which is true.
        Row(_S.FETCHING, _E.COUNT_ZERO, _S.LISTING, "begin_anew"),
        Row(_S.FETCHING, _E.COUNT_CHANGED, _S.LISTING, "begin_anew"),
        Row(_S.FETCHING, _E.ACK_BUSY, _S.BACKING_OFF, "note_busy"),
        Row(_S.FETCHING, _E.ACK_REFUSED, _S.REFUSED),
        Row(_S.FETCHING, _E.ACK_CANCELLED, _S.VEHICLE_CANCELLED),
        Row(_S.FETCHING, _E.RESEND, _S.FETCHING, "resend_requests"),
        Row(_S.FETCHING, _E.STALL, _S.LISTING, "begin_anew"),
        *staying([_S.FETCHING], [_E.COUNT, _E.ITEM_STRAY, _E.ACK_ACCEPTED, _E.ACK_SEQUENCE]),
        #
        Row(_S.BACKING_OFF, _E.COUNT, _S.FETCHING, "begin"),
        Row(_S.BACKING_OFF, _E.COUNT_ZERO, _S.DONE, "finish"),
        Row(_S.BACKING_OFF, _E.ACK_REFUSED, _S.REFUSED),
        Row(_S.BACKING_OFF, _E.RETRY, _S.LISTING, "begin_anew"),
        Row(_S.BACKING_OFF, _E.EXHAUSTED, _S.REFUSED),
        *staying([_S.BACKING_OFF], [_E.ITEM_STRAY, _E.ACK_ACCEPTED, _E.ACK_BUSY, _E.ACK_SEQUENCE, _E.ACK_CANCELLED]),
        #
        *(Row(state, _E.CANCEL, _S.CANCELLED, "send_cancel") for state in (_S.LISTING, _S.FETCHING, _S.BACKING_OFF)),
    ]
)
"""Every transition of a download. A finished download listens to nothing."""

DOWNLOAD_ENDS = frozenset({_S.DONE, _S.REFUSED, _S.VEHICLE_CANCELLED, _S.CANCELLED, _S.SILENT})

_THANKS_ON_A_BAD_LINK = 3

_ACK_EVENTS: dict[int, DownloadEvent] = {
    MissionResult.ACCEPTED: _E.ACK_ACCEPTED,
    MissionResult.ERROR: _E.ACK_BUSY,
    MissionResult.NO_SPACE: _E.ACK_BUSY,
    MissionResult.DENIED: _E.ACK_BUSY,
    MissionResult.INVALID_SEQUENCE: _E.ACK_SEQUENCE,
    MissionResult.OPERATION_CANCELLED: _E.ACK_CANCELLED,
}


class Download(Exchange[DownloadState, DownloadEvent]):
    """One download of the list ``mission_type``.

    Args:
        any_order: Whether the vehicle serves items in any order; only then is one asked for before its turn.
    """

    table: ClassVar = DOWNLOAD_TABLE

    def __init__(
        self,
        *,
        mission_type: MissionType,
        local: Address,
        vehicle: Address,
        now: float,
        timing: Timing | None = None,
        patience: Patience | None = None,
        any_order: bool = False,
    ) -> None:
        super().__init__(
            DownloadState.LISTING,
            mission_type=mission_type,
            local=local,
            vehicle=vehicle,
            timing=timing,
            patience=patience,
            now=now,
        )
        self._any_order = any_order
        self._count: int | None = None
        self._announced = 0
        self._arrived: dict[int, MissionItemInt | MissionItemFloat] = {}
        self._latest: MissionItemInt | MissionItemFloat | None = None
        self._missing = 0  # the first item that is not here
        self._asked_to = 0  # the items before this one were asked for
        self._send_list(now)

    @property
    def finished(self) -> bool:
        """Whether the download is over; ``state`` says how."""
        return self.state in DOWNLOAD_ENDS

    @property
    def count(self) -> int | None:
        """How many items there are; None before the vehicle said so."""
        return self._count

    @property
    def received_count(self) -> int:
        """How many items are here, for progress."""
        return len(self._arrived)

    def items(self) -> tuple[MissionItem, ...]:
        """The items as they are on the wire.

        Raises:
            FormatError: an item in a frame that mission_io does not know.
        """
        return tuple(item_from_message(self._arrived[seq]) for seq in range(len(self._arrived)))

    def cancel(self, now: float) -> None:
        """Stop and tell the vehicle. No effect on a finished download."""
        if not self.finished:
            self._step(DownloadEvent.CANCEL, now)

    def _event_of(self, message: Message, now: float) -> DownloadEvent | None:
        del now
        if isinstance(message, MissionCount):
            self._announced = message.count
            if message.count == 0:
                return DownloadEvent.COUNT_ZERO
            fetching = self.state is DownloadState.FETCHING
            return DownloadEvent.COUNT_CHANGED if fetching and message.count != self._count else DownloadEvent.COUNT
        if isinstance(message, MissionItemInt | MissionItemFloat):
            fetching = self.state is DownloadState.FETCHING
            if not fetching or message.seq in self._arrived or message.seq >= self._asked_to:
                return DownloadEvent.ITEM_STRAY
            self._latest = message
            return DownloadEvent.ITEM_LAST if len(self._arrived) + 1 == self._count else DownloadEvent.ITEM
        if isinstance(message, MissionAck):
            return _ACK_EVENTS.get(message.result, DownloadEvent.ACK_REFUSED)
        return None

    def _deadlines(self) -> list[tuple[float, DownloadEvent]]:
        timing = self.timing
        if self.state is DownloadState.LISTING:
            return [
                (self._last_heard + timing.give_up_s, DownloadEvent.GIVE_UP),
                (self._resend_at(), DownloadEvent.RESEND),
            ]
        if self.state is DownloadState.FETCHING:
            return [
                (self._last_heard + timing.stall_s, DownloadEvent.STALL),
                (self._resend_at(), DownloadEvent.RESEND),
            ]
        return [
            (self._busy_until(), DownloadEvent.EXHAUSTED),
            (self._waiting_since + timing.busy_retry_s, DownloadEvent.RETRY),
        ]

    def _actions(self) -> Mapping[str, Callable[[float], None]]:
        return {
            "begin": self._begin,
            "finish": self._finish,
            "store": self._store,
            "store_last": self._store_last,
            "resend_requests": self._resend_requests,
            "resend_list": self._resend_list,
            "begin_anew": self._begin_anew,
            "note_busy": self._note_busy,
            "send_cancel": self._send_cancel,
        }

    def _send_list(self, now: float) -> None:
        to = self.vehicle
        self._send(MissionRequestList(to.system_id, to.component_id, self.mission_type), now, question=OPENING)

    def _resend_list(self, now: float) -> None:
        self._count_silence()
        self._send_list(now)

    def _begin_anew(self, now: float) -> None:
        self._departures.clear()
        self._send_list(now)

    def _begin(self, now: float) -> None:
        self._answered(OPENING, now)
        self._busy_since = None
        self._count = self._announced
        self._arrived = {}
        self._missing = self._asked_to = 0
        self._ask_ahead(now)

    def _keep_latest(self, now: float) -> None:
        if self._latest is None:
            return
        self._arrived[self._latest.seq] = self._latest
        while self._missing in self._arrived:
            self._missing += 1
        self._answered(self._latest.seq, now)

    def _store(self, now: float) -> None:
        self._keep_latest(now)
        self._ask_ahead(now)

    def _store_last(self, now: float) -> None:
        self._keep_latest(now)
        self._send_thanks(now)

    def _window_end(self) -> int:
        ahead = self._ahead if self._any_order else 0
        return min(self._missing + 1 + ahead, self._count or 0)

    def _ask_ahead(self, now: float) -> None:
        """Ask for what of the first missing item and those ahead of their turn was not asked for yet."""
        for seq in range(max(self._missing, self._asked_to), self._window_end()):
            self._ask(seq, now)

    def _ask(self, seq: int, now: float) -> None:
        self._asked_to = max(self._asked_to, seq + 1)
        to = self.vehicle
        self._send(MissionRequestInt(to.system_id, to.component_id, seq, self.mission_type), now, question=seq)

    def _resend_requests(self, now: float) -> None:
        self._count_silence()
        for seq in range(self._missing, self._asked_to):
            if seq not in self._arrived:
                self._ask(seq, now)

    def _finish(self, now: float) -> None:
        self._answered(OPENING, now)
        self._count = 0
        self._arrived = {}
        self._send_thanks(now)

    def _send_thanks(self, now: float) -> None:
        """Nobody answers it, and without it PX4 takes no upload for 5 s: on a link that loses things it is said thrice."""
        for _ in range(_THANKS_ON_A_BAD_LINK if self.silences else 1):
            self._send_ack(MissionResult.ACCEPTED, now)

    def _send_cancel(self, now: float) -> None:
        self._send_ack(MissionResult.OPERATION_CANCELLED, now)

    def _send_ack(self, result: MissionResult, now: float) -> None:
        self._send(MissionAck(self.vehicle.system_id, self.vehicle.component_id, result, self.mission_type), now)

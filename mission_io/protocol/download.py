"""Downloading a list from a vehicle, as a state machine: request the list, then each item, then acknowledge.

Where the vehicle serves items in any order, the next one is requested before the last one has arrived. PX4 aborts a
download whose requests skip one, so a lost datagram would begin it anew: there the next one is requested early only while
nothing was lost, and on a link so short that beginning anew costs little.
"""

from enum import Enum
from typing import ClassVar, Unpack

from mission_io.autopilots.mission_lists import refuse_impossible
from mission_io.model.enums import MissionResult
from mission_io.model.items import MissionItem
from mission_io.protocol.exchange import OPENING, Exchange, ExchangeOptions
from mission_io.protocol.tables import Row, Table, staying
from mission_io.protocol.timing import TRANSFERS
from mission_io.wire import messages as m
from mission_io.wire.messages import item_from_message


class DownloadState(Enum):
    """State of a download."""

    LISTING = "the client requested the number of items"
    FETCHING = "the client requests the items"
    BACKING_OFF = "the vehicle was busy, and the list is requested again later"
    DONE = "the client has all items"
    REFUSED = "the vehicle refused"
    VEHICLE_CANCELLED = "the vehicle cancelled the transfer"
    CANCELLED = "the client cancelled the transfer"
    SILENT = "the vehicle stopped answering"
    CHANGING = "the vehicle repeatedly changes the number of items"
    STUCK = "the vehicle answers but makes no progress"


class DownloadEvent(Enum):
    """Events of a download."""

    COUNT = "the number of items"
    COUNT_ZERO = "the list is empty"
    COUNT_CHANGED = "another number of items than before"
    COUNT_UNSTABLE = "the same, too often"
    ITEM = "a requested item"
    ITEM_LAST = "a requested item, and none is missing now"
    ITEM_STRAY = "an item that was not requested: a duplicate or a late one"
    ACK_ACCEPTED = "an acknowledgement, left over from before"
    ACK_BUSY = "busy, or the list changed meanwhile"
    ACK_SEQUENCE = "out of sequence"
    ACK_REFUSED = "a result that says what is wrong"
    ACK_CANCELLED = "the vehicle gave up"
    RESEND = "silence: say it again"
    STALL = "long silence: begin anew"
    NO_PROGRESS = "for long no more items than there were"
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
        *staying(_S.LISTING, _E.ITEM_STRAY, _E.ACK_ACCEPTED, _E.ACK_SEQUENCE, _E.ACK_CANCELLED),
        #
        Row(_S.FETCHING, _E.ITEM, _S.FETCHING, "store"),
        Row(_S.FETCHING, _E.ITEM_LAST, _S.DONE, "store_last"),
        # One of the two counts belongs to an earlier download: request it again.
        Row(_S.FETCHING, _E.COUNT_CHANGED, _S.LISTING, "begin_anew"),
        Row(_S.FETCHING, _E.COUNT_UNSTABLE, _S.CHANGING, "send_cancel"),
        Row(_S.FETCHING, _E.ACK_BUSY, _S.BACKING_OFF, "note_broken_off"),
        Row(_S.FETCHING, _E.ACK_REFUSED, _S.REFUSED),
        Row(_S.FETCHING, _E.ACK_CANCELLED, _S.VEHICLE_CANCELLED),
        Row(_S.FETCHING, _E.RESEND, _S.FETCHING, "resend_requests"),
        Row(_S.FETCHING, _E.STALL, _S.LISTING, "begin_anew"),
        *staying(_S.FETCHING, _E.COUNT, _E.ITEM_STRAY, _E.ACK_ACCEPTED, _E.ACK_SEQUENCE),
        #
        Row(_S.BACKING_OFF, _E.COUNT, _S.FETCHING, "begin"),
        Row(_S.BACKING_OFF, _E.COUNT_ZERO, _S.DONE, "finish"),
        Row(_S.BACKING_OFF, _E.ACK_REFUSED, _S.REFUSED),
        Row(_S.BACKING_OFF, _E.RETRY, _S.LISTING, "ask_anew"),
        Row(_S.BACKING_OFF, _E.EXHAUSTED, _S.REFUSED),
        *staying(_S.BACKING_OFF, _E.ITEM_STRAY, _E.ACK_ACCEPTED, _E.ACK_BUSY, _E.ACK_SEQUENCE, _E.ACK_CANCELLED),
        #
        *(Row(state, _E.CANCEL, _S.CANCELLED, "send_cancel") for state in (_S.LISTING, _S.FETCHING, _S.BACKING_OFF)),
        *(Row(state, _E.NO_PROGRESS, _S.STUCK, "send_cancel") for state in (_S.LISTING, _S.FETCHING)),
    ]
)
"""Every transition of a download. A finished download ignores everything."""


_ACK_EVENTS: dict[int, DownloadEvent] = {
    MissionResult.ACCEPTED: _E.ACK_ACCEPTED,
    MissionResult.ERROR: _E.ACK_BUSY,
    MissionResult.NO_SPACE: _E.ACK_BUSY,
    MissionResult.DENIED: _E.ACK_BUSY,
    MissionResult.INVALID_SEQUENCE: _E.ACK_SEQUENCE,
    MissionResult.OPERATION_CANCELLED: _E.ACK_CANCELLED,
}


class Download(Exchange[DownloadState, DownloadEvent]):
    """One download of the list ``mission_type``."""

    table: ClassVar = DOWNLOAD_TABLE

    def __init__(
        self,
        *,
        # whether the vehicle serves items in any order; then one is requested ahead of its turn
        any_order: bool = False,
        # whether it serves requests that wait for their turn, and aborts when one of them is missing
        in_order: bool = False,
        **options: Unpack[ExchangeOptions],
    ) -> None:
        super().__init__(DownloadState.LISTING, **options)
        self._any_order, self._in_order = any_order, in_order
        self._retry_s = self.timing.busy_retry_s
        self._count: int | None = None
        self._announced = 0
        self._arrived: dict[int, m.MissionItemInt | m.MissionItemFloat] = {}
        self._latest: m.MissionItemInt | m.MissionItemFloat | None = None
        self._missing = 0  # the first missing item
        self._requested_to = 0  # the items before this one were requested
        self._list_sent_at = options["now"]
        self._count_changes = 0
        self._error_at = -1  # the item that an error came instead of
        self._errors_there = 0
        self._send_list(options["now"])

    @property
    def count(self) -> int | None:
        """Number of items; None before the vehicle has announced it."""
        return self._count

    @property
    def received_count(self) -> int:
        """Number of items received, for progress."""
        return len(self._arrived)

    def items(self) -> tuple[MissionItem, ...]:
        """The items as they are on the wire.

        Raises:
            FormatError: an item in a frame that mission_io does not know, or at a position that is none.
        """
        items = tuple(item_from_message(self._arrived[seq]) for seq in range(len(self._arrived)))
        refuse_impossible(items, self.mission_type)
        return items

    def cancel(self, now: float) -> None:
        """Stop and tell the vehicle. No effect on a finished download."""
        if not self.finished:
            self._step(DownloadEvent.CANCEL, now)

    def _event_of(self, message: m.Message, now: float) -> DownloadEvent | None:
        del now
        if isinstance(message, m.MissionCount):
            self.list_id = message.opaque_id
            return self._count_event(message.count)
        if isinstance(message, m.MissionItemInt | m.MissionItemFloat):
            fetching = self.state is DownloadState.FETCHING
            if not fetching or message.seq in self._arrived or message.seq >= self._requested_to:
                return DownloadEvent.ITEM_STRAY
            self._latest = message
            return DownloadEvent.ITEM_LAST if len(self._arrived) + 1 == self._count else DownloadEvent.ITEM
        if isinstance(message, m.MissionAck):
            event = _ACK_EVENTS.get(message.result, DownloadEvent.ACK_REFUSED)
            breaks_off = event is DownloadEvent.ACK_BUSY and self.state is DownloadState.FETCHING
            return DownloadEvent.ACK_REFUSED if breaks_off and self._is_last_error() else event
        return None

    def _count_event(self, count: int) -> DownloadEvent:
        if self.state is DownloadState.FETCHING:
            if count == self._count:
                return DownloadEvent.COUNT
            self._count_changes += 1
            last = self._count_changes > TRANSFERS.count_changes or self.restarts >= TRANSFERS.restarts
            return DownloadEvent.COUNT_UNSTABLE if last else DownloadEvent.COUNT_CHANGED
        self._announced = count
        return DownloadEvent.COUNT if count else DownloadEvent.COUNT_ZERO

    def _is_last_error(self) -> bool:
        """Whether an error in place of the first missing item ends the download; counts those in a row."""
        self._errors_there = self._errors_there + 1 if self._missing == self._error_at else 1
        self._error_at = self._missing
        return self._errors_there >= TRANSFERS.errors_at_an_item or self.restarts >= TRANSFERS.restarts

    def _deadlines(self) -> list[tuple[float, DownloadEvent]]:
        stuck = (self._stuck_at(), DownloadEvent.NO_PROGRESS)
        if self.state is DownloadState.LISTING:
            return [
                stuck,
                (self._silent_at(), DownloadEvent.GIVE_UP),
                (self._resend_at(), DownloadEvent.RESEND),
            ]
        if self.state is DownloadState.FETCHING:
            return [
                stuck,
                (self._stalled_at(), DownloadEvent.STALL),
                (self._resend_at(), DownloadEvent.RESEND),
            ]
        return [
            (self._busy_until(), DownloadEvent.EXHAUSTED),
            (self._waiting_since + self._retry_s, DownloadEvent.RETRY),
        ]

    def _event_when_due(self, event: DownloadEvent) -> DownloadEvent:
        if event is DownloadEvent.RESEND and self.state is DownloadState.FETCHING and self._requested_early():
            event = DownloadEvent.STALL  # after any loss the vehicle aborts at the next request
        too_often = event is DownloadEvent.STALL and self.restarts >= TRANSFERS.restarts
        return DownloadEvent.NO_PROGRESS if too_often else event

    def _send_list(self, now: float) -> None:
        self._list_sent_at = now
        self._send(m.MissionRequestList(*self.vehicle, self.mission_type), now, question=OPENING)

    def _resend_list(self, now: float) -> None:
        self._count_silence()
        self._send_list(now)

    def _begin_anew(self, now: float) -> None:
        self._note_restart(now)
        self._departures.clear()
        round_trip = self.retry_limits.round_trip
        if round_trip is not None and now - self._list_sent_at < round_trip.smoothed_s:
            return  # an answer to the last request may be under way; after a silence the next one follows
        self._send_list(now)

    def _ask_anew(self, now: float) -> None:
        self._departures.clear()
        self._retry_s = self.timing.busy_retry_s
        self._send_list(now)

    def _note_broken_off(self, now: float) -> None:
        if self._requested_early():
            self._retry_s = self.timing.resend_shortest_s  # not busy: something was lost during an early request
        self._note_restart(now)
        self._note_busy(now)

    def _begin(self, now: float) -> None:
        self._answered(OPENING, now)
        self._got_to(0, now)
        self._count = self._announced
        self._arrived = {}
        self._missing = self._requested_to = 0
        self._ask_ahead(now)

    def _keep_latest(self, now: float) -> None:
        if self._latest is None:
            return
        self._arrived[self._latest.seq] = self._latest
        while self._missing in self._arrived:
            self._missing += 1
        self._answered(self._latest.seq, now)
        self._got_to(len(self._arrived), now)

    def _store(self, now: float) -> None:
        self._keep_latest(now)
        self._ask_ahead(now)

    def _store_last(self, now: float) -> None:
        self._keep_latest(now)
        self._send_thanks(now)

    def _window_end(self) -> int:
        ahead = self._ahead if self._any_order or (self._in_order and self._loses_nothing()) else 0
        return min(self._missing + 1 + ahead, self._count or 0)

    def _requested_early(self) -> bool:
        """Whether a request is on its way that the vehicle takes only after the one before it."""
        return self._in_order and self._requested_to > self._missing + 1

    def _loses_nothing(self) -> bool:
        """Whether nothing was lost so far, and beginning anew would be cheap."""
        round_trip = self.retry_limits.round_trip
        if self.silences or self.restarts or self._missing < TRANSFERS.proven_items or round_trip is None:
            return False
        return (self._count or 0) * round_trip.smoothed_s <= TRANSFERS.cheap_restart_s

    def _ask_ahead(self, now: float) -> None:
        """Request the first missing item and those ahead of their turn, unless requested already."""
        for seq in range(max(self._missing, self._requested_to), self._window_end()):
            self._ask(seq, now)

    def _ask(self, seq: int, now: float) -> None:
        self._requested_to = max(self._requested_to, seq + 1)
        self._send(m.MissionRequestInt(*self.vehicle, seq, self.mission_type), now, question=seq)

    def _resend_requests(self, now: float) -> None:
        self._count_silence()
        for seq in range(self._missing, self._requested_to):
            if seq not in self._arrived:
                self._ask(seq, now)

    def _finish(self, now: float) -> None:
        self._answered(OPENING, now)
        self._count = 0
        self._arrived = {}
        self._send_thanks(now)

    def _send_thanks(self, now: float) -> None:
        """Send the final ACK: PX4 answers none, and refuses uploads for 5 s without it. A lossy link gets three."""
        for _ in range(TRANSFERS.thanks_on_a_bad_link if self.silences else 1):
            self._send_result(MissionResult.ACCEPTED, now)

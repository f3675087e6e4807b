"""The transition tables of the mission protocol: the vehicle's side, and the client's side of an upload.

A table lists states, events and every transition. The state machines look transitions up in it, and the documentation is
drawn from it.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Generic, TypeVar

from mission_io.errors import MissionIoError

StateT = TypeVar("StateT", bound=Enum)
EventT = TypeVar("EventT", bound=Enum)


class MissingRowError(MissionIoError):
    """A transition table lacks a row for an event: a bug in this package, not a fault of the peer."""


@dataclass(frozen=True, slots=True)
class Row(Generic[StateT, EventT]):
    """In ``state``, ``event`` triggers ``action`` (empty: none) and leads to ``next_state``."""

    state: StateT
    event: EventT
    next_state: StateT
    action: str = ""


class Table(Generic[StateT, EventT]):
    """Rows by state and event. Legal events without effect, such as duplicates, have rows too."""

    def __init__(self, rows: Iterable[Row[StateT, EventT]]) -> None:
        self.rows = tuple(rows)
        self._rows = {(row.state, row.event): row for row in self.rows}
        self._states = {row.state for row in self.rows}

    def row(self, state: StateT, event: EventT) -> Row[StateT, EventT]:
        """The row for an event in a state. Raises MissingRowError: the table has none."""
        try:
            return self._rows[state, event]
        except KeyError:
            raise MissingRowError(f"no transition for {event.name} in {state.name}") from None

    def is_end(self, state: StateT) -> bool:
        """Whether no event has an effect in a state."""
        return state not in self._states


def staying(state: StateT, *events: EventT, action: str = "") -> list[Row[StateT, EventT]]:
    """Rows for events after which the state is the same."""
    return [Row(state, event, state, action) for event in events]


class ServerState(Enum):
    """State of the vehicle's mission protocol."""

    IDLE = "no transfer"
    RECEIVING = "an upload is in progress"
    SENDING = "a download is in progress and blocks uploads"


class ServerEvent(Enum):
    """Events of the vehicle's mission protocol."""

    COUNT = "an upload is announced"
    COUNT_ZERO = "an empty list is announced"
    COUNT_REFUSED = (
        "what cannot be taken: an upload too long, too early or of an unknown list; all lists emptied at once"
    )
    COUNT_LATE = "the upload that is going on is announced again, and this autopilot does not start over"
    COUNT_OTHER = "another ground station, another list, or a part of a list, during an upload"
    ITEM = "the requested item"
    ITEM_LAST = "the requested item, and the last"
    ITEM_BAD = "the requested item, which cannot be stored"
    ITEM_STRAY = "an item that was not requested"
    ITEM_AGAIN = "the last item of the upload that just ended, once more"
    ITEM_OTHER = "an item from another ground station, or for another list"
    LIST = "a list is requested"
    LIST_HELD = "a list is requested, and this autopilot takes no upload until it is acknowledged"
    LIST_OTHER = "the same, by another ground station or for another list while one is being fetched"
    REQUEST = "an item of a list is requested"
    REQUEST_UNKNOWN = "an item is requested that does not exist, or one that is not the next of the download"
    REQUEST_UNHEARD = "an item is requested outside of a download, and this autopilot wants one to be begun"
    CLEAR = "a list is to be emptied"
    CLEAR_OWN = "the list of the upload that is going on is to be emptied, by who uploads it"
    ACK = "the ground station has everything"
    ACK_CANCEL = "the ground station stops"
    REREQUEST = "silence during an upload: ask again"
    GIVE_UP = "silence during an upload for good"
    DOWNLOAD_OVER = "silence during a download for good"


_IDLE, _RECEIVING, _SENDING, _V = ServerState.IDLE, ServerState.RECEIVING, ServerState.SENDING, ServerEvent
SERVER_TABLE: Table[ServerState, ServerEvent] = Table(
    [
        Row(_IDLE, _V.COUNT, _RECEIVING, "begin"),
        Row(_IDLE, _V.COUNT_ZERO, _IDLE, "empty"),
        Row(_IDLE, _V.COUNT_REFUSED, _IDLE, "refuse"),
        Row(_IDLE, _V.ITEM_STRAY, _IDLE, "answer_idle_item"),
        Row(_IDLE, _V.ITEM_AGAIN, _IDLE, "accept_again"),
        Row(_IDLE, _V.LIST, _IDLE, "send_count"),
        Row(_IDLE, _V.LIST_HELD, _SENDING, "send_count"),
        Row(_IDLE, _V.REQUEST, _IDLE, "send_item"),
        Row(_IDLE, _V.REQUEST_UNKNOWN, _IDLE, "answer_error"),
        Row(_IDLE, _V.CLEAR, _IDLE, "clear"),
        *staying(_IDLE, _V.REQUEST_UNHEARD, _V.ACK, _V.ACK_CANCEL),
        #
        Row(_RECEIVING, _V.COUNT, _RECEIVING, "begin"),
        Row(_RECEIVING, _V.COUNT_ZERO, _IDLE, "empty"),
        Row(_RECEIVING, _V.COUNT_REFUSED, _RECEIVING, "refuse"),
        Row(_RECEIVING, _V.COUNT_LATE, _RECEIVING, "answer_error"),
        Row(_RECEIVING, _V.COUNT_OTHER, _RECEIVING, "answer_busy"),
        Row(_RECEIVING, _V.ITEM, _RECEIVING, "store"),
        Row(_RECEIVING, _V.ITEM_LAST, _IDLE, "store_last"),
        Row(_RECEIVING, _V.ITEM_BAD, _IDLE, "reject"),
        Row(_RECEIVING, _V.ITEM_STRAY, _RECEIVING, "answer_wrong_sequence"),
        Row(_RECEIVING, _V.ITEM_OTHER, _RECEIVING, "answer_other_item"),
        *staying(_RECEIVING, _V.LIST, _V.LIST_HELD, _V.REQUEST, _V.REQUEST_UNKNOWN, action="answer_busy_request"),
        Row(_RECEIVING, _V.CLEAR, _RECEIVING, "answer_busy_clear"),
        Row(_RECEIVING, _V.CLEAR_OWN, _IDLE, "empty"),
        Row(_RECEIVING, _V.ACK_CANCEL, _IDLE, "abandon"),
        Row(_RECEIVING, _V.REREQUEST, _RECEIVING, "ask"),
        Row(_RECEIVING, _V.GIVE_UP, _IDLE, "give_up"),
        *staying(_RECEIVING, _V.ACK),
        #
        *staying(_SENDING, _V.COUNT, _V.COUNT_ZERO, action="answer_busy"),
        Row(_SENDING, _V.COUNT_REFUSED, _SENDING, "refuse"),
        *staying(_SENDING, _V.ITEM_STRAY, _V.ITEM_AGAIN, action="answer_idle_item"),
        Row(_SENDING, _V.LIST_HELD, _SENDING, "send_count"),
        Row(_SENDING, _V.REQUEST, _SENDING, "send_item"),
        Row(_SENDING, _V.REQUEST_UNKNOWN, _IDLE, "answer_error"),
        Row(_SENDING, _V.CLEAR, _SENDING, "answer_busy_clear"),
        *(Row(_SENDING, event, _IDLE) for event in (_V.ACK, _V.ACK_CANCEL, _V.DOWNLOAD_OVER)),
        *staying(_SENDING, _V.REQUEST_UNHEARD, _V.LIST_OTHER),
    ]
)
"""Every transition of the vehicle's side."""


class UploadState(Enum):
    """State of an upload."""

    ANNOUNCED = "COUNT was sent, and no item was requested yet"
    SERVING = "the vehicle requests items"
    CONFIRMING = "all items were sent, and the client waits for the final acknowledgement"
    ACKED_EARLY = "an acknowledgement arrived too early and may belong to an earlier transfer"
    DOUBTING = "an ERROR arrived that may only answer a duplicate"
    RECHECKING = "an ERROR arrived after all items were sent, but the vehicle may have the list"
    BACKING_OFF = "the vehicle was busy, and COUNT is sent again later"
    CANCELLING = "the client is cancelling the upload"
    ACCEPTED = "the vehicle accepted the list"
    UNCONFIRMED = "all items were sent, but the final answer is missing or unclear"
    REFUSED = "the vehicle refused"
    VEHICLE_CANCELLED = "the vehicle cancelled the transfer"
    CANCELLED = "the client cancelled the transfer"
    SILENT = "the vehicle stopped answering"
    ACCEPTED_EARLY = "the vehicle accepted the list before it had requested every item"
    STUCK = "the vehicle answers but makes no progress"


class UploadEvent(Enum):
    """Events of an upload."""

    REQUEST = "an item is requested"
    REQUEST_LAST = "an item is requested, and with it the last one goes out"
    REQUEST_CROSSED = "an item is requested again that is on its way already, or too often"
    REQUEST_UNKNOWN = "an item is requested that does not exist"
    ACK_ACCEPTED = "acknowledged"
    ACK_EARLY = "acknowledged although no item was requested, and not for the first time"
    ACK_EMPTIED = "acknowledged, and the list is empty"
    ACK_BUSY = "no space, or denied: busy or just booted"
    ACK_SEQUENCE = "an item came out of sequence: it was there already, or one before it is missing"
    ACK_ERROR = "the result without a reason"
    ACK_REFUSED = "a result that says what is wrong"
    ACK_GAVE_UP = "the vehicle gave up, as after a long silence: begin anew"
    ACK_CANCELLED = "the vehicle gave up, and beginning anew did not help"
    RESEND = "silence: say it again"
    RESEND_LAST = "silence: say it again, and with it the last item goes out"
    STALL = "long silence: begin anew"
    NO_PROGRESS = "for long no new item was requested"
    GIVE_UP = "silence for good"
    RETRY = "waited long enough for a busy vehicle"
    EXHAUSTED = "busy for too long"
    DOUBT_OVER = "no sign that the transfer goes on"
    DOUBT_CONFIRMED = "the same, and beginning anew did not help"
    LINGER_OVER = "the answer was repeated often enough"
    CANCEL = "this side wants to stop"


_S, _E = UploadState, UploadEvent
_UploadRow = Row[UploadState, UploadEvent]
_IN_PROGRESS = (_S.SERVING, _S.ACKED_EARLY, _S.CONFIRMING, _S.RECHECKING, _S.DOUBTING)
_LIVE = (_S.ANNOUNCED, *_IN_PROGRESS, _S.BACKING_OFF)
_STRAY_ACKS = (_E.ACK_ACCEPTED, _E.ACK_SEQUENCE, _E.ACK_CANCELLED)
_ALL_ACKS = (*_STRAY_ACKS, _E.ACK_EMPTIED, _E.ACK_BUSY, _E.ACK_ERROR, _E.ACK_REFUSED)


def _each(states: Iterable[UploadState], event: UploadEvent, then: UploadState, action: str = "") -> list[_UploadRow]:
    """Rows of an event that has the same effect in several states."""
    return [Row(state, event, then, action) for state in states]


UPLOAD_TABLE: Table[UploadState, UploadEvent] = Table(
    [
        # A request goes on with the upload; once every item was sent it waits for the answer.
        *_each(
            (_S.ANNOUNCED, _S.SERVING, _S.ACKED_EARLY, _S.DOUBTING, _S.BACKING_OFF),
            _E.REQUEST,
            _S.SERVING,
            "send_items",
        ),
        *_each((_S.CONFIRMING, _S.RECHECKING), _E.REQUEST, _S.CONFIRMING, "send_items"),
        *_each(_LIVE, _E.REQUEST_LAST, _S.CONFIRMING, "send_items"),
        *_each((_S.ANNOUNCED, *_IN_PROGRESS), _E.ACK_BUSY, _S.BACKING_OFF, "note_busy"),
        *_each(_LIVE, _E.ACK_REFUSED, _S.REFUSED),
        *_each(_IN_PROGRESS, _E.ACK_GAVE_UP, _S.ANNOUNCED, "restart"),
        *_each(_IN_PROGRESS, _E.ACK_CANCELLED, _S.VEHICLE_CANCELLED),
        *_each((_S.ANNOUNCED, _S.SERVING, _S.CONFIRMING), _E.NO_PROGRESS, _S.STUCK, "send_cancel"),
        *_each(_LIVE, _E.CANCEL, _S.CANCELLING, "send_cancel"),
        *(
            row
            for state in _IN_PROGRESS
            for row in staying(state, _E.REQUEST_CROSSED, _E.REQUEST_UNKNOWN, _E.ACK_SEQUENCE)
        ),
        #
        Row(_S.ANNOUNCED, _E.ACK_EMPTIED, _S.ACCEPTED),
        # PX4 reports "busy with another ground station" as ERROR.
        Row(_S.ANNOUNCED, _E.ACK_ERROR, _S.BACKING_OFF, "note_busy"),
        Row(_S.ANNOUNCED, _E.RESEND, _S.ANNOUNCED, "resend_count"),
        Row(_S.ANNOUNCED, _E.GIVE_UP, _S.SILENT),
        Row(_S.ANNOUNCED, _E.ACK_EARLY, _S.ACCEPTED_EARLY, "send_cancel"),
        # Leftovers of an earlier transfer: its acknowledgement, its requests, the vehicle giving it up.
        *staying(_S.ANNOUNCED, _E.REQUEST_UNKNOWN, *_STRAY_ACKS),
        #
        # PX4 answers a late duplicate of COUNT so, and goes on with the transfer.
        Row(_S.SERVING, _E.ACK_ERROR, _S.DOUBTING),
        Row(_S.SERVING, _E.RESEND, _S.SERVING, "resend_items"),
        Row(_S.SERVING, _E.RESEND_LAST, _S.CONFIRMING, "resend_items"),
        Row(_S.SERVING, _E.STALL, _S.ANNOUNCED, "begin_anew"),
        # It may belong to an earlier transfer; then this one goes on.
        Row(_S.SERVING, _E.ACK_ACCEPTED, _S.ACKED_EARLY),
        #
        Row(_S.ACKED_EARLY, _E.ACK_ACCEPTED, _S.ACCEPTED_EARLY, "send_cancel"),
        # Sent although it may be the last: an acknowledgement is no proof here any more.
        *staying(_S.ACKED_EARLY, _E.RESEND, _E.RESEND_LAST, action="resend_items"),
        Row(_S.ACKED_EARLY, _E.DOUBT_OVER, _S.ACCEPTED_EARLY, "send_cancel"),
        *staying(_S.ACKED_EARLY, _E.ACK_ERROR),
        #
        Row(_S.CONFIRMING, _E.ACK_ACCEPTED, _S.ACCEPTED),
        # Autopilots answer an item so when they have the whole list already and their acknowledgement was lost.
        Row(_S.CONFIRMING, _E.ACK_ERROR, _S.RECHECKING),
        *staying(_S.CONFIRMING, _E.RESEND, _E.RESEND_LAST, action="resend_items"),
        Row(_S.CONFIRMING, _E.STALL, _S.UNCONFIRMED),
        #
        # PX4 answers the last item but one with ERROR and the last with ACCEPTED, once it has them.
        Row(_S.RECHECKING, _E.ACK_ACCEPTED, _S.ACCEPTED),
        Row(_S.RECHECKING, _E.DOUBT_OVER, _S.UNCONFIRMED),
        *staying(_S.RECHECKING, _E.ACK_ERROR),
        #
        Row(_S.DOUBTING, _E.RESEND, _S.DOUBTING, "resend_items"),
        Row(_S.DOUBTING, _E.RESEND_LAST, _S.RECHECKING, "resend_items"),
        # The vehicle may have given up, and the message that said so was lost.
        Row(_S.DOUBTING, _E.DOUBT_OVER, _S.ANNOUNCED, "restart"),
        Row(_S.DOUBTING, _E.DOUBT_CONFIRMED, _S.REFUSED),
        *staying(_S.DOUBTING, _E.ACK_ACCEPTED, _E.ACK_ERROR),
        #
        Row(_S.BACKING_OFF, _E.ACK_EMPTIED, _S.ACCEPTED),
        Row(_S.BACKING_OFF, _E.RETRY, _S.ANNOUNCED, "ask_anew"),
        Row(_S.BACKING_OFF, _E.EXHAUSTED, _S.REFUSED),
        *staying(_S.BACKING_OFF, _E.REQUEST_CROSSED, _E.REQUEST_UNKNOWN, _E.ACK_BUSY, _E.ACK_ERROR, *_STRAY_ACKS),
        #
        *staying(_S.CANCELLING, _E.REQUEST, _E.REQUEST_LAST, _E.REQUEST_UNKNOWN, action="send_cancel"),
        *(Row(_S.CANCELLING, event, _S.CANCELLED) for event in (*_ALL_ACKS, _E.LINGER_OVER)),
        *staying(_S.CANCELLING, _E.CANCEL, _E.REQUEST_CROSSED),
    ]
)
"""Every transition of an upload. A finished upload ignores everything."""

"""Sending a list to a vehicle, as a state machine.

The vehicle asks for the items one by one; the client answers, and when nothing comes it sends again what the vehicle
waits for: the COUNT, or the item that was asked for last. Duplicates and late messages are ordinary rows of the table.
"""

from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from typing import ClassVar

from mission_io.enums import MissionResult
from mission_io.errors import MisuseError
from mission_io.items import MissionItem, MissionType
from mission_io.messages import Message, MissionAck, MissionCount, MissionRequest, MissionRequestInt
from mission_io.protocol.exchange import Address, Exchange, Timing
from mission_io.protocol.table import Row, Table, staying
from mission_io.wire import message_from_item


class UploadState(Enum):
    """Where an upload is."""

    ANNOUNCED = "COUNT sent, no item asked for yet"
    SERVING = "items are being asked for"
    CONFIRMING = "the last item was asked for; the final acknowledgement is awaited"
    DOUBTING = "an ERROR came that may only answer a duplicate"
    BACKING_OFF = "the vehicle was busy; COUNT goes out again later"
    CANCELLING = "the vehicle is being told that the upload is off"
    ACCEPTED = "the vehicle took the list"
    UNCONFIRMED = "everything was sent, the final answer is missing or doubtful"
    REFUSED = "the vehicle refused"
    VEHICLE_CANCELLED = "the vehicle cancelled"
    CANCELLED = "this side cancelled"
    SILENT = "the vehicle fell silent"


class UploadEvent(Enum):
    """What can happen to an upload."""

    REQUEST = "an item other than the last is asked for"
    REQUEST_LAST = "the last item is asked for"
    REQUEST_UNKNOWN = "an item that does not exist is asked for"
    ACK_ACCEPTED = "acknowledged"
    ACK_EMPTIED = "acknowledged, and the list is empty"
    ACK_BUSY = "no space, or denied: busy or just booted"
    ACK_SEQUENCE = "an item came out of sequence"
    ACK_SEQUENCE_NEXT = "the item that was sent again is there already: its successor is waited for"
    ACK_SEQUENCE_LAST = "the same, and the successor is the last item"
    ACK_ERROR = "the result without a reason"
    ACK_REFUSED = "a result that says what is wrong"
    ACK_CANCELLED = "the vehicle gave up"
    RESEND = "silence: say it again"
    STALL = "long silence: begin anew"
    GIVE_UP = "silence for good"
    RETRY = "waited long enough for a busy vehicle"
    EXHAUSTED = "busy for too long"
    DOUBT_OVER = "no sign that the transfer goes on: begin anew"
    DOUBT_CONFIRMED = "the same, and beginning anew did not help"
    LINGER_OVER = "told it often enough"
    CANCEL = "this side wants to stop"


_S, _E = UploadState, UploadEvent
_ALL_ACKS = (
    _E.ACK_ACCEPTED,
    _E.ACK_EMPTIED,
    _E.ACK_BUSY,
    _E.ACK_SEQUENCE,
    _E.ACK_ERROR,
    _E.ACK_REFUSED,
    _E.ACK_CANCELLED,
)
_LIVE = (_S.ANNOUNCED, _S.SERVING, _S.CONFIRMING, _S.DOUBTING, _S.BACKING_OFF)

UPLOAD_TABLE: Table[UploadState, UploadEvent] = Table(
    [
        Row(_S.ANNOUNCED, _E.REQUEST, _S.SERVING, "send_item"),
        Row(_S.ANNOUNCED, _E.REQUEST_LAST, _S.CONFIRMING, "send_item"),
        Row(_S.ANNOUNCED, _E.ACK_EMPTIED, _S.ACCEPTED),
        Row(_S.ANNOUNCED, _E.ACK_BUSY, _S.BACKING_OFF, "note_busy"),
        # PX4 has no other word for "busy with another ground station" than ERROR.
        Row(_S.ANNOUNCED, _E.ACK_ERROR, _S.BACKING_OFF, "note_busy"),
        Row(_S.ANNOUNCED, _E.ACK_REFUSED, _S.REFUSED),
        Row(_S.ANNOUNCED, _E.RESEND, _S.ANNOUNCED, "resend_count"),
        Row(_S.ANNOUNCED, _E.GIVE_UP, _S.SILENT),
        # Leftovers of an earlier transfer: its acknowledgement, its requests, the vehicle giving it up.
        *staying([_S.ANNOUNCED], [_E.REQUEST_UNKNOWN, _E.ACK_ACCEPTED, _E.ACK_SEQUENCE, _E.ACK_CANCELLED]),
        #
        Row(_S.SERVING, _E.REQUEST, _S.SERVING, "send_item"),
        Row(_S.SERVING, _E.REQUEST_LAST, _S.CONFIRMING, "send_item"),
        Row(_S.SERVING, _E.ACK_BUSY, _S.BACKING_OFF, "note_busy"),
        # PX4 answers a late duplicate of COUNT so, and goes on with the transfer.
        Row(_S.SERVING, _E.ACK_ERROR, _S.DOUBTING),
        # The request for the next item was lost; ArduPilot would only repeat it after a second.
        Row(_S.SERVING, _E.ACK_SEQUENCE_NEXT, _S.SERVING, "send_next"),
        Row(_S.SERVING, _E.ACK_SEQUENCE_LAST, _S.CONFIRMING, "send_next"),
        Row(_S.SERVING, _E.ACK_REFUSED, _S.REFUSED),
        Row(_S.SERVING, _E.ACK_CANCELLED, _S.VEHICLE_CANCELLED),
        Row(_S.SERVING, _E.RESEND, _S.SERVING, "resend_item"),
        Row(_S.SERVING, _E.STALL, _S.ANNOUNCED, "resend_count"),
        # An acknowledgement before the last item was asked for belongs to an earlier transfer.
        *staying([_S.SERVING], [_E.REQUEST_UNKNOWN, _E.ACK_ACCEPTED, _E.ACK_SEQUENCE]),
        #
        Row(_S.CONFIRMING, _E.REQUEST, _S.CONFIRMING, "send_item"),
        Row(_S.CONFIRMING, _E.REQUEST_LAST, _S.CONFIRMING, "send_item"),
        Row(_S.CONFIRMING, _E.ACK_ACCEPTED, _S.ACCEPTED),
        Row(_S.CONFIRMING, _E.ACK_BUSY, _S.BACKING_OFF, "note_busy"),
        # ArduPilot answers the last item so when it has it already and its acknowledgement was lost.
        Row(_S.CONFIRMING, _E.ACK_ERROR, _S.UNCONFIRMED),
        Row(_S.CONFIRMING, _E.ACK_REFUSED, _S.REFUSED),
        Row(_S.CONFIRMING, _E.ACK_CANCELLED, _S.VEHICLE_CANCELLED),
        Row(_S.CONFIRMING, _E.RESEND, _S.CONFIRMING, "resend_item"),
        Row(_S.CONFIRMING, _E.STALL, _S.UNCONFIRMED),
        *staying([_S.CONFIRMING], [_E.REQUEST_UNKNOWN, _E.ACK_SEQUENCE]),
        #
        Row(_S.DOUBTING, _E.REQUEST, _S.SERVING, "send_item"),
        Row(_S.DOUBTING, _E.REQUEST_LAST, _S.CONFIRMING, "send_item"),
        Row(_S.DOUBTING, _E.ACK_BUSY, _S.BACKING_OFF, "note_busy"),
        Row(_S.DOUBTING, _E.ACK_REFUSED, _S.REFUSED),
        Row(_S.DOUBTING, _E.ACK_CANCELLED, _S.VEHICLE_CANCELLED),
        # The vehicle may have given up, and the message that said so was lost.
        Row(_S.DOUBTING, _E.DOUBT_OVER, _S.ANNOUNCED, "restart"),
        Row(_S.DOUBTING, _E.DOUBT_CONFIRMED, _S.REFUSED),
        *staying([_S.DOUBTING], [_E.REQUEST_UNKNOWN, _E.ACK_ACCEPTED, _E.ACK_SEQUENCE, _E.ACK_ERROR]),
        #
        Row(_S.BACKING_OFF, _E.REQUEST, _S.SERVING, "send_item"),
        Row(_S.BACKING_OFF, _E.REQUEST_LAST, _S.CONFIRMING, "send_item"),
        Row(_S.BACKING_OFF, _E.ACK_EMPTIED, _S.ACCEPTED),
        Row(_S.BACKING_OFF, _E.ACK_REFUSED, _S.REFUSED),
        Row(_S.BACKING_OFF, _E.RETRY, _S.ANNOUNCED, "resend_count"),
        Row(_S.BACKING_OFF, _E.EXHAUSTED, _S.REFUSED),
        *staying(
            [_S.BACKING_OFF],
            [_E.REQUEST_UNKNOWN, _E.ACK_ACCEPTED, _E.ACK_BUSY, _E.ACK_SEQUENCE, _E.ACK_ERROR, _E.ACK_CANCELLED],
        ),
        #
        *(Row(state, _E.CANCEL, _S.CANCELLING, "send_cancel") for state in _LIVE),
        *(
            Row(_S.CANCELLING, event, _S.CANCELLING, "send_cancel")
            for event in (_E.REQUEST, _E.REQUEST_LAST, _E.REQUEST_UNKNOWN)
        ),
        *(Row(_S.CANCELLING, event, _S.CANCELLED) for event in _ALL_ACKS),
        Row(_S.CANCELLING, _E.LINGER_OVER, _S.CANCELLED),
        *staying([_S.CANCELLING], [_E.CANCEL]),
    ]
)
"""Every transition of an upload. A finished upload listens to nothing."""

UPLOAD_ENDS = frozenset({_S.ACCEPTED, _S.UNCONFIRMED, _S.REFUSED, _S.VEHICLE_CANCELLED, _S.CANCELLED, _S.SILENT})

_RESTARTS = 2

_ACK_EVENTS: dict[int, UploadEvent] = {
    MissionResult.NO_SPACE: _E.ACK_BUSY,
    MissionResult.DENIED: _E.ACK_BUSY,
    MissionResult.INVALID_SEQUENCE: _E.ACK_SEQUENCE,
    MissionResult.ERROR: _E.ACK_ERROR,
    MissionResult.OPERATION_CANCELLED: _E.ACK_CANCELLED,
}


class Upload(Exchange[UploadState, UploadEvent]):
    """One upload of ``items`` (as they go on the wire) as the list ``mission_type``.

    Attributes:
        sent_count: How many different items were asked for so far, for progress.
        last_result: The last MissionResult that the vehicle named; None when it named none.
    """

    table: ClassVar = UPLOAD_TABLE

    def __init__(
        self,
        items: Sequence[MissionItem],
        *,
        mission_type: MissionType,
        local: Address,
        vehicle: Address,
        now: float,
        timing: Timing | None = None,
    ) -> None:
        super().__init__(
            UploadState.ANNOUNCED,
            mission_type=mission_type,
            local=local,
            vehicle=vehicle,
            timing=timing if timing is not None else Timing(),
            now=now,
        )
        if len(items) > 65535:
            raise MisuseError(f"{len(items)} items; MAVLink counts them in 16 bits")
        self._items = [
            message_from_item(
                item,
                seq,
                mission_type=mission_type,
                target_system=vehicle.system_id,
                target_component=vehicle.component_id,
            )
            for seq, item in enumerate(items)
        ]
        self._awaited = 0  # the item that the vehicle waits for, as far as is known
        self._sent_again = False
        self._restarts = 0
        self.sent_count = 0
        self._send_count(now)

    @property
    def finished(self) -> bool:
        """Whether the upload is over; ``state`` says how."""
        return self.state in UPLOAD_ENDS

    def cancel(self, now: float) -> None:
        """Stop: the vehicle is told, and told again when it still asks. No effect on a finished upload."""
        if not self.finished:
            self._step(UploadEvent.CANCEL, now)

    def _event_of(self, message: Message) -> UploadEvent | None:
        if isinstance(message, MissionRequest | MissionRequestInt):
            if message.seq >= len(self._items):
                return UploadEvent.REQUEST_UNKNOWN
            self._awaited = message.seq
            return UploadEvent.REQUEST_LAST if message.seq == len(self._items) - 1 else UploadEvent.REQUEST
        if isinstance(message, MissionAck):
            if message.result == MissionResult.ACCEPTED:
                return UploadEvent.ACK_ACCEPTED if self._items else UploadEvent.ACK_EMPTIED
            event = _ACK_EVENTS.get(message.result, UploadEvent.ACK_REFUSED)
            # One step for each time an item was sent again, so that stray answers cannot run away with it.
            if event is UploadEvent.ACK_SEQUENCE and self.state is UploadState.SERVING and self._sent_again:
                left = len(self._items) - 1 - self._awaited
                return UploadEvent.ACK_SEQUENCE_NEXT if left > 1 else UploadEvent.ACK_SEQUENCE_LAST
            return event
        return None

    def _deadlines(self) -> list[tuple[float, UploadEvent]]:
        timing = self.timing
        if self.state is UploadState.ANNOUNCED:
            return [
                (self._last_heard + timing.give_up_s, UploadEvent.GIVE_UP),
                (self._resend_at(), UploadEvent.RESEND),
            ]
        if self.state in (UploadState.SERVING, UploadState.CONFIRMING):
            return [(self._last_heard + timing.stall_s, UploadEvent.STALL), (self._resend_at(), UploadEvent.RESEND)]
        if self.state is UploadState.DOUBTING:
            over = UploadEvent.DOUBT_OVER if self._restarts < _RESTARTS else UploadEvent.DOUBT_CONFIRMED
            return [(self._waiting_since + timing.doubt_s, over)]
        if self.state is UploadState.BACKING_OFF:
            return [
                (self._busy_until(), UploadEvent.EXHAUSTED),
                (self._waiting_since + timing.busy_retry_s, UploadEvent.RETRY),
            ]
        return [(self._waiting_since + timing.linger_s, UploadEvent.LINGER_OVER)]

    def _actions(self) -> Mapping[str, Callable[[float], None]]:
        return {
            "send_item": self._send_item,
            "send_next": self._send_next,
            "resend_item": self._resend_item,
            "restart": self._restart,
            "resend_count": self._resend_count,
            "note_busy": self._note_busy,
            "send_cancel": self._send_cancel,
        }

    def _send_count(self, now: float) -> None:
        to = self.vehicle
        self._send(MissionCount(to.system_id, to.component_id, len(self._items), self.mission_type), now)

    def _resend_count(self, now: float) -> None:
        self._count_silence()
        self._send_count(now)

    def _restart(self, now: float) -> None:
        self._restarts += 1
        self._send_count(now)

    def _send_item(self, now: float) -> None:
        self._busy_since = None
        self._sent_again = False
        self.sent_count = max(self.sent_count, self._awaited + 1)
        self._send(self._items[self._awaited], now)

    def _send_next(self, now: float) -> None:
        self._awaited += 1
        self._send_item(now)

    def _resend_item(self, now: float) -> None:
        self._count_silence()
        self._sent_again = True
        self._send(self._items[self._awaited], now)

    def _send_cancel(self, now: float) -> None:
        to = self.vehicle
        result = MissionResult.OPERATION_CANCELLED
        self._send(MissionAck(to.system_id, to.component_id, result, self.mission_type), now)

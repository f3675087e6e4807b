"""Uploading a list to a vehicle, as a state machine.

The vehicle requests the items one by one. The client answers with the item and, on a good link, also with the next one,
which the vehicle is about to request. On silence it repeats what the vehicle may be waiting for: the COUNT, or the item
requested last and its successor (whose request may have been lost). Duplicates and late messages are ordinary rows of the
table.
"""

from collections.abc import Sequence
from typing import ClassVar, Unpack

from mission_io.errors import MisuseError
from mission_io.model.enums import MissionResult
from mission_io.model.items import MissionItem
from mission_io.protocol.exchange import OPENING, Exchange, ExchangeOptions
from mission_io.protocol.tables import UPLOAD_TABLE, UploadEvent, UploadState
from mission_io.protocol.timing import TRANSFERS
from mission_io.wire import messages as m
from mission_io.wire.messages import message_to_send

REPEATS, REPEATS_PER_ITEM = 64, 4
"""Number of repeated requests answered at once; further ones wait for the next silence."""
_LARGEST_PART = 2**15
"""MISSION_WRITE_PARTIAL_LIST has signed numbers of 16 bits."""
_BEGUN = (
    UploadState.SERVING,
    UploadState.CONFIRMING,
    UploadState.ACKED_EARLY,
    UploadState.DOUBTING,
    UploadState.RECHECKING,
)

_ACK_EVENTS: dict[int, UploadEvent] = {
    MissionResult.NO_SPACE: UploadEvent.ACK_BUSY,
    MissionResult.DENIED: UploadEvent.ACK_BUSY,
    MissionResult.INVALID_SEQUENCE: UploadEvent.ACK_SEQUENCE,
    MissionResult.ERROR: UploadEvent.ACK_ERROR,
    MissionResult.OPERATION_CANCELLED: UploadEvent.ACK_CANCELLED,
}


class Upload(Exchange[UploadState, UploadEvent]):
    """One upload of ``items`` (as on the wire) as the list ``mission_type``, or over a part of it.

    Attributes:
        sent_count: Number of different items sent so far.
    """

    table: ClassVar = UPLOAD_TABLE

    def __init__(
        self,
        items: Sequence[MissionItem],  # what is sent
        *,
        # the number of the first item on the vehicle, where the others of its list stay as they are
        # (MISSION_WRITE_PARTIAL_LIST); None replaces the list
        first: int | None = None,
        **options: Unpack[ExchangeOptions],
    ) -> None:
        super().__init__(UploadState.ANNOUNCED, **options)
        if len(items) > 65535:
            raise MisuseError(f"the list has {len(items)} items, but MAVLink supports at most 65535")
        if first is not None and (first < 0 or not items or first + len(items) > _LARGEST_PART):
            raise MisuseError(
                f"a part must have at least one item and end at item {_LARGEST_PART - 1} or before, but this one has "
                f"{len(items)} items from {first}"
            )
        self._is_part, self._first = first is not None, first or 0
        self._items = [
            message_to_send(
                item,
                seq,
                mission_type=self.mission_type,
                target_system=self.vehicle.system_id,
                target_component=self.vehicle.component_id,
            )
            for seq, item in enumerate(items, self._first)
        ]
        self._requested = -1  # the item requested last
        self._furthest = -1  # the furthest item requested since COUNT
        self._sent_to = 0  # the items before this one went out since COUNT
        self._across = 0
        self._fresh_starts = 0
        self._repeats = self._cancels = 0
        self._acked_early_at: float | None = None
        self.sent_count = 0
        self._send_count(options["now"])

    @property
    def across_count(self) -> int:
        """Number of items the vehicle has received, judged by its requests; never decreases, for progress."""
        return len(self._items) if self.state is UploadState.ACCEPTED else self._across

    def cancel(self, now: float) -> None:
        """Stop and tell the vehicle, again if it still sends requests. No effect on a finished upload."""
        if not self.finished:
            self._step(UploadEvent.CANCEL, now)

    def _event_of(self, message: m.Message, now: float) -> UploadEvent | None:
        if isinstance(message, m.MissionRequest | m.MissionRequestInt):
            return self._request_event(message.seq - self._first, now)
        if isinstance(message, m.MissionAck):
            if message.result == MissionResult.ACCEPTED:
                self.list_id = message.opaque_id
                return self._accepted_event(now)
            event = _ACK_EVENTS.get(message.result, UploadEvent.ACK_REFUSED)
            begun = self.state in _BEGUN and self._fresh_starts < TRANSFERS.fresh_starts
            return UploadEvent.ACK_GAVE_UP if event is UploadEvent.ACK_CANCELLED and begun else event
        return None

    def _accepted_event(self, now: float) -> UploadEvent:
        if not self._items:
            return UploadEvent.ACK_EMPTIED
        if self.state is not UploadState.ANNOUNCED:
            return UploadEvent.ACK_ACCEPTED
        # The first ones may be left over from an earlier transfer, and come twice; later ones answer our COUNT.
        if self._acked_early_at is None:
            self._acked_early_at = now
        late = now - self._acked_early_at >= self.timing.recheck_s
        return UploadEvent.ACK_EARLY if late else UploadEvent.ACK_ACCEPTED

    def _request_event(self, seq: int, now: float) -> UploadEvent:
        if self.state is UploadState.CANCELLING:
            self._cancels += 1
            if self._cancels > TRANSFERS.cancels:
                return UploadEvent.REQUEST_CROSSED
        if not 0 <= seq < len(self._items):
            return UploadEvent.REQUEST_UNKNOWN
        going = self.state in (UploadState.SERVING, UploadState.CONFIRMING)
        if going and seq == self._requested and self._sent_within(1.0, seq, now):
            return UploadEvent.REQUEST_CROSSED
        backed_off, gets_on = self._backed_off, seq > self._furthest
        if seq > self._requested:
            self._answered(seq - 1, now)
            self._departures.forget_to(seq - 1)
        # An item that is requested again is still missing, or the vehicle starts over. And after a silence nothing is taken for
        # arrived that went out before its turn: a duplicate costs less than another silence.
        if seq <= self._requested or (self._ahead == 0 and not self._sent_within(0.5, seq, now)):
            self._sent_to = min(self._sent_to, seq)
        self._requested = seq
        self._furthest = max(self._furthest, seq)
        self._across = max(self._across, seq)
        self._got_to(seq, now)
        if not gets_on:
            self._backed_off = backed_off
            self._repeats += 1
            if self._repeats > REPEATS + REPEATS_PER_ITEM * len(self._items):
                return UploadEvent.REQUEST_CROSSED
        everything = max(self._sent_to, self._window_end()) == len(self._items)
        return UploadEvent.REQUEST_LAST if everything else UploadEvent.REQUEST

    def _window_end(self) -> int:
        """One past the last item sent along with the requested one."""
        return min(self._requested + 1 + self._ahead, len(self._items))

    def _doubtful(self) -> list[int]:
        """Items that may include the one the vehicle waits for after a silence.

        Those sent since the last request, and one more: the vehicle may have received them all, and only its requests were
        lost. A late request says less than the furthest one.
        """
        candidates: set[int] = set()
        for first in (self._requested, self._furthest):
            end = max(self._sent_to, first + 1) + 1
            candidates.update(range(first, min(end, first + TRANSFERS.doubtful_items, len(self._items))))
        return sorted(candidates)

    def _deadlines(self) -> list[tuple[float, UploadEvent]]:
        timing = self.timing
        if self.state is UploadState.ANNOUNCED:
            return [
                (self._stuck_at(), UploadEvent.NO_PROGRESS),
                (self._silent_at(), UploadEvent.GIVE_UP),
                (self._resend_at(), UploadEvent.RESEND),
            ]
        resend = (self._resend_at(), UploadEvent.RESEND)
        if self.state in (UploadState.SERVING, UploadState.CONFIRMING):
            return [
                (self._stuck_at(), UploadEvent.NO_PROGRESS),
                (self._stalled_at(), UploadEvent.STALL),
                resend,
            ]
        if self.state is UploadState.ACKED_EARLY:
            return [(self._waiting_since + timing.recheck_s, UploadEvent.DOUBT_OVER), resend]
        if self.state is UploadState.DOUBTING:
            over = (
                UploadEvent.DOUBT_OVER if self._fresh_starts < TRANSFERS.fresh_starts else UploadEvent.DOUBT_CONFIRMED
            )
            return [(self._waiting_since + timing.doubt_s, over), resend]
        if self.state is UploadState.RECHECKING:
            return [(self._waiting_since + timing.recheck_s, UploadEvent.DOUBT_OVER)]
        if self.state is UploadState.BACKING_OFF:
            return [
                (self._busy_until(), UploadEvent.EXHAUSTED),
                (self._waiting_since + timing.busy_retry_s, UploadEvent.RETRY),
            ]
        return [(self._waiting_since + timing.linger_s, UploadEvent.LINGER_OVER)]

    def _event_when_due(self, event: UploadEvent) -> UploadEvent:
        if event is UploadEvent.STALL and self.state is UploadState.SERVING and self.restarts >= TRANSFERS.restarts:
            return UploadEvent.NO_PROGRESS
        items_follow = event is UploadEvent.RESEND and self.state is not UploadState.ANNOUNCED
        last = items_follow and self._doubtful()[-1] == len(self._items) - 1
        return UploadEvent.RESEND_LAST if last else event

    def _send_count(self, now: float) -> None:
        end = self._first + len(self._items)
        opening: m.Message = m.MissionCount(*self.vehicle, end, self.mission_type)
        if self._is_part:
            opening = m.MissionWritePartialList(*self.vehicle, self._first, end - 1, self.mission_type)
        self._send(opening, now, question=OPENING)

    def _resend_count(self, now: float) -> None:
        self._count_silence()
        self._send_count(now)

    def _ask_anew(self, now: float) -> None:
        self._requested = self._furthest = -1
        self._sent_to = 0
        self._departures.clear()
        self._send_count(now)

    def _begin_anew(self, now: float) -> None:
        self._note_restart(now)
        self._ask_anew(now)

    def _restart(self, now: float) -> None:
        self._fresh_starts += 1
        self._begin_anew(now)

    def _send_items(self, now: float) -> None:
        """Answer a request with the item and those ahead of their turn, unless sent already."""
        for seq in range(max(self._requested, self._sent_to), self._window_end()):
            self._send_item(seq, now)

    def _resend_items(self, now: float) -> None:
        self._count_silence()
        for seq in self._doubtful():
            self._send_item(seq, now)

    def _send_item(self, seq: int, now: float) -> None:
        self._sent_to = max(self._sent_to, seq + 1)
        self.sent_count = max(self.sent_count, seq + 1)
        self._send(self._items[seq], now, question=seq)

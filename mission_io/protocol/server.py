"""The vehicle's side of the mission protocol: accepts uploads, serves downloads, clears; behaves as one autopilot does."""

import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from mission_io.autopilots.autopilot import Autopilot
from mission_io.autopilots.mission_lists import home_item, list_is_whole, refusal_of, stored_item
from mission_io.errors import MisuseError
from mission_io.model.enums import MissionResult
from mission_io.model.items import ALL_MISSION_TYPES, Command, GeoPoint, MissionItem, MissionType
from mission_io.protocol.tables import SERVER_TABLE, MissingRowError, ServerEvent, ServerState
from mission_io.wire import messages as m
from mission_io.wire.messages import Address, float_message, item_from_message, message_from_item

ChangeReason = Literal["uploaded", "upload failed", "cleared"]


@dataclass(frozen=True, slots=True)
class ListChanged:
    """One of the vehicle's lists has changed."""

    mission_type: MissionType  # the list
    items: tuple[MissionItem, ...]  # its items now, as on the wire (with home first where item 0 is home)
    # an upload was completed, one failed half-way (non-atomic autopilots), or the list was emptied
    reason: ChangeReason


@dataclass(slots=True)
class _Incoming:
    """An upload in progress."""

    station: Address  # who sends it
    mission_type: MissionType  # the list
    count: int  # how many items come
    heard_at: float  # when the last one came
    requested_at: float  # when the next one was last asked for
    first: int = 0  # its first item's number; others than 0 where only a part of a list comes
    base: tuple[MissionItem, ...] | None = None  # the list of which a part is written over; None for a whole list
    items: list[MissionItem] = field(default_factory=list)  # those that have come

    @property
    def next_seq(self) -> int:
        """The number of the next item."""
        return self.first + len(self.items)

    @property
    def last(self) -> int:
        """The number of the last item of the list that it makes; a fence does not grow by a part."""
        held = len(self.base or ())
        if self.base is not None and self.mission_type is MissionType.FENCE:
            return held - 1
        return max(held, self.first + self.count) - 1

    def over(self, held: tuple[MissionItem, ...]) -> tuple[MissionItem, ...]:
        """The list of the received items."""
        return (*held[: self.first], *self.items, *held[self.next_seq :])


def _refusal_in_list(
    message: m.MissionItemInt | m.MissionItemFloat, autopilot: Autopilot, incoming: _Incoming
) -> MissionResult | None:
    """The result with which ArduPilot refuses an item for its list; None when it accepts it.

    Source: MissionItemProtocol_Waypoints::append_item and replace_item, MissionItemProtocol_Fence::append_item.
    """
    if incoming.mission_type is MissionType.FENCE and message.seq > incoming.last:
        return MissionResult.INVALID_SEQUENCE
    jumps = autopilot.refuses_bad_numbers and message.command == Command.DO_JUMP
    return MissionResult.ERROR if jumps and not 1 <= message.params[0] <= incoming.last else None


class MissionServer:
    """The three lists of a vehicle, and the exchanges about them, one at a time.

    Call ``receive`` with every message, ``messages_to_send`` after that and whenever ``next_timer`` expires, and read
    ``events``. Messages outside the mission protocol have no effect.

    Args:
        autopilot: The autopilot to emulate.
        local: The vehicle's own address.
        booted_at: Time of power-up; some autopilots refuse uploads right after it.
        capacity: Largest number of items in a list; None uses the autopilot's own limit, or 65535.

    Attributes:
        home: The vehicle's home; an autopilot that keeps home in item 0 puts this one there. None leaves item 0 as it
            was uploaded.
    """

    table = SERVER_TABLE

    def __init__(
        self, autopilot: Autopilot, *, local: Address, booted_at: float = float("-inf"), capacity: int | None = None
    ) -> None:
        self.autopilot, self.local = autopilot, local
        self.state = ServerState.IDLE
        self.home: GeoPoint | None = None
        self._ready_at = booted_at + autopilot.boot_refusal_s
        limit = autopilot.item_limit if capacity is None else capacity
        self.capacity = limit if limit is not None else 65535
        self._lists: dict[MissionType, tuple[MissionItem, ...]] = dict.fromkeys(MissionType, ())
        self._incoming: _Incoming | None = None
        self._ended: tuple[Address, MissionType, int] | None = None
        self._partner: Address | None = None  # who began the last transfer
        self._served: tuple[Address, int] | None = None  # whose download of which list is going on
        self._served_at = 0.0
        self._serve_next = 0
        self._outbox: list[m.Message] = []
        self._events: list[ListChanged] = []
        # About the message at hand: who sent it, which list and which item or count it speaks of, and why it is refused.
        self._sender, self._about, self._number = local, 0, 0
        self._first: int | None = None
        self._item: MissionItem | None = None
        self._in_floats = False
        self._refusal = MissionResult.ERROR

    def items(self, mission_type: MissionType) -> tuple[MissionItem, ...]:
        """The vehicle's items, as on the wire."""
        held = self._lists[mission_type]
        if mission_type is MissionType.MISSION and held and self.home and self.autopilot.home_in_item_0:
            return (home_item(self.home), *held[1:])
        return held

    def set_items(self, mission_type: MissionType, items: Iterable[MissionItem], *, uploaded: bool = False) -> None:
        """Set a list from the vehicle's side, for instance home in item 0; report it if it was ``uploaded``.

        Raises:
            MisuseError: more items than it can hold.
        """
        items = tuple(items)
        if len(items) > self.capacity:
            raise MisuseError(f"the list has {len(items)} items, but this vehicle stores at most {self.capacity}")
        self._lists[mission_type] = items
        if uploaded:
            self._changed(mission_type, "uploaded")

    def events(self) -> list[ListChanged]:
        """The changes since the last call."""
        events, self._events = self._events, []
        return events

    def receive(self, received: m.Received, now: float) -> None:
        """Process a message that arrived at ``now``."""
        message = received.message
        if not m.is_for(message, system_id=self.local.system_id, component_id=self.local.component_id):
            return
        self._sender = received.sender
        self._about = getattr(message, "mission_type", 0)
        event = self._event_of(message, now)
        if event is not None:
            self._step(event, now)

    def messages_to_send(self, now: float) -> list[m.Message]:
        """The messages due by ``now``."""
        while True:
            deadlines = self._deadlines()
            if not deadlines or deadlines[0][0] > now:
                break
            self._step(deadlines[0][1], now)
        outbox, self._outbox = self._outbox, []
        return outbox

    def next_timer(self) -> float | None:
        """When to call ``messages_to_send`` again although nothing arrives; None for never."""
        deadlines = self._deadlines()
        return deadlines[0][0] if deadlines else None

    def _step(self, event: ServerEvent, now: float) -> None:
        row = self.table.row(self.state, event)
        self.state = row.next_state
        results = self._results_of(row.action)
        if results is None:
            getattr(self, f"_{row.action}")(now)
            return
        for result in results:
            if result is not None:
                self._answer(result)

    def _deadlines(self) -> list[tuple[float, ServerEvent]]:
        """Pending timed events, the nearest first."""
        if self._incoming is not None:
            give_up = self._incoming.heard_at + self.autopilot.give_up_s
            ask = self._incoming.requested_at + self.autopilot.rerequest_s
            return sorted([(give_up, ServerEvent.GIVE_UP), (ask, ServerEvent.REREQUEST)], key=lambda due: due[0])
        if self.state is ServerState.SENDING:
            return [(self._served_at + self.autopilot.download_blocks_s, ServerEvent.DOWNLOAD_OVER)]
        return []

    # What a message means.

    def _event_of(self, message: m.Message, now: float) -> ServerEvent | None:
        match message:
            case m.MissionCount():
                self._number, self._first = message.count, None
                return self._count_event(now)
            case m.MissionWritePartialList():
                return self._part_event(message, now)
            case m.MissionItemInt() | m.MissionItemFloat():
                return self._item_event(message)
            case m.MissionRequestList():
                if self._about not in self._lists:
                    return ServerEvent.REQUEST_UNKNOWN
                if not self.autopilot.download_blocks_s:
                    return ServerEvent.LIST
                return ServerEvent.LIST_OTHER if self._serves_another() else ServerEvent.LIST_HELD
            case m.MissionRequest() | m.MissionRequestInt():
                self._in_floats = self.autopilot.answers_in_floats and isinstance(message, m.MissionRequest)
                return self._request_event(message.seq)
            case m.MissionClearAll():
                if self._about == ALL_MISSION_TYPES and not self.autopilot.clears_all_at_once:
                    self._refusal = MissionResult.UNSUPPORTED
                    return ServerEvent.COUNT_REFUSED
                if self._is_incoming() and self.autopilot.count_restarts:
                    return ServerEvent.CLEAR_OWN
                known = self._about in (*self._lists, ALL_MISSION_TYPES)
                return ServerEvent.CLEAR if known else ServerEvent.REQUEST_UNKNOWN
            case m.MissionAck():
                stops = message.result in self.autopilot.stopped_by
                concerned = self._incoming is None or self._is_incoming()
                return ServerEvent.ACK_CANCEL if stops and concerned else ServerEvent.ACK
            case _:
                return None

    def _serves_another(self) -> bool:
        """Whether a download is going on that is not the message's, and not at its last item."""
        if self.state is not ServerState.SENDING or self._served is None or self._served == (self._sender, self._about):
            return False
        return self._serve_next < len(self.items(MissionType(self._served[1])))

    def _request_event(self, seq: int) -> ServerEvent:
        self._number = seq
        known = self._about in self._lists and seq < len(self._lists[MissionType(self._about)])
        if self._incoming is None and self.autopilot.download_blocks_s:
            if self.state is not ServerState.SENDING or self._served != (self._sender, self._about):
                return ServerEvent.REQUEST_UNHEARD
            known = known and seq in (self._serve_next, self._serve_next - 1)
        return ServerEvent.REQUEST if known else ServerEvent.REQUEST_UNKNOWN

    def _part_event(self, message: m.MissionWritePartialList, now: float) -> ServerEvent | None:
        """Whether a part of a list is taken (ArduPilot, MissionItemProtocol::handle_mission_write_partial_list)."""
        if not self.autopilot.takes_parts:
            return None
        if self._incoming is not None:  # also the part itself, announced again
            return ServerEvent.COUNT_OTHER
        self._number, self._first = message.end_index - message.start_index + 1, message.start_index
        event = self._count_event(now)
        held = len(self._lists[MissionType(self._about)]) if self._about in self._lists else 0
        if event in (ServerEvent.COUNT, ServerEvent.COUNT_ZERO) and not (
            0 <= message.start_index <= message.end_index <= held
        ):
            self._refusal = MissionResult.ERROR
            return ServerEvent.COUNT_REFUSED
        return event

    def _count_event(self, now: float) -> ServerEvent:
        if self._incoming is not None and not self._is_incoming():
            return ServerEvent.COUNT_OTHER
        if self._about not in self._lists:
            self._refusal = MissionResult.UNSUPPORTED
            return ServerEvent.COUNT_REFUSED
        if self._number + (self._first or 0) > self.capacity or now < self._ready_at:
            self._refusal = MissionResult.NO_SPACE
            return ServerEvent.COUNT_REFUSED
        if self._incoming is not None and not self.autopilot.count_restarts:
            if self._incoming.items:
                return ServerEvent.COUNT_LATE
            self._number = self._incoming.count  # counts as a repeated COUNT, with any number
        return ServerEvent.COUNT if self._number else ServerEvent.COUNT_ZERO

    def _item_event(self, message: m.MissionItemInt | m.MissionItemFloat) -> ServerEvent:
        incoming = self._incoming
        if incoming is None:
            again = self._ended == (self._sender, self._about, message.seq)
            return ServerEvent.ITEM_AGAIN if again else ServerEvent.ITEM_STRAY
        if not self._is_incoming():
            return ServerEvent.ITEM_OTHER
        if message.seq != incoming.next_seq:
            return ServerEvent.ITEM_STRAY
        refusal = refusal_of(message, self.autopilot) or _refusal_in_list(message, self.autopilot, incoming)
        if refusal is not None:
            self._refusal = refusal
            return ServerEvent.ITEM_BAD
        self._item = stored_item(item_from_message(message), self.autopilot)
        if len(incoming.items) + 1 < incoming.count:
            return ServerEvent.ITEM
        whole = incoming.base is not None or list_is_whole((*incoming.items, self._item), incoming.mission_type)
        if not whole:
            self._refusal = MissionResult.ERROR
            return ServerEvent.ITEM_BAD
        return ServerEvent.ITEM_LAST

    def _is_incoming(self) -> bool:
        """Whether sender and list of the message at hand are those of the upload that is going on."""
        incoming = self._incoming
        return incoming is not None and (incoming.station, incoming.mission_type) == (self._sender, self._about)

    # What the table's actions do: uploads.

    def _begin(self, now: float) -> None:
        mission_type = MissionType(self._about)
        self._ended, self._partner = None, self._sender
        base = None if self._first is None else self._lists[mission_type]
        self._incoming = _Incoming(self._sender, mission_type, self._number, now, now, self._first or 0, base)
        if base is None and mission_type not in self.autopilot.atomic:
            self._lists[mission_type] = self._lists[mission_type][: self._number]
        self._ask(now)

    def _ask(self, now: float) -> None:
        incoming = self._upload()
        incoming.requested_at = now
        kind = m.MissionRequest if self.autopilot.legacy_requests else m.MissionRequestInt
        self._outbox.append(kind(*incoming.station, incoming.next_seq, incoming.mission_type))

    def _store(self, now: float) -> None:
        self._take_item(now)
        self._ask(now)

    def _store_last(self, now: float) -> None:
        self._take_item(now)
        incoming = self._upload()
        self._incoming = None
        self._lists[incoming.mission_type] = incoming.over(incoming.base or ())
        if self.autopilot.acks_repeated_last_item:
            self._ended = (incoming.station, incoming.mission_type, incoming.next_seq - 1)
        self._changed(incoming.mission_type, "uploaded")
        self._answer(MissionResult.ACCEPTED)

    def _take_item(self, now: float) -> None:
        incoming = self._upload()
        if self._item is not None:
            incoming.items.append(self._item)
        incoming.heard_at = now
        if incoming.mission_type not in self.autopilot.atomic:
            self._lists[incoming.mission_type] = incoming.over(self._lists[incoming.mission_type])

    def _empty(self, now: float) -> None:
        self._incoming = None
        self._clear(now)

    def _clear(self, now: float) -> None:
        """Clear one list or all three."""
        del now
        types = tuple(MissionType) if self._about == ALL_MISSION_TYPES else (MissionType(self._about),)
        for mission_type in types:
            self._lists[mission_type] = ()
            self._changed(mission_type, "cleared")
        self._answer(MissionResult.ACCEPTED)

    def _reject(self, now: float) -> None:
        self._abandon(now)
        self._answer(self._refusal)

    def _give_up(self, now: float) -> None:
        incoming = self._upload()
        self._abandon(now)
        if self.autopilot.reports_give_up:
            self._send_ack(incoming.station, MissionResult.OPERATION_CANCELLED, incoming.mission_type)

    def _abandon(self, now: float) -> None:
        """Abort an upload; a non-atomic autopilot keeps what has arrived."""
        del now
        incoming = self._upload()
        self._incoming = None
        if incoming.mission_type not in self.autopilot.atomic:
            self._changed(incoming.mission_type, "upload failed")

    # What the table's actions do: downloads and answers.

    def _send_count(self, now: float) -> None:
        self._served, self._served_at, self._serve_next = (self._sender, self._about), now, 0
        self._partner = self._sender
        held, list_id = self.items(MissionType(self._about)), self.list_id(MissionType(self._about))
        self._outbox.append(m.MissionCount(*self._sender, len(held), self._about, list_id))

    def _send_item(self, now: float) -> None:
        self._served_at = now
        self._serve_next = max(self._serve_next, self._number + 1)
        to, about, seq = self._sender, MissionType(self._about), self._number
        item = self.items(about)[seq]
        message = message_from_item(
            item, seq, mission_type=about, target_system=to.system_id, target_component=to.component_id
        )
        if self._in_floats or not self.autopilot.returns_int_frames:
            message = replace(message, frame=int(item.frame))
        self._outbox.append(float_message(message) if self._in_floats else message)

    def _results_of(self, action: str) -> tuple[MissionResult | None, ...] | None:
        """The results of an action that only answers the message at hand; None for one that is a method."""
        autopilot = self.autopilot
        # whether an unrequested item of the message's sender is answered
        is_answered = autopilot.answers_strangers or self._sender == self._partner
        match action:
            case "":
                return ()
            case "accept_again":
                return (MissionResult.ACCEPTED,)
            case "refuse":
                return (self._refusal,)
            case "answer_error":
                return (MissionResult.ERROR,)
            case "answer_busy":
                return (autopilot.busy_result,)
            case "answer_busy_request":
                return (autopilot.busy_request_result,)
            case "answer_busy_clear":
                return autopilot.busy_clear_results
            case "answer_other_item":
                return (autopilot.busy_result if is_answered else None,)
            case "answer_idle_item":
                return (autopilot.idle_item_result if is_answered else None,)
            case "answer_wrong_sequence":
                return (autopilot.wrong_sequence_result,)
        return None

    def _answer(self, result: MissionResult) -> None:
        self._send_ack(self._sender, result, self._about)

    def _send_ack(self, to: Address, result: MissionResult, mission_type: int) -> None:
        accepted = result is MissionResult.ACCEPTED and mission_type in self._lists
        list_id = self.list_id(MissionType(mission_type)) if accepted else 0
        self._outbox.append(m.MissionAck(*to, result, mission_type, list_id))

    def list_id(self, mission_type: MissionType) -> int:
        """The id of a list, which changes with its content; 0 for an empty one, and where lists have none."""
        return id_of_items(self.items(mission_type)) if self.autopilot.has_list_ids else 0

    def _changed(self, mission_type: MissionType, reason: ChangeReason) -> None:
        self._events.append(ListChanged(mission_type, self.items(mission_type), reason))

    def _upload(self) -> _Incoming:
        if self._incoming is None:
            raise MissingRowError("an upload's action while no upload is active")
        return self._incoming


def id_of_items(items: Sequence[MissionItem]) -> int:
    """An id for a list: a checksum of its content, as PX4 has it; 0 for an empty list."""
    return zlib.crc32(repr(tuple(items)).encode()) if items else 0

"""A vehicle that misbehaves case by case, and keeps what the ground station does. No socket, no clock of its own.

It waits until a ground station begins something, takes the next open case about that, plays its trick, and judges when the
station has been silent for a while. What the station does besides, such as reading back, is served as it should be.
"""

import heapq
import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

from mission_io.autopilots.autopilot import PX4
from mission_io.conformance.case import ITEMS, PROTOCOL, REQUESTS, STATION, CaseResult, sample
from mission_io.conformance.client_case import ClientCase, HeardMessage, Kinds, Operation, Said, StationEvidence, Trick
from mission_io.model.enums import AutopilotId, CommandResult, MissionResult
from mission_io.model.items import Command, Frame, MissionType
from mission_io.protocol.server import MissionServer
from mission_io.wire import messages as m
from mission_io.wire.codec import Codec, message_id
from mission_io.wire.messages import Address

BY_THE_GUIDE: Final = replace(
    PX4,
    name="the guide",
    frames=frozenset(Frame),
    position_free_frames=frozenset(Frame),
    storage={},
    rerequest_s=STATION.item_resend_s,
    give_up_s=12.0,
    count_restarts=True,
    acks_repeated_last_item=False,
    download_blocks_s=0.0,
    answers_in_floats=False,
    stopped_by=frozenset(MissionResult) - {MissionResult.ACCEPTED},
)
"""The vehicle as the guide describes it, where no trick is played."""


CAPABILITIES: Final = (1 << 2) | (1 << 13) | (1 << 14) | (1 << 15)
"""It takes integers, MAVLink 2, fences and rally points."""

_CLIENT_KINDS: Final = (*PROTOCOL, m.MissionRequestList, m.MissionClearAll, m.MissionSetCurrent)


class FakeVehicle:
    """The vehicle, as a peer of a link: it takes datagrams and gives datagrams.

    Attributes:
        results: Of the cases that were judged.
    """

    def __init__(
        self,
        cases: Sequence[ClientCase],  # to be judged, each once
        *,
        autopilot: AutopilotId = AutopilotId.PX4,  # the autopilot that its heartbeats name
        judged: Callable[[CaseResult], None] | None = None,  # called with each result
        quiet_s: float = STATION.quiet_s,  # silence after which a ground station is done
        system_id: int = 1,  # its MAVLink system
    ) -> None:
        self.address = Address(system_id, 1)
        self.server = MissionServer(BY_THE_GUIDE, local=self.address)
        self.open = list(cases)
        self.results: list[CaseResult] = []
        self._autopilot, self._judged, self._quiet_s = autopilot, judged, quiet_s
        self._codecs: dict[Address, Codec] = {}
        self._waiting: list[tuple[float, int, Address, m.Message]] = []
        self._order = itertools.count()
        self._case: ClientCase | None = None
        self._trick = Trick()
        self._evidence: StationEvidence | None = None
        self._current = 0
        self._beat_at = 0.0
        for mission_type in MissionType:
            self.server.set_items(mission_type, sample(mission_type, 4))

    # The peer of a link.

    def receive_datagram(self, data: bytes, now: float) -> None:
        """Take a datagram that arrived at ``now``."""
        self._judge_if_over(now)
        for received in self._codec(self.address).decode(data):
            self._receive(received, now)
        self._collect(now)

    def datagrams_to_send(self, now: float) -> list[bytes]:
        """Datagrams that it sends at ``now``."""
        self._judge_if_over(now)
        self._collect(now)
        if now >= self._beat_at:
            self._beat_at = now + 1.0
            self._say(Said(m.Heartbeat(self._autopilot, 2, 0, 0, 3)), now)
            self._say(Said(self._mission_current()), now)
        sent = []
        while self._waiting and self._waiting[0][0] <= now:
            _, _, sender, message = heapq.heappop(self._waiting)
            sent.append(self._codec(sender).encode(message))
        return sent

    def next_timer(self) -> float:
        """Time of the next call without a message."""
        times = [self._beat_at]
        timer = self.server.next_timer()
        if timer is not None:
            times.append(timer)
        if self._waiting:
            times.append(self._waiting[0][0])
        if self._evidence is not None:
            times.append(self._over_at(self._evidence))
        return min(times)

    # Cases.

    @property
    def busy(self) -> bool:
        """Whether a case is going on."""
        return self._case is not None

    def told(self, succeeded: bool) -> None:
        """Take the ground station's report to its user about the current case."""
        if self._evidence is not None:
            self._evidence.reported_success = succeeded

    def _over_at(self, evidence: StationEvidence) -> float:
        last_s = evidence.heard[-1].at_s
        return min(last_s + self._quiet_s, evidence.began_s + STATION.longest_s)

    def _judge_if_over(self, now: float) -> None:
        evidence, case = self._evidence, self._case
        if evidence is None or case is None or now < self._over_at(evidence):
            return
        evidence.held = self.server.items(evidence.mission_type)
        evidence.unending = now >= evidence.began_s + STATION.longest_s
        verdict, seen = case.answered_by(evidence)
        result = CaseResult(case.name, verdict, seen, evidence.lasted_s)
        self.results.append(result)
        self.open.remove(case)
        self._case, self._evidence, self._trick = None, None, Trick()
        self._waiting.clear()
        self._announce(now)
        if self._judged is not None:
            self._judged(result)

    def _announce(self, now: float) -> None:
        """Announce the next expected operation to the user of the ground station."""
        text = f"{len(self.open)} cases left; {self.open[0].operation.value}" if self.open else "all cases are judged"
        self._say(Said(m.StatusText(6, text[:50])), now)

    def _begin(self, message: m.Message, station: Address, now: float) -> None:
        mission_type = getattr(message, "mission_type", 0)
        operations = _begun_by(message)
        if mission_type not in MissionType._value2member_map_:
            return
        for case in self.open:
            if case.mission_type in (None, mission_type) and case.operation in operations:
                t = MissionType(mission_type)
                if case.operation is not Operation.EMPTY or not self.server.items(t):
                    self.server.set_items(t, sample(t, 4))
                self._case, self._trick = case, case.trick()
                self._evidence = StationEvidence(case.operation, t, station, self.address, now, self.server.items(t))
                return

    # Messages.

    def _receive(self, received: m.Received, now: float) -> None:
        message = received.message
        sender = received.sender
        seq = _sets_current(message)
        requested = message  # a command that sets the current item is as good as the message
        if isinstance(message, m.CommandLong) and seq is not None:
            requested = m.MissionSetCurrent(message.target_system, message.target_component, seq)
        ours = m.is_for(message, system_id=self.address.system_id, component_id=self.address.component_id)
        if isinstance(requested, _CLIENT_KINDS):
            if self._case is None and ours:
                self._begin(message, sender, now)
            if self._evidence is not None and sender == self._evidence.station:
                self._evidence.heard.append(HeardMessage(now, requested))
        if not ours:
            return
        heard = not self._is_about_the_case(requested) or self._trick.hears(requested, now)
        if self._trick.forgets():
            self._forget_upload(now)
        if not heard:
            return
        self._set_current_or_command(message, sender, now)
        self.server.receive(received, now)

    def _set_current_or_command(self, message: m.Message, sender: Address, now: float) -> None:
        seq = _sets_current(message)
        if seq is not None and seq >= len(self.server.items(MissionType.MISSION)):
            self._say(Said(m.StatusText(3, f"there is no item {seq}")), now)
        elif seq is not None:
            self._current = seq
            self._say_all(self._trick.says(self._mission_current(), now), now)
        if not isinstance(message, m.CommandLong):
            return
        version = message.command == Command.REQUEST_AUTOPILOT_CAPABILITIES or (
            message.command == Command.REQUEST_MESSAGE and message.params[0] == message_id(m.AutopilotVersion)
        )
        result = CommandResult.ACCEPTED if version or seq is not None else CommandResult.UNSUPPORTED
        self._say(Said(m.CommandAck(message.command, result, 0, 0, *sender)), now)
        if version:
            self._say(Said(m.AutopilotVersion(CAPABILITIES, 0x01110000, 1)), now)

    def _mission_current(self) -> m.MissionCurrent:
        mission = MissionType.MISSION
        return m.MissionCurrent(self._current, len(self.server.items(mission)), mission_id=self.server.list_id(mission))

    def _is_about_the_case(self, message: m.Message) -> bool:
        evidence = self._evidence
        if evidence is None:
            return False
        if _sets_current(message) is not None:
            return evidence.operation is Operation.SET_CURRENT
        return isinstance(message, _KINDS[evidence.operation][0])

    def _collect(self, now: float) -> None:
        for message in self.server.messages_to_send(now):
            self._say_all(self._tricked(message, now), now)
        self.server.events()

    def _tricked(self, message: m.Message, now: float) -> Sequence[Said]:
        """Messages that answer a message of the server; after an error, the vehicle's side of the error too."""
        evidence = self._evidence
        if evidence is None or not isinstance(message, _KINDS[evidence.operation][1]):
            return [Said(message)]
        said = self._trick.says(message, now)
        own = [one.message for one in said if one.sender is None and isinstance(one.message, m.MissionAck)]
        ours = (evidence.station.system_id, evidence.mission_type)
        about = [got for got in own if (got.target_system, got.mission_type) == ours]
        if about and not isinstance(message, m.MissionAck):
            self._forget_upload(now)
        elif about and getattr(message, "result", 0) == MissionResult.ACCEPTED and about[-1].result:
            self.server.set_items(evidence.mission_type, evidence.old)
        return said

    def _forget_upload(self, now: float) -> None:
        """Be idle, with the list that was there before."""
        if self._evidence is not None:
            end = m.MissionAck(*self.address, MissionResult.OPERATION_CANCELLED, self._evidence.mission_type)
            self.server.receive(m.Received(end, *self._evidence.station), now)

    def _say_all(self, said: Sequence[Said], now: float) -> None:
        for one in said:
            self._say(one, now)

    def _say(self, said: Said, now: float) -> None:
        sender = said.sender if said.sender is not None else self.address
        heapq.heappush(self._waiting, (now + said.after_s, next(self._order), sender, said.message))
        if self._evidence is not None and sender == self.address and isinstance(said.message, PROTOCOL):
            self._evidence.said.append(HeardMessage(now + said.after_s, said.message))

    def _codec(self, sender: Address) -> Codec:
        if sender not in self._codecs:
            self._codecs[sender] = Codec(system_id=sender.system_id, component_id=sender.component_id)
        return self._codecs[sender]


_UPLOADING: Final = (m.MissionCount, *ITEMS, m.MissionAck)
_REQUESTING: Final = (*REQUESTS, m.MissionAck)
_DOWNLOAD: Final = ((m.MissionRequestList, *_REQUESTING), _UPLOADING)
_KINDS: Final[dict[Operation, tuple[Kinds, Kinds]]] = {
    Operation.UPLOAD: (_UPLOADING, _REQUESTING),
    Operation.EMPTY: (_UPLOADING, (m.MissionAck,)),
    Operation.CANCEL_UPLOAD: (_UPLOADING, _REQUESTING),
    Operation.DOWNLOAD: _DOWNLOAD,
    Operation.CANCEL_DOWNLOAD: _DOWNLOAD,
    Operation.CLEAR: ((m.MissionClearAll,), (m.MissionAck,)),
    Operation.SET_CURRENT: ((m.MissionSetCurrent,), (m.MissionCurrent,)),
}
"""What a trick of a case may not hear, and what it may change."""


def _begun_by(message: m.Message) -> tuple[Operation, ...]:
    """The operations that a message can begin."""
    if isinstance(message, m.MissionCount):
        return (Operation.UPLOAD, Operation.CANCEL_UPLOAD) if message.count else (Operation.EMPTY,)
    if isinstance(message, m.MissionRequestList):
        return (Operation.DOWNLOAD, Operation.CANCEL_DOWNLOAD)
    if isinstance(message, m.MissionClearAll):
        return (Operation.CLEAR,)
    return (Operation.SET_CURRENT,) if _sets_current(message) is not None else ()


def _sets_current(message: m.Message) -> int | None:
    """The item that a message makes the current one; None for other messages."""
    if isinstance(message, m.MissionSetCurrent):
        return message.seq
    if isinstance(message, m.CommandLong) and message.command == Command.DO_SET_MISSION_CURRENT:
        return int(message.params[0]) if 0.0 <= message.params[0] <= 65535.0 else None
    return None

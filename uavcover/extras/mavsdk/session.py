"""MAVSDK without sockets: it shares our link, its calls are answered later, its mission items become ours.

Mission items as MAVSDK's and as ours.

MAVSDK without sockets: it is given what arrives, says what is to be sent, and its calls are answered later.

A link that MAVSDK and our own listener share, so that the vehicle needs no second connection.
"""

import json
import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from queue import SimpleQueue
from typing import Any

import mavsdk
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkDirectResult, MavlinkMessage
from mavsdk.plugins.mission_raw import MissionItem as RawItem
from mavsdk.plugins.mission_raw import MissionRaw, MissionRawResult

from mission_io.autopilots.mission_lists import refuse_impossible
from mission_io.errors import MisuseError
from mission_io.links.datagrams import Link, WrappingLink
from mission_io.model.items import MissionItem, MissionType
from mission_io.wire.codec import frames_of
from mission_io.wire.messages import Address, MissionItemInt, item_from_message, message_to_send
from uavcover.errors import VehicleError


def raw_items(items: Sequence[MissionItem], mission_type: MissionType) -> list[Any]:
    """Items as MAVSDK uploads them: numbered from 0, the first one of a mission current.

    Raises:
        mission_io.errors.MisuseError: coordinates that are not finite or that do not fit 32 bits.
    """
    return [_raw_item(item, seq, mission_type) for seq, item in enumerate(items)]


def items_from_raw(raw: Sequence[Any], mission_type: MissionType) -> tuple[MissionItem, ...]:
    """Items as MAVSDK downloaded them.

    Raises:
        mission_io.errors.FormatError: a frame in which the coordinates mean nothing to mission_io.
    """
    return tuple(
        item_from_message(
            MissionItemInt(
                0,
                0,
                item.seq,
                item.frame,
                item.command,
                (item.param1, item.param2, item.param3, item.param4),
                item.x,
                item.y,
                item.z,
                current=item.current,
                autocontinue=item.autocontinue,
                mission_type=mission_type,
            )
        )
        for item in raw
    )


def _raw_item(item: MissionItem, seq: int, mission_type: MissionType) -> Any:
    message = message_to_send(item, seq, mission_type=mission_type, target_system=0, target_component=0)
    return RawItem(
        seq, message.frame, message.command, message.current, message.autocontinue, *message.params,
        message.x, message.y, message.z, int(mission_type),
    )  # fmt: skip


_log = logging.getLogger(__name__)
_LEVELS = {0: logging.DEBUG, 1: logging.DEBUG, 2: logging.INFO, 3: logging.INFO}
"""MAVSDK's levels: it warns and complains of every time-out, which is for us to judge."""


@dataclass(frozen=True, slots=True)
class Answer:
    """Result of one call."""

    result: str  # MAVSDK's name of the result, for instance ``SUCCESS`` or ``TIMEOUT``
    content: Any = None  # what it brought: raw items of a download, or the result number of a command


@dataclass(frozen=True, slots=True)
class Call:
    """A call that goes on in MAVSDK's threads."""

    _answers: "SimpleQueue[Answer]" = field(default_factory=SimpleQueue)

    def end(self, result: str, content: Any = None) -> None:
        """Called by MAVSDK's thread when it is over."""
        self._answers.put(Answer(result, content))

    def take_answer(self) -> Answer | None:
        """The answer, once; None while the call goes on."""
        return None if self._answers.empty() else self._answers.get()

    @property
    def over(self) -> bool:
        """Whether an answer is there that nothing has taken."""
        return not self._answers.empty()


class MavsdkSession:
    """One MAVSDK instance that speaks as ``local`` and sends its own heartbeats.

    Raises:
        VehicleError: MAVSDK does not begin.
    """

    def __init__(self, local: Address) -> None:
        mavsdk.log_subscribe(_log_line)
        self._local, self._vehicle = local, local
        self._outgoing: SimpleQueue[bytes] = SimpleQueue()
        self._dropped: list[Call] = []
        self._mavsdk = mavsdk.Mavsdk(mavsdk.Configuration.create_manual(*local, True))
        result = self._mavsdk.add_any_connection("raw://")
        if result != mavsdk.ConnectionResult.SUCCESS:
            self._mavsdk.destroy()
            raise VehicleError(f"MAVSDK could not start the mission: {result.name}")
        self._mavsdk.subscribe_raw_bytes_to_be_sent(self._outgoing.put)
        self._raw: Any = None
        self._direct: Any = None

    def close(self) -> None:
        """End it; closing twice is fine."""
        for part in (self._raw, self._direct, self._mavsdk):
            if part is not None:
                part.destroy()

    def receive(self, data: bytes) -> None:
        """Tell it what arrived."""
        self._mavsdk.pass_received_raw_bytes(data)

    def take_outgoing(self) -> Iterator[bytes]:
        """Messages that MAVSDK wants to send by now."""
        while not self._outgoing.empty():
            data = self._outgoing.get()
            self._dropped = [call for call in self._dropped if not call.over]
            if not self._dropped or _message_id(data) in _OF_NO_CALL:
                yield data

    def drop(self, call: Call) -> None:
        """Send nothing more of a call: MAVSDK cannot be stopped from sending a command again before it gives it up."""
        self._dropped.append(call)

    def has_found(self, vehicle: Address) -> bool:
        """Whether it knows the vehicle by now; the calls below are for that one."""
        if self._raw is not None and vehicle == self._vehicle:
            return True
        for system in self._mavsdk.get_systems():
            if system.get_system_id() == vehicle.system_id and system.has_autopilot():
                self._vehicle = vehicle
                self._raw, self._direct = MissionRaw(system), MavlinkDirect(system)
                return True
        return False

    def upload(self, mission_type: MissionType, items: Sequence[MissionItem]) -> Call:
        """Begin to send a list, which must not be empty: MAVSDK has no call for that."""
        call = Call()
        begin = {
            MissionType.MISSION: self._raw.upload_mission_async,
            MissionType.FENCE: self._raw.upload_geofence_async,
            MissionType.RALLY: self._raw.upload_rally_points_async,
        }[mission_type]
        begin(raw_items(items, mission_type), lambda result, _: call.end(result.name))
        return call

    def download(self, mission_type: MissionType) -> Call:
        """Begin to ask for a list."""
        call = Call()
        begin = {
            MissionType.MISSION: self._raw.download_mission_async,
            MissionType.FENCE: self._raw.download_geofence_async,
            MissionType.RALLY: self._raw.download_rallypoints_async,
        }[mission_type]
        begin(lambda result, items, _: call.end(result.name, items))
        return call

    def cancel(self, mission_type: MissionType) -> None:
        """Cancel a mission's transfer; MAVSDK has no call that cancels one of the others."""
        if mission_type is MissionType.MISSION:
            for cancel in (self._raw.cancel_mission_upload, self._raw.cancel_mission_download):
                try:
                    cancel()
                except mavsdk.MavsdkError as error:  # there was no such transfer
                    _log.debug("cancel: %s", error)

    def command(self, command: int, params: Sequence[float]) -> Call:
        """Begin to send a COMMAND_LONG with seven parameters; the answer's content is the number of the MAV_RESULT.

        Raises:
            MisuseError: a parameter that is not finite; MAVSDK takes messages as JSON, which has no such numbers.
        """
        if not all(math.isfinite(value) for value in params):
            raise MisuseError(f"command {command}: MAVSDK can send only finite parameters: {tuple(params)}")
        fields = {
            "target_system": self._vehicle.system_id, "target_component": self._vehicle.component_id,
            "command": command, "confirmation": 0,
            **{f"param{number}": float(value) for number, value in enumerate(params, start=1)},
        }  # fmt: skip
        call = Call()

        def end(result: Any, answer: Any, _: Any) -> None:
            accepted = result == MavlinkDirectResult.SUCCESS
            call.end(result.name, int(json.loads(answer.fields_json)["result"]) if accepted else None)

        message = MavlinkMessage(
            "COMMAND_LONG", self._local.system_id, self._local.component_id,
            self._vehicle.system_id, self._vehicle.component_id, json.dumps(fields),
        )  # fmt: skip
        self._direct.send_command_async(message, end)
        return call


def contents_of(answer: Answer, mission_type: MissionType) -> tuple[MissionItem, ...] | None:
    """The items of a download that has succeeded; None for one that has not.

    Raises:
        mission_io.errors.FormatError: as ``Client.download``.
    """
    if answer.result == MissionRawResult.NO_MISSION_AVAILABLE.name:
        return ()
    if answer.result != MissionRawResult.SUCCESS.name:
        return None
    items = items_from_raw(answer.content, mission_type)
    refuse_impossible(items, mission_type)
    return items


def _log_line(level: Any, text: str, file: str | None, line: int) -> bool:
    """Take a line of MAVSDK's, which it would print otherwise."""
    del file, line
    _log.log(_LEVELS.get(int(level), logging.INFO), "MAVSDK: %s", text)
    return True


_OF_NO_CALL = frozenset({0, 111})
"""HEARTBEAT and TIMESYNC."""


def _message_id(data: bytes) -> int:
    """The number of a datagram's message."""
    return int.from_bytes(data[7:10], "little") if data[0] == 0xFD else data[5]  # MAVLink 2


class TappedLink(WrappingLink):
    """A :class:`~mission_io.links.datagrams.Link` that tells MAVSDK what arrives, and sends what MAVSDK says while it listens.

    MAVSDK hears the vehicle's autopilot alone, from ``keep_to`` on: what a companion computer says with the same system id must
    answer none of its questions.
    """

    def __init__(self, link: Link, session: MavsdkSession) -> None:
        super().__init__(link)
        self._session = session
        self._vehicle: tuple[int, int] | None = None

    def keep_to(self, system_id: int, component_id: int) -> None:
        """Hear and speak to this sender's place only, and let MAVSDK hear this sender only."""
        super().keep_to(system_id, component_id)
        self._vehicle = (system_id, component_id)

    def let_go(self) -> None:
        """Hear all vehicles again; MAVSDK hears none until the vehicle is chosen."""
        super().let_go()
        self._vehicle = None

    def send(self, data: bytes) -> None:
        """Send one datagram of ours."""
        self._link.send(data)

    def receive(self, timeout_s: float) -> bytes | None:
        """The next datagram, which MAVSDK has then too, or None after ``timeout_s`` seconds."""
        deadline = self.clock.now() + timeout_s
        while True:
            for datagram in self._session.take_outgoing():
                self._link.send(datagram)
            left_s = deadline - self.clock.now()
            # longest delay of a message that MAVSDK wants to send
            data = self._link.receive(min(max(0.0, left_s), 0.002))
            if data is not None:
                self._session.receive(self._of_vehicle(data))
            if data is not None or left_s <= 0.0:
                return data

    def _of_vehicle(self, data: bytes) -> bytes:
        """The vehicle's own frames of a datagram."""
        frames = frames_of(data)
        return b"".join(frame.data for frame in frames if (frame.system_id, frame.component_id) == self._vehicle)

    def close(self) -> None:
        """End MAVSDK and close the link inside; closing twice is fine."""
        self._session.close()
        self._link.close()

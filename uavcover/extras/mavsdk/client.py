"""A client whose transfers and commands are MAVSDK's, behind the calls of our own client."""

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, NoReturn, TypeVar

from mission_io.client import commands
from mission_io.client.client import Client
from mission_io.client.connection import Progress, Stop
from mission_io.client.peers import VehicleInfo
from mission_io.errors import (
    CommandRefusedError,
    MisuseError,
    TransferCancelledError,
    TransferError,
    TransferInterrupted,
    TransferSilentError,
    VehicleHolds,
    VehicleSilentError,
    WaitCancelledError,
)
from mission_io.links.datagrams import Link
from mission_io.model.enums import CommandResult, MissionResult
from mission_io.model.items import Command, MissionItem, MissionType
from mission_io.wire import messages as m
from mission_io.wire.codec import message_id
from mission_io.wire.messages import Address
from mission_io.wire.signing import SigningKey
from uavcover.extras.mavsdk.session import Answer, Call, MavsdkSession, TappedLink, contents_of

MessageT = TypeVar("MessageT", bound=m.Message)
ResultT = TypeVar("ResultT")
Heard = Callable[[m.Received], None]

_log = logging.getLogger(__name__)

TRIES = 10
"""Number of tries of a transfer. MAVSDK gives one up after five silences of half a second, at 20 % loss most of them."""

_SILENT_S = 8.0
_ANSWER_S = 10.0
_BETWEEN_TRIES_S = 0.5
_LISTEN_S = 0.05
_FINAL_FROM_TRY: Final = {
    "INVALID_ARGUMENT": 1, "UNSUPPORTED": 1, "CURRENT_INVALID": 1, "MISSION_TYPE_NOT_CONSISTENT": 1, "TOO_MANY_MISSION_ITEMS": 5,
}  # fmt: skip
"""First try on which a result is believed. ArduPilot has no space for anything in its first two seconds."""
_FINAL_AT_FIRST: Final = frozenset({"DENIED", "ERROR"})
"""Results that are believed at once, but not after a try of ours that may still keep the vehicle busy."""
_NAMES: Final = {MissionType.MISSION: "mission", MissionType.FENCE: "fence", MissionType.RALLY: "rally points"}


@dataclass(frozen=True, slots=True)
class _Terms:
    """Messages for a transfer's errors."""

    doing: str
    holds: VehicleHolds
    advice: str


_UPLOAD = _Terms("upload", "unknown", "; use uavcover download to see its current content")
_DOWNLOAD = _Terms("download", "unchanged", "")


class MavsdkClient(Client):
    """A ground station like :class:`~mission_io.client.client.Client`, on the same link, by MAVSDK.

    MAVSDK sends the heartbeats, conducts uploads and downloads, and sends commands until they are answered. Ours are the
    comparison of what was read back, and the listening: the listener gets every message of the link. MAVSDK has no call for
    an empty list, for reading any parameter as a number, and for single messages: those go as our own.

    Args:
        link: carries the datagrams; ``close`` closes it.
        listener: called with every message that arrives, and the time in seconds.

    Raises:
        VehicleError: MAVSDK does not begin.
    """

    def __init__(
        self, link: Link, *, system_id: int = 255, listener: Callable[[m.Received, float], None] | None = None
    ) -> None:
        self._session = MavsdkSession(Address(system_id, 190))
        super().__init__(TappedLink(link, self._session), system_id=system_id, listener=listener)

    def sign_with(self, key: SigningKey, **_: object) -> NoReturn:
        """Refused: MAVSDK 4.1 does not sign."""
        del key
        raise MisuseError("MAVSDK's client does not support signing; use the native client with a signing key")

    def wait_for_vehicle(
        self, timeout_s: float = 10.0, *, system_id: int | None = None, component_id: int | None = None
    ) -> VehicleInfo:
        """Wait until we and MAVSDK have found a vehicle; errors as ``Client.wait_for_vehicle``."""
        deadline = self.clock.now() + timeout_s
        super().wait_for_vehicle(timeout_s, system_id=system_id, component_id=component_id)
        while not self._session.has_found(self.vehicle.address):
            if self.clock.now() >= deadline:
                raise VehicleSilentError(
                    f"MAVSDK did not find vehicle {self.vehicle.system_id} within {timeout_s:g} s; does it send heartbeats?"
                )
            self.next_messages(min(deadline, self.clock.now() + 0.1))
        return self.vehicle

    # Transfers.

    def upload(
        self,
        mission_type: MissionType,
        items: Sequence[MissionItem],
        *,
        progress: Progress | None = None,
        stop: Stop | None = None,
        in_flight: bool = False,
    ) -> None:
        """Replace one of the vehicle's lists; errors as ``Client.upload``, after up to ``TRIES`` tries.

        A success that MAVSDK tells without an acknowledgement of this list is none: it may have taken that of another one.
        """
        self._refuse_armed("upload", in_flight=in_flight)
        if not items:
            self.clear(mission_type, in_flight=in_flight)
            return
        accepted = False  # MAVSDK takes the acknowledgement of another list as that of this one
        across = _Across(len(items), progress)

        def hear(received: m.Received) -> None:
            nonlocal accepted
            match received.message:
                case m.MissionRequest() | m.MissionRequestInt() as request if request.mission_type == mission_type:
                    across.count(request.seq)
                case m.MissionAck(mission_type=kind, result=MissionResult.ACCEPTED) if kind == mission_type:
                    accepted = True

        self._transfer(
            mission_type,
            lambda: self._session.upload(mission_type, items),
            lambda answer: True if answer.result == "SUCCESS" and accepted else None,
            hear,
            stop,
            _UPLOAD,
        )
        across.count(len(items))

    def download(
        self, mission_type: MissionType, *, progress: Progress | None = None, stop: Stop | None = None
    ) -> tuple[MissionItem, ...]:
        """One of the vehicle's lists, as it is on the wire; errors as ``Client.download``, after up to ``TRIES`` tries."""
        across = _Across(0, progress)

        def hear(received: m.Received) -> None:
            match received.message:
                case m.MissionCount() as found if found.mission_type == mission_type:
                    across.total = found.count
                case m.MissionItemInt() as item if item.mission_type == mission_type:
                    across.count(item.seq + 1)

        return self._transfer(
            mission_type,
            lambda: self._session.download(mission_type),
            lambda answer: contents_of(answer, mission_type),
            hear,
            stop,
            _DOWNLOAD,
        )

    # Commands.

    def command(self, command: int, *params: float, timeout_s: float = _ANSWER_S) -> m.CommandAck:
        """Send a command until it is answered; errors as ``commands.send_command``."""
        return self._command(command, params, timeout_s, lambda _: None)

    def set_mode(self, custom_mode: int, *, timeout_s: float = _ANSWER_S) -> None:
        """Change the flight mode and see it in the heartbeat; errors as ``commands.set_mode``."""
        self.command(Command.DO_SET_MODE, *commands.mode_params(self.vehicle, custom_mode), timeout_s=timeout_s)
        commands.await_mode(self, custom_mode, timeout_s=timeout_s)

    def request_message_interval(
        self, kind: type[m.Message], interval_s: float, *, timeout_s: float = _ANSWER_S
    ) -> m.CommandAck:
        """Ask for a kind of message each ``interval_s`` seconds."""
        return self.command(
            Command.SET_MESSAGE_INTERVAL, float(message_id(kind)), interval_s * 1e6, timeout_s=timeout_s
        )

    def request_message(self, kind: type[MessageT], *, timeout_s: float = _ANSWER_S) -> MessageT:
        """Ask for one message of a kind and wait for it; errors as ``commands.request_message``."""
        found: list[MessageT] = []

        def hear(received: m.Received) -> None:
            if isinstance(received.message, kind):
                found.append(received.message)

        deadline = self.clock.now() + timeout_s
        while not found and self.clock.now() < deadline:
            left_s = deadline - self.clock.now()
            try:
                self._command(Command.REQUEST_MESSAGE, (float(message_id(kind)),), left_s, hear)
            except CommandRefusedError as error:
                raise VehicleSilentError(
                    f"vehicle {self.vehicle.system_id} sends no {kind.__name__}: {error}"
                ) from None
            again_at = min(deadline, self.clock.now() + _BETWEEN_TRIES_S)
            self._listen(hear, lambda: bool(found), again_at)
        if not found:
            raise VehicleSilentError(
                f"vehicle {self.vehicle.system_id} did not send a {kind.__name__} within {timeout_s:g} s"
            )
        return found[0]

    # How MAVSDK is driven.

    def _send_heartbeat(self) -> None:
        """MAVSDK sends its own, with our ids."""

    def _answer_time(self, question: m.TimeSync) -> None:
        """MAVSDK answers."""

    def _command(self, command: int, params: tuple[float, ...], timeout_s: float, hear: Heard) -> m.CommandAck:
        if len(params) > 7:
            raise MisuseError(f"command {commands.name_of(command)}: expected seven parameters, not {len(params)}")
        seven = (*params, *(0.0,) * (7 - len(params)))
        deadline = self.clock.now() + timeout_s
        while self.clock.now() < deadline:
            answer = self._await(self._session.command(command, seven), hear, deadline)
            if answer is None or answer.result == "TIMEOUT":
                continue
            if answer.result != "SUCCESS":
                raise MisuseError(f"MAVSDK did not send {commands.name_of(command)}: {answer.result}")
            ack = m.CommandAck(command, answer.content, target_system=self.local.system_id)
            if ack.result != CommandResult.ACCEPTED:
                raise commands.refusal(self.vehicle.system_id, ack)
            return ack
        raise VehicleSilentError(
            f"vehicle {self.vehicle.system_id} did not answer {commands.name_of(command)} within {timeout_s:g} s"
        )

    def _transfer(
        self,
        mission_type: MissionType,  # which list
        begin: Callable[[], Call],  # begins it
        outcome: Callable[[Answer], ResultT | None],  # what a call came to; None for one that did not succeed
        hear: Heard,  # looks at everything that arrives meanwhile
        stop: Stop | None,  # asked whether to cancel
        terms: _Terms,  # what an error says
    ) -> ResultT:
        """Begin a transfer until it succeeds, and see that the user can stop it."""
        doing, result = f"{terms.doing} of the {_NAMES[mission_type]} by MAVSDK: vehicle {self.vehicle.system_id}", ""
        for number in range(1, TRIES + 1):
            call = begin()
            try:
                answer = self._await(call, hear, math.inf, stop)
            except KeyboardInterrupt:
                self._cancel(call, mission_type)
                cancelled = TransferCancelledError(f"{doing}: cancelled", vehicle_holds=terms.holds)
                raise TransferInterrupted(cancelled) from None
            if answer is None:
                self._cancel(call, mission_type)
                raise TransferCancelledError(f"{doing}: cancelled", vehicle_holds=terms.holds)
            found = outcome(answer)
            if found is not None:
                return found
            result = answer.result
            _log.info("%s: %s in try %d", doing, result, number)
            if _is_final(result, number) or self.heartbeat_age_s > _SILENT_S:
                break
            # A vehicle that still waits for an earlier try of ours answers ERROR until it gives that up, after 5 s.
            pause_s = _BETWEEN_TRIES_S * (1 if result == "TIMEOUT" else number)
            self._listen(hear, lambda: False, self.clock.now() + pause_s)
        kind = TransferSilentError if result == "TIMEOUT" else TransferError
        raise kind(f"{doing}: {result} in try {number} of at most {TRIES}{terms.advice}", vehicle_holds=terms.holds)

    def _cancel(self, call: Call, mission_type: MissionType) -> None:
        """Cancel a transfer, and let MAVSDK say so."""
        self._session.cancel(mission_type)
        self._await(call, lambda _: None, self.clock.now() + 3.0)

    def _await(self, call: Call, hear: Heard, deadline: float, stop: Stop | None = None) -> Answer | None:
        """The answer to a call; None when the deadline came first, or ``stop`` said so."""
        answer: Answer | None = None

        def is_over() -> bool:
            nonlocal answer
            answer = call.take_answer()
            return answer is not None or (stop is not None and stop())

        try:
            self._listen(hear, is_over, deadline)
        except WaitCancelledError:
            self._session.drop(call)
            raise
        return answer

    def _listen(self, hear: Heard, is_over: Callable[[], bool], deadline: float) -> None:
        """Let MAVSDK and ``hear`` have what arrives, until something is over or the deadline comes."""
        while not is_over() and (now := self.clock.now()) < deadline:
            for received in self.next_messages(min(deadline, now + _LISTEN_S)):
                if received.sender == self.vehicle.address:
                    hear(received)


class _Across:
    """Items that are across, as the vehicle's own messages tell: MAVSDK's progress drops numbers and ends with NaN."""

    def __init__(self, total: int, progress: Progress | None) -> None:
        self.total, self._done, self._progress = total, -1, progress

    def count(self, done: int) -> None:
        """Report the number of items that arrived; a number that is not higher than before has no meaning."""
        if done > self._done:
            self._done = done
            if self._progress is not None:
                self._progress(done, self.total)


def _is_final(result: str, number: int) -> bool:
    """Whether another try would come to the same, after ``number`` tries."""
    return number >= _FINAL_FROM_TRY.get(result, TRIES) or (number == 1 and result in _FINAL_AT_FIRST)

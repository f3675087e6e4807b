"""Flying a mission that a vehicle holds: start, pause, go on, jump to an item, and follow it. Nothing here arms a vehicle."""

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from mission_io.autopilots.autopilot import Mode, custom_mode
from mission_io.client import commands
from mission_io.client.connection import Connection
from mission_io.errors import CommandRefusedError, VehicleSilentError
from mission_io.model.enums import CommandResult, Firmware, MissionState
from mission_io.model.items import Command
from mission_io.protocol.timing import CALLS, TRANSFERS
from mission_io.wire import messages as m
from mission_io.wire.messages import Address, MissionCurrent


class SetCurrent:
    """Makes another item the current one, and waits until the vehicle reports it.

    DO_SET_MISSION_CURRENT is sent until it is answered; to vehicles that do not know it MISSION_SET_CURRENT, without an answer.
    MISSION_CURRENT with the wanted item settles it. An autopilot that goes on to the next waypoint at once because the wanted
    item is a command reports a later one: that counts as well, when it is another one than before.

    Attributes:
        current: The vehicle's latest report since the first command; None before that.
        refused: The MAV_RESULT of a refusal; None without one.
        accepted: Whether the vehicle has acknowledged the command.
    """

    def __init__(
        self,
        seq: int,  # the item's number on the wire
        *,
        vehicle: Address,  # the autopilot
        local: Address,  # this side
        question: m.CommandLong,  # asks for MISSION_CURRENT
        before: int | None,  # the current item as last reported; None for not known
        now: float,  # the present time in seconds
        timeout_s: float = 5.0,  # longest duration
        again_s: float = 0.5,  # a silence after which it is said again
    ) -> None:
        self.current: m.MissionCurrent | None = None
        self.refused: int | None = None
        self.accepted = self.done = self.cancelled = False
        self._seq, self._vehicle, self._local, self._before = seq, vehicle, local, before
        self._question = question
        self._until, self._again_s = now + timeout_s, again_s
        self._said_at: float | None = None
        self._tries = self._stale = 0
        self._older = self._over = False

    @property
    def finished(self) -> bool:
        """Whether it is settled, refused, cancelled, or the time is up."""
        return self.done or self.cancelled or self._over or self.refused is not None

    def cancel(self, now: float) -> None:
        """Stop; the vehicle may have received the command."""
        del now
        self.cancelled = True

    def receive(self, received: m.Received, now: float) -> None:
        """Take a message; those about anything else have no effect."""
        del now
        if self.finished or received.sender != self._vehicle:
            return
        message = received.message
        if isinstance(message, m.CommandAck):
            ours = message.target_system in (0, self._local.system_id)
            if message.command == Command.DO_SET_MISSION_CURRENT and ours:
                self._take_ack(message.result)
        elif isinstance(message, m.MissionCurrent) and self._tries > 0:
            self._take_current(message)

    def _take_ack(self, result: int) -> None:
        if result == CommandResult.ACCEPTED:
            self._said_at = self._said_at if self.accepted else None  # ask at once what it reports now
            self.accepted = True
        elif result == CommandResult.UNSUPPORTED:
            self._older, self._said_at = True, None
        elif result != CommandResult.IN_PROGRESS and not self.accepted:
            self.refused = result

    def _take_current(self, message: m.MissionCurrent) -> None:
        commanded = self.accepted or self._older
        self.current = message
        went_on = self.accepted and message.seq > self._seq and message.seq != self._before
        if commanded and (message.seq == self._seq or went_on):
            self.done = True
        elif self.accepted:
            self._stale += 1
            self._over = self._stale >= TRANSFERS.stale_tries

    def messages_to_send(self, now: float) -> list[m.Message]:
        """Messages due at ``now``."""
        self._over = self._over or now >= self._until
        if self.finished or (self._said_at is not None and now < self._said_at + self._again_s):
            return []
        self._said_at = now
        if self.accepted:
            return [self._question]
        messages: list[m.Message] = []
        if not self._older:
            params = (float(self._seq), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            messages.append(
                m.CommandLong(
                    *self._vehicle, Command.DO_SET_MISSION_CURRENT, params, confirmation=min(self._tries, 255)
                )
            )
        self._tries += 1
        if self._older or self._tries > TRANSFERS.deaf_tries:
            self._older = True
            messages += [m.MissionSetCurrent(*self._vehicle, self._seq), self._question]
        return messages

    def next_timer(self) -> float | None:
        """Time of the next call without a message; None if it needs none."""
        if self.finished:
            return None
        return self._until if self._said_at is None else min(self._until, self._said_at + self._again_s)


@dataclass(frozen=True, slots=True)
class ItemProgress:
    """Progress of a mission."""

    current: int | None = None  # the item that the vehicle flies to, by its number on the wire; None before it has said
    reached: int | None = None  # the latest item that it has reported as reached; it may repeat some and leave some out
    total: int | None = None  # how many items there are, home omitted; None where the vehicle does not say
    state: int = MissionState.UNKNOWN  # A MissionState; UNKNOWN where the vehicle does not say

    @property
    def complete(self) -> bool:
        """Whether the vehicle reports that it has flown all of it."""
        return self.state == MissionState.COMPLETE

    def after(self, message: m.Message) -> "ItemProgress":
        """The progress after a message of the vehicle; the same for one about anything else."""
        if isinstance(message, m.MissionCurrent):
            return replace(self, current=message.seq, total=message.total, state=message.state)
        if isinstance(message, m.MissionItemReached):
            return replace(self, reached=message.seq)
        return self


def set_current(connection: Connection, seq: int, *, timeout_s: float = 5.0) -> MissionCurrent:
    """Make another item the current one, and wait until the vehicle reports it.

    Args:
        connection: With the vehicle.
        seq: The item's number on the wire: on ArduPilot item 0 is home.
        timeout_s: Longest time to wait.

    Returns:
        The vehicle's report; its item is a later one where the wanted one is a command that it has carried out.

    Raises:
        CommandRefusedError: the vehicle refuses, for example because there is no such item.
        VehicleSilentError: no report of that item within ``timeout_s`` seconds; it says what was reported instead.
    """
    vehicle = connection.vehicle
    before = _current(connection)
    machine = SetCurrent(
        seq,
        vehicle=vehicle.address,
        local=connection.local,
        question=commands.message_question(vehicle, MissionCurrent),
        before=None if before is None else before.seq,
        now=connection.clock.now(),
        timeout_s=timeout_s,
    )
    connection.run(machine, lambda: (0, None))
    if machine.done and machine.current is not None:
        return machine.current
    name = commands.name_of(Command.DO_SET_MISSION_CURRENT)
    if machine.refused is not None:
        result = commands.name_of_result(machine.refused)
        raise CommandRefusedError(
            f"vehicle {vehicle.system_id} answered {name} for item {seq} with {result}",
            command=Command.DO_SET_MISSION_CURRENT, result=machine.refused, result_name=result,
        )  # fmt: skip
    what = "accepted the command" if machine.accepted else "did not answer"
    now_at = "" if machine.current is None else f" but reports item {machine.current.seq}"
    raise VehicleSilentError(
        f"item {seq} did not become the current item: vehicle {vehicle.system_id} {what}{now_at}{connection.signing_advice()}"
    )


def _current(connection: Connection) -> MissionCurrent | None:
    try:
        return commands.request_message(connection, MissionCurrent, timeout_s=1.5)
    except VehicleSilentError:
        return None


def start_mission(connection: Connection, *, timeout_s: float = CALLS.answer_s) -> None:
    """Fly the mission: its mode, and on a multirotor of ArduPilot MISSION_START, without which it stays on the ground.

    The vehicle has to be armed, which is left to you.

    Raises:
        CommandRefusedError: the vehicle refuses, for example without a mission.
        VehicleSilentError: no answer, or no heartbeat in that mode.
        MisuseError: an autopilot or a kind of vehicle whose modes are not known.
    """
    autopilot = connection.vehicle.autopilot
    commands.set_mode(connection, custom_mode(autopilot, Mode.MISSION), timeout_s=timeout_s)
    if autopilot.firmware is Firmware.COPTER:
        commands.send_command(connection, Command.MISSION_START, timeout_s=timeout_s)


def pause_mission(connection: Connection, *, timeout_s: float = CALLS.answer_s) -> None:
    """Stop in the air and keep the current item of the mission.

    ArduCopter stops inside AUTO (DO_PAUSE_CONTINUE), or where it refuses that, in LOITER; planes circle, others and PX4 hold.

    Raises:
        CommandRefusedError: the vehicle refuses.
        VehicleSilentError: no answer, or no heartbeat in that mode.
        MisuseError: an autopilot or a kind of vehicle whose modes are not known.
    """
    _pause_or_continue(connection, 0.0, Mode.HOLD, timeout_s)


def resume_mission(connection: Connection, *, timeout_s: float = CALLS.answer_s) -> None:
    """Go on after ``pause_mission``, at the item that was current.

    ArduPilot begins anew instead when its parameter MIS_RESTART is 1.

    Raises:
        As ``pause_mission``.
    """
    _pause_or_continue(connection, 1.0, Mode.MISSION, timeout_s)


def _pause_or_continue(connection: Connection, go_on: float, mode: Mode, timeout_s: float) -> None:
    """DO_PAUSE_CONTINUE inside the mission of an ArduCopter; the mode for others, and where it refuses."""
    vehicle = connection.vehicle
    autopilot = vehicle.autopilot
    if autopilot.firmware is Firmware.COPTER and vehicle.custom_mode == custom_mode(autopilot, Mode.MISSION):
        with contextlib.suppress(CommandRefusedError):
            commands.send_command(connection, Command.DO_PAUSE_CONTINUE, go_on, timeout_s=timeout_s)
            return
    commands.set_mode(connection, custom_mode(autopilot, mode), timeout_s=timeout_s)


def follow_mission(
    connection: Connection, *, until: Callable[[ItemProgress], bool] | None = None, silent_s: float = 15.0
) -> Iterator[ItemProgress]:
    """Yield the progress of a mission whenever it changes, until it is complete.

    A vehicle that sends no MISSION_CURRENT by itself receives a request for it.

    Args:
        connection: With the vehicle.
        until: Ends it earlier; called with each progress.
        silent_s: Time without a heartbeat after which it ends with an error.

    Raises:
        VehicleSilentError: no heartbeat for ``silent_s`` seconds.
    """
    vehicle = connection.vehicle
    progress, heard_at = ItemProgress(), -CALLS.ask_again_s
    while True:
        now = connection.clock.now()
        if connection.heartbeat_age_s > silent_s:
            raise VehicleSilentError(f"vehicle {vehicle.system_id} did not send a heartbeat for {silent_s:g} s")
        if now >= heard_at + CALLS.ask_again_s:
            heard_at = now
            connection.send(commands.message_question(vehicle, MissionCurrent))
        for received in connection.poll(CALLS.poll_s):
            if received.sender != vehicle.address:
                continue
            if isinstance(received.message, MissionCurrent):
                heard_at = connection.clock.now()
            later = progress.after(received.message)
            if later != progress:
                progress = later
                yield progress
                if progress.complete or (until is not None and until(progress)):
                    return


def wait_for_mission(
    connection: Connection,
    *,
    progress: Callable[[ItemProgress], None] | None = None,
    until: Callable[[ItemProgress], bool] | None = None,
    silent_s: float = 15.0,
) -> ItemProgress:
    """Follow a mission to its end and return its last progress; ``progress`` is called with each.

    Raises:
        VehicleSilentError: as ``follow_mission``.
    """
    latest = ItemProgress()
    for latest in follow_mission(connection, until=until, silent_s=silent_s):
        if progress is not None:
            progress(latest)
    return latest

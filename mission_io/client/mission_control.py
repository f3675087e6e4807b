"""Flying a mission that a vehicle holds: start, pause, go on, jump to an item, and follow it. Nothing here arms a vehicle."""

import contextlib
from collections.abc import Callable, Iterator

from mission_io.autopilots.autopilot import Mode, custom_mode
from mission_io.client import commands
from mission_io.client.connection import Connection
from mission_io.client.running import run
from mission_io.errors import CommandRefusedError, VehicleSilentError
from mission_io.model.enums import Firmware
from mission_io.model.items import Command
from mission_io.protocol.mission_control import ItemProgress, SetCurrent
from mission_io.protocol.timing import CALLS
from mission_io.wire.messages import MissionCurrent


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
    run(connection, machine, lambda: (0, None))
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


def start_mission(connection: Connection, *, timeout_s: float = 10.0) -> None:
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
        commands.send_command(connection, Command.MISSION_START, (), timeout_s=timeout_s)


def pause_mission(connection: Connection, *, timeout_s: float = 10.0) -> None:
    """Stop in the air and keep the current item of the mission.

    ArduCopter stops inside AUTO (DO_PAUSE_CONTINUE), or where it refuses that, in LOITER; planes circle, others and PX4 hold.

    Raises:
        CommandRefusedError: the vehicle refuses.
        VehicleSilentError: no answer, or no heartbeat in that mode.
        MisuseError: an autopilot or a kind of vehicle whose modes are not known.
    """
    _pause_or_continue(connection, 0.0, Mode.HOLD, timeout_s)


def resume_mission(connection: Connection, *, timeout_s: float = 10.0) -> None:
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
            commands.send_command(connection, Command.DO_PAUSE_CONTINUE, (go_on,), timeout_s=timeout_s)
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

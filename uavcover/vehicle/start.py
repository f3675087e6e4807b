"""Arming and starting, in the order that each autopilot wants."""

from mission_io.errors import CommandRefusedError, VehicleSilentError
from mission_io.model.enums import AutopilotId, CommandResult
from mission_io.model.items import Command
from mission_io.wire.messages import MissionCurrent, MissionSetCurrent
from uavcover.vehicle.modes import Mode, custom_mode
from uavcover.vehicle.outcome import Ending, EventKind, FlightFaultError
from uavcover.vehicle.session import Conversation, Stopped, Timer

_ANSWER_S = 3.0
_AGAIN = (CommandResult.TEMPORARILY_REJECTED, CommandResult.FAILED)


def arm_and_start(conversation: Conversation) -> None:
    """Arm, start the mission, and wait until the vehicle has left the ground.

    ArduPilot: GUIDED, arm, AUTO, MISSION_START. PX4: mission mode, then arm, which starts it.

    Raises:
        FlightFaultError: it refuses to arm, or does not leave the ground.
        mission_io.errors.CommandRefusedError: it refuses another step.
        Stopped: the user asked to stop; it may be armed.
    """
    ardupilot = conversation.client.vehicle.mav_autopilot == AutopilotId.ARDUPILOT
    first = first_seq(conversation)
    set_current_item(conversation, first)
    if conversation.stop():
        raise Stopped
    set_mode(conversation, Mode.GUIDED if ardupilot else Mode.MISSION)
    conversation.monitor.forget(MissionCurrent)  # the item of an older flight may still be told
    _arm(conversation)
    conversation.tell(EventKind.STAGE, "armed")
    if ardupilot:
        start_mission(conversation)

    def off_the_ground() -> bool:
        on_ground = conversation.monitor.on_ground
        return on_ground is False or (on_ground is None and conversation.monitor.current_seq > first)

    conversation.wait(
        off_the_ground,
        patience_s=conversation.patience.start_s,
        what=lambda: f"the vehicle, armed and in {conversation.mode_name}, did not take off",
        stops_before=0,
        ending=Ending.NOT_STARTED,
    )
    conversation.watch.take_off()
    conversation.tell(EventKind.STAGE, "in the air")


def start_mission(conversation: Conversation) -> None:
    """Change an armed vehicle to its mission, and tell ArduPilot to begin."""
    set_mode(conversation, Mode.MISSION)
    if conversation.client.vehicle.mav_autopilot == AutopilotId.ARDUPILOT:
        conversation.client.command(Command.MISSION_START)


def set_mode(conversation: Conversation, mode: Mode) -> None:
    """Change the flight mode and see it in the heartbeat."""
    conversation.client.set_mode(custom_mode(conversation.autopilot, mode))


def hold_mode(conversation: Conversation) -> Mode:
    """The mode in which the vehicle stays where it is without a pilot's sticks.

    ArduPilot's LOITER takes the height from the throttle stick, which is down when nobody holds it; GUIDED stays.
    """
    return Mode.GUIDED if conversation.client.vehicle.mav_autopilot == AutopilotId.ARDUPILOT else Mode.HOLD


def first_seq(conversation: Conversation) -> int:
    """Number on the wire of a mission's first item."""
    return 1 if conversation.autopilot.home_in_item_0 else 0


def wire_seq(conversation: Conversation, index: int) -> int:
    """Number on the wire of item ``index`` of a mission."""
    return first_seq(conversation) + index


def set_current_item(conversation: Conversation, seq: int) -> None:
    """Go on with item ``seq``, by command, or by the older message where the command is not known."""
    try:
        conversation.client.command(Command.DO_SET_MISSION_CURRENT, float(seq), timeout_s=_ANSWER_S)
    except (CommandRefusedError, VehicleSilentError) as error:
        if isinstance(error, CommandRefusedError) and error.result != CommandResult.UNSUPPORTED:
            raise
        to = conversation.client.vehicle
        conversation.client.send(MissionSetCurrent(to.system_id, to.component_id, seq))


def disarm_on_ground(conversation: Conversation) -> bool:
    """Disarm a vehicle that stands on the ground.

    Returns:
        Whether it is disarmed; False when it refuses, because it has just left the ground, or when not all that is known of it
        (its word, its height, its motion) tells that it stands there.
    """
    if not conversation.client.vehicle.armed:
        return True
    if conversation.monitor.on_ground is not True:
        return False
    try:
        conversation.client.command(Command.COMPONENT_ARM_DISARM, 0.0)
    except CommandRefusedError:
        return False
    return True


def is_flying(conversation: Conversation) -> bool:
    """Whether the vehicle is armed and not proved to stand on the ground."""
    return conversation.client.vehicle.armed and conversation.monitor.on_ground is not True


def _arm(conversation: Conversation) -> None:
    timer = Timer(conversation, conversation.patience.arm_s)
    while True:
        try:
            conversation.client.command(Command.COMPONENT_ARM_DISARM, 1.0)
        except CommandRefusedError as error:
            if error.result not in _AGAIN or timer.over:
                raise FlightFaultError(Ending.ARMING_REFUSED, f"{error}{conversation.complaints}") from error
            if conversation.stop():
                raise Stopped from None
            pause = Timer(conversation, 1.0)
            while not pause.over:
                conversation.pump()
        else:
            break
    conversation.wait(
        lambda: conversation.client.vehicle.armed,
        patience_s=conversation.patience.start_s,
        what=lambda: "arming was accepted, but the heartbeat does not show it",
        stops_before=0,
        ending=Ending.ARMING_REFUSED,
    )

"""Conversations written as short scripts, played to a state machine on a clock that stands still between steps.

A step is ``req 2``, ``count 3``, ``item 0``, ``list``, ``clear``, ``ack DENIED``, ``wait 1.5`` (seconds) or ``cancel``.
What the machine sends is written the same way. ``@2`` after a step: from system 2; ``/rally``: about the rally points;
``3 * (req 0, wait 1)``: the same steps three times.
"""

import re
from dataclasses import dataclass
from typing import Any

from mission_io.model.enums import MissionResult
from mission_io.model.items import Frame, MissionItem, MissionType, waypoint
from mission_io.wire import messages as m
from mission_io.wire.messages import Address, degrees_on_wire, message_from_item

GROUND, VEHICLE = Address(255, 190), Address(1, 1)


@dataclass(frozen=True)
class Script:
    """What happens, the state it ends in, and what the last step made the machine send.

    In ``sends``, ``x *`` stands for one or more x, and ``...`` in front for anything.
    """

    shows: str
    steps: str
    state: str
    sends: str = ""
    items: int = 5
    autopilot: str = "PX4"


def items(count: int) -> tuple[MissionItem, ...]:
    """Items that come back equal to the last bit; no two, and no latitude and longitude, are alike."""
    return tuple(
        waypoint(degrees_on_wire(46.1 + i * 1e-3), degrees_on_wire(-7.2 - i * 2e-3), 100.0 + i, frame=Frame.ABOVE_HOME)
        for i in range(count)
    )


def message(step: str, to: Address) -> m.Message:
    words = step.split()
    kind, *arguments = words
    address = (to.system_id, to.component_id)
    mission_type = MissionType.RALLY if "/rally" in arguments else MissionType.MISSION
    if "/unknown" in arguments:
        mission_type = 7  # type: ignore[assignment]
    if kind == "ack":
        return m.MissionAck(*address, MissionResult[arguments[0]], mission_type)
    if kind == "list":
        return m.MissionRequestList(*address, mission_type)
    if kind == "clear":
        return m.MissionClearAll(*address, 255 if "/all" in arguments else mission_type)
    number = int(arguments[0])
    if kind == "count":
        return m.MissionCount(*address, number, mission_type)
    if kind == "req":
        return m.MissionRequestInt(*address, number, mission_type)
    if kind == "oldreq":
        return m.MissionRequest(*address, number, mission_type)
    item = items(number + 1)[number]
    sent = message_from_item(
        item, number, mission_type=mission_type, target_system=to.system_id, target_component=to.component_id
    )
    if "bad" in arguments:
        fields = {name: getattr(sent, name) for name in m.MissionItemInt.__dataclass_fields__}
        return m.MissionItemInt(**{**fields, "frame": 1})
    return sent


def text(sent: m.Message) -> str:
    match sent:
        case m.MissionCount():
            return f"count {sent.count}"
        case m.MissionRequest():
            return f"oldreq {sent.seq}"
        case m.MissionRequestInt():
            return f"req {sent.seq}"
        case m.MissionItemInt():
            return f"item {sent.seq}"
        case m.MissionItemFloat():
            return f"olditem {sent.seq}"
        case m.MissionAck():
            return f"ack {MissionResult(sent.result).name}"
        case m.MissionRequestList():
            return "list"
        case m.MissionClearAll():
            return "clear"
    raise AssertionError(sent)


def play(machine: Any, steps: str, *, sender: Address, to: Address, now: float = 0.0) -> list[str]:
    """Play the steps; what was sent during the last one. The machine is polled at its timers, as a driver would."""
    sent = [text(it) for it in machine.messages_to_send(now)]
    written_out = re.sub(r"(\d+) \* \((.*?)\)", lambda found: ", ".join([found[2]] * int(found[1])), steps)
    for step in filter(None, (step.strip() for step in written_out.split(","))):
        sent = []
        if step.startswith("wait "):
            end = now + float(step.split()[1])
            while (timer := machine.next_timer()) is not None and timer <= end:
                now = max(now, timer)
                sent += [text(it) for it in machine.messages_to_send(now)]
            now = end
        elif step == "cancel":
            machine.cancel(now)
        else:
            step, _, system = step.partition("@")
            origin = Address(int(system), sender.component_id) if system else sender
            machine.receive(m.Received(message(step, to), origin.system_id, origin.component_id), now)
        sent += [text(it) for it in machine.messages_to_send(now)]
    return sent

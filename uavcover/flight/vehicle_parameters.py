"""Parameters of a vehicle, several at once, as plain numbers: PX4 sends the bits of its integers as if they were floats."""

import struct
from collections.abc import Collection, Iterable, Mapping

from mission_io.enums import AutopilotId
from mission_io.errors import VehicleSilentError
from mission_io.messages import ParamRequestRead, ParamValue
from uavcover.flight.conversation import Conversation

_ANSWER_S = 3.0
_AGAIN_S = 0.7
_WHOLE_TYPES = range(1, 9)
"""MAV_PARAM_TYPE: integers of 8 to 64 bits."""


def read_parameters(conversation: Conversation, groups: Iterable[Collection[str]]) -> dict[str, ParamValue]:
    """Ask for all at once; of each group of names for the same thing one answer is enough.

    A vehicle is silent about a parameter that it does not have, so what is not here may also be lost on a bad link: it is asked
    for again until three seconds have gone.
    """
    client, found = conversation.client, dict[str, ParamValue]()
    wanted = [list(names) for names in groups]
    until_s = client.clock.now() + _ANSWER_S
    again_s = client.clock.now()
    while (left := [names for names in wanted if not found.keys() & names]) and client.clock.now() < until_s:
        if client.clock.now() >= again_s:
            again_s = client.clock.now() + _AGAIN_S
            to = client.vehicle
            for name in (name for names in left for name in names):
                client.send(ParamRequestRead(to.system_id, to.component_id, name))
        for received in client.poll(0.1):
            vehicle = client.vehicle
            ours = (received.system_id, received.component_id) == (vehicle.system_id, vehicle.component_id)
            if ours and isinstance(received.message, ParamValue):
                found[received.message.name] = received.message
    return found


def numbers(values: Mapping[str, ParamValue], *, px4: bool) -> dict[str, float]:
    """What the values are, in their own units."""
    return {name: _decoded(value, px4=px4) for name, value in values.items()}


def set_parameter(conversation: Conversation, name: str, number: float) -> None:
    """Set a parameter to a number in its own unit, whatever its type, and see that it is so.

    Raises:
        VehicleSilentError: it does not exist, or nobody answers.
        mission_io.errors.MisuseError: the vehicle limits or refuses it.
    """
    client = conversation.client
    known = read_parameters(conversation, [[name]]).get(name)
    if known is None:
        raise VehicleSilentError(f"no answer about {name}")
    wire = number
    if known.param_type in _WHOLE_TYPES:
        wire = float(round(number))
        if _is_px4(conversation):
            wire = float(struct.unpack("<f", struct.pack("<i", round(number)))[0])
    client.set_parameter(name, wire, param_type=known.param_type, timeout_s=_ANSWER_S)


def _decoded(value: ParamValue, *, px4: bool) -> float:
    if px4 and value.param_type in _WHOLE_TYPES:
        return float(struct.unpack("<i", struct.pack("<f", value.value))[0])
    return value.value


def _is_px4(conversation: Conversation) -> bool:
    return conversation.client.vehicle.mav_autopilot == AutopilotId.PX4

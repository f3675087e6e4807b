"""Flight modes by meaning, and the numbers that ArduPilot's copter and PX4 give them."""

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType

from mission_io.autopilots import Autopilot
from mission_io.enums import AutopilotId


class Mode(Enum):
    """What the vehicle is meant to do."""

    MANUAL = "manual"
    GUIDED = "guided"
    MISSION = "mission"
    HOLD = "hold"
    RETURN = "return"
    LAND = "land"


def _px4(main: int, sub: int = 0) -> int:
    return main << 16 | sub << 24


_CUSTOM_MODES: Mapping[int, Mapping[Mode, int]] = MappingProxyType(
    {
        AutopilotId.ARDUPILOT: {
            Mode.MANUAL: 0,  # STABILIZE
            Mode.MISSION: 3,  # AUTO
            Mode.GUIDED: 4,
            Mode.HOLD: 5,  # LOITER
            Mode.RETURN: 6,  # RTL
            Mode.LAND: 9,
        },
        AutopilotId.PX4: {
            Mode.MANUAL: _px4(1),
            Mode.GUIDED: _px4(3),  # POSCTL: holds its place unless the pilot says otherwise
            Mode.HOLD: _px4(4, 3),
            Mode.MISSION: _px4(4, 4),
            Mode.RETURN: _px4(4, 5),
            Mode.LAND: _px4(4, 6),
        },
    }
)


_ALSO: Mapping[int, Mapping[int, Mode]] = MappingProxyType(
    {
        AutopilotId.ARDUPILOT: {16: Mode.HOLD, 17: Mode.HOLD, 21: Mode.RETURN},  # POSHOLD, BRAKE, SMART_RTL
        AutopilotId.PX4: {},
    }
)
"""Further modes that mean the same to this package; it never asks for them."""


def custom_mode(autopilot: Autopilot, mode: Mode) -> int:
    """The heartbeat's ``custom_mode`` of a mode."""
    return _CUSTOM_MODES[autopilot.mav_autopilot][mode]


def mode_from_custom(autopilot: Autopilot, number: int) -> Mode | None:
    """The mode that a heartbeat's ``custom_mode`` stands for; None for one that this package has no word for."""
    for mode, known in _CUSTOM_MODES[autopilot.mav_autopilot].items():
        if known == number:
            return mode
    return _ALSO[autopilot.mav_autopilot].get(number)


def mode_from_params(autopilot: Autopilot, params: tuple[float, ...]) -> Mode | None:
    """The mode that a DO_SET_MODE command asks for: PX4 has main and sub mode in two parameters."""
    if autopilot.mav_autopilot == AutopilotId.PX4:
        return mode_from_custom(autopilot, _px4(int(params[1]), int(params[2])))
    return mode_from_custom(autopilot, int(params[1]))

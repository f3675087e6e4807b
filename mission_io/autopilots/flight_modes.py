"""Flight modes by meaning, with the numbers that PX4 and each ArduPilot vehicle use."""

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType

from mission_io.autopilots.autopilot import Autopilot
from mission_io.errors import MisuseError
from mission_io.model.enums import AutopilotId, Firmware


class Mode(Enum):
    """Purpose of a flight mode."""

    MANUAL = "manual"
    GUIDED = "guided"
    MISSION = "mission"
    HOLD = "hold"
    RETURN = "return"
    LAND = "land"


def _px4(main: int, sub: int = 0) -> int:
    return main << 16 | sub << 24


_CUSTOM_MODES: Mapping[Firmware, Mapping[Mode, int]] = MappingProxyType(
    {
        Firmware.COPTER: {
            Mode.MANUAL: 0,  # STABILIZE
            Mode.MISSION: 3,  # AUTO
            Mode.GUIDED: 4,
            Mode.HOLD: 5,  # LOITER
            Mode.RETURN: 6,  # RTL
            Mode.LAND: 9,
        },
        Firmware.PLANE: {
            Mode.MANUAL: 0,
            Mode.MISSION: 10,  # AUTO
            Mode.RETURN: 11,  # RTL
            Mode.HOLD: 12,  # LOITER: in circles
            Mode.GUIDED: 15,
            Mode.LAND: 20,  # QLAND, of those that land vertically
        },
        Firmware.ROVER: {Mode.MANUAL: 0, Mode.HOLD: 4, Mode.MISSION: 10, Mode.RETURN: 11, Mode.GUIDED: 15},
        Firmware.SUB: {
            Mode.MISSION: 3,  # AUTO
            Mode.GUIDED: 4,
            Mode.LAND: 9,  # SURFACE
            Mode.HOLD: 16,  # POSHOLD
            Mode.MANUAL: 19,
        },
        Firmware.BLIMP: {Mode.LAND: 0, Mode.MANUAL: 1, Mode.HOLD: 3, Mode.RETURN: 4, Mode.MISSION: 5},
        Firmware.PX4: {
            Mode.MANUAL: _px4(1),
            Mode.GUIDED: _px4(3),  # POSCTL: holds its place unless the pilot says otherwise
            Mode.HOLD: _px4(4, 3),
            Mode.MISSION: _px4(4, 4),
            Mode.RETURN: _px4(4, 5),
            Mode.LAND: _px4(4, 6),
        },
    }
)
"""From the autopilots' sources; a number means something else to each: 4 is GUIDED, ACRO, HOLD or RTL."""


_ALSO: Mapping[Firmware, Mapping[int, Mode]] = MappingProxyType(
    {
        Firmware.COPTER: {16: Mode.HOLD, 17: Mode.HOLD, 21: Mode.RETURN},  # POSHOLD, BRAKE, SMART_RTL
        Firmware.PLANE: {19: Mode.HOLD, 21: Mode.RETURN},  # QLOITER, QRTL
        Firmware.ROVER: {5: Mode.HOLD, 12: Mode.RETURN},  # LOITER, SMART_RTL
    }
)
"""Further modes that mean the same to this package; it never asks for them."""


def custom_mode(autopilot: Autopilot, mode: Mode) -> int:
    """The heartbeat's ``custom_mode`` of a mode. Raises MisuseError: such a vehicle has no such mode."""
    number = _CUSTOM_MODES.get(autopilot.firmware, {}).get(mode)
    if number is None:
        raise MisuseError(f"{autopilot.name} has no {mode.value} mode")
    return number


def has_mode(autopilot: Autopilot, mode: Mode) -> bool:
    """Whether such a vehicle has a mode, as far as it is known here."""
    return mode in _CUSTOM_MODES.get(autopilot.firmware, {})


def mode_from_custom(autopilot: Autopilot, number: int) -> Mode | None:
    """The mode that a heartbeat's ``custom_mode`` stands for; None for one that this package has no word for."""
    for mode, known in _CUSTOM_MODES.get(autopilot.firmware, {}).items():
        if known == number:
            return mode
    return _ALSO.get(autopilot.firmware, {}).get(number)


def mode_from_params(autopilot: Autopilot, params: tuple[float, ...]) -> Mode | None:
    """The mode that a DO_SET_MODE command requests: PX4 has main and sub mode in two parameters."""
    if autopilot.mav_autopilot == AutopilotId.PX4:
        return mode_from_custom(autopilot, _px4(int(params[1]), int(params[2])))
    return mode_from_custom(autopilot, int(params[1]))

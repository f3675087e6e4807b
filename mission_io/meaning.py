"""What the numbers of a command mean, as data: which of them say the same although they differ.

From the descriptions of the commands in MAVLink's common message set. Ground stations fill what a command has no use for,
and what it leaves to the vehicle, each in its own way: 0, -1, NaN.
"""

import math
from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType

from mission_io.items import Command, same_number

_FLOAT32_STEP = 2.0**-23
_SIX_DECIMALS = 1e-6
"""Files of other programs keep numbers with six decimals."""


class Meaning(Enum):
    """How two numbers of the same parameter are compared."""

    RESERVED = "the command has no use for this parameter"
    NUMBER = "a number"
    OR_DEFAULT = "a number; 0 and NaN leave it to the vehicle"
    IF_ABOVE_ZERO = "a number above 0; anything else leaves it to the vehicle"
    IF_NOT_NEGATIVE = "a number from 0; a negative one and NaN leave it to the vehicle"
    HEADING = "degrees on a circle; NaN leaves it to the vehicle"

    def same(self, a: float, b: float) -> bool:
        """Whether two numbers mean the same."""
        match self:
            case Meaning.RESERVED:
                return True
            case Meaning.HEADING if math.isfinite(a) and math.isfinite(b):
                return abs((a - b + 180.0) % 360.0 - 180.0) <= _rounding(max(abs(a), abs(b)))
            case Meaning.OR_DEFAULT:
                a, b = (0.0 if math.isnan(value) else value for value in (a, b))
            case Meaning.IF_ABOVE_ZERO:
                a, b = (value if value > 0.0 else 0.0 for value in (a, b))
            case Meaning.IF_NOT_NEGATIVE:
                a, b = (value if value >= 0.0 else -1.0 for value in (a, b))
        return same_number(a, b) or abs(a - b) <= _rounding(abs(a))


def meaning_of(command: int, number: int) -> Meaning:
    """What parameter ``number`` (1 to 7) of a command means; a number for commands that are not known here.

    Parameters 5 to 7 of a command with a position are the position, and not asked for here.
    """
    known = _MEANINGS.get(command, ())
    return known[number - 1] if number <= len(known) else Meaning.NUMBER


def _rounding(size: float) -> float:
    return max(_SIX_DECIMALS, size * _FLOAT32_STEP) if math.isfinite(size) else 0.0


_R, _N, _D = Meaning.RESERVED, Meaning.NUMBER, Meaning.OR_DEFAULT
_A, _P, _H = Meaning.IF_ABOVE_ZERO, Meaning.IF_NOT_NEGATIVE, Meaning.HEADING
_NO_PLACE = (_R, _R, _R)

_MEANINGS: Mapping[int, tuple[Meaning, ...]] = MappingProxyType(
    {
        Command.NAV_WAYPOINT: (_D, _D, _D, _H),
        Command.NAV_LOITER_UNLIM: (_R, _R, _D, _H),
        Command.NAV_LOITER_TURNS: (_N, _D, _D, _D),
        Command.NAV_LOITER_TIME: (_N, _D, _D, _D),
        Command.NAV_RETURN_TO_LAUNCH: (_R, _R, _R, _R, *_NO_PLACE),
        Command.NAV_LAND: (_D, _D, _R, _H),
        Command.NAV_TAKEOFF: (_D, _R, _R, _H),
        Command.NAV_LOITER_TO_ALT: (_D, _D, _R, _D),
        Command.NAV_SPLINE_WAYPOINT: (_D, _R, _R, _R),
        Command.NAV_DELAY: (_P, _P, _P, _P, *_NO_PLACE),
        Command.CONDITION_DELAY: (_N, _R, _R, _R, *_NO_PLACE),
        Command.CONDITION_DISTANCE: (_N, _R, _R, _R, *_NO_PLACE),
        Command.CONDITION_YAW: (_N, _D, _N, _D, *_NO_PLACE),
        Command.DO_JUMP: (_N, _N, _R, _R, *_NO_PLACE),
        Command.DO_CHANGE_SPEED: (_N, _N, _P, _R, *_NO_PLACE),
        Command.DO_LAND_START: (_R, _R, _R, _R, *_NO_PLACE),
        Command.DO_SET_ROI_LOCATION: (_D, _R, _R, _R),
        Command.DO_SET_ROI_NONE: (_D, _R, _R, _R, *_NO_PLACE),
        Command.DO_MOUNT_CONTROL: (_N, _N, _N, _D, _D, _D, _N),
        Command.DO_SET_CAM_TRIGG_DIST: (_N, _A, _D, _D, *_NO_PLACE),
        Command.DO_GIMBAL_MANAGER_PITCHYAW: (_N, _N, _N, _N, _N, _R, _D),
        Command.IMAGE_START_CAPTURE: (_D, _D, _D, _D, *_NO_PLACE),
        Command.IMAGE_STOP_CAPTURE: (_D, _R, _R, _R, *_NO_PLACE),
        Command.VIDEO_START_CAPTURE: (_D, _D, _D, _R, *_NO_PLACE),
        Command.VIDEO_STOP_CAPTURE: (_D, _R, _R, _R, *_NO_PLACE),
    }
)
"""By command: parameters 1 to 4, and 5 to 7 of a command without a position."""

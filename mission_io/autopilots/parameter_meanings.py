"""Meanings of command parameters, as data: which are unused, and which NaN, 0 or -1 leaves to the vehicle.

From the descriptions of MAV_CMD in MAVLink's common message set (mavlink/mavlink, message_definitions/v1.0/common.xml and
standard.xml at de1e078a, 2026-07-22): a parameter without description or label, or called empty, reserved or unused, is of
no use; "NaN to use the current system yaw heading mode" is a heading. Ground stations fill unused parameters and those left
to the vehicle with 0, -1 or NaN.
"""

import math
from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType

from mission_io.model.items import Command, MissionItem, same_number

_FLOAT32_STEP = 2.0**-23
_SIX_DECIMALS = 1e-6
"""Files of other programs keep numbers with six decimals."""


class Meaning(Enum):
    """Rule that compares two numbers of the same parameter."""

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
    """The meaning of a command's parameter ``number`` (1 to 7); a plain number for unknown commands.

    Parameters 5 to 7 of a command with a position are the position, and not asked for here.
    """
    known = _MEANINGS.get(command, "")
    return _LETTERS[known[number - 1]] if number <= len(known) else Meaning.NUMBER


def has_no_place(command: int) -> bool:
    """Whether parameters 5 to 7 of a command are of no use: neither a position nor numbers."""
    return _MEANINGS.get(command, "")[4:] == "---"


def number_for_nan(item: MissionItem, number: int) -> float:
    """The number for NaN in parameter 1 to 4 of a format without NaN; NaN where none means the same.

    A heading becomes 0, as other programs write it although it means north: who writes it has to say so.
    """
    match meaning_of(item.command, number):
        case Meaning.IF_NOT_NEGATIVE:
            return -1.0
        case Meaning.NUMBER:
            # A rate beside a given angle of a gimbal: the angle is gone to, so 0 adds nothing.
            beside_angle = item.command == Command.DO_GIMBAL_MANAGER_PITCHYAW and number in (3, 4)
            return 0.0 if beside_angle and math.isfinite(item.params[number - 3]) else math.nan
    return 0.0


def _rounding(size: float) -> float:
    return max(_SIX_DECIMALS, size * _FLOAT32_STEP) if math.isfinite(size) else 0.0


_LETTERS: Mapping[str, Meaning] = MappingProxyType(
    {
        "-": Meaning.RESERVED,
        "n": Meaning.NUMBER,
        "d": Meaning.OR_DEFAULT,
        "a": Meaning.IF_ABOVE_ZERO,
        "p": Meaning.IF_NOT_NEGATIVE,
        "h": Meaning.HEADING,
    }
)

_MEANINGS: Mapping[int, str] = MappingProxyType(
    {
        16: "dddh",  # NAV_WAYPOINT
        17: "--dh",  # NAV_LOITER_UNLIM
        18: "nddd",  # NAV_LOITER_TURNS
        19: "nddd",  # NAV_LOITER_TIME
        20: "-------",  # NAV_RETURN_TO_LAUNCH
        21: "dd-h",  # NAV_LAND
        22: "d-dh",  # NAV_TAKEOFF
        30: "n-----n",  # NAV_CONTINUE_AND_CHANGE_ALT
        31: "dd-d",  # NAV_LOITER_TO_ALT
        36: "n---",  # NAV_ARC_WAYPOINT
        80: "nnn-",  # NAV_ROI
        81: "nn-n",  # NAV_PATHPLANNING
        82: "d---",  # NAV_SPLINE_WAYPOINT
        84: "-n-h",  # NAV_VTOL_TAKEOFF
        85: "n-nh",  # NAV_VTOL_LAND
        92: "n------",  # NAV_GUIDED_ENABLE
        93: "pppp---",  # NAV_DELAY
        94: "n---",  # NAV_PAYLOAD_PLACE
        112: "n------",  # CONDITION_DELAY
        113: "n-----n",  # CONDITION_CHANGE_ALT
        114: "n------",  # CONDITION_DISTANCE
        115: "ndnd---",  # CONDITION_YAW
        177: "nn-----",  # DO_JUMP
        178: "nnp----",  # DO_CHANGE_SPEED
        179: "nnnn",  # DO_SET_HOME
        180: "nn-----",  # DO_SET_PARAMETER
        181: "nn-----",  # DO_SET_RELAY
        182: "nnn----",  # DO_REPEAT_RELAY
        183: "nn-----",  # DO_SET_SERVO
        184: "nnnn---",  # DO_REPEAT_SERVO
        185: "n------",  # DO_FLIGHTTERMINATION
        186: "nn-----",  # DO_CHANGE_ALTITUDE
        187: "nnnnnnn",  # DO_SET_ACTUATOR
        188: "----",  # DO_RETURN_PATH_START
        189: "-------",  # DO_LAND_START
        190: "nn-----",  # DO_RALLY_LAND
        191: "n------",  # DO_GO_AROUND
        194: "n------",  # DO_SET_REVERSE
        195: "d---",  # DO_SET_ROI_LOCATION
        196: "n---nnn",  # DO_SET_ROI_WPNEXT_OFFSET
        197: "d------",  # DO_SET_ROI_NONE
        200: "nnnn---",  # DO_CONTROL_VIDEO
        201: "nnn-",  # DO_SET_ROI
        202: "nnnnnnn",  # DO_DIGICAM_CONFIGURE
        203: "nnnnnnn",  # DO_DIGICAM_CONTROL
        204: "nnnnnnn",  # DO_MOUNT_CONFIGURE
        205: "nnndddn",  # DO_MOUNT_CONTROL
        206: "nadd---",  # DO_SET_CAM_TRIGG_DIST
        207: "nn-----",  # DO_FENCE_ENABLE
        208: "n------",  # DO_PARACHUTE
        209: "nnnnnn-",  # DO_MOTOR_TEST
        210: "n------",  # DO_INVERTED_FLIGHT
        211: "nn-----",  # DO_GRIPPER
        212: "nn-----",  # DO_AUTOTUNE_ENABLE
        213: "nnn----",  # NAV_SET_YAW_SPEED
        214: "nnn----",  # DO_SET_CAM_TRIGG_INTERVAL
        220: "nnnn---",  # DO_MOUNT_CONTROL_QUAT
        221: "nn-----",  # DO_GUIDED_MASTER
        222: "nnnn---",  # DO_GUIDED_LIMITS
        223: "nnnn---",  # DO_ENGINE_CONTROL
        405: "n------",  # ILLUMINATOR_ON_OFF
        406: "nnnn---",  # DO_ILLUMINATOR_CONFIGURE
        530: "nn-----",  # SET_CAMERA_MODE
        531: "nnn----",  # SET_CAMERA_ZOOM
        532: "nnn----",  # SET_CAMERA_FOCUS
        534: "nnn----",  # SET_CAMERA_SOURCE
        600: "n------",  # JUMP_TAG
        1000: "nnnnn-d",  # DO_GIMBAL_MANAGER_PITCHYAW
        1001: "nnnn--n",  # DO_GIMBAL_MANAGER_CONFIGURE
        2000: "dddd---",  # IMAGE_START_CAPTURE
        2001: "d------",  # IMAGE_STOP_CAPTURE
        2003: "nnnn---",  # DO_TRIGGER_CONTROL
        2500: "ddd----",  # VIDEO_START_CAPTURE
        2501: "dd-----",  # VIDEO_STOP_CAPTURE
        2502: "nn-----",  # VIDEO_START_STREAMING
        2503: "nn-----",  # VIDEO_STOP_STREAMING
        2520: "nn-----",  # AIRFRAME_CONFIGURATION
        2800: "nnnn---",  # PANORAMA_CREATE
        3000: "nn-----",  # DO_VTOL_TRANSITION
        4501: "nn--",  # CONDITION_GATE
        5000: "----",  # NAV_FENCE_RETURN_POINT
        5001: "nn--",  # NAV_FENCE_POLYGON_VERTEX_INCLUSION
        5002: "n---",  # NAV_FENCE_POLYGON_VERTEX_EXCLUSION
        5003: "nn--",  # NAV_FENCE_CIRCLE_INCLUSION
        5004: "n---",  # NAV_FENCE_CIRCLE_EXCLUSION
        5100: "----",  # NAV_RALLY_POINT
        30001: "nnnn",  # PAYLOAD_PREPARE_DEPLOY
        30002: "n------",  # PAYLOAD_CONTROL_DEPLOY
        42600: "nnnn---",  # DO_WINCH
    }
)
"""By command: a letter each for parameters 1 to 4, and 5 to 7 of a command without a position."""

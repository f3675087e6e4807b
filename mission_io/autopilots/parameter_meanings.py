"""Meanings of command parameters, as data: which are unused, and which NaN, 0 or -1 leaves to the vehicle.

The table is ``data/parameter_meanings.toml``. A parameter without description or label, or called empty, reserved or unused,
is of no use; "NaN to use the current system yaw heading mode" is a heading. Ground stations fill unused parameters and those
left to the vehicle with 0, -1 or NaN.
"""

import math
from collections.abc import Mapping
from enum import Enum
from functools import cache
from types import MappingProxyType

from mission_io.data_tables import read_document
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
    known = _meanings().get(command, "")
    return _LETTERS[known[number - 1]] if number <= len(known) else Meaning.NUMBER


def has_no_place(command: int) -> bool:
    """Whether parameters 5 to 7 of a command are of no use: neither a position nor numbers."""
    return _meanings().get(command, "")[4:] == "---"


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


@cache
def _meanings() -> Mapping[int, str]:
    """By command: a letter each for parameters 1 to 4, and 5 to 7 of a command without a position."""
    path = "mission_io/data/parameter_meanings.toml"
    for command, letters in read_document(path).items():
        if not (command.isdigit() and isinstance(letters, str) and len(letters) <= 7 and set(letters) <= set(_LETTERS)):
            raise ValueError(f"{path}: {command}: {letters!r} is not up to seven of {''.join(_LETTERS)}")
    return {int(command): letters for command, letters in read_document(path).items()}

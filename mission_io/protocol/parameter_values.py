"""Values of parameters, and how they travel.

PARAM_VALUE has one 32-bit float for every type. Autopilots put integers into it in two ways: PX4 by their bits (bytewise),
ArduPilot by their value (C cast), which is exact up to 2**24. AUTOPILOT_VERSION says which. Extended parameters (PARAM_EXT_*)
have 128 bytes, of which a number takes as many as its type has, least significant first.
"""

import math
import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, TypeAlias

from mission_io.errors import MisuseError
from mission_io.wire.mission_items import float32

Value: TypeAlias = int | float | bytes
"""A whole number, a number, or the bytes of an extended parameter of type CUSTOM."""


class ParamType(IntEnum):
    """Type of a parameter (MAV_PARAM_TYPE and MAV_PARAM_EXT_TYPE, which agree)."""

    UINT8 = 1
    INT8 = 2
    UINT16 = 3
    INT16 = 4
    UINT32 = 5
    INT32 = 6
    UINT64 = 7
    INT64 = 8
    REAL32 = 9
    REAL64 = 10
    CUSTOM = 11


PARAM_ENCODE_BYTEWISE: Final = 0x10
"""The capability (MAV_PROTOCOL_CAPABILITY) of an autopilot that sends the bits of an integer."""
PARAM_ENCODE_C_CAST: Final = 0x20000
"""The capability of one that sends its value."""

_LETTERS: Final = dict(zip(ParamType, "BbHhIiQqfd", strict=False))
_EXT_BYTES: Final = 128
_WORD_BYTES: Final = 4


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter as a vehicle has it."""

    name: str  # at most 16 letters
    value: Value  # in its own unit: int for whole types, float for REAL32 and REAL64, bytes for CUSTOM
    param_type: int  # A ParamType, or the number of a type that does not exist
    index: int | None = None  # its place among all; None where the vehicle does not say


def is_whole(param_type: int) -> bool:
    """Whether a type holds whole numbers."""
    return ParamType.UINT8 <= param_type <= ParamType.INT64


def value_of_float(wire: float, param_type: int, *, bytewise: bool) -> int | float:
    """The value that a PARAM_VALUE carries; NaN for an integer that was cast from none.

    A type that does not exist, or that does not fit 32 bits, is taken as a 32-bit float.
    """
    letter = _LETTERS.get(_known(param_type), "f")
    if not is_whole(param_type) or struct.calcsize(letter) > _WORD_BYTES:
        return wire
    if bytewise:
        (value,) = struct.unpack_from(f"<{letter}", struct.pack("<f", wire))
        return int(value)
    return round(wire) if math.isfinite(wire) else wire


def float_of_value(value: float, param_type: int, *, bytewise: bool, name: str) -> float:
    """The float that PARAM_SET carries for a value; the inverse of ``value_of_float``.

    Raises:
        MisuseError: the value does not fit the type, or would arrive as another number.
    """
    if not is_whole(param_type):
        return float32(value)
    whole = _whole(value, param_type, name)
    letter = _LETTERS[ParamType(param_type)]
    if struct.calcsize(letter) > _WORD_BYTES:
        raise MisuseError(f"{name} has 64 bits, but PARAM_SET supports only 32")
    if not bytewise:
        if float32(float(whole)) != whole:
            raise MisuseError(f"{name} = {whole} does not fit in a 32-bit float; use a number below 2**24")
        return float(whole)
    packed = struct.pack(f"<{letter}", whole)
    fill = b"\xff" if whole < 0 else b"\0"
    (wire,) = struct.unpack("<f", packed + fill * (_WORD_BYTES - len(packed)))
    if struct.pack("<f", wire)[: len(packed)] != packed:
        raise MisuseError(f"{name} = {whole} cannot be sent, because its bits form a signalling NaN")
    return float(wire)


def value_of_bytes(raw: bytes, param_type: int) -> Value:
    """The value that a PARAM_EXT_VALUE carries; the bytes, without the zeros at their end, where the type is no number."""
    letter = _LETTERS.get(_known(param_type))
    if letter is None:
        return raw.rstrip(b"\0")
    (value,) = struct.unpack_from(f"<{letter}", raw.ljust(8, b"\0"))
    return float(value) if letter in "fd" else int(value)


def bytes_of_value(value: Value, param_type: int, *, name: str) -> bytes:
    """The 128 bytes that PARAM_EXT_SET carries for a value. Raises MisuseError: the value does not fit the type."""
    letter = _LETTERS.get(_known(param_type))
    if letter is None or isinstance(value, bytes):
        if letter is not None or not isinstance(value, bytes):
            raise MisuseError(f"{name}: only parameters of type CUSTOM accept bytes")
        if len(value) > _EXT_BYTES:
            raise MisuseError(f"{name} has {len(value)} bytes, but the limit is {_EXT_BYTES}")
        return value.ljust(_EXT_BYTES, b"\0")
    if letter in "fd":
        number: float = float32(value) if letter == "f" else value
        return struct.pack(f"<{letter}", number).ljust(_EXT_BYTES, b"\0")
    return struct.pack(f"<{letter}", _whole(value, param_type, name)).ljust(_EXT_BYTES, b"\0")


def same_value(one: Value, other: Value, param_type: int) -> bool:
    """Whether two values are the same to a vehicle that stores ``param_type``."""
    if isinstance(one, bytes) or isinstance(other, bytes):
        return one == other
    if math.isnan(one) or math.isnan(other):
        return math.isnan(one) and math.isnan(other)
    if is_whole(param_type) or param_type == ParamType.REAL64:
        return one == other
    return float32(one) == float32(other)


def _known(param_type: int) -> ParamType:
    return ParamType(param_type) if param_type in ParamType._value2member_map_ else ParamType.CUSTOM


def _whole(value: float, param_type: int, name: str) -> int:
    """A value as a whole number of its type."""
    if not math.isfinite(value) or value != int(value):
        raise MisuseError(f"{name} = {value} is not a whole number, but {name} is {ParamType(param_type).name}")
    bits = 8 * struct.calcsize(_LETTERS[ParamType(param_type)])
    signed = param_type % 2 == 0  # the signed types have even numbers
    low, high = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if signed else (0, 2**bits - 1)
    if not low <= value <= high:
        raise MisuseError(f"{name} = {value:g} does not fit in {ParamType(param_type).name} ({low} to {high})")
    return int(value)

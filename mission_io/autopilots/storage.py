"""Rounding of received numbers by autopilots, as data: one rule for each field that they change.

ArduPilot packs an item into 15 bytes, so most fields are rounded or dropped. What each command keeps was read in
AP_Mission; for waypoints, landings, fences and rally points it was also observed on a simulated ArduCopter 4.7.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeAlias

from mission_io.model.items import FENCE_COMMANDS, WITHOUT_POSITION, Command
from mission_io.wire.mission_items import float32


@dataclass(frozen=True, slots=True)
class StorageRule:
    """One way in which an autopilot changes what it is given, by design."""

    field: str  # the changed field: ``param1`` to ``param4``, ``lat_deg``, ``lon_deg`` or ``alt_m``
    commands: frozenset[int]  # the commands it concerns
    store: Callable[[float], float]  # from the number sent to the number that comes back
    largest_change: float  # a larger change is not by design, even when ``store`` predicts it
    why: str  # the reason, for people


Storage: TypeAlias = Mapping[tuple[str, int], StorageRule]
"""The rules of an autopilot by field and command."""

_BELOW_ONE = 0.9999999


def _dropped(_: float) -> float:
    return 0.0


def _whole_uint16(value: float) -> float:
    return float(math.trunc(value) & 0xFFFF) if math.isfinite(value) else 0.0


def _whole_byte(value: float) -> float:
    return float(math.trunc(value) & 0xFF) if math.isfinite(value) else 0.0


def _byte_at_most(value: float) -> float:
    """Plane's radii are held at 255, but a negative one wraps first."""
    return min(255.0, _whole_uint16(value))


def _signed_radius(whole: Callable[[float], float]) -> Callable[[float], float]:
    return lambda value: math.copysign(whole(abs(value)), value) + 0.0


def _whole_signed(bits: int) -> Callable[[float], float]:
    half = 1 << (bits - 1)

    def store(value: float) -> float:
        return float((math.trunc(value) + half) % (2 * half) - half) if math.isfinite(value) else 0.0

    return store


def _to_centimetres(value: float) -> float:
    """Truncated toward zero, as a C cast does, in the arithmetic of 32-bit floats."""
    return math.trunc(float32(float32(value) * 100.0)) / 100.0 if math.isfinite(value) else 0.0


def _to_metres(value: float) -> float:
    return float(math.trunc(value)) if math.isfinite(value) else 0.0


def _turn_direction(value: float) -> float:
    return -1.0 if value < 0.0 else 1.0


def _is_above_zero(value: float) -> float:
    return 1.0 if value > 0.0 else 0.0


def _drop(names: Sequence[str], commands: Iterable[int], why: str) -> tuple[StorageRule, ...]:
    return tuple(StorageRule(name, frozenset(commands), _dropped, math.inf, why) for name in names)


def _rule(
    name: str, commands: Iterable[int], store: Callable[[float], float], why: str, largest_change: float = _BELOW_ONE
) -> StorageRule:
    return StorageRule(name, frozenset(commands), store, largest_change, why)


def _by_field(*rules: StorageRule) -> Storage:
    """The rules by command and field; the first of two for the same field counts."""
    found: dict[tuple[str, int], StorageRule] = {}
    for rule in rules:
        for command in rule.commands:
            found.setdefault((rule.field, command), rule)
    return MappingProxyType(found)


_C = Command
_RALLY = frozenset({int(_C.NAV_RALLY_POINT)})
_PLACES = frozenset(
    {
        _C.NAV_WAYPOINT, _C.NAV_LOITER_UNLIM, _C.NAV_LOITER_TURNS, _C.NAV_LOITER_TIME, _C.NAV_LAND, _C.NAV_TAKEOFF,
        _C.NAV_LOITER_TO_ALT, _C.NAV_SPLINE_WAYPOINT, _C.NAV_VTOL_TAKEOFF, _C.NAV_VTOL_LAND, _C.DO_SET_ROI_LOCATION,
    }
)  # fmt: skip
_WHOLE = "ArduPilot stores this value as a whole number"
_UNUSED = "ArduPilot does not use this value"
_SIGN = "ArduPilot keeps only the sign of the radius here"
_EXIT = "ArduPilot stores this value as yes or no"
_KEEP_PARAMETERS_5_TO_7 = {"lat_deg": {_C.DO_DIGICAM_CONTROL, _C.DO_GIMBAL_MANAGER_PITCHYAW},
                           "lon_deg": {_C.DO_DIGICAM_CONTROL},
                           "alt_m": {_C.DO_GIMBAL_MANAGER_PITCHYAW}}  # fmt: skip

_ARDUPILOT_COMMON = (
    _rule("param1", {_C.NAV_SPLINE_WAYPOINT, _C.NAV_LOITER_TIME, _C.NAV_TAKEOFF, _C.NAV_LAND}, _whole_uint16, _WHOLE),
    _rule("param3", {_C.NAV_LOITER_UNLIM}, _signed_radius(_whole_uint16), _WHOLE),
    _rule("param2", {_C.NAV_LOITER_TO_ALT}, _signed_radius(_whole_uint16), _WHOLE),
    _rule("param1", {_C.NAV_LOITER_TURNS}, _whole_byte, _WHOLE),
    _rule("param3", {_C.NAV_LOITER_TURNS}, _signed_radius(_whole_byte), _WHOLE),
    _rule("param3", {_C.NAV_LOITER_TIME}, _turn_direction, _SIGN, math.inf),
    _rule("param4", {_C.NAV_LOITER_TURNS, _C.NAV_LOITER_TIME, _C.NAV_LOITER_TO_ALT}, _is_above_zero, _EXIT, math.inf),
    StorageRule(
        "param4",
        frozenset({_C.NAV_LAND}),
        _turn_direction,
        math.inf,
        "ArduPilot keeps only the sign of a landing's fourth parameter, as 1 or -1 (seen with ArduCopter 4.7)",
    ),
    *_drop(("param2", "param3", "param4"), {_C.NAV_TAKEOFF, _C.DO_SET_ROI_LOCATION, _C.NAV_SPLINE_WAYPOINT}, _UNUSED),
    *_drop(("param2", "param3"), {_C.NAV_LAND}, _UNUSED),
    *_drop(("param1", "param2", "param4"), {_C.NAV_LOITER_UNLIM}, _UNUSED),
    *_drop(("param2",), {_C.NAV_LOITER_TURNS, _C.NAV_LOITER_TIME}, _UNUSED),
    *_drop(("param1", "param3"), {_C.NAV_LOITER_TO_ALT}, _UNUSED),
    *_drop(("param1", "param2", "param3", "param4"), {_C.NAV_VTOL_TAKEOFF, _C.NAV_VTOL_LAND}, _UNUSED),
    *_drop(("param2", "param3", "param4"), {_C.CONDITION_DELAY, _C.CONDITION_DISTANCE}, _UNUSED),
    *_drop(("param4",), {_C.DO_CHANGE_SPEED, _C.DO_MOUNT_CONTROL}, _UNUSED),
    *_drop(("param3", "param4"), {_C.DO_JUMP}, _UNUSED),
    *_drop(("param1", "param2", "param3", "param4"), {_C.NAV_RETURN_TO_LAUNCH, _C.DO_LAND_START}, _UNUSED),
    *_drop(("param2", "param4"), {_C.DO_SET_CAM_TRIGG_DIST}, _UNUSED),
    _rule("param1", {_C.DO_JUMP}, _whole_uint16, _WHOLE),
    _rule("param2", {_C.DO_JUMP}, _whole_signed(16), _WHOLE),
    _rule("param1", {_C.DO_CHANGE_SPEED}, _whole_byte, _WHOLE),
    _rule("param3", {_C.CONDITION_YAW}, _whole_signed(8), _WHOLE),
    _rule("param4", {_C.CONDITION_YAW}, _whole_byte, _WHOLE),
    *(_rule(f"param{n}", {_C.NAV_DELAY}, _whole_signed(8), _WHOLE) for n in (2, 3, 4)),
    *(_rule(f"param{n}", {_C.DO_GIMBAL_MANAGER_PITCHYAW}, _whole_signed(8), _WHOLE) for n in (1, 3, 4)),
    _rule("param2", {_C.DO_GIMBAL_MANAGER_PITCHYAW}, _whole_signed(16), _WHOLE),
    *(
        rule
        for name, kept in _KEEP_PARAMETERS_5_TO_7.items()
        for rule in _drop(
            (name,), WITHOUT_POSITION - kept, "ArduPilot keeps only these values of a command without a position"
        )
    ),
    StorageRule("alt_m", _PLACES, _to_centimetres, 0.01001, "ArduPilot truncates altitudes to centimetres"),
    *_drop(
        ("param2", "param3", "param4", "alt_m"), FENCE_COMMANDS, "ArduPilot keeps only the position and size of a fence"
    ),
    *_drop(("param1", "param2", "param3", "param4"), _RALLY, "ArduPilot keeps only the position of a rally point"),
    StorageRule("alt_m", _RALLY, _to_metres, 1.0, "ArduPilot truncates rally altitudes to metres"),
)

ARDUPILOT_COPTER_STORAGE = _by_field(
    _rule("param1", {_C.NAV_WAYPOINT}, _whole_uint16, "ArduPilot stores a waypoint's hold time in whole seconds"),
    *_drop(("param2", "param3", "param4"), {_C.NAV_WAYPOINT}, "ArduPilot keeps only a waypoint's hold time"),
    *_ARDUPILOT_COMMON,
)
"""ArduPilot on multicopters, helicopters, rovers, boats and submarines."""

ARDUPILOT_PLANE_STORAGE = _by_field(
    _rule("param1", {_C.NAV_WAYPOINT}, _dropped, "ArduPilot planes do not hold at a waypoint; use a loiter item", 0.0),
    *(
        _rule(f"param{n}", {_C.NAV_WAYPOINT}, _byte_at_most, "ArduPilot stores this value in whole metres, up to 255")
        for n in (2, 3)
    ),
    *_drop(("param4",), {_C.NAV_WAYPOINT}, _UNUSED),
    *_ARDUPILOT_COMMON,
)
"""ArduPilot on fixed wings."""

PX4_STORAGE = _by_field(*_drop(("param3",), {_C.NAV_WAYPOINT}, "PX4 does not store a waypoint's pass radius"))
"""PX4."""

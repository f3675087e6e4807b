"""Treatment of missions by ArduPilot and PX4, as data: accepted values, rounding, answers, and flight modes.

Every fact was observed on a simulated vehicle of ArduCopter 4.7 or PX4 1.17, or read in their sources. A vehicle keeps three
lists: mission, fence and rally points. Each is an item list on the wire.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from types import MappingProxyType
from typing import Final, TypeAlias

from mission_io.data_tables import read_document, table_of
from mission_io.errors import MisuseError
from mission_io.model.enums import AutopilotId, Firmware, MissionResult, VehicleClass, VehicleKind, kind_of
from mission_io.model.items import FENCE_COMMANDS, WITHOUT_POSITION, Command, Frame, MissionItem, MissionType
from mission_io.wire.messages import float32

# Rounding of received numbers: one rule for each field that an autopilot changes.
#
# ArduPilot packs an item into 15 bytes, so most fields are rounded or dropped. What each command keeps was read in AP_Mission;
# for waypoints, landings, fences and rally points it was also observed on a simulated ArduCopter 4.7.


@dataclass(frozen=True, slots=True)
class StorageRule:
    """One change that an autopilot makes to stored missions by design."""

    field: str  # the changed field: ``param1`` to ``param4``, ``lat_deg``, ``lon_deg`` or ``alt_m``
    commands: frozenset[int]  # the commands it concerns
    store: Callable[[float], float]  # from the number sent to the number that comes back
    largest_change: float  # a larger change is not by design, even when ``store`` predicts it
    why: str  # the reason, as text


Storage: TypeAlias = Mapping[tuple[str, int], StorageRule]
"""The rules of an autopilot by field and command."""

_BELOW_ONE = 0.9999999


def _whole(mask: int) -> Callable[[float], float]:
    return lambda value: float(math.trunc(value) & mask) if math.isfinite(value) else 0.0


_whole_uint16, _whole_byte = _whole(0xFFFF), _whole(0xFF)


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
    return tuple(_rule(name, commands, lambda _: 0.0, why, math.inf) for name in names)


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
_POSITIONS = frozenset(
    {
        _C.NAV_WAYPOINT, _C.NAV_LOITER_UNLIM, _C.NAV_LOITER_TURNS, _C.NAV_LOITER_TIME, _C.NAV_LAND, _C.NAV_TAKEOFF,
        _C.NAV_LOITER_TO_ALT, _C.NAV_SPLINE_WAYPOINT, _C.NAV_VTOL_TAKEOFF, _C.NAV_VTOL_LAND, _C.DO_SET_ROI_LOCATION,
    }
)  # fmt: skip
_WHOLE = "ArduPilot stores this value as a whole number"
_UNUSED = "ArduPilot does not use this value"
_SIGN = "ArduPilot keeps only the sign of the radius here"
_EXIT = "ArduPilot stores this value as yes or no"
_LANDING = "ArduPilot keeps only the sign of a landing's fourth parameter, as 1 or -1 (seen with ArduCopter 4.7)"
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
    _rule("param4", {_C.NAV_LAND}, _turn_direction, _LANDING, math.inf),
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
    _rule("alt_m", _POSITIONS, _to_centimetres, "ArduPilot truncates altitudes to centimetres", 0.01001),
    *_drop(
        ("param2", "param3", "param4", "alt_m"), FENCE_COMMANDS, "ArduPilot keeps only the position and size of a fence"
    ),
    *_drop(("param1", "param2", "param3", "param4"), _RALLY, "ArduPilot keeps only the position of a rally point"),
    _rule("alt_m", _RALLY, _to_metres, "ArduPilot truncates rally altitudes to metres", 1.0),
)

ARDUPILOT_COPTER_STORAGE = _by_field(
    _rule("param1", {_C.NAV_WAYPOINT}, _whole_uint16, "ArduPilot stores a waypoint's hold time in whole seconds"),
    *_drop(("param2", "param3", "param4"), {_C.NAV_WAYPOINT}, "ArduPilot keeps only a waypoint's hold time"),
    *_ARDUPILOT_COMMON,
)
"""ArduPilot on multicopters, helicopters, rovers, boats and submarines."""

ARDUPILOT_PLANE_STORAGE = _by_field(
    _rule(
        "param1", {_C.NAV_WAYPOINT}, lambda _: 0.0, "ArduPilot planes do not hold at a waypoint; use a loiter item", 0.0
    ),
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


@dataclass(frozen=True, slots=True)
class Autopilot:
    """Treatment of missions by one autopilot."""

    name: str  # shown to the user
    mav_autopilot: AutopilotId  # its MAV_AUTOPILOT number in heartbeats
    firmware: Firmware  # which of its programs: each has flight mode numbers of its own
    home_in_item_0: bool  # whether item 0 of a mission is home (overwritten by the vehicle's own) or the first item
    frames: frozenset[Frame]  # the frames it takes for positions
    position_free_frames: frozenset[Frame]  # the frames it takes for commands without a position
    command_frame_returned: Frame  # the frame that such a command comes back with
    # whether items come back with the frames 5, 6 and 11, or with 0, 3 and 10 although their coordinates are integers
    returns_int_frames: bool
    storage: Storage  # changes of the numbers it stores, by field and command
    # whether that flag comes back as it was sent. If not, it comes back set, and not set from fences and rally points
    # (seen with ArduCopter 4.7).
    keeps_autocontinue: bool
    # for each command, the parameters (1 to 4) that may be NaN; key 0 is every other command
    nan_allowed: Mapping[int, frozenset[int]]
    refuses_bad_numbers: bool  # whether an item with an impossible number is refused, or taken as it is
    item_limit: int | None  # more items than this are refused (None: it depends on the board)
    # the parameter with the kilobytes of a memory card that missions are kept on instead (0: none is); None for no such
    # thing. See ``item_limits``.
    card_parameter: str | None
    legacy_requests: bool  # whether it asks for items with the deprecated MISSION_REQUEST
    rerequest_s: float  # it asks again after this silence
    give_up_s: float  # it ends an upload after this silence
    reports_give_up: bool  # whether it reports (with OPERATION_CANCELLED) that it gave up
    atomic: frozenset[MissionType]  # the lists that a failed upload leaves as they were
    busy_result: MissionResult  # its answer to the upload of a second ground station
    # answer to a request for a list or an item while another transfer keeps it out; None for nothing
    busy_request_result: MissionResult | None
    # what an emptying is answered meanwhile: ArduPilot says no twice, in two words
    busy_clear_results: tuple[MissionResult, ...]
    # the results with which a ground station ends its upload; others are ignored. ArduPilot 4.7 and PX4 1.17 say so in
    # their sources.
    stopped_by: frozenset[MissionResult]
    answers_in_floats: bool  # whether it answers the deprecated MISSION_REQUEST with the deprecated MISSION_ITEM
    clears_all_at_once: bool  # whether it empties all lists for mission_type 255; if not, it says UNSUPPORTED
    # whether an item is answered that comes from a station which began no transfer, or not the last
    answers_strangers: bool
    # whether a COUNT in the middle of an upload starts it over, and CLEAR_ALL of who uploads ends it; if not, COUNT is
    # answered ERROR
    count_restarts: bool
    wrong_sequence_result: MissionResult | None  # its answer to an unrequested item; None for none
    acks_repeated_last_item: bool  # whether the last item, sent again after the end, is acknowledged again
    idle_item_result: MissionResult | None  # what an item is answered when no upload is going on; None for nothing
    download_blocks_s: float  # time for which an unacknowledged download blocks uploads; 0 for none
    boot_refusal_s: float  # for how long after boot an upload is answered NO_SPACE
    # whether it tells an id of each list, in transfers and in MISSION_CURRENT, that changes with its content
    has_list_ids: bool
    # whether items of a list can be written over, the others being left as they are (MISSION_WRITE_PARTIAL_LIST)
    takes_parts: bool
    lists_as_files: bool  # whether its lists are files too, as ``mission_io.formats.wpl`` has them
    fences_cross_180: bool  # whether a fence polygon may cross the 180th meridian (PX4: insidePolygonUpdateState)

    def rule_for(self, item: MissionItem, field_name: str) -> StorageRule | None:
        """The storage rule for a field of an item, if any."""
        return self.storage.get((field_name, item.command))


def _as_in_data(section: str, storage: Storage, nan_allowed: Mapping[int, frozenset[int]]) -> Autopilot:
    """An autopilot with what ``data/autopilots.toml`` says of it."""
    path = "mission_io/data/autopilots.toml"
    row = read_document(path)[section]
    return table_of(Autopilot, row, where=f"{path}: {section}", storage=storage, nan_allowed=nan_allowed)


ARDUPILOT = _as_in_data(
    "ardupilot",
    ARDUPILOT_COPTER_STORAGE,
    {
        **dict.fromkeys((_C.NAV_WAYPOINT, _C.NAV_LAND, _C.NAV_TAKEOFF, _C.NAV_VTOL_TAKEOFF), frozenset({4})),
        _C.NAV_VTOL_LAND: frozenset({3, 4}),
    },
)
"""ArduPilot on multicopters and helicopters (ArduCopter)."""

ARDUPILOT_PLANE = replace(ARDUPILOT, name="ArduPilot (plane)", firmware=Firmware.PLANE, storage=ARDUPILOT_PLANE_STORAGE)
"""ArduPilot on fixed wings, with or without vertical take-off (ArduPlane)."""

ARDUPILOT_ROVER = replace(ARDUPILOT, name="ArduPilot (rover)", firmware=Firmware.ROVER)
"""ArduPilot on the ground and on water (Rover): it stores the same as a copter."""

ARDUPILOT_SUB = replace(ARDUPILOT, name="ArduPilot (submarine)", firmware=Firmware.SUB)
"""ArduPilot under water (ArduSub), assumed to store the same as a copter."""

ARDUPILOT_BLIMP = replace(ARDUPILOT, name="ArduPilot (airship)", firmware=Firmware.BLIMP)
"""ArduPilot on airships (Blimp), assumed to store the same as a copter."""

_ARDUPILOT_OTHER = replace(ARDUPILOT, name="ArduPilot (other)", firmware=Firmware.OTHER)
"""ArduPilot with an unknown MAV_TYPE: lists can be transferred, modes have no numbers."""

PX4 = _as_in_data("px4", PX4_STORAGE, {0: frozenset({1, 2, 3, 4})})
"""PX4."""

AUTOPILOTS = (ARDUPILOT, ARDUPILOT_PLANE, ARDUPILOT_ROVER, ARDUPILOT_SUB, ARDUPILOT_BLIMP, PX4)

_ARDUPILOT_OF_KIND: Mapping[VehicleKind, Autopilot] = {
    VehicleKind.MULTIROTOR: ARDUPILOT,
    VehicleKind.HELICOPTER: ARDUPILOT,
    VehicleKind.PLANE: ARDUPILOT_PLANE,
    VehicleKind.VTOL: ARDUPILOT_PLANE,
    VehicleKind.ROVER: ARDUPILOT_ROVER,
    VehicleKind.BOAT: ARDUPILOT_ROVER,
    VehicleKind.SUBMARINE: ARDUPILOT_SUB,
    VehicleKind.AIRSHIP: ARDUPILOT_BLIMP,
}


def autopilot_for(mav_autopilot: int, vehicle_type: int = VehicleClass.GENERIC) -> Autopilot:
    """The autopilot with a MAV_AUTOPILOT number, on a vehicle with a MAV_TYPE number.

    Raises:
        MisuseError: one that mission_io does not know.
    """
    if mav_autopilot == AutopilotId.PX4:
        return PX4
    if mav_autopilot != AutopilotId.ARDUPILOT:
        raise MisuseError(f"unknown autopilot {mav_autopilot}; mission_io supports ArduPilot (3) and PX4 (12)")
    if vehicle_type == VehicleClass.GENERIC:  # what ArduCopter says until it knows its frame
        return ARDUPILOT
    return _ARDUPILOT_OF_KIND.get(kind_of(vehicle_type), _ARDUPILOT_OTHER)


# Flight modes by meaning, with the numbers that PX4 and each ArduPilot vehicle use.


class Mode(Enum):
    """Purpose of a flight mode."""

    MANUAL = "manual"
    GUIDED = "guided"
    MISSION = "mission"
    HOLD = "hold"
    RETURN = "return"
    LAND = "land"


_MODES: Final[Mapping[Firmware, Mapping[Mode, tuple[int, ...]]]] = MappingProxyType(
    {
        Firmware[firmware]: {Mode[mode]: tuple(numbers) for mode, numbers in modes.items()}
        for firmware, modes in read_document("mission_io/data/flight_modes.toml").items()
    }
)
"""The requested number comes first."""


def custom_mode(autopilot: Autopilot, mode: Mode) -> int:
    """The heartbeat's ``custom_mode`` of a mode. Raises MisuseError: such a vehicle has no such mode."""
    numbers = _MODES.get(autopilot.firmware, {}).get(mode)
    if numbers is None:
        raise MisuseError(f"{autopilot.name} has no {mode.value} mode")
    return numbers[0]


def has_mode(autopilot: Autopilot, mode: Mode) -> bool:
    """Whether such a vehicle has a mode, as far as it is known here."""
    return mode in _MODES.get(autopilot.firmware, {})


def mode_from_custom(autopilot: Autopilot, number: int) -> Mode | None:
    """The mode of a heartbeat's ``custom_mode``; None for one that this package does not know."""
    modes = _MODES.get(autopilot.firmware, {})
    return next((mode for mode, numbers in modes.items() if number in numbers), None)


def mode_from_params(autopilot: Autopilot, params: tuple[float, ...]) -> Mode | None:
    """The mode that a DO_SET_MODE command requests: PX4 has main and sub mode in two parameters."""
    if autopilot.mav_autopilot == AutopilotId.PX4:
        return mode_from_custom(autopilot, int(params[1]) << 16 | int(params[2]) << 24)
    return mode_from_custom(autopilot, int(params[1]))

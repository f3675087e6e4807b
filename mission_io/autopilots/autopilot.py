"""Treatment of missions by ArduPilot and PX4, as data: conversion into their terms and wire lists.

Every fact was observed on a simulated vehicle of ArduCopter 4.7 or PX4 1.17, or read in their sources.

A vehicle keeps three lists: mission, fence and rally points. Each is an item list on the wire.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
from types import MappingProxyType
from typing import Final

from mission_io.autopilots.storage import (
    ARDUPILOT_COPTER_STORAGE,
    ARDUPILOT_PLANE_STORAGE,
    PX4_STORAGE,
    Storage,
    StorageRule,
)
from mission_io.data_tables import data_rows
from mission_io.errors import MisuseError
from mission_io.model.enums import AutopilotId, Firmware, MissionResult, VehicleClass
from mission_io.model.items import (
    Command,
    Frame,
    MissionItem,
    MissionType,
)

# Vehicle types: the numbers of MAV_TYPE, by name and by kind (multicopter, plane, rover, ...).


class VehicleKind(Enum):
    """Vehicles that move in the same way; the value is for people."""

    MULTIROTOR = "multirotor"
    HELICOPTER = "helicopter"
    PLANE = "plane"
    VTOL = "VTOL plane"
    ROVER = "rover"
    BOAT = "boat"
    SUBMARINE = "submarine"
    AIRSHIP = "airship"
    OTHER = "other vehicle"
    NO_VEHICLE = "part of a vehicle, or a station"


@dataclass(frozen=True, slots=True)
class _Type:
    number: int
    kind: VehicleKind


_TYPES: Final[Mapping[int, tuple[str, VehicleKind]]] = MappingProxyType(
    {
        row.number: (name, row.kind)
        for name, row in data_rows(_Type, "mission_io/data/vehicle_types.toml", "types").items()
    }
)
"""Name and kind of each MAV_TYPE."""

VEHICLE_TYPES: Final = tuple(_TYPES)
"""The numbers that have a name here."""


def type_name(vehicle_type: int) -> str:
    """The name of a MAV_TYPE number, for people and as :func:`parse_type` reads it.

    >>> type_name(2), type_name(22), type_name(200)
    ('quadrotor', 'vtol-fixedrotor', 'type 200')
    """
    known = _TYPES.get(vehicle_type)
    return f"type {vehicle_type}" if known is None else known[0]


def kind_of(vehicle_type: int) -> VehicleKind:
    """The kind of vehicle with a MAV_TYPE number; an unknown number is another vehicle."""
    known = _TYPES.get(vehicle_type)
    return VehicleKind.OTHER if known is None else known[1]


def parse_type(text: str) -> int:
    """The MAV_TYPE number of a vehicle's name; ``vtol`` is short for the most usual of them.

    Raises:
        MisuseError: no vehicle has that name; it says which names there are.
    """
    wanted = "vtol-fixedrotor" if text == "vtol" else text
    vehicles = {name: number for number, (name, kind) in _TYPES.items() if kind is not VehicleKind.NO_VEHICLE}
    if wanted not in vehicles:
        raise MisuseError(f"unknown vehicle type {text!r}; use one of {', '.join(vehicles)}")
    return vehicles[wanted]


@dataclass(frozen=True, slots=True)
class Autopilot:
    """Treatment of missions by one autopilot."""

    name: str  # for people
    mav_autopilot: AutopilotId  # its MAV_AUTOPILOT number in heartbeats
    firmware: Firmware  # which of its programs: each has flight mode numbers of its own
    home_in_item_0: bool  # whether item 0 of a mission is home (overwritten by the vehicle's own) or the first item
    frames: frozenset[Frame]  # the frames it takes for positions
    position_free_frames: frozenset[Frame]  # the frames it takes for commands without a position
    command_frame_returned: Frame  # the frame that such a command comes back with
    # whether items come back with the frames 5, 6 and 11, or with 0, 3 and 10 although their coordinates are integers
    returns_int_frames: bool
    storage: Storage  # what it changes in the numbers it stores, by field and command
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
    says_give_up: bool  # whether it tells (with OPERATION_CANCELLED) that it gave up
    atomic: frozenset[MissionType]  # the lists that a failed upload leaves as they were
    busy_result: MissionResult  # what a second ground station's upload is answered
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
    wrong_sequence_result: MissionResult | None  # what an item that was not asked for is answered; None for nothing
    acks_repeated_last_item: bool  # whether the last item, sent again after the end, is acknowledged again
    idle_item_result: MissionResult | None  # what an item is answered when no upload is going on; None for nothing
    download_blocks_s: float  # for how long a download that was not acknowledged keeps uploads out; 0 for not at all
    boot_refusal_s: float  # for how long after boot an upload is answered NO_SPACE
    # whether it tells an id of each list, in transfers and in MISSION_CURRENT, that changes with its content
    has_list_ids: bool
    # whether items of a list can be written over, the others being left as they are (MISSION_WRITE_PARTIAL_LIST)
    takes_parts: bool
    lists_as_files: bool  # whether its lists are files too, as ``mission_io.wire.mission_items`` has them

    def rule_for(self, item: MissionItem, field_name: str) -> StorageRule | None:
        """The storage rule for a field of an item, if any."""
        return self.storage.get((field_name, item.command))


ARDUPILOT = Autopilot(
    name="ArduPilot",
    mav_autopilot=AutopilotId.ARDUPILOT,
    firmware=Firmware.COPTER,
    home_in_item_0=True,
    frames=frozenset({Frame.AMSL, Frame.ABOVE_HOME, Frame.ABOVE_TERRAIN}),
    position_free_frames=frozenset(Frame),
    command_frame_returned=Frame.AMSL,
    returns_int_frames=False,
    storage=ARDUPILOT_COPTER_STORAGE,
    keeps_autocontinue=False,
    nan_allowed={
        Command.NAV_WAYPOINT: frozenset({4}),
        Command.NAV_LAND: frozenset({4}),
        Command.NAV_TAKEOFF: frozenset({4}),
        Command.NAV_VTOL_TAKEOFF: frozenset({4}),
        Command.NAV_VTOL_LAND: frozenset({3, 4}),
    },
    refuses_bad_numbers=True,
    item_limit=650,
    card_parameter="BRD_SD_MISSION",
    legacy_requests=True,
    rerequest_s=1.0,
    give_up_s=8.0,
    says_give_up=True,
    atomic=frozenset({MissionType.FENCE}),
    busy_result=MissionResult.DENIED,
    busy_request_result=MissionResult.DENIED,
    busy_clear_results=(MissionResult.DENIED, MissionResult.ERROR),
    stopped_by=frozenset(),
    answers_in_floats=True,
    clears_all_at_once=False,
    answers_strangers=True,
    count_restarts=True,
    wrong_sequence_result=MissionResult.INVALID_SEQUENCE,
    acks_repeated_last_item=False,
    idle_item_result=MissionResult.ERROR,
    download_blocks_s=0.0,
    boot_refusal_s=2.0,
    has_list_ids=False,
    takes_parts=True,
    lists_as_files=True,
)
"""ArduPilot on multicopters and helicopters (ArduCopter)."""

ARDUPILOT_PLANE = replace(ARDUPILOT, name="ArduPilot (plane)", firmware=Firmware.PLANE, storage=ARDUPILOT_PLANE_STORAGE)
"""ArduPilot on fixed wings, with or without vertical take-off (ArduPlane)."""

ARDUPILOT_ROVER = replace(ARDUPILOT, name="ArduPilot (rover)", firmware=Firmware.ROVER)
"""ArduPilot on the ground and on water (Rover): it stores what a copter does."""

ARDUPILOT_SUB = replace(ARDUPILOT, name="ArduPilot (submarine)", firmware=Firmware.SUB)
"""ArduPilot under water (ArduSub), taken to store what a copter does."""

ARDUPILOT_BLIMP = replace(ARDUPILOT, name="ArduPilot (airship)", firmware=Firmware.BLIMP)
"""ArduPilot on airships (Blimp), taken to store what a copter does."""

_ARDUPILOT_OTHER = replace(ARDUPILOT, name="ArduPilot (other)", firmware=Firmware.OTHER)
"""ArduPilot on what has a MAV_TYPE of which nothing is known: lists can be transferred, modes have no numbers."""

PX4 = Autopilot(
    name="PX4",
    mav_autopilot=AutopilotId.PX4,
    firmware=Firmware.PX4,
    home_in_item_0=False,
    frames=frozenset({Frame.AMSL, Frame.ABOVE_HOME}),
    position_free_frames=frozenset({Frame.COMMAND}),
    command_frame_returned=Frame.COMMAND,
    returns_int_frames=True,
    storage=PX4_STORAGE,
    keeps_autocontinue=True,
    nan_allowed={0: frozenset({1, 2, 3, 4})},
    refuses_bad_numbers=False,
    item_limit=None,
    card_parameter=None,
    legacy_requests=False,
    rerequest_s=0.25,
    give_up_s=5.0,
    says_give_up=False,
    atomic=frozenset(MissionType),
    busy_result=MissionResult.ERROR,
    busy_request_result=None,
    busy_clear_results=(),
    stopped_by=frozenset({MissionResult.OPERATION_CANCELLED}),
    answers_in_floats=True,
    clears_all_at_once=True,
    answers_strangers=False,
    count_restarts=False,
    wrong_sequence_result=None,
    acks_repeated_last_item=True,
    idle_item_result=MissionResult.ERROR,
    download_blocks_s=5.3,
    boot_refusal_s=0.0,
    has_list_ids=True,
    takes_parts=False,
    lists_as_files=False,
)
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

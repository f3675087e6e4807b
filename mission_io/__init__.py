"""Read, check, convert, upload, download and compare MAVLink missions.

Files: ``read_mission``, ``write_mission`` and ``read_file``. Vehicles: ``open_link`` with ``Client``, or ``AsyncClient``
under asyncio. Changes: ``diff`` and ``apply_diff``. To be a vehicle: ``MissionServer``. See docs/reference/mission_io.md.

The names exported here are the public API, loaded when they are first used. Everything else may change without notice.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mission_io.autopilots.autopilot import (
        ARDUPILOT,
        ARDUPILOT_PLANE,
        ARDUPILOT_ROVER,
        PX4,
        Autopilot,
        autopilot_for,
    )
    from mission_io.autopilots.comparison import Difference, MissionDiff, apply_diff, compare_items, diff
    from mission_io.autopilots.mission_lists import (
        MissionList,
        Problem,
        check_for_autopilot,
        items_of,
        mission_from_wire,
        mission_list_of,
        mission_type_of,
        wire_items,
    )
    from mission_io.client.async_client import AsyncClient
    from mission_io.client.client import Client
    from mission_io.client.commands import VehicleParameters
    from mission_io.client.mission_control import ItemProgress
    from mission_io.client.peers import VehicleInfo
    from mission_io.client.transfer_outcome import ReadBack
    from mission_io.errors import (
        AmbiguousVehicleError,
        CommandRefusedError,
        FormatError,
        LinkError,
        MissionIoError,
        MisuseError,
        TransferCancelledError,
        TransferError,
        TransferInterrupted,
        TransferSilentError,
        VehicleSilentError,
        WaitCancelledError,
    )
    from mission_io.formats.files import read_file, read_mission, write_mission
    from mission_io.formats.text import MissionFile
    from mission_io.links.datagrams import Link, UdpLink
    from mission_io.links.opening import open_link, register_endpoint
    from mission_io.links.simulated import LINK_PRESETS, LinkPreset, link_preset
    from mission_io.model.actions import Action, action_of, item_of
    from mission_io.model.items import (
        Command,
        Fence,
        FenceCircle,
        FencePolygon,
        Frame,
        FramedPoint,
        GeoPoint,
        LatLon,
        Mission,
        MissionItem,
        MissionType,
        RallyPoints,
        SpeedType,
        change_speed,
        delay,
        land,
        look_ahead,
        look_at,
        return_to_launch,
        takeoff,
        trigger_camera_every,
        waypoint,
    )
    from mission_io.protocol.parameters import Parameter
    from mission_io.protocol.server import ListChanged, MissionServer
    from mission_io.protocol.timing import Timing
    from mission_io.wire.codec import LinkStatistics
    from mission_io.wire.messages import Address
    from mission_io.wire.signing import SigningKey

__all__ = [
    "ARDUPILOT", "ARDUPILOT_PLANE", "ARDUPILOT_ROVER", "LINK_PRESETS", "PX4", "Action", "Address",
    "AmbiguousVehicleError", "AsyncClient", "Autopilot", "Client", "Command", "CommandRefusedError", "Difference",
    "Fence", "FenceCircle", "FencePolygon", "FormatError", "Frame", "FramedPoint", "GeoPoint", "ItemProgress", "LatLon",
    "Link", "LinkError", "LinkPreset", "LinkStatistics", "ListChanged", "Mission", "MissionDiff", "MissionFile",
    "MissionIoError", "MissionItem", "MissionList", "MissionServer", "MissionType", "MisuseError", "Parameter",
    "Problem", "RallyPoints", "ReadBack", "SigningKey", "SpeedType", "Timing", "TransferCancelledError",
    "TransferError", "TransferInterrupted", "TransferSilentError", "UdpLink", "VehicleInfo", "VehicleParameters",
    "VehicleSilentError", "WaitCancelledError", "action_of", "apply_diff", "autopilot_for", "change_speed",
    "check_for_autopilot", "compare_items", "delay", "diff", "item_of", "items_of", "land", "link_preset", "look_ahead",
    "look_at", "mission_from_wire", "mission_list_of", "mission_type_of", "open_link", "read_file", "read_mission",
    "register_endpoint", "return_to_launch", "takeoff", "trigger_camera_every", "waypoint", "wire_items",
    "write_mission",
]  # fmt: skip

_MODULES = {
    "mission_io.autopilots.autopilot": (
        "ARDUPILOT", "ARDUPILOT_PLANE", "ARDUPILOT_ROVER", "PX4", "Autopilot", "autopilot_for",
    ),
    "mission_io.autopilots.comparison": ("Difference", "MissionDiff", "apply_diff", "compare_items", "diff"),
    "mission_io.autopilots.mission_lists": (
        "MissionList", "Problem", "check_for_autopilot", "items_of", "mission_from_wire", "mission_list_of",
        "mission_type_of", "wire_items",
    ),
    "mission_io.client.async_client": ("AsyncClient",),
    "mission_io.client.client": ("Client",),
    "mission_io.client.commands": ("VehicleParameters",),
    "mission_io.client.mission_control": ("ItemProgress",),
    "mission_io.client.peers": ("VehicleInfo",),
    "mission_io.client.transfer_outcome": ("ReadBack",),
    "mission_io.errors": (
        "AmbiguousVehicleError", "CommandRefusedError", "FormatError", "LinkError", "MissionIoError", "MisuseError",
        "TransferCancelledError", "TransferError", "TransferInterrupted", "TransferSilentError", "VehicleSilentError",
        "WaitCancelledError",
    ),
    "mission_io.formats.files": ("read_file", "read_mission", "write_mission"),
    "mission_io.formats.text": ("MissionFile",),
    "mission_io.links.datagrams": ("Link", "UdpLink"),
    "mission_io.links.opening": ("open_link", "register_endpoint"),
    "mission_io.links.simulated": ("LINK_PRESETS", "LinkPreset", "link_preset"),
    "mission_io.model.actions": ("Action", "action_of", "item_of"),
    "mission_io.model.items": (
        "Command", "Fence", "FenceCircle", "FencePolygon", "Frame", "FramedPoint", "GeoPoint", "LatLon", "Mission",
        "MissionItem", "MissionType", "RallyPoints", "SpeedType", "change_speed", "delay", "land", "look_ahead",
        "look_at", "return_to_launch", "takeoff", "trigger_camera_every", "waypoint",
    ),
    "mission_io.protocol.parameters": ("Parameter",),
    "mission_io.protocol.server": ("ListChanged", "MissionServer"),
    "mission_io.protocol.timing": ("Timing",),
    "mission_io.wire.codec": ("LinkStatistics",),
    "mission_io.wire.messages": ("Address",),
    "mission_io.wire.signing": ("SigningKey",),
}  # fmt: skip
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    """The public names, each loaded on first use."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_MODULE_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

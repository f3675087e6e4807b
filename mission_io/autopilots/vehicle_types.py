"""Vehicle types: the numbers of MAV_TYPE, by name and by kind (multicopter, plane, rover, ...)."""

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType
from typing import Final

from mission_io.errors import MisuseError


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


_M, _V, _N = VehicleKind.MULTIROTOR, VehicleKind.VTOL, VehicleKind.NO_VEHICLE

_TYPES: Final[Mapping[int, tuple[str, VehicleKind]]] = MappingProxyType(
    {
        0: ("generic", VehicleKind.OTHER),
        1: ("plane", VehicleKind.PLANE),
        2: ("quadrotor", _M),
        3: ("coaxial", _M),
        4: ("helicopter", VehicleKind.HELICOPTER),
        5: ("antenna-tracker", VehicleKind.OTHER),
        6: ("ground-station", _N),
        7: ("airship", VehicleKind.AIRSHIP),
        8: ("balloon", VehicleKind.OTHER),
        9: ("rocket", VehicleKind.OTHER),
        10: ("rover", VehicleKind.ROVER),
        11: ("boat", VehicleKind.BOAT),
        12: ("submarine", VehicleKind.SUBMARINE),
        13: ("hexarotor", _M),
        14: ("octorotor", _M),
        15: ("tricopter", _M),
        16: ("flapping-wing", VehicleKind.OTHER),
        17: ("kite", VehicleKind.OTHER),
        18: ("onboard-controller", _N),
        19: ("vtol-tailsitter-duorotor", _V),
        20: ("vtol-tailsitter-quadrotor", _V),
        21: ("vtol-tiltrotor", _V),
        22: ("vtol-fixedrotor", _V),
        23: ("vtol-tailsitter", _V),
        24: ("vtol-tiltwing", _V),
        25: ("vtol-reserved", _V),
        26: ("gimbal", _N),
        27: ("adsb", _N),
        28: ("parafoil", VehicleKind.OTHER),
        29: ("dodecarotor", _M),
        30: ("camera", _N),
        31: ("charging-station", _N),
        32: ("flarm", _N),
        33: ("servo", _N),
        34: ("remote-id", _N),
        35: ("decarotor", _M),
        36: ("battery", _N),
        37: ("parachute", _N),
        38: ("log", _N),
        39: ("osd", _N),
        40: ("imu", _N),
        41: ("gps", _N),
        42: ("winch", _N),
        43: ("multirotor", _M),
        44: ("illuminator", _N),
        45: ("spacecraft", VehicleKind.OTHER),
        46: ("walking-robot", VehicleKind.ROVER),
        47: ("vtol-gyrodyne", _V),
        48: ("gripper", _N),
    }
)
"""Name and kind of each MAV_TYPE, from common.xml of MAVLink."""

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
        raise MisuseError(f"vehicle type {text!r} is not known; take one of {', '.join(vehicles)}")
    return vehicles[wanted]

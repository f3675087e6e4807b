"""Vehicle types: the numbers of MAV_TYPE, by name and by kind (multicopter, plane, rover, ...)."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType
from typing import Final

from mission_io.data_tables import data_rows
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
        raise MisuseError(f"vehicle type {text!r} is not known; use one of {', '.join(vehicles)}")
    return vehicles[wanted]

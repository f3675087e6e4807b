"""Vehicles by name or from a file: speeds, acceleration and time in the air."""

from dataclasses import dataclass
from typing import Any

from uavcover.errors import InputError
from uavcover.model.vehicle import AutopilotName
from uavcover.new.catalog import checked_row, number_of, read_catalog, read_row

_NUMBERS = (
    "endurance_s", "cruise_speed_m_s", "max_speed_m_s", "max_climb_m_s", "max_descent_m_s", "acceleration_m_s2",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class VehicleType:
    """A multirotor as its data sheet has it; None where that says nothing.

    Attributes:
        name: in the table, or of the file.
        title: for people.
        endurance_s: longest time in the air.
        cruise_speed_m_s: usual speed over ground.
        max_speed_m_s: largest speed over ground in still air.
        max_climb_m_s: largest upward speed.
        max_descent_m_s: largest downward speed.
        acceleration_m_s2: over ground.
        autopilot: whose conventions it follows.
        source: where the values are from.
    """

    name: str
    title: str
    endurance_s: float | None = None
    cruise_speed_m_s: float | None = None
    max_speed_m_s: float | None = None
    max_climb_m_s: float | None = None
    max_descent_m_s: float | None = None
    acceleration_m_s2: float | None = None
    autopilot: AutopilotName | None = None
    source: str = ""


def all_vehicles() -> tuple[VehicleType, ...]:
    """The vehicles of the table."""
    rows = read_catalog("vehicles.toml")
    return tuple(_vehicle(name, row, where=f"vehicles.toml: {name}") for name, row in rows.items())


def vehicle_named(name: str) -> VehicleType:
    """A vehicle of the table, or of a TOML file of people's own.

    Raises:
        InputError: it is not known, or the file's values are not a vehicle's.
    """
    found, row, where = read_row(name, table="vehicles.toml", option="--vehicle")
    return _vehicle(found, row, where=where)


def _vehicle(name: str, row: dict[str, Any], *, where: str) -> VehicleType:
    checked_row(row, where=where, required=(), optional=(*_NUMBERS, "autopilot"))
    numbers = {key: number_of(row, key, where=where) for key in _NUMBERS}
    autopilot = row.get("autopilot")
    match autopilot:
        case None | "ardupilot" | "px4":
            return VehicleType(
                name, str(row["title"]), autopilot=autopilot, source=str(row.get("source", "")), **numbers
            )
    raise InputError(f"{where}: autopilot: {autopilot!r} is not known; use ardupilot or px4")

"""Aircraft that fly DJI's WPML, by name or from a file, with the numbers that the format has for them."""

from typing import Any

from mission_io.formats.wpml import IMAGE_FORMATS, DjiAircraft
from uavcover.errors import InputError
from uavcover.new.catalog import checked_row, number_of, read_catalog, read_row

_TABLE = "dji.toml"
_KEYS = ("drone", "payload", "payload_position", "image_format", "pitch_range_deg", "max_speed_m_s")


def all_dji_aircraft() -> dict[str, DjiAircraft]:
    """The aircraft of the table, by name."""
    return {name: _aircraft(row, where=f"{_TABLE}: {name}") for name, row in read_catalog(_TABLE).items()}


def dji_aircraft_named(name: str) -> DjiAircraft:
    """An aircraft of the table, or of a TOML file of people's own.

    Raises:
        InputError: it is not known, or the file's values are not an aircraft's.
    """
    _, row, where = read_row(name, table=_TABLE, option="--drone", command="export")
    return _aircraft(row, where=where)


def _aircraft(row: dict[str, Any], *, where: str) -> DjiAircraft:
    checked_row(row, where=where, required=_KEYS, optional=())
    lenses = str(row["image_format"])
    unknown = [lens for lens in lenses.split(",") if lens not in IMAGE_FORMATS]
    if unknown:
        raise InputError(f"{where}: image_format: {unknown[0]!r} is not one of {', '.join(IMAGE_FORMATS)}")
    low_deg, high_deg = (_number(value, "pitch_range_deg", where) for value in _two(row, "pitch_range_deg", where))
    if not -180.0 <= low_deg < high_deg <= 180.0:
        raise InputError(f"{where}: pitch_range_deg: give the lowest angle, then the highest, such as [-90, 30]")
    kind, subkind = (_whole(value, "drone", where) for value in _two(row, "drone", where))
    speed_m_s = number_of(row, "max_speed_m_s", where=where)
    return DjiAircraft(
        title=str(row["title"]),
        drone=(kind, subkind),
        payload=_whole(row["payload"], "payload", where),
        payload_position=_whole(row["payload_position"], "payload_position", where),
        image_format=lenses,
        pitch_range_deg=(low_deg, high_deg),
        max_speed_m_s=0.0 if speed_m_s is None else speed_m_s,
    )


def _two(row: dict[str, Any], key: str, where: str) -> list[Any]:
    value = row[key]
    if not isinstance(value, list) or len(value) != 2:
        raise InputError(f"{where}: {key}: {value!r} is not two numbers")
    return value


def _whole(value: Any, key: str, where: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= 65535:
        raise InputError(f"{where}: {key}: {value!r} is not a whole number from 0 to 65535")
    return value


def _number(value: Any, key: str, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{where}: {key}: {value!r} is not a number")
    return float(value)

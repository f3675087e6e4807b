"""Tables of products that come with the package: rows by name, near misses, and files of people's own."""

import difflib
import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mission_io.data_tables import read_document
from uavcover.errors import InputError
from uavcover.model.vehicle import AutopilotName
from uavcover.new.tuning import SURVEY

_LONGEST_BITS = 1000
_MOST_NAMES = 8


def read_catalog(name: str) -> dict[str, dict[str, Any]]:
    """The rows of a table in ``uavcover/data``, by name."""
    return dict(read_document(f"uavcover/data/{name}"))


def read_row(name: str, *, table: str, option: str, command: str = "new") -> tuple[str, dict[str, Any], str]:
    """A row of a table in ``uavcover/data``, or of a TOML file of people's own.

    Args:
        name: what the user wrote.
        table: its file.
        option: that takes the name.
        command: whose ``list`` shows the table.

    Returns:
        Its name, its keys, and where it stands, for errors.

    Raises:
        InputError: it is not known, or the file cannot be read.
    """
    if name.lower().endswith(".toml"):
        return Path(name).stem, read_own_row(Path(name), option=option), f"{option}: {name}"
    rows = read_catalog(table)
    found = find_name(name, rows, option=option, command=command)
    return found, rows[found], f"{table}: {found}"


def read_own_row(path: Path, *, option: str) -> dict[str, Any]:
    """A row of people's own: the keys of a TOML file, or of its only table.

    Raises:
        InputError: the file cannot be read, or has several tables.
    """
    try:
        row = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{option}: cannot read {path} ({type(error).__name__}); use a name or a TOML file") from error
    except (ValueError, RecursionError) as error:  # ValueError also of numbers with thousands of digits
        raise InputError(
            f"{option}: {path}: the file is not valid TOML: {error}; to show the known names, use {option} list"
        ) from error
    if _has_huge(row):
        raise InputError(
            f"{option}: {path}: the file has a number with hundreds of digits; to show the known names, use {option} list"
        )
    tables = [key for key, value in row.items() if isinstance(value, dict)]
    if len(tables) == 1 == len(row):
        return {"title": tables[0], **row[tables[0]]}
    if tables:
        raise InputError(f"{option}: {path} has several tables ({', '.join(tables[:_MOST_NAMES])}); keep only one")
    return {"title": path.stem, **row}


def _has_huge(value: object) -> bool:
    """Whether a whole number is too long to be shown: hexadecimal ones may have any length."""
    if isinstance(value, dict):
        return any(map(_has_huge, value.values()))
    if isinstance(value, list):
        return any(map(_has_huge, value))
    return isinstance(value, int) and value.bit_length() > _LONGEST_BITS


def find_name(wanted: str, rows: Mapping[str, Mapping[str, Any]], *, option: str, command: str = "new") -> str:
    """Find the row of a name, in any case and with any spaces and hyphens; also by title and alias.

    Args:
        wanted: what the user wrote.
        rows: the table.
        option: that takes the name.
        command: whose ``list`` shows the table.

    Raises:
        InputError: there is none; says what is near.
    """
    known = {_plain(name): name for name in rows}
    for name, row in rows.items():
        for other in (row["title"], *row.get("aliases", ())):
            known.setdefault(_plain(other), name)
    plain = _plain(wanted)
    if plain in known:
        return known[plain]
    near = [name for key, name in known.items() if plain and key.startswith(plain)]
    near += [known[key] for key in difflib.get_close_matches(plain, known, n=_MOST_NAMES, cutoff=0.6)]
    near += [name for key, name in known.items() if len(plain) >= 3 and plain in key]
    shown = list(dict.fromkeys(near))[:_MOST_NAMES]
    advice = f"did you mean {' or '.join(shown)}?" if shown else "the name of your own TOML file must end in .toml"
    raise InputError(f"{option}: unknown name {wanted!r}; {advice} (see uavcover {command} {option} list)")


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9+.]", "", name.casefold())


def checked_row(row: Mapping[str, Any], *, where: str, required: tuple[str, ...], optional: tuple[str, ...]) -> None:
    """Check the keys of a row. Raises InputError: one is missing or not known."""
    known = (*required, *optional, "title", "aliases", "source")
    unknown = [key for key in row if key not in known]
    if unknown:
        close = difflib.get_close_matches(unknown[0], known, n=1)
        advice = f"did you mean {close[0]}?" if close else f"known: {', '.join(known)}"
        raise InputError(f"{where}: {unknown[0]}: unknown key; {advice}")
    missing = [key for key in required if key not in row]
    if missing:
        raise InputError(f"{where}: {missing[0]}: the key is missing; required keys are {', '.join(required)}")


def number_of(row: Mapping[str, Any], key: str, *, where: str) -> float | None:
    """A positive number of a row; none when it is not there. Raises InputError: it is not a positive number."""
    value = row.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < 1e9:
        raise InputError(f"{where}: {key}: must be a number above 0, not {value!r} (its unit is in the key's name)")
    return float(value)


def pair_of(row: Mapping[str, Any], key: str, *, where: str) -> tuple[float, float]:
    """Two positive numbers of a row. Raises InputError: it is not two positive numbers."""
    value = row[key]
    if not isinstance(value, list) or len(value) != 2:
        raise InputError(f"{where}: {key}: must be two numbers, across and along the photo, not {value!r}")
    first, second = (number_of({key: number}, key, where=where) for number in value)
    if first is None or second is None:
        raise InputError(f"{where}: {key}: two numbers are required: first across the photo, then along it")
    return first, second


# Vehicles by name or from a file: speeds, acceleration and time in the air.

_NUMBERS = (
    "endurance_s", "cruise_speed_m_s", "max_speed_m_s", "max_climb_m_s", "max_descent_m_s", "acceleration_m_s2",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class VehicleType:
    """A multirotor as its data sheet has it; None where that says nothing."""

    name: str  # in the table, or of the file
    title: str  # for people
    endurance_s: float | None = None  # longest time in the air
    cruise_speed_m_s: float | None = None  # usual speed over ground
    max_speed_m_s: float | None = None  # largest speed over ground in still air
    max_climb_m_s: float | None = None  # largest upward speed
    max_descent_m_s: float | None = None  # largest downward speed
    acceleration_m_s2: float | None = None  # over ground
    autopilot: AutopilotName | None = None  # whose conventions it follows
    source: str = ""  # where the values are from


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
    raise InputError(f"{where}: autopilot: must be ardupilot or px4, not {autopilot!r}")


# Cameras by name or from a file: sensor, pixels, lens, and how fast they take photos.

_REQUIRED = ("sensor_mm", "pixels", "focal_length_mm")
_OPTIONAL = ("min_interval_s",)


@dataclass(frozen=True, slots=True)
class CameraBody:
    """A camera with its lens, in landscape: the longer side of the photo across the way it is flown."""

    name: str  # in the table, or of the file
    title: str  # for people
    sensor_across_mm: float  # longer side of the sensor's part that makes the photo
    sensor_along_mm: float  # shorter side
    pixels_across: int  # pixels along the longer side
    pixels_along: int  # along the shorter side
    focal_length_mm: float  # of the lens
    min_interval_s: float | None = None  # shortest time between two photos; none: unknown
    source: str = ""  # where the values are from

    @property
    def fov_across_deg(self) -> float:
        """Full angle between the left and the right side of the photo."""
        return 2.0 * math.degrees(math.atan(0.5 * self.sensor_across_mm / self.focal_length_mm))

    @property
    def fov_along_deg(self) -> float:
        """Full angle between its bottom and its top."""
        return 2.0 * math.degrees(math.atan(0.5 * self.sensor_along_mm / self.focal_length_mm))

    @property
    def focal_px(self) -> float:
        """Focal length in pixels."""
        return self.focal_length_mm / self.sensor_across_mm * self.pixels_across


def all_cameras() -> tuple[CameraBody, ...]:
    """The cameras of the table."""
    return tuple(
        _camera(name, row, where=f"cameras.toml: {name}") for name, row in read_catalog("cameras.toml").items()
    )


def camera_named(name: str) -> CameraBody:
    """A camera of the table, or of a TOML file of people's own.

    Raises:
        InputError: it is not known, or the file's values are not a camera's.
    """
    found, row, where = read_row(name, table="cameras.toml", option="--camera")
    return _camera(found, row, where=where)


def _camera(name: str, row: dict[str, Any], *, where: str) -> CameraBody:
    checked_row(row, where=where, required=_REQUIRED, optional=_OPTIONAL)
    width, height = pair_of(row, "sensor_mm", where=where)
    across, along = pair_of(row, "pixels", where=where)
    focal = number_of(row, "focal_length_mm", where=where)
    if focal is None or across != int(across) or along != int(along):
        raise InputError(f"{where}: pixels: must be whole numbers, across and along the photo, not {row['pixels']}")
    if abs(width / across / (height / along) - 1.0) > SURVEY.largest_pitch_difference:
        raise InputError(
            f"{where}: pixels of {1000.0 * width / across:.2f} x {1000.0 * height / along:.2f} um are not square, so "
            "sensor_mm and pixels do not match; specify both in landscape, for the same photo format"
        )
    interval = number_of(row, "min_interval_s", where=where)
    camera = CameraBody(
        name, str(row["title"]), width, height, int(across), int(along), focal, interval, str(row.get("source", ""))
    )
    if not 3.0 <= camera.fov_across_deg <= 140.0:
        raise InputError(
            f"{where}: the field of view of {camera.fov_across_deg:.1f} degrees across is implausible; use the real "
            "focal length in millimetres, not the 35 mm equivalent"
        )
    return camera

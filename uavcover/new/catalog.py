"""Tables of cameras, vehicles and detection curves: rows by name, near misses, and files of people's own."""

import difflib
import math
import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar

import numpy as np

from mission_io.data_tables import read_document
from uavcover.errors import InputError
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.coverage import DetectionTable, detection_table
from uavcover.model.vehicle import AutopilotName
from uavcover.new.quantities import SURVEY

_LONGEST_BITS = 1000
_MOST_NAMES = 8


Entry = TypeVar("Entry")


@dataclass(frozen=True, slots=True)
class Catalog(Generic[Entry]):
    """A table in ``uavcover/data`` whose rows people name; or they describe their own in a TOML file."""

    table: str  # its file
    option: str  # that takes the name
    entry_of: Callable[
        [str, Mapping[str, Any], str], Entry
    ]  # from a row's name, its keys, and where it stands, for errors
    command: str = "new"  # whose ``list`` shows the table

    def by_name(self) -> dict[str, Entry]:
        """Every entry of the table."""
        rows = read_document(f"uavcover/data/{self.table}")
        return {name: self.entry_of(name, row, f"{self.table}: {name}") for name, row in rows.items()}

    def named(self, name: str) -> Entry:
        """An entry of the table, or of a TOML file of people's own.

        Raises:
            InputError: it is not known, or the values in the file cannot be used.
        """
        if name.lower().endswith(".toml"):
            row = read_own_row(Path(name), option=self.option)
            return self.entry_of(Path(name).stem, row, f"{self.option}: {name}")
        rows = read_document(f"uavcover/data/{self.table}")
        found = find_name(name, rows, option=self.option, command=self.command)
        return self.entry_of(found, rows[found], f"{self.table}: {found}")


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


def find_name(wanted: str, rows: Mapping[str, Mapping[str, Any]], *, option: str, command: str) -> str:
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
    """A positive number of a row; None when it is not there. Raises InputError: it is not a positive number."""
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
    title: str  # shown to the user
    endurance_s: float | None = None  # longest time in the air
    cruise_speed_m_s: float | None = None  # usual speed over ground
    max_speed_m_s: float | None = None  # largest speed over ground in still air
    max_climb_m_s: float | None = None  # largest upward speed
    max_descent_m_s: float | None = None  # largest downward speed
    acceleration_m_s2: float | None = None  # over ground
    return_height_m: float | None = None  # height above home of the autopilot's own return
    autopilot: AutopilotName | None = None  # whose conventions it follows
    source: str = ""  # where the values are from


def _vehicle(name: str, row: Mapping[str, Any], where: str) -> VehicleType:
    checked_row(row, where=where, required=(), optional=(*_NUMBERS, "autopilot"))
    numbers = {key: number_of(row, key, where=where) for key in _NUMBERS}
    autopilot = row.get("autopilot")
    match autopilot:
        case None | "ardupilot" | "px4":
            return VehicleType(
                name, str(row["title"]), autopilot=autopilot, source=str(row.get("source", "")), **numbers
            )
    raise InputError(f"{where}: autopilot: must be ardupilot or px4, not {autopilot!r}")


VEHICLES = Catalog("vehicles.toml", "--vehicle", _vehicle)


# Cameras by name or from a file: sensor, pixels, lens, and how fast they take photos.

_REQUIRED = ("sensor_mm", "pixels", "focal_length_mm")
_OPTIONAL = ("min_interval_s",)


@dataclass(frozen=True, slots=True)
class CameraBody:
    """A camera with its lens, in landscape: the longer side of the photo across the way it is flown."""

    name: str  # in the table, or of the file
    title: str  # shown to the user
    sensor_across_mm: float  # longer side of the sensor's part that makes the photo
    sensor_along_mm: float  # shorter side
    pixels_across: int  # pixels along the longer side
    pixels_along: int  # along the shorter side
    focal_length_mm: float  # of the lens
    min_interval_s: float | None = None  # shortest time between two photos; None: unknown
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


def _camera(name: str, row: Mapping[str, Any], where: str) -> CameraBody:
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


CAMERAS = Catalog("cameras.toml", "--camera", _camera)


Independent = Literal["sides", "pictures", "none"]
INDEPENDENT: tuple[Independent, ...] = ("sides", "pictures", "none")


@dataclass(frozen=True, slots=True, eq=False)
class DetectionCurve:
    """The probability that a look finds the target, over ground sample distance and angle off the vertical."""

    name: str  # in the table that comes with the package, or of the file
    title: str  # shown to the user
    source: str  # where the values are from
    table: DetectionTable  # of it
    # which looks at one place count as independent chances: the best from each side (``sides``), every photo
    # (``photos``), or only the best of all (``none``)
    independent: Independent = "sides"
    # whether it comes with the package: a rule of thumb that was not measured for these photos
    is_example: bool = False

    @property
    def half_at_m(self) -> float:
        """The coarsest ground sample distance with which half of the looks straight down find the target; NaN: none."""
        found = np.flatnonzero(self.table.probability[0] >= 0.5)
        return float(self.table.sample_m[found[-1]]) if found.size else float("nan")


def noticed(ratio: FloatArray) -> FloatArray:
    """Share of observers who notice a target, by pixels across it over those with which half of them do.

    The target transfer probability function of ACQUIRE and NVTherm (U.S. Army NVESD, NVTherm manual, 2001): r^E / (1 + r^E) with
    E = 2.7 + 0.7 r.

    >>> noticed(np.array([0.5, 1.0, 2.0])).round(3).tolist()
    [0.108, 0.5, 0.945]
    """
    with np.errstate(over="ignore", under="ignore"):
        return 1.0 / (1.0 + ratio ** -(2.7 + 0.7 * ratio))


def _curve(name: str, row: Mapping[str, Any], where: str) -> DetectionCurve:
    if "probability" in row:
        checked_row(
            row, where=where, required=("ground_sample_m", "probability"), optional=("off_vertical_deg", "independent")
        )
        table = _own_table(row, where=where)
    else:
        optional = ("pixels_for_half", "found_at_best", "hidden_from_above", "independent")
        checked_row(row, where=where, required=("target_m",), optional=optional)
        table = _by_pixels(row, where=where)
    independent = row.get("independent", "sides")
    if independent not in INDEPENDENT:
        raise InputError(f"{where}: independent: unknown value {independent!r}; use one of {', '.join(INDEPENDENT)}")
    title, source = str(row.get("title", name)), str(row.get("source", ""))
    is_own = where.startswith(_DETECTION)
    return DetectionCurve(name, title, source, table, independent, is_example=not is_own)


_DETECTION = "--detection"
CURVES = Catalog("detection.toml", _DETECTION, _curve, command="judge-photos")


def _by_pixels(row: Mapping[str, Any], *, where: str) -> DetectionTable:
    target_m = number_of(row, "target_m", where=where) or 0.0
    pixels = number_of(row, "pixels_for_half", where=where) or SURVEY.pixels_for_half
    at_best = _fraction(row, "found_at_best", 1.0, where=where)
    hidden = _fraction(row, "hidden_from_above", 0.0, where=where)
    ratio = np.geomspace(SURVEY.finest_ratio, SURVEY.coarsest_ratio, SURVEY.ratio_steps)
    angles_deg = np.array([0.0, 90.0]) if hidden == 0.0 else np.arange(91.0)
    # Of leaves spread at random, each step along the line of sight hides the same share (Nilson, 1971: Beer's law for gaps).
    slant = 1.0 / np.maximum(np.cos(np.radians(angles_deg)), 1e-9)
    open_fraction = np.ones(2) if hidden == 0.0 else (1.0 - hidden) ** slant
    return detection_table(target_m / (pixels * ratio), angles_deg, at_best * open_fraction[:, None] * noticed(ratio))


def _own_table(row: Mapping[str, Any], *, where: str) -> DetectionTable:
    samples_m = _numbers(row["ground_sample_m"], "ground_sample_m", where=where)
    if not (samples_m[0] > 0.0 and samples_m[-1] < 100.0):
        raise InputError(f"{where}: ground_sample_m: the values must be metres on the ground, above 0 and below 100")
    given = row["probability"]
    by_angle = isinstance(given, list) and any(isinstance(part, list) for part in given)
    if by_angle and "off_vertical_deg" not in row:
        raise InputError(f"{where}: off_vertical_deg: the key is missing; add one angle for each row of probabilities")
    if by_angle:
        angles_deg = _numbers(row["off_vertical_deg"], "off_vertical_deg", where=where)
        rows = given
    else:
        if "off_vertical_deg" in row:
            raise InputError(f"{where}: probability: each angle in off_vertical_deg requires a row, such as [0.9, 0.4]")
        angles_deg, rows = np.array([0.0, 90.0]), [given, given]
    if angles_deg[0] != 0.0 or angles_deg[-1] > 90.0:
        raise InputError(f"{where}: off_vertical_deg: the angles must begin at 0 (straight down) and end at 90 or less")
    if len(rows) != len(angles_deg):
        raise InputError(f"{where}: probability: there are {len(rows)} rows for {len(angles_deg)} angles")
    values = np.empty((len(rows), samples_m.size))
    for number, part in enumerate(rows):
        if not isinstance(part, list) or len(part) != samples_m.size:
            count = len(part) if isinstance(part, list) else 1
            raise InputError(
                f"{where}: probability: row {number + 1} has {count} values for {samples_m.size} ground sample distances"
            )
        for k, value in enumerate(part):
            if not _is_number(value) or not 0.0 <= value <= 1.0:
                raise InputError(f"{where}: probability: values must be from 0 to 1, not {value!r} (row {number + 1})")
            values[number, k] = value
    return detection_table(samples_m, angles_deg, values)


def _numbers(values: object, key: str, *, where: str) -> FloatArray:
    """Finite numbers that rise."""
    if not isinstance(values, list) or not 0 < len(values) <= SURVEY.most_values:
        raise InputError(f"{where}: {key}: must be a list of numbers, not {str(values)[:60]}")
    for value in values:
        if not _is_number(value):
            raise InputError(f"{where}: {key}: each value must be a number, not {value!r}")
    numbers = np.array(values, dtype=float)
    if not (np.diff(numbers) > 0.0).all():
        raise InputError(f"{where}: {key}: values must increase")
    return numbers


def _fraction(row: Mapping[str, Any], key: str, default: float, *, where: str) -> float:
    value = row.get(key, default)
    if not _is_number(value) or not 0.0 <= value <= 1.0:
        raise InputError(f"{where}: {key}: must be a fraction between 0 and 1, not {value!r}")
    return float(value)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e9 and math.isfinite(value)

"""Numbers of ``uavcover new``: its defaults (``data/new.toml`` explains each), and quantities as people write them."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import timedelta

from mission_io.data_tables import data_table
from uavcover.errors import InputError
from uavcover.model.limits import utc_time, window_of


@dataclass(frozen=True, slots=True, kw_only=True)
class _Survey:
    usual_ceiling_m: float
    lowest_top_m: float
    lowest_bottom_m: float
    slowest_m_s: float
    usual_speed_m_s: float
    speed_fraction: float
    trigger_slack: float
    flat_deg: float
    steep_deg: float
    usual_climb_deg: float
    climb_over_slope_deg: float
    steepest_climb_deg: float
    cells: int
    finest_cell_m: float
    oblique_pitch_deg: float
    oblique_sample: float
    largest_pitch_difference: float
    pixels_for_half: float
    finest_ratio: float
    coarsest_ratio: float
    ratio_steps: int
    most_values: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Text:
    transit_clearance_m: float
    step_m: float
    no_fly_margin_m: float
    coverage: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Terrain:
    grid: int
    gap_grid: int
    round_m: float
    rim_fraction: float
    edge_steps: int
    slope_reach_m: float
    home_slope_deg: float
    largest_km: float
    hides_m: float
    surface_grid: int
    around_m: float
    max_tiles: int
    least_scale: float
    farthest_home_m: float
    beside_zones_m: float


SURVEY = data_table(_Survey, "uavcover/data/new.toml", "survey")
TEXT = data_table(_Text, "uavcover/data/new.toml", "text")
TERRAIN = data_table(_Terrain, "uavcover/data/new.toml", "terrain")

_USUAL_WINDOW = "2h"
_NUMBER = re.compile(r"\s*([-+]?\d+(?:\.\d*)?|\.\d+)\s*([a-zA-Z/]*)\s*")
_LENGTHS = {"mm": 0.001, "cm": 0.01, "m": 1.0, "km": 1000.0, "in": 0.0254, "ft": 0.3048}
_SIZES_MIB = {
    "kib": 2.0**-10,
    "mib": 1.0,
    "gib": 2.0**10,
    "tib": 2.0**20,
    "kb": 1e3 / 2**20,
    "mb": 1e6 / 2**20,
    "gb": 1e9 / 2**20,
}
_TIMES = {"s": 1.0, "sec": 1.0, "min": 60.0, "m": 60.0, "h": 3600.0}
_SPEEDS = {
    "m/s": 1.0,
    "km/h": 1.0 / 3.6,
    "kmh": 1.0 / 3.6,
    "kn": 1852.0 / 3600.0,
    "kt": 1852.0 / 3600.0,
    "mph": 0.44704,
}


def length_m(text: str, *, option: str, example: str) -> float:
    """A length such as ``2.5cm`` in metres; the unit is needed. Raises InputError: it is none, or not above 0."""
    return _quantity(text, _LENGTHS, option=option, example=example)


def water_height_m(text: str | None) -> float | None:
    """A height of water above sea level such as ``0m`` or ``-430m``, in metres; the unit is needed.

    Raises:
        InputError: it is none, or no height on Earth.
    """
    if text is None:
        return None
    match = _NUMBER.fullmatch(text)
    if match is None or match[2].lower() not in _LENGTHS:
        raise InputError(f"--water-height: must be a height with a unit, such as 0m, not {text!r}")
    height_m = float(match[1]) * _LENGTHS[match[2].lower()]
    if not -500.0 <= height_m <= 9000.0:
        raise InputError(f"--water-height: must be between -500 and 9,000 m above sea level, not {height_m:g} m")
    return height_m


def memory_bytes(text: str, *, option: str) -> int:
    """A size of memory such as ``4GiB`` in bytes; the unit is needed. Raises InputError: it is none, or below 1 MiB."""
    value = _quantity(text, _SIZES_MIB, option=option, example="4GiB")
    if value < 1.0:
        raise InputError(f"{option}: must be at least 1 MiB, such as 4GiB, not {text!r}")
    return round(value * 2**20)


def time_s(text: str, *, option: str, example: str) -> float:
    """A time such as ``25min`` in seconds; the unit is needed. Raises InputError: it is none, or not above 0."""
    return _quantity(text, _TIMES, option=option, example=example)


def speed_m_s(text: str, *, option: str, example: str) -> float:
    """A speed such as ``8m/s`` in metres per second; the unit is needed.

    Raises:
        InputError: it is none, or not above 0.
    """
    return _quantity(text, _SPEEDS, option=option, example=example)


def _quantity(text: str, units: Mapping[str, float], *, option: str, example: str) -> float:
    match = _NUMBER.fullmatch(text)
    known = {unit.lower(): each for unit, each in units.items()}
    if match is None or match[2].lower() not in known:
        missing = match is not None and not match[2]
        what = f"{text!r} has no unit" if missing else f"{text!r} is not a valid quantity"
        raise InputError(f"{option}: {what}; write it as {example} (units: {', '.join(units)})")
    value = float(match[1]) * known[match[2].lower()]
    if not 0.0 < value < 1e9:
        raise InputError(f"{option}: must be greater than 0, such as {example}, not {text!r}")
    return value


def flight_window(text: str, *, option: str) -> tuple[str, str]:
    """Read a time window as ``START/END`` or ``START/2h``; ``START`` alone is two hours.

    Both ends in ISO 8601, UTC.

    Raises:
        InputError: it is no such time.
    """
    start, slash, last = (part.strip() for part in text.partition("/"))
    advice = "write it as 2026-07-01T09:00Z/2h or START/END"
    try:
        begin = utc_time(start, option)
        if not slash or _NUMBER.fullmatch(last) is not None:
            end = begin + timedelta(
                seconds=time_s(last if slash else _USUAL_WINDOW, option=option, example="2026-07-01T09:00Z/2h")
            )
        else:
            end = utc_time(last, option)
    except (ValueError, OverflowError):
        raise InputError(f"{option}: {text[:40]!r} is not a valid flight time; {advice}") from None
    try:
        window_of(begin.isoformat(), end.isoformat(), option)
    except ValueError as error:
        raise InputError(f"{error}; {advice}") from None
    return f"{begin:%Y-%m-%dT%H:%M:%SZ}", f"{end:%Y-%m-%dT%H:%M:%SZ}"


def overlaps(text: str) -> tuple[float, float]:
    """Forward and side overlap, 0 to below 1, from ``75/70`` in percent; one number means both.

    Raises:
        InputError: it is not understood, or out of range.
    """
    parts = [part.strip().removesuffix("%") for part in re.split(r"[/,x]", text.strip())]
    try:
        fractions = [float(part) for part in parts]
    except ValueError:
        fractions = []
    if len(fractions) not in (1, 2):
        raise InputError(f"--overlap: must be forward and side overlap in percent, such as 75/70, not {text!r}")
    forward, side = fractions[0], fractions[-1]
    if max(forward, side) < 1.0 and max(forward, side) > 0.0:
        raise InputError(f"--overlap: must be in percent, such as 75/70, not {text!r}")
    if not (0.0 <= forward <= 95.0 and 0.0 <= side <= 95.0):
        raise InputError(f"--overlap: each value must be between 0 and 95 percent, such as 75/70, not {text!r}")
    return forward / 100.0, side / 100.0


def lat_lon(text: str, *, option: str) -> tuple[float, float]:
    """A place ``LAT,LON`` in degrees. Raises InputError: it is not understood, or not a position on Earth."""
    try:
        lat, lon = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(
            f"{option}: {text!r} is not a position; write it as LAT,LON in degrees, such as 46.5123,8.0456"
        ) from None
    if not (abs(lat) <= 90.0 and abs(lon) <= 180.0):
        raise InputError(f"{option}: latitude {lat:g}, longitude {lon:g} is not on Earth; write latitude first")
    return lat, lon

"""Frozen dataclasses from TOML: tables of numbers beside the code, checked and read once, and checks of single values."""

import math
import tomllib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import EnumType
from functools import cache
from importlib import resources
from types import NoneType
from typing import Any, TypeVar, get_args, get_origin

TableT = TypeVar("TableT")


@cache
def read_document(path: str) -> Mapping[str, Any]:
    """A TOML file of an installed package, by a path like ``uavcover/data/flight.toml``."""
    package, _, file = path.partition("/")
    return tomllib.loads((resources.files(package) / file).read_text(encoding="utf-8"))


def data_table(kind: type[TableT], path: str, section: str) -> TableT:
    """One section of a file; each key is a field of the dataclass and each field is a key.

    Raises:
        ValueError: a section or key is missing or unknown, or a value is of another type, not finite, or a share outside 0 to 1.
    """
    try:
        return table_of(kind, read_document(path)[section], where=f"{path}: {section}")
    except KeyError:
        raise ValueError(f"{path}: the section {section} is missing") from None


def data_rows(kind: type[TableT], path: str, section: str) -> dict[str, TableT]:
    """Each table of a section, by its name; errors as ``data_table``."""
    rows = read_document(path)[section]
    return {name: table_of(kind, row, where=f"{path}: {section}.{name}") for name, row in rows.items()}


def table_of(kind: type[TableT], row: Mapping[str, Any], *, where: str, **given: Any) -> TableT:
    """As ``data_table``, of a table that has been read; ``given`` are fields that it does not have."""
    wanted: dict[str, Any] = {f.name: f.type for f in fields(kind) if f.name not in given}  # type: ignore[arg-type]
    for key in (*row, *wanted):
        if key not in wanted or not (key in row or NoneType in get_args(wanted[key])):
            raise ValueError(f"{where}.{key}: {'missing key' if key in wanted else 'unknown key'}")
    values = {key: _checked(row[key], wanted[key], f"{where}.{key}") if key in row else None for key in wanted}
    try:
        return kind(**values, **given)
    except ValueError as error:  # of the dataclass's own checks
        raise ValueError(f"{where}: {error}") from None


def _checked(value: object, kind: Any, where: str) -> object:
    """A value of a field's type: float, int, str, bool, the name of an enum's member, a dataclass, or some of these."""
    if NoneType in (parts := get_args(kind)):
        return _checked(value, parts[0], where)
    if get_origin(kind) is frozenset:
        return frozenset(_checked(part, parts[0], where) for part in value)  # type: ignore[attr-defined]
    if parts:
        inner = parts[:1] * len(value) if parts[-1] is ... and isinstance(value, list) else parts
        if not isinstance(value, list) or len(value) != len(inner):
            raise ValueError(f"{where}: expected a list of another length, not {value!r}")
        return tuple(_checked(part, part_kind, where) for part, part_kind in zip(value, inner, strict=True))
    if isinstance(kind, type) and is_dataclass(kind) and isinstance(value, dict):
        return table_of(kind, value, where=where)
    if isinstance(kind, EnumType) and isinstance(value, str) and value in kind.__members__:
        return kind[value]
    if not isinstance(value, (int, float) if kind is float else kind) or isinstance(value, bool) is not (kind is bool):
        raise ValueError(f"{where}: expected a value of type {kind.__name__}, not {value!r}")
    if isinstance(value, int | float) and not math.isfinite(value):
        raise ValueError(f"{where}: must be finite, not {value}")
    if isinstance(value, float) and where.endswith("_fraction") and not 0.0 <= value <= 1.0:
        raise ValueError(f"{where}: must be between 0 and 1, not {value}")
    return float(value) if kind is float and isinstance(value, int) else value


STRICT: dict[str, Any] = {"extra": "forbid", "allow_inf_nan": False}
"""Settings for the scenario reader's validator: a misspelt key is an error."""


def require(condition: bool, message: str) -> None:
    """Raise ValueError with ``message`` (which starts with the key) unless ``condition`` holds."""
    if not condition:
        raise ValueError(message)


def require_positive(checked: object, *keys: str) -> None:
    """Require every named value that is given to be a finite number above zero."""
    for key in keys:
        value = getattr(checked, key)
        require(value is None or (math.isfinite(value) and value > 0.0), f"{key}: must be greater than 0, not {value}")


def require_not_negative(checked: object, *keys: str) -> None:
    """Require every named value that is given to be a finite number of at least zero."""
    for key in keys:
        value = getattr(checked, key)
        require(
            value is None or (math.isfinite(value) and value >= 0.0), f"{key}: must not be negative, but is {value}"
        )


def require_between(checked: object, low: float, high: float, *keys: str, unit: str = "") -> None:
    """Require every named value that is given to be between two numbers, both included."""
    for key in keys:
        value = getattr(checked, key)
        within = value is None or low <= value <= high
        require(within, f"{key}: must be between {low:g} and {high:g}{unit}, not {value}")


def require_lon_lat(ring: tuple[tuple[float, float], ...], key: str) -> None:
    """Require every corner to be a longitude and a latitude on Earth."""
    for lon, lat in ring:
        require(
            abs(lat) <= 90.0 and abs(lon) <= 180.0,
            f"{key}: ({lon}, {lat}) is not a longitude and latitude in degrees, in this order",
        )

"""Probability that one look finds the object: named, measured or assumed curves."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from uavcover.errors import InputError
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.detection import DetectionTable, detection_table
from uavcover.new.catalog import checked_row, find_name, number_of, read_catalog, read_own_row
from uavcover.new.tuning import SURVEY

Independent = Literal["sides", "pictures", "none"]
INDEPENDENT: tuple[Independent, ...] = ("sides", "pictures", "none")


@dataclass(frozen=True, slots=True, eq=False)
class DetectionCurve:
    """The probability that a look finds the target, over ground sample distance and angle off the vertical."""

    name: str  # in the table that comes with the package, or of the file
    title: str  # for people
    source: str  # where the values are from
    table: DetectionTable  # of it
    # which looks at one place count as independent chances: the best from each side (``sides``), every photo
    # (``pictures``), or only the best of all (``none``)
    independent: Independent = "sides"
    # whether it comes with the package: a rule of thumb that was not measured for these photos
    is_example: bool = False

    @property
    def half_at_m(self) -> float:
        """The coarsest ground sample distance with which half of the looks straight down find the target; NaN: none."""
        found = np.flatnonzero(self.table.probability[0] >= 0.5)
        return float(self.table.sample_m[found[-1]]) if found.size else float("nan")


def all_curves() -> tuple[DetectionCurve, ...]:
    """The curves of the table that comes with the package."""
    return tuple(_example(name, row) for name, row in read_catalog("detection.toml").items())


def curve_named(name: str) -> DetectionCurve:
    """A curve of the table, or of a TOML file of people's own.

    Raises:
        InputError: it is not known, or the file's values are no curve.
    """
    if name.lower().endswith(".toml"):
        return _curve(Path(name).stem, read_own_row(Path(name), option="--detection"), where=f"--detection: {name}")
    rows = read_catalog("detection.toml")
    found = find_name(name, rows, option="--detection", command="judge-photos")
    return _example(found, rows[found])


def noticed(ratio: FloatArray) -> FloatArray:
    """Share of observers who notice a target, by pixels across it over those with which half of them do.

    The target transfer probability function of ACQUIRE and NVTherm (U.S. Army NVESD, NVTherm manual, 2001): r^E / (1 + r^E) with
    E = 2.7 + 0.7 r.

    >>> noticed(np.array([0.5, 1.0, 2.0])).round(3).tolist()
    [0.108, 0.5, 0.945]
    """
    with np.errstate(over="ignore", under="ignore"):
        return 1.0 / (1.0 + ratio ** -(2.7 + 0.7 * ratio))


def _example(name: str, row: dict[str, Any]) -> DetectionCurve:
    """A curve of the table that comes with the package."""
    return replace(_curve(name, row, where=f"detection.toml: {name}"), is_example=True)


def _curve(name: str, row: dict[str, Any], *, where: str) -> DetectionCurve:
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
    return DetectionCurve(name, str(row.get("title", name)), str(row.get("source", "")), table, independent)


def _by_pixels(row: dict[str, Any], *, where: str) -> DetectionTable:
    target_m = number_of(row, "target_m", where=where) or 0.0
    pixels = number_of(row, "pixels_for_half", where=where) or SURVEY.pixels_for_half
    at_best = _share(row, "found_at_best", 1.0, where=where)
    hidden = _share(row, "hidden_from_above", 0.0, where=where)
    ratio = np.geomspace(SURVEY.finest_ratio, SURVEY.coarsest_ratio, SURVEY.ratio_steps)
    angles_deg = np.array([0.0, 90.0]) if hidden == 0.0 else np.arange(91.0)
    # Of leaves spread at random, each step along the line of sight hides the same share (Nilson, 1971: Beer's law for gaps).
    slant = 1.0 / np.maximum(np.cos(np.radians(angles_deg)), 1e-9)
    open_share = np.ones(2) if hidden == 0.0 else (1.0 - hidden) ** slant
    return detection_table(target_m / (pixels * ratio), angles_deg, at_best * open_share[:, None] * noticed(ratio))


def _own_table(row: dict[str, Any], *, where: str) -> DetectionTable:
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


def _share(row: dict[str, Any], key: str, default: float, *, where: str) -> float:
    value = row.get(key, default)
    if not _is_number(value) or not 0.0 <= value <= 1.0:
        raise InputError(f"{where}: {key}: must be a fraction between 0 and 1, not {value!r}")
    return float(value)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e9 and math.isfinite(value)

"""The mock's own log of where it really is, beside what it believes and tells: for tests, and for judging a track."""

import csv
from collections.abc import Callable
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from types import TracebackType
from typing import Self

from uavcover.errors import InputError


@dataclass(frozen=True, slots=True)
class TruthSample:
    """The true and the believed position at the moment a position was told.

    Attributes:
        time_s: vehicle time since it was switched on, as in the position that was told.
        lat_deg: true latitude.
        lon_deg: true longitude.
        alt_amsl_m: true height above mean sea level.
        east_error_m: believed position less the true one.
        north_error_m: the same.
        up_error_m: the same.
        roll_deg: right side down is positive.
        pitch_deg: nose up is positive.
        yaw_deg: clockwise from north.
    """

    time_s: float
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
    east_error_m: float
    north_error_m: float
    up_error_m: float
    roll_deg: float
    pitch_deg: float
    yaw_deg: float


OnTruth = Callable[[TruthSample], None]
"""Takes each sample."""


class TruthFile:
    """Writes samples to a CSV file as they come; a context manager.

    Raises:
        InputError: the file cannot be made.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._file = path.open("w", newline="", encoding="utf-8", buffering=1)
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from None
        self._rows = csv.writer(self._file, lineterminator="\n")
        self._rows.writerow(field.name for field in fields(TruthSample))

    def __call__(self, sample: TruthSample) -> None:
        """Write one sample."""
        self._rows.writerow([repr(value) for value in astuple(sample)])

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

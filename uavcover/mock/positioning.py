"""The mock vehicle's believed position, and a log of its true position.

The believed position is the true one with a slowly wandering error, and a drift while there is no fix. The log is for tests and
for judging a track.
"""

import csv
import math
from collections import deque
from collections.abc import Callable
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np

from mission_io.links.base import Closing
from uavcover.errors import InputError
from uavcover.mock.dynamics import Airframe, PointMass, Vector
from uavcover.mock.tuning import BODY


@dataclass(frozen=True, slots=True, kw_only=True)
class GpsError:
    """Position error of the satellite receiver."""

    horizontal_m: float = 0.0  # standard deviation of the error, east and north each
    vertical_m: float = 0.0  # standard deviation of the error in height
    time_s: float = 30.0  # correlation time of both: the error wanders, it does not jump
    latency_s: float = 0.0  # age of a position when the receiver reports it

    def __post_init__(self) -> None:
        for name in ("horizontal_m", "vertical_m", "latency_s"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name}: {getattr(self, name)} must not be negative")
        if not self.time_s > 0.0:
            raise ValueError(f"time_s: must be greater than 0, not {self.time_s}")


class Positioning:
    """The believed state by which the vehicle steers; a ``Mover`` for its ``Itinerary``.

    Attributes:
        position_m: the believed position, east, north, up.
        velocity_m_s: over ground, believed to be as it is.
        receiver_m: the latest position of the satellite receiver, delayed by its latency.
        lost: whether there is no fix.
        glitch_m: by which the believed position is too far east, suddenly, as by a reflected or faked signal.
    """

    def __init__(self, point: PointMass, error: GpsError, *, rng: np.random.Generator) -> None:
        self.lost = False
        self.glitch_m = 0.0
        self._point, self._rng = point, rng
        self._error_m: Vector = (0.0, 0.0, 0.0)
        self._wander_m: Vector = (0.0, 0.0, 0.0)
        self._keep = math.exp(-point.step_s / error.time_s)
        share = math.sqrt(1.0 - self._keep**2)
        self._scales = (error.horizontal_m * share, error.horizontal_m * share, error.vertical_m * share)
        self._exact = error.horizontal_m == 0.0 and error.vertical_m == 0.0
        if not self._exact:  # the receiver has been on for long: the error has its full spread from the start
            first = self._rng.standard_normal(3)
            spread = (error.horizontal_m, error.horizontal_m, error.vertical_m)
            self._wander_m = tuple(float(a) * b for a, b in zip(first, spread, strict=True))  # type: ignore[assignment]
        self._noise: list[list[float]] = []
        self._drift_m_s: Vector = (0.0, 0.0, 0.0)
        self._receiver_due = 0
        self._receiver_every = max(1, round(BODY.receiver_s / point.step_s))
        self._told: deque[Vector] = deque(maxlen=round(error.latency_s / BODY.receiver_s) + 1)
        self.position_m = self.receiver_m = _sum(point.position_m, self._wander_m)

    @property
    def airframe(self) -> Airframe:
        """The vehicle's airframe."""
        return self._point.airframe

    @property
    def velocity_m_s(self) -> Vector:
        """Over ground."""
        return self._point.velocity_m_s

    @property
    def error_m(self) -> Vector:
        """Believed position less the true one."""
        x, y, z = self._point.position_m
        return (self.position_m[0] - x, self.position_m[1] - y, self.position_m[2] - z)

    def lose_fix(self) -> None:
        """Lose the satellite fix."""
        angle = float(self._rng.uniform(0.0, math.tau))
        self._drift_m_s = (BODY.drift_m_s * math.sin(angle), BODY.drift_m_s * math.cos(angle), 0.0)
        self.lost = True

    def find_fix(self) -> None:
        """Regain the satellite fix."""
        self.lost = False

    def step(self) -> None:
        """Update the believed position after one more step."""
        if not self._exact:
            self._wander()
        dt = self._point.step_s
        if self.lost:
            self._error_m = _sum(self._error_m, tuple(d * dt for d in self._drift_m_s))  # type: ignore[arg-type]
        elif self._error_m != (0.0, 0.0, 0.0):
            keep = math.exp(-dt / BODY.recovery_s)
            x, y, _ = self._error_m
            self._error_m = (x * keep, y * keep, 0.0) if math.hypot(x, y) > 1e-3 else (0.0, 0.0, 0.0)
        true = self._point.position_m
        if self._exact and self._error_m == (0.0, 0.0, 0.0):
            self.position_m = true
        else:
            self.position_m = _sum(_sum(true, self._wander_m), self._error_m)
        if self.glitch_m:
            self.position_m = _sum(self.position_m, (self.glitch_m, 0.0, 0.0))
        self._receiver_due -= 1
        if self._receiver_due <= 0:
            self._receiver_due = self._receiver_every
            if not self.lost:
                self._told.append(_sum(true, self._wander_m))
                self.receiver_m = self._told[0]

    def _wander(self) -> None:
        if not self._noise:
            self._noise = self._rng.standard_normal((512, 3)).tolist()
        noise, keep, scales, (x, y, z) = self._noise.pop(), self._keep, self._scales, self._wander_m
        self._wander_m = (
            keep * x + scales[0] * noise[0],
            keep * y + scales[1] * noise[1],
            keep * z + scales[2] * noise[2],
        )


def _sum(a: Vector, b: Vector) -> Vector:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@dataclass(frozen=True, slots=True)
class TruthSample:
    """True and believed position when a position was reported."""

    time_s: float  # vehicle time since it was switched on, as in the reported position
    lat_deg: float  # true latitude
    lon_deg: float  # true longitude
    alt_amsl_m: float  # true height above mean sea level
    east_error_m: float  # believed position less the true one
    north_error_m: float  # the same
    up_error_m: float  # the same
    roll_deg: float  # right side down is positive
    pitch_deg: float  # nose up is positive
    yaw_deg: float  # clockwise from north


OnTruth = Callable[[TruthSample], None]
"""Called with each sample."""


class TruthFile(Closing):
    """Writes samples to a CSV file as they come; a context manager.

    Raises:
        InputError: the file cannot be made.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._file = path.open("w", newline="", encoding="utf-8", buffering=1)
        except OSError as error:
            raise InputError(f"{path}: the file cannot be written: {error.strerror}") from None
        self._rows = csv.writer(self._file, lineterminator="\n")
        self._rows.writerow(field.name for field in fields(TruthSample))

    def __call__(self, sample: TruthSample) -> None:
        """Write one sample."""
        self._rows.writerow(astuple(sample))

    def close(self) -> None:
        """Close the file."""
        self._file.close()

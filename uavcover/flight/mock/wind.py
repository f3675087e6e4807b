"""The air over time: a steady wind, gusts as a random process of a seed, and a wind that somebody adds in flight.

The gusts have the form of Dryden's longitudinal spectrum (MIL-F-8785C, 3.7.1.2): first-order noise, white noise through
``1 / (1 + T s)``, in each axis, with ``T`` the time that an eddy needs to pass.
"""

import math
from dataclasses import dataclass

import numpy as np

from uavcover.flight.mock.dynamics import Vector


@dataclass(frozen=True, slots=True, kw_only=True)
class Wind:
    """A steady horizontal wind with gusts on top.

    Attributes:
        speed_m_s: steady speed.
        from_deg: where it comes from, clockwise from north.
        gust_m_s: standard deviation of the gusts in each horizontal direction; half of it vertically.
        gust_time_s: correlation time of the gusts.
    """

    speed_m_s: float = 0.0
    from_deg: float = 0.0
    gust_m_s: float = 0.0
    gust_time_s: float = 3.0

    def __post_init__(self) -> None:
        if not (self.speed_m_s >= 0.0 and self.gust_m_s >= 0.0 and self.gust_time_s > 0.0):
            raise ValueError("wind: speed_m_s and gust_m_s must not be negative, gust_time_s must be above 0")

    @property
    def steady_m_s(self) -> Vector:
        """Velocity of the air, east, north, up."""
        angle = math.radians(self.from_deg)
        return (-self.speed_m_s * math.sin(angle), -self.speed_m_s * math.cos(angle), 0.0)


_COMES_UP_S = 1.5
_SAME_M_S = 1e-3


class WindField:
    """The wind over time: an Ornstein-Uhlenbeck process around the steady wind, in exact steps of ``step_s``."""

    _BLOCK = 512

    def __init__(self, wind: Wind, *, step_s: float, rng: np.random.Generator) -> None:
        self._steady = wind.steady_m_s
        self._coming: Vector | None = None
        self._coming_share = 1.0 - math.exp(-step_s / _COMES_UP_S)
        self._rng = rng
        self._keep = math.exp(-step_s / wind.gust_time_s)
        scale = wind.gust_m_s * math.sqrt(1.0 - self._keep**2)
        self._scales = (scale, scale, 0.5 * scale)
        self._gust: Vector = (0.0, 0.0, 0.0)
        self._noise: list[list[float]] = []
        self.velocity_m_s: Vector = self._steady

    def change(self, wind: Wind) -> None:
        """Let another steady wind come up; the gusts stay."""
        self._coming = wind.steady_m_s

    def step(self) -> Vector:
        """Velocity of the air after one more step."""
        if self._coming is not None:
            self._come_up(self._coming)
        if self._scales[0] == 0.0:
            return self.velocity_m_s
        if not self._noise:
            self._noise = self._rng.standard_normal((self._BLOCK, 3)).tolist()
        noise = self._noise.pop()
        east, north, up = self._gust
        keep, scales, steady = self._keep, self._scales, self._steady
        self._gust = (
            keep * east + scales[0] * noise[0],
            keep * north + scales[1] * noise[1],
            keep * up + scales[2] * noise[2],
        )
        self.velocity_m_s = (steady[0] + self._gust[0], steady[1] + self._gust[1], steady[2] + self._gust[2])
        return self.velocity_m_s

    def _come_up(self, coming: Vector) -> None:
        share, (east, north, up) = self._coming_share, self._steady
        east, north, up = (old + share * (new - old) for old, new in zip((east, north, up), coming, strict=True))
        if math.dist((east, north, up), coming) < _SAME_M_S:
            (east, north, up), self._coming = coming, None
        self._steady = self.velocity_m_s = (east, north, up)

"""The flown track."""

import math
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.arrays import FloatArray
from uavcover.model.area import svg_map

COLUMNS = (
    "time_s",
    "lat_deg",
    "lon_deg",
    "alt_amsl_m",
    "east_m",
    "north_m",
    "up_m",
    "roll_deg",
    "pitch_deg",
    "yaw_deg",
    "current_waypoint",
)
"""Columns of ``track.csv``, in order."""

AGE_COLUMN = "attitude_age_s"
PICTURES_COLUMN = "pictures_taken"
UNIX_TIME_COLUMN = "unix_time_s"
RECEIVED_COLUMN = "received_utc_s"
VELOCITY_COLUMNS = ("velocity_north_m_s", "velocity_east_m_s", "velocity_down_m_s")
OPTIONAL_COLUMNS = (AGE_COLUMN, PICTURES_COLUMN, UNIX_TIME_COLUMN, RECEIVED_COLUMN, *VELOCITY_COLUMNS)
"""Last columns, which a file may lack."""

MAY_BE_EMPTY = ("roll_deg", "pitch_deg", "yaw_deg", *OPTIONAL_COLUMNS)
"""Columns whose value may be empty: not reported by the vehicle."""


@dataclass(frozen=True, slots=True)
class TrackSample:
    """One sample, a row of ``track.csv``."""

    time_s: float  # vehicle time
    lat_deg: float  # latitude
    lon_deg: float  # longitude
    alt_amsl_m: float  # height above sea level
    east_m: float  # east in the local frame of the scenario
    north_m: float  # north
    up_m: float  # up
    roll_deg: float  # right side down is positive; NaN when unknown
    pitch_deg: float  # nose up is positive; NaN when unknown
    yaw_deg: float  # clockwise from north, 0..360; NaN when unknown
    # number in ``plan.json`` of the planned waypoint that the vehicle is flying to; -1 before it heads for the first
    # one and after it has reached the last
    current_waypoint: int
    attitude_age_s: float = math.nan  # time from the attitude to the position; NaN when unknown
    # number of photos of the vehicle's camera so far, by its own count; NaN when it has reported none
    pictures_taken: float = math.nan
    # seconds since 1970 in UTC, as the vehicle's receiver reports the time; NaN when it has not
    unix_time_s: float = math.nan
    # when the position arrived, seconds since 1970 on the ground station's clock; NaN when unknown
    received_utc_s: float = math.nan
    velocity_north_m_s: float = math.nan  # over ground, as the vehicle reports it; NaN when not reported
    velocity_east_m_s: float = math.nan  # the same
    velocity_down_m_s: float = math.nan  # the same


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """A flown track; its arrays are read-only.

    Attributes:
        time_s: (n,) vehicle time, increasing.
        geodetic: (n, 3) latitude and longitude in degrees, height above sea level in metres.
        enu_m: (n, 3) east, north, up in metres.
        attitude_deg: (n, 3) roll, pitch, yaw; NaN where unknown.
        current_waypoint: (n,) see :class:`TrackSample`.
        attitude_age_s: (n,) time from the attitude of a sample to its position, NaN where unknown; default: unknown everywhere.
        pictures_taken: (n,) see :class:`TrackSample`; default: unknown everywhere.
        unix_time_s: (n,) see :class:`TrackSample`; default: unknown everywhere.
        received_utc_s: (n,) see :class:`TrackSample`; default: unknown everywhere.
        velocity_north_m_s: (n,) see :class:`TrackSample`; default: unknown everywhere.
        velocity_east_m_s: (n,) see :class:`TrackSample`; default: unknown everywhere.
        velocity_down_m_s: (n,) see :class:`TrackSample`; default: unknown everywhere.
        ranged: (r, 3) latitude, longitude and height above sea level of the ground as a rangefinder that looks down measured it.
        stored: (s, 3) the same as the vehicle's own terrain data has it.
    """

    time_s: FloatArray
    geodetic: FloatArray
    enu_m: FloatArray
    attitude_deg: FloatArray
    current_waypoint: NDArray[np.int64]
    attitude_age_s: FloatArray = field(default_factory=lambda: np.empty(0))
    pictures_taken: FloatArray = field(default_factory=lambda: np.empty(0))
    unix_time_s: FloatArray = field(default_factory=lambda: np.empty(0))
    received_utc_s: FloatArray = field(default_factory=lambda: np.empty(0))
    velocity_north_m_s: FloatArray = field(default_factory=lambda: np.empty(0))
    velocity_east_m_s: FloatArray = field(default_factory=lambda: np.empty(0))
    velocity_down_m_s: FloatArray = field(default_factory=lambda: np.empty(0))
    ranged: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    stored: FloatArray = field(default_factory=lambda: np.empty((0, 3)))

    def __post_init__(self) -> None:
        for name in OPTIONAL_COLUMNS:
            if getattr(self, name).size == 0:
                object.__setattr__(self, name, np.broadcast_to(np.nan, self.time_s.size))  # takes no memory
        for each in fields(self):
            getattr(self, each.name).flags.writeable = False

    def __len__(self) -> int:
        return int(self.time_s.size)

    def __repr__(self) -> str:
        lasted_s = float(self.time_s[-1] - self.time_s[0]) if len(self) else 0.0
        return f"<Track: {len(self)} samples over {lasted_s:.0f} s>"

    def _repr_html_(self) -> str:
        return svg_map([("track", self.enu_m)], repr(self)[1:-1])

    @property
    def velocity_enu_m_s(self) -> FloatArray:
        """(n, 3) reported velocity: east, north, up; NaN where not reported."""
        return np.column_stack([self.velocity_east_m_s, self.velocity_north_m_s, -self.velocity_down_m_s])

    def taken(self, samples: NDArray[Any]) -> "Track":
        """The track reduced to some samples, by number or by mask."""
        known = [name for name in OPTIONAL_COLUMNS if getattr(self, name).strides != (0,)]
        names = ("time_s", "geodetic", "enu_m", "attitude_deg", "current_waypoint", *known)
        columns = {name: getattr(self, name)[samples].copy() for name in names}
        return Track(**columns, ranged=self.ranged.copy(), stored=self.stored.copy())


@dataclass(frozen=True, slots=True, eq=False)
class ReadTrack:
    """A track read from a file."""

    track: Track  # the samples
    warnings: tuple[str, ...]  # what was dropped or assumed, one line each

"""The flown track, the events of the flight, and its ending."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uavcover.errors import VehicleError
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
PHOTOS_COLUMN = "pictures_taken"
UNIX_TIME_COLUMN = "unix_time_s"
RECEIVED_COLUMN = "received_utc_s"
VELOCITY_COLUMNS = ("velocity_north_m_s", "velocity_east_m_s", "velocity_down_m_s")
FIX_COLUMN = "has_fix"
OPTIONAL_COLUMNS = (AGE_COLUMN, PHOTOS_COLUMN, UNIX_TIME_COLUMN, RECEIVED_COLUMN, *VELOCITY_COLUMNS, FIX_COLUMN)
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
    # 1 while the vehicle reports a satellite fix and a position estimate, 0 while it lacks one; NaN when it reports neither
    has_fix: float = math.nan


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
        has_fix: (n,) see :class:`TrackSample`; default: unknown everywhere.
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
    has_fix: FloatArray = field(default_factory=lambda: np.empty(0))
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


class EventKind(Enum):
    """Subject of an event."""

    STAGE = "the flight continues with its next stage"
    WAYPOINT = "the vehicle flies to the next planned waypoint"
    TEXT = "a message from the vehicle"
    WARNING = "a problem that does not end the flight"
    STOP = "the user wants to end the flight"


@dataclass(frozen=True, slots=True)
class FlightEvent:
    """Something that happened."""

    kind: EventKind  # what it is about
    text: str  # one line as text
    time_s: float | None = None  # vehicle time; None before the vehicle sent its time
    waypoint: int | None = None  # number of the planned waypoint that is flown to, for progress; None for other events
    alarm: bool = False  # whether something is wrong now, so that it should be heard too
    # rows of the table of limits that follows as lines, as ``--json`` has them; empty for other events
    limits: tuple[Mapping[str, Any], ...] = ()


class Ending(Enum):
    """Endings of a flight; the names are those of ``run.json`` and ``--json``, in small letters."""

    LANDED = "mission completed, landed and disarmed"
    RETURNED = "stopped by the user, returned along checked legs, landed and disarmed"
    LEFT_HOLDING = "stopped by the user; the vehicle holds its position, armed and in the air"
    NOT_FLOWN = "stopped by the user before it left the ground; disarmed"
    RESERVE_KEPT = "returned early along checked legs to keep the battery reserve, landed and disarmed"

    NOT_ARMED = "not armed: the vehicle does not match the plan"
    NOT_READY = "not armed: the vehicle did not become ready"
    ARMING_REFUSED = "the vehicle refused to arm"
    NOT_STARTED = "the vehicle did not take off"

    LINK_LOST = "the link to the vehicle was lost"
    HEARTBEAT_LOST = "the autopilot's heartbeat was lost, although other messages arrived"
    POSITION_LOST = "the vehicle stopped reporting its position"
    GPS_LOST = "the vehicle lost its satellite fix or its position estimate"
    BATTERY_FAILSAFE = "the battery was low, and the vehicle took its failsafe action"
    BATTERY_LOW = "the battery was low"
    WIND_ABOVE_LIMITS = "the wind was above the vehicle's limits"
    OFF_ROUTE = "the vehicle left the planned route, although it has the planned mission"
    FENCE_BREACHED = "the vehicle left its fence"
    BAND_LEFT = "the vehicle left the height band of its route"
    GROUND_UNKNOWN = "the vehicle flew over ground without data"
    RADIO_LOST = "the pilot's radio was lost, and the vehicle took its failsafe action"
    FAILSAFE = "the vehicle took another failsafe"
    PILOT_TOOK_OVER = "a pilot or another ground station changed the flight mode"
    TAKEN_OVER = "the vehicle left its mission for an unknown reason"
    STATE_UNKNOWN = "the vehicle's mode or state was not known"
    HOLD_LOST = "the vehicle did not hold its position"
    UNSAFE_LINE = "the straight line back to the route was not clear"
    LATE = "the vehicle was later than planned"
    RESERVE_USED = "the flight used the reserve of its battery"
    PHOTOS_MISSING = "the camera reported fewer photos than planned"
    FALLING = "the vehicle fell"
    MISSION_CHANGED = "another station changed the mission, or the current item"
    HOME_MOVED = "another station moved the vehicle's home, or the origin of its heights"
    SETTINGS_CHANGED = "another station changed a parameter that the mission depends on"
    FENCE_CHANGED = "another station changed or disabled the vehicle's fence"
    RALLY_CHANGED = "another station changed the vehicle's rally points"
    RESTARTED = "the vehicle's autopilot restarted"
    STUCK = "the vehicle made no progress"
    CRASHED = "the vehicle crashed: it reported a crash, or it was disarmed in the air and fell"
    ENDED_EARLY = "the vehicle landed before the last planned waypoint"
    STAYED_ARMED = "the vehicle landed and did not disarm"
    FAILED = "the vehicle did not follow its commands"

    @property
    def key(self) -> str:
        """Its name in documents."""
        return self.name.lower()

    @property
    def good(self) -> bool:
        """Whether the flight went as planned or as the user wished."""
        return self in (Ending.LANDED, Ending.RETURNED, Ending.LEFT_HOLDING, Ending.NOT_FLOWN, Ending.RESERVE_KEPT)


@dataclass(frozen=True, slots=True)
class Incident:
    """Something that went wrong in flight."""

    kind: Ending  # the ending that it leads to if it lasts
    text: str  # the event's text
    begin_s: float | None  # vehicle time; None before the vehicle sent its time
    end_s: float | None = None  # when it was over; None when it lasted to the end
    evidence: tuple[str, ...] = ()  # the evidence, each with its time


@dataclass(frozen=True, slots=True)
class FlightOutcome:
    """Outcome of a flight."""

    ending: Ending  # how
    waypoints_reached: int  # number of planned waypoints that were reached in order
    sample_count: int  # number of recorded samples
    duration_s: float  # vehicle time from the first sample to the last
    simulated_by: str | None  # the vehicle's simulator; None for one that may be real
    incidents: tuple[Incident, ...] = ()  # all incidents, also those without consequence
    vehicle_now: str = ""  # last known action of the vehicle, as text
    # the table of what the plan counts on and what the vehicle was set to; empty for a flight that had none
    limits: tuple[dict[str, Any], ...] = ()

    def as_json(self) -> dict[str, Any]:
        """For ``run.json`` and ``--json``."""
        return {
            "ending": self.ending.key,
            "waypoints_reached": self.waypoints_reached,
            "samples": self.sample_count,
            "duration_s": self.duration_s,
            "simulated_by": self.simulated_by,
            "vehicle_now": self.vehicle_now,
            "incidents": [{**asdict(incident), "kind": incident.kind.key} for incident in self.incidents],
            **({"limits": list(self.limits)} if self.limits else {}),
        }


class FlightFaultError(VehicleError):
    """Something that ends following the vehicle.

    Attributes:
        ending: the name of it.
    """

    def __init__(self, ending: Ending, text: str) -> None:
        self.ending = ending
        super().__init__(text)


class FlightFailedError(VehicleError):
    """A flight that did not end as planned.

    Attributes:
        outcome: of the flight.
    """

    def __init__(self, text: str, outcome: FlightOutcome) -> None:
        self.outcome = outcome
        super().__init__(text)

    def details(self) -> dict[str, Any]:
        """The outcome, for programs."""
        return self.outcome.as_json()

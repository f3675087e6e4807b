"""Limits of a flight: height band, fence, obstacles, no-fly zones and the times when these are in force."""

import re
from dataclasses import dataclass
from datetime import UTC, datetime, time, timedelta, timezone, tzinfo
from typing import ClassVar, Literal

import numpy as np

from mission_io.data_tables import (
    STRICT,
    require,
    require_between,
    require_lon_lat,
    require_not_negative,
    require_positive,
)
from uavcover.kernels.arrays import FloatArray
from uavcover.model.area import Ring, Rings

Window = tuple[datetime, datetime]
"""First and last moment, in UTC."""

DAYS = ("MON", "TUE", "WED", "THU", "FRI", "SAT", "SUN")

_EXAMPLE = '"MON-FRI 08:00-17:00Z" or "2026-06-01T06:00Z/2026-06-03T18:00Z"'
_CLOCK = r"(\d{1,2}):(\d{2})(?::(\d{2})(?:\.\d+)?)?"
_HOURS = re.compile(rf"{_CLOCK}-{_CLOCK}(Z|[+-]\d{{2}}:\d{{2}})")
_A_DAY = timedelta(days=1)
_FIRST_YEAR, _LAST_YEAR = 1970, 2999
_FIRST_FLIGHT_S, _LAST_FLIGHT_S = 946_684_800.0, 32_472_144_000.0
"""The years 2000 and 2999."""


def utc_time(text: str, key: str) -> datetime:
    """A time of ISO 8601 with its zone, in UTC. Raises ValueError: it is not one; the message begins with the key."""
    try:
        moment = datetime.fromisoformat(text.strip())
    except ValueError:
        moment = None
    require(
        moment is not None and moment.tzinfo is not None,
        f"{key}: {text!r} is not a valid time; write it as 2026-06-01T06:00Z",
    )
    assert moment is not None
    try:
        return moment.astimezone(UTC)
    except OverflowError:
        raise ValueError(f"{key}: {text!r} is not a valid time; write it as 2026-06-01T06:00Z") from None


def is_flight_time(unix_s: float) -> bool:
    """Whether seconds since 1970 can be the time of a flight. Receivers without a fix send 0, or the time since start."""
    return _FIRST_FLIGHT_S <= unix_s < _LAST_FLIGHT_S


def flown_window(unix_time_s: FloatArray) -> Window | None:
    """First and last of the known times since 1970 of a track; None if none is known."""
    known = unix_time_s[np.isfinite(unix_time_s)]
    return None if known.size == 0 else (_moment(float(known.min())), _moment(float(known.max())))


def _moment(unix_s: float) -> datetime:
    return datetime.fromtimestamp(unix_s, UTC)


def window_text(window: Window) -> str:
    """Both ends, to the minute; the last one with its day only if that differs."""
    begin, end = window
    last = f"{end:%H:%M}" if begin.date() == end.date() else f"{end:%Y-%m-%d %H:%M}"
    return f"{begin:%Y-%m-%d %H:%M} to {last} UTC"


def window_of(begin: str, end: str, key: str) -> Window:
    """The time between two times.

    Raises:
        ValueError: one is not a time, or of no year of flight, or they are in the wrong order; the message begins with the key.
    """
    first, last = utc_time(begin, key), utc_time(end, key)
    for moment, text in ((first, begin), (last, end)):
        require(_FIRST_YEAR <= moment.year <= _LAST_YEAR, f"{key}: {text!r} is not a valid flight time")
    require(first < last, f"{key}: the latest landing must be after the earliest take-off")
    return first, last


@dataclass(frozen=True, slots=True)
class ActivePeriod:
    """A stretch of time, or the part of it on some days of the week and some hours of the day."""

    begin_utc: datetime | None = None  # its first moment; None: it has always begun
    end_utc: datetime | None = None  # its last moment; None: it does not end
    days: frozenset[int] = frozenset()  # numbers of the weekdays on which it begins, Monday is 0; empty: every day
    hours: tuple[time, timedelta] | None = None  # when it begins on such a day and how long it lasts; None: all day
    zone: tzinfo = UTC  # where these days and hours are counted

    def meets(self, window: Window) -> bool:
        """Whether any moment of it lies in a window, ends included."""
        begin = window[0] if self.begin_utc is None else max(window[0], self.begin_utc)
        end = window[1] if self.end_utc is None else min(window[1], self.end_utc)
        if begin > end:
            return False
        if not self.days and self.hours is None:
            return True
        first, lasts = self.hours or (time(), _A_DAY)
        # From the day before: hours may go on over midnight.
        day = begin.astimezone(self.zone).date() - _A_DAY
        for _ in range(10):  # days of a window that are examined: every day of the week is among them
            opens = datetime.combine(day, first, tzinfo=self.zone)
            if opens > end:
                return False
            if (not self.days or day.weekday() in self.days) and opens + lasts >= begin:
                return True
            day += _A_DAY
        return False


def active_period(text: str, key: str) -> ActivePeriod:
    """Read a period from text.

    It has an ISO 8601 interval, days of the week and hours, each at most once.

    An open end of an interval is ``..``. Days are MON to SUN, as a list or a range; hours have a zone, ``Z`` or ``+02:00``,
    and may go on over midnight, on the day after. Days without hours are days of UTC.

    Raises:
        ValueError: it is not one; the message begins with the key.
    """
    interval: tuple[datetime | None, datetime | None] | None = None
    days: frozenset[int] | None = None
    hours: tuple[tuple[time, timedelta], tzinfo] | None = None
    words = text.split()
    wrong = f"{key}: {text[:60]!r} is not a valid period; write, for example, {_EXAMPLE}"
    require(bool(words), wrong)
    for word in words:
        if "/" in word:
            require(interval is None, wrong)
            interval = _interval(word, key)
        elif (match := _HOURS.fullmatch(word)) is not None:
            require(hours is None, wrong)
            hours = _hours(match, wrong)
        else:
            found = _days(word.upper())
            require(days is None and bool(found), wrong)
            days = found
    begin, end = interval or (None, None)
    return ActivePeriod(begin, end, days or frozenset(), *(hours or (None, UTC)))


def _interval(word: str, key: str) -> tuple[datetime | None, datetime | None]:
    first, _, last = word.partition("/")
    begin, end = (None if part == ".." else utc_time(part, key) for part in (first, last))
    require(begin is None or end is None or begin < end, f"{key}: {word[:60]!r} ends before it begins")
    return begin, end


def _hours(match: re.Match[str], wrong: str) -> tuple[tuple[time, timedelta], tzinfo]:
    seconds = []
    for hour, minute, second in (match.group(1, 2, 3), match.group(4, 5, 6)):
        total = int(hour) * 3600 + int(minute) * 60 + int(second or 0)
        require(int(minute) < 60 and int(second or 0) < 60 and total <= 86400, wrong)
        seconds.append(total)
    begin, end = seconds
    require(begin < 86400, wrong)
    lasts = timedelta(seconds=(end - begin) % 86400 or 86400)
    return ((datetime.min + timedelta(seconds=begin)).time(), lasts), _zone(match[7], wrong)


def _zone(text: str, wrong: str) -> tzinfo:
    if text == "Z":
        return UTC
    offset = timedelta(hours=int(text[1:3]), minutes=int(text[4:6]))
    require(offset < _A_DAY and int(text[4:6]) < 60, wrong)
    return timezone(-offset if text[0] == "-" else offset)


def _days(word: str) -> frozenset[int]:
    """Numbers of weekdays; empty where the word is not one of days."""
    found: set[int] = set()
    for part in word.split(","):
        first, dash, last = part.partition("-")
        last = last if dash else first
        if first not in DAYS or last not in DAYS:
            return frozenset()
        begin, end = DAYS.index(first), DAYS.index(last)
        found |= {(begin + k) % 7 for k in range((end - begin) % 7 + 1)}
    return frozenset(found)


# Take-off and landing position of a vehicle.


@dataclass(frozen=True, slots=True, kw_only=True)
class Home:
    """Take-off and landing position on the ground. Use one of the two pairs of keys."""

    __pydantic_config__: ClassVar = STRICT

    lat_deg: float | None = None  # latitude on WGS 84
    lon_deg: float | None = None  # longitude on WGS 84
    east_m: float | None = None  # east in the local frame, for areas given in metres
    north_m: float | None = None  # north in the local frame

    def __post_init__(self) -> None:
        geographic = self.lat_deg is not None and self.lon_deg is not None
        local = self.east_m is not None and self.north_m is not None
        any_geographic = self.lat_deg is not None or self.lon_deg is not None
        any_local = self.east_m is not None or self.north_m is not None
        require(
            (geographic and not any_local) or (local and not any_geographic),
            "specify lat_deg and lon_deg, or east_m and north_m",
        )
        require_between(self, -90.0, 90.0, "lat_deg")
        require_between(self, -180.0, 180.0, "lon_deg")


FENCE_KEYS = ("fence_lon_lat_deg", "fence_east_north_m", "fence_polygons_lon_lat_deg", "fence_polygons_east_north_m")


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightLimits:
    """Hard limits. The height band applies between the first and last planned waypoint, other limits to the whole flight."""

    __pydantic_config__: ClassVar = STRICT

    min_height_agl_m: float  # lowest height above ground on the planned route
    max_height_agl_m: float  # greatest height above ground on the planned route
    min_alt_amsl_m: float | None = None  # lowest altitude above sea level; default: no limit
    max_alt_amsl_m: float | None = None  # greatest altitude above sea level; default: no limit
    # margin for tracking errors. Planned routes keep this distance from both ends of the height band and from the
    # transit clearance.
    height_margin_m: float = 0.0
    transit_clearance_m: float = 20.0  # lowest height above ground on transit legs, except directly above home
    # greatest height above ground on transit legs, take-off and landing; default: 30 m above the highest of the height
    # band, the take-off and return heights, and the target height of the transit
    max_transit_height_agl_m: float | None = None
    max_climb_angle_deg: float = 30.0  # steepest permitted leg, up or down
    fence_margin_m: float = 150.0  # distance of the default fence from the convex hull of area and home
    # the fence as a ring of (longitude, latitude) pairs
    fence_lon_lat_deg: tuple[tuple[float, float], ...] | None = None
    fence_east_north_m: tuple[tuple[float, float], ...] | None = None  # the fence as a ring in the local frame
    # the fence as several rings that overlap or share edges. The vehicle stays inside their union.
    fence_polygons_lon_lat_deg: tuple[Ring, ...] | None = None
    fence_polygons_east_north_m: tuple[Ring, ...] | None = None  # the fence as several rings in the local frame
    # "legs": limits apply to the full length of every leg. "waypoints": limits apply only to the waypoints, as in the
    # paper.
    applies_to: Literal["legs", "waypoints"] = "legs"
    # largest difference between the actual and the planned home, horizontally and in height
    max_home_error_m: float = 10.0

    def __post_init__(self) -> None:
        require_not_negative(self, "min_height_agl_m", "height_margin_m", "transit_clearance_m", "fence_margin_m")
        require_positive(self, "max_home_error_m")
        require(
            self.max_height_agl_m - self.min_height_agl_m > 2.0 * self.height_margin_m,
            f"max_height_agl_m: the band {self.min_height_agl_m}..{self.max_height_agl_m} m is too narrow for "
            f"height_margin_m = {self.height_margin_m} at each end",
        )
        ceiling = self.max_transit_height_agl_m
        require(
            ceiling is None or ceiling > self.transit_clearance_m + self.height_margin_m,
            f"max_transit_height_agl_m: {ceiling} is too low for transit_clearance_m and height_margin_m",
        )
        require(
            0.0 < self.max_climb_angle_deg < 90.0,
            f"max_climb_angle_deg: must be between 0 and 90 degrees, not {self.max_climb_angle_deg}",
        )
        if self.min_alt_amsl_m is not None and self.max_alt_amsl_m is not None:
            require(
                self.max_alt_amsl_m > self.min_alt_amsl_m,
                f"max_alt_amsl_m: must be greater than min_alt_amsl_m = {self.min_alt_amsl_m}, not {self.max_alt_amsl_m}",
            )
        given = [key for key in FENCE_KEYS if getattr(self, key) is not None]
        require(
            len(given) <= 1,
            f"{given[0] if given else ''}: specify the fence only once, not also as {given[-1] if given else ''}",
        )
        require_lon_lat(self.fence_lon_lat_deg or (), "fence_lon_lat_deg")
        for number, ring in enumerate(self.fence_polygons_lon_lat_deg or ()):
            require_lon_lat(ring, f"fence_polygons_lon_lat_deg.{number}")
        for key in FENCE_KEYS[2:]:
            require(getattr(self, key) != (), f"{key}: the list is empty; specify a list of rings, or remove this key")

    @property
    def fence_key(self) -> str | None:
        """The key by which the fence is given; None for the default fence."""
        return next((key for key in FENCE_KEYS if getattr(self, key) is not None), None)

    @property
    def fence_rings_lon_lat_deg(self) -> list[Ring]:
        """The rings of a fence in degrees; empty for another fence."""
        ring = self.fence_lon_lat_deg
        return [ring] if ring is not None else list(self.fence_polygons_lon_lat_deg or ())


@dataclass(frozen=True, slots=True, kw_only=True)
class Obstacle:
    """A footprint with a flat top. Exactly one of the two kinds of rings is given: the outline, then courtyards."""

    __pydantic_config__: ClassVar = STRICT

    height_m: float  # height of the top above the highest ground under the footprint
    rings_lon_lat_deg: tuple[Ring, ...] = ()  # rings of (longitude, latitude) pairs on WGS 84
    rings_east_north_m: tuple[Ring, ...] = ()  # rings in the local frame
    name: str = ""  # name of the obstacle in reports

    def __post_init__(self) -> None:
        require_positive(self, "height_m")
        require(
            bool(self.rings_lon_lat_deg) != bool(self.rings_east_north_m),
            "rings: specify exactly one of rings_lon_lat_deg and rings_east_north_m",
        )
        for ring in self.rings_lon_lat_deg:
            require_lon_lat(ring, "rings_lon_lat_deg")


@dataclass(frozen=True, slots=True, kw_only=True)
class Obstacles:
    """Obstacles, and the clearance from them on the whole flight."""

    __pydantic_config__: ClassVar = STRICT

    # a `.geojson`, `.kml`, `.kmz` or `.csv` file, relative to the scenario file, or `bundled:NAME`
    file: str | None = None
    prisms: tuple[Obstacle, ...] = ()  # obstacles in the scenario file
    clearance_beside_m: float = 10.0  # smallest horizontal distance from a footprint, unless the vehicle passes above
    clearance_above_m: float = 10.0  # height above the top from which the vehicle may pass over the obstacle

    def __post_init__(self) -> None:
        require_not_negative(self, "clearance_beside_m", "clearance_above_m")
        require(
            self.clearance_beside_m <= 50.0,
            f"clearance_beside_m: must be at most 50 m, not {self.clearance_beside_m} m",
        )


OUTLINES = (
    "file", "polygon_lon_lat_deg", "polygon_east_north_m", "polygons_lon_lat_deg", "center_lon_lat_deg",
    "center_east_north_m",
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class NoFly:
    """A zone that the vehicle must not enter, or a file of such zones. Provide exactly one outline.

    Without a floor, the zone starts at the ground. Without a ceiling, it is unlimited. If a zone has two floors, the lower
    one counts. If it has two ceilings, the higher one counts.
    """

    __pydantic_config__: ClassVar = STRICT

    # a file of zones, relative to the scenario file: GeoJSON, KML, KMZ, GeoPackage, Shapefile, WKT, .plan, .poly,
    # ED-269 or ED-318 JSON, or OpenAir (.txt, .air). Values in this table apply to zones that do not state their own.
    # Zones more than 20 km from area, home and fence are ignored.
    file: str | None = None
    make_valid: bool = False  # whether to repair outlines that cross themselves and rings that are not closed
    # names or identifiers of zones in the file that do not count, such as zones for which you have a clearance
    ignore: tuple[str, ...] = ()
    polygon_lon_lat_deg: Ring | None = None  # outline as a ring of (longitude, latitude) pairs
    polygon_east_north_m: Ring | None = None  # outline as a ring in the local frame
    # several polygons; each is a list of rings with the outer ring first
    polygons_lon_lat_deg: tuple[Rings, ...] | None = None
    center_lon_lat_deg: tuple[float, float] | None = None  # (longitude, latitude) of the centre of a circle
    center_east_north_m: tuple[float, float] | None = None  # centre of a circle in the local frame
    radius_m: float | None = None  # radius of the circle
    floor_agl_m: float | None = None  # lower limit above the ground below the vehicle
    floor_amsl_m: float | None = None  # lower limit above mean sea level
    ceiling_agl_m: float | None = None  # upper limit above the ground below the vehicle
    ceiling_amsl_m: float | None = None  # upper limit above mean sea level
    # start of the time in which the zone is active, such as "2026-06-01T06:00Z"; default: always active
    from_utc: str | None = None
    until_utc: str | None = None  # end of the time in which the zone is active
    # periods in which the zone is active: "MON-FRI 08:00-17:00Z", "SAT,SUN", "22:00-06:00+02:00",
    # "2026-06-01T06:00Z/2026-06-03T18:00Z", or an interval with days and hours. ".." is an open end. Default: always
    # active.
    active: tuple[str, ...] = ()
    # horizontal distance that planned legs keep from the zone. The vertical distance is limits.height_margin_m.
    # Verification uses the zone without margins.
    margin_m: float = 10.0
    name: str = ""  # name of the zone in reports

    def __post_init__(self) -> None:
        given = [key for key in OUTLINES if getattr(self, key) is not None]
        require(len(given) == 1, f"specify exactly one of {', '.join(OUTLINES[:-1])} and {OUTLINES[-1]}")
        require(self.file is None or bool(self.file.strip()), "file: the name is empty; specify a file with zones")
        for key in ("ignore", "make_valid"):
            require(not getattr(self, key) or self.file is not None, f"{key}: this key requires file")
        circle = self.center_lon_lat_deg is not None or self.center_east_north_m is not None
        require(
            circle == (self.radius_m is not None),
            "radius_m: this key requires center_lon_lat_deg or center_east_north_m",
        )
        require_not_negative(self, "margin_m")
        require(self.margin_m <= 1000.0, f"margin_m: must be at most 1000 m, not {self.margin_m} m")
        require_positive(self, "radius_m")
        require_lon_lat(self.polygon_lon_lat_deg or (), "polygon_lon_lat_deg")
        for number, rings in enumerate(self.polygons_lon_lat_deg or ()):
            require(bool(rings), "polygons_lon_lat_deg: expected a list of polygons, each a list of rings")
            for ring in rings:
                require_lon_lat(ring, f"polygons_lon_lat_deg.{number}")
        if self.center_lon_lat_deg is not None:
            require_lon_lat((self.center_lon_lat_deg,), "center_lon_lat_deg")
        for datum in ("agl_m", "amsl_m"):
            floor, ceiling = getattr(self, f"floor_{datum}"), getattr(self, f"ceiling_{datum}")
            require(
                floor is None or ceiling is None or ceiling > floor,
                f"ceiling_{datum}: must be greater than floor_{datum} = {floor}, not {ceiling}",
            )
        begin, end = (
            None if text is None else utc_time(text, key)
            for key, text in (("from_utc", self.from_utc), ("until_utc", self.until_utc))
        )
        require(begin is None or end is None or begin < end, "until_utc: must be later than from_utc")
        for number, text in enumerate(self.active):
            active_period(text, f"active.{number}")

    @property
    def is_geographic(self) -> bool:
        """Whether its outline is in longitude and latitude."""
        return self.polygon_east_north_m is None and self.center_east_north_m is None

    @property
    def parts(self) -> tuple[Rings, ...]:
        """The polygons in its own coordinates; empty for a circle or a file."""
        ring = self.polygon_lon_lat_deg or self.polygon_east_north_m
        return ((ring,),) if ring is not None else self.polygons_lon_lat_deg or ()

    @property
    def has_heights(self) -> bool:
        """Whether there is a floor or a ceiling."""
        return (self.floor_agl_m, self.floor_amsl_m, self.ceiling_agl_m, self.ceiling_amsl_m) != (None,) * 4

    @property
    def has_times(self) -> bool:
        """Whether it is inactive at some times."""
        return self.from_utc is not None or self.until_utc is not None or bool(self.active)

    def in_force(self, window: Window | None) -> bool:
        """Whether it is in force at some time of a window, ends included. Without a window it counts as in force."""
        if window is None:
            return True
        begin, end = window
        if self.from_utc is not None:
            begin = max(begin, utc_time(self.from_utc, "from_utc"))
        if self.until_utc is not None:
            end = min(end, utc_time(self.until_utc, "until_utc"))
        if begin > end:
            return False
        return not self.active or any(active_period(text, "active").meets((begin, end)) for text in self.active)

"""Limits of a flight, and what it must keep clear of: obstacles and no-fly zones."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from uavcover.model.active_times import Window, active_period, utc_time
from uavcover.model.area import Ring, Rings
from uavcover.model.value_checks import (
    STRICT,
    require,
    require_between,
    require_lon_lat,
    require_not_negative,
    require_positive,
)

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
        """The key by which the fence is given; none for the default fence."""
        return next((key for key in FENCE_KEYS if getattr(self, key) is not None), None)

    @property
    def fence_rings_lon_lat_deg(self) -> list[Ring]:
        """The rings of a fence in degrees; none of another one."""
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
        """The polygons in its own coordinates; none for a circle or a file."""
        ring = self.polygon_lon_lat_deg or self.polygon_east_north_m
        return ((ring,),) if ring is not None else self.polygons_lon_lat_deg or ()

    @property
    def has_heights(self) -> bool:
        """Whether there is a floor or a ceiling."""
        return (self.floor_agl_m, self.floor_amsl_m, self.ceiling_agl_m, self.ceiling_amsl_m) != (None,) * 4

    @property
    def has_times(self) -> bool:
        """Whether there are times at which it is not in force."""
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

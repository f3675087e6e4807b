"""Hard limits of the flight: declared once, and read by planning, compiling and verification."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from uavcover.model.area import Ring
from uavcover.model.value_checks import STRICT, require, require_lon_lat, require_not_negative, require_positive

# Take-off and landing position of a vehicle.


@dataclass(frozen=True, slots=True, kw_only=True)
class Home:
    """Take-off and landing position on the ground. Use one of the two pairs of keys.

    Attributes:
        lat_deg: latitude on WGS 84.
        lon_deg: longitude on WGS 84.
        east_m: east in the local frame, for areas given in metres.
        north_m: north in the local frame.
    """

    __pydantic_config__: ClassVar = STRICT

    lat_deg: float | None = None
    lon_deg: float | None = None
    east_m: float | None = None
    north_m: float | None = None

    def __post_init__(self) -> None:
        geographic = self.lat_deg is not None and self.lon_deg is not None
        local = self.east_m is not None and self.north_m is not None
        any_geographic = self.lat_deg is not None or self.lon_deg is not None
        any_local = self.east_m is not None or self.north_m is not None
        require(
            (geographic and not any_local) or (local and not any_geographic),
            "specify lat_deg and lon_deg, or east_m and north_m",
        )
        require(
            self.lat_deg is None or abs(self.lat_deg) <= 90.0,
            f"lat_deg: must be between -90 and 90, not {self.lat_deg}",
        )
        require(
            self.lon_deg is None or abs(self.lon_deg) <= 180.0,
            f"lon_deg: must be between -180 and 180, not {self.lon_deg}",
        )


FENCE_KEYS = ("fence_lon_lat_deg", "fence_east_north_m", "fence_polygons_lon_lat_deg", "fence_polygons_east_north_m")


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightLimits:
    """Hard limits. The height band applies between the first and last planned waypoint, other limits to the whole flight.

    Attributes:
        min_height_agl_m: lowest height above ground on the planned route.
        max_height_agl_m: greatest height above ground on the planned route.
        min_alt_amsl_m: lowest altitude above sea level; default: no limit.
        max_alt_amsl_m: greatest altitude above sea level; default: no limit.
        height_margin_m: margin for tracking errors. Planned routes keep this distance from both ends of the height band
            and from the transit clearance.
        transit_clearance_m: lowest height above ground on transit legs, except directly above home.
        max_transit_height_agl_m: greatest height above ground on transit legs, take-off and landing; default: 30 m
            above the highest of the height band, the take-off and return heights, and the target height of the transit.
        max_climb_angle_deg: steepest permitted leg, up or down.
        fence_margin_m: distance of the default fence from the convex hull of area and home.
        fence_lon_lat_deg: the fence as a ring of (longitude, latitude) pairs.
        fence_east_north_m: the fence as a ring in the local frame.
        fence_polygons_lon_lat_deg: the fence as several rings that overlap or share edges. The vehicle stays inside
            their union.
        fence_polygons_east_north_m: the fence as several rings in the local frame.
        applies_to: "legs": limits apply to the full length of every leg. "waypoints": limits apply only to the
            waypoints, as in the paper.
        max_home_error_m: largest difference between the actual and the planned home, horizontally and in height.
    """

    __pydantic_config__: ClassVar = STRICT

    min_height_agl_m: float
    max_height_agl_m: float
    min_alt_amsl_m: float | None = None
    max_alt_amsl_m: float | None = None
    height_margin_m: float = 0.0
    transit_clearance_m: float = 20.0
    max_transit_height_agl_m: float | None = None
    max_climb_angle_deg: float = 30.0
    fence_margin_m: float = 150.0
    fence_lon_lat_deg: tuple[tuple[float, float], ...] | None = None
    fence_east_north_m: tuple[tuple[float, float], ...] | None = None
    fence_polygons_lon_lat_deg: tuple[Ring, ...] | None = None
    fence_polygons_east_north_m: tuple[Ring, ...] | None = None
    applies_to: Literal["legs", "waypoints"] = "legs"
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

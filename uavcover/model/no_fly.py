"""No-fly zones: parts of the airspace that the vehicle must not enter, with floor, ceiling and times."""

from dataclasses import dataclass
from typing import ClassVar

from uavcover.model.active_times import Window, active_period, utc_time
from uavcover.model.area import Ring, Rings
from uavcover.model.value_checks import STRICT, require, require_lon_lat, require_not_negative, require_positive

OUTLINES = (
    "file", "polygon_lon_lat_deg", "polygon_east_north_m", "polygons_lon_lat_deg", "center_lon_lat_deg",
    "center_east_north_m",
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class NoFly:
    """A zone that the vehicle must not enter, or a file of such zones. Provide exactly one outline.

    Without a floor, the zone starts at the ground. Without a ceiling, it is unlimited. If a zone has two floors, the lower
    one counts. If it has two ceilings, the higher one counts.

    Attributes:
        file: a file of zones, relative to the scenario file: GeoJSON, KML, KMZ, GeoPackage, Shapefile, WKT, .plan,
            .poly, ED-269 or ED-318 JSON, or OpenAir (.txt, .air). Values in this table apply to zones that do not state
            their own. Zones more than 20 km from area, home and fence are ignored.
        make_valid: whether to repair outlines that cross themselves and rings that are not closed.
        ignore: names or identifiers of zones in the file that do not count, such as zones for which you have a
            clearance.
        polygon_lon_lat_deg: outline as a ring of (longitude, latitude) pairs.
        polygon_east_north_m: outline as a ring in the local frame.
        polygons_lon_lat_deg: several polygons; each is a list of rings with the outer ring first.
        center_lon_lat_deg: (longitude, latitude) of the centre of a circle.
        center_east_north_m: centre of a circle in the local frame.
        radius_m: radius of the circle.
        floor_agl_m: lower limit above the ground below the vehicle.
        floor_amsl_m: lower limit above mean sea level.
        ceiling_agl_m: upper limit above the ground below the vehicle.
        ceiling_amsl_m: upper limit above mean sea level.
        from_utc: start of the time in which the zone is active, such as "2026-06-01T06:00Z"; default: always active.
        until_utc: end of the time in which the zone is active.
        active: periods in which the zone is active: "MON-FRI 08:00-17:00Z", "SAT,SUN", "22:00-06:00+02:00",
            "2026-06-01T06:00Z/2026-06-03T18:00Z", or an interval with days and hours. ".." is an open end. Default:
            always active.
        margin_m: horizontal distance that planned legs keep from the zone. The vertical distance is
            limits.height_margin_m. Verification uses the zone without margins.
        name: name of the zone in reports.
    """

    __pydantic_config__: ClassVar = STRICT

    file: str | None = None
    make_valid: bool = False
    ignore: tuple[str, ...] = ()
    polygon_lon_lat_deg: Ring | None = None
    polygon_east_north_m: Ring | None = None
    polygons_lon_lat_deg: tuple[Rings, ...] | None = None
    center_lon_lat_deg: tuple[float, float] | None = None
    center_east_north_m: tuple[float, float] | None = None
    radius_m: float | None = None
    floor_agl_m: float | None = None
    floor_amsl_m: float | None = None
    ceiling_agl_m: float | None = None
    ceiling_amsl_m: float | None = None
    from_utc: str | None = None
    until_utc: str | None = None
    active: tuple[str, ...] = ()
    margin_m: float = 10.0
    name: str = ""

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

"""Clearance from obstacles, which block the sensor's view and must not be hit."""

from dataclasses import dataclass
from typing import ClassVar

from uavcover.model.area import Ring
from uavcover.model.value_checks import STRICT, require, require_lon_lat, require_not_negative, require_positive


@dataclass(frozen=True, slots=True, kw_only=True)
class Obstacle:
    """A footprint with a flat top. Exactly one of the two kinds of rings is given: the outline, then courtyards.

    Attributes:
        height_m: height of the top above the highest ground under the footprint.
        rings_lon_lat_deg: rings of (longitude, latitude) pairs on WGS 84.
        rings_east_north_m: rings in the local frame.
        name: name of the obstacle in reports.
    """

    __pydantic_config__: ClassVar = STRICT

    height_m: float
    rings_lon_lat_deg: tuple[Ring, ...] = ()
    rings_east_north_m: tuple[Ring, ...] = ()
    name: str = ""

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
    """Obstacles, and the clearance from them on the whole flight.

    Attributes:
        file: a `.geojson`, `.kml`, `.kmz` or `.csv` file, relative to the scenario file, or `bundled:NAME`.
        prisms: obstacles in the scenario file.
        clearance_beside_m: smallest horizontal distance from a footprint, unless the vehicle passes above.
        clearance_above_m: height above the top from which the vehicle may pass over the obstacle.
    """

    __pydantic_config__: ClassVar = STRICT

    file: str | None = None
    prisms: tuple[Obstacle, ...] = ()
    clearance_beside_m: float = 10.0
    clearance_above_m: float = 10.0

    def __post_init__(self) -> None:
        require_not_negative(self, "clearance_beside_m", "clearance_above_m")
        require(
            self.clearance_beside_m <= 50.0,
            f"clearance_beside_m: must be at most 50 m, not {self.clearance_beside_m} m",
        )

"""The area to cover: a polygon with holes, divided into square cells."""

from dataclasses import dataclass
from typing import ClassVar

from uavcover.model.value_checks import STRICT, require, require_lon_lat, require_positive

Ring = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Area:
    """The area to cover, as the scenario gives it: exactly one of the three polygon keys.

    Attributes:
        polygon_lon_lat_deg: outer ring as (longitude, latitude) pairs on WGS 84, the order of GeoJSON.
        polygon_east_north_m: outer ring in the local frame.
        geojson: a GeoJSON file with one Polygon, holes included; relative to the scenario file.
        holes_lon_lat_deg: rings that need no coverage, with ``polygon_lon_lat_deg``.
        holes_east_north_m: the same with ``polygon_east_north_m``.
        cell_size_m: side of the square cells on which results are judged. A cell is seen when its centre is.
    """

    __pydantic_config__: ClassVar = STRICT

    cell_size_m: float
    polygon_lon_lat_deg: Ring | None = None
    polygon_east_north_m: Ring | None = None
    geojson: str | None = None
    holes_lon_lat_deg: tuple[Ring, ...] = ()
    holes_east_north_m: tuple[Ring, ...] = ()

    def __post_init__(self) -> None:
        require_positive(cell_size_m=self.cell_size_m)
        given = [self.polygon_lon_lat_deg is not None, self.polygon_east_north_m is not None, self.geojson is not None]
        require(sum(given) == 1, "give exactly one of polygon_lon_lat_deg, polygon_east_north_m and geojson")
        require(
            not self.holes_lon_lat_deg or self.polygon_lon_lat_deg is not None,
            "holes_lon_lat_deg: goes with polygon_lon_lat_deg",
        )
        require(
            not self.holes_east_north_m or self.polygon_east_north_m is not None,
            "holes_east_north_m: goes with polygon_east_north_m",
        )
        require_lon_lat(self.polygon_lon_lat_deg or (), "polygon_lon_lat_deg")
        for hole in self.holes_lon_lat_deg:
            require_lon_lat(hole, "holes_lon_lat_deg")

    @property
    def is_geographic(self) -> bool:
        """Whether the area's own coordinates are geographic."""
        return self.polygon_east_north_m is None

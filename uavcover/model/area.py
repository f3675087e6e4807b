"""The area to be covered, and the elevation data of its terrain."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
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

# A small map as SVG, for notebooks: lines and areas in metres, north up, with a scale bar. No dependency.

_WIDTH_PX = 420.0
_MARGIN_PX = 12.0
_STYLES = {
    "area": 'fill="#e8eef4" stroke="#7b8794"',
    "gap": 'fill="#d64545" stroke="none"',
    "route": 'fill="none" stroke="#2563ab" stroke-width="1.5"',
    "track": 'fill="none" stroke="#d97706" stroke-width="1.2"',
}


def svg_map(shapes: Sequence[tuple[str, FloatArray]], caption: str) -> str:
    """An inline SVG with a caption.

    Args:
        shapes: what each is ("area", "gap", "route" or "track") and its (n, 2) or (n, 3) east and north, metres.
        caption: one line.
    """
    drawn = [(kind, np.asarray(points, dtype=float)[:, :2]) for kind, points in shapes if len(points)]
    if not drawn:
        return f"<p>{escape(caption)}</p>"
    every = np.vstack([points for _, points in drawn])
    west, south = every.min(axis=0)
    extent_m = float(max(*(every.max(axis=0) - (west, south)), 1.0))
    scale = (_WIDTH_PX - 2 * _MARGIN_PX) / extent_m
    north = float(every[:, 1].max())
    height_px = (north - south) * scale + 2 * _MARGIN_PX + 20.0
    parts = []
    for kind, points in drawn:
        positions = " ".join(
            f"{_MARGIN_PX + (east - west) * scale:.1f},{_MARGIN_PX + (north - n) * scale:.1f}" for east, n in points
        )
        shape = "polygon" if kind in ("area", "gap") else "polyline"
        parts.append(f'<{shape} points="{positions}" {_STYLES[kind]}/>')
    bar_m = float(10.0 ** np.floor(np.log10(extent_m / 2.0)))
    foot_px = height_px - 8.0
    parts.append(
        f'<path d="M {_MARGIN_PX} {foot_px:.1f} h {bar_m * scale:.1f}" stroke="#333" stroke-width="2"/>'
        f'<text x="{_MARGIN_PX + bar_m * scale + 6:.1f}" y="{foot_px + 4:.1f}" font-size="11">{bar_m:g} m</text>'
    )
    return (
        f'<figure><svg xmlns="http://www.w3.org/2000/svg" width="{_WIDTH_PX:.0f}" height="{height_px:.0f}" role="img">'
        f"<title>{escape(caption)}</title>{''.join(parts)}</svg><figcaption>{escape(caption)}</figcaption></figure>"
    )


Ring = tuple[tuple[float, float], ...]
Rings = tuple[Ring, ...]
"""A polygon: its outer ring, then its holes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outline:
    """Polygons as a scenario gives them: exactly one of the six polygon keys."""

    __pydantic_config__: ClassVar = STRICT

    # outer ring as (longitude, latitude) pairs on WGS 84, in the order of GeoJSON
    polygon_lon_lat_deg: Ring | None = None
    polygon_east_north_m: Ring | None = None  # outer ring in the local frame
    geojson: str | None = None  # path of a GeoJSON file with one or several polygons, relative to the scenario file
    holes_lon_lat_deg: tuple[Ring, ...] = ()  # rings that need no coverage, for `polygon_lon_lat_deg`
    holes_east_north_m: tuple[Ring, ...] = ()  # rings that need no coverage, for `polygon_east_north_m`
    # several polygons; each is a list of rings with the outer ring first, as in a GeoJSON MultiPolygon. Polygons may
    # touch or overlap.
    polygons_lon_lat_deg: tuple[Rings, ...] | None = None
    polygons_east_north_m: tuple[Rings, ...] | None = None  # several polygons in the local frame
    file: str | None = None  # path of a file with one or several polygons, relative to the scenario file
    layer: str | None = None  # name of the layer in the file; default: the only layer
    feature: str | None = None  # name or number (from 1) of a feature in the file; default: all features
    crs: str | None = None  # coordinate system of the file, such as "EPSG:32632", if the file does not state it
    make_valid: bool = False  # whether to repair outlines that cross themselves and rings that are not closed
    swap_axes: bool = False  # whether the file stores latitude or north first

    def __post_init__(self) -> None:
        keys = (
            "polygon_lon_lat_deg", "polygon_east_north_m", "polygons_lon_lat_deg", "polygons_east_north_m", "file",
            "geojson",
        )  # fmt: skip
        given = [key for key in keys if getattr(self, key) is not None]
        require(len(given) == 1, f"specify exactly one of {', '.join(keys[:-1])} and {keys[-1]}")
        for key in ("layer", "feature", "crs", "make_valid", "swap_axes"):
            require(self.file is not None or not getattr(self, key), f"{key}: this key requires file")
        require(
            not self.holes_lon_lat_deg or self.polygon_lon_lat_deg is not None,
            "holes_lon_lat_deg: this key requires polygon_lon_lat_deg",
        )
        require(
            not self.holes_east_north_m or self.polygon_east_north_m is not None,
            "holes_east_north_m: this key requires polygon_east_north_m",
        )
        require_lon_lat(self.polygon_lon_lat_deg or (), "polygon_lon_lat_deg")
        for hole in self.holes_lon_lat_deg:
            require_lon_lat(hole, "holes_lon_lat_deg")
        for number, rings in enumerate(self.polygons_lon_lat_deg or ()):
            for ring in rings:
                require_lon_lat(ring, f"polygons_lon_lat_deg.{number}")
        for key in ("polygons_lon_lat_deg", "polygons_east_north_m"):
            parts = getattr(self, key)
            require(
                parts is None or (parts and all(parts)), f"{key}: expected a list of polygons, each a list of rings"
            )

    @property
    def is_geographic(self) -> bool:
        """Whether the area's own coordinates are geographic."""
        return self.polygon_east_north_m is None and self.polygons_east_north_m is None

    @property
    def parts(self) -> tuple[Rings, ...]:
        """Every polygon in the area's own coordinates; none while they are in a file."""
        if self.polygon_lon_lat_deg is not None:
            return ((self.polygon_lon_lat_deg, *self.holes_lon_lat_deg),)
        if self.polygon_east_north_m is not None:
            return ((self.polygon_east_north_m, *self.holes_east_north_m),)
        return self.polygons_lon_lat_deg or self.polygons_east_north_m or ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Area(Outline):
    """The area to cover."""

    __pydantic_config__: ClassVar = STRICT

    # largest side of the square cells on which results are evaluated. A cell counts as observed if one point inside it
    # is observed.
    cell_size_m: float
    # distance by which the area is extended outwards before planning and verification, so that photos overlap up to the
    # original edge. Holes do not change.
    margin_m: float = 0.0
    # smallest number of cells. An area with fewer cells uses smaller ones. 0 keeps `cell_size_m`.
    fewest_places: int = 25_000

    def __post_init__(self) -> None:
        require_positive(self, "cell_size_m")
        require_not_negative(self, "margin_m", "fewest_places")
        # Named: a class with slots is made anew, and super() without arguments looks for the one before.
        Outline.__post_init__(self)


VerticalDatum = Literal["EGM96", "EGM2008", "WGS84-ellipsoid"]
HeightUnit = Literal["m", "dm", "cm", "ft", "us-ft"]


@dataclass(frozen=True, slots=True, kw_only=True)
class RasterTerrain:
    """Elevation data in a file that rasterio reads."""

    __pydantic_config__: ClassVar = STRICT

    kind: Literal["raster"]  # name of this source in a scenario
    # a path relative to the scenario file, `bundled:NAME` for included data, a folder of tiles, a pattern such as
    # "tiles/*.hgt", a zipped tile, or a list of these
    file: str | tuple[str, ...]
    # vertical datum of the heights. Heights above the ellipsoid are converted to sea level (EGM96) if PROJ has the
    # geoid grid.
    vertical_datum: VerticalDatum
    crs: str | None = None  # coordinate system, such as "EPSG:32632", if the file does not state it
    band: int | str | None = None  # number or name of the band with the heights; default: the first band
    height_unit: HeightUnit | None = None  # unit of the heights if the file does not state it; default: metres
    fill_no_data_m: float = 0.0  # longest gap without data that is interpolated from its edge, such as a lake
    # altitude of open water, which replaces missing data in and around the files; default: missing data has no height
    water_height_m: float | None = None
    # whether to accept heights that look like a filled void, the edge of a warped image, a spike or a step between
    # tiles; otherwise such heights stop the planning
    trust_heights: bool = False
    # spacing of a square grid to which the data is resampled; default: the pixels of the file
    grid_step_m: float | None = None
    # a surface model with trees and roofs for the same area, in any form that `file` accepts. Heights above ground then
    # refer to the higher of both models, and the surface can hide the ground.
    surface_file: str | tuple[str, ...] | None = None
    # vertical datum of the surface model; default: `vertical_datum`
    surface_vertical_datum: VerticalDatum | None = None
    surface_crs: str | None = None  # coordinate system of the surface model if the file does not state it
    surface_band: int | str | None = None  # number or name of the band of the surface model; default: the first band
    surface_height_unit: HeightUnit | None = None  # unit of the surface model if the file does not state it
    surface_hides_m: float = 2.0  # height of the surface above the ground from which trees or roofs hide the ground

    def __post_init__(self) -> None:
        require(bool(self.file), "file: the name is empty; specify an elevation file")
        require(
            self.surface_file is None or bool(self.surface_file),
            "surface_file: the name is empty; specify a surface model",
        )
        for key in ("surface_vertical_datum", "surface_crs", "surface_band", "surface_height_unit"):
            require(
                self.surface_file is not None or getattr(self, key) is None,
                f"{key}: this key describes a surface model; add surface_file, or remove this key",
            )
        band = self.surface_band
        require(
            not isinstance(band, int) or band >= 1, f"surface_band: must be at least 1 (the first band), not {band}"
        )
        require_positive(self, "surface_hides_m")
        require(
            not isinstance(self.band, int) or self.band >= 1,
            f"band: must be at least 1 (the first band), not {self.band}",
        )
        require_not_negative(self, "fill_no_data_m")
        require(
            self.fill_no_data_m == 0.0 or self.grid_step_m is None,
            "fill_no_data_m: this key requires the file's own pixels; remove grid_step_m",
        )
        require(
            self.water_height_m is None or self.fill_no_data_m == 0.0,
            "water_height_m: use either this key, which treats gaps as water, or fill_no_data_m, which treats them as ground",
        )
        require_between(self, -500.0, 9000.0, "water_height_m", unit=" m")
        require_positive(self, "grid_step_m")


@dataclass(frozen=True, slots=True, kw_only=True)
class SineCosineTerrain:
    """The paper's surface, Eq. 26: z = s sin(y / s) cos(x / s), with s = ``scale_m`` metres to the paper's unit."""

    __pydantic_config__: ClassVar = STRICT

    kind: Literal["sine-cosine"]  # name of this source in a scenario
    scale_m: float = 1.0  # metres per unit of the paper

    def __post_init__(self) -> None:
        require_positive(self, "scale_m")


Terrain = RasterTerrain | SineCosineTerrain

"""Terrains of twelve kinds and six sensors, made for trying the planner where a method may fail; see scripts/bench/kinds.py.

Every scenario is written as a user would have it: an elevation file, an area and obstacles as GeoJSON, a TOML file. The file's
system has true metres around the middle of the area, so that a check needs no geodesy of the package.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import rasterio
import shapely
from pyproj import Transformer
from rasterio.transform import Affine

from tests.terrain.dem_files import fractal_m

LAT_DEG, LON_DEG = 46.31, 10.42
TRUE_TO_SCALE = f"+proj=tmerc +lat_0={LAT_DEG} +lon_0={LON_DEG} +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m"
PIXEL_M = 5.0
_AROUND_M = 400.0

Relief = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Heights above sea level of places east and north of the middle, metres."""


@dataclass(frozen=True, slots=True)
class Kind:
    """A terrain with its area.

    Attributes:
        relief: heights.
        area: polygon or polygons, metres east and north of the middle.
        cell_size_m: of the scenario.
        band_m: lowest and highest height above ground.
        margin_m: how far the planner stays inside it.
        prisms: (footprint, height above ground) pairs.
        beside_m: least distance from obstacles.
    """

    relief: Relief
    area: shapely.Geometry
    cell_size_m: float = 5.0
    band_m: tuple[float, float] = (50.0, 120.0)
    margin_m: float = 5.0
    prisms: tuple[tuple[shapely.Polygon, float], ...] = field(default=())


def fractal(number: int, steepest: float) -> Relief:
    """Rough ground of a number, and how steep it is at its steepest."""

    def heights(east: np.ndarray, north: np.ndarray) -> np.ndarray:
        assert east.shape == north.shape
        return np.asarray(fractal_m(np.random.default_rng(number), *east.shape, pixel_m=PIXEL_M, steepest=steepest))

    return heights


def _canyon(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    """A gorge 70 m wide and 85 m deep, with vertical walls, that winds through a plateau."""
    away = np.abs(north - 60.0 * np.sin(east / 90.0))
    return np.asarray(np.where(away < 35.0, 325.0, 410.0) + 0.02 * east)


def _volcano(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    away = np.hypot(east - 40.0, north + 20.0)
    return np.asarray(500.0 + np.maximum(0.0, 190.0 - 0.62 * away) - 1.5 * np.maximum(0.0, 60.0 - away))


def _terraces(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    up = 0.35 * (north + 0.4 * east) + 700.0
    return np.asarray(14.0 * np.floor(up / 14.0))


def flat(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    return np.asarray(120.0 + 0.0 * east * north)


def _ridge(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    return np.asarray(900.0 + 70.0 * np.exp(-(((north - 30.0 * np.sin(east / 200.0)) / 60.0) ** 2)) + 0.03 * east)


def _rolling(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    return np.asarray(250.0 + 22.0 * np.sin(east / 70.0) * np.cos(north / 55.0) + 0.05 * north)


def _city() -> tuple[tuple[shapely.Polygon, float], ...]:
    rng = np.random.default_rng(30)
    blocks = []
    for row in range(6):
        for column in range(5):
            x, y = -200.0 + 92.0 * column + rng.uniform(-8, 8), -205.0 + 78.0 * row + rng.uniform(-6, 6)
            house = shapely.box(x, y, x + rng.uniform(18, 45), y + rng.uniform(15, 34))
            house = shapely.affinity.rotate(house, rng.uniform(-15, 15))
            blocks.append((house, float(rng.uniform(8, 40))))
    return tuple(blocks)


_SQUARE = shapely.box(-231.3, -229.6, 228.1, 230.9)
"""Not along the pixels: cells whose centres all lie on nodes would be a sample of creases."""
_L = shapely.Polygon([(-250, -250), (250, -250), (250, -60), (-40, -60), (-40, 250), (-250, 250)]).difference(
    shapely.union_all([shapely.Point(-150, 60).buffer(45, 6), shapely.box(60, -200, 150, -130)])
)

KINDS: dict[str, Kind] = {
    "fractal": Kind(fractal(7, 1.2), _SQUARE),
    "canyon": Kind(_canyon, _SQUARE, band_m=(40.0, 150.0)),
    "volcano": Kind(_volcano, _SQUARE),
    "terraces": Kind(_terraces, _SQUARE),
    "flat": Kind(flat, _SQUARE),
    "city": Kind(flat, shapely.box(-215.0, -215.0, 215.0, 240.0), prisms=_city()),
    "L with holes": Kind(fractal(8, 0.6), _L),
    "strip": Kind(_ridge, shapely.affinity.rotate(shapely.box(-600.0, -60.0, 600.0, 60.0), 8.0)),
    "two parts": Kind(
        fractal(9, 0.8), shapely.MultiPolygon([shapely.box(-310, -150, -60, 140), shapely.box(90, -120, 320, 170)])
    ),
    "hectare": Kind(fractal(10, 0.8), shapely.box(-50.0, -50.0, 50.0, 50.0), cell_size_m=2.0),
    "40 m": Kind(_rolling, shapely.box(-20.0, -20.0, 20.0, 20.0), cell_size_m=1.0),
    "narrow band": Kind(_rolling, _SQUARE, band_m=(64.0, 80.0), margin_m=2.0),
}  # fmt: skip

SENSORS: dict[str, str] = {
    "nadir": 'kind = "nadir-camera"\nfov_deg = 70.0\nrange_m = 200.0\nmax_incidence_deg = 75.0\nmount = "stabilised"',
    "survey": 'kind = "frame-camera"\nfov_across_deg = 73.0\nfov_along_deg = 53.0\nrange_m = 250.0\nmount = "stabilised"\n'
    "forward_overlap = 0.75\nside_overlap = 0.6",
    "tilted": 'kind = "frame-camera"\nfov_across_deg = 60.0\nfov_along_deg = 45.0\nrange_m = 250.0\npitch_deg = -50.0\n'
    'mount = "stabilised"\nmax_incidence_deg = 80.0',
    "sphere": 'kind = "sphere"\nrange_m = 130.0\nsensing = "at-waypoints"',
    "pictures": 'kind = "frame-camera"\nfov_across_deg = 73.0\nfov_along_deg = 53.0\nrange_m = 250.0\nmount = "stabilised"\n'
    'sensing = "at-waypoints"\nheading_deg = 0.0',
    "sparse": 'kind = "frame-camera"\nfov_across_deg = 60.0\nfov_along_deg = 40.0\nrange_m = 250.0\nmount = "stabilised"\n'
    "trigger_distance_m = 40.0",
}  # fmt: skip

REQUIRED = {"sphere": 0.95, "pictures": 0.95}
"""Of what can be seen; 0.98 of the sensors that are not named."""

_SCENARIO = """\
name = "{name}"
select = "coverage>={required}"

[area]
geojson = "area.geojson"
cell_size_m = {cell_size_m}

[terrain]
kind = "raster"
file = "dem.tif"
vertical_datum = "EGM96"

[home]
lat_deg = {home_lat}
lon_deg = {home_lon}

[sensor]
{sensor}

[limits]
min_height_agl_m = {low}
max_height_agl_m = {high}
height_margin_m = {margin}
transit_clearance_m = 25.0
{limits}

[vehicle]
cruise_speed_m_s = 10.0
max_climb_m_s = 4.0
max_descent_m_s = 3.0
takeoff_height_m = 60.0
return_height_m = 100.0
{vehicle}
"""


def write_scenario(folder: Path, kind_name: str, sensor_name: str) -> Path:
    """The files of one kind of terrain and one kind of sensor; the scenario's file."""
    return write_kind(
        folder, KINDS[kind_name], name=f"{kind_name}, {sensor_name}", required=REQUIRED.get(sensor_name, 0.98),
        sensor=SENSORS[sensor_name],
    )  # fmt: skip


def write_kind(
    folder: Path,
    kind: Kind,
    *,
    name: str,
    required: float,
    sensor: str,
    limits: str = "",
    vehicle: str = "",
    more: str = "",
) -> Path:
    """The files of a terrain and the keys of a sensor, with more keys of two tables and more tables; the scenario's file."""
    west, south, east, north = kind.area.bounds
    columns, rows = (round((high - low + 2.0 * _AROUND_M) / PIXEL_M) for low, high in ((west, east), (south, north)))
    x = west - _AROUND_M + PIXEL_M * (np.arange(columns) + 0.5)
    y = north + _AROUND_M - PIXEL_M * (np.arange(rows) + 0.5)
    with rasterio.open(
        folder / "dem.tif", "w", driver="GTiff", width=columns, height=rows, count=1, crs=TRUE_TO_SCALE, dtype="float64",
        transform=Affine(PIXEL_M, 0.0, west - _AROUND_M, 0.0, -PIXEL_M, north + _AROUND_M),
    ) as file:  # fmt: skip
        file.write(kind.relief(*np.meshgrid(x, y)), 1)
    _write_geojson(folder / "area.geojson", [(kind.area, {})])
    to_earth = Transformer.from_crs(TRUE_TO_SCALE, 4326, always_xy=True)
    lon, lat = to_earth.transform(west - 60.0, south - 30.0)
    text = _SCENARIO.format(
        name=name, required=required, cell_size_m=kind.cell_size_m, home_lat=lat, home_lon=lon, sensor=sensor, low=kind.band_m[0],
        high=kind.band_m[1], margin=kind.margin_m, limits=limits, vehicle=vehicle,
    )  # fmt: skip
    if kind.prisms:
        _write_geojson(
            folder / "obstacles.geojson", [(house, {"height_m": height_m}) for house, height_m in kind.prisms]
        )
        text += '\n[obstacles]\nfile = "obstacles.geojson"\nclearance_beside_m = 8.0\nclearance_above_m = 8.0\n'
    text += more
    scenario = folder / "scenario.toml"
    scenario.write_text(text)
    return scenario


def _write_geojson(path: Path, shapes: list[tuple[shapely.Geometry, dict[str, float]]]) -> None:
    to_earth = Transformer.from_crs(TRUE_TO_SCALE, 4326, always_xy=True)
    features = [
        {
            "type": "Feature",
            "properties": properties,
            "geometry": shapely.geometry.mapping(shapely.transform(shape, to_earth.transform, interleaved=False)),
        }
        for shape, properties in shapes
    ]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))

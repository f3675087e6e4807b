"""Sites on flat ground from published areas; areas with holes of the AreaCoverage dataset beside their published routes.

The dataset (github.com/UNCCharlotte-CS-Robotics/AreaCoverage-dataset, AC300: 300 squares of one hectare with 1 to 15 buildings in
them) has a route for each area and its cost. A robot observes 1.5 m to each side, stops at each corner, flies 3 m/s and
accelerates with 1 m/s²: with these numbers the cost of each published route comes out to the published digits. Buildings are not
crossed. Both routes begin and end at the same corner, and the coverage of both is computed from their lines by shapely. There are
also published routes of several flights that each take at most 1,200 s.
"""

import dataclasses
import functools
import math
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import shapely
import tomli_w
from pyproj import Transformer

from uavcover.errors import InfeasibleError, InputError
from uavcover.extras.benchmarks.runs import KeptRuns, kept
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.flight_time import landing_time, takeoff_time
from uavcover.missions.flights import compile_sorties
from uavcover.missions.transit import transit
from uavcover.model.route import Plan
from uavcover.model.vehicle import AutopilotMotion, AutopilotName, Vehicle
from uavcover.planner.planner import Effort, plan_routes
from uavcover.scenario.site import Site, load_site
from uavcover.scenario.vehicles import pace_of

# routes are HEIGHT_M above the ground
HEIGHT_M, _ALT_AMSL_M, LAT_DEG, LON_DEG = 20.0, 100.0, 46.0, 10.0
CRS: Final = f"+proj=tmerc +lat_0={LAT_DEG} +lon_0={LON_DEG} +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m"

_SHARED: Final[Mapping[str, dict[str, Any]]] = MappingProxyType(
    {
        "area": {"fewest_places": 0},
        "terrain": {"kind": "raster", "file": "dem.asc", "crs": CRS, "vertical_datum": "EGM96"},
        "limits": {
            "min_height_agl_m": HEIGHT_M - 1.0, "max_height_agl_m": HEIGHT_M + 1.0, "height_margin_m": 0.9,
        },
        "vehicle": {"takeoff_height_m": HEIGHT_M},
        "planner": {"objective": "mission-time"},
    }
)  # fmt: skip


def earth_from_metres() -> Transformer:
    """From metres in `CRS` to longitude and latitude."""
    return Transformer.from_crs(CRS, 4326, always_xy=True)


def flat_site(
    folder: Path,
    tables: Mapping[str, Any],
    *,
    corner_m: tuple[float, float],
    shape: tuple[int, int],
    pixel_m: float,
) -> Site:
    """The site of a scenario over flat ground in ``dem.asc``; both files are written to a folder.

    Args:
        folder: for the files.
        tables: of the scenario, with what is not the same for all: ``_SHARED`` has the rest.
        corner_m: the south-west corner of the ground.
        shape: number of its rows and columns.
        pixel_m: side of a pixel.
    """
    rows, columns = shape
    (folder / "dem.asc").write_text(
        f"ncols {columns}\nnrows {rows}\nxllcorner {corner_m[0]}\nyllcorner {corner_m[1]}\n"
        f"cellsize {pixel_m}\nNODATA_value -9999\n" + (f"{_ALT_AMSL_M} " * columns + "\n") * rows,
        encoding="utf-8",
    )
    whole = {**tables, **{name: table | tables.get(name, {}) for name, table in _SHARED.items()}}
    (folder / "scenario.toml").write_text(tomli_w.dumps(whole), encoding="utf-8")
    return load_site(str(folder / "scenario.toml"))


def home_en_m(site: Site) -> FloatArray:
    """Home (2,) in metres of the site."""
    return np.zeros(2) if site.home_m is None else site.home_m[:2]


def planned(site: Site, name: str, budget_s: float) -> Plan:
    """The plan of a site within a processor time. Raises InfeasibleError: there is none; it has the name."""
    settings = site.scenario.planner
    effort = Effort(settings.evaluations, budget_s, time.process_time)
    try:
        return plan_routes(site, settings=settings, select_rule=site.scenario.select, effort=effort)
    except InfeasibleError as error:
        raise InfeasibleError(f"{name}: {error}") from error


SPEED_M_S, ACCELERATION_M_S2, REACH_M = 3.0, 1.0, 1.5
REQUIRED = 0.9999
"""Of the cells; the published routes observe 99.976 to 100 % of the areas."""

_PIXEL_M, _AROUND_M = 2.0, 100.0
_LEEWAY_M = 0.005
"""The fence is this much wider than the area, because its corners are rounded."""

_CLEAR_M = 0.1
"""Home stands this far outside of buildings, on whose corners the published routes begin."""


@dataclass(frozen=True, slots=True, eq=False)
class PublishedArea:
    """An area of the dataset."""

    name: str  # of its folder
    outline: shapely.Polygon  # what is to be observed, without the holes
    routes_m: tuple[FloatArray, ...]  # (n, 2) corners of each flight of the published route, closed

    def observed(self, routes_m: Sequence[FloatArray]) -> float:
        """Share 0..1 of the area within reach of the flights."""
        strip = shapely.buffer(shapely.MultiLineString(list(routes_m)), REACH_M, quad_segs=32)
        return float(shapely.intersection(strip, self.outline).area / self.outline.area)


class StoppingVehicle(Vehicle):
    """A vehicle that stops at each waypoint."""

    __slots__ = ()

    def motion(self, autopilot: AutopilotName | None = None) -> AutopilotMotion:
        """Motion from rest to rest."""
        return dataclasses.replace(
            Vehicle.motion(self, autopilot), corner_radius_m=1e-6, settling_s=0.0, smoothing_s=0.0
        )


def cost_s(route_m: FloatArray) -> float:
    """Time of an (n, 2) route from rest to rest on each leg."""
    legs_m = np.hypot(*np.diff(route_m, axis=0).T)
    long = legs_m >= SPEED_M_S**2 / ACCELERATION_M_S2
    return float(np.where(long, legs_m / SPEED_M_S + SPEED_M_S, 2.0 * np.sqrt(legs_m / ACCELERATION_M_S2)).sum())


def area_names(data: Path) -> list[str]:
    """Areas in a folder of the dataset that have holes and a published route, by name."""
    names = sorted(folder.parent.parent.name for folder in data.glob("*/mem_inf/mem_inf_route_data0"))
    if not names:
        raise InputError(f"{data}: no area with mem_inf/mem_inf_route_data0; specify the dataset's folder AC300")
    return names


def read_area(data: Path, name: str, capacity_s: float | None = None) -> PublishedArea:
    """An area of the dataset, with its route for flights of this capacity.

    Raises InputError: a file is missing or cannot be read.
    """
    folder, kind = data / name, "mem_inf" if capacity_s is None else f"mem_{capacity_s:.0f}"
    try:
        rings = [_rings(folder / file)[:] for file in ("outer_polygon", "holes")]
        routes = [np.loadtxt(path)[:, :2] for path in sorted((folder / kind).glob(f"{kind}_route_data*"))]
        if not routes:
            raise ValueError(f"{kind} has no route")
        holes = shapely.union_all([shapely.Polygon(ring) for ring in rings[1]])
        outline = shapely.difference(shapely.Polygon(rings[0][0]), holes)
    except (OSError, ValueError, IndexError) as error:
        raise InputError(f"{folder}: cannot read the area ({error})") from error
    if not isinstance(outline, shapely.Polygon):
        raise InputError(f"{folder}: the holes divide the area")
    return PublishedArea(name, outline, tuple(routes))


def _rings(path: Path) -> list[FloatArray]:
    blocks = path.read_text(encoding="utf-8").replace("\r", "").strip().split("\n\n")
    return [np.array([line.split() for line in block.splitlines()], dtype=float) for block in blocks if block.strip()]


def site_of(area: PublishedArea, folder: Path, capacity_s: float | None = None) -> tuple[Site, FloatArray]:
    """The site of an area, its files written to a folder, and the place of home in the dataset's coordinates.

    The capacity is the longest time of a flight without take-off and landing.
    """
    to_earth = earth_from_metres()
    free = area.outline.buffer(-_CLEAR_M)
    home_m = shapely.get_coordinates(shapely.shortest_line(free, shapely.Point(area.routes_m[0][0])))[0]

    def on_earth(ring: shapely.LinearRing) -> list[list[float]]:
        positions = np.column_stack(to_earth.transform(*shapely.get_coordinates(ring).T)).round(9)
        return [[float(lon), float(lat)] for lon, lat in positions]

    west, south, east, north = area.outline.bounds
    columns, rows = (math.ceil((side + 2.0 * _AROUND_M) / _PIXEL_M) for side in (east - west, north - south))
    fence = shapely.Polygon(area.outline.exterior).buffer(_LEEWAY_M, join_style="mitre").exterior
    lon_deg, lat_deg = (float(value) for value in to_earth.transform(*home_m))
    tables: dict[str, Any] = {
        "name": area.name,
        "select": f"coverage>={REQUIRED}",
        "area": {
            "polygons_lon_lat_deg": [[on_earth(ring) for ring in (area.outline.exterior, *area.outline.interiors)]],
            "cell_size_m": 0.3,
        },
        "home": {"lat_deg": lat_deg, "lon_deg": lon_deg},
        "sensor": {
            "kind": "nadir-camera", "fov_deg": 2.0 * math.degrees(math.atan(REACH_M / HEIGHT_M)), "range_m": 60.0,
            "mount": "stabilised",
        },
        "limits": {
            "max_climb_angle_deg": 80.0, "transit_clearance_m": 5.0, "fence_polygons_lon_lat_deg": [on_earth(fence)],
        },
        "vehicle": {
            "cruise_speed_m_s": SPEED_M_S, "acceleration_m_s2": ACCELERATION_M_S2, "jerk_m_s3": 1000.0,
            "return_height_m": HEIGHT_M, "reserve_fraction": 0.0, "autopilot": "px4",
            "power": {"uncertainty_fraction": 0.0},
        },
        "planner": {"waypoint_price": 0.0},
        "no_fly": [{"margin_m": 0.0, "polygon_lon_lat_deg": on_earth(ring)} for ring in area.outline.interiors],
    }  # fmt: skip
    corner_m = (west - _AROUND_M, south - _AROUND_M)
    site = flat_site(folder, tables, corner_m=corner_m, shape=(rows, columns), pixel_m=_PIXEL_M)
    vehicle, pace = site.scenario.vehicle, pace_of(site)
    values = {field.name: getattr(vehicle, field.name) for field in dataclasses.fields(vehicle) if field.init}
    if capacity_s is not None:
        values["endurance_s"] = capacity_s + takeoff_time(pace, HEIGHT_M) + landing_time(pace, HEIGHT_M)
    stopping = StoppingVehicle(**values)
    return dataclasses.replace(site, scenario=dataclasses.replace(site.scenario, vehicle=stopping)), home_m


def _run(name: str, *, data: Path, budget_s: float, capacity_s: float | None) -> dict[str, Any]:
    """Plan an area: the costs and the coverage of both routes."""
    area, begin = read_area(data, name, capacity_s), time.process_time()
    with tempfile.TemporaryDirectory() as scratch:
        site, home_m = site_of(area, Path(scratch), capacity_s)
        plan = planned(site, name, budget_s)
    flights = compile_sorties(site, plan.chosen.route, autopilot=site.scenario.vehicle.autopilot)
    routes_m = [_closed(site, flight.route.waypoints_m) + (home_m - home_en_m(site)) for flight in flights]
    costs, free = [cost_s(route_m) for route_m in routes_m], area.outline.buffer(2.0 * _LEEWAY_M)
    return {
        "holes": len(area.outline.interiors), "cost_s": sum(costs), "published_s": sum(map(cost_s, area.routes_m)),
        "seen": area.observed(routes_m), "published_seen": area.observed(area.routes_m), "made_by": plan.chosen.origin,
        "crosses_m": float(shapely.difference(shapely.MultiLineString(routes_m), free).length),
        "longest_s": max(costs), "cpu_s": time.process_time() - begin,
    }  # fmt: skip


def _closed(site: Site, route_m: FloatArray) -> FloatArray:
    """(k, 2) corners of a flight from home along a route and back, around the zones."""
    home = home_en_m(site)
    there_m, back_m = (transit(site, home, end_m, ground_end_height_m=HEIGHT_M) for end_m in route_m[[0, -1]])
    return np.asarray(np.vstack([there_m[:-1], route_m, back_m[-2::-1]])[:, :2])


def plan_areas(
    folder: KeptRuns, names: Sequence[str], *, data: Path, budget_s: float, capacity_s: float | None, processes: int
) -> Iterator[str]:
    """Plan areas in parallel; the name of each that is done."""
    plan = functools.partial(_run, data=data, budget_s=budget_s, capacity_s=capacity_s)
    return kept(folder, plan, names, processes=processes)


def table_lines(folder: KeptRuns) -> list[str]:
    """The areas that are done as CSV, and their means as a last line."""
    rows = [(name, folder.read(name)) for name in folder.done()]
    lines = ["area,holes,cost_s,published_s,ratio,seen,published_seen,crosses_m,longest_s,made_by,cpu_s"]
    for name, row in rows:
        ratio = row["cost_s"] / row["published_s"]
        lines.append(
            f"{name},{row['holes']},{row['cost_s']:.2f},{row['published_s']:.2f},{ratio:.4f},{row['seen']:.6f},"
            f"{row['published_seen']:.6f},{row['crosses_m']:.3f},{row['longest_s']:.1f},{row['made_by']},{row['cpu_s']:.1f}"
        )
    return lines


def summary(folder: KeptRuns) -> str:
    """One line: how the costs of all areas compare."""
    rows = [folder.read(name) for name in folder.done()]
    ratios = np.array([row["cost_s"] / row["published_s"] for row in rows])
    mean, published = (float(np.mean([row[key] for row in rows])) for key in ("cost_s", "published_s"))
    least = min(row["seen"] for row in rows)
    return (
        f"{len(rows)} areas: mean cost {mean:.1f} s, published {published:.1f} s ({mean / published:.4f}); "
        f"ratio {ratios.min():.4f} to {ratios.max():.4f}; at least {100.0 * least:.3f} % seen"
    )

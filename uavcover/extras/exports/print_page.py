"""A plan on paper: one HTML page that prints on A4, opens without a network and runs no script."""

import math
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import contourpy
import numpy as np
import shapely
from markupsafe import Markup

from mission_io.model.plain_text import plain_lines
from uavcover.extras.exports.export import ExportRequest, flights_for, refuse_unlike, time_with_stops_s, write_exported
from uavcover.kernels.arrays import FloatArray
from uavcover.missions.mission_compiler import Sortie
from uavcover.model.vehicle import AutopilotName
from uavcover.report.charts import PRINTED, Scale, nice_ticks
from uavcover.report.page import hash_source, page_environment
from uavcover.run.documents import read_planned
from uavcover.run.folder import RunFolder
from uavcover.run.provenance import sha256_of_content
from uavcover.scenario.site import Site
from uavcover.sensing.sensors import trigger_distance_m

# Drawings of a print-out: a map and a height profile in black and white, legible without colour; print.html has their SVG.

MAP_WIDTH, MAP_HEIGHT = 720.0, 520.0
_COLORS = ("#005a9c", "#b8460e", "#1b7a3d", "#7a2f8f", "#8a6d00", "#00747a")
_DASHES = ("", "9 3", "2 3", "9 3 2 3", "14 4", "5 2")
_CONTOUR_NODES = 160


def map_drawing(site: Site, flights: Sequence[Sortie]) -> dict[str, Any]:
    """Paths and positions of a map of the flights with area, fence, zones, obstacles and home, and its contours' interval."""
    view = _View(site, flights)
    contours, interval_m = _contours(site, view)
    bar_m = _ticks(0.0, 0.3 * MAP_WIDTH / view.per_m, 1)[-1]
    return {
        "width": MAP_WIDTH,
        "height": MAP_HEIGHT,
        "contours": contours,
        "interval_m": interval_m,
        "area": view.polygon(site.area),
        "fence": view.outline(site.fence),
        "zones": [(view.polygon(zone.outline), view.name(zone.outline, zone.name)) for zone in site.zones],
        "obstacles": [view.polygon(prism.footprint.polygon) for prism in site.prisms],
        "flights": [(view.line(sortie.compiled.path_m), _numbers(view, sortie)) for sortie in flights],
        "home": None if site.home_m is None else view.at(float(site.home_m[0]), float(site.home_m[1])),
        "bar_m": bar_m,
        "bar_end": 14.0 + bar_m * view.per_m,
        "corners": _corners(site, view),
    }


def profile_drawing(site: Site, sortie: Sortie) -> dict[str, Any]:
    """Ground, height band and path of a flight above sea level, over the distance from home to home, and the axes' labels."""
    compiled, limits = sortie.compiled, site.scenario.limits
    steps_m = np.hypot(*np.diff(compiled.path_m[:, :2], axis=0).T)
    along_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    at_m = np.union1d(along_m, np.linspace(0.0, along_m[-1], 600))
    positions = np.column_stack([np.interp(at_m, along_m, compiled.path_m[:, k]) for k in range(3)])
    # At a vertical leg two heights have one distance; the corners themselves are drawn from the path.
    ground_up_m = site.ground.heights_m(positions[:, :2])
    sea_m = site.alts_amsl_m(positions) - positions[:, 2]
    ground_m, path_m = ground_up_m + sea_m, site.alts_amsl_m(compiled.path_m)
    low = math.floor(float(np.nanmin(ground_m)) / 10.0) * 10.0 - 10.0
    high = max(float(path_m.max()), float(np.nanmax(ground_m)) + limits.max_height_agl_m)
    high += 0.06 * (high - low)
    scale = Scale(PRINTED, (0.0, max(float(along_m[-1]), 1.0)), (low, max(high, low + 1.0)))
    known = np.isfinite(ground_m)
    over = at_m[known]
    outline = np.concatenate([over[:1], over, over[-1:]]), np.concatenate([[low], ground_m[known], [low]])
    begin_m, end_m = along_m[_planned_rows(sortie)]
    on_survey = known & (at_m >= begin_m) & (at_m <= end_m)
    return {
        "frame": PRINTED,
        "ground": scale.path(*outline) + "Z" if known.any() else "",
        "band": [
            scale.path(at_m[on_survey], ground_m[on_survey] + agl_m)
            for agl_m in (limits.min_height_agl_m, limits.max_height_agl_m)
            if on_survey.any()
        ],
        "path": scale.path(along_m, path_m),
        "heights": [(scale.y(m), label) for m, label in nice_ticks(*scale.y_range, about=PRINTED.y_ticks)],
        "distances": [(scale.x(m), label) for m, label in nice_ticks(*scale.x_range, about=PRINTED.x_ticks)],
    }


def _planned_rows(sortie: Sortie) -> list[int]:
    """Rows of the first and the last planned waypoint in the path of a flight."""
    path_m, route_m = sortie.compiled.path_m, sortie.route.waypoints_m
    count = len(route_m)
    first = next(k for k in range(len(path_m) - count + 1) if np.array_equal(path_m[k : k + count], route_m))
    return [first, first + count - 1]


class _View:
    """Transform from east and north in metres to the map's units; north is up."""

    def __init__(self, site: Site, flights: Sequence[Sortie]) -> None:
        shapes: list[shapely.geometry.base.BaseGeometry] = [
            site.area,
            *(shapely.MultiPoint(sortie.compiled.path_m[:, :2]) for sortie in flights),
        ]
        if site.home_m is not None:
            shapes.append(shapely.Point(site.home_m[:2]))
        west, south, east, north = shapely.union_all([shapely.envelope(shape) for shape in shapes]).bounds
        margin = 0.06 * max(east - west, north - south, 1.0)
        width, height = east - west + 2.0 * margin, north - south + 2.0 * margin
        self.per_m = min(MAP_WIDTH / width, MAP_HEIGHT / height)
        center = 0.5 * (west + east), 0.5 * (south + north)
        half = 0.5 * MAP_WIDTH / self.per_m, 0.5 * MAP_HEIGHT / self.per_m
        self.west, self.east = center[0] - half[0], center[0] + half[0]
        self.south, self.north_m = center[1] - half[1], center[1] + half[1]
        self._frame = shapely.box(self.west, self.south, self.east, self.north_m)

    def at(self, east_m: float, north_m: float) -> tuple[float, float]:
        return (east_m - self.west) * self.per_m, (self.north_m - north_m) * self.per_m

    def polygon(self, shape: shapely.geometry.base.BaseGeometry) -> str:
        rings = [
            _path([self.at(*position) for position in shapely.get_coordinates(ring)[:-1].tolist()]) + "Z"
            for part in shapely.get_parts(shape.intersection(self._frame))
            if isinstance(part, shapely.Polygon)
            for ring in (part.exterior, *part.interiors)
        ]
        return " ".join(rings)

    def outline(self, shape: shapely.geometry.base.BaseGeometry) -> str:
        """The edge of an area inside the map. A polygon cut off at the map's edge would have an edge there too."""
        lines = shapely.get_parts(shape.boundary.intersection(self._frame))
        return " ".join(_path([self.at(*point) for point in shapely.get_coordinates(line).tolist()]) for line in lines)

    def line(self, points_m: FloatArray) -> str:
        return _path([self.at(float(east), float(north)) for east, north in points_m[:, :2]])

    def label(self, east_m: float, north_m: float, text: str) -> tuple[float, float, str] | None:
        """A text with its position; none outside the map."""
        x, y = self.at(east_m, north_m)
        return (x, y, text) if 0.0 <= x <= MAP_WIDTH and 0.0 <= y <= MAP_HEIGHT else None

    def name(self, shape: shapely.Polygon | shapely.MultiPolygon, text: str) -> tuple[float, float, str] | None:
        at = shape.representative_point()
        return self.label(at.x, at.y, text)


def _numbers(view: _View, sortie: Sortie) -> list[tuple[float, float, str] | None]:
    """Numbers of planned waypoints, thinned, as the plan counts them, from 0."""
    step = max(1, math.ceil(len(sortie.route) / 24))
    return [
        view.label(float(east), float(north), str(sortie.first + k))
        for k, (east, north) in enumerate(sortie.route.waypoints_m[:, :2])
        if k % step == 0
    ]


def _contours(site: Site, view: _View) -> tuple[str, float]:
    """Lines of equal height above sea level, and the interval between two of them; 0 where there are none."""
    easts = np.linspace(view.west, view.east, _CONTOUR_NODES)
    norths = np.linspace(view.south, view.north_m, _CONTOUR_NODES)
    grid = np.stack(np.meshgrid(easts, norths), axis=-1).reshape(-1, 2)
    up_m = site.ground.heights_m(grid).reshape(_CONTOUR_NODES, _CONTOUR_NODES) + site.alt_amsl_offset_m
    if not np.isfinite(up_m).any() or np.nanmax(up_m) - np.nanmin(up_m) < 1.0:
        return "", 0.0
    levels = _ticks(float(np.nanmin(up_m)), float(np.nanmax(up_m)), 12)
    lines = contourpy.contour_generator(easts, norths, np.ma.masked_invalid(up_m))
    shapes = [
        _path([view.at(float(east), float(north)) for east, north in np.asarray(line)])
        for level in levels
        for line in lines.lines(level)
    ]
    interval_m = levels[1] - levels[0] if len(levels) > 1 else 0.0
    return " ".join(shapes), interval_m


def _corners(site: Site, view: _View) -> list[str]:
    """Latitude and longitude of two corners of the map."""
    if site.frame is None:
        return []
    positions = np.array([[view.west, view.south, 0.0], [view.east, view.north_m, 0.0]])
    lat, lon, _ = site.frame.geodetic_from_enu(positions)
    return [position_text(float(lat[k]), float(lon[k])) for k in range(2)]


def position_text(lat_deg: float, lon_deg: float) -> str:
    """A place as pilots read it: degrees with hemispheres."""
    return f"{abs(lat_deg):.6f}° {'N' if lat_deg >= 0 else 'S'}, {abs(lon_deg):.6f}° {'E' if lon_deg >= 0 else 'W'}"


def _path(positions: Sequence[tuple[float, float]]) -> str:
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in positions)


def _ticks(low: float, high: float, count: int) -> list[float]:
    """Round numbers from low to high, about ``count``."""
    raw = (high - low) / max(count, 1)
    if not raw > 0.0:
        return [low]
    magnitude = 10.0 ** math.floor(math.log10(raw))
    step = next(factor * magnitude for factor in (1.0, 2.0, 5.0, 10.0) if factor * magnitude >= raw * 0.999)
    if count == 1:
        step = next(factor * magnitude for factor in (5.0, 2.0, 1.0) if factor * magnitude <= raw * 1.001)
        return [low, low + step]
    return [round(k * step, 9) for k in range(math.ceil(low / step), math.floor(high / step) + 1)]


_PAGE = Path(__file__).parent


def print_plan(run: RunFolder, request: ExportRequest, notes: Mapping[str, str]) -> int:
    """Write the print-out of a run, of all flights or of one sortie, split as the files that are flown.

    With an aircraft in the request these are the flights of its ``wpml`` files, with stops. Notes are what only the pilot knows:
    ``pilot``, ``contact`` for emergencies and ``weather``; an empty one becomes a line to fill in by hand.

    Returns:
        How many flights are on it.

    Raises:
        InputError: the run cannot be read, or has no place or home.
        InfeasibleError: a leg exceeds a limit.
        OutputError: the page already exists, or cannot be written.
    """
    folder = run if request.sortie is None else run.flight(request.sortie)
    site, planned = read_planned(folder)
    refuse_unlike(site, run, request.sortie)
    name = request.autopilot or site.scenario.vehicle.autopilot
    flights = flights_for(site, planned.route, request, vehicles=planned.vehicles)
    plan_sha256 = sha256_of_content(folder.file("plan.json").read_text(encoding="utf-8"))
    page = render_print(
        site, flights, notes=notes, autopilot=name, coverage=planned.coverage_of_coverable, plan_sha256=plan_sha256,
        aircraft=None if request.aircraft is None else request.aircraft.title,
    )  # fmt: skip
    write_exported(request.out, {request.out.name: page.encode()}, force=request.force)
    return len(flights)


def render_print(
    site: Site, flights: Sequence[Sortie], *, notes: Mapping[str, str], autopilot: AutopilotName, coverage: float,
    plan_sha256: str, aircraft: str | None = None,
) -> str:  # fmt: skip
    """The page; every text from files and options is escaped."""
    style = (_PAGE / "print.css").read_text(encoding="utf-8")
    return plain_lines(
        page_environment(_PAGE)
        .get_template("print.html")
        .render(
            scenario=site.scenario,
            site=site,
            home=_home(site),
            map=map_drawing(site, flights),
            flights=[
                _flight_row(site, number, sortie, autopilot, stops=aircraft is not None)
                for number, sortie in enumerate(flights)
            ],
            aircraft=aircraft,
            limits=_limits(site, flights),
            camera=_camera(site),
            notes=notes,
            return_height_m=_return_height_m(flights),
            zones_on_return=sorted({name for sortie in flights for name in sortie.compiled.return_advice.no_fly}),
            coverage=coverage,
            plan=plan_sha256[:12],
            version=metadata.version("uavcover"),
            style=Markup(style),
            policy=f"default-src 'none'; style-src {hash_source(style)}",
        )
    )


def _home(site: Site) -> dict[str, str]:
    if site.frame is None or site.home_m is None:
        return {"place": "", "alt": ""}
    lat, lon, alt = site.frame.geodetic_from_enu(site.home_m)
    return {"place": position_text(float(lat[0]), float(lon[0])), "alt": f"{float(alt[0]):.0f} m"}


def _flight_row(site: Site, number: int, sortie: Sortie, autopilot: AutopilotName, *, stops: bool) -> dict[str, Any]:
    compiled, longest_s = sortie.compiled, site.scenario.vehicle.longest_flight_s
    home_alt_m = 0.0 if site.home_m is None else float(site.alts_amsl_m(site.home_m)[0])
    return {
        "number": number + 1,
        "color": _COLORS[number % len(_COLORS)],
        "dash": _DASHES[number % len(_DASHES)],
        "waypoints": f"{sortie.first} to {sortie.last}",
        "points": len(compiled.path_m),
        "length_m": float(sum(math.dist(a, b) for a, b in zip(compiled.path_m[:-1], compiled.path_m[1:], strict=True))),
        "time": clock(time_with_stops_s(site, compiled, autopilot) if stops else compiled.flight_time_s),
        "battery": "" if stops or compiled.battery_used is None else f"{compiled.battery_used:.0%}",
        "latest": "" if longest_s is None else clock(longest_s),
        "highest_m": compiled.max_height_above_home_m,
        "highest_amsl_m": compiled.max_height_above_home_m + home_alt_m,
        "unsafe_return": len(compiled.return_advice.unsafe_waypoints),
        "profile": profile_drawing(site, sortie),
    }


def clock(seconds: float) -> str:
    """Minutes and seconds."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d}"


def _return_height_m(flights: Sequence[Sortie]) -> float | None:
    """Height above home from which the straight way home is clear from everywhere; None where ground is unknown."""
    safe_m = [sortie.compiled.return_advice.safe_return_height_m for sortie in flights]
    return math.ceil(max(safe_m)) if all(map(math.isfinite, safe_m)) else None


def _limits(site: Site, flights: Sequence[Sortie]) -> list[tuple[str, str]]:
    limits, vehicle, wind = site.scenario.limits, site.scenario.vehicle, site.scenario.wind
    home = site.home_m
    reach_m = 0.0
    if home is not None:
        reach_m = max(math.dist(position[:2], home[:2]) for sortie in flights for position in sortie.compiled.path_m)
    sea = [
        (word, alt_m)
        for word, alt_m in (("from", limits.min_alt_amsl_m), ("to", limits.max_alt_amsl_m))
        if alt_m is not None
    ]
    rows = [
        ("Height above ground", f"{limits.min_height_agl_m:g} to {limits.max_height_agl_m:g} m, on the route"),
        ("Clearance on outbound and return transit", f"{limits.transit_clearance_m:g} m"),
        ("Height above sea level", " ".join(f"{word} {alt_m:g} m" for word, alt_m in sea)),
        ("Maximum distance from home", f"{reach_m:.0f} m"),
        ("Ground speed", f"{vehicle.cruise_speed_m_s:g} m/s"),
        ("Climb, descent", f"{vehicle.max_climb_m_s:g} m/s, {vehicle.max_descent_m_s:g} m/s"),
        ("Planned wind", f"{wind.speed_m_s:g} m/s from {wind.from_deg:g}°" if wind.speed_m_s else "none"),
        ("Batteries last in wind up to", f"{wind.most_m_s:g} m/s from any direction" if wind.most_m_s else ""),
        ("Maximum airspeed", "" if vehicle.max_airspeed_m_s is None else f"{vehicle.max_airspeed_m_s:g} m/s"),
        ("Battery", "" if vehicle.endurance_s is None else (
            f"{clock(vehicle.endurance_s)} min of hovering on a full battery, {vehicle.reserve_fraction:.0%} held in reserve"
        )),
        ("Active no-fly zones", ", ".join(f"{zone.name} ({zone.heights_text()})" for zone in site.zones)),
    ]  # fmt: skip
    return [(name, text) for name, text in rows if text]


def _camera(site: Site) -> str:
    """The camera in one line; empty for other sensors."""
    sensor = site.scenario.sensor
    if not sensor.is_camera:
        return ""
    distance_m = trigger_distance_m(site.scenario)
    photos = "the mission does not trigger photos" if distance_m is None else f"a photo every {distance_m:.1f} m"
    if not sensor.looks_along_path:
        photos = "a photo at each waypoint"
    return f"{sensor.mount}, {sensor.pitch_deg:g}° (-90° is straight down), {photos}"

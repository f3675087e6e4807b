"""Content of the map for a scenario or a run folder: shapes in longitude and latitude, layers of cells as images.

A scenario without a position on Earth is drawn around latitude 0, longitude 0; the page says so.
"""

import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from uavcover.errors import InputError, UavcoverError
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.missions.failsafes import IN_PLACE
from uavcover.missions.leg_checks import LegProblem, find_problems, find_waypoint_problems
from uavcover.missions.mission_compiler import CompiledMission, compile_mission
from uavcover.missions.return_advice import flight_states
from uavcover.model.area import RasterTerrain
from uavcover.model.route import Route
from uavcover.planner.pareto_file import ParetoRow
from uavcover.report.content import ReportContent, read_run
from uavcover.report.map_data import (
    OBSERVED_RGB,
    UNOBSERVED_RGB,
    cell_layers,
    cells_bounds_m,
    classes_image,
    gap_data,
    zone_data,
)
from uavcover.run.documents import read_planned
from uavcover.run.folder import RunFolder
from uavcover.scenario.obstacles import rings_m
from uavcover.scenario.scenario_file import terrain_source
from uavcover.scenario.site import Site, area_as_drawn, load_site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.site_maps import judging_map
from uavcover.terrain.terrain_source import TerrainSource
from uavcover.verification.verify import Verdict

_DEGREE_M = 111_319.49
"""Length of a degree on the equator, WGS 84: for scenarios without a position on Earth."""
_DRAWN_SAMPLES = 4000
_PROFILE_EVERY_M = 5.0
_PLAN_KEYS = ("metrics", "select", "rule_met", "mission", "interrupted", "made_by", "sorties", "fleet", "bounds")


@dataclass(slots=True, eq=False)
class Scene:
    """A scenario, or a run folder, that was read."""

    site: Site  # the scenario on its ground
    path: Path  # the scenario file, or the run folder
    content: ReportContent | None = None  # of a run folder with a plan; None for a scenario
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _coverage: CoverageMap | None = None

    @property
    def coverage(self) -> CoverageMap:
        """The cells of the area, made when they are first needed."""
        with self._lock:
            if self._coverage is None:
                self._coverage = judging_map(self.site) if self.content is None else self.content.coverage
            return self._coverage

    @property
    def terrain(self) -> TerrainSource | None:
        """Its elevation file; None where the ground is made from a formula."""
        terrain = self.site.scenario.terrain
        return terrain_source(terrain) if isinstance(terrain, RasterTerrain) and self.site.frame is not None else None

    def lon_lat(self, enu_m: FloatArray) -> FloatArray:
        """(n, 2) longitude and latitude of (n, 2 or 3) local positions."""
        positions = np.asarray(enu_m, dtype=float)
        if positions.shape[1] == 2:
            positions = np.column_stack([positions, self.site.ground.heights_m(positions)])
        if self.site.frame is None:
            return np.asarray(positions[:, :2] / _DEGREE_M)
        positions = np.where(np.isfinite(positions), positions, 0.0)
        lat, lon, _ = self.site.frame.geodetic_from_enu(positions)
        return np.column_stack([lon, lat])

    def east_north(self, lon_lat: FloatArray) -> FloatArray:
        """(n, 2) local east and north of (n, 2) longitude and latitude."""
        if self.site.frame is None:
            return np.asarray(lon_lat * _DEGREE_M)
        flat = self.site.frame.enu_from_geodetic(
            lon_lat[:, 1], lon_lat[:, 0], np.full(len(lon_lat), self.site.alt_amsl_offset_m)
        )
        return np.asarray(flat[:, :2])

    def enu(self, waypoints: Sequence[Sequence[float]]) -> FloatArray:
        """(n, 3) waypoints of the page: longitude, latitude, height above ground.

        Raises:
            InputError: they are no positions near the area.
        """
        try:
            given = np.array(waypoints, dtype=float).reshape(-1, 3)
        except (TypeError, ValueError):
            given = np.empty((0, 3))
        if not len(given) or not np.isfinite(given).all():
            raise InputError("waypoints: specify at least one, each as [longitude, latitude, height above ground in m]")
        east_north = self.east_north(given[:, :2])
        enu = np.column_stack([east_north, self.site.ground.ups_m(east_north, given[:, 2])])
        if self.site.frame is not None:  # the verticals of a frame lean apart: where a place is depends on its height
            for _ in range(2):
                alts = self.site.alts_amsl_m(enu)
                enu[:, :2] = self.site.frame.enu_from_geodetic(given[:, 1], given[:, 0], alts)[:, :2]
                enu[:, 2] = self.site.ground.ups_m(enu[:, :2], given[:, 2])
        return enu

    def waypoints(self, route_m: FloatArray) -> list[list[float]]:
        """Waypoints for the page: longitude, latitude, height above ground."""
        lon_lat, agl = self.lon_lat(route_m), self.site.ground.heights_agl_m(route_m)
        return [
            [round(lon, 8), round(lat, 8), _number(h)]
            for (lon, lat), h in zip(lon_lat.tolist(), agl.tolist(), strict=True)
        ]

    def corners(self) -> list[list[float]]:
        """North-west, north-east, south-east and south-west corner of images of the cells."""
        west, south, east, north = cells_bounds_m(self.coverage)
        ends = np.array([[west, north], [east, north], [east, south], [west, south]])
        return [[lon, lat] for lon, lat in self.lon_lat(np.column_stack([ends, np.zeros(4)])).tolist()]


class Scenes:
    """Scenes by path; the last few stay in memory until their files change."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._kept: OrderedDict[tuple[str, tuple[tuple[str, int], ...]], Scene] = OrderedDict()

    def of(self, path: Path) -> Scene:
        """The scene of a scenario file or a run folder. Raises UavcoverError: it cannot be read."""
        files = sorted(path.rglob("*.*")) if path.is_dir() else [path]
        state = tuple(
            (file.name, file.stat().st_mtime_ns) for file in files if file.suffix in {".json", ".toml", ".csv"}
        )
        key = (str(path), state)
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
        scene = _read(path)
        with self._lock:
            self._kept[key] = scene
            while len(self._kept) > 6:
                self._kept.popitem(last=False)
        return scene


def _read(path: Path) -> Scene:
    run = RunFolder(path)
    if not path.is_dir():
        return Scene(load_site(str(path)), path)
    if not run.file("plan.json").is_file():
        raise InputError(f"{path.name}: the folder has no plan.json; create it with: uavcover plan")
    try:
        content = read_run(run, logs=())
    except UavcoverError:
        if not run.file("track.csv").is_file():
            raise
        # a flight that has just begun, or whose track cannot be judged, still has its plan.
        content = read_run(run, logs=(), judged=False)
    return Scene(content.site, path, content)


def scene_document(scene: Scene) -> dict[str, Any]:
    """Everything that the map draws, for JSON."""
    site, content = scene.site, scene.content
    shapes: Callable[[Iterable[FloatArray]], list[Any]] = lambda rings: [scene.lon_lat(ring).tolist() for ring in rings]  # noqa: E731
    limits = site.scenario.limits
    document: dict[str, Any] = {
        "name": site.scenario.name,
        "description": site.scenario.description,
        "onEarth": site.frame is not None,
        "area": shapes(rings_m(site.area)),
        "drawn": shapes(rings_m(area_as_drawn(site))),
        "areaM2": float(area_as_drawn(site).area),
        "fence": shapes(rings_m(site.fence)),
        "zones": [
            {"name": zone.name, "heights": zone_data(zone)["heights"], "rings": shapes(rings_m(zone.outline))}
            for zone in site.zones
        ],
        "obstacles": [
            {"name": p.footprint.name, "heightM": p.footprint.height_m, "rings": shapes(rings_m(p.footprint.polygon))}
            for p in site.prisms
        ],
        "rally": [] if isinstance(site.scenario.planner.rally, str) else [*map(list, site.scenario.planner.rally)],
        "home": None if site.home_m is None else scene.lon_lat(site.home_m[None, :])[0].tolist(),
        "band": [limits.min_height_agl_m, limits.max_height_agl_m],
        "camera": site.scenario.sensor.kind,
        "vehicle": {"autopilot": site.scenario.vehicle.autopilot, "speed": site.scenario.vehicle.cruise_speed_m_s},
        "bounds": _bounds(scene),
    }
    if content is not None:
        document |= _run_document(scene, content)
    return document


def _run_document(scene: Scene, content: ReportContent) -> dict[str, Any]:
    site, verdict = scene.site, content.verdict
    compiled = _missions(scene, content)
    sorties = content.sorties_m or (content.planned.route.waypoints_m,)
    layers = [asdict(layer) for layer in cell_layers(content)]
    own_rally = {"rally": [[p.lon_deg, p.lat_deg] for p in compiled[0].rally.points[1:]]} if compiled else {}
    return {
        "route": scene.waypoints(content.planned.route.waypoints_m),
        "sorties": [scene.lon_lat(route_m).tolist() for route_m in sorties],
        "profile": [_profile(site, route_m) for route_m in sorties],
        "paths": [scene.lon_lat(one.path_m).tolist() for one in compiled],
        "unsafeReturns": [unsafe for one in compiled for unsafe in _unsafe_returns(scene, one)],
        **own_rally,
        "colors": [
            int(sortie.get("vehicle") or number) - 1
            for number, sortie in enumerate(content.plan.get("sorties") or (), 1)
        ],
        "layers": layers,
        "corners": scene.corners(),
        "photos": _photos(scene, content),
        "members": [_member(row) for row in content.members],
        "plan": {name: content.plan.get(name) for name in _PLAN_KEYS},
        "uploads": _uploads(scene),
        "tracks": [
            _track(scene, flight.enu_m, flight.height_agl_m, flight.clock_s, flight.name) for flight in content.flights
        ],
        "verdict": None if verdict is None else verdict_document(scene, verdict),
        "warnings": list(content.warnings),
    }


def verdict_document(scene: Scene, verdict: Verdict) -> dict[str, Any]:
    """The verdict of a run's flights with its findings on the map."""
    report = verdict.report
    gaps = gap_data(report.gaps)
    for gap, position in zip(gaps, _positions(scene, [(g["east"], g["north"]) for g in gaps]), strict=True):
        gap["place"] = position
    found = [(v.east_m, v.north_m) for v in report.violations]
    return {
        "verdict": report.verdict,
        "reasons": [*report.reasons],
        "doubts": list(report.doubts),
        "coverageOfCoverable": report.coverage_of_coverable,
        "gaps": gaps,
        "violations": [
            {"kind": v.kind, "worst": f"{v.worst:.1f} {v.unit}", "limit": f"{v.limit:g} {v.unit}", "place": position}
            for v, position in zip(report.violations, _positions(scene, found), strict=True)
        ],
    }


def route_check(scene: Scene, waypoints: Sequence[Sequence[float]]) -> dict[str, Any]:
    """The legs of an edited route that exceed a limit, by the same checks as for a plan, and its height profile.

    Raises:
        InputError: the waypoints cannot be read.
    """
    site = scene.site
    route_m = scene.enu(waypoints)
    limits = site.scenario.limits
    check = find_problems if limits.applies_to == "legs" else find_waypoint_problems
    problems = check(site, route_m, lowest_agl_m=limits.min_height_agl_m, highest_agl_m=limits.max_height_agl_m)
    return {
        "legs": sorted({problem.leg for problem in problems}),
        "problems": [_problem(problem) for problem in problems],
        "lengthM": Route(route_m).length_m,
        "profile": _profile(site, route_m),
    }


def route_coverage(scene: Scene, waypoints: Sequence[Sequence[float]]) -> dict[str, Any]:
    """Coverage of an edited route, as a share and as an image."""
    observed = scene.coverage.observed(scene.enu(waypoints))
    return {
        "coverage": scene.coverage.fraction_of_coverable(observed),
        "image": observed_image(scene.coverage, observed),
        "corners": scene.corners(),
    }


def observed_image(coverage: CoverageMap, observed: BoolArray) -> str:
    """Cells that are seen and cells that are not, as a data URI."""
    return classes_image(coverage, [(UNOBSERVED_RGB, ~observed), (OBSERVED_RGB, observed)])


def _uploads(scene: Scene) -> list[dict[str, Any]]:
    """Read-back and returns of each flight that was uploaded."""
    run = RunFolder(scene.path)
    found = []
    for flight in run.sorties() or [run]:
        if not flight.file("upload.json").is_file():
            continue
        upload = flight.read_json("upload.json", made_by="uavcover plan-upload")
        advice = upload.get("return_advice") or {}
        lists = [
            {
                "type": part["mission_type"], "passed": part["passed"], "sent": len(part["sent"]),
                "received": len(part["received"]),
                "wrong": [d for d in part["differences"] if not d["acceptable"]][:20],
                "normalised": sum(bool(d["acceptable"]) for d in part["differences"]),
            }
            for part in upload.get("lists", ())
        ]  # fmt: skip
        found.append(
            {
                "flight": flight.path.name if flight.path != run.path else "", "url": upload.get("url"),
                "passed": upload.get("passed"), "lists": lists,
                "returnHeight": advice.get("return_height_m"), "safeReturnHeight": advice.get("safe_return_height_m"),
                "unsafe": len(advice.get("unsafe") or ()), "highest": upload.get("autopilot_max_height_above_home_m"),
            }
        )  # fmt: skip
    return found


def _problem(problem: LegProblem) -> dict[str, Any]:
    return {"leg": problem.leg, "kind": problem.kind, "text": str(problem)}


def _missions(scene: Scene, content: ReportContent) -> list[CompiledMission]:
    """The mission of the plan, or of each of its sorties."""
    folders = RunFolder(scene.path).sorties()
    planned = [read_planned(folder) for folder in folders] or [(content.site, content.planned)]
    return [one for site, plan in planned if (one := _compiled(site, plan.route)) is not None]


def _compiled(site: Site, route: Route) -> CompiledMission | None:
    if site.frame is None or site.home_m is None or route.begins:
        return None
    try:
        return compile_mission(site, route)
    except UavcoverError:
        return None  # a leg that exceeds a limit: the plan's own output says which


def _unsafe_returns(scene: Scene, compiled: CompiledMission) -> list[dict[str, Any]]:
    advice = compiled.return_advice
    states = flight_states(scene.site, compiled.path_m, begin_s=compiled.own_returns.begin_s)
    away = [one for one in advice.unsafe if one.destination != IN_PLACE]
    found = []
    for one, words in zip(away, advice.sentences, strict=True):
        inside = (states.times_s >= one.begin_s) & (states.times_s <= one.end_s)
        found.append({"line": scene.lon_lat(states.positions_m[inside]).tolist(), "text": words})
    return found


def _profile(site: Site, route_m: FloatArray) -> dict[str, list[float]]:
    """Heights above the lowest ground along a route: of the ground and of the vehicle, about every 5 m."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(route_m[:, :2], axis=0).T))])
    count = int(np.clip(along[-1] / _PROFILE_EVERY_M, 2, 1200))
    at = np.union1d(np.linspace(0.0, along[-1], count), along)
    positions = np.column_stack([np.interp(at, along, route_m[:, axis]) for axis in range(3)])
    ground = site.ground.heights_m(positions[:, :2])
    low = float(np.nanmin(ground)) if np.isfinite(ground).any() else 0.0
    return {"along": at.round(1).tolist(), "ground": _numbers(ground - low), "flight": _numbers(positions[:, 2] - low)}


def _photos(scene: Scene, content: ReportContent) -> dict[str, Any]:
    planned = content.planned_view
    if planned.photos is None:
        return {"planned": []}
    return {"planned": scene.lon_lat(planned.poses.eyes).tolist()}


def _member(row: ParetoRow) -> dict[str, Any]:
    return {
        "index": row.index, "coverage": row.coverage_of_coverable, "waypoints": row.waypoint_count,
        "lengthM": row.path_length_m, "timeS": row.flight_time_s if row.mission_time_s is None else row.mission_time_s,
        "sorties": None if row.mission is None else row.mission.sorties, "madeBy": row.made_by, "chosen": row.chosen,
    }  # fmt: skip


def _track(scene: Scene, enu_m: FloatArray, agl_m: FloatArray, clock_s: FloatArray, name: str) -> dict[str, Any]:
    every = max(1, -(-len(enu_m) // _DRAWN_SAMPLES))
    return {
        "name": name,
        "line": scene.lon_lat(enu_m[::every]).tolist(),
        "heightsAgl": _numbers(agl_m[::every]),
        "seconds": _numbers(clock_s[::every]),
    }


def _positions(scene: Scene, east_north: Sequence[tuple[float, float]]) -> list[Any]:
    return scene.lon_lat(np.array(east_north, dtype=float).reshape(-1, 2)).tolist() if east_north else []


def _bounds(scene: Scene) -> list[float]:
    west, south, east, north = shapely.union_all([scene.site.area, scene.site.fence]).bounds
    corners = scene.lon_lat(np.array([[west, south], [west, north], [east, south], [east, north]]))
    return [*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist()]


def _number(value: float) -> float:
    return round(value, 2) if np.isfinite(value) else 0.0


def _numbers(values: FloatArray) -> list[Any]:
    return [round(value, 1) if np.isfinite(value) else None for value in values.tolist()]

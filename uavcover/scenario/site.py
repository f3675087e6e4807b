"""The site: a scenario on its ground, everything in the local frame, ready for planning, flying and judging."""

import dataclasses
import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
import shapely

from uavcover.errors import NoElevationError, ScenarioError, TerrainError
from uavcover.kernels.arrays import FloatArray
from uavcover.model.area import Outline, RasterTerrain, Ring, SineCosineTerrain
from uavcover.model.scenario import Objective, Scenario, Uncertainty
from uavcover.scenario.airspace.zones import Zone, ZoneCheck, check_is_outside, local_zones
from uavcover.scenario.obstacles import Footprint, Prism, check_is_clear, stand_on
from uavcover.scenario.scenario_file import load_scenario, terrain_source
from uavcover.scenario.surface_model import check_home_is_open, with_surface_over
from uavcover.terrain.elevation_file import read_ground, read_height_amsl_m
from uavcover.terrain.frames import LocalFrame
from uavcover.terrain.ground import Ground, sine_cosine_ground
from uavcover.terrain.terrain_source import FILES, TerrainSource

MAX_REACH_M = 100_000.0
"""A position in a scenario farther from the origin is treated as a mistake."""

TERRAIN_MARGIN_M = 100.0
"""The terrain is read this far beyond everything flown over or observed."""


@dataclass(frozen=True, eq=False)
class Site:
    """A scenario in its local frame.

    Attributes:
        scenario: the scenario.
        frame: the local frame; None for a scenario that is not georeferenced.
        ground: the height surface that flights keep their heights above and that hides what lies under it: with a surface model,
            the higher of the two.
        area: the area to cover, holes cut out and grown by its margin, (east, north) metres.
        fence: the geofence, (east, north) metres.
        home_m: (3,) take-off position on the ground, ENU metres; None without a home.
        prisms: the obstacles on the ground, by their kernel numbers.
        zones: the no-fly zones that come near and are in force in the flight window, or may be without one.
        other_zones: those that come near and are not in force then.
        ground_model: the ground under the surface model; None without one.
        whole: the site of which this one's area is a part, where their routes are flown as one; none otherwise.
        block_cells: cells of a block, where the cells that results are judged on are evaluated in blocks; None: in one piece.
        targets_m: (n, 2) east and north of single places that are to be seen, in place of the area's cells; None: the cells.
    """

    scenario: Scenario
    frame: LocalFrame | None
    ground: Ground
    area: shapely.Polygon | shapely.MultiPolygon
    fence: shapely.Polygon
    home_m: FloatArray | None
    prisms: tuple[Prism, ...] = ()
    zones: tuple[Zone, ...] = ()
    other_zones: tuple[Zone, ...] = ()
    ground_model: Ground | None = None
    whole: "Site | None" = None
    block_cells: int | None = None
    targets_m: FloatArray | None = None

    def __repr__(self) -> str:
        where = "no position on Earth" if self.frame is None else f"{self.frame.lat_deg:.5f}, {self.frame.lon_deg:.5f}"
        return f"<Site {self.scenario.name}: {self.area.area / 1e6:.2f} square kilometres at {where}>"

    def minimising(self, objective: Objective | None = None, *, waypoint_price: float | None = None) -> "Site":
        """This site with another cost that its planner makes small; benchmarks of path length ask for "length".

        Raises:
            ScenarioError: the cost is no cost.
        """
        changes = {"objective": objective, "waypoint_price": waypoint_price}
        given = {key: value for key, value in changes.items() if value is not None}
        try:
            planner = dataclasses.replace(self.scenario.planner, **given)  # type: ignore[arg-type]
        except ValueError as error:
            raise ScenarioError(str(error)) from error
        return dataclasses.replace(self, scenario=dataclasses.replace(self.scenario, planner=planner))

    def flown_by(self, vehicles: int) -> "Site":
        """This site with this number of vehicles. Raises ScenarioError: the number is not possible."""
        try:
            fleet = dataclasses.replace(self.scenario.fleet, vehicles=vehicles)
            scenario = dataclasses.replace(self.scenario, fleet=fleet)
        except ValueError as error:
            raise ScenarioError(str(error)) from error
        return dataclasses.replace(self, scenario=scenario)

    @property
    def bare_ground(self) -> Ground:
        """The ground without trees and roofs of a surface model: vehicles stand on it, and sensors observe it."""
        return self.ground if self.ground_model is None else self.ground_model

    @property
    def alt_amsl_offset_m(self) -> float:
        """Offset from up at the origin to height above sea level; 0 when not georeferenced."""
        return 0.0 if self.frame is None else self.frame.alt_amsl_m

    @property
    def ground_error_m(self) -> float:
        """Largest error of heights above a resampled ground; 0 where the ground equals the file within ``max_error_m``."""
        return self.ground.error_m if self.ground.error_m > FILES.max_error_m else 0.0

    @property
    def vertical_uncertainty_m(self) -> float:
        """Largest error of a height above ground in a verdict: the stated one plus the ground's own.

        Without a stated uncertainty, measurements are taken as exact, and so is a ground within ``max_error_m`` of its file.
        """
        stated = self.scenario.uncertainty
        if stated == Uncertainty():
            return self.ground_error_m
        return stated.vertical_m + self.ground.error_m

    @property
    def planned_zones(self) -> ZoneCheck:
        """Tests planned legs against the no-fly zones with all margins."""
        margin_m = self.scenario.limits.height_margin_m
        return ZoneCheck(self.zones, self.ground, self.frame, height_margin_m=margin_m, margins=True)

    @property
    def flown_zones(self) -> ZoneCheck:
        """Tests flown legs against the no-fly zones themselves."""
        return ZoneCheck(self.zones, self.ground, self.frame)

    def alts_amsl_m(self, enu_m: FloatArray) -> FloatArray:
        """Heights above sea level (n,) of (n, 3) ENU positions; when not georeferenced, up itself."""
        points = np.atleast_2d(enu_m)
        return points[:, 2] if self.frame is None else self.frame.geodetic_from_enu(points)[2]

    def ground_alt_amsl_m(self, lat_deg: float, lon_deg: float) -> float | None:
        """Height of the bare ground above sea level; None where unknown, and for a site that is not georeferenced."""
        if self.frame is None:
            return None
        position = self.frame.enu_from_geodetic(lat_deg, lon_deg, 0.0)
        position[:, 2] = self.bare_ground.heights_m(position[:, :2])
        alt_amsl_m = float(self.alts_amsl_m(position)[0])
        return alt_amsl_m if math.isfinite(alt_amsl_m) else None


Computed = TypeVar("Computed")
Shape = TypeVar("Shape", bound=shapely.Geometry)


def once(compute: Callable[[Site], Computed]) -> Callable[[Site], Computed]:
    """Make a function of a later stage a cached property of its site. A copy of the site starts without its value."""
    name = _name_of(compute)

    @functools.wraps(compute)
    def found(site: Site) -> Computed:
        values: dict[str, Computed] = site.__dict__
        if name not in values:
            values[name] = compute(site)
        return values[name]

    return found


def prepared(geometry: Shape) -> Shape:
    """A copy with an index for many tests, for one thread at a time: GEOS writes to it while it tests lines.

    Geometries of a site are shared by threads, so they are never prepared themselves.
    """
    copied = cast("Shape", shapely.from_wkb(shapely.to_wkb(geometry)))
    shapely.prepare(copied)
    return copied


def keep_computed(site: Site, compute: Callable[[Site], Computed], value: Computed) -> None:
    """Give a site the value of a function with :func:`once`, where it is known from another site."""
    site.__dict__[_name_of(compute)] = value


def _name_of(compute: Callable[[Site], object]) -> str:
    return f"{compute.__module__}.{compute.__qualname__}"


def forget_computed(site: Site) -> None:
    """Drop the values of :func:`once`. Maps know their site: a site that is not used any more would stay for a while."""
    for name in site.__dict__.keys() - {field.name for field in dataclasses.fields(site)}:
        del site.__dict__[name]


def build_site(scenario: Scenario, *, terrain_file: Path | TerrainSource | None = None) -> Site:
    """Transform a scenario into its local frame and read its terrain.

    Raises:
        TerrainError: the elevation data cannot be used, or does not reach.
        ScenarioError: positions are inconsistent.
    """
    frame = _frame(scenario, terrain_file)
    area = _area(scenario, frame)
    home_en = _home_en(scenario, frame)
    fence = _fence(scenario, frame, area, home_en)
    if frame is not None:
        _check_near(scenario, area, fence, home_en)
    if home_en is not None and not fence.covers(shapely.Point(home_en)):
        raise ScenarioError("home: the take-off position is outside limits.fence; move the position or the fence")
    rally = rally_en(scenario, frame)
    for number, position in enumerate(rally):
        if not fence.covers(shapely.Point(position)):
            raise ScenarioError(f"planner.rally.{number}: the position is outside limits.fence; move the rally point")
    footprints = _footprints(scenario, frame, shapely.union_all([area, fence]))
    bounds = shapely.union_all([area, fence, *(footprint.polygon for footprint in footprints)]).bounds
    bare_ground = _ground(scenario, frame, bounds, terrain_file)
    with_surface = None if frame is None else with_surface_over(scenario, frame, _with_margin(bounds), bare_ground)
    ground = bare_ground if with_surface is None else with_surface
    prisms: tuple[Prism, ...] = ()
    if footprints:
        clearance_m = max(scenario.obstacles.clearance_beside_m, scenario.uncertainty.position_m)
        ground, prisms = stand_on(ground, footprints, largest_clearance_m=clearance_m, foot=bare_ground)
    positions = fence if home_en is None else shapely.union_all([fence, shapely.Point(home_en)])
    near_zones = local_zones(scenario.no_fly, frame, positions)
    zones = tuple(zone for zone in near_zones if zone.entry.in_force(scenario.flight_window))
    if home_en is not None:
        check_is_clear("home", scenario, home_en, footprints)
    alt_amsl_offset_m = 0.0 if frame is None else frame.alt_amsl_m
    home = None
    if home_en is not None:
        home_up = float(bare_ground.heights_m(home_en)[0])
        if not np.isfinite(home_up):
            raise TerrainError(f"home: there is no elevation data at the take-off position ({bare_ground.source})")
        if with_surface is not None and isinstance(scenario.terrain, RasterTerrain):
            check_home_is_open(scenario.terrain, with_surface, home_en, home_up)
        home = np.array([home_en[0], home_en[1], home_up])
        home.flags.writeable = False
        check_is_outside("home", zones, home, alt_amsl_offset_m)
    for number, (position, up) in enumerate(zip(rally, bare_ground.heights_m(rally), strict=True)):
        if not np.isfinite(up):
            raise TerrainError(
                f"planner.rally.{number}: there is no elevation data at this position ({bare_ground.source})"
            )
        check_is_clear(f"planner.rally.{number}", scenario, position, footprints)
        check_is_outside(f"planner.rally.{number}", zones, np.array([*position, up]), alt_amsl_offset_m)
    return Site(
        scenario=scenario, frame=frame, ground=ground, area=area, fence=fence, home_m=home, prisms=prisms, zones=zones,
        other_zones=tuple(zone for zone in near_zones if zone not in zones),
        ground_model=None if with_surface is None else bare_ground,
    )  # fmt: skip


def _frame(scenario: Scenario, terrain_file: Path | TerrainSource | None) -> LocalFrame | None:
    if scenario.origin is not None:
        return LocalFrame(scenario.origin.lat_deg, scenario.origin.lon_deg, scenario.origin.alt_amsl_m)
    home = scenario.home
    if not scenario.area.is_geographic or home is None or home.lat_deg is None or home.lon_deg is None:
        return None
    if not isinstance(scenario.terrain, RasterTerrain) or terrain_file is None:
        raise ScenarioError("terrain: an area in degrees requires raster terrain")
    alt = _read_home_height(terrain_file, scenario.terrain.vertical_datum, home.lat_deg, home.lon_deg)
    return LocalFrame(home.lat_deg, home.lon_deg, alt)


def _read_home_height(terrain_file: Path | TerrainSource, vertical_datum: str, lat_deg: float, lon_deg: float) -> float:
    try:
        return read_height_amsl_m(terrain_file, vertical_datum, lat_deg=lat_deg, lon_deg=lon_deg)
    except NoElevationError as error:
        raise TerrainError(f"home: {error}; are latitude and longitude swapped?") from error


def _area(scenario: Scenario, frame: LocalFrame | None) -> shapely.Polygon | shapely.MultiPolygon:
    left = polygons_in_metres(scenario.area, frame)
    if left.is_empty or not isinstance(left, shapely.Polygon | shapely.MultiPolygon):
        raise ScenarioError("area: the holes cover the whole area; remove some of them")
    return _grown(left, scenario.area.margin_m) if scenario.area.margin_m > 0.0 else left


def polygons_in_metres(outline: Outline, frame: LocalFrame | None) -> Any:
    """The polygons of an outline without their holes, (east, north) metres.

    Raises:
        ScenarioError: they are in degrees, and the frame has no position on Earth.
    """
    in_metres = functools.partial(_polygon, frame=frame) if outline.is_geographic else shapely.Polygon
    polygons = [[in_metres(ring) for ring in rings] for rings in outline.parts]
    return shapely.union_all([outer.difference(shapely.union_all(holes)) for outer, *holes in polygons])


def area_as_drawn(site: Site) -> shapely.Polygon | shapely.MultiPolygon:
    """The area of a site, (east, north) metres, before it was grown by its margin."""
    area = site.scenario.area
    if area.margin_m == 0.0:
        return site.area
    return _area(dataclasses.replace(site.scenario, area=dataclasses.replace(area, margin_m=0.0)), site.frame)


def _grown(area: shapely.Polygon | shapely.MultiPolygon, margin_m: float) -> shapely.Polygon | shapely.MultiPolygon:
    """The area with a margin outside; holes stay as they were drawn, whose ground need not even be known."""
    solid = shapely.union_all([shapely.Polygon(part.exterior) for part in shapely.get_parts(area)])
    grown = solid.buffer(margin_m, join_style="mitre", mitre_limit=2.0).difference(solid.difference(area))
    polygons = [part for part in shapely.get_parts(grown) if isinstance(part, shapely.Polygon)]
    return polygons[0] if len(polygons) == 1 else shapely.MultiPolygon(polygons)


def _check_near(
    scenario: Scenario,
    area: shapely.Polygon | shapely.MultiPolygon,
    fence: shapely.Polygon,
    home_en: FloatArray | None,
) -> None:
    """Refuse implausible positions: degrees in the wrong order, or map coordinates instead of local ones."""
    several = "polygons" if len(scenario.area.parts) > 1 else "polygon"
    area_key = f"{several}_{'lon_lat_deg' if scenario.area.is_geographic else 'east_north_m'}"
    fence_key = scenario.limits.fence_key or "fence_margin_m"
    home = [] if home_en is None else [("home", shapely.Point(home_en))]
    for key, position in [*home, (f"area.{area_key}", area), (f"limits.{fence_key}", fence)]:
        reach_m = float(np.abs(shapely.bounds(position)).max())
        if not reach_m <= MAX_REACH_M:
            raise ScenarioError(
                f"{key}: the position is {reach_m / 1000.0:.0f} km from the origin of the local frame; the limit is "
                f"{MAX_REACH_M / 1000.0:.0f} km (are longitude and latitude swapped, or are these map coordinates "
                "instead of local ones?)"
            )


def _polygon(lon_lat_deg: Ring, frame: LocalFrame | None) -> shapely.Polygon:
    if frame is None:
        raise ScenarioError("area: a polygon in degrees requires a home or an origin")
    return shapely.Polygon(frame.en_from_lon_lat(lon_lat_deg))


def _home_en(scenario: Scenario, frame: LocalFrame | None) -> FloatArray | None:
    home = scenario.home
    if home is None:
        return None
    if home.east_m is not None and home.north_m is not None:
        return np.array([home.east_m, home.north_m])
    if frame is None or home.lat_deg is None or home.lon_deg is None:
        raise ScenarioError("home: lat_deg and lon_deg require an origin")
    return np.asarray(frame.enu_from_geodetic(home.lat_deg, home.lon_deg, frame.alt_amsl_m)[0, :2])


def rally_en(scenario: Scenario, frame: LocalFrame | None) -> FloatArray:
    """(r, 2) east and north of the rally points that the scenario lists; without a position on Earth it must list none."""
    given = scenario.planner.rally
    if isinstance(given, str):
        return np.empty((0, 2))
    if frame is None:
        raise ScenarioError("planner.rally: positions in degrees require a home or an origin")
    return frame.en_from_lon_lat(given)


def _footprints(scenario: Scenario, frame: LocalFrame | None, positions: shapely.Geometry) -> list[Footprint]:
    """The obstacles that stand in area or fence, or near enough to matter there."""
    found = []
    for number, prism in enumerate(scenario.obstacles.prisms):
        rings = [_polygon(ring, frame).exterior for ring in prism.rings_lon_lat_deg]
        rings += [shapely.LinearRing(ring) for ring in prism.rings_east_north_m]
        polygon = shapely.Polygon(rings[0], rings[1:])
        if polygon.distance(positions) <= TERRAIN_MARGIN_M:
            found.append(Footprint(prism.name or str(number), polygon, prism.height_m))
    return found


def _fence(
    scenario: Scenario, frame: LocalFrame | None, area: shapely.Geometry, home_en: FloatArray | None
) -> shapely.Polygon:
    limits, key = scenario.limits, scenario.limits.fence_key
    if key is not None:
        in_degrees = limits.fence_rings_lon_lat_deg
        if in_degrees and frame is None:
            raise ScenarioError(
                f"limits.{key}: this key requires a position on Earth; add an [origin], or use "
                f"{key.replace('lon_lat_deg', 'east_north_m')}"
            )
        in_metres = limits.fence_polygons_east_north_m or ()
        in_metres = (limits.fence_east_north_m,) if limits.fence_east_north_m is not None else in_metres
        parts = [_polygon(ring, frame) for ring in in_degrees] or [shapely.Polygon(ring) for ring in in_metres]
        for part in parts:
            if not part.is_valid:
                raise ScenarioError(
                    f"limits.{key}: {shapely.is_valid_reason(part)}; a ring must not cross or touch itself"
                )
        fence = shapely.union_all(parts) if len(parts) > 1 else parts[0]
        if not isinstance(fence, shapely.Polygon):
            raise ScenarioError(
                f"limits.{key}: the polygons form {len(shapely.get_parts(fence))} separate parts, and no vehicle can "
                "fly between them; make the polygons overlap"
            )
        return fence
    positions = [area] if home_en is None else [area, shapely.Point(home_en)]
    grown = shapely.union_all(positions).convex_hull.buffer(limits.fence_margin_m, join_style="mitre")
    # Few vertices: a fence is uploaded item by item. Simplifying outwards would need more; the hull has few already.
    return grown if isinstance(grown, shapely.Polygon) else shapely.Polygon(grown.exterior)


def _ground(
    scenario: Scenario,
    frame: LocalFrame | None,
    bounds_m: tuple[float, float, float, float],
    terrain_file: Path | TerrainSource | None,
) -> Ground:
    terrain = scenario.terrain
    if isinstance(terrain, SineCosineTerrain):
        return sine_cosine_ground(terrain.scale_m)
    if frame is None or terrain_file is None:
        raise ScenarioError("terrain: raster terrain requires a position on Earth; add an [origin]")
    ground = read_ground(
        terrain_file, terrain.vertical_datum, frame=frame, bounds_m=_with_margin(bounds_m), grid_step_m=terrain.grid_step_m
    )  # fmt: skip
    margin_m = scenario.limits.height_margin_m
    if ground.error_m > max(FILES.max_error_m, margin_m):
        raise ScenarioError(
            f"terrain.grid_step_m: a grid of {terrain.grid_step_m:g} m differs from the terrain in the file by up to "
            f"{ground.error_m:.1f} m, but limits.height_margin_m is {margin_m:g} m; remove grid_step_m to use the "
            f"file's pixels, or set height_margin_m to at least {ground.error_m + 0.05:.1f}"
        )
    return ground


def _with_margin(bounds_m: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    west, south, east, north = bounds_m
    return west - TERRAIN_MARGIN_M, south - TERRAIN_MARGIN_M, east + TERRAIN_MARGIN_M, north + TERRAIN_MARGIN_M


def load_site(scenario: str | Path | Scenario) -> Site:
    """A scenario (a file, the name of a bundled one, or loaded already) on its ground.

    Raises:
        ScenarioError, TerrainError: it cannot be understood, or its elevation data cannot be used.
    """
    loaded = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
    terrain = loaded.terrain
    return build_site(loaded, terrain_file=terrain_source(terrain) if isinstance(terrain, RasterTerrain) else None)

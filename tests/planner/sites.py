"""Small sites for the tests: a ground from a formula, an area in metres, a position on Earth with unequal coordinates."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import shapely

from uavcover.model.area import Area, SineCosineTerrain
from uavcover.model.limits import FlightLimits, Home, NoFly, Obstacle, Obstacles
from uavcover.model.scenario import Origin, PlannerSettings, Requirements, Scenario
from uavcover.model.sensor import NadirCamera, Sensor
from uavcover.model.vehicle import Vehicle, Wind
from uavcover.scenario.airspace.zones import local_zones
from uavcover.scenario.obstacles import Footprint, stand_on
from uavcover.scenario.site import Site
from uavcover.terrain.frames import LocalFrame
from uavcover.terrain.ground import grid_ground

ORIGIN = Origin(lat_deg=36.5, lon_deg=-84.2, alt_amsl_m=400.0)
SQUARE = ((0.0, 0.0), (300.0, 0.0), (300.0, 200.0), (0.0, 200.0))
CAMERA = NadirCamera(kind="nadir-camera", fov_deg=70.0, range_m=200.0)
Ups = Callable[[np.ndarray, np.ndarray], np.ndarray]

EXACT = {"acceleration_m_s2": math.inf}
"""A vehicle that flies through its waypoints, and not beside them."""

LOW_M, HIGH_M, STEP_M = -600.0, 1000.0, 10.0


def flat(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    return np.zeros_like(east + north)


def hills(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    return 15.0 * np.sin(east / 60.0) * np.cos(north / 45.0) + 0.05 * east


def ridge(at_east_m: float, height_m: float, half_width_m: float = 40.0) -> Ups:
    return lambda east, north: np.maximum(0.0, height_m * (1.0 - np.abs(east - at_east_m) / half_width_m)) + 0.0 * north


def make_site(
    ups: Ups = flat,
    *,
    ring: tuple[tuple[float, float], ...] = SQUARE,
    holes: tuple[tuple[tuple[float, float], ...], ...] = (),
    more_parts: tuple[tuple[tuple[float, float], ...], ...] = (),
    home: tuple[float, float] | None = (-100.0, 50.0),
    on_earth: bool = True,
    fence: tuple[tuple[float, float], ...] | None = None,
    cell_m: float = 10.0,
    sensor: Sensor = CAMERA,
    limits: dict[str, Any] | None = None,
    vehicle: dict[str, Any] | None = None,
    planner: dict[str, Any] | None = None,
    requirements: dict[str, Any] | None = None,
    obstacles: Obstacles | None = None,
    no_fly: tuple[NoFly, ...] = (),
    flight_window_utc: tuple[str, str] | None = None,
    wind: Wind | None = None,
) -> Site:
    scenario = Scenario(
        name="test",
        area=Area(cell_size_m=cell_m, polygons_east_north_m=((ring, *holes), *((part,) for part in more_parts))),
        terrain=SineCosineTerrain(kind="sine-cosine"),
        sensor=sensor,
        limits=FlightLimits(**{"min_height_agl_m": 40.0, "max_height_agl_m": 120.0, **(limits or {})}),
        vehicle=Vehicle(**(vehicle or {})),
        origin=ORIGIN if on_earth else None,
        home=None if home is None else Home(east_m=home[0], north_m=home[1]),
        planner=PlannerSettings(**{"algorithm": "imodbo", "population_size": 20, "evaluations": 60, **(planner or {})}),
        requirements=Requirements(**(requirements or {})),
        wind=wind or Wind(),
        obstacles=obstacles or Obstacles(),
        no_fly=no_fly,
        flight_window_utc=flight_window_utc,
    )
    axis = np.arange(LOW_M, HIGH_M + STEP_M / 2, STEP_M)
    east, north = np.meshgrid(axis, axis)
    ground = grid_ground(
        ups(east, north), east0_m=LOW_M, north0_m=LOW_M, step_m=STEP_M, source="a formula", vertical_datum="EGM96"
    )
    area = shapely.Polygon(ring).difference(shapely.union_all([shapely.Polygon(hole) for hole in holes]))
    area = shapely.union_all([area, *map(shapely.Polygon, more_parts)])
    hull = shapely.union_all([area, shapely.Point(home)] if home is not None else [area]).convex_hull
    home_m = None
    if home is not None:
        home_m = np.array([*home, float(ground.heights_m(np.array(home))[0])])
    frame = LocalFrame(ORIGIN.lat_deg, ORIGIN.lon_deg, ORIGIN.alt_amsl_m) if on_earth else None
    around = shapely.Polygon(fence) if fence is not None else hull.buffer(150.0, join_style="mitre")
    footprints = [
        Footprint(
            prism.name, shapely.Polygon(prism.rings_east_north_m[0], prism.rings_east_north_m[1:]), prism.height_m
        )
        for prism in scenario.obstacles.prisms
    ]
    ground, prisms = stand_on(ground, footprints, largest_clearance_m=scenario.obstacles.clearance_beside_m)
    zones = local_zones(no_fly, frame, around if home is None else shapely.union_all([around, shapely.Point(home)]))
    in_force = tuple(zone for zone in zones if zone.entry.in_force(scenario.flight_window))
    others = tuple(zone for zone in zones if zone not in in_force)
    return Site(scenario, frame, ground, area, around, home_m, prisms, in_force, others)


def tower(
    west_m: float, south_m: float, east_m: float, north_m: float, height_m: float, *, name: str = "tower"
) -> Obstacle:
    ring = ((west_m, south_m), (east_m, south_m), (east_m, north_m), (west_m, north_m))
    return Obstacle(height_m=height_m, rings_east_north_m=(ring,), name=name)


def with_scenario(site: Site, **changes: Any) -> Site:
    return dataclasses.replace(site, scenario=dataclasses.replace(site.scenario, **changes))

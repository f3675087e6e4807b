"""Routes, and what the mission compiler makes of them."""

import dataclasses
import math

import numpy as np
from pyproj import Transformer

from mission_io.model.items import MissionItem
from tests.planner.sites import ORIGIN
from uavcover.missions.mission_compiler import CompiledMission, compile_mission
from uavcover.model.route import Route
from uavcover.planner.baselines.boustrophedon import fly_layout, regular_layout
from uavcover.scenario.site import Site

HOME = (-100.0, 50.0)


def sensing_route(site: Site, height_agl_m: float = 80.0) -> Route:
    return fly_layout(
        site, regular_layout(angle_rad=0.0, lines=3, height_agl_m=height_agl_m, inset=0.0, tolerance_m=10.0)
    )


def route(*points: tuple[float, float, float]) -> Route:
    return Route(np.array(points))


def compiled(site: Site, planned: Route | None = None) -> CompiledMission:
    return compile_mission(site, sensing_route(site) if planned is None else planned, autopilot="ardupilot")


def enu_of(items: list[MissionItem]) -> np.ndarray:
    """Places of items in the scenario's frame, by way of Earth-centred coordinates and pyproj alone."""
    to_earth = Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    lat, lon = math.radians(ORIGIN.lat_deg), math.radians(ORIGIN.lon_deg)
    east = np.array([-math.sin(lon), math.cos(lon), 0.0])
    north = np.array([-math.sin(lat) * math.cos(lon), -math.sin(lat) * math.sin(lon), math.cos(lat)])
    up = np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])
    origin = np.array(to_earth.transform(ORIGIN.lon_deg, ORIGIN.lat_deg, ORIGIN.alt_amsl_m))
    return np.array([np.stack([east, north, up]) @ (np.array(position) - origin) for position in (
        to_earth.transform(item.lon_deg, item.lat_deg, item.alt_m) for item in items
    )])  # fmt: skip


def amsl(found: CompiledMission) -> list[MissionItem]:
    assert found.mission.home is not None
    home_alt = found.mission.home.alt_amsl_m
    return [dataclasses.replace(item, alt_m=item.alt_m + home_alt) for item in found.mission.items]

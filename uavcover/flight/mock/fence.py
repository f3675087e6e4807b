"""Whether the mock vehicle is where its fence lets it be."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from mission_io.areas import Fence, fence_from_items
from mission_io.items import MissionItem, MissionType
from uavcover.flight.mock.dynamics import Vector
from uavcover.frames import LocalFrame

if TYPE_CHECKING:
    from uavcover.flight.mock.vehicle import MockVehicle

Ring = tuple[tuple[float, float], ...]

_HEIGHT, _CIRCLE, _AREAS = 1, 2, 4
"""Bits of FENCE_TYPE."""


class FenceWatch:
    """The fence that a vehicle holds, in its own frame."""

    def __init__(self) -> None:
        self._items: tuple[MissionItem, ...] = ()
        self._inclusions: list[Ring] = []
        self._exclusions: list[Ring] = []
        self._circles: list[tuple[float, float, float, bool]] = []

    def breach(self, vehicle: "MockVehicle") -> str | None:
        """Which limit the vehicle believes to be beyond, in its autopilot's words; None when it is inside of all."""
        items = vehicle.missions.items(MissionType.FENCE)
        if items is not self._items:
            self._read(items, vehicle.body.frame)
        where = vehicle.body.believed.position_m
        ardupilot, get = vehicle.is_ardupilot, vehicle.parameters
        if ardupilot and not get["FENCE_ENABLE"]:
            return None
        kinds = int(get["FENCE_TYPE"]) if ardupilot else _HEIGHT | _CIRCLE | _AREAS
        highest_m = get["FENCE_ALT_MAX" if ardupilot else "GF_MAX_VER_DIST"]
        farthest_m = get["FENCE_RADIUS" if ardupilot else "GF_MAX_HOR_DIST"]
        if kinds & _HEIGHT and 0.0 < highest_m < where[2]:
            return "Max Alt"
        if kinds & _CIRCLE and 0.0 < farthest_m < math.hypot(where[0], where[1]):
            return "Circle"
        return "Polygon" if kinds & _AREAS and self._outside_areas(where) else None

    def _outside_areas(self, where: Vector) -> bool:
        x, y = where[0], where[1]
        wanted = [_inside(x, y, ring) for ring in self._inclusions]
        wanted += [math.hypot(x - e, y - n) <= r for e, n, r, inclusion in self._circles if inclusion]
        forbidden = [_inside(x, y, ring) for ring in self._exclusions]
        forbidden += [math.hypot(x - e, y - n) < r for e, n, r, inclusion in self._circles if not inclusion]
        return (bool(wanted) and not any(wanted)) or any(forbidden)

    def _read(self, items: tuple[MissionItem, ...], frame: LocalFrame) -> None:
        self._items = items
        fence: Fence = fence_from_items(items)

        def east_north(lat_deg: float, lon_deg: float) -> tuple[float, float]:
            east, north, _ = frame.enu_from_geodetic(lat_deg, lon_deg, frame.alt_amsl_m)[0]
            return float(east), float(north)

        rings = [
            (polygon.inclusion, tuple(east_north(v.lat_deg, v.lon_deg) for v in polygon.vertices))
            for polygon in fence.polygons
        ]
        self._inclusions = [ring for inclusion, ring in rings if inclusion]
        self._exclusions = [ring for inclusion, ring in rings if not inclusion]
        self._circles = [
            (*east_north(c.center.lat_deg, c.center.lon_deg), c.radius_m, c.inclusion) for c in fence.circles
        ]


def _inside(x: float, y: float, ring: Sequence[tuple[float, float]]) -> bool:
    """Whether a point is inside a ring, by the number of edges to its east (even-odd rule)."""
    inside = False
    ax, ay = ring[-1]
    for bx, by in ring:
        if (ay > y) != (by > y) and x < (bx - ax) * (y - ay) / (by - ay) + ax:
            inside = not inside
        ax, ay = bx, by
    return inside

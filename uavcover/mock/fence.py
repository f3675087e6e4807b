"""Whether the mock vehicle is inside its fence."""

import math
from collections.abc import Sequence

from mission_io.model.items import Fence, MissionItem, MissionType, fence_from_items
from uavcover.mock.behaviour import Parameters
from uavcover.mock.body import MockBody
from uavcover.mock.dynamics import Vector
from uavcover.mock.mission_store import MissionStore
from uavcover.terrain.frames import LocalFrame

Ring = tuple[tuple[float, float], ...]

_HEIGHT, _CIRCLE, _AREAS, _FLOOR = 1, 2, 4, 8
"""Bits of FENCE_TYPE."""


class FenceWatch:
    """Tells whether the vehicle breaches the fence that it holds, or the limits in its parameters.

    Args:
        missions: holds the fence.
        body: gives the vehicle's frame and believed position.
        parameters: the fence parameters of the autopilot.
        ardupilot: whether the autopilot is ArduPilot; otherwise PX4.

    Attributes:
        switched_off: whether a command has put ArduPilot's fence out of force.
    """

    def __init__(self, missions: MissionStore, body: MockBody, parameters: Parameters, *, ardupilot: bool) -> None:
        self._missions, self._body, self._parameters, self._ardupilot = missions, body, parameters, ardupilot
        self._items: tuple[MissionItem, ...] = ()
        self._inclusions: list[Ring] = []
        self._exclusions: list[Ring] = []
        self._circles: list[tuple[float, float, float, bool]] = []
        self._floor_in_force = False
        self.switched_off = False

    @property
    def in_force(self) -> bool:
        """Whether the vehicle keeps to its fence: PX4 to any that it holds, ArduPilot by its parameter and by command."""
        return not self._ardupilot or bool(self._parameters["FENCE_ENABLE"] and not self.switched_off)

    @property
    def highest_m(self) -> float:
        """Height above home up to where ArduPilot returns while its fence has a ceiling; infinite without one."""
        get = self._parameters
        if not self._ardupilot or not get["FENCE_ENABLE"] or not int(get["FENCE_TYPE"]) & _HEIGHT:
            return math.inf
        return get["FENCE_ALT_MAX"] - get["FENCE_MARGIN"]

    def breach(self) -> str | None:
        """The limit that the believed position breaches, named as the autopilot names it; None inside all limits."""
        where = self._body.believed.position_m
        has_floor = self._ardupilot and self.in_force and int(self._parameters["FENCE_TYPE"]) & _FLOOR
        below = has_floor and self._below_floor(where[2] - self._body.home_m[2])
        return self._breach_at(where) or ("Min Alt" if below else None)

    def allows(self, place_m: Vector) -> bool:
        """Whether the limits in force hold at a position."""
        get = self._parameters
        has_floor = self._ardupilot and self.in_force and int(get["FENCE_TYPE"]) & _FLOOR
        if has_floor and place_m[2] - self._body.home_m[2] < get["FENCE_ALT_MIN"]:
            return False
        return self._breach_at(place_m) is None

    def _breach_at(self, where: Vector) -> str | None:
        items = self._missions.items(MissionType.FENCE)
        if items is not self._items:
            self._read(items, self._body.frame)
        up_m = where[2] - self._body.home_m[2]
        ardupilot, get = self._ardupilot, self._parameters
        if not self.in_force:
            return None
        kinds = int(get["FENCE_TYPE"]) if ardupilot else _HEIGHT | _CIRCLE | _AREAS
        highest_m = get["FENCE_ALT_MAX" if ardupilot else "GF_MAX_VER_DIST"]
        farthest_m = get["FENCE_RADIUS" if ardupilot else "GF_MAX_HOR_DIST"]
        if kinds & _HEIGHT and 0.0 < highest_m < up_m:
            return "Max Alt"
        if kinds & _CIRCLE and 0.0 < farthest_m < math.dist(where[:2], self._body.home_m[:2]):
            return "Circle"
        return "Polygon" if kinds & _AREAS and self._outside_areas(where) else None

    def _below_floor(self, up_m: float) -> bool:
        """The floor comes into force when the vehicle has climbed above it, and ends with the landing."""
        floor_m, body = self._parameters["FENCE_ALT_MIN"], self._body
        if body.on_ground or body.itinerary.landing:
            self._floor_in_force = False
        elif up_m >= floor_m + self._parameters["FENCE_MARGIN"]:
            self._floor_in_force = True
        return self._floor_in_force and up_m <= floor_m

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
    """Whether a point is inside a ring (even-odd rule: counts the edges to its east)."""
    inside = False
    ax, ay = ring[-1]
    for bx, by in ring:
        if (ay > y) != (by > y) and x < (bx - ax) * (y - ay) / (by - ay) + ax:
            inside = not inside
        ax, ay = bx, by
    return inside

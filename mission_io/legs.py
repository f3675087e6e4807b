"""The legs that a mission flies, one after the other, with their heights and their places on the ground."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from mission_io.errors import MisuseError
from mission_io.geodesy import ground_distance_m
from mission_io.items import Command, Frame, GeoPoint, Mission, MissionItem
from mission_io.surface import FloatArray, Surface

_FLOWN_TO = frozenset(
    {
        Command.NAV_WAYPOINT, Command.NAV_SPLINE_WAYPOINT, Command.NAV_LOITER_UNLIM, Command.NAV_LOITER_TURNS,
        Command.NAV_LOITER_TIME, Command.NAV_LOITER_TO_ALT,
    }
)  # fmt: skip
_TAKEOFFS = frozenset({Command.NAV_TAKEOFF, Command.NAV_VTOL_TAKEOFF})
_LANDINGS = frozenset({Command.NAV_LAND, Command.NAV_VTOL_LAND})
_MOST_STEPS = 200_000


class LegKind(Enum):
    """What a leg is for."""

    TAKEOFF = "take-off"
    FLIGHT = "flight"
    RETURN = "return"
    LANDING = "landing"


class Climb(Enum):
    """How a vehicle gets to the height of its take-off."""

    STRAIGHT_UP = "straight up"
    TOWARDS_THE_PLACE = "towards the place"


@dataclass(frozen=True, slots=True)
class Leg:
    """A straight stretch: over ground the shortest way, in height an even climb.

    Attributes:
        item: Number of the item at its end; the first item of a mission is 1.
        kind: What it is for.
        start: Where it begins: degrees, and metres above mean sea level.
        end: Where it ends.
        follows_terrain: Whether the vehicle keeps heights above the terrain that lies below it, as it knows the
            terrain, instead of the even climb.
        start_height_agl_m: For such a leg, the height above terrain at its beginning; NaN for others.
        end_height_agl_m: Likewise at its end.
    """

    item: int
    kind: LegKind
    start: GeoPoint
    end: GeoPoint
    follows_terrain: bool = False
    start_height_agl_m: float = math.nan
    end_height_agl_m: float = math.nan

    @property
    def ground_m(self) -> float:
        """Its length over ground."""
        return ground_distance_m(self.start.lat_deg, self.start.lon_deg, self.end.lat_deg, self.end.lon_deg)

    @property
    def climb_m(self) -> float:
        """How much higher it ends."""
        return self.end.alt_amsl_m - self.start.alt_amsl_m

    @property
    def length_m(self) -> float:
        """Its length in space."""
        return math.hypot(self.ground_m, self.climb_m)

    def places(self, fractions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Latitudes and longitudes, (n,) degrees, at (n,) fractions of the way from 0 to 1 along the great circle.

        It is within 0.2 m of the geodesic of WGS 84 for legs up to 50 km (tested against pyproj). Autopilots fly
        straight in a local frame instead, at 45 degrees of latitude 0.5 m beside it on 5 km and 8 m beside it on 20 km.
        """
        a, b = _normal(self.start), _normal(self.end)
        angle = math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))
        t = np.asarray(fractions, dtype=np.float64)[:, None]
        if angle < 1e-12:
            weight_a, weight_b = 1.0 - t, t
        else:
            weight_a, weight_b = np.sin((1.0 - t) * angle) / math.sin(angle), np.sin(t * angle) / math.sin(angle)
        between = weight_a * a + weight_b * b
        x, y, z = between.T
        return np.degrees(np.arctan2(z, np.hypot(x, y))), np.degrees(np.arctan2(y, x))

    def altitudes_amsl_m(self, fractions: FloatArray) -> FloatArray:
        """Heights above mean sea level, (n,) metres, of the even climb."""
        return self.start.alt_amsl_m + np.asarray(fractions, dtype=np.float64) * self.climb_m


def legs_of(
    mission: Mission,
    *,
    surface: Surface | None = None,
    climb: Climb = Climb.STRAIGHT_UP,
    return_alt_above_home_m: float | None = None,
) -> tuple[Leg, ...]:
    """The legs of a mission, with every jump followed as often as it says (once when it says for ever).

    A mission without a take-off begins at its first place: the vehicle is flying already. Landings go at the height
    before them to the place and then straight down. A return to launch climbs to ``return_alt_above_home_m`` where it
    is below that, goes home and straight down; without that height, which is set in the autopilot, it has no legs.

    Raises:
        MisuseError: a place or height that is not a number, heights above home without a home, heights above terrain
            without a surface that knows the ground there, or jumps that make more than 200,000 steps.
    """
    found: list[Leg] = []
    here: GeoPoint | None = None
    for number, item in items_in_flying_order(mission):
        if item.command == Command.NAV_RETURN_TO_LAUNCH:
            if here is not None and mission.home is not None and return_alt_above_home_m is not None:
                found += _return_legs(number, here, mission.home, return_alt_above_home_m)
                here = mission.home
            continue
        if item.command in _LANDINGS:
            place = _landing_place(item, here, mission, surface, number)
            if here is not None:
                above = replace(place, alt_amsl_m=here.alt_amsl_m)
                if above != here:
                    found.append(Leg(number, LegKind.FLIGHT, here, above))
                found.append(Leg(number, LegKind.LANDING, above, place))
            here = place
            continue
        takes_off = item.command in _TAKEOFFS
        if not takes_off and item.command not in _FLOWN_TO:
            continue
        place = _place(item, mission.home, surface, number)
        if takes_off:
            here = here if here is not None else mission.home
            if here is not None and climb is Climb.STRAIGHT_UP:
                place = replace(here, alt_amsl_m=place.alt_amsl_m)
        if here is not None:
            found.append(_leg(number, item, here, place, surface, LegKind.TAKEOFF if takes_off else LegKind.FLIGHT))
        here = place
    return tuple(found)


def items_in_flying_order(mission: Mission) -> Iterator[tuple[int, MissionItem]]:
    """The items with their numbers as they come, jumps followed: one for ever is followed once, one to itself never.

    Raises:
        MisuseError: jumps that make more than 200,000 steps.
    """
    left: dict[int, float] = {}
    number, steps = 1, 0
    while number <= len(mission.items):
        steps += 1
        if steps > len(mission.items) + _MOST_STEPS:
            raise MisuseError(f"item {number}: the mission's jumps make more than {_MOST_STEPS} steps")
        item = mission.items[number - 1]
        yield number, item
        number += 1
        if item.command == Command.DO_JUMP:
            target, times = item.params[:2]
            here = number - 1
            left.setdefault(here, 1.0 if times < 0 else times)
            if left[here] >= 1.0 and 1.0 <= target <= len(mission.items) and target != here:
                left[here] -= 1.0
                number = int(target)


def _leg(
    number: int, item: MissionItem, here: GeoPoint, place: GeoPoint, surface: Surface | None, kind: LegKind
) -> Leg:
    if item.frame is not Frame.ABOVE_TERRAIN or surface is None:
        return Leg(number, kind, here, place)
    height_agl_m = here.alt_amsl_m - _ground_amsl_m(surface, here.lat_deg, here.lon_deg, number)
    return Leg(number, kind, here, place, True, height_agl_m, item.alt_m)


def _return_legs(number: int, here: GeoPoint, home: GeoPoint, alt_above_home_m: float) -> Iterator[Leg]:
    high = replace(here, alt_amsl_m=max(here.alt_amsl_m, home.alt_amsl_m + alt_above_home_m))
    above_home = replace(home, alt_amsl_m=high.alt_amsl_m)
    if high != here:
        yield Leg(number, LegKind.RETURN, here, high)
    yield Leg(number, LegKind.RETURN, high, above_home)
    yield Leg(number, LegKind.LANDING, above_home, home)


def _landing_place(
    item: MissionItem, here: GeoPoint | None, mission: Mission, surface: Surface | None, number: int
) -> GeoPoint:
    """A landing at latitude 0, longitude 0 is one where the vehicle is."""
    if item.lat_deg == 0.0 and item.lon_deg == 0.0 and here is not None:
        item = replace(item, lat_deg=here.lat_deg, lon_deg=here.lon_deg)
    return _place(item, mission.home, surface, number)


def _place(item: MissionItem, home: GeoPoint | None, surface: Surface | None, number: int) -> GeoPoint:
    where = f"item {number}"
    if not all(map(math.isfinite, (item.lat_deg, item.lon_deg, item.alt_m))) or not abs(item.lat_deg) <= 90.0:
        raise MisuseError(f"{where}: no place; see check_for_autopilot")
    if item.frame is Frame.AMSL:
        return GeoPoint(item.lat_deg, item.lon_deg, item.alt_m)
    if item.frame is Frame.ABOVE_HOME:
        if home is None:
            raise MisuseError(f"{where}: its height is above home, and the mission has no home; give the home")
        return GeoPoint(item.lat_deg, item.lon_deg, home.alt_amsl_m + item.alt_m)
    if item.frame is Frame.COMMAND:
        raise MisuseError(f"{where}: command {item.command} without a position; give it one")
    if surface is None:
        raise MisuseError(f"{where}: its height is above the terrain; give a surface")
    ground_amsl_m = _ground_amsl_m(surface, item.lat_deg, item.lon_deg, number)
    return GeoPoint(item.lat_deg, item.lon_deg, ground_amsl_m + item.alt_m)


def _ground_amsl_m(surface: Surface, lat_deg: float, lon_deg: float, number: int) -> float:
    height = float(surface.heights_amsl_m(np.array([lat_deg]), np.array([lon_deg]))[0])
    if math.isnan(height):
        raise MisuseError(f"item {number}: its height is above a terrain that the surface does not know there")
    return height


def _normal(point: GeoPoint) -> FloatArray:
    """The direction straight up at a place, as a unit vector from the centre of the Earth's axis (n-vector)."""
    lat, lon = math.radians(point.lat_deg), math.radians(point.lon_deg)
    return np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)])

"""The vehicles of a site: their speeds, their pads, and the site and part of the area of each."""

import dataclasses
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from uavcover.errors import ScenarioError, UavcoverError
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.flight_time import BLENDED, BRAKED, Pace
from uavcover.model.area import RasterTerrain
from uavcover.model.limits import Home
from uavcover.model.scenario import Origin, Scenario
from uavcover.model.sensor import Sensor
from uavcover.model.vehicle import AutopilotMotion, AutopilotName
from uavcover.scenario.airspace.zones import check_is_outside
from uavcover.scenario.obstacles import check_is_clear
from uavcover.scenario.site import Site, area_as_drawn, load_site, once, polygons_in_metres
from uavcover.scenario.surface_model import check_home_is_open


def pace_of(site: Site, autopilot: AutopilotName | None = None) -> Pace:
    """Speeds and motion of a site's vehicle in its wind, flown by this autopilot; default: the scenario's own."""
    vehicle, wind = site.scenario.vehicle, site.scenario.wind
    to_rad = math.radians(wind.from_deg + 180.0)
    return moving_pace(
        vehicle.motion(autopilot),
        cruise_m_s=vehicle.cruise_speed_m_s,
        climb_m_s=vehicle.max_climb_m_s,
        descent_m_s=vehicle.max_descent_m_s,
        airspeed_m_s=vehicle.max_airspeed_m_s,
        wind_m_s=(wind.speed_m_s * math.sin(to_rad), wind.speed_m_s * math.cos(to_rad)),
    )


def moving_pace(
    motion: AutopilotMotion,
    *,
    cruise_m_s: float,
    climb_m_s: float,
    descent_m_s: float,
    airspeed_m_s: float | None,
    wind_m_s: tuple[float, float],
) -> Pace:
    """Inputs of the flight time: the autopilot's motion, the speeds, and the wind towards east and north."""
    own = {field.name: getattr(motion, field.name) for field in dataclasses.fields(motion)}
    own = {name: math.inf if value is None else value for name, value in own.items()}
    return Pace(
        cruise_m_s=cruise_m_s,
        climb_m_s=climb_m_s,
        descent_m_s=descent_m_s,
        airspeed_m_s=math.inf if airspeed_m_s is None else airspeed_m_s,
        wind_east_m_s=wind_m_s[0],
        wind_north_m_s=wind_m_s[1],
        **own | {"corner": BLENDED if motion.corner == "blended" else BRAKED},
    )


_ROUNDING_M = 0.01
"""Added to the distance between pads, whose positions are rounded."""
_HALF_ROW = 4
"""Pads of a row on either side of its middle."""
_AROUND = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])


def on_pads(site: Site) -> Site:
    """The site with a pad for each vehicle in ``scenario.vehicles``. Unchanged where they have homes, or share one.

    Vehicles cannot stand at one position, and one position lets only one vehicle take off or land at a time. Pads are placed
    across the direction of the area, so that paths from them fan out; [home] is the first one. A pad on unsuitable ground is
    moved back or forth. The others follow in further rows.

    Raises:
        ScenarioError: there is no room for all of them; says why, and what to do.
    """
    scenario, fleet, home, frame = site.scenario, site.scenario.fleet, site.home_m, site.frame
    if fleet.vehicles == 1 or scenario.vehicles or fleet.pad_spacing_m == 0.0:
        return site
    if home is None or frame is None or scenario.home is None:
        return site
    # Each vehicle may stand beside its pad as far as readiness lets it, and fly beside its path.
    least_m = fleet.planned_separation_m + 2.0 * scenario.limits.max_home_error_m
    spacing_m = least_m if fleet.pad_spacing_m is None else fleet.pad_spacing_m
    if spacing_m < least_m:
        raise ScenarioError(
            f"fleet.pad_spacing_m: {spacing_m:g} is below separation_m + 2 path_error_m + 2 limits.max_home_error_m "
            f"= {least_m:g}; increase it, lower max_home_error_m, or use 0 for a single home"
        )
    positions, objection = [home[:2]], ""
    for position_en, axes in _candidates(site, home[:2], spacing_m + _ROUNDING_M):
        if len(positions) == fleet.vehicles:
            break
        if min(float(np.linalg.norm(axes @ (position - position_en))) for position in positions) < spacing_m:
            continue
        try:
            _check_pad(site, position_en)
            positions.append(position_en)
        except UavcoverError as error:
            objection = objection or str(error)
    homes = [scenario.home, *(_home_at(site, position_en) for position_en in positions[1:])]
    if len(homes) < fleet.vehicles:
        raise ScenarioError(
            f"fleet.vehicles: beside [home] there is room for only {len(homes)} of {fleet.vehicles} pads "
            f"{spacing_m:g} m apart ({objection}); move [home], define a home for each [[vehicle]], or set "
            "fleet.pad_spacing_m = 0, so that all take off from [home], one after the other"
        )
    # One link leads to one vehicle: those of the others are given with --to.
    link = scenario.vehicle.link
    own = scenario.vehicle
    if link is not None and not link.startswith("mock:"):
        own = dataclasses.replace(own, link=None, system_id=None)
    vehicles = tuple(dataclasses.replace(own, home=position) for position in homes)
    return dataclasses.replace(
        site, scenario=dataclasses.replace(scenario, vehicle=own, vehicles=vehicles, home=homes[0])
    )


def before_pads(site: Site) -> Site | None:
    """The site whose vehicles :func:`on_pads` placed here; None where they stand elsewhere, or share one home."""
    scenario = site.scenario
    before = dataclasses.replace(site, scenario=dataclasses.replace(scenario, vehicles=()))
    try:
        pads = [vehicle.home for vehicle in on_pads(before).scenario.vehicles]
    except ScenarioError:
        return None
    return before if pads and pads == [vehicle.home for vehicle in scenario.vehicles] else None


def _candidates(site: Site, home_en: FloatArray, spacing_m: float) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Positions around a home, the best ones first, and the axes along which they are to be apart from other pads.

    First across the direction of the area, then in any direction.
    """
    middle = site.area.centroid
    along = math.atan2(middle.y - home_en[1], middle.x - home_en[0])
    ahead = np.array([math.cos(along), math.sin(along)])
    across = np.array([-math.sin(along), math.cos(along)])
    columns = sorted(range(-_HALF_ROW, _HALF_ROW + 1), key=lambda k: (abs(k), k))
    rows = sorted(np.arange(-_HALF_ROW, _HALF_ROW + 0.5, 0.5).tolist(), key=lambda k: (abs(k), k))
    for column, row in itertools.product(columns, rows):
        if abs(row) <= 0.5 * _HALF_ROW:
            yield home_en + spacing_m * (column * across + row * ahead), across[None]
    for row, column in itertools.product(rows, columns):
        yield home_en + spacing_m * (column * across + row * ahead), np.eye(2)


def _check_pad(site: Site, position_en: FloatArray) -> None:
    """Refuse a pad outside the fence, on steep or unknown ground, beside an obstacle, or in a no-fly zone.

    Raises:
        UavcoverError: it is; the text says why.
    """
    scenario, fleet = site.scenario, site.scenario.fleet
    if not site.fence.covers(shapely.Point(position_en).buffer(fleet.path_error_m)):
        raise ScenarioError("a pad lies outside limits.fence, or at its edge")
    reach_m = max(fleet.path_error_m, 1.0)
    up_m, *around_m = site.bare_ground.heights_m(np.vstack([position_en, position_en + reach_m * _AROUND])).tolist()
    if not all(map(math.isfinite, (up_m, *around_m))):
        raise ScenarioError(f"a pad has no elevation data ({site.bare_ground.source})")
    slope_deg = math.degrees(
        math.atan(math.hypot(around_m[0] - around_m[1], around_m[2] - around_m[3]) / (2.0 * reach_m))
    )
    if slope_deg > fleet.max_pad_slope_deg:
        raise ScenarioError(
            f"the ground at a pad slopes by {slope_deg:.0f} degrees, but fleet.max_pad_slope_deg is {fleet.max_pad_slope_deg:g}"
        )
    check_is_clear("pad", scenario, position_en, [prism.footprint for prism in site.prisms])
    if site.ground_model is not None and isinstance(scenario.terrain, RasterTerrain):
        check_home_is_open(scenario.terrain, site.ground, position_en, up_m)
    check_is_outside("pad", site.zones, np.array([*position_en, up_m]), site.alt_amsl_offset_m)


def _home_at(site: Site, position_en: FloatArray) -> Home:
    """A pad as a home, in degrees where [home] is."""
    given, frame = site.scenario.home, site.frame
    if frame is None or given is None or given.lat_deg is None:
        return Home(east_m=round(float(position_en[0]), 3), north_m=round(float(position_en[1]), 3))
    up_m = float(site.bare_ground.heights_m(position_en)[0])
    lat, lon, _ = frame.geodetic_from_enu(np.array([*position_en, up_m]))
    return Home(lat_deg=round(float(lat[0]), 8), lon_deg=round(float(lon[0]), 8))


# The sites of different vehicles: the same ground and area, with the home and the settings of each.


def vehicle_scenario(site: Site, number: int) -> Scenario:
    """The scenario of one of several different vehicles: one [vehicle] and its [home], in the frame of all.

    Args:
        site: of all vehicles.
        number: of the vehicle, from 1.
    """
    scenario, frame = site.scenario, site.frame
    own = scenario.vehicles[number - 1]
    origin = scenario.origin
    if frame is not None:
        origin = Origin(lat_deg=frame.lat_deg, lon_deg=frame.lon_deg, alt_amsl_m=frame.alt_amsl_m)
    return dataclasses.replace(
        scenario,
        vehicle=dataclasses.replace(own, home=None, area=None, sensor=None),
        home=own.home,
        sensor=own.sensor or scenario.sensor,
        origin=origin,
        vehicles=(),
        fleet=dataclasses.replace(scenario.fleet, one_at_a_time=False),
    )


@once
def vehicle_sites(site: Site) -> tuple[Site, ...]:
    """The site of each vehicle, vehicle 1 first; empty where all are identical.

    Raises:
        ScenarioError, TerrainError: a home is in a no-fly zone, by an obstacle, outside the fence or the elevation data; the
            text begins with the vehicle.
    """
    return tuple(_built(site, number) for number in range(1, len(site.scenario.vehicles) + 1))


def _built(site: Site, number: int) -> Site:
    try:
        return load_site(vehicle_scenario(site, number))
    except UavcoverError as error:
        launched = site.scenario.has_launch_points and number > 1
        which = f"[[launch_point]] number {number - 1}" if launched else f"[[vehicle]] number {number}"
        raise type(error)(f"{which}: {error}") from error


Piece = shapely.Polygon | shapely.MultiPolygon

SLIVER_M = 1.0
"""Borders of parts that are drawn apart, or over each other, by less than this are meant to be one."""


@dataclass(frozen=True, slots=True, eq=False)
class OwnParts:
    """The area, shared out as the scenario says."""

    of_vehicle: dict[int, Piece]  # the part of each vehicle that has one, by its number from 1; (east, north) metres
    rest: Piece | None  # what the others see together; None where every vehicle has a part


def groups_of(scenario: Scenario) -> tuple[tuple[int, ...], ...]:
    """The vehicles that share a part of the area, by number; empty where all share the whole area.

    A vehicle with a part sees it alone; of the others, those with equal sensors share one.
    """
    own: list[tuple[int, ...]] = []
    others: list[tuple[Sensor, list[int]]] = []
    for number, vehicle in enumerate(scenario.vehicles, start=1):
        sensor = vehicle.sensor or scenario.sensor
        alike = next((numbers for other, numbers in others if other == sensor), None)
        if vehicle.area is not None:
            own.append((number,))
        elif alike is not None:
            alike.append(number)
        else:
            others.append((sensor, [number]))
    groups = sorted([*own, *(tuple(numbers) for _, numbers in others)])
    return tuple(groups) if own or len(groups) > 1 else ()


def own_sensors(scenario: Scenario) -> bool:
    """Whether a vehicle has a sensor that is not that of [sensor]."""
    return any(vehicle.sensor not in (None, scenario.sensor) for vehicle in scenario.vehicles)


def own_parts(site: Site) -> OwnParts:
    """The vehicles' parts of the area from the scenario, and the rest.

    Together they are the area; none overlap.

    Raises:
        ScenarioError: parts overlap, lie outside the area, or leave too much or too little; says which, and by how much.
    """
    drawn = area_as_drawn(site)
    parts: dict[int, Any] = {
        number: _inside(site, number, drawn)
        for number, vehicle in enumerate(site.scenario.vehicles, start=1)
        if vehicle.area is not None
    }
    taken: Any = shapely.Polygon()
    for number, part in parts.items():
        for other, before in parts.items():
            both = part.intersection(before)
            if other < number and _is_wide(both):
                raise ScenarioError(
                    f"vehicle.{other - 1}.area and vehicle.{number - 1}.area: these areas overlap by {both.area:.0f} "
                    "square metres; move a border so that each part of [area] belongs to one vehicle"
                )
        parts[number] = part.difference(taken)
        taken = taken.union(part)
    rest = polygons_of(drawn.difference(taken))
    pieces = shapely.get_parts(rest)
    slivers = [piece for piece in pieces if not _is_wide(piece)]
    rest = polygons_of(shapely.union_all([piece for piece in pieces if _is_wide(piece)]))
    _check_rest(site.scenario, rest)
    for sliver in slivers:
        nearest = min(parts, key=lambda number: (parts[number].distance(sliver), number))
        parts[nearest] = parts[nearest].union(sliver)
    return _grown(site, drawn, parts, rest)


def polygons_of(shape: shapely.Geometry) -> Piece:
    """The polygons of a shape."""
    parts = [part for part in shapely.get_parts(shape) if isinstance(part, shapely.Polygon) and part.area > 0.0]
    return parts[0] if len(parts) == 1 else shapely.MultiPolygon(parts)


def _inside(site: Site, number: int, drawn: Piece) -> Any:
    """A vehicle's part, as drawn, inside the area."""
    outline = site.scenario.vehicles[number - 1].area
    if outline is None:
        raise ScenarioError(f"vehicle.{number - 1}.area: the key is missing")
    if outline.is_geographic and site.frame is None:
        raise ScenarioError(f"vehicle.{number - 1}.area: a polygon in degrees requires a home or an origin")
    part = polygons_in_metres(outline, site.frame)
    # The holes of the area need not be drawn into a part again.
    solid = shapely.union_all([shapely.Polygon(piece.exterior) for piece in shapely.get_parts(drawn)])
    outside = part.difference(solid)
    if not part.intersects(drawn):
        raise ScenarioError(
            f"vehicle.{number - 1}.area: this area lies outside [area], {part.distance(drawn):.0f} m away; move it"
        )
    if _is_wide(outside):
        raise ScenarioError(
            f"vehicle.{number - 1}.area: {outside.area:.0f} of the {part.area:.0f} square metres lie outside [area]; "
            "draw this area inside [area], or enlarge [area]"
        )
    inside = part.intersection(drawn)
    if not _is_wide(inside):
        raise ScenarioError(
            f"vehicle.{number - 1}.area: this area is at most {SLIVER_M:g} m wide inside [area]; enlarge it, or remove it"
        )
    return inside


def _is_wide(shape: Any) -> bool:
    """Whether a shape is more than a sliver along a border."""
    return not shape.buffer(-0.5 * SLIVER_M).is_empty


def _check_rest(scenario: Scenario, rest: Piece) -> None:
    others = [number for number, vehicle in enumerate(scenario.vehicles) if vehicle.area is None]
    if others and rest.is_empty:
        raise ScenarioError(f"vehicle.{others[0]}: the others cover the whole [area]; assign it an area, or remove it")
    if not others and not rest.is_empty:
        raise ScenarioError(
            f"vehicle.0.area to vehicle.{len(scenario.vehicles) - 1}.area: no vehicle covers {rest.area:.0f} square "
            "metres of [area]; enlarge a part, make [area] smaller, or remove the area of one vehicle, which then "
            "covers the rest"
        )


def _grown(site: Site, drawn: Piece, parts: dict[int, Any], rest: Piece) -> OwnParts:
    """The same with the margin of the area, which belongs to what it lies beside."""
    margin = site.area.difference(drawn)
    grown: dict[int, Piece] = {}
    for number, part in parts.items():
        beside = margin.intersection(part.buffer(site.scenario.area.margin_m, join_style="mitre", mitre_limit=2.0))
        margin = margin.difference(beside)
        grown[number] = polygons_of(part.union(beside))
    if rest.is_empty:
        return OwnParts(grown, None)
    return OwnParts(grown, polygons_of(rest.union(margin)))

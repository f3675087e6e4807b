"""Assign parts of the area to vehicles: the parts that the scenario names, and the rest to all others."""

import dataclasses
from dataclasses import dataclass
from typing import Any

import shapely

from uavcover.errors import ScenarioError, UavcoverError
from uavcover.model.scenario import Origin, Scenario
from uavcover.model.sensor import Sensor
from uavcover.scenario.site import Site, area_as_drawn, load_site, once, polygons_in_metres

# The sites of vehicles that differ: the same ground and area, with the home and the settings of each.


def vehicle_scenario(site: Site, number: int) -> Scenario:
    """The scenario of one of several vehicles that differ: one [vehicle] and its [home], in the frame of all.

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
    """The site of each vehicle, vehicle 1 first; none where all are alike.

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
    rest: Piece | None  # what the others see together; none where every vehicle has a part


def groups_of(scenario: Scenario) -> tuple[tuple[int, ...], ...]:
    """The vehicles that share a part of the area, by number; none where all share the whole area.

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

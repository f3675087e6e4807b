"""Take-off pads: own homes at and beside [home] for the vehicles of a fleet that are alike.

Vehicles cannot stand at one position, and one position lets only one vehicle take off or land at a time. Pads lie side by side
across the direction of the area, so that paths from them fan out; [home] is the first one. Where the ground is not good enough a
pad is moved back or forth. What does not fit side by side follows in further rows.
"""

import dataclasses
import itertools
import math
from collections.abc import Iterator

import numpy as np
import shapely

from uavcover.errors import ScenarioError, UavcoverError
from uavcover.kernels.arrays import FloatArray
from uavcover.model.limits import Home
from uavcover.model.terrain import RasterTerrain
from uavcover.scenario.airspace.zones import check_is_outside
from uavcover.scenario.obstacles import check_is_clear
from uavcover.scenario.site import Site
from uavcover.scenario.surface_model import check_home_is_open

_ROUNDING_M = 0.01
"""Added to the distance between pads, whose positions are rounded."""
_HALF_ROW = 4
"""Pads of a row on either side of its middle."""
_AROUND = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])


def on_pads(site: Site) -> Site:
    """The site with a pad for each vehicle in ``scenario.vehicles``. Unchanged where they have homes, or share one.

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
    places, objection = [home[:2]], ""
    for place_en, axes in _candidates(site, home[:2], spacing_m + _ROUNDING_M):
        if len(places) == fleet.vehicles:
            break
        if min(float(np.linalg.norm(axes @ (place - place_en))) for place in places) < spacing_m:
            continue
        try:
            _check_pad(site, place_en)
            places.append(place_en)
        except UavcoverError as error:
            objection = objection or str(error)
    homes = [scenario.home, *(_home_at(site, place_en) for place_en in places[1:])]
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
    vehicles = tuple(dataclasses.replace(own, home=place) for place in homes)
    return dataclasses.replace(
        site, scenario=dataclasses.replace(scenario, vehicle=own, vehicles=vehicles, home=homes[0])
    )


def before_pads(site: Site) -> Site | None:
    """The site whose vehicles :func:`on_pads` placed here; none where they stand elsewhere, or share one home."""
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


def _check_pad(site: Site, place_en: FloatArray) -> None:
    """Refuse a pad outside the fence, on steep or unknown ground, beside an obstacle, or in a no-fly zone.

    Raises:
        UavcoverError: it is; the text says why.
    """
    scenario, fleet = site.scenario, site.scenario.fleet
    if not site.fence.covers(shapely.Point(place_en).buffer(fleet.path_error_m)):
        raise ScenarioError("a pad lies outside limits.fence, or at its edge")
    reach_m = max(fleet.path_error_m, 1.0)
    up_m, *around_m = site.bare_ground.heights_m(np.vstack([place_en, place_en + reach_m * _AROUND])).tolist()
    if not all(map(math.isfinite, (up_m, *around_m))):
        raise ScenarioError(f"a pad has no elevation data ({site.bare_ground.source})")
    slope_deg = math.degrees(
        math.atan(math.hypot(around_m[0] - around_m[1], around_m[2] - around_m[3]) / (2.0 * reach_m))
    )
    if slope_deg > fleet.max_pad_slope_deg:
        raise ScenarioError(
            f"the ground at a pad slopes by {slope_deg:.0f} degrees, but fleet.max_pad_slope_deg is {fleet.max_pad_slope_deg:g}"
        )
    check_is_clear("pad", scenario, place_en, [prism.footprint for prism in site.prisms])
    if site.ground_model is not None and isinstance(scenario.terrain, RasterTerrain):
        check_home_is_open(scenario.terrain, site.ground, place_en, up_m)
    check_is_outside("pad", site.zones, np.array([*place_en, up_m]), site.alt_amsl_offset_m)


def _home_at(site: Site, place_en: FloatArray) -> Home:
    """A pad as a home, in degrees where [home] is."""
    given, frame = site.scenario.home, site.frame
    if frame is None or given is None or given.lat_deg is None:
        return Home(east_m=round(float(place_en[0]), 3), north_m=round(float(place_en[1]), 3))
    up_m = float(site.bare_ground.heights_m(place_en)[0])
    lat, lon, _ = frame.geodetic_from_enu(np.array([*place_en, up_m]))
    return Home(lat_deg=round(float(lat[0]), 8), lon_deg=round(float(lon[0]), 8))

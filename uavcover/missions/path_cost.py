"""The cost model of a site, and the battery use of its flights, as numbers for the kernels."""

import itertools
import math
from collections.abc import Sequence

import numpy as np

from uavcover.errors import InfeasibleError, InputError
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.energy import (
    Power,
    landing_energy,
    path_energies,
    star_energies,
    takeoff_energy,
    vertical_energies,
)
from uavcover.kernels.flight_time import landing_time, takeoff_time
from uavcover.kernels.path_cost import (
    ENERGY,
    LENGTH,
    NO_DETOURS,
    NO_ENERGIES,
    TIME,
    Detours,
    FlightEnergies,
    PathCost,
    leg_cost,
    turn_cost,
)
from uavcover.kernels.sight import horizontal_reach
from uavcover.missions.transit import direct_transit, is_too_high, low_enough
from uavcover.model.vehicle import AutopilotName, Vehicle, Wind
from uavcover.scenario.site import Site, once
from uavcover.scenario.vehicles import pace_of
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.sensors import any_heading, trigger_distance_m


def power_of(vehicle: Vehicle, *, gust_m_s: float = 0.0) -> Power:
    """A vehicle's power, as numbers for the kernels, in gusts of this standard deviation."""
    model = vehicle.power
    return Power(
        induced_m_s=model.induced_m_s,
        profile_share=model.profile_share,
        tip_m_s=model.tip_speed_m_s,
        drag_1_s=model.rotor_drag_1_s,
        drag_1_m=model.body_drag_1_m,
        idle_share=model.idle_share,
        descent_gain=model.descent_gain,
        gust_m_s=gust_m_s,
    )


_WAYPOINT_PRICE = 0.01
"""Default price of a waypoint, in radii of the sensor: of path, or of flight at cruise speed (docs/results/coverage.md)."""


def waypoint_price_of(site: Site) -> float:
    """Cost of a waypoint, in metres of path or in seconds, as the objective is: ``planner.waypoint_price`` or its default.

    The default grows with the sensor's footprint: a waypoint that a small sensor needs for its ground must not cost more than
    the path to it. A sensor that looks from the waypoints needs each, and every number of them is searched for by itself.
    """
    scenario = site.scenario
    if scenario.planner.waypoint_price is not None:
        return scenario.planner.waypoint_price
    if not scenario.sensor.looks_along_path:
        return 0.0
    middle_agl_m = 0.5 * (scenario.limits.min_height_agl_m + scenario.limits.max_height_agl_m)
    price_m = _WAYPOINT_PRICE * scenario.sensor.half_width_m(middle_agl_m)
    return price_m if scenario.objective == "length" else price_m / scenario.vehicle.cruise_speed_m_s


def path_cost_of(site: Site, *, straight: bool = False) -> PathCost:
    """The cost that the planner minimises beside coverage and the number of waypoints; ``straight``: by straight transits."""
    planner, limits = site.scenario.planner, site.scenario.limits
    objective = site.scenario.objective
    whole = objective in {"mission-time", "energy"}
    cost = mission_cost_of(site) if whole else PathCost(LENGTH, pace_of(site), 0.0, 0.0)
    return cost._replace(
        unit={"length": LENGTH, "energy": ENERGY}.get(objective, TIME),
        deviation_price=planner.band_deviation_price,
        middle_agl_m=0.5 * (limits.min_height_agl_m + limits.max_height_agl_m),
        waypoint_price=waypoint_price_of(site),
        detours=detours(site) if whole and not straight else NO_DETOURS,
    )


_FEW_TRANSITS, _MANY_TRANSITS = 8, 20
"""Rows and columns of a lattice of transits. Each takes 0.2 ms, and some ms around zones or below a ceiling that the straight one
exceeds: there few have to do."""

_MANY_TOO_HIGH = 0.2
"""Straight transits above their ceiling for each place, of two, that say that more of them would take long: 4 ms each."""

_SAME = 1.0
"""Where few transits cost less than this more than straight ones, in seconds, there are no more of them."""


@once
def detours(site: Site) -> Detours:
    """Costs of transits beside straight ones, to both ends of the height band over the area of a site with a home."""
    few, is_slow = _lattice_of_detours(site, _FEW_TRANSITS)
    return few if is_slow or few.more.max() < _SAME else _lattice_of_detours(site, _MANY_TRANSITS)[0]


def _lattice_of_detours(site: Site, count: int) -> tuple[Detours, bool]:
    """The costs, and whether it takes long to find them."""
    cost, home = mission_cost_of(site), np.asarray(site.home_m)
    cost = cost._replace(unit=ENERGY if site.scenario.objective == "energy" else TIME)
    west, south, east, north = site.area.bounds
    positions = np.meshgrid(np.linspace(west, east, count), np.linspace(south, north, count))
    positions_m = np.column_stack([axis.ravel() for axis in positions])
    heights_agl_m = _ends_of_band_m(site)
    more, too_high = np.zeros((count * count, 4)), 0
    for level, agl_m in enumerate(heights_agl_m):
        ups_m = site.ground.ups_m(positions_m, agl_m)
        for k in np.flatnonzero(np.isfinite(ups_m)):
            end_m = np.array([*positions_m[k], ups_m[k]])
            flown_m = direct_transit(site, home[:2], end_m, ground_end_height_m=cost.climb_out_m)
            if is_too_high(site, flown_m):
                too_high += 1
                flown_m = low_enough(site, flown_m, end_m, ground_end_height_m=cost.climb_out_m)
            straight_m = np.array([cost.climb_out_top, end_m])
            for column, direction in ((2 * level, 1), (2 * level + 1, -1)):
                flown, straight = (_transit_cost(cost, home, line_m, direction) for line_m in (flown_m, straight_m))
                more[k, column] = flown - straight
    more[~np.isfinite(more)] = 0.0
    lattice = more.reshape(count, count, 4)
    lattice.flags.writeable = False
    east_m, north_m = (max(side / (count - 1), 1e-6) for side in (east - west, north - south))
    is_slow = bool(site.zones) or too_high > _MANY_TOO_HIGH * count * count
    return Detours(lattice, float(west), float(south), east_m, north_m, *heights_agl_m), is_slow


def _ends_of_band_m(site: Site) -> tuple[float, float]:
    """Lowest and greatest height above ground of waypoints."""
    limits = site.scenario.limits
    low_m = limits.min_height_agl_m + limits.height_margin_m
    return low_m, max(limits.max_height_agl_m - limits.height_margin_m, low_m + 1e-3)


def _transit_cost(cost: PathCost, home_m: FloatArray, line_m: FloatArray, direction: int) -> float:
    """Cost along a (k, 3) line from above home, with take-off, or against its direction (-1), with landing."""
    climb_out_m, points = float(line_m[0, 2] - home_m[2]), [tuple(point) for point in line_m[::direction].tolist()]
    legs = sum(leg_cost(cost, p, q) for p, q in itertools.pairwise(points))
    turns = sum(turn_cost(cost, *three) for three in zip(points, points[1:], points[2:], strict=False))
    if cost.unit == ENERGY:
        column = (takeoff_energy if direction > 0 else landing_energy)(cost.power, cost.pace, climb_out_m)
    else:
        column = (takeoff_time if direction > 0 else landing_time)(cost.pace, climb_out_m)
    return float(legs + turns + column)


def mission_cost_of(site: Site) -> PathCost:
    """Time and energy of the whole mission of a site with a home, by straight transits."""
    vehicle, home = site.scenario.vehicle, site.home_m
    if home is None:
        raise InputError(f"scenario {site.scenario.name} has no [home], so the flight time of a mission is unknown")
    return PathCost(
        unit=TIME,
        pace=pace_of(site),
        deviation_price=0.0,
        middle_agl_m=0.0,
        mission=1,
        climb_out_top=(float(home[0]), float(home[1]), float(home[2]) + vehicle.takeoff_height_m),
        climb_out_m=vehicle.takeoff_height_m,
        power=power_of(vehicle, gust_m_s=site.scenario.wind.gust_m_s),
        stop_at_first=0 if trigger_distance_m(site.scenario) is None else 1,
    )


_DIRECTIONS = 12
"""Directions of the strongest wind. Between two of them the airspeed differs by less than 4 % of the wind."""


def winds_of(wind: Wind) -> FloatArray:
    """(w, 2) winds that batteries are planned for, towards east and north: the stated wind, and the strongest from all sides."""
    to_rad = math.radians(wind.from_deg + 180.0)
    known = np.array([[wind.speed_m_s * math.sin(to_rad), wind.speed_m_s * math.cos(to_rad)]])
    if not wind.most_m_s:
        return known
    sides_rad = 2.0 * math.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    return np.vstack([known, wind.most_m_s * np.column_stack([np.sin(sides_rad), np.cos(sides_rad)])])


def usable_s(vehicle: Vehicle) -> float:
    """Seconds of hovering that the model may count for a flight, so that it keeps the reserve; infinite without endurance."""
    return (vehicle.longest_flight_s or math.inf) / (1.0 + vehicle.power.uncertainty_fraction)


class FlightEnergy:
    """Energies of a site's flights, each (w,) or (w, n) seconds of hovering in w winds.

    Args:
        site: the scenario on its ground.
        autopilot: who flies; the scenario's own by default.
    """

    def __init__(self, site: Site, autopilot: AutopilotName | None = None) -> None:
        wind = site.scenario.wind
        self._site = site
        self._power = power_of(site.scenario.vehicle, gust_m_s=wind.gust_m_s)
        self._pace, self.winds_m_s = pace_of(site, autopilot), winds_of(wind)

    def takeoff_s(self, height_m: float) -> FloatArray:
        """(w,) from the ground straight up to rest at a height."""
        return np.asarray(vertical_energies(self._power, self._pace, self.winds_m_s, float(height_m))[0])

    def landing_s(self, height_m: float) -> FloatArray:
        """(w,) from rest at a height straight down to the ground."""
        return np.asarray(vertical_energies(self._power, self._pace, self.winds_m_s, float(height_m))[1])

    def legs_and_turns_s(self, path_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(w, n - 1) hovering seconds of the legs of an (n, 3) path from rest to rest, and (w, n) of passing its waypoints."""
        legs, turns = path_energies(self._power, self._pace, self.winds_m_s, np.ascontiguousarray(path_m))
        return np.asarray(legs), np.asarray(turns)

    def path_s(self, path_m: FloatArray) -> FloatArray:
        """(w,) along an (n, 3) path, from rest to rest."""
        legs, turns = self.legs_and_turns_s(path_m)
        return np.asarray(legs.sum(axis=1) + turns.sum(axis=1))

    def first_legs_s(self, path_m: FloatArray, legs: int) -> FloatArray:
        """(w,) hovering seconds of the first ``legs`` legs of an (n, 3) path with all turns. Of its last legs if negative."""
        along, turns = self.legs_and_turns_s(path_m)
        return np.asarray((along[:, :legs] if legs > 0 else along[:, legs:]).sum(axis=1) + turns.sum(axis=1))

    def flights(
        self, route_m: FloatArray, there_s: FloatArray, back_s: FloatArray, alone_s: FloatArray
    ) -> FlightEnergies:
        """Energy of the flights along parts of an (n, 3) route.

        Args:
            route_m: the route.
            there_s: (w, n) from home on the ground to each waypoint, with the turn there.
            back_s: (w, n) from there to home, landed, with the turn there.
            alone_s: (w, n) of a flight to it alone.
        """
        vehicle = self._site.scenario.vehicle
        if vehicle.hover_s is None:
            return NO_ENERGIES
        legs, turns = self.legs_and_turns_s(route_m)
        return FlightEnergies(
            so_far_s=np.hstack([np.zeros((len(legs), 1)), np.cumsum(legs, axis=1)]),
            turns_s=np.cumsum(turns, axis=1),
            there_s=there_s,
            back_s=back_s,
            alone_s=alone_s,
            usable_s=usable_s(vehicle),
        )

    def straight_flights(self, cost: PathCost, route_m: FloatArray) -> FlightEnergies:
        """Energy of the flights along parts of an (n, 3) route with straight transits."""
        out, back = star_energies(self._power, self._pace, self.winds_m_s, cost.climb_out_top, route_m)
        up, down = vertical_energies(self._power, self._pace, self.winds_m_s, cost.climb_out_m)
        there, home = out + up[:, None], back + down[:, None]
        alone, n, top = there + home, len(route_m), np.array(cost.climb_out_top)
        tops = np.broadcast_to(top, (n, 3))
        if cost.stop_at_first == 0:
            alone += self._turns_s(tops, route_m, tops)
            there[:, :-1] += self._turns_s(tops[1:], route_m[:-1], route_m[1:])
        home[:, 1:] += self._turns_s(route_m[:-1], route_m[1:], tops[1:])
        return self.flights(route_m, there, home, alone)

    def _turns_s(self, before_m: FloatArray, at_m: FloatArray, after_m: FloatArray) -> FloatArray:
        """(w, k) of passing each of (k, 3) places between two others."""
        # One path through all of them: a turn depends on the places before and after it alone.
        path_m = np.stack([before_m, at_m, after_m], axis=1).reshape(-1, 3)
        return self.legs_and_turns_s(path_m)[1][:, 1::3]


def battery_used_s(energy: FlightEnergy, begin_s: FloatArray, path_m: FloatArray, home_m: FloatArray) -> float:
    """Seconds of hovering that a flight uses in the worst wind.

    Args:
        energy: of the site's flights.
        begin_s: (w,) of the take-off, or of what it begins with in the air.
        path_m: (n, 3) ENU from there to the top of the column above home.
        home_m: (3,) ENU, the ground at home.
    """
    return float((begin_s + energy.path_s(path_m) + energy.landing_s(path_m[-1, 2] - home_m[2])).max())


def longest_flight_text(vehicle: Vehicle) -> str:
    """The limit that a flight is held against, as messages tell it."""
    load = f" ({vehicle.hover_s:.0f} s with the payload)" if vehicle.hover_s and vehicle.power.payload_kg else ""
    return (
        f"vehicle.endurance_s is {vehicle.endurance_s or math.inf:g} s{load}, and vehicle.reserve_fraction = "
        f"{vehicle.reserve_fraction:g} allows flights of at most {vehicle.longest_flight_s or math.inf:.0f} s"
    )


def battery_text(site: Site, used_s: float) -> str:
    """Battery fraction that ``used_s`` seconds of hovering take, the wind, and the allowed fraction, as text."""
    vehicle, wind = site.scenario.vehicle, site.scenario.wind
    hover_s, strongest_m_s = vehicle.hover_s or math.inf, max(wind.speed_m_s, wind.most_m_s or 0.0)
    blows = f" in {strongest_m_s:g} m/s of wind" if strongest_m_s else ""
    blows += f" in gusts of {wind.gust_m_s:g} m/s" if wind.gust_m_s else ""
    return (
        f"{used_s / hover_s:.0%} of a battery{blows}; only {usable_s(vehicle) / hover_s:.0%} is usable "
        f"(vehicle.reserve_fraction = {vehicle.reserve_fraction:g}, vehicle.power.uncertainty_fraction = "
        f"{vehicle.power.uncertainty_fraction:g})"
    )


def check_reach(sites: Sequence[Site], coverage: CoverageMap, required: float | None) -> None:
    """Refuse an area of which no flights reach enough, before a route is searched for.

    Counted is the least that a flight to a cell takes: take-off, the straight line to where the sensor may see it and back at
    cruise speed, and landing.

    Args:
        sites: of the vehicles, each with its home.
        coverage: the cells to be seen, with those that can be.
        required: fraction of these; None: anything.

    Raises:
        InfeasibleError: fewer are within reach, or nothing can be seen from allowed heights at all.
    """
    site, coverable = sites[0], coverage.coverable
    weight_m2 = coverage.grid.weight_m2[coverable]
    if not weight_m2.size:
        wanted = site.scenario.requirements
        looks = "" if wanted.looks == 1 else f" {wanted.looks} times from positions {wanted.look_distance_m:g} m apart"
        keys = "" if wanted.looks == 1 else "requirements.looks, requirements.look_distance_m, "
        raise InfeasibleError(
            f"area: no part of the area can be observed{looks} from within the fence and the height band; check "
            f"{keys}sensor.range_m, the heights in [limits], and the no-fly zones"
        )
    if any(each.home_m is None or each.scenario.vehicle.longest_flight_s is None for each in sites):
        return
    centres_m = coverage.grid.cells.centre_m[coverable, :2]
    least_s, room_s = np.full(len(weight_m2), math.inf), np.full(len(weight_m2), -math.inf)
    for each in sites:
        vehicle, pace, home = each.scenario.vehicle, pace_of(each), each.home_m
        if home is None or vehicle.longest_flight_s is None:
            continue
        away_m = np.hypot(*(centres_m - home[:2]).T) - horizontal_reach(any_heading(coverage.sight))
        vertical_s = takeoff_time(pace, vehicle.takeoff_height_m) + landing_time(pace, vehicle.takeoff_height_m)
        seconds = vertical_s + 2.0 * np.maximum(away_m, 0.0) / vehicle.cruise_speed_m_s
        least_s = np.minimum(least_s, seconds)
        room_s = np.maximum(room_s, vehicle.longest_flight_s - seconds)
    fraction = float(weight_m2[room_s >= 0.0].sum() / weight_m2.sum())
    if fraction > 0.0 and fraction >= (required or 0.0):
        return
    raise InfeasibleError(
        f"flights from [home] reach only {fraction:.0%} of the visible ground, but {required or 1.0:.0%} is required: a "
        f"flight to the farthest cells takes at least {least_s.max():.0f} s, but "
        f"{longest_flight_text(site.scenario.vehicle)}; move [home] nearer, plan a smaller area, or require less "
        "coverage (--select)"
    )

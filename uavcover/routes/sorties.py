"""Splits a planned route into several flights so that the transits home are short in total, and times whole missions."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uavcover.errors import InfeasibleError
from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.kernels.flight_time import (
    Pace,
    flight_time,
    landing_time,
    leg_times,
    takeoff_time,
    turn_times,
)
from uavcover.kernels.way_cost import FlightCosts, FlightEnergies, battery_s, route_cost, split, straight_ends
from uavcover.model.route import Route
from uavcover.model.vehicle import AutopilotName
from uavcover.routes.energy import FlightEnergy, battery_in_words, battery_used_s, longest_flight_in_words, usable_s
from uavcover.routes.fleet_cuts import fleet_cuts
from uavcover.routes.mission_compiler import (
    AUTOPILOTS,
    CompiledMission,
    MissionTooLongError,
    compile_mission,
    items_per_waypoint,
)
from uavcover.routes.transit import check_way_home, check_way_there, transit
from uavcover.routes.way_cost import mission_cost_of, pace_of
from uavcover.scenario.site import Site
from uavcover.sensing.sensors import trigger_distance_m

_ROUNDS = 200
"""Number of new splits after the compiler has refused a flight of the previous one."""
_ROUNDS_BEFORE_TIGHTER = 60
"""Number of flights excluded one by one for being too long, before the room of every flight is reduced."""


@dataclass(frozen=True, slots=True, eq=False)
class Sortie:
    """One flight of a planned route.

    Attributes:
        first: number of its first waypoint in the whole route.
        last: number of its last waypoint; for sensing along the path, the next sortie begins there too.
        route: its waypoints.
        compiled: its mission, from take-off at home to landing there.
        vehicle: who flies it, from 1.
        start_s: its planned take-off, since the first take-off of all; none where there is no schedule.
    """

    first: int
    last: int
    route: Route
    compiled: CompiledMission
    vehicle: int = 1
    start_s: float | None = None


def compile_sorties(
    site: Site,
    route: Route,
    *,
    autopilot: AutopilotName,
    most_points: int | None = None,
    vehicles: int = 1,
    spacing_share: float = 1.0,
) -> tuple[Sortie, ...]:
    """Compile a route as one flight or, where endurance or item count require it, as several with transits of their own.

    The order of the waypoints is kept. Dynamic programming over all possible splits minimises the total flight time. For several
    vehicles the route is cut so that they are done soonest (``routes/fleet_cuts.py``).

    Args:
        site: the scenario on its ground.
        route: the planned route.
        autopilot: the autopilot whose limits apply.
        most_points: how many points of its path a flight may have, transits included; none: any number.
        vehicles: how many fly at the same time.
        spacing_share: share of the time between two landings at one home that is left between the starts of two vehicles; with
            less than 1 the flights are more even, and other pairs than neighbours must not land together.

    Raises:
        InputError: the scenario has no place on Earth or no home.
        InfeasibleError: a leg breaks a limit, or a part of the route cannot be reached inside the endurance (says which).
    """
    refusal = InfeasibleError("no cut keeps the limits")
    if vehicles == 1 or len(route) < 2:
        try:
            whole = _compile(site, route, autopilot=autopilot, most_points=most_points)
            return (Sortie(0, len(route) - 1, route, whole),)
        except MissionTooLongError as error:
            if len(route) < 2:
                raise
            refusal = error
    costs = _along_transits(site, route, autopilot, most_points)
    compiled: dict[tuple[int, int], CompiledMission] = {}
    all_checked = False
    for attempt in range(_ROUNDS):
        cuts = _cuts(costs, site, vehicles, spacing_share)
        if cuts is None:
            raise InfeasibleError(_why_not(site, costs, refusal)) from refusal
        for first, last in cuts:
            if (first, last) in compiled:
                continue
            part = Route(route.waypoints_m[first : last + 1])
            try:
                compiled[first, last] = _compile(site, part, autopilot=autopilot, most_points=most_points)
            except MissionTooLongError as error:
                # The compiler includes costs that the estimate does not.
                refusal, costs = error, _without(costs, first, last)
                if attempt >= _ROUNDS_BEFORE_TIGHTER:
                    costs = _tighter(costs)
                break
            except InfeasibleError as error:
                # A transit that breaks a limit bars only its own waypoint from beginning or ending a flight, and no
                # other. Transits are checked one by one, and only where it matters.
                refusal, costs = error, costs if all_checked else _checked(costs, site, route)
                all_checked = True
                costs = _without(costs, first, last)
                break
        else:
            return tuple(
                Sortie(first, last, Route(route.waypoints_m[first : last + 1]), compiled[first, last])
                for first, last in cuts
            )
    raise InfeasibleError(f"the route could not be split into flights: {refusal}") from refusal


def _compile(site: Site, route: Route, *, autopilot: AutopilotName, most_points: int | None) -> CompiledMission:
    compiled = compile_mission(site, route, autopilot=autopilot)
    if most_points is not None and len(compiled.path_m) > most_points:
        raise MissionTooLongError(
            f"the flight has {len(compiled.path_m)} points with the ways there and home, of which {most_points} are allowed"
        )
    return compiled


def _item_limit(site: Site, autopilot: AutopilotName) -> float:
    limits = (AUTOPILOTS[autopilot].item_limit, site.scenario.vehicle.max_mission_items)
    return min((float(limit) for limit in limits if limit is not None), default=math.inf)


def _limits(site: Site, autopilot: AutopilotName) -> tuple[float, float]:
    """Seconds and mission items of one flight."""
    return site.scenario.vehicle.longest_flight_s or math.inf, _item_limit(site, autopilot)


def _flight_costs(
    site: Site, points_m: FloatArray, pace: Pace, *, ends: tuple[FloatArray, ...], items: tuple[IntArray, IntArray],
    limits: tuple[float, float], energies: FlightEnergies,
) -> FlightCosts:  # fmt: skip
    """Costs of the flights of an (n, 3) route.

    Args:
        site: the scenario on its ground.
        points_m: the route.
        pace: of the vehicle.
        ends: (n,) seconds there, back, and of a flight to the waypoint alone.
        items: (n,) mission items before the waypoint, and behind it.
        limits: seconds and items of one flight.
        energies: of the flights.
    """
    there, back, alone = ends
    return FlightCosts(
        so_far_s=np.concatenate([[0.0], np.cumsum(leg_times(pace, points_m))]),
        turns_s=np.cumsum(turn_times(pace, points_m)),
        there_s=there,
        back_s=back,
        alone_s=alone,
        there_items=items[0],
        back_items=items[1],
        each_items=items_per_waypoint(site.scenario.sensor),
        shared=1 if site.scenario.sensor.sensing == "along-path" else 0,
        endurance_s=limits[0],
        item_limit=limits[1],
        barred=np.empty((0, 2), dtype=np.int64),
        energies=energies,
    )


def _along_transits(site: Site, route: Route, autopilot: AutopilotName, most_points: int | None) -> FlightCosts:
    """Costs of flights whose transits follow the terrain exactly as the compiler makes them."""
    home, vehicle = site.home_m, site.scenario.vehicle
    if home is None:
        raise InfeasibleError(f"scenario {site.scenario.name}: has no [home]")
    points, n, pace = route.waypoints_m, len(route), pace_of(site, autopilot)
    # The waypoint at which pictures begin stands twice in the mission and is a stop.
    stops = trigger_distance_m(site.scenario) is not None
    there, back, alone, items = np.empty(n), np.empty(n), np.empty(n), np.empty(n, dtype=np.int64)
    energy = FlightEnergy(site, autopilot)
    used_there, used_back, used_alone = np.empty((3, len(energy.winds_m_s), n))
    for k, point in enumerate(points):
        way = transit(site, home[:2], point, ground_end_height_m=vehicle.takeoff_height_m)
        # With the turn onto the leg behind it, and off the leg before it.
        onto, off = points[k + 1 : k + 1] if stops else points[k + 1 : k + 2], points[max(k - 1, 0) : k]
        there[k] = _there_s(pace, home, way, onto)
        back[k] = _back_s(pace, home, way, off)
        # A flight to this waypoint alone turns from the way there to the way home.
        round_m = np.vstack([way, way[-1:] if stops else way[:0], way[-2::-1]])
        column_m = way[0, 2] - home[2]
        alone[k] = takeoff_time(pace, column_m) + flight_time(pace, round_m) + landing_time(pace, column_m)
        items[k] = len(way) - 1
        up, down, legs = energy.takeoff_s(column_m), energy.landing_s(column_m), len(way) - 1
        used_there[:, k] = up + energy.first_legs_s(np.vstack([way, onto]), legs)
        used_back[:, k] = energy.first_legs_s(np.vstack([off, way[::-1]]), -legs) + down
        used_alone[:, k] = up + energy.path_s(round_m) + down
    # Home, take-off, speed and transit before the route; transit and landing after it.
    costs = _flight_costs(
        site, points, pace, ends=(there, back, alone), items=(items + 2, items + 1), limits=_limits(site, autopilot),
        energies=energy.flights(points, used_there, used_back, used_alone),
    )  # fmt: skip
    if most_points is None:
        return costs
    # Points are fewer than items: where items are the tighter limit, the compiler says so, and another split is tried.
    return costs._replace(there_items=items, back_items=items, each_items=1, item_limit=float(most_points))


def mission_time_s(site: Site, route: Route) -> float:
    """Seconds of the whole mission of a route, from the ground to the ground, of all flights that it takes.

    One flight is counted along its transits, as the compiler does. Several are split as :func:`compile_sorties` splits them, but
    with straight transits. Nothing is checked: a route that cannot be split or flown has the time of one flight.

    Args:
        site: the scenario on its ground, with a home.
        route: one waypoint at least.
    """
    home, vehicle = site.home_m, site.scenario.vehicle
    if home is None or len(route) == 0:
        raise InfeasibleError(f"scenario {site.scenario.name}: has no [home], or the route no waypoint")
    points, pace = route.waypoints_m, pace_of(site)
    stops = trigger_distance_m(site.scenario) is not None
    way, way_back = (
        transit(site, home[:2], point, ground_end_height_m=vehicle.takeoff_height_m) for point in points[[0, -1]]
    )
    whole_m = np.vstack([way, points[:1] if stops else points[:0], points[1:], way_back[-2::-1]])
    time_s = float(
        takeoff_time(pace, way[0, 2] - home[2])
        + flight_time(pace, whole_m)
        + landing_time(pace, way_back[0, 2] - home[2])
    )
    if not math.isfinite(time_s):
        # The ground between home and the route is not known all the way: the mission is refused when it is compiled.
        return float(route_cost(site.ground.surface, mission_cost_of(site), points))
    longest_s, most_items = limits = _limits(site, vehicle.autopilot)
    each = items_per_waypoint(site.scenario.sensor)
    one = len(way) + len(way_back) + each * len(route) + 1 <= most_items and time_s <= longest_s
    energy = FlightEnergy(site)
    if one and battery_used_s(energy, energy.takeoff_s(way[0, 2] - home[2]), whole_m, home) <= usable_s(vehicle):
        return time_s
    items = np.full(len(route), round(0.5 * (len(way) + len(way_back))) - 1, dtype=np.int64)
    costs = _flight_costs(
        site,
        points,
        pace,
        ends=straight_ends(mission_cost_of(site), points),
        items=(items + 2, items + 1),
        limits=limits,
        energies=energy.straight_flights(mission_cost_of(site), points),
    )
    split_s, _ = split(costs)
    return float(split_s) if math.isfinite(split_s) else time_s


def _there_s(pace: Pace, home_m: FloatArray, way_m: FloatArray, onto_m: FloatArray) -> float:
    """From home on the ground along a (k, 3) transit, with the turn onto what follows."""
    return float(takeoff_time(pace, way_m[0, 2] - home_m[2])) + _time_s(
        pace, np.vstack([way_m, onto_m]), legs=len(way_m) - 1
    )


def _back_s(pace: Pace, home_m: FloatArray, way_m: FloatArray, off_m: FloatArray) -> float:
    """Back along a (k, 3) transit to home on the ground, with the turn off what was before."""
    return float(landing_time(pace, way_m[0, 2] - home_m[2])) + _time_s(
        pace, np.vstack([off_m, way_m[::-1]]), legs=1 - len(way_m)
    )


def way_home(site: Site, place_m: FloatArray) -> tuple[FloatArray, float]:
    """The transit home from rest at a (3,) ENU place in flight.

    Returns:
        (k, 3) ENU from the place to the ground at home, and the seconds that it takes.

    Raises:
        InfeasibleError: the site has no home.
    """
    home = site.home_m
    if home is None:
        raise InfeasibleError(f"scenario {site.scenario.name}: has no [home]")
    way = transit(site, home[:2], place_m, ground_end_height_m=site.scenario.vehicle.takeoff_height_m)
    return np.vstack([way[::-1], home]), _back_s(pace_of(site), home, way, np.empty((0, 3)))


def _tighter(costs: FlightCosts) -> FlightCosts:
    """The same costs with slightly lower limits."""
    return costs._replace(
        endurance_s=0.998 * costs.endurance_s, item_limit=costs.item_limit - 2,
        energies=costs.energies._replace(usable_s=0.998 * costs.energies.usable_s),
    )  # fmt: skip


def _without(costs: FlightCosts, first: int, last: int) -> FlightCosts:
    """The same costs with one flight excluded."""
    return costs._replace(barred=np.vstack([costs.barred, [[first, last]]]))


def _checked(costs: FlightCosts, site: Site, route: Route) -> FlightCosts:
    """The same costs, excluding flights whose transit the compiler refuses."""
    home, height_m = site.home_m, site.scenario.vehicle.takeoff_height_m
    there, back = costs.there_s.copy(), costs.back_s.copy()
    if home is None:
        return costs
    for k, point in enumerate(route.waypoints_m):
        way = transit(site, home[:2], point, ground_end_height_m=height_m)
        try:
            check_way_there(site, way)
        except InfeasibleError:
            there[k] = math.inf
        try:
            check_way_home(site, way[::-1])
        except InfeasibleError:
            back[k] = math.inf
    return costs._replace(there_s=there, back_s=back)


def _cuts(costs: FlightCosts, site: Site, vehicles: int, spacing_share: float) -> Sequence[tuple[int, int]] | None:
    """First and last waypoint of each flight of the split that is done soonest; none when no split exists."""
    if vehicles > 1:
        return fleet_cuts(
            costs, vehicles=vehicles, turnaround_s=site.scenario.fleet.turnaround_s,
            spacing_s=spacing_share * _spacing_s(costs, site, vehicles),
        )  # fmt: skip
    total_s, begun = split(costs)
    if not math.isfinite(total_s):
        return None
    end = len(begun) - costs.shared
    cuts: list[tuple[int, int]] = []
    while end > 0:
        last = end - 1 + costs.shared
        cuts.append((int(begun[last]), last))
        end = int(begun[last])
    return cuts[::-1]


def _spacing_s(costs: FlightCosts, site: Site, vehicles: int) -> float:
    """About how long after each other vehicles land at one home: so that the second one comes late enough, the first one late."""
    fleet = site.scenario.fleet
    flight_s = min(costs.endurance_s, float(costs.so_far_s[-1]) / vehicles)
    column_s = float(landing_time(pace_of(site), site.scenario.vehicle.takeoff_height_m))
    return 2.0 * (fleet.timing_error_fraction * flight_s + fleet.start_error_s) + fleet.pad_s + column_s


def _why_not(site: Site, costs: FlightCosts, refusal: InfeasibleError) -> str:
    """Message naming the part of a route that no flight reaches, and by how much."""
    step = costs.shared
    n = len(costs.so_far_s)
    firsts = np.arange(n - step)
    least = (
        costs.there_s[firsts] + (costs.so_far_s[firsts + step] - costs.so_far_s[firsts]) + costs.back_s[firsts + step]
    )
    worst = int(np.argmax(np.where(np.isfinite(least), least, -math.inf)))
    if least[worst] > costs.endurance_s:
        what = f"the leg to waypoint {worst + 1}" if step else f"waypoint {worst}"
        return (
            f"{what}: flown alone it takes {least[worst]:.0f} s with the ways there and home, "
            f"{longest_flight_in_words(site.scenario.vehicle)}; move [home] nearer, or plan a smaller area"
        )
    used = np.array([battery_s(costs.energies, int(first), int(first) + step) for first in firsts])
    worst = int(np.argmax(used))
    if used[worst] > costs.energies.usable_s:
        what = f"the leg to waypoint {worst + 1}" if step else f"waypoint {worst}"
        return (
            f"{what}: flown alone it uses {battery_in_words(site, float(used[worst]))}; move [home] nearer, plan a smaller area, "
            "or fly in less wind"
        )
    items = costs.there_items[firsts] + costs.each_items * (step + 1) + costs.back_items[firsts + step]
    most = int(np.argmax(items))
    if items[most] > costs.item_limit:
        what = f"the leg to waypoint {most + 1}" if step else f"waypoint {most}"
        return f"{what}: a flight there and home has {items[most]} points or items, of which {costs.item_limit:g} are allowed"
    return f"the route cannot be split into flights: {refusal}"


def _time_s(pace: Pace, points_m: FloatArray, *, legs: int) -> float:
    """Flight time of the first ``legs`` legs of a line, or of the last ones when negative, including turns."""
    times = leg_times(pace, points_m)
    return float((times[:legs] if legs > 0 else times[legs:]).sum() + turn_times(pace, points_m).sum())

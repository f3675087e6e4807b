"""Splits a planned route into several flights so that the transits home are short in total."""

import math
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
from uavcover.model.route import Route
from uavcover.model.vehicle import AutopilotName
from uavcover.routes.mission_compiler import (
    AUTOPILOTS,
    CompiledMission,
    MissionTooLongError,
    compile_mission,
    items_per_waypoint,
)
from uavcover.routes.transit import check_way_home, check_way_there, transit
from uavcover.routes.way_cost import pace_of
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
    """

    first: int
    last: int
    route: Route
    compiled: CompiledMission


def compile_sorties(site: Site, route: Route, *, autopilot: AutopilotName) -> tuple[Sortie, ...]:
    """Compile a route as one flight or, where endurance or item count require it, as several with transits of their own.

    The order of the waypoints is kept. Dynamic programming over all possible splits minimises the total flight time.

    Args:
        site: the scenario on its ground.
        route: the planned route.
        autopilot: the autopilot whose limits apply.

    Raises:
        InputError: the scenario has no place on Earth or no home.
        InfeasibleError: a leg breaks a limit, or a part of the route cannot be reached inside the endurance (says which).
    """
    try:
        return (Sortie(0, len(route) - 1, route, compile_mission(site, route, autopilot=autopilot)),)
    except MissionTooLongError as error:
        if len(route) < 2:
            raise
        refusal: InfeasibleError = error
    ways = _Ways.of(site, route, item_limit=_item_limit(site, autopilot), autopilot=autopilot)
    compiled: dict[tuple[int, int], CompiledMission] = {}
    all_checked = False
    for attempt in range(_ROUNDS):
        cuts = _split(ways)
        if cuts is None:
            raise InfeasibleError(_why_not(site, ways, refusal)) from refusal
        for first, last in cuts:
            if (first, last) in compiled:
                continue
            part = Route(route.waypoints_m[first : last + 1])
            try:
                compiled[first, last] = compile_mission(site, part, autopilot=autopilot)
            except MissionTooLongError as error:
                # The compiler includes costs that the estimate does not.
                refusal, ways = error, ways.without(first, last)
                if attempt >= _ROUNDS_BEFORE_TIGHTER:
                    ways = ways.tighter()
                break
            except InfeasibleError as error:
                # A transit that breaks a limit bars only its own waypoint from beginning or ending a flight, and no
                # other. Transits are checked one by one, and only where it matters.
                refusal, ways = error, ways if all_checked else ways.checked(site, route)
                all_checked = True
                ways = ways.without(first, last)
                break
        else:
            return tuple(
                Sortie(first, last, Route(route.waypoints_m[first : last + 1]), compiled[first, last])
                for first, last in cuts
            )
    raise InfeasibleError(f"the route could not be split into flights: {refusal}") from refusal


def _item_limit(site: Site, autopilot: AutopilotName) -> float:
    limits = (AUTOPILOTS[autopilot].item_limit, site.scenario.vehicle.max_mission_items)
    return min((float(limit) for limit in limits if limit is not None), default=math.inf)


@dataclass(frozen=True, slots=True, eq=False)
class _Ways:
    """Cost of a flight that begins or ends at each of (n,) waypoints.

    Attributes:
        so_far_s: (n,) flight time from the first waypoint, without turns.
        turns_s: (n,) of all turns up to and at the waypoint.
        there_s: (n,) from home on the ground; infinite where no flight may begin.
        back_s: (n,) to home, landed; infinite where no flight may end.
        alone_s: (n,) of a flight to this waypoint only.
        there_items: (n,) mission items before the waypoint, home among them.
        back_items: (n,) behind it.
        each_items: of every waypoint.
        shared: 1 when a flight begins at the last waypoint of the previous one, 0 when at the next waypoint.
        endurance_s: of one flight.
        item_limit: of one mission.
        barred: first and last waypoints of flights that the compiler has refused.
    """

    so_far_s: FloatArray
    turns_s: FloatArray
    there_s: FloatArray
    back_s: FloatArray
    alone_s: FloatArray
    there_items: IntArray
    back_items: IntArray
    each_items: int
    shared: int
    endurance_s: float
    item_limit: float
    barred: frozenset[tuple[int, int]] = frozenset()

    @classmethod
    def of(cls, site: Site, route: Route, *, item_limit: float, autopilot: AutopilotName) -> "_Ways":
        """The costs of a route; transits follow the terrain exactly as the compiler makes them."""
        home, vehicle = site.home_m, site.scenario.vehicle
        if home is None:
            raise InfeasibleError(f"scenario {site.scenario.name}: has no [home]")
        points, n, pace = route.waypoints_m, len(route), pace_of(site, autopilot)
        # The waypoint at which pictures begin stands twice in the mission and is a stop.
        stops = trigger_distance_m(site.scenario) is not None
        there, back, alone, items = np.empty(n), np.empty(n), np.empty(n), np.empty(n, dtype=np.int64)
        for k, point in enumerate(points):
            way = transit(site, home[:2], point, ground_end_height_m=vehicle.takeoff_height_m)
            # With the turn onto the leg behind it, and off the leg before it.
            onto = points[k + 1 : k + 1] if stops else points[k + 1 : k + 2]
            there[k] = takeoff_time(pace, way[0, 2] - home[2]) + _time_s(
                pace, np.vstack([way, onto]), legs=len(way) - 1
            )
            back[k] = landing_time(pace, way[0, 2] - home[2]) + _time_s(
                pace, np.vstack([points[max(k - 1, 0) : k], way[::-1]]), legs=1 - len(way)
            )
            # A flight to this waypoint alone turns from the way there to the way home.
            round_m = np.vstack([way, way[-1:] if stops else way[:0], way[-2::-1]])
            column_m = way[0, 2] - home[2]
            alone[k] = takeoff_time(pace, column_m) + flight_time(pace, round_m) + landing_time(pace, column_m)
            items[k] = len(way) - 1
        so_far = np.concatenate([[0.0], np.cumsum(leg_times(pace, points))])
        return cls(
            so_far_s=so_far,
            turns_s=np.cumsum(turn_times(pace, points)),
            there_s=there,
            back_s=back,
            alone_s=alone,
            # Home, take-off, speed and transit before the route; transit and landing after it.
            there_items=items + 2,
            back_items=items + 1,
            each_items=items_per_waypoint(site.scenario.sensor),
            shared=1 if site.scenario.sensor.sensing == "along-path" else 0,
            endurance_s=vehicle.endurance_s or math.inf,
            item_limit=item_limit,
        )

    def tighter(self) -> "_Ways":
        """The same costs with slightly lower limits."""
        return self._with(endurance_s=0.998 * self.endurance_s, item_limit=self.item_limit - 2)

    def without(self, first: int, last: int) -> "_Ways":
        """The same costs with one flight excluded."""
        return self._with(barred=self.barred | {(first, last)})

    def checked(self, site: Site, route: Route) -> "_Ways":
        """The same costs, excluding flights whose transit the compiler refuses."""
        home, height_m = site.home_m, site.scenario.vehicle.takeoff_height_m
        there, back = self.there_s.copy(), self.back_s.copy()
        if home is None:
            return self
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
        return self._with(there_s=there, back_s=back)

    def _with(self, **changes: object) -> "_Ways":
        values = {name: getattr(self, name) for name in self.__slots__}
        return _Ways(**{**values, **changes})


def _split(ways: _Ways) -> list[tuple[int, int]] | None:
    """First and last waypoint of each flight of the split with the least total flight time; none when no split exists.

    cost(j), of all up to waypoint j, is the least of cost(i) + flight(i .. j) over the places i where that flight can begin.
    """
    n = len(ways.so_far_s)
    # cost[i] of all before a flight that begins at waypoint i.
    cost = np.full(n + 1, math.inf)
    cost[0] = 0.0
    begun = np.zeros(n, dtype=np.int64)
    barred: dict[int, list[int]] = {}
    for first, last in ways.barred:
        barred.setdefault(last, []).append(first)
    for last in range(ways.shared, n):
        starts = np.arange(0, last + 1 - ways.shared)
        turns_s = np.where(starts < last, ways.turns_s[max(last - 1, 0)] - ways.turns_s[starts], 0.0)
        route_s = ways.so_far_s[last] - ways.so_far_s[starts] + turns_s
        flight = ways.there_s[starts] + route_s + ways.back_s[last]
        alone = (starts == last) & np.isfinite(flight)
        flight[alone] = ways.alone_s[last]
        flight[barred.get(last, [])] = math.inf
        items = ways.there_items[starts] + ways.each_items * (last - starts + 1) + ways.back_items[last]
        possible = np.isfinite(flight) & (flight <= ways.endurance_s) & (items <= ways.item_limit)
        total = np.where(possible, cost[starts] + flight, math.inf)
        best = int(np.argmin(total))
        begun[last] = best
        cost[last + 1 - ways.shared] = total[best]
    end = n - ways.shared
    if not math.isfinite(cost[end]):
        return None
    cuts: list[tuple[int, int]] = []
    while end > 0:
        last = end - 1 + ways.shared
        cuts.append((int(begun[last]), last))
        end = int(begun[last])
    return cuts[::-1]


def _why_not(site: Site, ways: _Ways, refusal: InfeasibleError) -> str:
    """Message naming the part of a route that no flight reaches, and by how much."""
    step = ways.shared
    n = len(ways.so_far_s)
    firsts = np.arange(n - step)
    least = ways.there_s[firsts] + (ways.so_far_s[firsts + step] - ways.so_far_s[firsts]) + ways.back_s[firsts + step]
    worst = int(np.argmax(np.where(np.isfinite(least), least, -math.inf)))
    if least[worst] > ways.endurance_s:
        what = f"the leg to waypoint {worst + 1}" if step else f"waypoint {worst}"
        return (
            f"{what}: flown alone it takes {least[worst]:.0f} s with the ways there and home, vehicle.endurance_s is "
            f"{site.scenario.vehicle.endurance_s or math.inf:.0f} s; move [home] nearer, or plan a smaller area"
        )
    return f"the route cannot be split into flights: {refusal}"


def _time_s(pace: Pace, points_m: FloatArray, *, legs: int) -> float:
    """Flight time of the first ``legs`` legs of a line, or of the last ones when negative, including turns."""
    times = leg_times(pace, points_m)
    return float((times[:legs] if legs > 0 else times[legs:]).sum() + turn_times(pace, points_m).sum())

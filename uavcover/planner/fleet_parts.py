"""Plans of vehicles with their own parts of the area. Each part is searched separately; the routes form one plan."""

import bisect
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely

from uavcover.errors import ScenarioError
from uavcover.kernels.arrays import BoolArray
from uavcover.missions.objectives import judge_route
from uavcover.model.route import PART_OF, Plan, Route, RouteMember
from uavcover.planner.baselines.boustrophedon import TUNED
from uavcover.planner.division import FlightWork, divide, flight_work
from uavcover.planner.front import pareto_members
from uavcover.planner.selection_rule import parse_rule, select
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import Piece, groups_of, own_parts, vehicle_sites
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.site_maps import finer_map, map_for

SearchPart = Callable[[Site, float, str], Plan]
"""Searches on a site whose area is one part, with a fraction of the effort, by a rule."""

_ROUNDS = (0.2, 0.3, 0.5)
"""Fractions of the search, for one division after the other where the planner divides."""
_MOST_ORDERS = 24
"""This number of orders of groups is tried, for parts near their homes."""
_MOST_MEMBERS = 60
"""This number of combinations of the parts' routes is judged, evenly spread over their coverages."""
_SOONEST = 4
"""Combinations of the parts' routes that are compiled and scheduled: those with the shortest longest flights."""
_OVERFIT = 0.0004
"""Fraction of the required coverage that may be missing on finer cells, as in the selection (``selection_rule.py``)."""


def part_sites(site: Site, paces: Sequence[float] | None = None) -> tuple[Site, ...]:
    """For each group of vehicles that share a part: the site of its first vehicle, with that part as the area.

    Groups without a part divide the rest of the area.

    Args:
        site: the scenario on its ground.
        paces: ground that each group observes per time, in any unit; default: sensor width times cruise speed, of all its
            vehicles.

    Raises:
        ScenarioError: the parts do not fit, or the rest is too small for the groups that divide it.
    """
    shared, sites, groups = own_parts(site), vehicle_sites(site), groups_of(site.scenario)
    firsts = [sites[group[0] - 1] for group in groups]
    speeds = first_paces(site) if paces is None else list(paces)
    others = [k for k, group in enumerate(groups) if group[0] not in shared.of_vehicle]
    areas: dict[int, Piece] = {
        k: shared.of_vehicle[group[0]] for k, group in enumerate(groups) if group[0] in shared.of_vehicle
    }
    if shared.rest is not None:
        areas |= dict(zip(others, _allocated(shared.rest, [(firsts[k], speeds[k]) for k in others]), strict=True))
    return tuple(replace(own, area=areas[k]) for k, own in enumerate(firsts))


def first_paces(site: Site) -> list[float]:
    """Estimated square metres per second that the vehicles of each group observe, without turns and transit."""
    sites = vehicle_sites(site)
    return [
        sum(flight_work(sites[k - 1]).swath_m * sites[k - 1].scenario.vehicle.cruise_speed_m_s for k in group)
        for group in groups_of(site.scenario)
    ]


def _allocated(rest: Piece, groups: Sequence[tuple[Site, float]]) -> list[Piece]:
    """An area divided in proportion to the paces of groups, each part near its home if possible.

    Args:
        rest: the area to divide.
        groups: the site of the first vehicle of each group, and its pace.
    """
    if len(groups) == 1:
        return [rest]
    work = FlightWork(swath_m=min(flight_work(own).swath_m for own, _ in groups))
    best: tuple[float, list[Piece]] | None = None
    for order in itertools.islice(itertools.permutations(range(len(groups))), _MOST_ORDERS):
        pieces = divide(rest, len(groups), work, [groups[k][1] for k in order])
        if len(pieces) < len(groups):
            raise ScenarioError(
                f"area: cannot divide the remaining area among {len(groups)} sensors; assign areas to the vehicles, "
                "or remove vehicles"
            )
        of_group = dict(zip(order, pieces, strict=True))
        away_m = sum(_away_m(own, of_group[k]) for k, (own, _) in enumerate(groups))
        if best is None or away_m < best[0] - 1e-6:
            best = away_m, [of_group[k] for k in range(len(groups))]
    return [] if best is None else best[1]


def _away_m(own: Site, piece: Piece) -> float:
    """Distance from home to the middle of a piece."""
    if own.home_m is None:
        return 0.0
    return float(shapely.distance(shapely.Point(own.home_m[:2]), piece.centroid))


def plan_parts(site: Site, *, select_rule: str, search: SearchPart) -> Plan:
    """Plan the routes of vehicles that have parts of the area.

    Args:
        site: the scenario on its ground, at least one vehicle has a part.
        select_rule: see :mod:`uavcover.planner.selection_rule`; it chooses in every part and among the combinations.
        search: of each part.

    Raises:
        ScenarioError: the parts do not fit.
        InfeasibleError: no route of a part keeps the limits.
    """
    plans, evaluations = _best_division(site, search, _rule_of_part(select_rule))
    required = parse_rule(select_rule).required_coverage
    # Their total cost does not determine when the last vehicle lands.
    soonest = [] if required is None else Soonest(site, plans, required).combinations()
    return plan_of_parts(site, plans, select_rule=select_rule, evaluations=evaluations, soonest=soonest)


def _rule_of_part(select_rule: str) -> str:
    """The rule for one part. It cannot name a member of the whole set."""
    return "knee" if parse_rule(select_rule).kind == "index" else select_rule


def plan_of_parts(
    site: Site,  # the scenario on its ground, with vehicles that have parts
    plans: Sequence[Plan],  # of each part
    *,
    select_rule: str,  # chooses among the combinations
    evaluations: int,  # of all searches
    soonest: Sequence[Sequence[RouteMember]],  # combinations of routes that must be members
) -> Plan:
    """The plan of all parts together, from the plan of each."""
    rule, of_part = parse_rule(select_rule), _rule_of_part(select_rule)
    margin_m = site.scenario.limits.height_margin_m

    def together(members: Sequence[RouteMember]) -> RouteMember:
        origins = dict.fromkeys(member.origin.removeprefix(PART_OF) for member in members)
        mark = PART_OF if any(member.is_part for member in members) else ""
        route = Route.of_parts([member.route for member in members])
        return judge_route(site, route, mark + " + ".join(origins), margin_m=margin_m)

    combined = _combinations([plan.members for plan in plans])
    members = pareto_members([together(each) for each in [[plan.chosen for plan in plans], *combined]])
    choice = select(members, rule)
    members += [together(each) for each in soonest]
    baselines = []
    for name in ("boustrophedon", TUNED):
        of_parts = [[each for each in plan.baselines if each.origin == name] for plan in plans]
        if all(of_parts):
            baselines.append(together([each[select(each, parse_rule(of_part)).index] for each in of_parts]))
    return Plan(
        chosen=members[choice.index], members=tuple(members), baselines=tuple(baselines), rule=rule.text,
        rule_met=choice.met, algorithm=plans[0].algorithm, evaluations=evaluations,
        wall_s=sum(plan.wall_s for plan in plans), interrupted=any(plan.interrupted for plan in plans),
    )  # fmt: skip


def _best_division(site: Site, search: SearchPart, rule: str) -> tuple[list[Plan], int]:
    """Plans of the parts, and all evaluations; if the planner divides, those of the division that ends first.

    The first division uses width and speed; the next ones use the resulting times.
    """
    groups = groups_of(site.scenario)
    divided = [k for k, group in enumerate(groups) if site.scenario.vehicles[group[0] - 1].area is None]
    paces = first_paces(site)
    best: tuple[float, list[Plan]] | None = None
    evaluations = 0
    for effort in _ROUNDS if len(divided) > 1 else (1.0,):
        sites = part_sites(site, paces)
        whole_m2 = sum(own.area.area for own in sites)
        plans = [search(own, effort * own.area.area / whole_m2, rule) for own in sites]
        evaluations += sum(plan.evaluations for plan in plans)
        times_s = [plan.chosen.metrics.time_s / len(group) for plan, group in zip(plans, groups, strict=True)]
        done_s = max(times_s[k] for k in divided) if divided else 0.0
        if best is None or done_s < best[0]:
            best = done_s, plans
        for k in divided:
            paces[k] = sites[k].area.area / max(times_s[k], 1.0)
        if any(plan.interrupted for plan in plans):
            break
    return ([] if best is None else best[1]), evaluations


@dataclass(slots=True, eq=False)
class Soonest:
    """Combinations of part routes with the required coverage and the shortest longest flight.

    A part may have less than the required coverage if others have more, or observe ground beyond their borders.
    """

    site: Site  # the scenario on its ground, with vehicles that have parts
    plans: Sequence[Plan]  # of the parts
    required: float  # coverage of all together
    _options: list[list[RouteMember]] = field(init=False)
    _times_s: list[list[float]] = field(init=False)
    _maps: list[tuple[float, list[CoverageMap]]] = field(init=False)
    _observed: dict[tuple[int, int, int], BoolArray] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        sites, sensor = vehicle_sites(self.site), self.site.scenario.sensor
        firsts = [sites[group[0] - 1] for group in groups_of(self.site.scenario)]
        self._maps = [(self.required, [map_for(self.site, own) for own in firsts])]
        finer = finer_map(self.site)
        if finer is not None and all(own.scenario.sensor == sensor for own in firsts):
            self._maps.append((self.required - _OVERFIT, [finer.flown_from(own) for own in firsts]))
        self._options = [_most_for_time(plan.members) for plan in self.plans]
        self._times_s = [[member.metrics.time_s for member in options] for options in self._options]

    def combinations(self) -> list[list[RouteMember]]:
        """A few combinations, the soonest first; empty where none has the coverage."""
        times_s = sorted({time_s for times_s in self._times_s for time_s in times_s})
        least = bisect.bisect_left(times_s, True, key=lambda time_s: self._covers(self._within(time_s)))
        found: dict[tuple[int, ...], list[RouteMember]] = {}
        for time_s in times_s[least:]:
            chosen = self._thrifty(self._within(time_s))
            found.setdefault(tuple(chosen), self._members(chosen))
            if len(found) == _SOONEST:
                break
        return list(found.values())

    def spare(self, longest_s: float) -> float:
        """Coverage beyond the required one, if each part flies its best route within this time."""
        chosen, maps = self._within(longest_s), self._maps[0][1]
        if min(chosen) < 0:
            return 0.0
        observed = np.logical_or.reduce([self._observed_by(0, part, option) for part, option in enumerate(chosen)])
        return max(0.0, maps[0].fraction_of_coverable(observed) - self.required)

    def beside(self, members: Sequence[RouteMember], longest_s: float) -> list[list[RouteMember]]:
        """Combinations with another route of one part and, if that costs coverage, a better route of another part.

        Args:
            members: a combination.
            longest_s: upper limit of the time of the other routes.
        """
        now = [options.index(member) for options, member in zip(self._options, members, strict=True)]
        found: dict[tuple[int, ...], None] = {}
        for part, option in itertools.product(range(len(now)), range(max(map(len, self._options)))):
            if option >= len(self._options[part]) or option == now[part] or self._times_s[part][option] >= longest_s:
                continue
            changed = [*now[:part], option, *now[part + 1 :]]
            if self._covers(changed):
                found[tuple(changed)] = None
                continue
            for other in set(range(len(now))) - {part}:
                within = bisect.bisect_left(self._times_s[other], longest_s)
                raised = ([*changed[:other], more, *changed[other + 1 :]] for more in range(now[other] + 1, within))
                enough = next((each for each in raised if self._covers(each)), None)
                if enough is not None:
                    found[tuple(enough)] = None
        return [self._members(each) for each in found]

    def _members(self, chosen: Sequence[int]) -> list[RouteMember]:
        return [options[k] for options, k in zip(self._options, chosen, strict=True)]

    def _within(self, time_s: float) -> list[int]:
        """For each part, the option with most coverage within this time; -1 without one."""
        return [bisect.bisect_right(times_s, time_s) - 1 for times_s in self._times_s]

    def _thrifty(self, chosen: list[int]) -> list[int]:
        """Options that take less time, part by part, while the total coverage suffices."""
        for part in range(len(chosen)):
            while chosen[part] > 0 and self._covers(less := [*chosen[:part], chosen[part] - 1, *chosen[part + 1 :]]):
                chosen = less
        return chosen

    def _covers(self, chosen: Sequence[int]) -> bool:
        if min(chosen) < 0:
            return False
        for scale, (least, maps) in enumerate(self._maps):
            observed = np.logical_or.reduce(
                [self._observed_by(scale, part, option) for part, option in enumerate(chosen)]
            )
            if maps[0].fraction_of_coverable(observed) < least:
                return False
        return True

    def _observed_by(self, scale: int, part: int, option: int) -> BoolArray:
        key = (scale, part, option)
        if key not in self._observed:
            self._observed[key] = self._maps[scale][1][part].observed(self._options[part][option].route.waypoints_m)
        return self._observed[key]


def _most_for_time(members: Sequence[RouteMember]) -> list[RouteMember]:
    """The members, by time, that have more coverage than all faster ones."""
    kept: list[RouteMember] = []
    for member in sorted(members, key=lambda m: (m.metrics.time_s, -m.metrics.coverage_of_coverable)):
        if member.violation <= 0.0 and (
            not kept or member.metrics.coverage_of_coverable > kept[-1].metrics.coverage_of_coverable
        ):
            kept.append(member)
    return kept


def _combinations(sets: Sequence[Sequence[RouteMember]]) -> list[list[RouteMember]]:
    """Routes of the parts that each have a required coverage, for all coverages that may be required.

    Args:
        sets: of each part, by coverage.
    """
    required = sorted({member.metrics.coverage_of_coverable for members in sets for member in members})
    step = max(1, -(-len(required) // _MOST_MEMBERS))
    found: dict[tuple[int, ...], list[RouteMember]] = {}
    for fraction in required[::-step][::-1]:
        chosen = []
        for members in sets:
            enough = [member for member in members if member.metrics.coverage_of_coverable >= fraction]
            chosen.append(min(enough, key=lambda member: member.metrics.cost) if enough else members[-1])
        found.setdefault(tuple(map(id, chosen)), chosen)
    return list(found.values())

"""Selection of one route from a Pareto set by a named rule, with conditions on its missions.

For several vehicles, the choice depends on sorties, vehicles and makespan of the routes after splitting and allocation. A rule
may limit them.
"""

import dataclasses
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from uavcover.errors import InputError
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.dominance import least_crowded, non_dominated_mask
from uavcover.missions.flights import mission_size
from uavcover.model.route import MissionSize, Plan, Route, RouteMember
from uavcover.model.vehicle import AutopilotName
from uavcover.planner.budget import CommandTime
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import before_pads, on_pads

PAPER_WEIGHTS = (0.6, 0.2, 0.2)

_WEIGHTED = re.compile(r"weighted(?::(?P<weights>[^:]+))?")
_COVERAGE = re.compile(r"coverage\s*>=\s*(?P<share>[0-9.eE+-]+)")
_INDEX = re.compile(r"index:(?P<index>\d+)")
_CONDITION = re.compile(r",?\s*(?P<what>[a-z-]+)\s*<=\s*(?P<limit>[^,<>]*)$")
_SECONDS = {"s": 1.0, "m": 60.0, "h": 3600.0}


@dataclass(frozen=True, slots=True)
class Choice:
    """The chosen member."""

    index: int  # its number in the set
    met: bool  # whether the rule is met; False if the required coverage is out of reach


@dataclass(frozen=True, slots=True)
class Condition:
    """Limit on the mission of a route: ``sorties<=N``, ``vehicles<=N`` or ``done<=TIME``."""

    what: str  # sorties, vehicles or done (from the first take-off to the last landing)
    most: float  # a number, or seconds

    def excess(self, size: MissionSize | None) -> float:
        """Excess of a mission over its limit, as a fraction of it; infinite without a mission."""
        if size is None:
            return math.inf
        value = {"sorties": size.sorties, "vehicles": size.vehicles, "done": size.makespan_s}[self.what]
        return max(0.0, value / self.most - 1.0)


@dataclass(frozen=True, slots=True)
class Rule:
    """A parsed rule: ``weighted[:w1,w2,w3]``, ``knee``, ``max-coverage``, ``coverage>=X`` or ``index:N``, and conditions."""

    text: str  # as written
    kind: str  # the word before the parameters
    numbers: tuple[float, ...] = ()  # the parameters
    conditions: tuple[Condition, ...] = ()  # on the missions of the route; known after it is split into sorties

    @property
    def required_coverage(self) -> float | None:
        """The required coverage of the visible ground, if the rule has one."""
        return self.numbers[0] if self.kind == "coverage" else None


def parse_rule(text: str) -> Rule:
    """Parse a selection rule, such as ``coverage>=0.98,sorties<=3,done<=40m``; conditions alone imply ``max-coverage``.

    Raises:
        InputError: it is not a rule, or its numbers are out of range.
    """
    rest, conditions = text.strip(), list[Condition]()
    while match := _CONDITION.search(rest):
        conditions.insert(0, _condition(match["what"], match["limit"].strip(), text))
        rest = rest[: match.start()].rstrip()
    if not conditions:
        return _parse_choice(rest)
    names = [condition.what for condition in conditions]
    if len(set(names)) < len(names):
        raise InputError(f"select: {text!r} has two conditions of the same kind; keep only the stricter one")
    choice = _parse_choice(rest or "max-coverage")
    if choice.kind == "index":
        raise InputError(f"select: {text!r} selects a single route; remove the conditions")
    return replace(choice, text=text.strip(), conditions=tuple(conditions))


def _condition(what: str, limit: str, text: str) -> Condition:
    if what not in {"sorties", "vehicles", "done"}:
        raise InputError(f"select: {text!r}: unknown condition {what!r}; use sorties<=N, vehicles<=N or done<=TIME")
    number, unit = (limit[:-1], limit[-1]) if what == "done" and limit[-1:] in _SECONDS else (limit, "s")
    try:
        most = float(number) * _SECONDS[unit]
    except ValueError:
        most = -1.0
    if not 0.0 < most < math.inf or (what != "done" and not most.is_integer()):
        example = "a time such as 40m, 1200s or 1.5h" if what == "done" else "a whole number of at least 1"
        raise InputError(f"select: {text!r}: {what}<= requires {example}")
    return Condition(what, most)


def _parse_choice(text: str) -> Rule:
    """A rule without its conditions."""
    rule = text.strip()
    if rule in {"knee", "max-coverage"}:
        return Rule(rule, rule)
    if match := _WEIGHTED.fullmatch(rule):
        try:
            weights = tuple(float(w) for w in match["weights"].split(",")) if match["weights"] else PAPER_WEIGHTS
        except ValueError:
            weights = ()
        if len(weights) != 3 or min(weights, default=-1.0) < 0.0 or not 0.0 < sum(weights) < np.inf:
            raise InputError(f"select: {text!r} requires three weights of at least 0, such as weighted:0.6,0.2,0.2")
        return Rule(rule, "weighted", weights)
    if match := _COVERAGE.fullmatch(rule):
        try:
            fraction = float(match["share"])
        except ValueError:
            fraction = -1.0
        if not 0.0 <= fraction <= 1.0:
            raise InputError(f"select: {text!r} requires a fraction between 0 and 1, such as coverage>=0.95")
        return Rule(rule, "coverage", (fraction,))
    if match := _INDEX.fullmatch(rule):
        return Rule(rule, "index", (float(match["index"]),))
    raise InputError(
        f"select: unknown rule {text!r}; use weighted[:w1,w2,w3], knee, max-coverage, coverage>=X or index:N, "
        "followed by conditions (,sorties<=N ,vehicles<=N ,done<=TIME)"
    )


def select(members: Sequence[RouteMember], rule: Rule) -> Choice:
    """Choose by a rule; ties go to the lower number.

    - ``weighted``: smallest weighted sum of the objectives, each scaled to 0..1 over the set (the paper's section 5.3).
    - ``knee``: nearest to the ideal point after the same scaling. It considers only whole routes, because their parts lie on a
      straight line to the origin and would make a half-covered route the knee.
    - ``max-coverage``: most coverage, then least cost.
    - ``coverage>=X``: least cost (by default: the shortest) with this coverage of the visible ground; without one, as
      ``max-coverage`` and not met. The same applies to an ``index`` outside the set.

    Conditions are ignored; use :func:`select_flown` for them.

    Raises:
        InputError: an empty set.
    """
    return _select(members, rule, [member.metrics.cost for member in members])


def select_flown(members: Sequence[RouteMember], rule: Rule, *, soonest: bool) -> Choice:
    """Choose by a rule with its conditions among members whose missions are known.

    Only members that keep all conditions are considered; without any, the one that exceeds them least, and not met.

    Args:
        members: one without a mission keeps no condition.
        rule: as for :func:`select`.
        soonest: whether the cost of a route is the finish of all vehicles.

    Raises:
        InputError: an empty set.
    """
    excess = [math.fsum(each.excess(member.mission) for each in rule.conditions) for member in members]
    fewest = min(excess, default=0.0)
    kept = [k for k, more in enumerate(excess) if more <= fewest]
    cost = [members[k].metrics.cost for k in kept]
    if soonest:
        sizes = [members[k].mission for k in kept]
        cost = [math.inf if size is None else size.makespan_s for size in sizes]
    choice = _select([members[k] for k in kept], rule, cost)
    return Choice(kept[choice.index], met=choice.met and fewest == 0.0)


def _select(members: Sequence[RouteMember], rule: Rule, costs: Sequence[float]) -> Choice:
    if not members:
        raise InputError("select: the Pareto set is empty")
    coverage = np.array([member.metrics.coverage_of_coverable for member in members])
    cost = np.array(costs)
    if rule.kind == "index":
        index = int(rule.numbers[0])
        if index < len(members):
            return Choice(index, met=True)
    if rule.kind == "coverage":
        enough = np.flatnonzero(coverage >= rule.numbers[0])
        if enough.size:
            return Choice(int(enough[np.lexsort((-coverage[enough], cost[enough]))[0]]), met=True)
    if rule.kind in {"coverage", "max-coverage", "index"}:
        return Choice(int(np.lexsort((cost, -coverage))[0]), met=rule.kind == "max-coverage")
    whole = [k for k, member in enumerate(members) if not member.is_part] or list(range(len(members)))
    scaled = _scaled([members[k] for k in whole])
    worth = scaled @ np.array(rule.numbers) if rule.kind == "weighted" else (scaled**2).sum(axis=1)
    return Choice(whole[int(np.argmin(worth))], met=True)


def missing_index(rule: Rule, members: int) -> str | None:
    """Text for a rule that names a number outside the set of members; None for any other rule."""
    if rule.kind != "index" or rule.numbers[0] < members:
        return None
    return f"{rule.text} does not exist; the set has the members 0 to {members - 1}"


_OVERFIT = 0.0015
_OVERFIT_OF_GOAL = 0.0004
"""Tolerance of coverage on other cells, and of a required coverage, as a fraction: cells are a sample."""

_OVERFIT_CELLS = 2.0
"""Number of cells that do not matter in a small sample."""

_MOST_TRIES = 40


def without_overfitted(
    members: Sequence[RouteMember], rule: Rule, elsewhere: Callable[[Route], float], *, cells: int
) -> list[RouteMember]:
    """The members without overfitted choices of the rule, whose coverage is lower on other cells.

    Among many routes that barely reach a coverage, the cheapest probably profits from its cells. Only choices of the rule are
    checked, until one is confirmed; otherwise the one with the smallest shortfall stays.

    Args:
        members: feasible; at least one.
        rule: selects one of the members that no other dominates.
        elsewhere: fraction of the visible ground that a route observes on other cells.
        cells: number of cells on which the members were evaluated.
    """
    few = _OVERFIT_CELLS / cells
    left, overfitted, met_before = list(members), list[tuple[float, RouteMember]](), False
    while left and len(overfitted) < _MOST_TRIES:
        values = np.array([[-m.metrics.coverage_of_coverable, m.metrics.waypoint_count, m.metrics.cost] for m in left])
        front = [left[k] for k in np.flatnonzero(non_dominated_mask(values, np.zeros(len(left))))]
        choice = select(front, rule)
        chosen = front[choice.index]
        met_before = choice.met if not overfitted else met_before
        if rule.kind == "index" or (met_before and not choice.met):
            break
        observed, required = chosen.metrics.coverage_of_coverable, rule.required_coverage
        least = observed - max(_OVERFIT, few)
        if required is not None and choice.met:
            least = max(required - max(_OVERFIT_OF_GOAL, few), least - _OVERFIT)
        lacking = least - elsewhere(chosen.route)
        if lacking <= 0.0:
            return left
        overfitted.append((lacking, chosen))
        left = [member for member in left if member is not chosen]
    # None is confirmed: keep the best of the checked ones, and all that the rule ranks after it.
    best = min(overfitted, key=lambda each: each[0])[1] if overfitted else None
    return [member for member in members if member is best or all(member is not each for _, each in overfitted)]


def _scaled(members: Sequence[RouteMember]) -> FloatArray:
    """(n, 3) objectives, all minimised, scaled to 0..1 over the set; 0 for a set without spread."""
    values = np.array([[-m.metrics.coverage_of_coverable, m.metrics.waypoint_count, m.metrics.cost] for m in members])
    spread = np.ptp(values, axis=0)
    return np.asarray((values - values.min(axis=0)) / np.where(spread > 0.0, spread, 1.0))


_MOST_S = 4.0
"""Longest estimated processor time to split all members of a set into flights."""

_MOST_COUNTS = 6
"""Largest number of vehicle counts that are compared."""


def with_sizes(
    site: Site,  # the scenario on its ground
    plan: Plan,  # from the search
    *,
    autopilot: AutopilotName | None = None,  # for whom; default: the scenario's
    vehicles: int | None = None,  # how many may fly, where they are identical; default: the scenario's
    limit: CommandTime | None = None,  # time of the command; None: no limit
) -> Plan:
    """A plan whose members have mission sizes: all, or if that is slow, the chosen one and the least crowded ones.

    This may change the choice: with several vehicles, the cheapest route is the one that ends first, and conditions of the rule
    refer to missions. All possible choices are split into flights if there is time.
    """
    rule = parse_rule(plan.rule)
    if site.frame is None or site.home_m is None:
        if rule.conditions:
            raise InputError(
                f"select: {plan.rule!r} has conditions on missions, but {site.scenario.name} has no position on "
                "Earth or no [home]; remove the conditions"
            )
        return plan
    count = site.scenario.fleet.vehicles if vehicles is None else vehicles
    before = next(k for k, member in enumerate(plan.members) if member is plan.chosen)
    in_question = _in_question(plan.members, rule, count)
    limit = limit or CommandTime(begun_s=0.0)
    begun_s = limit.now()
    members = list(plan.members)

    def size(number: int) -> None:
        member = members[number]
        if member.violation <= 0.0 and member.mission is None:
            sized = mission_size(site, member.route, autopilot=autopilot, vehicles=count)
            members[number] = dataclasses.replace(member, mission=sized)

    size(before)
    each_s = (limit.now() - begun_s) / max(_seconds(members[before], count), 1e-9)
    for number in (*in_question, *_worth_sizing(plan.members, before, count, limit.left_s() / max(each_s, 1e-9))):
        if limit.left_s() <= 0.0:
            break
        size(number)
    in_question = [number for number in in_question if number == before or members[number].mission is not None]
    chosen, rule_met = before, plan.rule_met
    if in_question:
        candidates = sorted({before, *in_question})
        choice = select_flown([members[k] for k in candidates], rule, soonest=count > 1)
        chosen, rule_met = candidates[choice.index], rule_met and choice.met
    others = _by_vehicles(site, members[chosen], autopilot, count) if limit.left_s() > 0.0 else ()
    return dataclasses.replace(
        plan, members=tuple(members), chosen=members[chosen], rule_met=rule_met, by_vehicles=others
    )


def _in_question(members: Sequence[RouteMember], rule: Rule, vehicles: int) -> list[int]:
    """Numbers of the members that may be chosen because of their missions; empty if missions do not matter."""
    feasible = [k for k, member in enumerate(members) if member.violation <= 0.0]
    if rule.conditions:
        return feasible
    least = rule.required_coverage
    if vehicles == 1 or least is None:
        return []
    return [k for k in feasible if members[k].metrics.coverage_of_coverable >= least]


def _by_vehicles(
    site: Site, chosen: RouteMember, autopilot: AutopilotName | None, most: int
) -> tuple[MissionSize, ...]:
    """Mission size of the chosen route with one vehicle, two and so on. Empty where there is one, or they differ."""
    alike = before_pads(site) if site.scenario.vehicles else site
    if most == 1 or alike is None or chosen.mission is None:
        return ()
    counts = np.unique(np.linspace(1, most, min(most, _MOST_COUNTS)).round().astype(int)).tolist()
    if sum(_seconds(chosen, count) for count in counts) > _MOST_S:
        counts = [1, most]
    route = Route(chosen.route.waypoints_m)  # fewer vehicles fly all parts of it
    sites = [alike.flown_by(count) for count in counts[:-1]]
    if alike is not site:
        sites = [on_pads(own) for own in sites]
    fewer = [mission_size(own, route, autopilot=autopilot) for own in sites]
    return tuple(size for size in dict.fromkeys((*fewer, chosen.mission)) if size is not None)


def _worth_sizing(members: Sequence[RouteMember], chosen: int, vehicles: int, most_s: float) -> list[int]:
    """Members besides the chosen one to split into flights; the least crowded ones if there is no time for all."""
    new = [k for k, member in enumerate(members) if member.mission is None and k != chosen]
    most_s = min(most_s, _MOST_S)
    whole_s = sum(_seconds(members[k], vehicles) for k in new)
    if whole_s <= most_s:
        return new
    metrics = [members[k].metrics for k in new]
    values = np.array([[-m.coverage_of_coverable, m.waypoint_count, m.cost] for m in metrics])
    return [new[k] for k in least_crowded(values, max(1, int(len(new) * most_s / whole_s)))]


def _seconds(member: RouteMember, vehicles: int) -> float:
    """Approximate time to find the flights of a route."""
    n = len(member.route)
    if vehicles == 1:
        return 0.003 + 0.0008 * n
    cuts = 1.5 if vehicles == 2 else 2.0  # for fewer vehicles too, until those are later
    return cuts * (0.01 + 0.002 * n + 1e-5 * n**2)

"""Plans of vehicles that each see a part of the area: every part is searched by itself, and their routes are one plan."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from uavcover.model.route import PART_OF, Plan, Route, RouteMember
from uavcover.planning.baselines.boustrophedon import TUNED
from uavcover.planning.front import pareto_members
from uavcover.planning.selection import parse_rule, select
from uavcover.routes.part_routes import judge_route
from uavcover.scenario.site import Site
from uavcover.scenario.vehicle_parts import Piece, groups_of, own_parts
from uavcover.scenario.vehicle_site import vehicle_sites

SearchPart = Callable[[Site, float, str], Plan]
"""Searches on a site whose area is one part, with a share of the effort, by a rule."""

_MOST_MEMBERS = 60
"""So many combinations of the parts' routes are judged, evenly spread over their coverages."""


def part_sites(site: Site) -> tuple[Site, ...]:
    """For each group of vehicles that see a part together: the site of its first vehicle with that part as its area.

    Raises:
        ScenarioError: the parts do not fit.
    """
    shared, sites = own_parts(site), vehicle_sites(site)
    areas: list[Piece] = []
    for group in groups_of(site.scenario):
        area = shared.of_vehicle.get(group[0], shared.rest)
        if area is not None:
            areas.append(area)
    firsts = [sites[group[0] - 1] for group in groups_of(site.scenario)]
    return tuple(replace(own, area=area) for own, area in zip(firsts, areas, strict=True))


def plan_parts(site: Site, *, select_rule: str, search: SearchPart) -> Plan:
    """Plan the routes of vehicles that have parts of the area.

    Args:
        site: the scenario on its ground, with vehicles of whom one at least has a part.
        select_rule: see :mod:`uavcover.planning.selection`; it chooses in every part, and among what the parts are together.
        search: of each part.

    Raises:
        ScenarioError: the parts do not fit.
        InfeasibleError: no route of a part keeps the limits.
    """
    rule = parse_rule(select_rule)
    sites = part_sites(site)
    whole_m2 = sum(own.area.area for own in sites)
    # A member of the whole set cannot be named in a part.
    of_part = "knee" if rule.kind == "index" else select_rule
    plans = [search(own, own.area.area / whole_m2, of_part) for own in sites]
    margin_m = site.scenario.limits.height_margin_m

    def together(members: Sequence[RouteMember]) -> RouteMember:
        origins = dict.fromkeys(member.origin.removeprefix(PART_OF) for member in members)
        mark = PART_OF if any(member.is_part for member in members) else ""
        route = Route.of_parts([member.route for member in members])
        return judge_route(site, route, mark + " + ".join(origins), margin_m=margin_m)

    combined = _combinations([plan.members for plan in plans])
    members = pareto_members([together(each) for each in [[plan.chosen for plan in plans], *combined]])
    choice = select(members, rule)
    baselines = []
    for name in ("boustrophedon", TUNED):
        of_parts = [[each for each in plan.baselines if each.origin == name] for plan in plans]
        if all(of_parts):
            baselines.append(together([each[select(each, parse_rule(of_part)).index] for each in of_parts]))
    return Plan(
        chosen=members[choice.index], members=tuple(members), baselines=tuple(baselines), rule=rule.text,
        rule_met=choice.met, algorithm=plans[0].algorithm, evaluations=sum(plan.evaluations for plan in plans),
        wall_s=sum(plan.wall_s for plan in plans), interrupted=any(plan.interrupted for plan in plans),
    )  # fmt: skip


def _combinations(sets: Sequence[Sequence[RouteMember]]) -> list[list[RouteMember]]:
    """A route of each part, so that each part sees at least as much as is asked, for all that may be asked.

    Args:
        sets: of each part, by coverage.
    """
    asked = sorted({member.metrics.coverage_of_coverable for members in sets for member in members})
    step = max(1, -(-len(asked) // _MOST_MEMBERS))
    found: dict[tuple[int, ...], list[RouteMember]] = {}
    for share in asked[::-step][::-1]:
        chosen = []
        for members in sets:
            enough = [member for member in members if member.metrics.coverage_of_coverable >= share]
            chosen.append(min(enough, key=lambda member: member.metrics.cost) if enough else members[-1])
        found.setdefault(tuple(map(id, chosen)), chosen)
    return list(found.values())

"""Sorties, vehicles and makespan of a plan's routes, split into flights and allocated as they would be flown.

They have a say in the choice: several vehicles are to be done soon, and a rule may limit them.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from uavcover.errors import InputError
from uavcover.kernels.dominance import least_crowded
from uavcover.missions.flights import mission_size
from uavcover.model.route import MissionSize, Plan, Route, RouteMember
from uavcover.model.vehicle import AutopilotName
from uavcover.planner.budget import CommandTime
from uavcover.planner.selection_rule import Rule, parse_rule, select_flown
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import before_pads, on_pads

_MOST_S = 4.0
"""Processor time for all members of a set, as estimated from their waypoints and vehicles: more is too long beside the search."""

_MOST_COUNTS = 6
"""This number of vehicle counts is compared at most."""


def with_sizes(
    site: Site,  # the scenario on its ground
    plan: Plan,  # as it was found
    *,
    autopilot: AutopilotName | None = None,  # for whom; default: the scenario's
    vehicles: int | None = None,  # how many may fly, where they are alike; default: the scenario's
    limit: CommandTime | None = None,  # time of the command; none: as long as it takes
) -> Plan:
    """A plan whose members have mission sizes: all, or where that takes long the chosen and the least crowded.

    Another member may be chosen then: where several vehicles fly, the one with which they are done soonest is the cheapest, and
    conditions of the rule are of missions. All members that this may concern are cut into flights, as far as there is time.
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
    """Numbers of the members that may be chosen for what their missions come to; none where that has no say."""
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
    """Mission size of the chosen route with one vehicle, two and so on. None where there is one, or they differ."""
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
    """Members beside the chosen one that are split into flights, the least crowded where there is no time for all."""
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
    cuts = 1.5 if vehicles == 2 else 2.0  # for fewer vehicles too, until that is later
    return cuts * (0.01 + 0.002 * n + 1e-5 * n**2)

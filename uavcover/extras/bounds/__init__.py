"""Proved bounds on any plan: fewest waypoints, shortest path, most coverage.

In: a site on its ground and a plan. Out: for each question the proved limit and the best value found
(docs/explanation/bounds.md). Begin with ``proved``, the prover of the group ``uavcover.bounds``; ``bounds.py`` has the proofs.
"""

from typing import Any

from uavcover.extras.bounds.bounds import are_quick, least_path_length_m, path_bounds, waypoint_bounds
from uavcover.extras.bounds.programs import SolverEffort
from uavcover.model.route import Plan
from uavcover.planner.selection_rule import parse_rule
from uavcover.run.documents import bound_document
from uavcover.scenario.site import Site
from uavcover.sensing.site_maps import fleet_map, judging_map


def least_length_m(site: Site, rule: str) -> float | None:
    """Lower bound on path length for the required coverage; None where none applies.

    Args:
        site: the scenario on its ground.
        rule: see :mod:`uavcover.planner.selection_rule`; there is a bound when it names a coverage, for a sensor that observes
            along the path and an objective that is a length.

    Raises:
        InputError: the rule cannot be understood.
    """
    fraction = parse_rule(rule).required_coverage
    sensor = site.scenario.sensor
    in_metres = site.scenario.objective == "length" and sensor.looks_along_path and not sensor.has_own_view
    return least_path_length_m(judging_map(site), fraction) if in_metres and fraction is not None else None


def proved(site: Site, result: Plan, *, time_s: float | None) -> dict[str, Any]:
    """Proved limits with what a plan has, by question: as ``bounds`` of ``plan.json`` has them; empty for a view of its own.

    Args:
        site: the scenario on its ground.
        result: the plan.
        time_s: for prices on the ground, or for branch and bound, half of it for each question; 0: proofs that take no solver
            alone; None: linear relaxations too, where they are quick.
    """
    coverage = fleet_map(site)
    if site.scenario.sensor.has_own_view:
        return {}
    found = path_bounds(coverage, result, time_s=time_s or 0.0)
    if time_s is not None and time_s > 0.0:
        found += waypoint_bounds(coverage, result, SolverEffort(time_s=0.5 * time_s))
    elif time_s is None and are_quick(coverage):
        found += waypoint_bounds(coverage, result, SolverEffort(nodes=0))
    return {bound.question: bound_document(bound) for bound in found}

"""The bounds that a plan is held against."""

from typing import Any

from uavcover.model.route import Plan
from uavcover.planning.baselines.boustrophedon import best_height_agl_m
from uavcover.planning.bounds import are_quick, least_path_length_m, path_bounds, waypoint_bounds
from uavcover.planning.selection_rule import parse_rule
from uavcover.planning.set_cover.solvers import SolverEffort
from uavcover.run.documents import bound_document
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import judging_map
from uavcover.sensing.fleet_map import fleet_map
from uavcover.sensing.sensors import reach_at_height_m


def least_length_m(site: Site, rule: str) -> float | None:
    """Lower bound on path length for the required coverage; None where none applies.

    Args:
        site: the scenario on its ground.
        rule: see :mod:`uavcover.planning.selection_rule`; there is a bound when it names a coverage, for a sensor that observes
            along the path and an objective that is a length.

    Raises:
        InputError: the rule cannot be understood.
    """
    share = parse_rule(rule).required_coverage
    in_metres = site.scenario.objective == "length" and site.scenario.sensor.sensing == "along-path"
    return least_path_length_m(judging_map(site), share) if in_metres and share is not None else None


def bounds(site: Site, result: Plan | None = None, *, time_s: float | None = None) -> dict[str, Any]:
    """Known bounds on any plan, and references to measure it by: ``bounds`` of ``plan.json``.

    ``coverable_fraction``: share of the area that some allowed place sees (tried places: at least this much).
    ``length_reference_m``: area of the map over the width of flat ground that the sensor sweeps; a reference, no bound,
    because slopes widen the swath. Only for sensors that look along the path.
    ``shortest_path_m``, ``fewest_waypoints``, ``most_coverage``: proved limits, and what was found (docs/explanation/bounds.md).

    Args:
        site: the scenario on its ground.
        result: a plan; without one there is nothing to compare with.
        time_s: for prices on the ground, or for branch and bound, half of it for each question; 0: proofs that take no solver
            alone; default: linear relaxations too, where they are quick.
    """
    coverage = fleet_map(site)
    found: dict[str, Any] = {"coverable_fraction": coverage.share(coverage.coverable)}
    if site.scenario.sensor.sensing == "along-path":
        width = 2.0 * reach_at_height_m(site.scenario.sensor, best_height_agl_m(site))
        found["length_reference_m"] = float(site.area.area) / width
    if result is None:
        return found
    proved = path_bounds(coverage, result, time_s=time_s or 0.0)
    if time_s is not None and time_s > 0.0:
        proved += waypoint_bounds(coverage, result, SolverEffort(time_s=0.5 * time_s))
    elif time_s is None and are_quick(coverage):
        proved += waypoint_bounds(coverage, result, SolverEffort(nodes=0))
    return found | {bound.question: bound_document(bound) for bound in proved}

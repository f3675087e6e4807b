"""The bounds that a plan is held against."""

from typing import Any

from uavcover.model.route import Plan
from uavcover.planner.baselines.boustrophedon import best_height_agl_m
from uavcover.plugins import loaded
from uavcover.scenario.site import Site
from uavcover.sensing.site_maps import fleet_map


def least_length_m(site: Site, rule: str) -> float | None:
    """The largest lower bound on path length for the coverage of a selection rule; none where none applies.

    Raises:
        InputError: the rule cannot be understood.
    """
    proved = [prover.least_length_m(site, rule) for prover in loaded("uavcover.bounds").values()]
    return max((length_m for length_m in proved if length_m is not None), default=None)


def bounds(site: Site, result: Plan | None = None, *, time_s: float | None = None) -> dict[str, Any]:
    """Known bounds on any plan, and references to measure it by: ``bounds`` of ``plan.json``.

    ``coverable_fraction``: share of the area that some allowed place sees (tried places: at least this much).
    ``length_reference_m``: area of the map over the width of flat ground that the sensor sweeps; a reference, no bound,
    because slopes widen the swath. Only for sensors that look along the path.
    ``shortest_path_m``, ``fewest_waypoints``, ``most_coverage``: what the installed provers prove, and what was found.

    Args:
        site: the scenario on its ground.
        result: a plan; without one nothing is proved.
        time_s: for the proofs; 0: those that take no solver; none: what is quick.
    """
    coverage = fleet_map(site)
    found: dict[str, Any] = {"coverable_fraction": coverage.share(coverage.coverable)}
    if site.scenario.sensor.looks_along_path:
        width = 2.0 * site.scenario.sensor.half_width_m(best_height_agl_m(site))
        found["length_reference_m"] = float(site.area.area) / width
    if result is not None:
        for prover in loaded("uavcover.bounds").values():
            found |= prover.proved(site, result, time_s=time_s)
    return found

"""Lines that a search begins with besides the baselines: balanced and simple ones, as many as there is time for."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor

import numpy as np

from uavcover.kernels.way_cost import LENGTH, route_cost
from uavcover.missions.way_cost import way_cost_of
from uavcover.model.route import Route
from uavcover.planner.baselines.adaptive_swaths import adaptive_swaths, ample_lines, can_be_adapted, simple_lines
from uavcover.planner.front import NamedRoute
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap


def first_lines(
    site: Site, angle_rad: float, executor: Executor | None, should_stop: Callable[[], bool]
) -> list[NamedRoute]:
    """Balanced and simple lines; what the search begins with best comes first, and the rest is left out when time is over."""

    def balanced() -> list[Route]:
        if not can_be_adapted(site):
            return []
        return adaptive_swaths(site, angle_rad, executor=executor, should_stop=should_stop)

    def simple() -> list[Route]:
        return simple_lines(site, angle_rad, executor=executor, should_stop=should_stop)

    makers = [("simple-lines", simple), ("balanced-lines", balanced)]
    kinds: list[tuple[str, list[Route]]] = []
    for kind, make in reversed(makers) if _by_length(site) else makers:
        if not any(routes for _, routes in kinds) or not should_stop():
            kinds.append((kind, make()))
    return [(_cheaper_way_round(site, route), kind) for kind, routes in kinds for route in routes]


def _by_length(site: Site) -> bool:
    """Whether balanced lines are worth more than simple ones.

    Balanced lines are the shortest, but they have a waypoint wherever the ground asks for one, and each costs time: on 25 km²
    simple ones take a third less of it.
    """
    return way_cost_of(site).unit == LENGTH


def any_reaches(coarse: CoverageMap, lines: Sequence[NamedRoute], asked: float | None) -> bool:
    """Whether one of the lines sees what is asked for; there is no need to where nothing is, or there are no lines."""
    if asked is None or not lines:
        return True
    return any(coarse.share_of_coverable(coarse.seen(route.waypoints_m)) >= asked for route, _ in lines)


def one_line_more(site: Site, angle_rad: float) -> list[NamedRoute]:
    """Under a time budget few numbers of lines are laid out: these see enough for nearly every coverage."""
    if not can_be_adapted(site):
        return []
    shortest = _by_length(site)
    kind = "balanced-lines" if shortest else "simple-lines"
    return [(_cheaper_way_round(site, route), kind) for route in ample_lines(site, angle_rad, shortest=shortest)]


def _cheaper_way_round(site: Site, route: Route) -> Route:
    """The route or its reverse, whichever costs less: in wind they differ, and no single move reverses a whole route."""
    way, surface = way_cost_of(site), site.ground.surface
    back = Route(np.ascontiguousarray(route.waypoints_m[::-1]))
    there_cost, back_cost = (float(route_cost(surface, way, each.waypoints_m)) for each in (route, back))
    # Where both ways are as good, rounding must not choose.
    return back if back_cost < there_cost * (1.0 - 1e-9) else route

"""Planning by parts: divide the area, search in every part, join the routes, search along the seams, judge the whole."""

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely

from uavcover.errors import InputError
from uavcover.extras.large_areas.part_search import Neighbour, PartTask, search_part
from uavcover.extras.large_areas.sortie_parts import SortiePart, may_have_sorties, sortie_parts
from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.kernels.path_cost import ENERGY, route_cost
from uavcover.kernels.sight import horizontal_reach
from uavcover.missions.leg_checks import measure_violations
from uavcover.missions.objectives import mission_cost
from uavcover.missions.path_cost import path_cost_of
from uavcover.model.route import Plan, Route
from uavcover.model.scenario import PlannerSettings
from uavcover.planner.baselines.adaptive_swaths import (
    TIGHT,
    BentLines,
    bend_lines,
    can_be_adapted,
    fly_tight,
    tight_layouts,
)
from uavcover.planner.baselines.boustrophedon import (
    BOUSTROPHEDON,
    Baseline,
    SwathLayout,
    fewest_lines,
    fly_layout,
    long_side_angle_rad,
    plain_boustrophedon,
    to_lines_frame,
)
from uavcover.planner.budget import FRACTIONS
from uavcover.planner.division import divide, flight_work
from uavcover.planner.final_choice import choose
from uavcover.planner.front import NamedRoute, judge_members
from uavcover.planner.search.optimizer_search import SearchProgress, SearchRun
from uavcover.planner.search.route_problem import with_safety
from uavcover.planner.search.tuning import TUNED
from uavcover.planner.selection_rule import parse_rule
from uavcover.planner.terrain_following import in_good_order, joined
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import Piece, polygons_of
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.site_maps import RunBlocks, judging_map, look_at_all, one_after_the_other, sampling_map

# Slices: parts that hold neighbouring lines of one route over the whole area, so that at first no seam costs anything.
#
# Parts with lines of their own turn or overlap along every seam, and the ways from one part to the next are flown
# besides. A slice has a few lines of a route that bends over the whole area; one behind the other the slices are that
# route.

_FRACTIONS = (1 / 32, *TIGHT)
"""Tolerances of legs to their height, as fractions of the band.

On 10,000 km² with relief of 900 m the least is best: 119 lines in 11,875 km, where 1/16 takes 121 in 12,075.
"""
_FEWEST_LINES = 2
"""Fewest lines of a slice, because the search moves its lines while those of other slices stay."""
_OVER_AREA = 0.8
"""Lines over the whole area cross what is between its parts; where they observe less of the area than so much of what they could,
parts with lines of their own are better."""


@dataclass(frozen=True, slots=True, eq=False)
class Slice:
    """A part with its lines."""

    area: Piece  # of the part
    begin_m: FloatArray  # (n, 3) ENU along its lines


def sliced(site: Site, coarse: CoverageMap, goal: float, count: int) -> list[Slice]:
    """Slices of lines along or across the long side, in the order of the route.

    Args:
        site: the scenario on its ground.
        coarse: cells to find out what the routes observe.
        goal: required fraction of the coverable ground.
        count: how many.

    Returns:
        ``count`` slices; empty where no lines keep the limits, or are enough for ``count``, or are over the area.
    """
    if not can_be_adapted(site):
        return []
    found = _best_lines(site, coarse, goal)
    if found is None:
        return []
    layout, bent = found
    long_m = bent.east_m - bent.west_m
    if len(long_m) < _FEWEST_LINES * count or site.area.area < _OVER_AREA * 2.0 * bent.reach_m * long_m.sum():
        return []
    cuts = _cuts(long_m, count)
    areas = _between_lines(site.area, layout.angle_rad, bent, cuts)
    if any(area.is_empty for area in areas):
        return []
    return [
        Slice(area, _fly(site, layout, bent, first, end))
        for area, first, end in zip(areas, cuts[:-1].tolist(), cuts[1:].tolist(), strict=True)
    ]


def _best_lines(site: Site, coarse: CoverageMap, goal: float) -> tuple[SwathLayout, BentLines] | None:
    """Feasible lines of least cost, with their missing coverage at its price; None if none is feasible."""
    along_rad = long_side_angle_rad(site.area)
    found: list[_Lines] = []
    for angle_rad, fraction in itertools.product((along_rad, along_rad + 0.5 * math.pi), _FRACTIONS):
        fitting = _lines(site, coarse, goal, tight_layouts(site, angle_rad, fraction=fraction, more=0))
        enough = max(each.observed for each in fitting) >= goal
        others = tight_layouts(site, angle_rad, fraction=fraction, more=-1 if enough else 1)
        found += fitting + _lines(site, coarse, goal, others)
    best = min(found, key=lambda each: each.merit)
    return None if math.isinf(best.merit) else (best.layout, best.bent)


class _Lines(NamedTuple):
    """Lines over the whole area, their coverage of the visible ground, and their cost; infinite outside limits."""

    layout: SwathLayout
    bent: BentLines
    observed: float
    merit: float


def _lines(site: Site, coarse: CoverageMap, goal: float, layouts: Sequence[SwathLayout]) -> list[_Lines]:
    """Lines of layouts that differ by their inset."""
    path_cost, surface, margin_m = path_cost_of(site), site.ground.surface, site.scenario.limits.height_margin_m
    bent = bend_lines(site, layouts[0])
    found = []
    for layout in layouts:
        route_m = fly_tight(site, layout, bent).waypoints_m
        observed = coarse.fraction_of_coverable(coarse.observed(route_m))
        merit = TUNED.goal.start_cost(float(route_cost(surface, path_cost, route_m)), observed, goal)
        broken = measure_violations(site, route_m, margin_m=margin_m).total > 0.0
        found.append(_Lines(layout, bent, observed, math.inf if broken else merit))
    return found


def _cuts(long_m: FloatArray, count: int) -> IntArray:
    """(count + 1,) numbers of the lines at which slices begin, and the end: equal metres in each, and enough lines.

    Args:
        long_m: (n,) of each line, in their order.
        count: of slices; n / _FEWEST_LINES at most.
    """
    so_far = np.concatenate([[0.0], np.cumsum(long_m)])
    cuts = np.searchsorted(so_far, so_far[-1] * np.arange(count + 1) / count - 1e-9 * so_far[-1])
    cuts[0], cuts[-1] = 0, len(long_m)
    for k in range(1, count):
        cuts[k] = max(cuts[k], cuts[k - 1] + _FEWEST_LINES)
    for k in range(count - 1, 0, -1):
        cuts[k] = min(cuts[k], cuts[k + 1] - _FEWEST_LINES)
    return np.asarray(cuts)


def _between_lines(area: Piece, angle_rad: float, bent: BentLines, cuts: IntArray) -> list[Piece]:
    """The area cut in the middle between the last line of a slice and the first one of the next."""
    corners = shapely.get_coordinates(area) @ to_lines_frame(angle_rad).T
    (west, south), (east, north) = corners.min(axis=0) - 1.0, corners.max(axis=0) + 1.0
    middles = bent.across_m.mean(axis=1)
    borders = [south, *(0.5 * (middles[cuts[1:-1] - 1] + middles[cuts[1:-1]])).tolist(), north]
    bands = [
        shapely.Polygon(np.array([(west, low), (east, low), (east, high), (west, high)]) @ to_lines_frame(angle_rad))
        for low, high in itertools.pairwise(borders)
    ]
    return [polygons_of(area.intersection(band)) for band in bands]


def _fly(site: Site, layout: SwathLayout, bent: BentLines, first: int, end: int) -> FloatArray:
    """(n, 3) along some of the lines, in the direction in which the whole route flies them."""
    own = dataclasses.replace(layout, start=layout.start ^ (first % 2))
    return fly_tight(site, own, bent.between(first, end)).waypoints_m


RunTasks = Callable[[Site, Sequence[PartTask]], Iterator[tuple[PartTask, FloatArray]]]
"""Search in parts of a site: each task with the waypoints of its route, in any order."""

_ROUNDS = FRACTIONS.part_rounds


_FLOWN = 0.98
"""The coverage that is searched for when the rule asks for none."""

_ONE_SEARCH_CELLS = 130_000
_PART_CELLS = 260_000
"""Above the first, "auto" divides the area, and gives no part more cells than the second. Few large parts were best, by
``scripts/bench/large.py`` (docs/results/large.md): many seams cost more than they save."""

_MOST_COMPARED_CELLS = 300_000
"""For a larger area the tuned boustrophedon is found on this number of larger cells: no worker shares that work."""

_WORTH = 0.99
"""A flight for each part is worth it where they begin with so much of what the tuned boustrophedon costs: a search in few large
parts ends with 0.88 of it on 25 km², 0.92 on 49 and 0.92 on 100 km², and one in flights with 0.91 of what they begin with."""

_LARGEST_CORRECTION = 0.01


def part_count(site: Site) -> int:
    """Number of parts for "auto", by the number of cells; 1 where the area is small."""
    cells = site.area.area / site.scenario.area.cell_size_m**2
    return 1 if cells <= _ONE_SEARCH_CELLS else max(2, math.ceil(cells / _PART_CELLS))


def most_parts(site: Site) -> int:
    """Largest number of parts: none is smaller than the sensor's footprint."""
    return max(1, int(site.area.area / flight_work(site).swath_m ** 2))


def require_parts(settings: PlannerSettings, site: Site) -> None:
    """Refuse what parts cannot be planned for. Raises InputError: says what, and what to do."""
    what = None
    if settings.encoding != "swaths" or not site.scenario.sensor.looks_along_path:
        what = 'a sensor with sensing = "along-path" and encoding = "swaths"'
    elif settings.algorithm not in ("memetic", "local-search"):
        what = 'algorithm = "memetic" or "local-search"'
    elif settings.max_waypoints is not None:
        what = "no max_waypoints"
    if what is not None:
        raise InputError(f"planner.parts: more than one part requires {what}; remove this key, or set it to 1")


def plan_by_parts(
    site: Site,  # the scenario on its ground
    *,
    parts: int,  # how many, 2 at least
    settings: PlannerSettings,  # of the search
    select_rule: str,  # see :mod:`uavcover.planner.selection_rule`
    # evaluations of all parts together, or a time budget; the executor for whole routes, and the progress callback
    run: SearchRun,
    run_tasks: RunTasks,  # who searches in the parts
    run_blocks: RunBlocks = one_after_the_other,  # who judges a large area, block by block
    workers: int = 1,  # how many search at the same time: what a time budget is shared by
    # whether parts may be a flight each instead, as many as there are or more, where that is worth it
    or_sorties: bool = False,
) -> Plan:
    """Plan the sensing route of a large site by parts.

    The plan depends on the seed, the evaluations and the number of parts, and not on who searches in which part, or when.

    Raises:
        InfeasibleError: the joined route exceeds a limit; says which.
        InputError: the rule cannot be understood, or the scenario cannot be planned by parts.
    """
    require_parts(settings, site)
    effort, executor = run.effort, run.executor
    rule = parse_rule(select_rule)
    goal = _FLOWN if rule.required_coverage is None else rule.required_coverage
    most = most_parts(site)
    if parts > most:
        raise InputError(
            f"planner.parts: {parts} parts of {site.area.area / 1e6:.3g} km² are smaller than the sensor's "
            f"footprint; use at most {most}, or auto"
        )
    fine = judging_map(site)
    areas, routes, comparison = _divided(site, parts, goal, executor, or_sorties=or_sorties)
    found: list[Route] = []
    aim = goal
    observed = 0.0
    # two further rounds, as long as the last one, while the joined route lacks the required coverage
    for number, fraction in enumerate((*_ROUNDS, *_ROUNDS[-1:] * 2)):
        if found and (run.should_stop() or (number >= len(_ROUNDS) and observed >= goal)):
            break
        budget_s = (
            None if effort.budget_s is None else FRACTIONS.parts * fraction * effort.budget_s * workers / len(areas)
        )
        evaluations = max(1, int(fraction * effort.evaluations / len(areas)))
        tasks = tasks_of(
            site, areas, routes, aim, round_number=number, seed=settings.seed, evaluations=evaluations,
            budget_s=budget_s,
        )  # fmt: skip
        know_each_other = routes is not None
        done_m: dict[int, FloatArray] = {}
        for task, route_m in run_tasks(site, tasks):
            done_m[task.number] = route_m
            searched = sum(_ROUNDS[:number]) + sum(_ROUNDS[number : number + 1]) * len(done_m) / len(tasks)
            done = min(effort.evaluations, round(searched * effort.evaluations))
            run.on_progress(SearchProgress(done, effort.evaluations, observed, None))
        routes = [done_m[task.number] for task in tasks]
        steepest_deg = site.scenario.limits.max_climb_angle_deg
        whole = Route(joined(site, in_good_order(routes, site.home_m, max_climb_angle_deg=steepest_deg)))
        found.append(whole)
        look_at_all(fine, [whole.waypoints_m], run_blocks)
        observed = fine.fraction_of_coverable(fine.observed(whole.waypoints_m))
        if know_each_other:  # before that, what they observe twice is no sign
            missing = with_safety(goal) - observed
            aim = min(1.0, aim + float(np.clip(missing, -_LARGEST_CORRECTION, _LARGEST_CORRECTION)))
        done = min(effort.evaluations, round(sum(_ROUNDS[: number + 1]) * effort.evaluations))
        run.on_progress(SearchProgress(done, effort.evaluations, observed, None))
    interrupted = len(found) < len(_ROUNDS) or run.should_stop()
    baselines = comparison()
    look_at_all(fine, [route.waypoints_m for route, _ in baselines], run_blocks)
    reference = judge_members(fine, baselines, executor)
    members = judge_members(fine, [(route, "parts") for route in found], executor)
    chosen = choose(
        fine, settings, rule, (*members, *reference), executor=executor, interrupted=interrupted, is_over=None
    )
    return Plan(
        chosen=chosen.route,
        members=chosen.pareto,
        baselines=tuple(reference),
        rule=rule.text,
        rule_met=chosen.rule_met,
        algorithm=settings.algorithm,
        evaluations=effort.evaluations,
        wall_s=effort.now() - run.started,
        interrupted=interrupted,
    )


def search_parts_with(
    executor: Executor | None, *, now: Callable[[], float], should_stop: Callable[[], bool]
) -> RunTasks:
    """Search in the parts by threads of this process, or one after the other."""

    def run(site: Site, tasks: Sequence[PartTask]) -> Iterator[tuple[PartTask, FloatArray]]:
        def one(task: PartTask) -> tuple[PartTask, FloatArray]:
            return task, search_part(site, task, now=now, should_stop=should_stop).waypoints_m

        if executor is None:
            yield from map(one, tasks)
        else:
            for future in as_completed([executor.submit(one, task) for task in tasks]):
                yield future.result()

    return run


def tasks_of(
    site: Site,  # the scenario on its ground
    areas: Sequence[Piece],  # the parts
    # their routes so far, each (n, 3) ENU; None before the first round where each is to have lines of its own
    routes: Sequence[FloatArray] | None,
    goal: float,  # fraction of the coverable ground
    *,
    # from 0; in odd ones the lower number of two neighbours keeps what both observe, in even ones the higher
    round_number: int,
    seed: int,  # of the whole search
    evaluations: int,  # of each part
    budget_s: float | None,  # of each part, instead
) -> list[PartTask]:
    """The tasks of a round, one for each part."""
    tasks = [
        PartTask(number, round_number, shapely.to_wkb(area), goal, seed, evaluations, budget_s)
        for number, area in enumerate(areas)
    ]
    if routes is None:
        return tasks
    reach_m = horizontal_reach(site.scenario.sensor.sight) + site.scenario.area.cell_size_m
    paths = [shapely.LineString(route[:, :2]) for route in routes]
    tree = shapely.STRtree([path.buffer(reach_m) for path in paths])
    with_routes = []
    for task, area, route, path in zip(tasks, areas, routes, paths, strict=True):
        # Who observes some of what this part is asked about: its own ground, and what its route observes.
        near = tree.query(shapely.union(area, path.buffer(reach_m)), predicate="intersects")
        neighbours = tuple(
            Neighbour(routes[k], first=(k < task.number) == (round_number % 2 == 1))
            for k in sorted(near.tolist())
            if k != task.number
        )
        with_routes.append(dataclasses.replace(task, route_m=route, neighbours=neighbours))
    return with_routes


def _divided(
    site: Site, parts: int, goal: float, executor: Executor | None, *, or_sorties: bool
) -> tuple[list[Piece], list[FloatArray] | None, Callable[[], list[NamedRoute]]]:
    """The parts, with what each begins with where that is known already; and the baselines, when somebody asks for them."""
    coarse = sampling_map(site, most_cells=_MOST_COMPARED_CELLS)
    known: list[NamedRoute] | None = None
    begun: Sequence[SortiePart | Slice] = []
    if or_sorties and may_have_sorties(site):
        known, flights = _baselines(coarse, goal), sortie_parts(site, coarse, goal)
        together = math.fsum(flight.cost for flight in flights)
        if len(flights) >= parts and together < _WORTH * _least_cost(site, known):
            begun = flights
    begun = begun or sliced(site, coarse, goal, parts)

    def compared() -> list[NamedRoute]:
        # On a map of its own: the one that slices were found on would be kept until the end of the search.
        return _baselines(sampling_map(site, most_cells=_MOST_COMPARED_CELLS), goal) if known is None else known

    # Lines over a large area take as long as the search in a part, which others may do meanwhile.
    later = compared if executor is None else executor.submit(compared).result
    areas = [each.area for each in begun] or divide(site.area, parts, flight_work(site))
    return areas, [each.begin_m for each in begun] or None, later


def _baselines(coarse: CoverageMap, goal: float) -> list[NamedRoute]:
    """The plain boustrophedon, and of each kind the best of those with the fewest lines along the long side."""
    site = coarse.site
    plain = fly_layout(site, plain_boustrophedon(site))
    fraction = goal * coarse.fraction(coarse.coverable)

    def merit(tuned: Baseline) -> tuple[float, float, float]:
        return tuned.violation, max(0.0, fraction + float(tuned.objectives[0])), float(tuned.objectives[2])

    best = {each.name: each for each in sorted(fewest_lines(coarse, fraction, turns=1), key=merit, reverse=True)}
    return [(plain, BOUSTROPHEDON), *((each.route, name) for name, each in best.items())]


def _least_cost(site: Site, routes: Sequence[NamedRoute]) -> float:
    """The least cost of missions that fly one of the routes, each in as many flights as it takes."""
    costs = [mission_cost(site, route) for route, _ in routes]
    return min(cost.energy_hover_s if path_cost_of(site).unit == ENERGY else cost.time_s for cost in costs)

"""Search by an optimizer, which proposes genes and receives the values of the decoded routes.

Encodings: the paper's free waypoints with activation genes, for sensors that observe from waypoints; and swath layouts, with
genes relative to a known good layout.
"""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np

from uavcover.errors import InputError
from uavcover.kernels import route as kernels
from uavcover.kernels.arrays import FloatArray, read_only
from uavcover.missions.objectives import evaluate_routes
from uavcover.model.route import Route
from uavcover.optimizers.ask_tell import AskAndTell
from uavcover.planner.baselines.boustrophedon import SwathLayout, fly_layout
from uavcover.planner.terrain_following import allowed_band_m, finite_heights, lay_over_terrain
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap

_TIMED_ROUTES = 8
_SHORTEST_EVALUATION_S = 1e-5


class Encoding(Protocol):
    """Maps genes to routes."""

    lower: FloatArray  # (d,) lower bounds
    upper: FloatArray  # (d,) upper bounds

    def decode(self, genes: FloatArray) -> Route:
        """The route of a (d,) vector of genes."""
        ...


@dataclass(frozen=True, slots=True)
class SearchProgress:
    """Progress of a search."""

    evaluations: int  # routes evaluated so far
    total: int  # routes that will be evaluated, or an estimate under a time budget
    best_coverage: float  # largest coverage of the planner's cells by a feasible route
    # of the feasible routes with the required coverage, in the unit of the objective; None without one
    least_cost: float | None
    incumbent: Route | None = None  # the best route so far; None if unknown


@dataclass(frozen=True, slots=True, eq=False)
class Searched:
    """Result of a search."""

    interrupted: bool  # whether the user ended it
    scale: FloatArray | None  # (3,) divisors of the objectives for the optimizer; None: it received no values


@dataclass(frozen=True, slots=True)
class Effort:
    """Effort of a search: a number of evaluations, or a time budget in seconds measured by ``now``.

    The baselines use at most half of the budget, or a tenth before a local search. The optimizer runs at least one round. With a
    local search, the budget includes all of planning (:class:`uavcover.planner.front.Finish`); the evaluation of a plain
    optimizer's result comes on top.
    """

    evaluations: int
    budget_s: float | None
    now: Callable[[], float]

    def left_s(self, started: float, *, fraction: float = 1.0) -> float:
        """Time left of a fraction of the time budget since ``started``; infinite without a budget."""
        return math.inf if self.budget_s is None else fraction * self.budget_s - (self.now() - started)

    def is_over(self, started: float, *, fraction: float = 1.0) -> bool:
        """Whether a fraction of the time budget, if there is one, has been used since ``started``."""
        return self.left_s(started, fraction=fraction) <= 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchRun:
    """Resources of a search, and its observers."""

    effort: Effort  # when to stop
    started: float  # when planning began, by the effort's clock
    executor: Executor | None = None  # works on routes in parallel; the result does not depend on it
    should_stop: Callable[[], bool] = lambda: False  # the user's stop, called before every round or batch
    on_progress: Callable[[SearchProgress], None] = lambda _: None  # called after every round or batch
    found: list[Route] = field(default_factory=list)  # filled by a local search with routes worth judging


def rounds_of(
    effort: Effort,
    started: float,
    *,
    encoding: Encoding,
    coverage: CoverageMap,
    population_size: int,
    executor: Executor | None,
) -> int:
    """Number of rounds for which the optimizer plans its steps, which shrink with the remaining rounds (Eq. 12, 20, 21).

    Under a time budget, time a few routes from all over the encoding after one that warms up the compiled code, and divide the
    remaining time by the result. The clock ends the search in any case.
    """
    if effort.budget_s is None:
        return max(1, effort.evaluations // population_size)
    # A fixed sample: it only measures time, and must not depend on the seed of the search.
    genes = np.random.default_rng(0).uniform(encoding.lower, encoding.upper, (_TIMED_ROUTES + 1, encoding.lower.size))
    evaluate_routes(coverage, [encoding.decode(genes[0])])
    before = effort.now()
    evaluate_routes(coverage, [encoding.decode(row) for row in genes[1:]], executor)
    each_s = max((effort.now() - before) / _TIMED_ROUTES, _SHORTEST_EVALUATION_S)
    left_s = effort.budget_s - (effort.now() - started)
    return max(2, math.ceil(left_s / each_s / population_size))


def search(
    optimizer: AskAndTell,  # fresh
    run: SearchRun,  # its effort, its clock, and who follows it
    *,
    rounds: int,  # that it was made for
    encoding: Encoding,  # of the routes
    coverage: CoverageMap,  # on the planner's cells
    at_least_one_round: bool,  # whether the user's stop waits for the first round, because no other route exists
    goal: float | None,  # required fraction of the planner's cells, if one is required
    # may look at the Pareto set, before each round is added to it
    look: Callable[[Callable[[], Sequence[Route]]], None] = lambda _: None,
) -> Searched:
    """Run the optimizer until it ends, the budget is used up or the user stops it."""
    best, shortest = 0.0, math.inf
    scale: FloatArray | None = None
    while not optimizer.should_stop:
        first = optimizer.iteration == 0
        if run.should_stop() and not (first and at_least_one_round):
            return Searched(interrupted=True, scale=scale)
        if not first and run.effort.is_over(run.started):
            break
        genes = optimizer.ask()
        values = evaluate_routes(coverage, [encoding.decode(row) for row in genes], run.executor)
        if scale is None:
            scale = _spread(values.objectives)
        else:
            look(lambda: [encoding.decode(genes) for genes in optimizer.pareto_set().x])
        optimizer.tell(values.objectives / scale, values.violations)
        keeps = values.violations[:, 0] <= 0.0
        observed = -values.objectives[:, 0]
        best = max(best, float(observed[keeps].max(initial=0.0)))
        if goal is not None:
            shortest = min(shortest, float(values.objectives[keeps & (observed >= goal), 2].min(initial=math.inf)))
        total = max(rounds * len(genes), optimizer.evaluations)
        run.on_progress(
            SearchProgress(optimizer.evaluations, total, best, shortest if math.isfinite(shortest) else None)
        )
    return Searched(interrupted=False, scale=scale)


def _spread(objectives: FloatArray) -> FloatArray:
    """(m,) powers of two near the spread of (n, m) objectives, which scale the objectives to comparable sizes.

    MOEA/D needs this because it adds objectives up. Powers of two cause no rounding, so other optimizers propose exactly the
    same.
    """
    spread = np.ptp(objectives, axis=0)
    return np.asarray(2.0 ** np.round(np.log2(np.where(spread > 0.0, spread, 1.0))))


class WaypointEncoding:
    """Four genes for each of ``capacity`` nodes: east, north, height, activation.

    - The height gene 0..1 is a fraction of what is allowed at the place: the height band cut with the sea-level limits. No
      node is ever under the ground (NOTES on section 5.2).
    - A node takes part when its activation gene is above one half; when none is, the one with the largest.
    - Order: the node nearest the reference, then always the nearest (section 2.1); "improved" shortens that by 2-opt.
    - Where the limits apply to legs, the legs are laid over the terrain, which may add waypoints between the nodes.

    Attributes:
        lower: (d,) lower bounds of the genes, d = 4 capacity.
        upper: (d,) upper bounds.
    """

    name = "waypoints"

    def __init__(
        self, site: Site, *, capacity: int, order: Literal["nearest-neighbour", "improved"], reference_m: FloatArray
    ) -> None:
        self._site = site
        self._order = order
        self._reference_m = np.asarray(reference_m, float)
        west, south, east, north = site.area.bounds
        self.lower = np.tile([west, south, 0.0, 0.0], capacity)
        self.upper = np.tile([east, north, 1.0, 1.0], capacity)

    def near(self, route: Route) -> FloatArray:
        """(d,) genes of a route's waypoints; inside the bounds, so a waypoint outside the area is moved to its border.

        Raises:
            InputError: it has more waypoints than there are nodes.
        """
        points = route.waypoints_m
        capacity = self.lower.size // 4
        if len(points) > capacity:
            raise InputError(f"initial: a route of {len(points)} waypoints exceeds max_waypoints = {capacity}")
        genes = self.lower.reshape(-1, 4).copy()
        low, high = allowed_band_m(self._site, points[:, :2])
        room = np.where(high > low, high - low, 1.0)
        genes[: len(points)] = np.column_stack([points[:, :2], (points[:, 2] - low) / room, np.ones(len(points))])
        return np.asarray(np.clip(genes.ravel(), self.lower, self.upper))

    def decode(self, genes: FloatArray) -> Route:
        """The route of a (d,) vector of genes."""
        nodes = np.asarray(genes, float).reshape(-1, 4)
        active = nodes[:, 3] > 0.5
        if not active.any():
            active[np.argmax(nodes[:, 3])] = True
        positions = nodes[active, :2]
        low, high = allowed_band_m(self._site, positions)
        points = finite_heights(np.column_stack([positions, low + nodes[active, 2] * (high - low)]))
        order = kernels.nearest_neighbour_order(read_only(points), read_only(self._reference_m))
        if self._order == "improved":
            order = kernels.two_opt(points, order)
        points = points[order]
        if self._site.scenario.limits.applies_to == "legs" and len(points) > 1:
            agl_m = self._site.ground.heights_agl_m(points)
            points = lay_over_terrain(self._site, points[:, :2], agl_m, tolerance_m=0.0)
        return Route(points)


SPARE_LINES = 2
_WIDEST_GAP = 1.6
_FIXED = 5


class SwathEncoding:
    """Genes -1..1; all zero for the layout that the encoding is centred on.

    The moves of the dung beetles are drawn to the origin of the genes, because Eq. 9 and 12 to 16 multiply positions (measured in
    docs/explanation/imodbo.md). So the origin is a good layout: the tuned boustrophedon. The genes, in order: direction (up to a
    quarter turn), number of lines (up to two more or fewer), inset, tolerance, start corner, the width of every gap (1 / 1.6 to
    1.6 times), and the height of every line (up to half the band, less the tolerance of the legs). Genes of missing lines are
    ignored.

    Attributes:
        lower: (d,) lower bounds, all -1; d = 5 + 2 capacity + 1.
        upper: (d,) upper bounds, all 1.
    """

    name = "swaths"

    def __init__(self, site: Site, *, centre: SwathLayout) -> None:
        self._site = site
        self._centre = centre
        self._capacity = len(centre.heights_agl_m) + SPARE_LINES
        limits = site.scenario.limits
        self._low = limits.min_height_agl_m + limits.height_margin_m
        self._high = limits.max_height_agl_m - limits.height_margin_m
        size = _FIXED + 2 * self._capacity + 1
        self.lower = np.full(size, -1.0)
        self.upper = np.full(size, 1.0)

    def layout(self, genes: FloatArray) -> SwathLayout:
        """The layout of a (d,) vector of genes."""
        centre = self._centre
        lines = max(1, len(centre.heights_agl_m) + round(float(genes[1]) * SPARE_LINES))
        gaps = _WIDEST_GAP ** np.asarray(genes[_FIXED : _FIXED + lines + 1], float)
        gaps[[0, -1]] *= 0.5
        heights = np.full(lines, float(np.mean(centre.heights_agl_m)))
        heights += genes[_FIXED + self._capacity + 1 :][:lines] * 0.5 * (self._high - self._low)
        tolerance = centre.tolerance_m * 4.0 ** float(genes[3])
        # A leg that may deviate upwards and downwards needs a tenth of the waypoints of one at the upper limit.
        inner = min(tolerance, 0.25 * (self._high - self._low))
        return SwathLayout(
            angle_rad=centre.angle_rad + float(genes[0]) * 0.5 * math.pi,
            gaps=gaps,
            heights_agl_m=np.clip(heights, self._low + inner, self._high - inner),
            inset=max(0.0, centre.inset + float(genes[2])),
            tolerance_m=tolerance,
            start=(centre.start + round(2.0 * float(genes[4]))) % 4,
            returns=centre.returns,
        )

    def decode(self, genes: FloatArray) -> Route:
        """The route of a (d,) vector of genes."""
        return fly_layout(self._site, self.layout(genes))

    def near(self, layout: SwathLayout) -> FloatArray:
        """Genes (d,) whose layout is ``layout``, a regular one, as nearly as the genes reach."""
        centre = self._centre
        genes = np.zeros(self.lower.size)
        turn = layout.angle_rad - centre.angle_rad
        quarter_turn = math.remainder(turn, math.pi)
        genes[0] = quarter_turn / (0.5 * math.pi)
        start = layout.start
        if round((turn - quarter_turn) / math.pi) % 2:
            # After half a turn, the same lines start at the opposite corner.
            start ^= 2 if len(layout.heights_agl_m) % 2 else 3
        genes[4] = math.remainder(start - centre.start, 4) / 2.0
        genes[1] = (len(layout.heights_agl_m) - len(centre.heights_agl_m)) / SPARE_LINES
        genes[2] = layout.inset - centre.inset
        genes[3] = math.log(layout.tolerance_m / centre.tolerance_m, 4.0)
        rise = float(np.mean(layout.heights_agl_m) - np.mean(centre.heights_agl_m))
        genes[_FIXED + self._capacity + 1 :] = rise / (0.5 * (self._high - self._low))
        return np.clip(genes, -1.0, 1.0)

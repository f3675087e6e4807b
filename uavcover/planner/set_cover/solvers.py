"""Set covers on given places: exact (linear and mixed-integer programs by HiGHS through scipy), greedy, and by local search.

A cover becomes a route when its places are put in the order of a short tour, laid over the terrain where the limits apply to
legs.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels import set_cover as kernels
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.set_cover import search_cover
from uavcover.kernels.tours import short_tour
from uavcover.model.route import Route
from uavcover.planner.set_cover.candidates import Candidates, Reduced
from uavcover.planner.terrain_following import lay_over_terrain
from uavcover.scenario.site import Site

if TYPE_CHECKING:
    from scipy.optimize._milp import _OptionsMILP


_INTEGRAL = 1e-6
"""Tolerance of HiGHS: a bound may be below the whole number that it means by this."""
_COVERED = 1e-9


@dataclass(frozen=True, slots=True)
class SolverEffort:
    """Limits on the effort for an exact answer."""

    time_s: float | None = None  # wall time; the outcome then depends on the machine
    nodes: int | None = None  # of branch and bound, which depends on nothing; 0: the linear relaxation alone


@dataclass(frozen=True, slots=True, eq=False)
class CoverSolution:
    """Solution of a program, with its proved bound."""

    chosen: NDArray[np.int64] | None  # (k,) numbers of the places found, None when none were found in the time
    # no choice of these places needs fewer places, or sees more; None: nothing was proved in the time
    bound: float | None


class CoverProgram:
    """Linear and mixed-integer programs on a reduced table."""

    def __init__(self, reduced: Reduced) -> None:
        from scipy import sparse

        self._reduced = reduced
        by_place = sparse.csr_array(
            (np.ones(reduced.classes.size), reduced.classes, reduced.start),
            shape=(reduced.numbers.size, reduced.weight.size),
        )
        self._matrix = sparse.csr_array(by_place.T)

    @property
    def reachable(self) -> float:
        """Share of what can be covered that the places see together, 0..1."""
        return self._reduced.reachable

    def fewest_places(self, coverage: float, effort: SolverEffort) -> CoverSolution:
        """The fewest points that observe a share of the coverable area; with all of ``reachable`` this is set cover.

        Args:
            coverage: 0..reachable.
            effort: how long.
        """
        from scipy import sparse

        if coverage <= 0.0:
            return CoverSolution(np.empty(0, dtype=np.int64), 0.0)
        rows, c = self._matrix.shape
        if coverage >= self.reachable - _COVERED:
            return self._counted(self._solve(np.ones(c), self._matrix, np.ones(rows), c, effort))
        # A class of cells counts as seen as far as its variable says, which is at most the number of places that see it.
        matrix = sparse.vstack(
            [
                sparse.hstack([self._matrix, -sparse.eye_array(rows)]),
                sparse.csr_array(np.append(np.zeros(c), self._reduced.weight)[None]),
            ]
        )
        lower = np.append(np.zeros(rows), coverage - _COVERED)
        return self._counted(self._solve(np.append(np.ones(c), np.zeros(rows)), matrix, lower, c, effort))

    def most_coverage(self, count: int, effort: SolverEffort) -> CoverSolution:
        """At most ``count`` places with the largest share of the coverable area; the bound is that share."""
        from scipy import sparse

        rows, c = self._matrix.shape
        matrix = sparse.vstack(
            [
                sparse.hstack([self._matrix, -sparse.eye_array(rows)]),
                sparse.csr_array(np.append(-np.ones(c), np.zeros(rows))[None]),
            ]
        )
        lower = np.append(np.zeros(rows), -float(count))
        chosen, least = self._solve(np.append(np.zeros(c), -self._reduced.weight), matrix, lower, c, effort)
        return CoverSolution(chosen, None if least is None else min(-least, self.reachable))

    def _counted(self, outcome: tuple[NDArray[np.int64] | None, float | None]) -> CoverSolution:
        """Round a bound on a number of places, which is an integer."""
        chosen, bound = outcome
        return CoverSolution(chosen, None if bound is None else float(np.ceil(bound - _INTEGRAL)))

    def _solve(
        self, cost: FloatArray, matrix: object, lower: FloatArray, binaries: int, effort: SolverEffort
    ) -> tuple[NDArray[np.int64] | None, float | None]:
        """Points and proved bound of: least cost with matrix x >= lower, 0 <= x <= 1, the first ``binaries`` whole."""
        from scipy.optimize import Bounds, LinearConstraint, milp

        constraints = LinearConstraint(matrix, lb=lower)  # type: ignore[arg-type]
        relaxed = effort.nodes == 0
        options: _OptionsMILP = {}
        if effort.time_s is not None:
            options["time_limit"] = max(0.0, effort.time_s)
        if effort.nodes:
            options["node_limit"] = effort.nodes
        whole = np.zeros(cost.size, dtype=np.int64)
        whole[:binaries] = 0 if relaxed else 1
        result = milp(cost, constraints=constraints, integrality=whole, bounds=Bounds(0.0, 1.0), options=options)
        if relaxed:
            return None, float(result.fun) if result.success else None
        bound = result.mip_dual_bound
        chosen = None if result.x is None else self._reduced.numbers[np.flatnonzero(result.x[:binaries] > 0.5)]
        return chosen, float(bound) if bound is not None and np.isfinite(bound) else None


_ROUNDING = 1e-9


def greedy_cover(reduced: Reduced, coverage: float) -> NDArray[np.int64]:
    """Numbers of candidates that reach a share of the coverable area, or all that is reachable, chosen greedily."""
    return reduced.numbers[_greedy(reduced, coverage)]


def searched_cover(reduced: Reduced, *, steps: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Numbers of few candidates that see everything reachable: greedily, then by local search.

    Args:
        reduced: the places.
        steps: exchanges; 20,000 take about half a second on the paper's scenarios.
        rng: draws them.
    """
    first = _greedy(reduced, 1.0)
    return reduced.numbers[search_cover(reduced.start, reduced.classes, reduced.weight.size, first, steps, rng)]


def cut_down(candidates: Candidates, chosen: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """The chosen candidates, reduced to a maximum number by repeatedly removing the one with the least coverage of its own."""
    return kernels.drop_needless(candidates.start, candidates.cells, candidates.weight, chosen, np.inf, most)


def _greedy(reduced: Reduced, coverage: float) -> NDArray[np.int64]:
    enough = min(coverage, reduced.reachable) - _ROUNDING
    places = reduced.numbers.size
    table = (reduced.start, reduced.classes, reduced.weight)
    return kernels.drop_needless(*table, kernels.choose_greedily(*table, enough, places), enough, places)


def tour_route(site: Site, places_m: FloatArray, *, tolerance_m: float) -> Route:
    """A short route through all of (k, 3) points, begun at the end nearer to home, or to the origin without one.

    Args:
        site: the scenario on its ground.
        places_m: ENU.
        tolerance_m: how far the straight legs may leave the wanted height above ground, where they are laid over the terrain.
    """
    points = places_m[short_tour(places_m)]
    reference = np.zeros(3) if site.home_m is None else site.home_m
    if len(points) and np.linalg.norm(points[-1] - reference) < np.linalg.norm(points[0] - reference):
        points = points[::-1]
    if site.scenario.limits.applies_to == "legs" and len(points) > 1:
        wanted_agl_m = site.ground.heights_agl_m(points)
        points = lay_over_terrain(site, points[:, :2], wanted_agl_m, tolerance_m=tolerance_m)
    return Route(points)

"""What is handed over of what a planner found: what is worth judging, whole or in part, and few enough members to be read."""

import dataclasses
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.coverage.coverage_map import CoverageMap
from uavcover.kernels.dominance import least_crowded, non_dominated_mask
from uavcover.kernels.way_cost import route_cost
from uavcover.leg_checks import measure_violations
from uavcover.model.route import PART_OF, Route, RouteMember
from uavcover.planning.members import judge_members
from uavcover.planning.route_parts import Gains, gains_of, parts_of
from uavcover.planning.search import Effort
from uavcover.planning.selection import Rule, select
from uavcover.planning.snapshots import NamedRoute
from uavcover.site import Site
from uavcover.way_cost import way_cost_of

FloatArray = NDArray[np.float64]

MOST_MEMBERS = 100
"""A Pareto set of more is thinned: a choice that nobody can survey is none."""

_MOST_OTHERS = 80
_FEWEST_OTHERS = 10
"""So many parts and routes of the optimizer are judged at most, and at least, whatever time is left for it."""

_MOST_FOUND = 25
"""So many routes a search is expected to find, when time is set aside for judging them."""

_PART = 0.5
"""What judging a part takes, of what a whole route takes."""

_LARGEST_SHARE = 0.2
"""Of a time budget that is set aside."""

_WHOLE = 0.9
"""A route has parts worth flying when it sees at least this share of the most that any sees."""


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A route with its values on the planner's cells.

    Attributes:
        route: the route and what made it.
        objectives: (3,) as in :mod:`uavcover.planning.objectives`.
        violation: total violation of the hard limits.
    """

    route: NamedRoute
    objectives: FloatArray
    violation: float


@dataclass(frozen=True, slots=True, eq=False)
class Whole:
    """A route that may have parts: its values, and what each of its legs adds."""

    candidate: Candidate
    gains: Gains


class Finish:
    """The end of a plan: routes and parts that are worth judging, in the time that the budget leaves for it.

    Attributes:
        baselines: judged, in their order.
    """

    def __init__(
        self,
        coarse: CoverageMap,
        fine: CoverageMap,
        baselines: Sequence[NamedRoute],
        others: Sequence[Candidate],
        lines: Sequence[NamedRoute],
        *,
        effort: Effort,
        started: float,
        executor: Executor | None,
    ) -> None:
        """Judge the baselines, and see how long that takes.

        Args:
            coarse: on the planner's cells.
            fine: on the cells that judge.
            baselines: named routes.
            others: what an optimizer found.
            lines: further named routes; like the others they are judged when nothing beats them.
            effort: of the whole plan.
            started: when planning began, by the effort's clock.
            executor: looks at routes side by side.
        """
        self._coarse, self._others = coarse, others
        self._effort, self._started, self._executor = effort, started, executor
        # Every route is judged by the coverable cells: found once.
        _ = fine.coverable
        begin = effort.now()
        self.baselines = judge_members(fine, baselines, executor)
        judged = effort.now()
        self._wholes = self._looked_at(baselines)
        self._judging_s = (judged - begin) / max(len(baselines), 1)
        self._looking_s = (effort.now() - judged) / max(len(baselines), 1)
        self._lines = self._looked_at(lines)

    @property
    def known(self) -> list[Candidate]:
        """All that there is before a local search, on the planner's cells."""
        return [*self._others, *(each.candidate for each in (*self._lines, *self._wholes))]

    def search_effort(self) -> Effort:
        """The effort without the time that looking at what was found and judging it will take."""
        budget_s = self._effort.budget_s
        if budget_s is None:
            return self._effort
        finish_s = _MOST_FOUND * (self._judging_s + self._looking_s) + _PART * _MOST_OTHERS * self._judging_s
        return dataclasses.replace(self._effort, budget_s=budget_s - min(finish_s, _LARGEST_SHARE * budget_s))

    def worth_judging(self, found: Sequence[NamedRoute]) -> list[NamedRoute]:
        """What was found, and beside it the parts of it and the optimizer's routes that nothing is known to beat."""
        scenario = self._coarse.site.scenario
        if scenario.sensor.sensing == "at-waypoints" and scenario.limits.applies_to == "waypoints":
            # In any order every number of waypoints is searched for by itself: a part is no news.
            return [*found, *(each.route for each in self._others), *(each.candidate.route for each in self._lines)]
        looked = [*self._wholes, *self._looked_at(found)]
        lines = _unbeaten([each.candidate for each in self._lines], [each.candidate for each in looked])
        most = _MOST_OTHERS
        if self._effort.budget_s is not None:
            left_s = self._started + self._effort.budget_s - self._effort.now()
            fit = left_s / max(self._judging_s, 1e-6) - len(found) - len(lines)
            most = max(_FEWEST_OTHERS, min(most, int(fit / _PART)))
        judged = [each.candidate for each in looked] + lines
        offered = [*self._others, *_parts(self._coarse.site, [*looked, *self._lines])]
        new = _unbeaten(offered, judged)
        kept = least_crowded(np.array([each.objectives for each in new]), most) if new else ()
        return [*found, *(each.route for each in lines), *(new[k].route for k in kept)]

    def _looked_at(self, routes: Sequence[NamedRoute]) -> list[Whole]:
        site = self._coarse.site
        margin_m = site.scenario.limits.height_margin_m

        def one(named: NamedRoute) -> Whole:
            route, _ = named
            gains = gains_of(self._coarse, route)
            violation = measure_violations(site, route.waypoints_m, margin_m=margin_m).total
            objectives = np.array([-gains.seen[-1], len(route), _cost(site, route)])
            return Whole(Candidate(named, objectives, violation), gains)

        return list(map(one, routes) if self._executor is None else self._executor.map(one, routes))


def _unbeaten(offered: Sequence[Candidate], known: Sequence[Candidate]) -> list[Candidate]:
    """The routes that are offered and that nothing offered or known beats; of equals the first."""
    if not offered:
        return []
    values = np.array([each.objectives for each in (*known, *offered)])
    mask = non_dominated_mask(values, np.array([each.violation for each in (*known, *offered)]))
    new = np.flatnonzero(mask[len(known) :])
    _, first = np.unique(values[len(known) :][new], axis=0, return_index=True)
    return [offered[k] for k in new[np.sort(first)]]


def _parts(site: Site, wholes: Sequence[Whole]) -> list[Candidate]:
    """The parts of the routes that see most, where nothing beats the whole."""
    sound = [each for each in wholes if each.candidate.violation <= 0.0]
    if not sound:
        return []
    values = np.array([each.candidate.objectives for each in sound])
    mask = non_dominated_mask(values, np.zeros(len(values))) & (values[:, 0] <= _WHOLE * values[:, 0].min())
    found = []
    for each, keep in zip(sound, mask, strict=True):
        if keep:
            _, name = each.candidate.route
            for part in parts_of(each.gains):
                objectives = np.array([-part.seen, len(part.route), _cost(site, part.route)])
                found.append(Candidate((part.route, PART_OF + name), objectives, 0.0))
    return found


def thinned(pareto: Sequence[RouteMember], rule: Rule) -> list[RouteMember]:
    """At most MOST_MEMBERS of a Pareto set, in its order: the one that the rule chooses, and the least crowded."""
    if len(pareto) <= MOST_MEMBERS:
        return list(pareto)
    metrics = [member.metrics for member in pareto]
    values = np.array([[-m.coverage_of_coverable, m.waypoint_count, m.cost] for m in metrics])
    kept = set(least_crowded(values, MOST_MEMBERS - 1).tolist())
    if rule.kind != "index":  # a number means one of those that are left
        kept.add(select(pareto, rule).index)
    return [pareto[k] for k in sorted(kept)]


def _cost(site: Site, route: Route) -> float:
    return float(route_cost(site.ground.surface, way_cost_of(site), route.waypoints_m))

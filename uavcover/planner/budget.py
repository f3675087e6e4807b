"""The one table of how a search's budget is divided, and what each stage used of it.

A budget is a time, or a number of evaluations. Every share stands here with what it is a share of; the numbers were set by
trials on the bundled scenarios and on those of ``scripts/bench/kinds.py``. ``uavcover plan -v`` prints what each stage was
allotted and used.
"""

import logging
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class Shares:
    """Shares of the whole budget, by stage; those of the two searches, of the search's own budget.

    Attributes:
        baselines: initial solutions, at most, where an optimizer follows alone; ...
        baselines_before_lines: ... where other lines and a local search follow; lines that are left then come after the search.
        cut_lines: lines cut at holes and no-fly zones, after these.
        optimizer: of a memetic search, before the local search; the other algorithms are one of the two alone.
        bent_lines: lines that bend and lines of few waypoints; the best ones come first. On 25 square kilometres all of them take
            6 s of processor time, which a search of 10 s had to wait for.
        late_lines: the lines that were left before the search.
        mended: after this share no more routes that break limits are mended for the local search.
        judging: set aside for judging what was found, at most; ...
        judging_of_fewest: ... for large areas: what judging so few routes takes, up to this.
        judging_baselines: judging more baselines than the first two.
        order: another order of the legs of several sorties.
        sizes: sorties and makespan of the routes that are not chosen.
        fleet_parts: searches of the parts of a fleet's area: of all parts, of all after their borders were moved, and of the
            slowest parts once more.
        fleet_whole: one route for all vehicles of a fleet, where the parts give none.
        late_bounds: after the budget, in which bounds that take no solver may end.
        simplified_until: after this number of budgets no more waypoints are removed: a little late, most routes need a moment.
        parts: searches of the parts of a large area; the rest is for dividing, joining and judging.
        part_rounds: of these: each part by itself; then along the seams, where in turn the lower number of two neighbours
            keeps what both see, and the higher one.
        goal_main: of the local search, for the required coverage; the rest goes to the ladder of others.
        goal_main_stages: shares of that after which the goal is corrected by what judging cells see; after the first one both
            chains take the better route.
        goal_stages: the same for a coverage of the ladder, and for a route whose gaps were closed.
        goal_closing: a search that ends a little short of its goal goes on from its route with the gaps closed, ...
        goal_closing_far: ... and one that ends far from it: there nothing else leads to it.
        goal_coarse: of a search for nearly all of the ground, before the finest cells are searched.
        goal_waypoints: for searches for fewer waypoints, ...
        goal_waypoint_stages: ... and the stages of each.
        free_tours: of a search in any order, for shortest tours, once something sees as much as they are to see; ...
        free_tours_asked: ... and where the rule asks for a coverage: what sees that is chosen by its cost.
        free_tours_of_discs: first, where the rule asks for all and the sensor is a disc: for tours that both chains rebuild, ...
        free_rebuilt_stages: ... and shares of that after which both chains take the better tour.
        free_quench: cold, on what there is, first: a search that is stopped early has that.
        free_spread, free_squeeze: of what is left for numbers of waypoints, after which these parts end; the rest is the sweep.
        free_long_spread, free_first_squeeze, free_late_tours: the same while nothing sees enough.
        free_attempt: of a squeeze, for one number of waypoints at a time.
    """

    baselines: float = 0.5
    baselines_before_lines: float = 0.1
    cut_lines: float = 0.15
    optimizer: float = 0.05
    bent_lines: float = 0.01
    late_lines: float = 0.02
    mended: float = 0.3
    judging: float = 0.06
    judging_of_fewest: float = 0.3
    judging_baselines: float = 0.01
    order: float = 0.05
    sizes: float = 0.03
    fleet_parts: tuple[float, ...] = (0.25, 0.25, 0.4)
    fleet_whole: float = 0.1
    late_bounds: float = 0.05
    simplified_until: float = 1.03
    parts: float = 0.85
    part_rounds: tuple[float, ...] = (0.5, 0.2, 0.15, 0.15)
    goal_main: float = 0.7
    goal_main_stages: tuple[float, ...] = (0.35, 0.55, 0.7, 0.8, 0.88, 0.94, 0.97, 1.0)
    goal_stages: tuple[float, ...] = (0.5, 0.85, 1.0)
    goal_closing: float = 0.15
    goal_closing_far: float = 0.3
    goal_coarse: float = 0.5
    goal_waypoints: float = 0.15
    goal_waypoint_stages: tuple[float, ...] = (0.4, 0.8, 1.0)
    free_tours: float = 0.4
    free_tours_asked: float = 0.8
    free_tours_of_discs: float = 0.85
    free_rebuilt_stages: tuple[float, ...] = (0.35, 0.55, 0.7, 0.8, 0.88, 0.94, 0.97, 1.0)
    free_quench: float = 0.2
    free_spread: float = 0.35
    free_squeeze: float = 0.85
    free_long_spread: float = 0.65
    free_first_squeeze: float = 0.75
    free_late_tours: float = 0.9
    free_attempt: float = 0.25


SHARES: Final = Shares()


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandTime:
    """The time of a whole command, from its first line to its last one."""

    begun_s: float  # when it began, by ``now``
    budget_s: float | None = None  # how long it may take; none: as long as the search takes for its evaluations
    now: Callable[[], float] = time.monotonic  # the clock
    should_stop: Callable[[], bool] = lambda: False  # whether the user wants the best there is

    def left_s(self, *, share: float = 1.0) -> float:
        """Time left of a share of the budget, 0 at least; infinite without a budget."""
        if self.should_stop():
            return 0.0
        if self.budget_s is None:
            return math.inf
        return max(0.0, self.begun_s + share * self.budget_s - self.now())


class StageTimes:
    """Logs what each stage was allotted and used.

    Args:
        now: the clock of the budget.
        budget_s: the whole budget; none: it is counted in evaluations, and no stage has a time of its own.
    """

    def __init__(self, now: Callable[[], float], budget_s: float | None) -> None:
        self._now, self._budget_s = now, budget_s

    @contextmanager
    def stage(self, name: str, share: float | None = None) -> Iterator[None]:
        """A stage, with its share of the budget where it has one."""
        begin = self._now()
        try:
            yield
        finally:
            allotted = "" if share is None or self._budget_s is None else f"{share * self._budget_s:7.2f} s allotted,"
            _log.info("%-24s%-20s%7.2f s used", name, allotted, self._now() - begin)

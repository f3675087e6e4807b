"""The table that divides a search's budget, and the log of the time that each stage used.

A budget is a time or a number of evaluations. The shares were tuned on the bundled scenarios and on those of
``scripts/bench/kinds.py``. ``uavcover plan -v`` prints the allotted and the used time of each stage.
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
class Fractions:
    """Fractions of the whole budget, by stage; for stages of a search, fractions of that search's budget.

    Attributes:
        baselines: upper limit for initial solutions if only an optimizer follows; ...
        baselines_before_lines: ... if other lines and a local search follow; the remaining lines then come after the search.
        cut_lines: lines cut at holes and no-fly zones, after these.
        optimizer: of a memetic search, before the local search. The other algorithms use only one of the two.
        bent_lines: bent lines and lines with few waypoints, the best first. On 25 square kilometres they take 6 s of processor
            time, too long for a search of 10 s.
        late_lines: the lines that remained before the search.
        repaired: after this fraction, infeasible routes are no longer repaired for the local search.
        judging: upper limit for evaluating the routes found on the evaluation grid; ...
        judging_of_fewest: ... for large areas, upper limit of the time for the fewest routes.
        judging_baselines: evaluating baselines after the first two.
        order: another order of the legs of several sorties.
        sizes: sorties and makespan of the routes that are not chosen.
        fleet_parts: searches of the parts of a fleet's area: all parts, all parts with adjusted borders, the slowest parts again.
        fleet_whole: one route for the whole fleet if the parts give none.
        late_bounds: time after the budget for bounds that need no solver.
        simplified_until: multiple of the budget after which no more waypoints are removed. Most routes need a moment longer.
        parts: searches of the parts of a large area; the rest is for dividing, joining and judging.
        part_rounds: of these: first each part alone, then the seams; in turn, the lower and the higher numbered of two neighbours
            keeps the ground that both observe.
        goal_main: of the local search, for the required coverage; the other coverage values share the rest.
        goal_main_stages: ends of its stages. Each stage corrects the goal on the evaluation grid; after the first, both chains
            continue from the better route.
        goal_stages: the same for another coverage value, and for a route whose gaps were closed.
        goal_repair: closing the gaps and searching again if a search ends slightly short of its goal; ...
        goal_repair_far: ... and if it ends far from it.
        goal_coarse: of a search for nearly all of the ground, before the finest cells.
        goal_waypoints: searches for fewer waypoints; ...
        goal_waypoint_stages: ... and the stages of each.
        free_tours: of a search in any order, for shortest tours once a route reaches the target coverage; ...
        free_tours_required: ... the same if the selection rule requires a coverage and chooses by cost; ...
        free_tours_of_discs: ... the same if it requires full coverage and the sensor is a disc: both chains rebuild tours.
        free_rebuilt_stages: ends of the stages of the latter; after each, both chains take the better tour.
        free_quench: first, a cold search from the initial solutions, so that a search that is stopped early has a result.
        free_spread, free_squeeze: ends of these parts in the search for few waypoints; the rest is the sweep.
        free_long_spread, free_first_squeeze, free_late_tours: the same while no route reaches the coverage.
        free_attempt: of a squeeze, for one number of waypoints.
    """

    baselines: float = 0.5
    baselines_before_lines: float = 0.1
    cut_lines: float = 0.15
    optimizer: float = 0.05
    bent_lines: float = 0.01
    late_lines: float = 0.02
    repaired: float = 0.3
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
    goal_repair: float = 0.15
    goal_repair_far: float = 0.3
    goal_coarse: float = 0.5
    goal_waypoints: float = 0.15
    goal_waypoint_stages: tuple[float, ...] = (0.4, 0.8, 1.0)
    free_tours: float = 0.4
    free_tours_required: float = 0.8
    free_tours_of_discs: float = 0.85
    free_rebuilt_stages: tuple[float, ...] = (0.35, 0.55, 0.7, 0.8, 0.88, 0.94, 0.97, 1.0)
    free_quench: float = 0.2
    free_spread: float = 0.35
    free_squeeze: float = 0.85
    free_long_spread: float = 0.65
    free_first_squeeze: float = 0.75
    free_late_tours: float = 0.9
    free_attempt: float = 0.25


FRACTIONS: Final = Fractions()


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandTime:
    """The time budget of a whole command."""

    begun_s: float  # when it began, by ``now``
    budget_s: float | None = None  # how long it may take; None: as long as the search takes for its evaluations
    now: Callable[[], float] = time.monotonic  # the clock
    should_stop: Callable[[], bool] = lambda: False  # whether the user wants the best there is

    def left_s(self, *, fraction: float = 1.0) -> float:
        """Time left of a fraction of the budget, 0 at least; infinite without a budget."""
        if self.should_stop():
            return 0.0
        if self.budget_s is None:
            return math.inf
        return max(0.0, self.begun_s + fraction * self.budget_s - self.now())


class StageTimes:
    """Logs the allotted and the used time of each stage.

    Args:
        now: the clock of the budget.
        budget_s: the whole budget; None: the budget is a number of evaluations, and no stage has a time.
    """

    def __init__(self, now: Callable[[], float], budget_s: float | None) -> None:
        self._now, self._budget_s = now, budget_s

    @contextmanager
    def stage(self, name: str, fraction: float | None = None) -> Iterator[None]:
        """A stage, with its fraction of the budget where it has one."""
        begin = self._now()
        try:
            yield
        finally:
            allotted = (
                "" if fraction is None or self._budget_s is None else f"{fraction * self._budget_s:7.2f} s allotted,"
            )
            _log.info("%-24s%-20s%7.2f s used", name, allotted, self._now() - begin)

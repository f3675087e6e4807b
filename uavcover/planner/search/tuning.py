"""Tuned numbers of the local search, with their meaning and reason.

They were tuned by hand and by trials on the bundled scenarios. Numbers that need no tuning (the number of chains, the ladder of
goals, the margin of a goal) are defined where they are used.
"""

import math
from dataclasses import dataclass, field

from uavcover.kernels.annealing import Moves
from uavcover.planner.budget import FRACTIONS

_MOVES = Moves(
    turn=0.1, transfer_to_gap=0.15, transfer=0.1,
    move_and_height=0.2, move=0.25, height=0.15, shift=0.08, shift_height=0.07, insert=0.1, smallest_step=0.01,
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class GoalTuning:
    """Search of a route for one coverage, and the allocation of the work among coverages.

    Lengths and temperatures are in radii of the sensor, so that a bend costs the same on a short route and on a long one.

    Attributes:
        main_fraction, main_stages, stages, repair_fraction, coarse_fraction, repair_fraction_far, waypoint_stages,
        waypoint_fraction: see `uavcover.planner.budget.Fractions`.
        further_left: before that, under a time budget, stages follow that are as short as corrections allow, while each leaves no
            more than this of what the one before it lacked. Over large areas closing gaps one by one takes half of the way again
            (ridge-25km2, 150 to 231 km for 0.02 points), and these stages close most (10 s: 150.0 to 150.6 km, was 153.5).
        most_short: that little, as a fraction of the coverage.
        closed: multiples of the missing ground whose gaps are repaired, one after the other: photos by distance fall
            elsewhere behind a route than behind home, so it may take more.
        most_trials: to make each route that closes them shorter. The search makes it shorter, too: with 4,000 trials that took
            2 to 4 of 20 s in a canyon, and with 300 the search began too far away (scripts/bench/kinds.py, ``canyon:sparse``).
        waiting_penalty: of all coverage, in costs of the route, for turns that wait for a photo: what else closes gaps costs as
            much or more (``costly_ground``: 17 to 80 in four cases of scripts/bench/kinds.py).
        nearly_all: a search that begins with closed gaps opens them again, and mostly closes them better. For more coverage than
            this it did not come back to its goal, in either field that was tried (fields U and L of b33804a, 99.9 %); for
            98 % a search that may not open them ended up to 6 % later (jacksboro, seed 4).
        nearly_all_on_finest: the same where the finest cells can be searched: canyon-nadir with 99 % takes 404 s instead of 588,
            two_parts-survey 379 instead of 486, two others 1 and 2 % more (scripts/bench/kinds.py, 10 s).
        likely_on_finest: the same where likely photos are counted, up to 3 points too many: with a photo every 40 m and 10 s,
            canyon takes 18 % less, city 11, terraces 10 and volcano 1 % (3 or 4 seeds each), ...
        most_prepared: ... unless preparing the search took more than this fraction of the time: the finest cells take as long
            again.
        fewest_on_finest: the finest cells are searched if there is time for this number of proposals there.
        closed_costlier: factor of the price of coverage there: 10 is too little in both fields.
        closed_heat: factor of the temperature at its beginning; 0.05 and 0.2 do as well.
        finest_penalty: the same factor on the finest cells, at the beginning: there it rises from stage to stage, ...
        finest_penalty_step: ... and by this factor from round to round while the goal is missed.
        finest_cooler: factor of the temperature from round to round.
        sure_penalty: price of coverage, in costs of the route, by which a beginning that observes nearly all is found beside the
            best. AC13_0004 (areas with holes, 99.98 %, 20 s) takes 1,713 s; without one, no search reached the goal (lines:
            2,765 s).
        other_lines: the second chain begins with other lines than the first, if their price is at most this multiple. At 0.8 %
            more, fractal-sparse takes 315 s instead of 337; at 5 to 8 % more, three cases end 2 to 7 % later (2,000 evaluations,
            scripts/bench/kinds.py). Not for more than ``nearly_all``: a square field took 340 s instead of 321.
        most_short_at_first: a search that misses its goal by more after its first stage ends there, and goes on from long lines
            with the gaps closed: in a canyon it was 0.09 to 0.1 short, in six cases on other ground (scripts/bench/kinds.py) at
            most 0.047 (terraces, tilted). At 0.06 canyon-nadir takes 395 s with 10 s, at 0.07 336 s (seeds
            1 to 5); of ten other runs on steep ground nine take 2 % less on average, and one 40 % more.
        most_short_start: such lines lack no more than this, ...
        most_starts: ... this number with the most coverage on the planner's cells are judged, ...
        most_closed: ... and the gaps of this number are repaired, of more until one succeeds.
        most_closed_after: a search from there may miss its goal again: the gaps of this number of its stages are repaired.
        closed_again: searches from routes with closed gaps, one after the other, while they end short of their goal.
        costly_ground: after repairing gaps the price of coverage is this multiple of its cost between what the search ended with
            and the route with its gaps closed: at that rate itself both would be worth as much; ...
        most_penalty: ... up to this price. Where both observe nearly the same on the search's cells it has no limit, and no
            change that loses a cell would be accepted: canyon-sparse took 554 s instead of 427.
        coverage_penalty: of all coverage, in lengths of the route. Along a path a share more costs one to two such fractions of
            the length; at a price far above that no single change may lose a cell, and nothing can be traded.
        nearly_all_penalty: the same for more than ``nearly_all``, where the last of the ground is the dearest: at 2 triangle and
            pentagon often end short of 99.9 % and up to 17 % later, at 12 the square does (scripts/bench_fields.py of b33804a).
        penalty_step: factor of that price when a stage ends below its goal, by up to ``far_short``; ...
        most_penalty_steps: ... its power, in proportion, when it ends further below, up to this one. Photos every 40 m over
            canyon, terraces, volcano and city cost 3 % less (1,000 evaluations, seeds 1 to 3, -33 to +10 %), others the same.
        start_penalty: the same price when beginnings are compared: lower missing coverage is cheap in a beginning, for fewer
            lines are hard to come by, and gaps between lines are closed.
        stage_per_correction: under a time budget a stage takes at least this multiple of the time of a correction, which judges a
            route and prepares the chains, so that most of the time is search.
        goal_per_correction: the same for a coverage of the ladder, and a price of waypoints.
        waypoint_price: of a waypoint where few are not asked for: one more holds a leg nearer to the height that observes widest.
        waypoint_prices: where few are searched for, one after the other.
        costly_waypoints: lengths that the price of all waypoints counts as in the price of coverage: else coverage would be given
            for one waypoint less.
        largest_step: standard deviation of the widest moves.
        hottest: temperature at the beginning. Where length alone is the cost, on routes of up to ``hot_radii``, ...
        hot_radii: ... for longer ones begin with lines that are nearly as short as they can be, and heat spoils more of them
            than is repaired later: there it falls with the square of the length, ...
        least_hottest: ... to this. With 30 s jacksboro takes 6,292 m (6,333 at 0.05), ridge-obstacles 6,293 (6,300), ridge-25km2
            with 60 s 150,542 (152,511). Mission time pays for turns, and lines have to change: at the lower temperature jacksboro
            took 823 s, at 0.05 798 s (1,500 evaluations, three seeds each).
        hottest_of_waypoint: of the price of a waypoint, beside it.
        coldest: temperature at the end.
        second_chain: heat of the second of two chains that go on from the same route: from a good one heat only leads away.
        path_capacity: a route may have this multiple of the waypoints of the longest beginning, ...
        spare_waypoints: ... and this number more.
    """

    main_fraction: float = FRACTIONS.goal_main
    main_stages: tuple[float, ...] = FRACTIONS.goal_main_stages
    stages: tuple[float, ...] = FRACTIONS.goal_stages
    repair_fraction: float = FRACTIONS.goal_repair
    coarse_fraction: float = FRACTIONS.goal_coarse
    further_left: float = 0.7
    repair_fraction_far: float = FRACTIONS.goal_repair_far
    most_short: float = 0.03
    closed: tuple[float, ...] = (1.0, 1.5, 2.5)
    most_trials: int = 1_000
    waiting_penalty: float = 10.0
    nearly_all: float = 0.995
    nearly_all_on_finest: float = 0.985
    likely_on_finest: float = 0.9
    most_prepared: float = 0.25
    fewest_on_finest: int = 1000
    closed_costlier: float = 40.0
    closed_heat: float = 0.2
    finest_penalty: float = 10.0
    finest_penalty_step: float = 3.0
    finest_cooler: float = 0.2
    sure_penalty: float = 1_000.0
    other_lines: float = 1.03
    most_short_at_first: float = 0.07
    most_short_start: float = 0.1
    most_starts: int = 8
    most_closed: int = 2
    most_closed_after: int = 1
    closed_again: int = 3
    costly_ground: float = 1.6
    most_penalty: float = 30.0
    coverage_penalty: float = 2.0
    nearly_all_penalty: float = 6.0
    penalty_step: float = 1.6
    far_short: float = 0.01
    most_penalty_steps: float = 3.0
    start_penalty: float = 3.0
    stage_per_correction: float = 4.0
    goal_per_correction: float = 12.0
    waypoint_price: float = 0.002
    waypoint_prices: tuple[float, ...] = (0.3, 1.0, 3.0)
    waypoint_stages: tuple[float, ...] = FRACTIONS.goal_waypoint_stages
    waypoint_fraction: float = FRACTIONS.goal_waypoints
    costly_waypoints: float = 3.0
    largest_step: float = 0.4
    hottest: float = 0.05
    hot_radii: float = 25.0
    least_hottest: float = 0.0025
    hottest_of_waypoint: float = 0.01
    coldest: float = 5e-4
    second_chain: float = 0.3
    path_capacity: int = 3
    spare_waypoints: int = 100

    def start_cost(self, cost: float, observed: float, goal: float, *, penalty: float | None = None) -> float:
        """Cost of an initial solution, with that of its missing coverage at its own cost per coverage.

        Args:
            cost: of its route.
            observed: fraction of the visible ground that it observes.
            goal: the fraction to observe.
            penalty: of full coverage, in costs of the route. Default: ``start_penalty``.
        """
        missing = max(0.0, goal - observed)
        return (
            cost * (1.0 + (self.start_penalty if penalty is None else penalty) * missing / observed)
            if observed > 0.0
            else math.inf
        )

    def penalty_rise(self, short: float) -> float:
        """Factor of the penalty for missing coverage after a stage that misses its goal by a fraction; 1 at the goal."""
        steps = min(self.most_penalty_steps, max(1.0, short / self.far_short))
        return 1.0 if short <= 0.0 else self.penalty_step**steps

    def heat_of_length(self, radii: float) -> float:
        """Initial temperature of a search for the shortest path, in radii of the sensor.

        Args:
            radii: length of the initial route.
        """
        return max(self.least_hottest, self.hottest * min(1.0, self.hot_radii / radii) ** 2)


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeOrderTuning:
    """Search of waypoints that may be visited in any order.

    Temperatures and prices "in cells" are in units of the coverage of one cell of average weight.

    Attributes:
        tours, tours_required, tours_of_discs, rebuilt_stages, quench, spread, squeeze, long_spread, first_squeeze,
            late_tours, attempt: see `uavcover.planner.budget.Fractions`.
        tour_coverage_penalty: of a cell, in radii of the sensor, in a search for a tour. Where all is to be observed no cell is
            worth less than the whole tour: single targets lie many radii apart.
        tour_hottest: temperature at the beginning of that search, in radii.
        rebuilt: fraction of the proposals that rebuild the tour around a waypoint, in one of the two chains at first, ...
        rebuilt_hottest: ... the temperature at its beginning, ...
        rebuilt_heat: ... and that of rebuilding, as a multiple.
        discs_heats: temperatures at the beginning and at the end, in radii, where both chains rebuild.
        quenched: times the coldest temperature.
        hottest_cells, coldest_cells: temperatures.
        spread_heats, squeeze_heats, sweep_heats: of the two chains, as fractions of the hottest.
        path_cost_cells: of a radius of way, where coverage is all that counts.
        sweep_path_cost_cells: the same for the second chain of a sweep, where the way counts too.
        waypoint_cost_cells: of a waypoint while they spread.
    """

    tours: float = FRACTIONS.free_tours
    tours_required: float = FRACTIONS.free_tours_required
    tours_of_discs: float = FRACTIONS.free_tours_of_discs
    rebuilt_stages: tuple[float, ...] = FRACTIONS.free_rebuilt_stages
    tour_coverage_penalty: float = 1.5
    tour_hottest: float = 0.2
    rebuilt: float = 0.1
    rebuilt_hottest: float = 0.02
    rebuilt_heat: float = 50.0
    discs_heats: tuple[float, float] = (0.06, 2e-3)
    quench: float = FRACTIONS.free_quench
    quenched: float = 5.0
    spread: float = FRACTIONS.free_spread
    squeeze: float = FRACTIONS.free_squeeze
    long_spread: float = FRACTIONS.free_long_spread
    first_squeeze: float = FRACTIONS.free_first_squeeze
    late_tours: float = FRACTIONS.free_late_tours
    attempt: float = FRACTIONS.free_attempt
    hottest_cells: float = 1.2
    coldest_cells: float = 0.012
    spread_heats: tuple[float, float] = (1.0, 0.6)
    squeeze_heats: tuple[float, float] = (0.5, 0.2)
    sweep_heats: tuple[float, float] = (0.4, 0.4)
    path_cost_cells: float = 0.04
    sweep_path_cost_cells: float = 1.0
    waypoint_cost_cells: float = 1.2

    def hottest_tour(self, rebuilt: float) -> float:
        """Initial temperature of a search for a tour with this fraction of rebuilding, in radii."""
        return self.rebuilt_hottest if rebuilt > 0.0 else self.tour_hottest


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchTuning:
    """All tuned numbers."""

    # fractions of the proposals by kind; where the order is given, the two kinds of transfer are exchanges instead
    moves: Moves = _MOVES
    goal: GoalTuning = field(default_factory=GoalTuning)  # of the search for a coverage
    free_order: FreeOrderTuning = field(default_factory=FreeOrderTuning)  # of the search for waypoints in any order


TUNED = SearchTuning()
"""Numbers that the planner uses."""

"""Annealing chains side by side, in batches, until the evaluations or the time are used up."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from uavcover.kernels import annealing
from uavcover.kernels.annealing import Prices, Schedule
from uavcover.kernels.route_state import RouteState
from uavcover.model.route import Route
from uavcover.planner.search.route_problem import RouteProblem
from uavcover.planner.search.tuning import TUNED, SearchTuning

CHAINS = 2
"""Chains that run side by side, for any number of threads: the result must not depend on it."""

PROPOSALS_PER_EVALUATION = 50
"""This number of proposals counts as one evaluation: about what they cost in time (docs/results/coverage.md)."""

_BATCHES = 400
_LARGEST_BATCH = 5000
"""A batch is not interrupted: it must be over in a moment."""


class SearchPace(Protocol):
    """Pace of a search: how much of the work remains."""

    @property
    def fraction(self) -> float:
        """Share of the work that is done, 0..1."""
        ...

    def next_batch(self) -> int:
        """Proposals for each chain to do next; 0 when the work is done."""
        ...

    def done(self, proposals: int) -> None:
        """Take note of proposals, of all chains together."""
        ...


class PaceByNumber:
    """A fixed number of proposals, in reproducible batches."""

    def __init__(self, proposals: int) -> None:
        self._total = proposals
        self._left = proposals
        self._batch = min(_LARGEST_BATCH, max(1, proposals // (CHAINS * _BATCHES)))

    @property
    def fraction(self) -> float:
        """Share of the work that is done, 0..1."""
        return 1.0 - self._left / self._total if self._total > 0 else 1.0

    def next_batch(self) -> int:
        """Proposals for each chain to do next; 0 when the work is done."""
        return min(self._batch, self._left // CHAINS)

    def done(self, proposals: int) -> None:
        """Take note of proposals, of all chains together."""
        self._left -= proposals


class PaceByClock:
    """Proposals until a deadline, in batches of about ``batch_s``; their number depends on the machine's speed."""

    def __init__(self, now: Callable[[], float], until: float, *, batch_s: float = 0.1) -> None:
        self._now = now
        self._until = until
        self._batch_s = batch_s
        self._begin = self._at = now()
        self._batch = 50

    @property
    def fraction(self) -> float:
        """Share of the time used, 0..1."""
        return min(1.0, (self._now() - self._begin) / max(self._until - self._begin, 1e-9))

    def next_batch(self) -> int:
        """Proposals for each chain to do next; 0 when the time is over."""
        self._at = self._now()
        return self._batch if self._at < self._until else 0

    def done(self, proposals: int) -> None:
        """Record proposals, and size the next batch by the time that this one took, without what was done before it."""
        now = self._now()
        wanted_s = min(self._batch_s, max(self._until - now, 1e-3))
        each_s = max(now - self._at, 1e-6) / max(proposals // CHAINS, 1)
        # The first batches may have waited for the compiler: grow step by step.
        self._batch = max(1, min(4 * self._batch, int(wanted_s / each_s)))


@dataclass(slots=True, eq=False)
class Chain:
    """One route under annealing."""

    problem: RouteProblem  # what is looked at
    state: RouteState  # the route
    prices: Prices  # of the energy
    hottest: float  # temperature at the beginning of a stage
    coldest: float  # at its end
    step_m: float  # widest moves
    fewest: int  # waypoints
    most: int  # waypoints
    rebuilt: float = 0.0  # share of the proposals that rebuild the route around a waypoint, where the order is free

    @property
    def route(self) -> Route:
        """The route as it is now."""
        return Route(annealing.snapshot(self.state))

    @property
    def seen(self) -> float:
        """Share of what counts that is seen, 0..1."""
        return float(self.state.seen[0])

    @property
    def energy(self) -> float:
        """Energy that the chain minimises."""
        route = self.route
        return (
            self.prices.way * self.problem.cost(route)
            + self.prices.waypoint * len(route)
            + annealing.energy_of_share(self.prices, self.seen)
        )


@dataclass(slots=True, eq=False)
class Work:
    """The work of one local search, and its observers."""

    problem: RouteProblem  # what is looked at
    pace: SearchPace  # how much is left
    rngs: Sequence[np.random.Generator]  # one random generator for each chain
    executor: Executor | None  # runs the chains side by side; the result does not depend on it
    should_stop: Callable[[], bool]  # asked between batches
    on_batch: Callable[[Sequence[Chain]], None]  # called after every batch, with the chains
    # the problem on the finest cells that counts of a route what is judged of it; none where there are none
    finest: Callable[[Route, float], RouteProblem] | None = None
    tuning: SearchTuning = TUNED  # of the search
    proposals: int = 0  # done so far, by all chains
    stopped: bool = field(default=False)  # whether ``should_stop`` ended the work
    # share of all the work that judging routes and preparing chains took the last time; 0 where work is counted by
    # proposals
    correction: float = 0.0

    def run(self, chains: Sequence[Chain], *, until: float) -> bool:
        """Anneal CHAINS chains until a share ``until`` of all work is done, cooling throughout; False: no work is left.

        Args:
            chains: are changed.
            until: 0..1 of all the work.
        """
        begin = self.pace.fraction
        while not self.stopped and self.pace.fraction < until:
            batch = self.pace.next_batch()
            if batch == 0:
                return False
            if self.should_stop():
                self.stopped = True
                break
            share = min(1.0, (self.pace.fraction - begin) / max(until - begin, 1e-12))

            def one(number: int, batch: int = batch, share: float = share) -> None:
                chain = chains[number]
                temperature = chain.hottest * (chain.coldest / chain.hottest) ** share
                schedule = Schedule(
                    batch, temperature, temperature, chain.step_m, chain.fewest, chain.most, self.tuning.moves,
                    chain.rebuilt, self.tuning.free_order.rebuilt_heat,
                )  # fmt: skip
                annealing.anneal(self.problem.numbers, chain.prices, schedule, chain.state, self.rngs[number])

            numbers = range(len(chains))
            list(map(one, numbers) if self.executor is None else self.executor.map(one, numbers))
            self.proposals += batch * len(chains)
            self.pace.done(batch * len(chains))
            self.on_batch(chains)
        return not self.stopped

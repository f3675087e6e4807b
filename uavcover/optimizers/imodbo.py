"""The paper's method: MODBO, and IMODBO, the improved multi-objective dung beetle optimizer.

Both share one frame: four groups, one archive, survival of the better ones. The paper gives the moves but not the multi-objective
frame around them. docs/explanation/imodbo.md documents our choices and their reasons.

Moves are equations 9-18 and 20-23 of the paper, one function per group of equations. Rows are beetles: ``(g, d)``, g = beetles of
the group, d = variables. Results may be outside the search space. Functions that need random numbers draw them from ``rng`` in
the order that their docstring gives. Equation 19, the Latin hypercube, is `Box.latin_hypercube`.

Variants show the effect of each of IMODBO's improvements: the Latin hypercube (Eq. 19), the dynamic k and b (Eq. 20, 21), the
sine-cosine disturbance (Eq. 22, 23). ``OwnBest`` variants keep the best position of each beetle, as single-objective DBO does:
the paper does not specify the survival (docs/explanation/fidelity.md).
"""

from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.kernels.dominance import least_crowded, non_dominated_ranks
from uavcover.optimizers.ask_tell import AskTellOptimizer, Solutions

ROLLING_PROBABILITY = 0.9  # else the roller meets an obstacle and dances
STRAIGHT_PROBABILITY = 0.9  # alpha = +1, else -1


def roll(
    x: FloatArray, previous: FloatArray, worst: FloatArray, alpha: FloatArray, *, k: float, b: float
) -> FloatArray:
    """A roller on a free way, Eq. 9 and 10.

    Args:
        x: ``(g, d)`` positions x(t).
        previous: ``(g, d)`` positions x(t-1).
        worst: ``(g, d)`` the bad position X^W each one walks away from.
        alpha: ``(g, 1)`` +1 or -1.
        k: deflection coefficient.
        b: step size coefficient.

    Returns:
        ``(g, d)`` positions x(t+1).
    """
    light = np.abs(x - worst)  # Eq. 10
    return x + alpha * k * previous + b * light  # Eq. 9


def dance(x: FloatArray, previous: FloatArray, degrees: FloatArray) -> FloatArray:
    """A roller before an obstacle, Eq. 11; it stays where it is at 0, 90 and 180 degrees.

    Args:
        x: ``(g, d)`` positions x(t).
        previous: ``(g, d)`` positions x(t-1).
        degrees: ``(g, 1)`` theta, 0 to 180 degrees.

    Returns:
        ``(g, d)`` positions x(t+1).
    """
    moves = degrees % 90 != 0
    slope = np.tan(np.radians(np.where(moves, degrees, 0.0)))
    moved: FloatArray = x + slope * np.abs(x - previous)  # Eq. 11
    return moved


def roller(
    x: FloatArray, previous: FloatArray, worst: FloatArray, *, k: float, b: float, rng: np.random.Generator
) -> FloatArray:
    """Rollers, each with its own chance to roll (Eq. 9) or to dance (Eq. 11).

    Draws ``random((g, 1))`` for roll or dance, ``random((g, 1))`` for alpha, ``integers(0, 181, (g, 1))`` for theta:
    whole degrees, so that the angles at which Eq. 11 does not move do occur.

    Args:
        x: ``(g, d)`` positions x(t).
        previous: ``(g, d)`` positions x(t-1).
        worst: ``(g, d)`` X^W of each.
        k: deflection coefficient.
        b: step size coefficient.
        rng: source of random numbers.

    Returns:
        ``(g, d)`` positions x(t+1).
    """
    each = (len(x), 1)
    rolls = rng.random(each) < ROLLING_PROBABILITY
    alpha = np.where(rng.random(each) < STRAIGHT_PROBABILITY, 1.0, -1.0)
    degrees = rng.integers(0, 181, each).astype(np.float64)
    return np.where(rolls, roll(x, previous, worst, alpha, k=k, b=b), dance(x, previous, degrees))


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """The region around a good position in which eggs are laid or food is looked for; both ``(g, d)``."""

    lower: FloatArray
    upper: FloatArray


def area_around(centre: FloatArray, lower: FloatArray, upper: FloatArray, *, t: int, t_max: int) -> Region:
    """Oviposition area around X* (Eq. 12, 13) or foraging area around X^b (Eq. 15, 16).

    R = 1 - t/Tmax as in the original dung beetle paper; the (1 - t)/Tmax printed here is negative from t = 2 on. The
    two ends are ordered before clipping: for negative coordinates X(1-R) is the larger one.

    Args:
        centre: ``(g, d)`` X* or X^b, inside the bounds.
        lower: ``(d,)`` Lb of the search space.
        upper: ``(d,)`` Ub of the search space.
        t: iteration.
        t_max: the last iteration.
    """
    radius = 1 - t / t_max
    one, other = centre * (1 - radius), centre * (1 + radius)
    return Region(
        lower=np.maximum(np.minimum(one, other), lower),  # Eq. 12, 15
        upper=np.minimum(np.maximum(one, other), upper),  # Eq. 13, 16
    )


def breeder(x: FloatArray, best: FloatArray, area: Region, *, rng: np.random.Generator) -> FloatArray:
    """Brood balls laid around X*, Eq. 14. Draws ``random((g, d))`` for b1, then for b2.

    Args:
        x: ``(g, d)`` positions B(t).
        best: ``(g, d)`` X* of each.
        area: its oviposition area.
        rng: source of random numbers.

    Returns:
        ``(g, d)`` positions B(t+1).
    """
    b1, b2 = rng.random(x.shape), rng.random(x.shape)
    return best + b1 * (x - area.lower) + b2 * (x - area.upper)  # Eq. 14


def small_beetle(x: FloatArray, area: Region, *, rng: np.random.Generator) -> FloatArray:
    """Small beetles looking for food, Eq. 17. Draws ``standard_normal((g, 1))`` for C1, ``random((g, d))`` for C2.

    Args:
        x: ``(g, d)`` positions x(t).
        area: ``(g, d)`` foraging area of each.
        rng: source of random numbers.

    Returns:
        ``(g, d)`` positions x(t+1).
    """
    c1, c2 = rng.standard_normal((len(x), 1)), rng.random(x.shape)
    return x + c1 * (x - area.lower) + c2 * (x - area.upper)  # Eq. 17


def disturbed_small_beetle(x: FloatArray, area: Region, *, t: int, t_max: int, rng: np.random.Generator) -> FloatArray:
    """Small beetles with the sine-cosine disturbance, Eq. 22 and 23.

    Draws what `small_beetle` draws, then ``random((g, 1))`` for r2 / (2 pi) and ``random((g, 1))`` for r3 / 2.

    Args:
        x: ``(g, d)`` positions x(t).
        area: ``(g, d)`` foraging area of each.
        t: iteration.
        t_max: the last iteration.
        rng: source of random numbers.

    Returns:
        ``(g, d)`` positions x(t+1).
    """
    walked = small_beetle(x, area, rng=rng)
    r2, r3 = 2 * np.pi * rng.random((len(x), 1)), 2 * rng.random((len(x), 1))
    delta = sine_cosine_disturbance(r2, r3, t=t, t_max=t_max)
    return walked + 0.1 * delta * (area.upper - area.lower)  # Eq. 23


def sine_cosine_disturbance(r2: FloatArray, r3: FloatArray, *, t: int, t_max: int) -> FloatArray:
    """delta(t), Eq. 22: sine in the first third, both in the middle, cosine in the last; r2, r3 ``(g, 1)``."""
    if 3 * t < t_max:
        return disturbance_decay(t, t_max) * np.sin(r2) * r3  # Eq. 22, first case
    if 3 * t <= 2 * t_max:
        return disturbance_decay(t, t_max) * (np.sin(r2) + np.cos(r2)) / 2 * r3  # Eq. 22, second case
    return disturbance_decay(t, t_max) * np.cos(r2) * r3  # Eq. 22, third case


def thief(x: FloatArray, best: FloatArray, leader: FloatArray, *, s: float, rng: np.random.Generator) -> FloatArray:
    """Thieves around the food X^b, Eq. 18. Draws ``standard_normal((g, d))`` for g.

    Args:
        x: ``(g, d)`` positions x(t).
        best: ``(g, d)`` X* of each.
        leader: ``(g, d)`` X^b of each.
        s: the constant S.
        rng: source of random numbers.

    Returns:
        ``(g, d)`` positions x(t+1).
    """
    g = rng.standard_normal(x.shape)
    stolen: FloatArray = leader + s * g * (np.abs(x - best) + np.abs(x - leader))  # Eq. 18
    return stolen


def dynamic_step(t: int, t_max: int) -> float:
    """b(t), Eq. 20: 0.4 at the start, falling as a Gaussian."""
    return float(0.4 * np.exp(-((5 * t / t_max) ** 2)))  # Eq. 20


def dynamic_deflection(t: int, t_max: int) -> float:
    """k(t), Eq. 21: from 0.5 to 0.6, outside the (0, 0.2] that belongs to Eq. 9, as printed."""
    return 0.5 + 0.1 * t / t_max  # Eq. 21


def disturbance_decay(t: int, t_max: int) -> float:
    """a(t) of Eq. 22: from 2 to 1."""
    return 2 - t / t_max


# Percentages: rollers, breeders, small beetles, thieves; from the 6, 6, 7 and 11 of 30 of the single-objective DBO.
GROUP_FRACTIONS: Final = (20, 20, 25, 35)


def group_sizes(population_size: int) -> IntArray:
    """``(4,)`` beetles in each group: the shares rounded so that they add up, larger remainders first.

    >>> group_sizes(50).tolist(), group_sizes(30).tolist()
    ([10, 10, 12, 18], [6, 6, 7, 11])
    """
    hundredths = population_size * np.array(GROUP_FRACTIONS, dtype=np.int64)
    sizes = hundredths // 100
    short = population_size - int(sizes.sum())
    # stable: of equal remainders the later group (thieves before small beetles) gets the beetle
    by_remainder = np.lexsort((-np.arange(4), -(hundredths % 100)))
    sizes[by_remainder[:short]] += 1
    return sizes


class MODBO(AskTellOptimizer):
    """Rollers, breeders, small beetles and thieves; arguments as `AskTellOptimizer`.

    Every round each beetle moves once, by the equations of the group it is drawn into; parents and offspring together are reduced
    to the population size by non-dominated sort and crowding. The first population is uniform, k and b are fixed (Table 2).
    """

    smallest_population: ClassVar[int] = 4  # one beetle in each group
    deflection: ClassVar[float] = 0.2  # K, Table 2
    step: ClassVar[float] = 0.2  # b, Table 2
    theft_constant: ClassVar[float] = 0.25  # S, Table 2
    remembered: ClassVar[tuple[str, ...]] = ("previous", "ranks", "parents")

    _previous: FloatArray  # (n, d) x(t-1) of each; its own x as long as it has not moved
    _ranks: IntArray  # (n,) front of each, 0 is the first
    _parents: IntArray  # (n,) the beetle that each candidate comes from

    def _roller_coefficients(self) -> tuple[float, float]:
        """The k and b of Eq. 9 in this round."""
        return self.deflection, self.step

    def _walk_small_beetles(self, x: FloatArray, area: Region, rng: np.random.Generator) -> FloatArray:
        """New positions of small beetles ``(g, d)`` with these foraging areas."""
        return small_beetle(x, area, rng=rng)

    def _move(self, rng: np.random.Generator) -> FloatArray:
        x, archive = self._alive.x, self._archive
        parents = rng.permutation(self._population_size)  # groups are drawn anew in each round
        rollers, breeders, smalls, thieves = np.split(parents, np.cumsum(group_sizes(self._population_size))[:-1])

        worst = self._drawn_from_front(int(self._ranks.max()), len(rollers), rng)
        k, b = self._roller_coefficients()
        rolled = roller(x[rollers], self._previous[rollers], worst, k=k, b=b, rng=rng)

        best = self._drawn_from_front(0, len(breeders), rng)
        bred = breeder(x[breeders], best, self._area_around(best), rng=rng)

        food = archive.leaders(len(smalls), rng)
        walked = self._walk_small_beetles(x[smalls], self._area_around(food), rng)

        best = self._drawn_from_front(0, len(thieves), rng)
        stolen = thief(x[thieves], best, archive.leaders(len(thieves), rng), s=self.theft_constant, rng=rng)

        self._parents = parents
        return np.concatenate([rolled, bred, walked, stolen])

    def _drawn_from_front(self, rank: int, count: int, rng: np.random.Generator) -> FloatArray:
        """Decision vectors ``(count, d)`` of random members of one front."""
        members = np.flatnonzero(self._ranks == rank)
        return self._alive.x[members[rng.integers(0, len(members), count)]]

    def _area_around(self, centre: FloatArray) -> Region:
        return area_around(centre, self._box.lower, self._box.upper, t=self._iteration, t_max=self._max_iterations)

    def _learn(self, evaluated: Solutions) -> None:
        if self._iteration == 0:
            alive, previous = evaluated, evaluated.x
        else:
            alive = self._alive.followed_by(evaluated)
            # a survivor keeps the x(t-1) it has; an offspring comes from where its parent is
            previous = np.concatenate([self._previous, self._alive.x[self._parents]])
        chosen, self._ranks = survivors(alive, self._population_size)
        self._alive, self._previous = alive.rows(chosen), previous[chosen]


class ModboPlusLatinHypercube(MODBO):
    """MODBO whose first population is a Latin hypercube."""

    def _sample(self, rng: np.random.Generator) -> FloatArray:
        return self._box.latin_hypercube(self._population_size, rng)  # Eq. 19


class ModboPlusDynamicParameters(MODBO):
    """MODBO whose k and b change with time; the K and b of Table 2 are not used."""

    def _roller_coefficients(self) -> tuple[float, float]:
        t, t_max = self._iteration, self._max_iterations
        return dynamic_deflection(t, t_max), dynamic_step(t, t_max)  # Eq. 21, 20


class ModboPlusSineCosine(MODBO):
    """MODBO whose small beetles are disturbed by sine and cosine."""

    def _walk_small_beetles(self, x: FloatArray, area: Region, rng: np.random.Generator) -> FloatArray:
        return disturbed_small_beetle(x, area, t=self._iteration, t_max=self._max_iterations, rng=rng)  # Eq. 22, 23


class IMODBO(ModboPlusLatinHypercube, ModboPlusDynamicParameters, ModboPlusSineCosine):
    """MODBO with the paper's three improvements; arguments as `AskTellOptimizer`."""


def survivors(solutions: Solutions, count: int) -> tuple[IntArray, IntArray]:
    """The ``count`` best rows: whole fronts first, then the least crowded of the front that does not fit.

    Fronts follow the feasibility rules: feasible before infeasible, less total violation before more, then dominance.

    Args:
        solutions: n rows, n >= count.
        count: how many survive.

    Returns:
        ``(count,)`` row numbers, ascending, and ``(count,)`` the number of each one's front, 0 for the first.
    """
    ranks = non_dominated_ranks(solutions.objectives, solutions.total_violation)
    last = int(np.sort(ranks)[count - 1])
    whole = np.flatnonzero(ranks < last)
    split = np.flatnonzero(ranks == last)
    spared = split[least_crowded(solutions.objectives[split], count - len(whole))]
    chosen = np.sort(np.concatenate([whole, spared]))
    return chosen, ranks[chosen]


class DBO(MODBO):
    """Rollers, breeders, small beetles and thieves for a single objective (Xue and Shen 2023); arguments as `AskTellOptimizer`.

    As in the original, a beetle stays in its group, moves from the best place it has ever been at, and eggs stay inside the
    oviposition area. Parameters are the original's: k = 0.1, b = 0.3, S = 0.5. Lines name its equations, and ours in brackets.
    """

    most_objectives: ClassVar[int | None] = 1
    deflection: ClassVar[float] = 0.1  # k
    step: ClassVar[float] = 0.3  # b
    theft_constant: ClassVar[float] = 0.5  # S
    remembered: ClassVar[tuple[str, ...]] = ("previous", "current_best", "current_worst")

    _alive: Solutions  # the best position of each beetle; _previous is the one of the round before, x(t-1)
    _current_best: FloatArray  # (d,): X*, of the last evaluated round
    _current_worst: FloatArray  # (d,): X^w, of the last evaluated round

    def _move(self, rng: np.random.Generator) -> FloatArray:
        x, here, worst = self._alive.x, self._current_best, self._current_worst
        ever = self._archive.solutions.x[0]  # X^b
        n = self._population_size
        rollers, breeders, smalls, thieves = np.split(np.arange(n), np.cumsum(group_sizes(n))[:-1])

        rolled = roller(
            x[rollers], self._previous[rollers], _each(worst, rollers), k=self.deflection, b=self.step, rng=rng
        )  # Eq. 1, 2 (9, 10, 11)

        area = self._area_around(_each(here, breeders))  # Eq. 3 (12, 13)
        laid = breeder(x[breeders], _each(here, breeders), area, rng=rng)  # Eq. 4 (14)
        bred = np.clip(laid, area.lower, area.upper)  # Algorithm 2 of the original: eggs stay in the area

        area = self._area_around(_each(ever, smalls))  # Eq. 5 (15, 16)
        walked = small_beetle(x[smalls], area, rng=rng)  # Eq. 6 (17)

        stolen = thief(
            x[thieves], _each(here, thieves), _each(ever, thieves), s=self.theft_constant, rng=rng
        )  # Eq. 7 (18)
        return np.concatenate([rolled, bred, walked, stolen])

    def _learn(self, evaluated: Solutions) -> None:
        order = np.lexsort((evaluated.objectives[:, 0], evaluated.total_violation))  # feasibility rules
        self._current_best, self._current_worst = evaluated.x[order[0]], evaluated.x[order[-1]]
        if self._iteration == 0:
            self._alive, self._previous = evaluated, evaluated.x
            return
        old = self._alive
        same = evaluated.total_violation == old.total_violation
        better = np.where(
            same, evaluated.objectives[:, 0] < old.objectives[:, 0], evaluated.total_violation < old.total_violation
        )
        self._previous = old.x
        n = self._population_size
        self._alive = old.followed_by(evaluated).rows(np.where(better, n + np.arange(n), np.arange(n)))


def _each(position: FloatArray, members: IntArray) -> FloatArray:
    """The same ``(d,)`` position for each member: ``(g, d)``."""
    return np.broadcast_to(position, (len(members), len(position)))


class ImodboMinusLatinHypercube(ModboPlusDynamicParameters, ModboPlusSineCosine):
    """IMODBO whose first population is uniform."""


class ImodboMinusDynamicParameters(ModboPlusLatinHypercube, ModboPlusSineCosine):
    """IMODBO with the fixed k and b of MODBO (Table 2)."""


class ImodboMinusSineCosine(ModboPlusLatinHypercube, ModboPlusDynamicParameters):
    """IMODBO whose small beetles are not disturbed."""


class ModboOwnBest(MODBO):
    """MODBO whose beetles keep their own best position.

    A beetle moves to its new position only if that dominates the current one, by the feasibility rules.
    """

    def _learn(self, evaluated: Solutions) -> None:
        if self._iteration == 0:
            super()._learn(evaluated)
            return
        order = np.argsort(self._parents)  # offspring in the order of their parents
        parents, offspring = self._alive, evaluated.rows(order)
        moved = _dominate(offspring, parents)[:, None]
        self._alive = Solutions(
            np.where(moved, offspring.x, parents.x),
            np.where(moved, offspring.objectives, parents.objectives),
            np.where(moved, offspring.violations, parents.violations),
        )
        self._previous = np.where(moved, parents.x, self._previous)
        self._ranks = non_dominated_ranks(self._alive.objectives, self._alive.total_violation)


def _dominate(these: Solutions, others: Solutions) -> BoolArray:
    """``(n,)`` whether each row dominates the same row of the others: less total violation, or equal and dominance."""
    no_worse = (these.objectives <= others.objectives).all(axis=1)
    better = (these.objectives < others.objectives).any(axis=1)
    equal = these.total_violation == others.total_violation
    dominating: BoolArray = np.where(equal, no_worse & better, these.total_violation < others.total_violation)
    return dominating


class ImodboOwnBest(ModboOwnBest, IMODBO):
    """IMODBO whose beetles keep their own best position."""

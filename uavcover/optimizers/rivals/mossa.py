"""MOSSA: the multi-objective sparrow search algorithm.

Equations are numbered as in Xue and Shen, "A novel swarm intelligence optimization approach: sparrow search algorithm",
Systems Science and Control Engineering 8, 2020, which has one objective. What "better", "best" and "worst" mean with several
is said at `MOSSA` and in docs/explanation/imodbo.md.
"""

from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.kernels.dominance import crowding_distance
from uavcover.optimizers.ask_tell import AskTellOptimizer
from uavcover.optimizers.interface import Solutions, survivors


def produce(x: FloatArray, place: IntArray, *, threshold: float, t_max: int, rng: np.random.Generator) -> FloatArray:
    """Producers, Eq. 3: a wide search, or a flight when the alarm is louder than the safety threshold.

    Draws ``random((1, 1))`` for the alarm R2 of the whole flock, ``random((g, 1))`` for 1 - alpha,
    ``standard_normal((g, 1))`` for Q.

    Args:
        x: ``(g, d)`` positions.
        place: ``(g,)`` i, the place of each in the order of fitness, from 1.
        threshold: ST.
        t_max: iter_max.
        rng: source of random numbers.

    Returns:
        ``(g, d)`` next positions.
    """
    alarm = rng.random((1, 1))
    alpha = 1 - rng.random((len(x), 1))  # in (0, 1]
    q = rng.standard_normal((len(x), 1))
    searched = x * np.exp(-place[:, None] / (alpha * t_max))  # Eq. 3, R2 < ST
    return np.where(alarm < threshold, searched, x + q)  # Eq. 3, R2 >= ST: Q times a row of ones


def scrounge(
    x: FloatArray, place: IntArray, producer: FloatArray, worst: FloatArray, *, n: int, rng: np.random.Generator
) -> FloatArray:
    """Scroungers, Eq. 4: the worse half of the flock flies elsewhere, the others go to a producer.

    Draws ``standard_normal((g, 1))`` for Q, ``random((g, d))`` for the signs of A.

    Args:
        x: ``(g, d)`` positions.
        place: ``(g,)`` i, from 1.
        producer: ``(g, d)`` X_P of each.
        worst: ``(g, d)`` X_worst of each.
        n: sparrows in the flock.
        rng: source of random numbers.

    Returns:
        ``(g, d)`` next positions.
    """
    q = rng.standard_normal((len(x), 1))
    a = np.where(rng.random(x.shape) < 0.5, -1.0, 1.0)
    with np.errstate(over="ignore"):  # what flies off to infinity is put on the bound
        hungry = q * np.exp((worst - x) / place[:, None] ** 2.0)  # Eq. 4, i > n/2
    # A+ = A'(AA')^-1 = A'/d, so that |X - X_P| A+ is one number for all variables
    step = (np.abs(x - producer) * a).sum(axis=1, keepdims=True) / x.shape[1]
    return np.where(place[:, None] > n / 2, hungry, producer + step)  # Eq. 4, else


def beware(
    x: FloatArray, behind: IntArray, best: FloatArray, worst: FloatArray, *, depth: int, rng: np.random.Generator
) -> FloatArray:
    """Sparrows that sense danger, Eq. 5: those at the edge go to the best, those in the middle move about.

    Draws ``standard_normal((g, d))`` for beta, ``random((g, 1))`` for K.

    Args:
        x: ``(g, d)`` positions.
        behind: ``(g,)`` the front of each, for f_i - f_g: 0 is the first.
        best: ``(g, d)`` X_best of each.
        worst: ``(g, d)`` X_worst of each.
        depth: fronts behind the first, for f_w - f_g; with epsilon = 1, one front, the division is never by zero.
        rng: source of random numbers.

    Returns:
        ``(g, d)`` next positions.
    """
    beta = rng.standard_normal(x.shape)
    k = 2 * rng.random((len(x), 1)) - 1
    edge = best + beta * np.abs(x - best)  # Eq. 5, f_i > f_g
    middle = x + k * np.abs(x - worst) / (depth + 1)  # Eq. 5, f_i = f_g
    return np.where(behind[:, None] > 0, edge, middle)


class MOSSA(AskTellOptimizer):
    """Producers, scroungers and sparrows that sense danger; arguments as `AskTellOptimizer`.

    The order of fitness is by front, then the less crowded first. X_P and X_best are leaders drawn from the archive, X_worst
    a member of the last front. Parents and offspring together are reduced to the population size by front and crowding, where
    the original keeps each sparrow's best.
    """

    smallest_population: ClassVar[int] = 2  # a producer and a scrounger
    safety_threshold: ClassVar[float] = 0.8  # ST; Table 2 calls it R2
    producer_share: ClassVar[float] = 0.2  # PD, Table 2
    aware_share: ClassVar[float] = 0.1  # SD, Table 2

    _flock: Solutions
    _ranks: IntArray

    def _sample(self, rng: np.random.Generator) -> FloatArray:
        return self._box.uniform(self._population_size, rng)

    def _move(self, rng: np.random.Generator) -> FloatArray:
        n, archive = self._population_size, self._archive
        order = self._by_fitness()
        x, place = self._flock.x[order], np.arange(1, n + 1)
        last = np.flatnonzero(self._ranks == self._ranks.max())
        worst = self._flock.x[last[rng.integers(0, len(last), n)]]
        producers = max(1, round(self.producer_share * n))

        produced = produce(
            x[:producers], place[:producers], threshold=self.safety_threshold, t_max=self._max_iterations, rng=rng
        )
        followed = archive.leaders(n - producers, rng)
        scrounged = scrounge(x[producers:], place[producers:], followed, worst[producers:], n=n, rng=rng)
        moved = np.concatenate([produced, scrounged])

        aware = rng.permutation(n)[: max(1, round(self.aware_share * n))]
        moved[aware] = beware(
            x[aware],
            self._ranks[order[aware]],
            archive.leaders(len(aware), rng),
            worst[aware],
            depth=int(self._ranks.max()),
            rng=rng,
        )
        return moved

    def _by_fitness(self) -> IntArray:
        crowding = np.empty(self._population_size)
        for rank in range(int(self._ranks.max()) + 1):
            front = self._ranks == rank
            crowding[front] = crowding_distance(self._flock.objectives[front])
        return np.lexsort((-crowding, self._ranks))

    def _learn(self, evaluated: Solutions) -> None:
        alive = evaluated if self._iteration == 0 else self._flock.followed_by(evaluated)
        chosen, self._ranks = survivors(alive, self._population_size)
        self._flock = alive.rows(chosen)

    def _memory(self) -> dict[str, npt.NDArray[Any]]:
        if self._iteration == 0:
            return {}
        flock = self._flock
        return {"x": flock.x, "objectives": flock.objectives, "violations": flock.violations, "ranks": self._ranks}

    def _recall(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        self._flock = Solutions(memory["x"], memory["objectives"], memory["violations"])
        self._ranks = memory["ranks"]

"""Optimizers that IMODBO is compared with: MOGWO (grey wolves), MOSSA (sparrows) and MOWOA (whales).

Equations are numbered as in the papers on the versions for one objective:

- MOGWO: Mirjalili, Mirjalili and Lewis, "Grey wolf optimizer", Advances in Engineering Software 69, 2014. The archive and the
  choice of leaders are those of the multi-objective version: Mirjalili, Saremi, Mirjalili and Coelho, "Multi-objective grey wolf
  optimizer: a novel algorithm for multi-criterion optimization", Expert Systems with Applications 47, 2016, section 3, and the
  authors' published code where the text is silent. The archive is thinned, and leaders are chosen, by how many solutions share a
  cell of objective space.
- MOSSA: Xue and Shen, "A novel swarm intelligence optimization approach: sparrow search algorithm", Systems Science and Control
  Engineering 8, 2020. What "better", "best" and "worst" mean with several is said at `MOSSA` and in docs/explanation/imodbo.md.
- MOWOA: Mirjalili and Lewis, "The whale optimization algorithm", Advances in Engineering Software 95, 2016. Its best whale X*
  becomes, for each whale, a leader drawn from the archive.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.kernels.dominance import crowding_distance
from uavcover.optimizers.ask_tell import Archive, AskTellOptimizer, Solutions
from uavcover.optimizers.imodbo import survivors


def cells(objectives: FloatArray, *, n_grid: int, inflation: float) -> IntArray:
    """Cell of each solution; cells that hold something are numbered from 0.

    Along each objective the range, made wider by ``inflation`` times itself at both ends, gets ``n_grid - 1`` evenly spaced
    borders; so there are ``n_grid`` intervals, the first and last of which have no outer end.

    Args:
        objectives: ``(k, m)``, k >= 1.
        n_grid: intervals per objective, >= 3.
        inflation: alpha, >= 0.

    Returns:
        ``(k,)`` cell numbers, 0 to the number of occupied cells - 1.

    >>> cells(np.array([[0.0, 1.0], [0.01, 0.99], [1.0, 0.0]]), n_grid=10, inflation=0.1).tolist()
    [0, 0, 1]
    """
    low, high = objectives.min(axis=0), objectives.max(axis=0)
    margin = inflation * (high - low)
    borders = np.linspace(low - margin, high + margin, n_grid - 1)
    position = np.zeros(len(objectives), np.int64)
    for j in range(objectives.shape[1]):
        interval = np.searchsorted(borders[:, j], objectives[:, j], side="right")
        # number pairs densely at once, so that many objectives do not overflow
        position = np.unique(position * n_grid + interval, return_inverse=True)[1].astype(np.int64)
    return position


def thinned(cell: IntArray, keep: int, *, rng: np.random.Generator) -> IntArray:
    """Rows that remain when a random member of the most crowded cell is removed, one at a time.

    Draws ``random((r, 2))``, r = rows to remove: which of the equally crowded cells, and which of its members.

    Args:
        cell: ``(k,)`` the cell of each row, as `cells` numbers them.
        keep: how many to keep.
        rng: source of random numbers.

    Returns:
        ``(min(k, keep),)`` row numbers, ascending.
    """
    if len(cell) <= keep:
        return np.arange(len(cell), dtype=np.int64)
    order = np.argsort(cell, kind="stable")
    members = [rows.tolist() for rows in np.split(order, np.cumsum(np.bincount(cell))[:-1])]
    counts = [len(rows) for rows in members]
    for which, member in rng.random((len(cell) - keep, 2)).tolist():
        most = max(counts)
        crowded = [i for i, count in enumerate(counts) if count == most]
        chosen = crowded[int(which * len(crowded))]
        members[chosen].pop(int(member * most))
        counts[chosen] -= 1
    return np.array(sorted(row for rows in members for row in rows), dtype=np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class LeaderChoice:
    """The archive by cells, ready to draw leaders from.

    Attributes:
        by_cell: ``(k,)`` row numbers, those of cell 0 first.
        starts: ``(c,)`` where each cell begins in ``by_cell``.
        counts: ``(c,)`` members of each cell.
        position: ``(k,)`` where each row stands in ``by_cell``.
        cell: ``(k,)`` the cell of each row.
        pressure: beta.
    """

    by_cell: IntArray
    starts: IntArray
    counts: IntArray
    position: IntArray
    cell: IntArray
    pressure: float

    @classmethod
    def of(cls, cell: IntArray, *, pressure: float) -> "LeaderChoice":
        """For rows in these cells ``(k,)``, k >= 1, with selection pressure beta."""
        by_cell = np.argsort(cell, kind="stable").astype(np.int64)
        counts = np.bincount(cell).astype(np.int64)
        position = np.empty_like(by_cell)
        position[by_cell] = np.arange(len(cell))
        return cls(by_cell, np.cumsum(counts) - counts, counts, position, cell, pressure)

    def drawn(self, count: int, taken: IntArray, rng: np.random.Generator) -> IntArray:
        """For each of ``count`` wolves a row that it has not taken yet.

        A cell is drawn in proportion to its count ** -beta (the roulette P = c / N of the paper, with the pressure of the
        authors' code), then one of its members. What a wolf has taken does not count. Draws ``random((count, 2))``.

        Args:
            count: wolves, g.
            taken: ``(g, j)`` different rows each wolf already has; if the archive holds no others, nothing is barred.
            rng: source of random numbers.

        Returns:
            ``(g,)`` row numbers.
        """
        which, member = rng.random((count, 2)).T
        if taken.shape[1] >= len(self.cell):
            taken = taken[:, :0]
        left = np.tile(self.counts, (count, 1))
        wolves = np.arange(count)
        for column in taken.T:
            left[wolves, self.cell[column]] -= 1
        with np.errstate(divide="ignore"):
            weights = np.where(left > 0, left.astype(np.float64) ** -self.pressure, 0.0)
        steps = weights.cumsum(axis=1)
        end = steps[:, -1]
        mark = np.minimum(which * end, np.nextafter(end, 0.0))  # below the end, also after rounding
        chosen = (steps <= mark[:, None]).sum(axis=1)
        position = self.starts[chosen] + (member * left[wolves, chosen]).astype(np.int64)
        # step over those of the same cell that are taken, in ascending order
        for barred in np.sort(self.position[taken], axis=1).T:
            position += (self.cell[self.by_cell[barred]] == chosen) & (barred <= position)
        chosen_rows: IntArray = self.by_cell[position]
        return chosen_rows


def encircle(x: FloatArray, leader: FloatArray, *, a: float, rng: np.random.Generator) -> FloatArray:
    """Positions to which one leader draws its wolves.

    Draws ``random((n, d))`` for r1, then for r2.

    Args:
        x: ``(n, d)`` positions X(t).
        leader: ``(n, d)`` alpha, beta or delta of each.
        a: falls from 2 to 0 over the rounds.
        rng: source of random numbers.

    Returns:
        ``(n, d)``: X1, X2 or X3.
    """
    big_a = 2 * a * rng.random(x.shape) - a  # Eq. 3.3
    c = 2 * rng.random(x.shape)  # Eq. 3.4
    distance = np.abs(c * leader - x)  # Eq. 3.5
    return leader - big_a * distance  # Eq. 3.6


class MOGWO(AskTellOptimizer):
    """Grey wolves that follow three leaders from the least crowded cells of a grid; arguments as `AskTellOptimizer`.

    Wolves go where they are sent, better or not; the archive is the memory. Table 2 has beta = 10, the original 4. Its gamma
    belongs to the authors' code, which removes from a cell drawn by count ** gamma; here the most crowded cell loses a member,
    as their text says, because with gamma = 2 the archive loses the ends of the front (figures in docs/explanation/imodbo.md).
    """

    n_grid: ClassVar[int] = 10  # Table 2
    grid_inflation: ClassVar[float] = 0.1  # alpha, Table 2
    leader_pressure: ClassVar[float] = 10.0  # beta, Table 2
    remembered: ClassVar[tuple[str, ...]] = ("wolves",)

    _wolves: FloatArray  # (n, d) positions X(t)

    def _move(self, rng: np.random.Generator) -> FloatArray:
        a = 2 - 2 * self._iteration / self._max_iterations
        best = self._archive.solutions
        choice = LeaderChoice.of(self._cells(best), pressure=self.leader_pressure)
        taken = np.empty((self._population_size, 0), np.int64)
        pulled = np.zeros_like(self._wolves)
        for _ in range(3):  # delta, beta, alpha: different ones as long as there are any
            row = choice.drawn(self._population_size, taken, rng)
            taken = np.column_stack([taken, row])
            pulled += encircle(self._wolves, best.x[row], a=a, rng=rng)
        return pulled / 3  # Eq. 3.7

    def _cells(self, solutions: Solutions) -> IntArray:
        return cells(solutions.objectives, n_grid=self.n_grid, inflation=self.grid_inflation)

    def _archive_with(self, evaluated: Solutions) -> Archive:
        merged = self._archive.non_dominated_with(evaluated)
        kept = thinned(self._cells(merged), self._archive.capacity, rng=self._rngs["moves"])
        return Archive(merged.rows(kept), self._archive.capacity)

    def _learn(self, evaluated: Solutions) -> None:
        self._wolves = evaluated.x


def produce(x: FloatArray, rank: IntArray, *, threshold: float, t_max: int, rng: np.random.Generator) -> FloatArray:
    """Producers, Eq. 3: a wide search, or a flight when the alarm is louder than the safety threshold.

    Draws ``random((1, 1))`` for the alarm R2 of the whole flock, ``random((g, 1))`` for 1 - alpha,
    ``standard_normal((g, 1))`` for Q.

    Args:
        x: ``(g, d)`` positions.
        rank: ``(g,)`` i, the rank of each by fitness, from 1.
        threshold: ST.
        t_max: iter_max.
        rng: source of random numbers.

    Returns:
        ``(g, d)`` next positions.
    """
    alarm = rng.random((1, 1))
    alpha = 1 - rng.random((len(x), 1))  # in (0, 1]
    q = rng.standard_normal((len(x), 1))
    searched = x * np.exp(-rank[:, None] / (alpha * t_max))  # Eq. 3, R2 < ST
    return np.where(alarm < threshold, searched, x + q)  # Eq. 3, R2 >= ST: Q times a row of ones


def scrounge(
    x: FloatArray, rank: IntArray, producer: FloatArray, worst: FloatArray, *, n: int, rng: np.random.Generator
) -> FloatArray:
    """Scroungers, Eq. 4: the worse half of the flock flies elsewhere, the others go to a producer.

    Draws ``standard_normal((g, 1))`` for Q, ``random((g, d))`` for the signs of A.

    Args:
        x: ``(g, d)`` positions.
        rank: ``(g,)`` i, from 1.
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
        hungry = q * np.exp((worst - x) / rank[:, None] ** 2.0)  # Eq. 4, i > n/2
    # A+ = A'(AA')^-1 = A'/d, so that |X - X_P| A+ is one number for all variables
    step = (np.abs(x - producer) * a).sum(axis=1, keepdims=True) / x.shape[1]
    return np.where(rank[:, None] > n / 2, hungry, producer + step)  # Eq. 4, else


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
    producer_fraction: ClassVar[float] = 0.2  # PD, Table 2
    aware_fraction: ClassVar[float] = 0.1  # SD, Table 2
    remembered: ClassVar[tuple[str, ...]] = ("ranks",)

    _ranks: IntArray  # (n,) front of each sparrow, 0 is the first

    def _move(self, rng: np.random.Generator) -> FloatArray:
        n, archive = self._population_size, self._archive
        order = self._by_fitness()
        x, rank = self._alive.x[order], np.arange(1, n + 1)
        last = np.flatnonzero(self._ranks == self._ranks.max())
        worst = self._alive.x[last[rng.integers(0, len(last), n)]]
        producers = max(1, round(self.producer_fraction * n))

        produced = produce(
            x[:producers], rank[:producers], threshold=self.safety_threshold, t_max=self._max_iterations, rng=rng
        )
        followed = archive.leaders(n - producers, rng)
        scrounged = scrounge(x[producers:], rank[producers:], followed, worst[producers:], n=n, rng=rng)
        moved = np.concatenate([produced, scrounged])

        aware = rng.permutation(n)[: max(1, round(self.aware_fraction * n))]
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
            crowding[front] = crowding_distance(self._alive.objectives[front])
        return np.lexsort((-crowding, self._ranks))

    def _learn(self, evaluated: Solutions) -> None:
        alive = evaluated if self._iteration == 0 else self._alive.followed_by(evaluated)
        chosen, self._ranks = survivors(alive, self._population_size)
        self._alive = alive.rows(chosen)


def swim(
    x: FloatArray, best: FloatArray, other: FloatArray, *, a: float, spiral: float, rng: np.random.Generator
) -> FloatArray:
    """New positions of whales: around X*, towards or away from another whale, or along a spiral to X*.

    Draws ``random((n, 1))`` four times: for A, for C, for l, for p; one number for all variables of a whale, because
    ``|A| < 1`` and ``p < 0.5`` decide for the whole whale.

    Args:
        x: ``(n, d)`` positions X(t).
        best: ``(n, d)`` X* of each.
        other: ``(n, d)`` X_rand of each.
        a: falls from 2 to 0 over the rounds.
        spiral: b, the shape of the spiral.
        rng: source of random numbers.

    Returns:
        ``(n, d)`` positions X(t+1).
    """
    each = (len(x), 1)
    big_a = 2 * a * rng.random(each) - a  # Eq. 2.3
    c = 2 * rng.random(each)  # Eq. 2.4
    length = 2 * rng.random(each) - 1  # l in [-1, 1]
    p = rng.random(each)
    around = best - big_a * np.abs(c * best - x)  # Eq. 2.1, 2.2
    search = other - big_a * np.abs(c * other - x)  # Eq. 2.7, 2.8
    turn = np.exp(spiral * length) * np.cos(2 * np.pi * length)
    along = np.abs(best - x) * turn + best  # Eq. 2.5
    return np.where(p < 0.5, np.where(np.abs(big_a) < 1, around, search), along)  # Eq. 2.6


class MOWOA(AskTellOptimizer):
    """Whales around leaders of the archive; arguments as `AskTellOptimizer`. Table 2: no parameters.

    Whales go where they swim, better or not; the archive is the memory.
    """

    spiral: ClassVar[float] = 1.0  # b, as the original
    remembered: ClassVar[tuple[str, ...]] = ("whales",)

    _whales: FloatArray  # (n, d) positions X(t)

    def _move(self, rng: np.random.Generator) -> FloatArray:
        n = self._population_size
        a = 2 - 2 * self._iteration / self._max_iterations
        best = self._archive.leaders(n, rng)
        other = self._whales[rng.integers(0, n, n)]
        return swim(self._whales, best, other, a=a, spiral=self.spiral, rng=rng)

    def _learn(self, evaluated: Solutions) -> None:
        self._whales = evaluated.x


class RandomSearch(AskTellOptimizer):
    """Independent uniform samples in every round, a baseline that every other algorithm must beat.

    See `AskTellOptimizer` for the arguments.
    """

    def _move(self, rng: np.random.Generator) -> FloatArray:
        return self._sample(rng)

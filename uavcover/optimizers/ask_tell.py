"""Ask and tell: the interface of every optimizer, and the common base of ours, which samples, checks, archives and saves.

The optimizer proposes, and the caller evaluates anywhere, in any number of processes. All objectives are minimised; a constraint
is a number that is > 0 if violated.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Protocol, Self

import numpy as np
import numpy.typing as npt

from uavcover.errors import OptimizerError
from uavcover.kernels.arrays import FloatArray, read_only
from uavcover.kernels.dominance import crowding_distance, first_occurrences, least_crowded, non_dominated_mask

State = dict[str, object]


def finite_array(values: npt.ArrayLike, name: str) -> FloatArray:
    """A float64 copy of ``values``.

    Raises:
        OptimizerError: Not numbers, or not all finite; the message names the array and the first bad entry.
    """
    try:
        array = np.array(values, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise OptimizerError(f"{name}: this is not an array of numbers ({error}); use rows of equal length") from error
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        position = tuple(int(i) for i in bad[0])
        raise OptimizerError(f"{name}: entry {position} is {array[position]}; use only finite numbers")
    return array


@dataclass(frozen=True, eq=False)
class Solutions:
    """Rows of decision vectors with their values; n = rows, d = variables, m = objectives, c = constraints."""

    x: FloatArray  # (n, d) decision vectors
    objectives: FloatArray  # (n, m), minimised
    violations: FloatArray  # (n, c), > 0 where violated

    def __post_init__(self) -> None:
        for name, values in self.columns.items():
            object.__setattr__(self, name, read_only(values))

    def __len__(self) -> int:
        return len(self.x)

    @classmethod
    def none(cls, n_variables: int, n_objectives: int, n_constraints: int) -> "Solutions":
        """No rows, with these widths."""
        return cls(np.empty((0, n_variables)), np.empty((0, n_objectives)), np.empty((0, n_constraints)))

    @cached_property
    def total_violation(self) -> FloatArray:
        """``(n,)`` sums of the positive parts of the violations; 0 is feasible."""
        return read_only(np.maximum(self.violations, 0.0).sum(axis=1))

    @property
    def columns(self) -> dict[str, FloatArray]:
        """The arrays by name."""
        return {"x": self.x, "objectives": self.objectives, "violations": self.violations}

    def rows(self, chosen: npt.NDArray[np.int64 | np.bool_]) -> "Solutions":
        """The chosen rows: ``(k,)`` row numbers or an ``(n,)`` mask."""
        return Solutions(self.x[chosen], self.objectives[chosen], self.violations[chosen])

    def followed_by(self, other: "Solutions") -> "Solutions":
        """These rows, then those of ``other``."""
        pairs = zip(self.columns.values(), other.columns.values(), strict=True)
        return Solutions(*map(np.concatenate, pairs))


@dataclass(frozen=True, eq=False)
class ParetoSet(Solutions):
    """The best solutions found."""

    # True if every row keeps every constraint. False without a known feasible point: the rows then have the smallest total
    # violation and do not dominate each other.
    feasible: bool


class AskAndTell(Protocol):
    """A multi-objective optimizer with ask and tell, one whole population at a time.

    A round is one ``ask`` and one successful ``tell``. Round 0 samples the first population, the others move it.
    """

    @property
    def iteration(self) -> int:
        """Rounds completed so far."""

    @property
    def evaluations(self) -> int:
        """Number of candidates whose values are known so far."""

    @property
    def should_stop(self) -> bool:
        """True once all rounds are done."""

    def ask(self) -> FloatArray:
        """The candidates to evaluate next.

        Asking again before telling returns the same candidates.

        Returns:
            ``(n, d)`` read-only, inside [lower, upper]; n = population size, d = variables.

        Raises:
            OptimizerError: All rounds are done.
        """

    def tell(self, objectives: npt.ArrayLike, violations: npt.ArrayLike | None = None) -> None:
        """Give the values of the candidates asked last, in their order.

        Args:
            objectives: ``(n, m)``, finite, minimised; m = objectives.
            violations: ``(n, c)``, finite, > 0 where violated; c = constraints. May be omitted when c is 0. Their positive parts
                are summed, so constraints should be of comparable scale.

        Raises:
            OptimizerError: Nothing was asked, a shape is wrong, or a value is not finite. Nothing has changed then: the
                same candidates can be given to tell() again.
        """

    def pareto_set(self) -> ParetoSet:
        """The non-dominated solutions kept so far; feasible ones if there are any, else the least violating.

        Raises:
            OptimizerError: No candidates are evaluated yet.
        """


@dataclass(frozen=True, eq=False)
class Archive:
    """At most ``capacity`` solutions, none of which dominates another.

    By the feasibility rules they are all feasible, or, as long as no feasible one is known, all of the same smallest total
    violation. Solutions with equal objectives but different x are kept side by side: they are different answers.
    """

    solutions: Solutions
    capacity: int

    def with_evaluated(self, evaluated: Solutions) -> "Archive":
        """The archive after new rows: dominated rows and repetitions of both x and objectives dropped, then thinned.

        Above capacity the most crowded solution (in objectives) is removed, one at a time, until the rest fits; so the
        ends of the front stay.
        """
        merged = self.non_dominated_with(evaluated)
        return Archive(merged.rows(least_crowded(merged.objectives, self.capacity)), self.capacity)

    def non_dominated_with(self, evaluated: Solutions) -> Solutions:
        """The archive after new rows, without a limit of capacity: none dominated, none repeated."""
        merged = self.solutions.followed_by(evaluated)
        merged = merged.rows(non_dominated_mask(merged.objectives, merged.total_violation))
        return merged.rows(first_occurrences(np.hstack([merged.objectives, merged.x])))

    @cached_property
    def crowding(self) -> FloatArray:
        """``(k,)`` crowding distance of each solution, infinite at the ends."""
        return crowding_distance(self.solutions.objectives)

    def leaders(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Decision vectors ``(count, d)``, each the less crowded of two drawn at random."""
        one, other = rng.integers(0, len(self.solutions), size=(2, count))
        less_crowded = np.where(self.crowding[one] >= self.crowding[other], one, other)
        return np.asarray(self.solutions.x[less_crowded])

    def pareto_set(self) -> ParetoSet:
        """Content of the archive, as a result."""
        return ParetoSet(**self.solutions.columns, feasible=not self.solutions.total_violation.any())


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """All x with ``lower <= x <= upper``; both ``(d,)``, read-only, finite. Equal ends fix a variable."""

    lower: FloatArray
    upper: FloatArray

    @classmethod
    def checked(cls, lower: npt.ArrayLike, upper: npt.ArrayLike) -> "Box":
        """A box from the caller's arrays.

        Raises:
            OptimizerError: The bounds are empty, of different length, not finite, or inverted.
        """
        low, high = finite_array(lower, "lower bounds"), finite_array(upper, "upper bounds")
        if low.ndim != 1 or low.size == 0 or low.shape != high.shape:
            raise OptimizerError(f"bounds have shapes {low.shape} and {high.shape}; use one entry per variable")
        inverted = np.flatnonzero(low > high)
        if inverted.size:
            j = int(inverted[0])
            raise OptimizerError(f"bounds of variable {j} are inverted: lower {low[j]} > upper {high[j]}; swap them")
        with np.errstate(over="ignore"):
            if not np.isfinite(high - low).all():
                raise OptimizerError("bounds are too far apart for floating point: upper - lower must be finite")
        return cls(read_only(low), read_only(high))

    @property
    def n_variables(self) -> int:
        """The number of variables, d."""
        return len(self.lower)

    def contains(self, x: FloatArray) -> bool:
        """Whether all rows of ``x`` ``(n, d)`` are inside."""
        return bool(((x >= self.lower) & (x <= self.upper)).all())

    def clipped(self, x: FloatArray) -> FloatArray:
        """``x`` ``(n, d)`` with every coordinate outside the box moved to the bound that it crossed."""
        return np.clip(x, self.lower, self.upper)

    def scaled(self, unit: FloatArray) -> FloatArray:
        """Points ``(n, d)`` of the unit cube stretched onto the box."""
        return self.clipped(self.lower + unit * (self.upper - self.lower))  # Eq. 19; clipped only against rounding

    def uniform(self, n: int, rng: np.random.Generator) -> FloatArray:
        """``(n, d)`` independent uniform samples."""
        return self.scaled(rng.random((n, self.n_variables)))

    def latin_hypercube(self, n: int, rng: np.random.Generator) -> FloatArray:
        """``(n, d)`` samples, exactly one in each of the n equal slices of every variable (McKay et al. 1979).

        Identical to ``scipy.stats.qmc.LatinHypercube``, whose import takes as long as a small plan.
        """
        own = np.random.default_rng(int(rng.integers(2**63))).spawn(1)[0]
        within = own.uniform(size=(n, self.n_variables))
        slices = np.tile(np.arange(1, n + 1), (self.n_variables, 1))
        for row in slices:
            own.shuffle(row)
        return self.scaled((slices.T - within) / n)


class AskTellOptimizer(AskAndTell, ABC):
    """An optimizer of a fixed number of rounds of one population each, with an external archive.

    Subclasses say what to propose and what to remember. Random numbers are drawn while asking, or while telling once
    all values have been checked.

    Args:
        lower: ``(d,)`` smallest allowed values, d = variables.
        upper: ``(d,)`` largest allowed values.
        n_objectives: m >= 1, and at most the algorithm's ``most_objectives``.
        n_constraints: c >= 0.
        population_size: n, the candidates of each round.
        max_iterations: rounds in all, so ``population_size * max_iterations`` evaluations.
        archive_size: most solutions to keep; the population size if None.
        seed: an integer >= 0 or a SeedSequence (which is not changed); each component gets its own stream from it.
        initial: ``(k, d)`` known starts inside the bounds, k <= n; they take the place of the first k samples.

    Raises:
        OptimizerError: An argument makes no sense; the message says which.
    """

    smallest_population: ClassVar[int] = 1
    most_objectives: ClassVar[int | None] = None  # no limit
    remembered: ClassVar[tuple[str, ...]] = ()  # arrays between rounds: "ranks" is the attribute _ranks
    _alive: Solutions  # the solutions between rounds of an algorithm that has some beside the archive

    def __init__(
        self,
        lower: npt.ArrayLike,
        upper: npt.ArrayLike,
        *,
        n_objectives: int,
        n_constraints: int = 0,
        population_size: int = 50,
        max_iterations: int = 500,
        archive_size: int | None = None,
        seed: int | np.random.SeedSequence,
        initial: npt.ArrayLike | None = None,
    ) -> None:
        self._box = Box.checked(lower, upper)
        self._n_objectives = _at_least(1, n_objectives, "n_objectives")
        if self.most_objectives is not None and self._n_objectives > self.most_objectives:
            raise OptimizerError(
                f"n_objectives is {n_objectives}, but {type(self).__name__} minimises at most "
                f"{self.most_objectives}; choose another algorithm"
            )
        self._n_constraints = _at_least(0, n_constraints, "n_constraints")
        self._population_size = _at_least(self.smallest_population, population_size, "population_size")
        self._max_iterations = _at_least(1, max_iterations, "max_iterations")
        capacity = population_size if archive_size is None else _at_least(1, archive_size, "archive_size")
        self._initial = self._checked_starts(initial)
        # Spawning from the caller's sequence would change it: what it generates seeds a sequence of our own.
        own = (
            seed.generate_state(8).tolist() if isinstance(seed, np.random.SeedSequence) else _at_least(0, seed, "seed")
        )
        sampling, moves = map(np.random.default_rng, np.random.SeedSequence(own).spawn(2))
        self._rngs = {"sampling": sampling, "moves": moves}
        self._iteration = 0
        self._asked: FloatArray | None = None
        nothing = Solutions.none(self._box.n_variables, self._n_objectives, self._n_constraints)
        self._archive = Archive(nothing, capacity)

    def _sample(self, rng: np.random.Generator) -> FloatArray:
        """The first population ``(n, d)``."""
        return self._box.uniform(self._population_size, rng)

    @abstractmethod
    def _move(self, rng: np.random.Generator) -> FloatArray:
        """The next candidates ``(n, d)``; those outside the bounds are clipped to them."""

    def _archive_with(self, evaluated: Solutions) -> Archive:
        """The archive after new rows; an algorithm that thins its archive in its own way overrides this."""
        return self._archive.with_evaluated(evaluated)

    def _learn(self, evaluated: Solutions) -> None:
        """Receive the values of the candidates proposed last, which the archive already has."""

    def _memory(self) -> dict[str, npt.NDArray[Any]]:
        """State of the algorithm between rounds; empty without state."""
        alive = self._alive.columns if hasattr(self, "_alive") else {}
        return alive | {name: getattr(self, f"_{name}") for name in self.remembered if hasattr(self, f"_{name}")}

    def _recall(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        """Restore the state from ``_memory``, unless that was empty."""
        if "x" in memory:
            self._alive = Solutions(memory.pop("x"), memory.pop("objectives"), memory.pop("violations"))
        for name, values in memory.items():
            setattr(self, f"_{name}", values)

    @property
    def iteration(self) -> int:
        """Rounds completed so far; it is t in the equations of the round that comes next."""
        return self._iteration

    @property
    def evaluations(self) -> int:
        """Number of candidates whose values are known so far."""
        return self._iteration * self._population_size

    @property
    def should_stop(self) -> bool:
        """True once all rounds are done."""
        return self._iteration >= self._max_iterations

    def ask(self) -> FloatArray:
        """See `AskAndTell.ask`: ``(n, d)`` read-only candidates inside the bounds."""
        if self._asked is None:
            if self.should_stop:
                raise OptimizerError(
                    f"ask: all {self._max_iterations} iterations are done; stop at should_stop, or raise max_iterations"
                )
            if self._iteration == 0:
                candidates = np.concatenate([self._initial, self._sample(self._rngs["sampling"])[len(self._initial) :]])
            else:
                candidates = self._move(self._rngs["moves"])
            self._asked = read_only(self._box.clipped(candidates))
        return self._asked

    def tell(self, objectives: npt.ArrayLike, violations: npt.ArrayLike | None = None) -> None:
        """See `AskAndTell.tell`: ``(n, m)`` objectives and ``(n, c)`` violations of the candidates asked last."""
        if self._asked is None:
            raise OptimizerError("tell: no candidates are open; call ask() first, and tell() once for each ask()")
        if violations is None and self._n_constraints > 0:
            raise OptimizerError(f"tell: violations are missing; use ({self._population_size}, {self._n_constraints})")
        violations = np.empty((self._population_size, 0)) if violations is None else violations
        evaluated = Solutions(
            self._asked,
            self._checked_values(objectives, "objectives", self._n_objectives),
            self._checked_values(violations, "violations", self._n_constraints),
        )
        self._archive = self._archive_with(evaluated)
        self._learn(evaluated)
        self._iteration += 1
        self._asked = None

    def pareto_set(self) -> ParetoSet:
        """See `AskAndTell.pareto_set`: what the archive holds."""
        if self._iteration == 0:
            raise OptimizerError("pareto_set: no candidates evaluated yet; complete one ask() and tell() first")
        return self._archive.pareto_set()

    def interim_set(self) -> ParetoSet:
        """Set to show between rounds: the `pareto_set`, or a similar set if choosing it is slow."""
        return self.pareto_set()

    def state_dict(self) -> State:
        """Everything needed to continue later, including random streams: dicts, numbers, strings and copied arrays."""
        return {
            "algorithm": type(self).__name__,
            "settings": {
                "lower": self._box.lower.copy(),
                "upper": self._box.upper.copy(),
                "n_objectives": self._n_objectives,
                "n_constraints": self._n_constraints,
                "population_size": self._population_size,
                "max_iterations": self._max_iterations,
                "archive_size": self._archive.capacity,
                "initial": self._initial.copy(),
            },
            "iteration": self._iteration,
            "streams": {name: rng.bit_generator.state for name, rng in self._rngs.items()},
            "asked": None if self._asked is None else self._asked.copy(),
            "archive": {name: values.copy() for name, values in self._archive.solutions.columns.items()},
            "memory": {name: values.copy() for name, values in self._memory().items()},
        }

    @classmethod
    def from_state(cls, state: State) -> Self:
        """The optimizer that ``state_dict`` described; it continues exactly like the saved one.

        Raises:
            OptimizerError: The state belongs to another algorithm.
        """
        saved: dict[str, Any] = state
        if saved.get("algorithm") != cls.__name__:
            raise OptimizerError(f"state: saved by {saved.get('algorithm')!r}, so {cls.__name__!r} cannot load it")
        optimizer = cls(**saved["settings"], seed=0)
        for name, rng in optimizer._rngs.items():
            rng.bit_generator.state = saved["streams"][name]
        optimizer._iteration = saved["iteration"]
        optimizer._asked = None if saved["asked"] is None else read_only(saved["asked"].copy())
        best = Solutions(**{name: values.copy() for name, values in saved["archive"].items()})
        optimizer._archive = Archive(best, saved["settings"]["archive_size"])
        if saved["memory"]:
            optimizer._recall({name: values.copy() for name, values in saved["memory"].items()})
        return optimizer

    def _checked_starts(self, initial: npt.ArrayLike | None) -> FloatArray:
        d = self._box.n_variables
        starts = finite_array(np.empty((0, d)) if initial is None else initial, "initial")
        if starts.ndim != 2 or starts.shape[1] != d or len(starts) > self._population_size:
            raise OptimizerError(
                f"initial: the shape is {starts.shape}; use (k, {d}) with k <= population_size = {self._population_size}"
            )
        if not self._box.contains(starts):
            raise OptimizerError("initial: a start lies outside the bounds; move it inside, or widen the bounds")
        return starts

    def _checked_values(self, values: npt.ArrayLike, name: str, width: int) -> FloatArray:
        array = finite_array(values, f"tell: {name}")
        expected = (self._population_size, width)
        if array.shape != expected:
            raise OptimizerError(f"tell: {name} have shape {array.shape}; use {expected}, with one row per candidate")
        return array


def _at_least(smallest: int, value: int, name: str) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < smallest:
        raise OptimizerError(f"{name} is {value!r}; use a whole number >= {smallest}")
    return int(value)

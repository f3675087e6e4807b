"""Algorithms of pymoo behind our ask and tell: NSGA-II and MOEA/D with the paper's parameters, and any other.

`pymoo_algorithm` finds one by name and `adapted` gives it its usual parameters; a subclass of `PymooOptimizer` of three
lines builds it otherwise. `spread_weights` makes the weight vectors that decomposition needs. pymoo is imported when such
an algorithm is built or asked for by name, not before. The other direction, our algorithms in ``pymoo.optimize.minimize``,
is `uavcover.optimizers.pymoo.algorithm`.
"""

import importlib
import inspect
import io
import pickle
import pkgutil
import sys
from abc import abstractmethod
from functools import partial
from itertools import combinations
from math import comb
from types import FunctionType
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from uavcover.errors import OptimizerError
from uavcover.kernels.arrays import FloatArray
from uavcover.optimizers.ask_tell import Archive, AskTellOptimizer, ParetoSet, Solutions


def pymoo_missing(what: str, reason: ImportError) -> OptimizerError:
    """The error to raise when ``what`` cannot import pymoo.

    >>> print(pymoo_missing("NSGA2", ImportError("No module named 'pymoo'")))
    NSGA2 requires pymoo (No module named 'pymoo'); install it with: pip install pymoo
    """
    return OptimizerError(f"{what} requires pymoo ({reason}); install it with: pip install pymoo")


def spread_weights(n: int, m: int) -> FloatArray:
    """Weight vectors ``(n, m)`` spread over the simplex, for any n: rows sum to 1, the corners come first.

    Two objectives: evenly spaced. More: from a Das-Dennis lattice of at least 20 n points (n <= 20 n always leaves a choice)
    the corners, then always the point farthest from all chosen ones.

    >>> spread_weights(3, 2).tolist()
    [[1.0, 0.0], [0.5, 0.5], [0.0, 1.0]]
    """
    if m == 1:
        return np.ones((n, 1))
    if m == 2:
        fraction = np.linspace(1.0, 0.0, n)
        return np.column_stack([fraction, 1.0 - fraction])
    divisions = 1
    while comb(divisions + m - 1, m - 1) < 20 * n:
        divisions += 1
    # stars and bars: the gaps between m - 1 bars are the parts of a sum
    bars = np.array(list(combinations(range(divisions + m - 1), m - 1)))
    ends = np.column_stack([np.full(len(bars), -1), bars, np.full(len(bars), divisions + m - 1)])
    lattice = (np.diff(ends, axis=1) - 1) / divisions
    chosen = np.flatnonzero(lattice.max(axis=1) == 1.0)[:n].tolist()
    nearest = np.min([np.linalg.norm(lattice - lattice[i], axis=1) for i in chosen], axis=0)
    while len(chosen) < n:
        chosen.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, np.linalg.norm(lattice - lattice[chosen[-1]], axis=1))
    picked: FloatArray = lattice[chosen]
    return picked


class PymooOptimizer(AskTellOptimizer):
    """A pymoo algorithm that proposes one population per round; arguments as `AskTellOptimizer`.

    A subclass builds the algorithm:

        class SmsEmoa(PymooOptimizer):
            def _build(self):
                return SMSEMOA(pop_size=self._population_size)

    The result is our external archive, unless a subclass says otherwise. Should pymoo propose fewer candidates than the
    population has (it gives up when it only finds duplicates), uniform samples fill the round.

    The saved state holds the pymoo algorithm pickled, as bytes: load only states that you trust. If what you build cannot be
    pickled (it holds a lambda), saving raises an OptimizerError, and nothing else is affected.
    """

    knows_constraints: ClassVar[bool] = True  # False: pymoo's algorithm refuses them and gets the total violation only

    _algorithm: Any = None
    _pending: Any = None  # the pymoo population asked last
    _pickled: npt.NDArray[np.uint8] | None = None  # the state, until something moves

    @abstractmethod
    def _build(self) -> Any:
        """The pymoo algorithm, for ``self._population_size`` candidates per round."""

    def _sample(self, rng: np.random.Generator) -> FloatArray:
        self._algorithm = self._set_up()
        return self._proposed(rng)

    def _move(self, rng: np.random.Generator) -> FloatArray:
        return self._proposed(rng)

    def _set_up(self) -> Any:
        try:
            from pymoo.core.problem import Problem
            from pymoo.termination.max_gen import MaximumGenerationTermination
        except ImportError as error:
            raise pymoo_missing(type(self).__name__, error) from error
        problem = Problem(
            n_var=self._box.n_variables,
            n_obj=self._n_objectives,
            n_ieq_constr=self._n_constraints if self.knows_constraints else 0,
            xl=self._box.lower.copy(),
            xu=self._box.upper.copy(),
        )
        # we decide the end; some algorithms (RVEA) adapt to the number of generations
        termination = MaximumGenerationTermination(self._max_iterations)
        # the seed is replaced by our own stream before anything is drawn
        return self._build().setup(problem, termination=termination, seed=0, output=None)

    def _proposed(self, rng: np.random.Generator) -> FloatArray:
        from pymoo.core.population import Population

        n, algorithm = self._population_size, self._algorithm
        algorithm.random_state = rng
        offered = algorithm.infill()
        if offered is None:
            offered = Population.empty()
        if len(offered) > n:
            raise OptimizerError(
                f"{type(algorithm).__name__} proposed {len(offered)} candidates for a population of {n}; build it "
                "with as many offspring as the population size"
            )
        if len(offered) < n:
            offered = Population.merge(offered, Population.new("X", self._box.uniform(n - len(offered), rng)))
        self._pending, self._pickled = offered, None
        x: FloatArray = np.array(offered.get("X"), dtype=np.float64)
        return x

    def _learn(self, evaluated: Solutions) -> None:
        pending = self._pending
        pending.set("X", evaluated.x.copy())  # a known start may replace a sample
        pending.set("F", evaluated.objectives.copy())
        if self.knows_constraints:
            pending.set("G", evaluated.violations.copy())
        else:
            pending.set("total_violation", evaluated.total_violation.copy())
        for individual in pending:
            individual.evaluated.update(("F", "G", "H"))
        self._algorithm.random_state = self._rngs["moves"]
        self._algorithm.advance(infills=pending)
        self._pending = self._pickled = None

    def _memory(self) -> dict[str, npt.NDArray[Any]]:
        if self._algorithm is None:
            return {}
        if self._pickled is None:
            algorithm, stream = self._algorithm, self._algorithm.random_state
            algorithm.random_state = None  # the streams are saved with all others
            try:
                self._pickled = np.frombuffer(_as_bytes((algorithm, self._pending)), np.uint8)
            except (pickle.PicklingError, AttributeError, TypeError) as error:
                raise OptimizerError(
                    f"state: {type(algorithm).__name__} of pymoo cannot be pickled ({error}); run it without interruption"
                ) from error
            finally:
                algorithm.random_state = stream
        return {"pickled": self._pickled}

    def _recall(self, memory: dict[str, npt.NDArray[Any]]) -> None:
        if "pickled" in memory:
            self._algorithm, self._pending = pickle.loads(memory["pickled"].tobytes())
            self._pickled = memory["pickled"]


class NSGA2(PymooOptimizer):
    """pymoo's NSGA-II (Deb et al. 2002) with the probabilities of Table 2.

    As published it has no archive: the result is the best front of its population.
    """

    crossover_probability: ClassVar[float] = 0.8  # Pc, Table 2
    mutation_probability: ClassVar[float] = 0.1  # Pr, Table 2: of each variable

    def _build(self) -> Any:
        from pymoo.algorithms.moo import nsga2
        from pymoo.operators.crossover.sbx import SBX
        from pymoo.operators.mutation.pm import PM

        return nsga2.NSGA2(
            pop_size=self._population_size,
            crossover=SBX(prob=self.crossover_probability, eta=15),
            mutation=PM(prob=1.0, prob_var=self.mutation_probability, eta=20),
        )

    def pareto_set(self) -> ParetoSet:
        """See `AskAndTell.pareto_set`: the best front of the population, at most ``archive_size`` of it."""
        if self._iteration == 0:
            return super().pareto_set()
        alive = Solutions(*self._algorithm.pop.get("X", "F", "G"))
        nothing = Solutions.none(self._box.n_variables, self._n_objectives, self._n_constraints)
        return Archive(nothing, self._archive.capacity).with_evaluated(alive).pareto_set()


class MOEAD(PymooOptimizer):
    """pymoo's MOEA/D (Zhang and Li 2007), generation by generation, with the parameters of Table 2.

    pymoo has no n_r and no constraints: the replacement is `_replace_neighbours`. The objectives are compared as they are: bring
    them to comparable scale.
    """

    smallest_population: ClassVar[int] = 2
    knows_constraints: ClassVar[bool] = False
    neighbourhood_fraction: ClassVar[float] = 0.1  # T, Table 2
    replaced_fraction: ClassVar[float] = 0.01  # n_r, Table 2
    neighbour_mating_probability: ClassVar[float] = 0.9  # delta, Table 2
    distribution_index: ClassVar[int] = 30  # eta, Table 2

    def _build(self) -> Any:
        from pymoo.algorithms.moo.moead import ParallelMOEAD
        from pymoo.operators.crossover.sbx import SBX
        from pymoo.operators.mutation.pm import PM

        n = self._population_size
        built = ParallelMOEAD(
            spread_weights(n, self._n_objectives),
            n_neighbors=max(2, round(self.neighbourhood_fraction * n)),
            prob_neighbor_mating=self.neighbour_mating_probability,
            crossover=SBX(prob=1.0, eta=self.distribution_index),
            mutation=PM(prob_var=None, eta=self.distribution_index),
        )
        built._advance = partial(_replace_neighbours, built, max(1, round(self.replaced_fraction * n)))
        return built


def _replace_neighbours(moead: Any, n_replaced: int, infills: Any = None, **_: Any) -> None:
    """Replace members of a whole generation by its children, in place of `ParallelMOEAD._advance`.

    A child replaces at most ``n_replaced`` of its neighbours, in random order (Li and Zhang 2009). Less total violation is
    better than a better scalar value, as everywhere here.
    """
    moead.ideal = np.minimum(moead.ideal, infills.get("F").min(axis=0))
    # arrays beside the population, because reading one row at a time out of it takes most of the run
    objectives, violations = moead.pop.get("F", "total_violation")
    for k, child in zip(moead.indices, infills, strict=True):
        near = moead.random_state.permutation(moead.neighbors[k])
        weights, violation = moead.ref_dirs[near], child.get("total_violation")
        now, then = np.split(
            moead.decomposition.do(
                np.concatenate([objectives[near], np.tile(child.F, (len(near), 1))]),
                weights=np.concatenate([weights, weights]),
                ideal_point=moead.ideal,
                _type="one_to_one",
            ),
            2,
        )
        better = np.where(violations[near] == violation, then < now, violation < violations[near])
        replaced = near[better][:n_replaced]
        moead.pop[replaced] = child
        objectives[replaced], violations[replaced] = child.F, violation


def pymoo_algorithm(name: str) -> type:
    """A multi-objective algorithm of pymoo by the name of its class, as NSGA3 or SMSEMOA, in any case.

    Raises:
        OptimizerError: pymoo is not installed, or has no algorithm of this name.
    """
    try:
        from pymoo.algorithms import moo
        from pymoo.core.algorithm import Algorithm
    except ImportError as error:
        raise pymoo_missing(f"pymoo:{name}", error) from error
    found: dict[str, type] = {}
    for entry in pkgutil.iter_modules(moo.__path__):
        try:
            module = importlib.import_module(f"{moo.__name__}.{entry.name}")
        except ImportError:  # an algorithm whose own dependencies are not installed
            continue
        found |= {
            key: value
            for key, value in vars(module).items()
            if inspect.isclass(value) and issubclass(value, Algorithm) and value.__module__ == module.__name__
        }
    for key, value in found.items():
        if key.lower() == name.lower():
            return value
    raise OptimizerError(f"algorithm 'pymoo:{name}': unknown to pymoo; choose one of {', '.join(sorted(found))}")


def adapted(algorithm: type) -> type[PymooOptimizer]:
    """A pymoo algorithm as one of our optimizers, with pymoo's own parameters, for a population of any size.

    Args:
        algorithm: a subclass of pymoo's ``Algorithm`` that proposes a whole population in every round. It is given ``pop_size``,
            and ``ref_dirs`` by `spread_weights` if it takes them.

    Raises:
        OptimizerError: it needs other arguments, or proposes one candidate at a time.
    """
    from pymoo.algorithms.moo.moead import MOEAD as PYMOO_MOEAD
    from pymoo.core.algorithm import LoopwiseAlgorithm

    parameters = inspect.signature(algorithm).parameters
    named = f"pymoo's {algorithm.__name__}"
    missing = [
        name
        for name, parameter in parameters.items()
        if parameter.default is parameter.empty
        and parameter.kind not in (parameter.VAR_KEYWORD, parameter.VAR_POSITIONAL)
        and name not in ("ref_dirs", "pop_size")
    ]
    if missing:
        raise OptimizerError(
            f"{named} requires {', '.join(missing)}; write a subclass of PymooOptimizer that builds it "
            "(docs/reference/optimizers.md)"
        )
    if getattr(algorithm, "_infill", None) is LoopwiseAlgorithm._infill:
        raise OptimizerError(f"{named} proposes one candidate at a time; choose one that proposes a population")
    weighted = "ref_dirs" in parameters
    # A class that takes weights has as many candidates as these, unless it asks for the number too.
    sized = "pop_size" in parameters or not weighted

    def build(self: PymooOptimizer) -> Any:
        settings: dict[str, Any] = {"pop_size": self._population_size} if sized else {}
        if weighted:
            settings["ref_dirs"] = spread_weights(self._population_size, self._n_objectives)
        return algorithm(**settings)

    members = {
        "__doc__": f"{named}, with its own parameters.",
        "__module__": __name__,
        "_build": build,
        "knows_constraints": not issubclass(algorithm, PYMOO_MOEAD),
        "most_objectives": 1 if algorithm.__module__.startswith("pymoo.algorithms.soo") else None,
    }
    return type(algorithm.__name__, (PymooOptimizer,), members)


def _as_bytes(value: object) -> bytes:
    """``value`` as bytes, for ``pickle.loads``; it also finds functions whose names pymoo's decorators hide.

    Raises:
        pickle.PicklingError, AttributeError, TypeError: Something in it cannot be pickled.
    """
    buffer = io.BytesIO()
    _Pickler(buffer).dump(value)
    return buffer.getvalue()


class _Pickler(pickle.Pickler):
    def reducer_override(self, obj: Any) -> Any:
        # A decorator without functools.wraps leaves the name of its own inner function on what is a module's public one.
        if isinstance(obj, FunctionType) and "<locals>" in obj.__qualname__:
            for module_name, module in list(sys.modules.items()):
                if module_name.startswith("pymoo."):
                    for name, value in vars(module).items():
                        if value is obj:
                            return _member, (module_name, name)
        return NotImplemented


def _member(module_name: str, name: str) -> Any:
    return getattr(importlib.import_module(module_name), name)

"""Guards an optimizer that is not ours: checks what it proposes, counts, and keeps the best in our archive."""

import os
import traceback
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from uavcover.errors import OptimizerError, UavcoverError
from uavcover.kernels.arrays import FloatArray
from uavcover.optimizers.archive import Archive
from uavcover.optimizers.ask_tell import Box
from uavcover.optimizers.interface import ParetoSet, Solutions, finite_array, read_only

Returned = TypeVar("Returned")


class GuardedOptimizer:
    """An optimizer with ``ask`` and ``tell`` from anywhere, offered as `AskAndTell`.

    Every candidate must be finite and inside the bounds, and a round must have at most ``population_size`` of them. The
    search ends when another round like the last one would exceed ``population_size * max_iterations`` evaluations, or before
    if the optimizer says ``should_stop``. The result is its own ``pareto_set()`` if it has one, else the best of all
    candidates, kept in our external archive.

    Args:
        algorithm: class with ``ask()`` and ``tell(objectives, violations)``.
        name: for error lines.
        lower: ``(d,)`` smallest allowed values.
        upper: ``(d,)`` largest allowed values.
        **settings: the keyword arguments of `AskTellOptimizer`, handed on as they are.

    Raises:
        OptimizerError: the class cannot be built with these, or does not keep to the rules above; names it and the method.
    """

    def __init__(self, algorithm: type, name: str, lower: npt.ArrayLike, upper: npt.ArrayLike, **settings: Any) -> None:
        self._name = name
        self._box = Box.checked(lower, upper)
        self._n_objectives = int(settings["n_objectives"])
        self._n_constraints = int(settings.get("n_constraints", 0))
        self._population_size = int(settings["population_size"])
        self._most_evaluations = self._population_size * int(settings["max_iterations"])
        everything = {"n_constraints": 0, "archive_size": None, "initial": None} | settings
        copies = self._box.lower.copy(), self._box.upper.copy()
        self._optimizer: Any = self._called("__init__", lambda: algorithm(*copies, **everything))
        nothing = Solutions.none(self._box.n_variables, self._n_objectives, self._n_constraints)
        self._archive = Archive(nothing, everything["archive_size"] or self._population_size)
        self._asked: FloatArray | None = None
        self._iteration = self._evaluations = self._last_round = 0

    @property
    def iteration(self) -> int:
        """Rounds completed so far."""
        return self._iteration

    @property
    def evaluations(self) -> int:
        """Candidates whose values have been told so far."""
        return self._evaluations

    @property
    def should_stop(self) -> bool:
        """True once the evaluations left are too few for a round like the last one, or the optimizer says so itself."""
        if self._evaluations + max(1, self._last_round) > self._most_evaluations:
            return True
        return self._iteration > 0 and self._called("should_stop", self._says_stop)

    def ask(self) -> FloatArray:
        """See `Optimizer.ask`: ``(n, d)`` read-only candidates inside the bounds, n <= population size."""
        if self._asked is None:
            x = finite_array(self._called("ask", lambda: self._optimizer.ask()), f"{self._name}.ask()")
            d = self._box.n_variables
            if x.ndim != 2 or x.shape[1] != d or not 1 <= len(x) <= self._population_size:
                raise OptimizerError(
                    f"{self._name}.ask(): shape {x.shape}: return (n, {d}) with 1 <= n <= population_size = "
                    f"{self._population_size}"
                )
            if not self._box.contains(x):
                row, column = (int(k[0]) for k in np.nonzero((x < self._box.lower) | (x > self._box.upper)))
                raise OptimizerError(
                    f"{self._name}.ask(): entry ({row}, {column}) is {x[row, column]:g}, outside "
                    f"[{self._box.lower[column]:g}, {self._box.upper[column]:g}]: keep candidates inside lower and upper"
                )
            self._asked = read_only(x)
        return self._asked

    def tell(self, objectives: npt.ArrayLike, violations: npt.ArrayLike | None = None) -> None:
        """See `Optimizer.tell`; the optimizer is always given violations, ``(n, c)``."""
        if self._asked is None:
            raise OptimizerError("tell: nothing was asked: call ask() first, and tell once for each ask")
        n = len(self._asked)
        values = finite_array(objectives, "tell: objectives")
        broken = np.empty((n, 0)) if violations is None else finite_array(violations, "tell: violations")
        for what, array, width in (
            ("objectives", values, self._n_objectives),
            ("violations", broken, self._n_constraints),
        ):
            if array.shape != (n, width):
                raise OptimizerError(f"tell: {what} have shape {array.shape}: give {(n, width)}, a row per candidate")
        self._called("tell", lambda: self._optimizer.tell(values.copy(), broken.copy()))
        self._archive = self._archive.with_told(Solutions(self._asked, values, broken))
        self._iteration += 1
        self._evaluations += n
        self._last_round = n
        self._asked = None

    def pareto_set(self) -> ParetoSet:
        """See `Optimizer.pareto_set`: what the optimizer says, or our archive if it says nothing."""
        if self._iteration == 0:
            raise OptimizerError("pareto_set: nothing has been told yet: complete one ask and tell first")
        if not hasattr(self._optimizer, "pareto_set"):
            return self._archive.pareto_set()
        found = self._called("pareto_set", lambda: self._optimizer.pareto_set())
        columns: list[FloatArray] = []
        widths = (self._box.n_variables, self._n_objectives, self._n_constraints)
        for what, width in zip(("x", "objectives", "violations"), widths, strict=True):
            if not hasattr(found, what):
                raise OptimizerError(
                    f"{self._name}.pareto_set(): has no {what}: return a uavcover.optimizers.ParetoSet"
                )
            array = finite_array(getattr(found, what), f"{self._name}.pareto_set().{what}")
            rows = len(columns[0]) if columns else max(1, len(array))
            if array.shape != (rows, width):
                raise OptimizerError(f"{self._name}.pareto_set().{what}: shape {array.shape}: return {(rows, width)}")
            columns.append(read_only(array))
        if not self._box.contains(columns[0]):
            raise OptimizerError(f"{self._name}.pareto_set().x: a row is outside the bounds: return what was asked")
        x, values, violations = columns
        return ParetoSet(x, values, violations, feasible=not (violations > 0.0).any())

    def _says_stop(self) -> bool:
        said = getattr(self._optimizer, "should_stop", False)
        return bool(said() if callable(said) else said)

    def _called(self, method: str, call: Callable[[], Returned]) -> Returned:
        try:
            return call()
        except UavcoverError:
            raise
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            raise OptimizerError(
                f"{self._name}: {method} fails: {type(error).__name__}: {error} ({os.path.basename(place.filename)}, "
                f"line {place.lineno}): correct the class, or choose another algorithm"
            ) from error

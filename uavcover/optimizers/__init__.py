"""Multi-objective optimizers with ask and tell, by name: ours, pymoo's, or any class as ``module:Class``.

They handle boxes, objectives and constraints, and know nothing of UAVs. An optimizer from elsewhere is guarded: its proposals are
checked and counted, and our archive keeps the best.
"""

import importlib
import inspect
import os
import sys
import traceback
from collections.abc import Callable
from types import MappingProxyType, ModuleType
from typing import Any, Final, TypeVar

import numpy as np
import numpy.typing as npt

from uavcover.errors import InputError, OptimizerError, UavcoverError
from uavcover.kernels.arrays import FloatArray, read_only
from uavcover.optimizers.ask_tell import Archive, AskAndTell, AskTellOptimizer, Box, ParetoSet, Solutions, finite_array
from uavcover.optimizers.imodbo import (
    DBO,
    IMODBO,
    MODBO,
    ImodboMinusDynamicParameters,
    ImodboMinusLatinHypercube,
    ImodboMinusSineCosine,
    ImodboOwnBest,
    ModboOwnBest,
    ModboPlusDynamicParameters,
    ModboPlusLatinHypercube,
    ModboPlusSineCosine,
)
from uavcover.optimizers.imodbo_niching import ImodboNiching
from uavcover.optimizers.pymoo.adapters import MOEAD, NSGA2, adapted, pymoo_algorithm
from uavcover.optimizers.rivals import MOGWO, MOSSA, MOWOA, RandomSearch
from uavcover.plugins import load, registered

__all__ = [
    "ALGORITHMS",
    "DBO",
    "IMODBO",
    "MODBO",
    "MOEAD",
    "MOGWO",
    "MOSSA",
    "MOWOA",
    "NSGA2",
    "AskAndTell",
    "AskTellOptimizer",
    "ImodboNiching",
    "ParetoSet",
    "RandomSearch",
    "make_optimizer",
    "optimizer_class",
    "optimizer_name",
]

Returned = TypeVar("Returned")


class GuardedOptimizer:
    """An optimizer with ``ask`` and ``tell`` from elsewhere, as `AskAndTell`.

    Every candidate must be finite and inside the bounds, and a round has at most ``population_size`` of them. The search ends
    when another round like the last one would exceed ``population_size * max_iterations`` evaluations, or when the optimizer says
    ``should_stop``. The result is its own ``pareto_set()`` if it has one, otherwise the best of all candidates, from our external
    archive.

    Args:
        algorithm: class with ``ask()`` and ``tell(objectives, violations)``.
        name: for error messages.
        lower: ``(d,)`` smallest allowed values.
        upper: ``(d,)`` largest allowed values.
        **settings: the keyword arguments of `AskTellOptimizer`, passed on unchanged.

    Raises:
        OptimizerError: the class cannot be built with these, or breaks the rules above; names it and the method.
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
        """Number of candidates whose values are known so far."""
        return self._evaluations

    @property
    def should_stop(self) -> bool:
        """True once too few evaluations are left for a round like the last one, or the optimizer itself stops."""
        if self._evaluations + max(1, self._last_round) > self._most_evaluations:
            return True
        return self._iteration > 0 and self._called("should_stop", self._says_stop)

    def ask(self) -> FloatArray:
        """See `AskAndTell.ask`: ``(n, d)`` read-only candidates inside the bounds, n <= population size."""
        if self._asked is None:
            x = finite_array(self._called("ask", lambda: self._optimizer.ask()), f"{self._name}.ask()")
            d = self._box.n_variables
            if x.ndim != 2 or x.shape[1] != d or not 1 <= len(x) <= self._population_size:
                raise OptimizerError(
                    f"{self._name}.ask(): the shape is {x.shape}; return (n, {d}) with 1 <= n <= population_size = "
                    f"{self._population_size}"
                )
            if not self._box.contains(x):
                row, column = (int(k[0]) for k in np.nonzero((x < self._box.lower) | (x > self._box.upper)))
                raise OptimizerError(
                    f"{self._name}.ask(): entry ({row}, {column}) is {x[row, column]:g}, outside "
                    f"[{self._box.lower[column]:g}, {self._box.upper[column]:g}]; keep candidates in bounds"
                )
            self._asked = read_only(x)
        return self._asked

    def tell(self, objectives: npt.ArrayLike, violations: npt.ArrayLike | None = None) -> None:
        """See `AskAndTell.tell`; the optimizer always receives violations, ``(n, c)``."""
        if self._asked is None:
            raise OptimizerError("tell: no candidates are open; call ask() first, and tell() once for each ask()")
        n = len(self._asked)
        values = finite_array(objectives, "tell: objectives")
        broken = np.empty((n, 0)) if violations is None else finite_array(violations, "tell: violations")
        for what, array, width in (
            ("objectives", values, self._n_objectives),
            ("violations", broken, self._n_constraints),
        ):
            if array.shape != (n, width):
                raise OptimizerError(f"tell: {what} have shape {array.shape}; use {(n, width)}, one row per candidate")
        self._called("tell", lambda: self._optimizer.tell(values.copy(), broken.copy()))
        self._archive = self._archive.with_evaluated(Solutions(self._asked, values, broken))
        self._iteration += 1
        self._evaluations += n
        self._last_round = n
        self._asked = None

    def pareto_set(self) -> ParetoSet:
        """See `AskAndTell.pareto_set`: the optimizer's own set, or our archive."""
        if self._iteration == 0:
            raise OptimizerError("pareto_set: no candidates evaluated yet; complete one ask() and tell() first")
        if not hasattr(self._optimizer, "pareto_set"):
            return self._archive.pareto_set()
        found = self._called("pareto_set", lambda: self._optimizer.pareto_set())
        columns: list[FloatArray] = []
        widths = (self._box.n_variables, self._n_objectives, self._n_constraints)
        for what, width in zip(("x", "objectives", "violations"), widths, strict=True):
            if not hasattr(found, what):
                raise OptimizerError(f"{self._name}.pareto_set(): no {what}; return a uavcover.optimizers.ParetoSet")
            array = finite_array(getattr(found, what), f"{self._name}.pareto_set().{what}")
            rows = len(columns[0]) if columns else max(1, len(array))
            if array.shape != (rows, width):
                raise OptimizerError(f"{self._name}.pareto_set().{what}: shape {array.shape}, not {(rows, width)}")
            columns.append(read_only(array))
        if not self._box.contains(columns[0]):
            raise OptimizerError(f"{self._name}.pareto_set().x: a row is outside the bounds; return rows of ask()")
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
            position = traceback.extract_tb(error.__traceback__)[-1]
            raise OptimizerError(
                f"{self._name}: {method} fails: {type(error).__name__}: {error} ({os.path.basename(position.filename)}, "
                f"line {position.lineno}); correct the class, or choose another algorithm"
            ) from error


ALGORITHMS: Final = MappingProxyType[str, type[AskTellOptimizer]](
    {
        "imodbo": IMODBO,
        "imodbo-niching": ImodboNiching,
        "modbo": MODBO,
        "dbo": DBO,
        "mogwo": MOGWO,
        "mossa": MOSSA,
        "mowoa": MOWOA,
        "nsga2": NSGA2,
        "moead": MOEAD,
        "random": RandomSearch,
        "modbo+lhs": ModboPlusLatinHypercube,
        "modbo+dynamic": ModboPlusDynamicParameters,
        "modbo+sine-cosine": ModboPlusSineCosine,
        "imodbo-lhs": ImodboMinusLatinHypercube,
        "imodbo-dynamic": ImodboMinusDynamicParameters,
        "imodbo-sine-cosine": ImodboMinusSineCosine,
        "modbo+own-best": ModboOwnBest,
        "imodbo+own-best": ImodboOwnBest,
    }
)
"""Every algorithm and variant by its name, all built with the same arguments; ``dbo`` takes one objective only.

``imodbo-niching`` takes one argument more, ``local_sets_wanted``, which may be omitted.
"""

_SETTINGS = ("n_objectives", "n_constraints", "population_size", "max_iterations", "archive_size", "seed", "initial")
"""Keyword arguments that every class is built with, after the bounds."""


def optimizer_class(algorithm: str | type) -> type:
    """The class of an algorithm's name.

    Args:
        algorithm: a key of `ALGORITHMS`; ``module:Class``, where the module may be a file in the current folder; ``pymoo:NSGA3``
            for a multi-objective algorithm of pymoo, which is adapted; or the class itself.

    Returns:
        A class with ``ask`` and ``tell`` that takes the arguments of `AskTellOptimizer`; build it with `make_optimizer`.

    Raises:
        OptimizerError: the name, module or class does not exist, importing the module fails, or the class is not an optimizer.
    """
    if isinstance(algorithm, str):
        if algorithm in ALGORITHMS:
            return ALGORITHMS[algorithm]
        found = _imported(algorithm)
    else:
        found = algorithm
    name = optimizer_name(algorithm)
    if not inspect.isclass(found):
        raise OptimizerError(f"algorithm {name!r}: {found!r} is not a class; name a class with ask() and tell()")
    if _is_pymoo(found):
        return adapted(found)
    lacking = [f"{method}()" for method in ("ask", "tell") if not callable(getattr(found, method, None))]
    if lacking:
        raise OptimizerError(
            f"algorithm {name!r}: class {found.__name__} has no {' and no '.join(lacking)}; implement them "
            "(docs/reference/optimizers.md)"
        )
    if inspect.isabstract(found):
        unwritten = ", ".join(sorted(f"{method}()" for method in getattr(found, "__abstractmethods__", ())))
        raise OptimizerError(f"algorithm {name!r}: class {found.__name__} is abstract; implement {unwritten}")
    _check_arguments(found, name)
    return found


def optimizer_name(algorithm: str | type) -> str:
    """Name of an algorithm in results: its own, or ``module:Class``."""
    return algorithm if isinstance(algorithm, str) else f"{algorithm.__module__}:{algorithm.__qualname__}"


def make_optimizer(
    algorithm: str | type, lower: npt.ArrayLike, upper: npt.ArrayLike, **settings: Any
) -> AskTellOptimizer | AskAndTell:
    """A new optimizer. Classes from elsewhere are guarded: see `GuardedOptimizer`.

    Args:
        algorithm: as for `optimizer_class`.
        lower: ``(d,)`` smallest allowed values.
        upper: ``(d,)`` largest allowed values.
        **settings: the keyword arguments of `AskTellOptimizer`.

    Raises:
        OptimizerError: it cannot be found, is not an optimizer, or refuses these settings.
    """
    found = optimizer_class(algorithm)
    if found in ALGORITHMS.values():
        ours: AskTellOptimizer = found(lower, upper, **settings)
        return ours
    return GuardedOptimizer(found, optimizer_name(algorithm), lower, upper, **settings)


def _imported(name: str) -> object:
    module_name, colon, class_name = name.partition(":")
    if not colon and name in registered("uavcover.algorithms"):
        try:
            return load("uavcover.algorithms", name)
        except InputError as error:
            raise OptimizerError(f"algorithm {error}") from error
    if not colon:
        raise OptimizerError(f"unknown algorithm {name!r}; use {', '.join(ALGORITHMS)} or a class as module:Class")
    parts = [*module_name.split("."), *class_name.split(".")]
    if not all(part.isidentifier() for part in parts):
        raise OptimizerError(f"algorithm {name!r}: write module:Class, such as my_search:MySearch")
    if module_name == "pymoo":
        return pymoo_algorithm(class_name)
    found: object = _module(module_name, name)
    for part in class_name.split("."):
        if not hasattr(found, part):
            raise OptimizerError(f"algorithm {name!r}: {module_name!r} has no {class_name}{_classes_in(found)}")
        found = getattr(found, part)
    return found


def _module(module_name: str, name: str) -> ModuleType:
    here = os.getcwd()
    if here not in sys.path and "" not in sys.path:
        sys.path.insert(0, here)  # as python -m, so that later imports of the module are found, too
        importlib.invalidate_caches()
    try:
        return importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        if error.name is not None and f"{module_name}.".startswith(f"{error.name}."):
            raise OptimizerError(
                f"algorithm {name!r}: cannot find the module {error.name!r}; run the command in the folder of "
                f"{error.name}.py, or install the module"
            ) from None
        raise OptimizerError(f"algorithm {name!r}: importing {module_name!r} fails: {error}") from error
    except (Exception, SystemExit) as error:
        # A class in a script without a main guard ends the program when it is imported.
        raise OptimizerError(
            f"algorithm {name!r}: importing {module_name!r} fails: {type(error).__name__}: {_position(error)}{error}"
        ) from error


def _position(error: BaseException) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if not frame.filename.startswith("<") and frame.filename != __file__]
    return f"{os.path.basename(own[-1].filename)}, line {own[-1].lineno}: " if own else ""


def _classes_in(found: object) -> str:
    usable = [
        key
        for key, value in vars(found).items()
        if inspect.isclass(value) and hasattr(value, "ask") and hasattr(value, "tell")
    ]
    return f"; choose one of {', '.join(sorted(usable))}" if usable else ", nor another class with ask() and tell()"


def _is_pymoo(found: type) -> bool:
    # A pymoo class cannot exist before pymoo has been imported.
    base = getattr(sys.modules.get("pymoo.core.algorithm"), "Algorithm", None)
    return base is not None and issubclass(found, base)


def _check_arguments(found: type, name: str) -> None:
    try:
        signature = inspect.signature(found)
    except (TypeError, ValueError):
        return  # written in C: building it will show
    try:
        signature.bind(np.zeros(1), np.ones(1), **dict.fromkeys(_SETTINGS))
    except TypeError as error:
        raise OptimizerError(
            f"algorithm {name!r}: {found.__name__}(...) does not accept its arguments ({error}); accept (lower, "
            f"upper, *, {', '.join(_SETTINGS)}), or end with **settings"
        ) from None

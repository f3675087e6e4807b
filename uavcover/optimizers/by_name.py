"""Which class an algorithm's name stands for: one of ours, one of pymoo's, or any class as ``module:Class``."""

import importlib
import inspect
import os
import sys
import traceback
from types import MappingProxyType, ModuleType
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from uavcover.errors import OptimizerError
from uavcover.optimizers.ablations import (
    ImodboMinusDynamicParameters,
    ImodboMinusLatinHypercube,
    ImodboMinusSineCosine,
    ImodboOwnBest,
    ModboOwnBest,
    ModboPlusDynamicParameters,
    ModboPlusLatinHypercube,
    ModboPlusSineCosine,
)
from uavcover.optimizers.ask_tell import AskTellOptimizer
from uavcover.optimizers.imodbo import IMODBO, MODBO
from uavcover.optimizers.imodbo_niching import ImodboNiching
from uavcover.optimizers.interface import AskAndTell
from uavcover.optimizers.own import GuardedOptimizer
from uavcover.optimizers.pymoo.adapters import MOEAD, NSGA2, adapted, pymoo_algorithm
from uavcover.optimizers.rivals.dbo import DBO
from uavcover.optimizers.rivals.mogwo import MOGWO
from uavcover.optimizers.rivals.mossa import MOSSA
from uavcover.optimizers.rivals.mowoa import MOWOA
from uavcover.optimizers.rivals.random_search import RandomSearch

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

``imodbo-niching`` takes one argument more, ``local_sets_wanted``, which may be left out.
"""

_SETTINGS = ("n_objectives", "n_constraints", "population_size", "max_iterations", "archive_size", "seed", "initial")
"""Keyword arguments that every class is built with, after the bounds."""


def optimizer_class(algorithm: str | type) -> type:
    """The class that an algorithm's name stands for.

    Args:
        algorithm: a key of `ALGORITHMS`; ``module:Class``, where the module may be a file in the current folder;
            ``pymoo:NSGA3`` for a multi-objective algorithm of pymoo; or the class itself. A class of pymoo's is adapted.

    Returns:
        A class with ``ask`` and ``tell`` that takes the arguments of `AskTellOptimizer`; build it with `make_optimizer`.

    Raises:
        OptimizerError: there is no such name, module or class, importing the module fails, or the class is no optimizer.
    """
    if isinstance(algorithm, str):
        if algorithm in ALGORITHMS:
            return ALGORITHMS[algorithm]
        found = _imported(algorithm)
    else:
        found = algorithm
    name = optimizer_name(algorithm)
    if not inspect.isclass(found):
        raise OptimizerError(f"algorithm {name!r}: {found!r} is no class: name a class with ask() and tell()")
    if _is_pymoo(found):
        return adapted(found)
    lacking = [f"{method}()" for method in ("ask", "tell") if not callable(getattr(found, method, None))]
    if lacking:
        raise OptimizerError(
            f"algorithm {name!r}: class {found.__name__} has no {' and no '.join(lacking)}: "
            "write them (docs/reference/optimizers.md)"
        )
    if inspect.isabstract(found):
        unwritten = ", ".join(sorted(f"{method}()" for method in getattr(found, "__abstractmethods__", ())))
        raise OptimizerError(f"algorithm {name!r}: class {found.__name__} is abstract: write {unwritten}")
    _check_arguments(found, name)
    return found


def optimizer_name(algorithm: str | type) -> str:
    """What results call an algorithm: its name, or ``module:Class``."""
    return algorithm if isinstance(algorithm, str) else f"{algorithm.__module__}:{algorithm.__qualname__}"


def make_optimizer(
    algorithm: str | type, lower: npt.ArrayLike, upper: npt.ArrayLike, **settings: Any
) -> AskTellOptimizer | AskAndTell:
    """A fresh optimizer. What is not one of our own classes is guarded: see `GuardedOptimizer`.

    Args:
        algorithm: as `optimizer_class` takes it.
        lower: ``(d,)`` smallest allowed values.
        upper: ``(d,)`` largest allowed values.
        **settings: the keyword arguments of `AskTellOptimizer`.

    Raises:
        OptimizerError: it cannot be found, is no optimizer, or refuses these settings.
    """
    found = optimizer_class(algorithm)
    if found in ALGORITHMS.values():
        ours: AskTellOptimizer = found(lower, upper, **settings)
        return ours
    return GuardedOptimizer(found, optimizer_name(algorithm), lower, upper, **settings)


def _imported(name: str) -> object:
    module_name, colon, class_name = name.partition(":")
    if not colon:
        raise OptimizerError(
            f"algorithm {name!r} is not known: choose one of {', '.join(ALGORITHMS)}, or name a class as module:Class"
        )
    parts = [*module_name.split("."), *class_name.split(".")]
    if not all(part.isidentifier() for part in parts):
        raise OptimizerError(f"algorithm {name!r}: write module:Class, as my_search:MySearch")
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
        sys.path.insert(0, here)  # as python -m: what the module imports later is found here too
        importlib.invalidate_caches()
    try:
        return importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        if error.name is not None and f"{module_name}.".startswith(f"{error.name}."):
            raise OptimizerError(
                f"algorithm {name!r}: there is no module {error.name!r}: run the command in the folder of {error.name}.py, "
                "or install it"
            ) from None
        raise OptimizerError(f"algorithm {name!r}: importing {module_name!r} fails: {error}") from error
    except (Exception, SystemExit) as error:
        # A class in a script without a main guard ends the program when it is imported.
        raise OptimizerError(
            f"algorithm {name!r}: importing {module_name!r} fails: {type(error).__name__}: {_place(error)}{error}"
        ) from error


def _place(error: BaseException) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if not frame.filename.startswith("<") and frame.filename != __file__]
    return f"{os.path.basename(own[-1].filename)}, line {own[-1].lineno}: " if own else ""


def _classes_in(found: object) -> str:
    usable = [
        key
        for key, value in vars(found).items()
        if inspect.isclass(value) and hasattr(value, "ask") and hasattr(value, "tell")
    ]
    return f": choose one of {', '.join(sorted(usable))}" if usable else ", nor another class with ask() and tell()"


def _is_pymoo(found: type) -> bool:
    # A class of pymoo's cannot exist before pymoo has been imported.
    base = getattr(sys.modules.get("pymoo.core.algorithm"), "Algorithm", None)
    return base is not None and issubclass(found, base)


def _check_arguments(found: type, name: str) -> None:
    try:
        signature = inspect.signature(found)
    except (TypeError, ValueError):
        return  # written in C: building it will tell
    try:
        signature.bind(np.zeros(1), np.ones(1), **dict.fromkeys(_SETTINGS))
    except TypeError as error:
        raise OptimizerError(
            f"algorithm {name!r}: {found.__name__}(...) does not take what it is built with ({error}): "
            f"take (lower, upper, *, {', '.join(_SETTINGS)}), or end with **settings"
        ) from None

"""Multi-objective optimizers behind ask and tell. They know boxes, objectives and constraints, and nothing of UAVs."""

from types import MappingProxyType
from typing import Final

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
from uavcover.optimizers.interface import Optimizer, ParetoSet
from uavcover.optimizers.pymoo.adapters import MOEAD, NSGA2
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

__all__ = [
    "ALGORITHMS",
    "DBO",
    "IMODBO",
    "MODBO",
    "MOGWO",
    "MOSSA",
    "MOWOA",
    "ImodboNiching",
    "Optimizer",
    "ParetoSet",
    "RandomSearch",
]

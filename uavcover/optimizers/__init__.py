"""Multi-objective optimizers behind ask and tell. They know boxes, objectives and constraints, and nothing of UAVs."""

from types import MappingProxyType
from typing import Final

from uavcover.optimizers.ask_tell import AskTellOptimizer
from uavcover.optimizers.imodbo import IMODBO
from uavcover.optimizers.interface import Optimizer, ParetoSet
from uavcover.optimizers.modbo import MODBO
from uavcover.optimizers.random_search import RandomSearch

ALGORITHMS: Final = MappingProxyType[str, type[AskTellOptimizer]](
    {
        "imodbo": IMODBO,
        "modbo": MODBO,
        "random_search": RandomSearch,
    }
)
"""Every algorithm and variant by its name, all built with the same arguments."""

__all__ = ["ALGORITHMS", "IMODBO", "MODBO", "Optimizer", "ParetoSet", "RandomSearch"]

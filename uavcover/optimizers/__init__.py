"""Multi-objective optimizers behind ask and tell. They know boxes, objectives and constraints, and nothing of UAVs."""

from uavcover.optimizers.ask_tell import AskTellOptimizer, RandomSearch
from uavcover.optimizers.by_name import ALGORITHMS, make_optimizer, optimizer_class, optimizer_name
from uavcover.optimizers.dung_beetle_variants import DBO
from uavcover.optimizers.imodbo import IMODBO, MODBO
from uavcover.optimizers.imodbo_niching import ImodboNiching
from uavcover.optimizers.interface import AskAndTell, Optimizer, ParetoSet
from uavcover.optimizers.pymoo.adapters import MOEAD, NSGA2
from uavcover.optimizers.rivals import MOGWO, MOSSA, MOWOA

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
    "Optimizer",
    "ParetoSet",
    "RandomSearch",
    "make_optimizer",
    "optimizer_class",
    "optimizer_name",
]

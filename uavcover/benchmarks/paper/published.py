"""Tables 5 and 6 as printed."""

from dataclasses import dataclass
from types import MappingProxyType
from typing import Final


@dataclass(frozen=True, slots=True)
class Figures:
    """Coverage as a share 0..1, number of nodes, length of the path in the paper's units."""

    coverage: float
    nodes: float
    length: float


TABLE_5: Final = MappingProxyType(
    {
        "modbo": (Figures(0.7284, 41.8, 72.1694), Figures(0.014876, 2.1679, 2.3748)),
        "imodbo": (Figures(0.8680, 41.2, 71.6046), Figures(0.003670, 1.9235, 1.1020)),
    }
)
"""Mean and standard deviation over five runs, by algorithm."""

TABLE_6: Final = MappingProxyType({"modbo": Figures(0.746, 40.0, 71.1091), "imodbo": Figures(0.872, 40.0, 70.7435)})
"""The scheme chosen by the weights 0.6, 0.2, 0.2, by algorithm."""

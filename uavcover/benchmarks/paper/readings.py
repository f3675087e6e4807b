"""The paper's Tables 5 and 6 as printed, and how its sensor can be read: the paper does not say which reading made them."""

import dataclasses
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from uavcover.model.sensor import LineOfSight, SphereSensor
from uavcover.scenario.site import Site, load_site


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


@dataclass(frozen=True, slots=True)
class Reading:
    """A reading of sections 2.2 and 5.2.

    Attributes:
        name: short.
        scenario: the bundled scenario that it is a variant of.
        line_of_sight: how a cell is hidden by ground; none where nothing hides it.
        meaning: in words.
    """

    name: str
    scenario: str
    line_of_sight: LineOfSight | None
    meaning: str

    def site(self) -> Site:
        """The paper's ground, seen by this reading's sensor."""
        site = load_site(self.scenario)
        sensor = site.scenario.sensor
        if self.line_of_sight is None or not isinstance(sensor, SphereSensor):
            return site
        changed = dataclasses.replace(sensor, line_of_sight=self.line_of_sight)
        return dataclasses.replace(site, scenario=dataclasses.replace(site.scenario, sensor=changed))


READINGS: Final = MappingProxyType(
    {
        reading.name: reading
        for reading in (
            Reading("R2-ray", "paper-R2", "ray", "R = 2 in three dimensions (Table 1), exact line of sight"),
            Reading("R2-midpoint", "paper-R2", "midpoint", "R = 2 in three dimensions, the midpoint test of Eq. 5"),
            Reading("r1-ray", "paper-r1", "ray", "r = 1 in three dimensions (section 2.2.2), exact line of sight"),
            Reading("r1-midpoint", "paper-r1", "midpoint", "r = 1 in three dimensions, the midpoint test of Eq. 5"),
            Reading("planar", "paper-planar", None, "r = 1 in the horizontal plane (S = pi r^2), nothing hides a cell"),
        )
    }
)
"""The readings by name."""

"""The scenarios of the benchmark, what is asked for on each, and where its hypervolume is measured from."""

from dataclasses import dataclass
from types import MappingProxyType
from typing import Final


@dataclass(frozen=True, slots=True)
class Case:
    """A bundled scenario as a problem.

    Attributes:
        scenario: its name.
        rule: by which the planners choose.
        asked: share of the coverable area at which routes are compared.
        most_waypoints: reference point of the hypervolume; its coverage is 0.
        longest_m: likewise.
    """

    scenario: str
    rule: str
    asked: float
    most_waypoints: float
    longest_m: float


CASES: Final = MappingProxyType(
    {
        case.scenario: case
        for case in (
            Case("paper-R2", "max-coverage", 1.0, 61.0, 120.0),
            Case("paper-r1", "max-coverage", 1.0, 61.0, 120.0),
            Case("paper-planar", "max-coverage", 1.0, 61.0, 120.0),
            Case("jacksboro", "coverage>=0.98", 0.98, 100.0, 20_000.0),
            Case("ridge-25km2", "coverage>=0.995", 0.995, 2_000.0, 400_000.0),
            Case("ridge-obstacles", "coverage>=0.99", 0.99, 400.0, 20_000.0),
        )
    }
)
"""The cases by scenario, in the order in which they are run."""

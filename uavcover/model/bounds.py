"""What no plan can beat, and how near a plan has come."""

from dataclasses import dataclass
from typing import Literal

Question = Literal["fewest_waypoints", "most_coverage", "shortest_path_m"]


@dataclass(frozen=True, slots=True)
class Bound:
    """A proved limit beside the best that was found.

    Attributes:
        question: fewest waypoints that see a share; most that so many waypoints see; shortest path that sees a share.
        asked: the share of what can be covered, 0..1, or the number of waypoints.
        limit: proved: at least, or for "most_coverage" at most.
        found: the best of the plan's routes, none when no route reaches what was asked.
        proved_on: among which places: a route over others may beat a limit that is proved on a lattice.
        method: how it was proved.
    """

    question: Question
    asked: float
    limit: float
    found: float | None
    proved_on: str
    method: str

    @property
    def gap(self) -> float | None:
        """How far the best found is from the limit: a share of it, or of the coverage; negative where other places beat it."""
        if self.found is None:
            return None
        if self.question == "most_coverage":
            return self.limit - self.found
        return (self.found - self.limit) / self.limit if self.limit > 0.0 else None

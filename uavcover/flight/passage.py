"""Which planned waypoints were passed, one after the other."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Passage:
    """Counts planned waypoints as they are passed, by what the vehicle says and by where it is.

    A waypoint counts when the vehicle goes on from it to the very next one, or comes near it while it says that it flies to it
    or to a later one; the last one also when the vehicle is near it as it goes on to something else. A jump over waypoints, as
    when another ground station sets the current item, passes none of them.

    Args:
        waypoints_m: (n, 3) ENU, the planned waypoints.
        radius_m: how near is near.

    Attributes:
        reached: so many, counted from the first, were passed.
        number: of the waypoint that was flown to at the last look; -1 for none.
    """

    def __init__(self, waypoints_m: FloatArray, *, radius_m: float) -> None:
        self._waypoints_m, self._radius_m = waypoints_m, radius_m
        self.reached, self.number = 0, -1

    @property
    def complete(self) -> bool:
        """Whether all were passed."""
        return self.reached >= len(self._waypoints_m)

    def take(self, number: int, place_m: FloatArray) -> None:
        """Look at one moment.

        Args:
            number: of the planned waypoint that is flown to; -1 for none.
            place_m: (3,) ENU, where the vehicle is.
        """
        before, self.number = self.number, number
        if before == self.reached and number == self.reached + 1:
            self.reached += 1
        last = len(self._waypoints_m) - 1
        heading = last if number < 0 and before == last else number
        while self.reached <= min(heading, last) and self._near(place_m):
            self.reached += 1

    def believe(self, count: int) -> None:
        """Count the first ``count`` waypoints as passed, as after a silence in which nobody could look."""
        self.reached = max(self.reached, min(count, len(self._waypoints_m)))

    def _near(self, place_m: FloatArray) -> bool:
        return float(np.linalg.norm(place_m - self._waypoints_m[self.reached])) <= self._radius_m

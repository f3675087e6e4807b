"""Which planned waypoints were passed, one after the other."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_NEAR_RADII = 1.25
"""The vehicle goes on as soon as it is inside the radius, and what it tells of its place are samples of that."""


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
        self._waypoints_m, self._near_m = waypoints_m, _NEAR_RADII * radius_m
        self._before_m: FloatArray | None = None
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
        self._before_m = np.array(place_m, dtype=float)

    def believe(self, count: int) -> None:
        """Count the first ``count`` waypoints as passed, as after a silence in which nobody could look."""
        self.reached = max(self.reached, min(count, len(self._waypoints_m)))

    def _near(self, place_m: FloatArray) -> bool:
        """Whether the straight line since the last look comes near the next waypoint."""
        start_m = place_m if self._before_m is None else self._before_m
        way_m, waypoint_m = place_m - start_m, self._waypoints_m[self.reached]
        length2 = float(way_m @ way_m)
        share = 0.0 if length2 == 0.0 else min(1.0, max(0.0, float((waypoint_m - start_m) @ way_m) / length2))
        return float(np.linalg.norm(start_m + share * way_m - waypoint_m)) <= self._near_m

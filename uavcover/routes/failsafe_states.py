"""Moments of a flight, where a vehicle can return to, and the paths of its returns, as data.

Positions are (east, north, height above sea level): autopilots keep a level above the sea.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely

from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.routes.failsafe_parameters import Response

Stage = Literal["stop", "climb", "return", "descend", "land", "mission"]
"""``descend`` is a descent that does not expect the ground; ``land`` one that does; ``mission`` joins legs of the mission."""

HOME, IN_PLACE = -1, -2
"""Destinations that are no rally points."""


@dataclass(frozen=True, slots=True, eq=False)
class FlightStates:
    """n moments of a flight.

    Attributes:
        places_m: (n, 3) east, north, height above sea level.
        velocities_m_s: (n, 2) east, north.
        times_s: (n,) since take-off.
        legs: (n,) vertex of the route that the vehicle flies to.
        ahead_m: (n,) way to that vertex, before which the vehicle slows down; none: it flies on.
    """

    places_m: FloatArray
    velocities_m_s: FloatArray
    times_s: FloatArray
    legs: IntArray
    ahead_m: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Destinations:
    """Where a vehicle can go, in positions as in :class:`FlightStates`.

    Attributes:
        home_m: (3,) on the ground.
        rally_m: (r, 3).
        fence: area that the vehicle's fence allows, by its polygons; none without polygons.
        route_m: (m, 3) vertices of the flown mission, take-off's top to landing's top.
        landing: vertex of the route where the mission's landing begins; none without one.
    """

    home_m: FloatArray
    rally_m: FloatArray
    route_m: FloatArray
    fence: shapely.Geometry | None = None
    landing: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class FailsafePaths:
    """What the vehicle flies from each of n moments, for one kind of response.

    Attributes:
        responses: that lead to these paths.
        points_m: (n, k, 3) vertices; legs without length where a stage is left out.
        stages: k - 1 of them.
        destinations: (n,) number of a rally point, ``HOME`` or ``IN_PLACE``.
        duration_s: (n,) until it lands or holds.
        tail_m: (m, 3) legs of the mission that follow; none without them.
        joins: (n,) first vertex of the tail that is flown to.
        note: what else the paths depend on, for people.
    """

    responses: tuple[Response, ...]
    points_m: FloatArray
    stages: tuple[Stage, ...]
    destinations: IntArray
    duration_s: FloatArray
    tail_m: FloatArray | None = None
    joins: IntArray | None = None
    note: str = ""

    def path_m(self, moment: int) -> FloatArray:
        """(j, 3) the whole path from one moment, without legs that have no length."""
        points = self.points_m[moment]
        if self.tail_m is not None and self.joins is not None:
            points = np.vstack([points, self.tail_m[self.joins[moment] :]])
        moved = np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-6
        return np.asarray(points[np.concatenate([[True], moved])], float)


def states_along(line_m: FloatArray, times_s: FloatArray, *, step_m: float, step_s: float) -> FlightStates:
    """Moments along a (k, 3) line that is flown at (k,) times, both ends of every leg among them.

    Args:
        line_m: east, north, height above sea level.
        times_s: when each vertex is passed.
        step_m: largest distance between two moments.
        step_s: largest time between them.
    """
    steps, spans = np.diff(line_m, axis=0), np.diff(times_s)
    lengths = np.linalg.norm(steps, axis=1)
    counts = np.maximum(1, np.ceil(np.maximum(lengths / step_m, spans / step_s))).astype(np.int64)
    leg = np.repeat(np.arange(len(steps)), counts + 1)
    first = np.cumsum(counts + 1) - (counts + 1)
    t = (np.arange(len(leg)) - first[leg]) / counts[leg]
    velocities = steps[leg, :2] / np.maximum(spans[leg], 1e-9)[:, None]
    level = np.hypot(steps[leg, 0], steps[leg, 1])
    return FlightStates(
        line_m[leg] + t[:, None] * steps[leg], velocities, times_s[leg] + t * spans[leg], leg + 1, (1.0 - t) * level
    )

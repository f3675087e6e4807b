"""Flown returns beside the predicted ones: how far apart they are."""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from sitl_tests.returns import SPEED_M_S, FailsafeCase, Flown, predicted
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.missions.failsafes import FailsafePaths

_SAMPLE_M = 2.0
_LANDING_M = 5.0
_MEETS_M = 6.0
"""A path whose parts are this near to each other may be left out between them by SmartRTL."""
WITHIN_M = 10.0
"""As far from its prediction as a flown path may be."""


@dataclass(frozen=True, slots=True)
class Compared:
    """A flight beside its prediction.

    Attributes:
        off_m: farthest flown place from the predicted path.
        left_out_m: farthest predicted place from the flown path; 0 after a crash.
        flown_clearance_m: least height above the terrain before it lands.
        predicted_clearance_m: the same of the prediction.
        destination: number of the rally point; -1 is home, -2 down where it is.
    """

    off_m: float
    left_out_m: float
    flown_clearance_m: float
    predicted_clearance_m: float
    destination: int

    @property
    def is_near(self) -> bool:
        """Whether both are within the limit."""
        return max(self.off_m, self.left_out_m) <= WITHIN_M

    @property
    def is_foretold(self) -> bool:
        """Whether a contact with the terrain was predicted, too: below a metre, as the judgement has it."""
        return self.flown_clearance_m > 0.0 or self.predicted_clearance_m < 1.0


def compare(case: FailsafeCase, flown: Flown, *, flat: bool) -> Compared:
    """The prediction that is nearest to a flight; there are several where the autopilot's choice cannot be known.

    Where two destinations are nearly as far, the way that it takes to stop decides: it is taken as shorter, too. PX4 brakes from
    the speed that it is set to fly, which after a corner is more than it has (``trajectory_setpoint`` in its log).
    """
    (vx, vy), found = flown.velocity_m_s, list[Compared]()
    fractions = [1.0, 0.6]
    if case.autopilot == "px4":
        fractions.append(max(1.0, SPEED_M_S / max(math.hypot(vx, vy), 1.0)))
    for fraction in fractions:
        found_paths = predicted(case, flown.position_m, (fraction * vx, fraction * vy), flown.leg, flat=flat)
        found += [_compared(case, flown, paths) for paths in found_paths]
    return min(found, key=lambda one: max(one.off_m, one.left_out_m))


def _compared(case: FailsafeCase, flown: Flown, paths: FailsafePaths) -> Compared:
    line = paths.path_m(0)
    samples = _sampled(line)
    if any(response.action.startswith("retrace") for response in paths.responses) and "mission" in paths.stages:
        samples = samples[~_between_meetings(samples)]
    off = distances_m(flown.track_m, line)
    lands = len(line) > 1 and bool(np.all(line[-1, :2] == line[-2, :2])) and line[-1, 2] < line[-2, 2]
    bottom = line[-1, :2] if lands else np.full(2, np.nan)

    def clearance_m(positions: FloatArray) -> float:
        above = positions[:, 2] - case.terrain.heights_m(positions[:, :2])
        return float(above[~(np.hypot(*(positions[:, :2] - bottom).T) < _LANDING_M)].min(initial=math.inf))

    return Compared(
        float(off.max()),
        0.0 if flown.crashed else float(distances_m(samples, flown.track_m).max()),
        clearance_m(flown.track_m),
        clearance_m(_sampled(line)),
        int(paths.destinations[0]),
    )


def _between_meetings(samples: FloatArray) -> BoolArray:
    """(n,) whether a place of a path is between two others where the path comes near to itself: SmartRTL cuts across there."""
    n = len(samples)
    near = np.linalg.norm(samples[:, None] - samples[None], axis=2) < _MEETS_M
    between = np.zeros(n, dtype=bool)
    for i, j in np.argwhere(np.triu(near, k=int(2.0 * _MEETS_M / _SAMPLE_M))):
        between[i + 1 : j] = True
    return between


def _sampled(line: FloatArray) -> FloatArray:
    pieces = [line[:1]]
    for a, b in itertools.pairwise(line):
        count = max(1, math.ceil(float(np.linalg.norm(b - a)) / _SAMPLE_M))
        pieces.append(a + np.linspace(0.0, 1.0, count + 1)[1:, None] * (b - a))
    return np.vstack(pieces)


def distances_m(positions_m: FloatArray, line_m: FloatArray) -> FloatArray:
    """(n,) distances of places (n, 3) from a line of points (m, 3)."""
    best = np.full(len(positions_m), math.inf)
    for begin, end in itertools.pairwise(line_m):
        leg = end - begin
        length = float(leg @ leg)
        fraction = (
            np.clip((positions_m - begin) @ leg / length, 0.0, 1.0) if length > 0.0 else np.zeros(len(positions_m))
        )
        best = np.minimum(best, np.linalg.norm(positions_m - begin - fraction[:, None] * leg, axis=1))
    return best

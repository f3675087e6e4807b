"""Whether a track begins and ends on the ground."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from uavcover.kernels.arrays import FloatArray
from uavcover.model.scenario import Scenario
from uavcover.verification.possible_motion import MAX_JUMP_M, MotionLimits
from uavcover.verification.tuning import ENDS


@dataclass(frozen=True, slots=True, eq=False)
class TrackEnd:
    """The first or the last sample of a track."""

    which: Literal["begins", "ends"]  # first or last
    time_s: float  # vehicle time
    enu_m: FloatArray  # (3,) its position
    height_agl_m: float  # height above ground, NaN where the ground is unknown
    on_ground: bool  # whether the vehicle is on the ground
    still: bool  # whether it does not move

    def __str__(self) -> str:
        """Description for people."""
        if np.isnan(self.height_agl_m):
            return f"the track {self.which} at an unknown height above ground"
        side = "above" if self.height_agl_m >= 0.0 else "under"
        moving = "" if self.still else ", in motion"
        return f"the track {self.which} {abs(self.height_agl_m):.1f} m {side} the ground{moving}"


def ground_tolerance_m(scenario: Scenario) -> float:
    """Largest apparent distance from the terrain of a vehicle on the ground: the tolerance of home, and the height errors."""
    return scenario.limits.max_home_error_m + scenario.uncertainty.vertical_m


def track_ends(
    scenario: Scenario,  # for the tolerances
    time_s: FloatArray,  # (n,) vehicle time
    enu_m: FloatArray,  # positions
    heights_agl_m: FloatArray,  # (n,) above ground, NaN where the ground is not known
    *,
    noise_m: tuple[float, float],  # medians of second differences, over ground and vertically
) -> tuple[TrackEnd, TrackEnd]:
    """The first and the last sample of an (n, 3) track.

    On the ground a vehicle is near the terrain and stands still. A moving one counts as well within 2 m of the ground, as in
    a log that ends at touchdown.
    """
    tolerance_m = ground_tolerance_m(scenario)
    last = len(time_s) - 1
    rests = (
        _still(enu_m, 0, int(np.searchsorted(time_s, time_s[0] + ENDS.still_s)), time_s, noise_m),
        _still(enu_m, int(np.searchsorted(time_s, time_s[-1] - ENDS.still_s, side="right")) - 1, last, time_s, noise_m),
    )
    same_place = float(np.hypot(*(enu_m[0, :2] - enu_m[-1, :2]))) <= ENDS.same_place_m
    ends = []
    for number, (sample, other) in enumerate(((0, last), (last, 0))):
        height = float(heights_agl_m[sample])
        as_low = abs(height) <= ENDS.near_terrain_m
        as_other = (
            same_place and rests[1 - number] and abs(float(enu_m[sample, 2] - enu_m[other, 2])) <= ENDS.same_height_m
        )
        above_other_m = float(enu_m[sample, 2] - enu_m[other, 2])
        in_the_air = (
            same_place and abs(float(heights_agl_m[other])) <= ENDS.near_terrain_m and above_other_m > ENDS.drift_m
        )
        on_ground = abs(height) <= tolerance_m and (rests[number] or as_low or as_other) and not in_the_air
        which: Literal["begins", "ends"] = "begins" if number == 0 else "ends"
        ends.append(TrackEnd(which, float(time_s[sample]), enu_m[sample], height, on_ground, rests[number]))
    return ends[0], ends[1]


def _still(enu_m: FloatArray, first: int, last: int, time_s: FloatArray, noise_m: tuple[float, float]) -> bool:
    first, last = max(first, 0), min(last, len(enu_m) - 1)
    seconds = float(time_s[last] - time_s[first])
    way = enu_m[last] - enu_m[first]
    level, vertical = float(np.hypot(way[0], way[1])), abs(float(way[2]))
    return (
        level <= ENDS.still_level_m_s * seconds + ENDS.noise_medians * noise_m[0]
        and vertical <= ENDS.still_vertical_m_s * seconds + ENDS.noise_medians * noise_m[1]
    )


@dataclass(frozen=True, slots=True)
class FlightContinuation:
    """A track that continues in the air where another one ended."""

    before: int  # number of the track that ended
    after: int  # number of the track that continues


def continuations(ends: Sequence[tuple[TrackEnd, TrackEnd]], limits: MotionLimits) -> list[FlightContinuation]:
    """Match tracks that begin in the air with tracks that ended in the air.

    A track continues one that ended before it, no further away than can have been flown: the one that ended last. Each is
    continued at most once.
    """
    found: list[FlightContinuation] = []
    for after in sorted(range(len(ends)), key=lambda number: ends[number][0].time_s):
        begin = ends[after][0]
        if begin.on_ground:
            continue
        taken = {link.before for link in found}
        fitting = [
            before
            for before, (_, end) in enumerate(ends)
            if before != after and before not in taken and not end.on_ground
            and begin.time_s >= end.time_s
            and np.linalg.norm(begin.enu_m - end.enu_m) <= MAX_JUMP_M + limits.speed_m_s * (begin.time_s - end.time_s)
        ]  # fmt: skip
        if fitting:
            found.append(FlightContinuation(max(fitting, key=lambda number: ends[number][1].time_s), after))
    return found

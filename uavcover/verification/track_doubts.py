"""Reasons to distrust a track: its ends, its motion although most of it is possible, and its sampling.

A receiver may lose and regain its position a few times in a flight. This leaves impossible moves that look like jumps: without
them, the motion before and after is continuous. A velocity that changes at once is no jump: time was inserted, a stretch was
removed, or two flights were joined, so the real motion was not observed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mission_io.data_tables import data_table
from mission_io.model.plain_text import counted
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.model.scenario import Scenario
from uavcover.model.track import Track
from uavcover.scenario.site import Site
from uavcover.verification.attitude import KnownAttitude
from uavcover.verification.flown_route import TRACK, position_of
from uavcover.verification.measured_motion import COARSE_STEP_S, VELOCITY, Windows
from uavcover.verification.possible_motion import (
    ACCELERATION_WINDOWS_S,
    MAX_JUMP_M,
    ImpossibleMove,
    Motion,
    MotionLimits,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Ends:
    still_s: float
    still_level_m_s: float
    still_vertical_m_s: float
    noise_medians: float
    near_terrain_m: float
    same_height_m: float
    drift_m: float
    same_position_m: float


ENDS = data_table(_Ends, "uavcover/data/verification.toml", "ends")


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
        """Description as text."""
        if np.isnan(self.height_agl_m):
            return f"the track {self.which} at an unknown height above ground"
        side = "above" if self.height_agl_m >= 0.0 else "under"
        moving = "" if self.still else ", in motion"
        return f"the track {self.which} {abs(self.height_agl_m):.1f} m {side} the ground{moving}"


def without_fix(track: Track) -> BoolArray:
    """(n,) samples at which the vehicle had been without a satellite fix for ``TRACK.dead_reckoning_s``: it extrapolated."""
    lacks = track.has_fix == 0.0
    last_s = np.maximum.accumulate(np.where(lacks, -np.inf, track.time_s))
    return np.asarray(lacks & (track.time_s - last_s > TRACK.dead_reckoning_s))


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
    same_position = float(np.hypot(*(enu_m[0, :2] - enu_m[-1, :2]))) <= ENDS.same_position_m
    ends = []
    for number, (sample, other) in enumerate(((0, last), (last, 0))):
        height = float(heights_agl_m[sample])
        as_low = abs(height) <= ENDS.near_terrain_m
        as_other = (
            same_position and rests[1 - number] and abs(float(enu_m[sample, 2] - enu_m[other, 2])) <= ENDS.same_height_m
        )
        above_other_m = float(enu_m[sample, 2] - enu_m[other, 2])
        in_the_air = (
            same_position and abs(float(heights_agl_m[other])) <= ENDS.near_terrain_m and above_other_m > ENDS.drift_m
        )
        on_ground = abs(height) <= tolerance_m and (rests[number] or as_low or as_other) and not in_the_air
        which: Literal["begins", "ends"] = "begins" if number == 0 else "ends"
        ends.append(TrackEnd(which, float(time_s[sample]), enu_m[sample], height, on_ground, rests[number]))
    return ends[0], ends[1]


def _still(enu_m: FloatArray, first: int, last: int, time_s: FloatArray, noise_m: tuple[float, float]) -> bool:
    first, last = max(first, 0), min(last, len(enu_m) - 1)
    seconds = float(time_s[last] - time_s[first])
    moved = enu_m[last] - enu_m[first]
    level, vertical = float(np.hypot(moved[0], moved[1])), abs(float(moved[2]))
    return (
        level <= ENDS.still_level_m_s * seconds + ENDS.noise_medians * noise_m[0]
        and vertical <= ENDS.still_vertical_m_s * seconds + ENDS.noise_medians * noise_m[1]
    )


@dataclass(frozen=True, slots=True)
class FlightContinuation:
    """A track that continues a flight in the air."""

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


def motion_doubts(
    site: Site, track: Track, enu_m: FloatArray, motion: Motion, limits: MotionLimits, *, position_error_m: float
) -> list[str]:
    """List the reasons why the motion proves nothing, one line each.

    Args:
        site: the scenario on its ground.
        track: all samples that were recorded.
        enu_m: (n, 3) their positions.
        motion: which part of their motion is possible.
        limits: limits of the vehicle.
        position_error_m: standard deviation of the positions, known from elsewhere.
    """
    doubts = []

    def at(move: ImpossibleMove) -> str:
        return f"at {track.time_s[move.first]:.1f} s, {position_of(site, enu_m[move.first])}"

    steps = [move for move in motion.moves if move.step_m_s > 0.0]
    if steps:
        step = max(steps, key=lambda move: move.step_m_s)
        doubts.append(
            f"the velocity jumps {at(step)} by {step.step_m_s:.1f} m/s more than possible; a part of the flight, of "
            "unknown length, is missing there"
        )
    if (move := motion.contradiction) is not None:
        doubts.append(
            f"reported velocity and positions contradict each other for {motion.contradicted_fraction:.0%} of the "
            f"time, from {track.time_s[move.first]:.1f} s, {position_of(site, enu_m[move.first])}: {move}; one of the "
            "two was not measured"
        )
    if motion.lag is not None:
        lag_s, axis = motion.lag
        most_s = VELOCITY.height_skew_s if axis == "upward" else VELOCITY.skew_s
        doubts.append(
            f"the {axis} positions are {abs(lag_s):.1f} s {'late' if lag_s > 0.0 else 'early'} against the reported "
            f"velocity, at most {most_s:g} s is possible; one of the two was not measured"
        )
    if len(motion.moves) > TRACK.max_impossible_moves:
        first = motion.moves[0]
        doubts.append(
            f"the vehicle cannot have moved like this at {counted(len(motion.moves), 'position')}, first {at(first)}: {first}"
        )
    elif not steps:
        shortest = Windows.of(
            track.time_s, enu_m, window_s=ACCELERATION_WINDOWS_S[0], joined=np.diff(track.time_s) <= COARSE_STEP_S,
            position_error_m=position_error_m,
        )  # fmt: skip
        for move in motion.moves:
            if not _is_jump(track.time_s, enu_m, move, limits, shortest):
                doubts.append(
                    f"the vehicle cannot have moved like this {at(move)}: {move}; a receiver jump does not explain "
                    "this, so time was inserted, or a part of the flight is missing"
                )
                break
    return doubts


def _is_jump(
    time_s: FloatArray, enu_m: FloatArray, move: ImpossibleMove, limits: MotionLimits, shortest: Windows
) -> bool:
    """Whether a jump of the position, there or there and back, is all that is impossible in a move."""
    if move.kind in ("out of reach", "velocity"):
        return True  # judged by its place, or by what the vehicle reported: those samples are no evidence
    begin = int(np.searchsorted(time_s, time_s[move.first] - TRACK.around_s))
    end = int(np.searchsorted(time_s, time_s[move.last] + TRACK.around_s, side="right"))
    times, positions = time_s[begin:end], enu_m[begin:end]
    allowed = (shortest.allowance_m(0), shortest.allowance_m(1))
    return any(
        _is_possible(times, without, limits, allowed)
        for without in _without_a_jump(times, positions, move.first - begin, move.last - begin)
    )


def _without_a_jump(time_s: FloatArray, enu_m: FloatArray, first: int, last: int) -> Iterator[FloatArray]:
    """The positions without the jump of any leg between two samples, and without any excursion there and back."""
    steps_s = np.diff(time_s)[:, None]
    velocity = np.diff(enu_m, axis=0) / steps_s
    around = np.vstack([velocity[:1], velocity, velocity[-1:]])
    unlike_m = np.linalg.norm((velocity - 0.5 * (around[:-2] + around[2:])) * steps_s, axis=1)
    legs = first + np.argsort(-unlike_m[first:last], kind="stable")[: TRACK.most_legs]
    for leg in sorted(legs.tolist()):
        for back in range(leg, last):
            jump_m = (velocity[leg] - 0.5 * (around[leg] + around[back + 2])) * steps_s[leg]
            if back == leg:
                yield np.vstack([enu_m[: leg + 1], enu_m[leg + 1 :] - jump_m])
            else:
                yield np.vstack([enu_m[: leg + 1], enu_m[leg + 1 : back + 1] - jump_m, enu_m[back + 1 :]])


def _is_possible(time_s: FloatArray, enu_m: FloatArray, limits: MotionLimits, allowed_m: tuple[float, float]) -> bool:
    for length_s in ACCELERATION_WINDOWS_S:
        windows = Windows.of(time_s, enu_m, window_s=length_s)
        level = windows.level_m_s2 - allowed_m[0] / windows.spans_s2
        vertical = windows.vertical_m_s2 - allowed_m[1] / windows.spans_s2
        if max(level.max(initial=0.0), vertical.max(initial=0.0)) > limits.acceleration_m_s2:
            return False
    return True


def sampling_doubts(track: Track, motion: Motion, known: KnownAttitude) -> list[str]:
    """Positions that no estimator produces, or that are too far apart to distinguish a flight from a drawn line."""
    doubts = []
    if motion.white_m > 0.0:
        doubts.append(
            f"the positions have independent errors of {motion.white_m:.1f} m from sample to sample, which no "
            "receiver or autopilot reports"
        )
    steps_s = np.diff(track.time_s)
    coarse = steps_s > COARSE_STEP_S
    if steps_s[coarse].sum() > 0.5 * steps_s.sum() and not known.confirmed:
        doubts.append(
            f"the samples are {np.median(steps_s[coarse]):.1f} s apart and no attitude confirms them, so it is "
            f"unknown whether a vehicle can fly these turns; record at least one position every {COARSE_STEP_S:g} s"
        )
    return doubts

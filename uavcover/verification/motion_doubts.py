"""Find reasons to distrust the motion of a track although most of it is possible.

A receiver may lose and regain its position a few times in a flight. That leaves impossible moves, and each looks like a jump:
without it, the motion before and after continues as a vehicle can fly. A velocity that changes at once is no jump. Time was
inserted there, a stretch was taken out, or two flights were joined, and the real motion was not observed.
"""

from collections.abc import Iterator

import numpy as np

from mission_io.model.plain_text import counted
from uavcover.kernels.arrays import FloatArray
from uavcover.model.track import Track
from uavcover.scenario.site import Site
from uavcover.verification.attitude import KnownAttitude
from uavcover.verification.motion_windows import COARSE_STEP_S, Windows
from uavcover.verification.possible_motion import ACCELERATION_WINDOWS_S, ImpossibleMove, Motion, MotionLimits
from uavcover.verification.tuning import TRACK
from uavcover.verification.unobserved import place_of


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
        return f"at {track.time_s[move.first]:.1f} s, {place_of(site, enu_m[move.first])}"

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
            f"time, from {track.time_s[move.first]:.1f} s, {place_of(site, enu_m[move.first])}: {move}; one of the "
            "two was not measured"
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
    times, places = time_s[begin:end], enu_m[begin:end]
    allowed = (shortest.allowance_m(0), shortest.allowance_m(1))
    return any(
        _is_possible(times, without, limits, allowed)
        for without in _without_a_jump(times, places, move.first - begin, move.last - begin)
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
    """Positions that no estimator gives, or that are too far apart to tell a flight from a drawn line."""
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

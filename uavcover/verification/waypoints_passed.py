"""Find the planned waypoints that a track passed, by its positions, and compare its recorded waypoint numbers."""

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np

from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.model.track import Track
from uavcover.verification.tuning import SAFETY


@dataclass(frozen=True, slots=True, eq=False)
class Passing:
    """Record of a track following its plan."""

    # (m,) number of the sample at which each planned waypoint was passed, in the order of the plan; -1 where it was not
    samples: IntArray
    nearest_m: FloatArray  # (m,) shortest distance over ground from the track to each waypoint, at any time
    radius_m: float  # distance within which a waypoint counts as passed

    @property
    def passed(self) -> BoolArray:
        """(m,) which waypoints were passed."""
        return np.asarray(self.samples >= 0)


def passing(enu_m: FloatArray, joined: BoolArray, waypoints_m: FloatArray, *, radius_m: float) -> Passing:
    """Find when an (n, 3) track passed each of (m, 3) waypoints.

    The number passed in plan order is maximal.

    Each stretch of the track within the radius over ground passes the waypoint at its nearest point. Heights are ignored: a
    flight at a wrong height is on its route, and is judged there.

    Args:
        enu_m: the track.
        joined: (n - 1,) legs of the track that count; of the others only the ends do.
        waypoints_m: the plan.
        radius_m: distance within which a waypoint counts as passed.
    """
    approaches: list[tuple[int, int]] = []
    nearest = np.full(len(waypoints_m), np.inf)
    for number, point in enumerate(waypoints_m):
        distance = _distances_m(enu_m, joined, point)
        nearest[number] = float(distance.min())
        near = np.flatnonzero(distance <= radius_m)
        stretches = np.split(near, np.flatnonzero(np.diff(near) > 1) + 1) if near.size else []
        # Latest first, so that no chain contains two approaches to one waypoint.
        approaches += [(number, int(run[int(np.argmin(distance[run]))])) for run in reversed(stretches)]
    samples = np.full(len(waypoints_m), -1, dtype=np.int64)
    for number, sample in _longest_chain(approaches):
        samples[number] = sample
    return Passing(samples, nearest, radius_m)


def _longest_chain(approaches: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """The longest chain of approaches, ordered by waypoint, whose samples do not go back (patience sorting)."""
    last_samples: list[int] = []
    last_numbers: list[int] = []
    before: list[int] = []
    for k, (_, sample) in enumerate(approaches):
        length = bisect_right(last_samples, sample)
        before.append(last_numbers[length - 1] if length else -1)
        last_samples[length : length + 1] = [sample]
        last_numbers[length : length + 1] = [k]
    chain: list[tuple[int, int]] = []
    k = last_numbers[-1] if last_numbers else -1
    while k >= 0:
        chain.append(approaches[k])
        k = before[k]
    return chain[::-1]


def _distances_m(enu_m: FloatArray, joined: BoolArray, point_m: FloatArray) -> FloatArray:
    """(n,) distance over ground from a point to each sample and the leg that begins there."""
    offset = enu_m[:, :2] - point_m[:2]
    distance = np.hypot(offset[:, 0], offset[:, 1])
    if len(enu_m) < 2:
        return distance
    way = np.diff(enu_m[:, :2], axis=0)
    length2 = np.maximum(np.einsum("ij,ij->i", way, way), 1e-12)
    share = np.clip(-np.einsum("ij,ij->i", offset[:-1], way) / length2, 0.0, 1.0)
    foot = offset[:-1] + share[:, None] * way
    along = np.hypot(foot[:, 0], foot[:, 1])
    distance[:-1] = np.where(joined, along, distance[:-1])
    return distance


def contradiction(
    track: Track, enu_m: FloatArray, joined: BoolArray, waypoints_m: FloatArray, *, radius_m: float, speed_m_s: float
) -> str | None:
    """Contradiction between the waypoint numbers of a track and its positions; None when they agree, or without numbers.

    The numbers must increase from the first one, and where they change the track must be near that waypoint. Unobserved
    stretches contradict nothing.

    Args:
        track: what was flown.
        enu_m: (n, 3) its positions.
        joined: (n - 1,) legs that were observed.
        waypoints_m: (m, 3) the plan.
        radius_m: distance within which the vehicle is at a waypoint.
        speed_m_s: speed of the vehicle, for the distance flown before the change is recorded.
    """
    numbers = track.current_waypoint
    if not (numbers >= 0).any():
        return None
    if int(numbers.max()) >= len(waypoints_m):
        return f"current_waypoint reaches {int(numbers.max())}, but the plan has {len(waypoints_m)} waypoints"
    numbered = np.flatnonzero(numbers >= 0)
    changes = numbered[1:][np.diff(numbers[numbered]) != 0]
    before = numbered[:-1][np.diff(numbers[numbered]) != 0]
    gaps = np.concatenate([[0], np.cumsum(~joined)])
    # The first number, and the one after the last, count as changes too.
    if numbers[numbered[0]] > 0 and numbered[0] > 0:
        changes, before = np.append(numbered[0], changes), np.append(numbered[0] - 1, before)
    if numbers[numbered[-1]] == len(waypoints_m) - 1 and numbered[-1] + 1 < len(numbers):
        changes, before = np.append(changes, numbered[-1] + 1), np.append(before, numbered[-1])
    for old, new in zip(before, changes, strict=True):
        # Recorded late: the vehicle was there within the last seconds.
        since = int(np.searchsorted(track.time_s, track.time_s[new] - SAFETY.lateness_s))
        if gaps[new] > gaps[min(old, since)]:
            continue
        left, reached = int(numbers[old]), int(numbers[new])
        if reached >= 0 and reached < left:
            soon = int(np.searchsorted(track.time_s, track.time_s[new] + SAFETY.overtaken_s, side="right"))
            if (numbers[new:soon] >= left).any():
                continue  # a message that a later one has overtaken
            return f"current_waypoint decreases from {left} to {reached} at {track.time_s[new]:.1f} s"
        waypoint = waypoints_m[reached - 1 if reached >= 0 else left]
        window = slice(since, new + 1)
        away_m = float(_distances_m(enu_m[window], joined[since:new], waypoint).min())
        if away_m > radius_m + speed_m_s * float(track.time_s[new] - track.time_s[old]):
            name = reached - 1 if reached >= 0 else left
            return (
                f"current_waypoint changes from {left} to {reached} at {track.time_s[new]:.1f} s, {away_m:.0f} m "
                f"away from waypoint {name}"
            )
    return None


def plan_doubt(passed: Passing) -> str | None:
    """Reason why a track cannot be a flight of its plan; None when it can."""
    count, near = len(passed.samples), int((passed.nearest_m <= passed.radius_m).sum())
    if near == 0:
        return (
            f"none of the {count} planned waypoints was passed (the nearest distance is "
            f"{float(passed.nearest_m.min()):.0f} m); the track belongs to another flight, or its positions are shifted"
        )
    kept = int(passed.passed.sum())
    if near >= SAFETY.order_of and kept < SAFETY.kept_at_least * near:
        return f"only {kept} of the {near} planned waypoints that were passed were passed in the planned order"
    reached = np.flatnonzero(passed.passed)
    missed = int(reached[-1]) + 1 - kept
    if missed > (1.0 - SAFETY.kept_at_least) * (int(reached[-1]) + 1):
        worst = float(passed.nearest_m[: int(reached[-1]) + 1].max())
        return f"the vehicle missed {missed} of the first {int(reached[-1]) + 1} waypoints by up to {worst:.0f} m"
    return None

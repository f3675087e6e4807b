"""A track against its planned route: the waypoints that it passed, its samples on the route, and unobserved stretches."""

from bisect import bisect_right
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mission_io.data_tables import data_table
from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.model.track import Track
from uavcover.model.verdict import Unobserved, UnobservedReason
from uavcover.scenario.site import Site
from uavcover.verification.possible_motion import MAX_JUMP_M, Motion


@dataclass(frozen=True, slots=True, kw_only=True)
class _Track:
    max_contradiction_m: float
    reported_height_m: float
    roll_m: float
    position_margin_m: float
    max_impossible_moves: int
    around_s: float
    most_legs: int
    moments: int
    max_unobserved_transit_fraction: float
    shown: int
    fewest_samples: int
    spreads: float
    largest_turn_deg: float
    same_view_m: float
    dead_reckoning_s: float
    stand_s: float


TRACK = data_table(_Track, "uavcover/data/verification.toml", "track")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Safety:
    speed_window_s: float
    sustained_s: float
    moving: float
    too_slow: float
    speed_tolerance: float
    fence_step_m: float
    on_the_fence_m: float
    ground_m: float
    shifts: int
    separation_longest_s: float
    overtaken_s: float
    lateness_s: float
    kept_at_least: float
    order_of: int


SAFETY = data_table(_Safety, "uavcover/data/verification.toml", "safety")


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
    step = np.diff(enu_m[:, :2], axis=0)
    length2 = np.maximum(np.einsum("ij,ij->i", step, step), 1e-12)
    fraction = np.clip(-np.einsum("ij,ij->i", offset[:-1], step) / length2, 0.0, 1.0)
    foot = offset[:-1] + fraction[:, None] * step
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


# Find the part of a track that is the planned route, and its observed stretches.


@dataclass(frozen=True, slots=True, eq=False)
class PlannedRoute:
    """The part of a plan that verification may use: its waypoints and its promised coverage."""

    waypoints_m: FloatArray  # (n, 3) ENU positions
    coverage_fraction: float  # fraction of the area that the plan promised to cover, 0..1


def on_route(
    track: Track,  # what was flown
    enu_m: FloatArray,  # (n, 3) its positions
    planned: PlannedRoute | None,  # the plan, if there is one
    *,
    acceptance_radius_m: float,  # of the vehicle
    passed: Passing | None = None,  # where the track passed the planned waypoints, if known
    believed: bool = True,  # whether the numbers agree with the positions
    on_ground: tuple[bool, bool] = (True, True),  # whether the track begins and ends there
    hides: Callable[[FloatArray], BoolArray] | None = None,  # (n - 1,) legs without evidence that may hide a position
) -> BoolArray:
    """(n,) whether each sample lies between the first and the last planned waypoint; one stretch.

    By ``current_waypoint`` where the track has it and it is credible: from the first sample heading for waypoint 1 or later to
    the last such sample, with any numbers in between. A vehicle turns to the next waypoint within its acceptance radius,
    so the route begins and ends up to that far from its ends. Where the positions show that more of the plan was flown
    before or after, that belongs to the route too: a missing number must not relax the judgement. A track that never got
    beyond waypoint 0 has no sample on the route, except that a plan of one waypoint is passed once.

    Otherwise by positions: from the first nearest approach to the first planned waypoint to the last nearest approach to the
    last one, where "near" means the smallest distance plus the acceptance radius; where a gap may hide such an end, only from or
    to the gap. Where the track lacks an end of the route, as
    a log that begins in the air, it reaches to the first or last waypoint that was passed, or to the end of such a log. Without
    a plan the whole track counts.
    """
    mask = np.zeros(len(track), dtype=bool)
    numbers = track.current_waypoint
    single = planned is not None and len(planned.waypoints_m) == 1
    if (numbers >= 0).any() and not single and believed:
        numbered = np.flatnonzero(numbers >= 1)
        span = [int(numbered[0]), int(numbered[-1])] if numbered.size else []
        for sample in _beyond(numbers, span, passed):
            span = [min([*span, sample]), max([*span, sample])]
        if span:
            mask[span[0] : span[1] + 1] = True
        return mask
    if planned is None or len(planned.waypoints_m) == 0:
        return np.ones(len(track), dtype=bool)
    first = _nearest(enu_m, planned.waypoints_m[0], acceptance_radius_m)
    last = len(track) - 1 - _nearest(enu_m[::-1], planned.waypoints_m[-1], acceptance_radius_m)
    if passed is not None and np.count_nonzero(passed.passed) > 1:  # one alone is passed in any order
        at = passed.samples[passed.passed]
        first = first if first <= at[0] else int(at[0]) * on_ground[0]
        last = last if last >= at[-1] else int(at[-1]) if on_ground[1] else len(track) - 1
        if hides is not None and not passed.passed[0]:
            gaps = np.flatnonzero(hides(planned.waypoints_m[0])[: at[0]])
            first = max([first, *(gaps[gaps >= first] + 1)])
        if hides is not None and not passed.passed[-1]:
            gaps = np.flatnonzero(hides(planned.waypoints_m[-1]))
            last = min([last, *gaps[(gaps >= at[-1]) & (gaps < last)]])
    mask[min(first, last) : max(first, last) + 1] = True
    return mask


def _beyond(numbers: NDArray[np.int64], span: list[int], passed: Passing | None) -> list[int]:
    """Samples outside the span at which planned waypoints were passed that the numbers do not show.

    One waypoint can be passed by chance, as on a straight flight home; two in order, or the end of the route, belong to it.
    """
    if passed is None:
        return []
    waypoints = np.flatnonzero(passed.passed)
    at = passed.samples[waypoints]
    if not span:
        return [int(at[0]), int(at[-1])] if waypoints.size >= 2 else []
    first_reported, last_reported = int(numbers[span[0]]), int(numbers[span[1]])
    before = at[(at < span[0]) & (waypoints < first_reported - 1)]
    after = at[(at > span[1]) & (waypoints >= last_reported)]
    ends = waypoints[(at > span[1]) & (waypoints >= last_reported)]
    found = [int(before[0])] if before.size >= 2 or (before.size and waypoints[0] == 0) else []
    if after.size >= 2 or (
        after.size and last_reported < len(passed.samples) - 1 and ends[-1] == len(passed.samples) - 1
    ):
        found.append(int(after[-1]))
    return found


def turned_back(
    track: Track, enu_m: FloatArray, joined: BoolArray, planned: PlannedRoute, passed: Passing,
    *, home_m: FloatArray, speed_m_s: float,
) -> bool:  # fmt: skip
    """Whether a flight ended before the first planned waypoint: it stayed closer to its take-off than the waypoint is to home.

    A track moved elsewhere keeps its extent, so moving it and removing its numbers hides no route.

    Args:
        track: the flown track, from a take-off on the ground.
        enu_m: (n, 3) its positions.
        joined: (n - 1,) legs that were observed; on others the vehicle may have been away and back.
        planned: the plan.
        passed: where the track passed its waypoints; one waypoint can be passed by chance.
        home_m: (3,) planned start of the flight.
        speed_m_s: greatest speed of the vehicle.
    """
    if (track.current_waypoint >= 1).any() or passed.passed.sum() > 1:
        return False
    away_m = np.linalg.norm(enu_m - enu_m[0], axis=1)
    unobserved_m = np.where(joined, 0.0, speed_m_s * np.diff(track.time_s))
    furthest_m = max(float(away_m.max()), float((0.5 * (away_m[:-1] + away_m[1:] + unobserved_m)).max(initial=0.0)))
    return furthest_m < float(np.linalg.norm(planned.waypoints_m[0] - home_m)) - passed.radius_m


def _nearest(enu_m: FloatArray, point_m: FloatArray, radius_m: float) -> int:
    """Number of the nearest sample of the first approach about as near to a (3,) point as any."""
    distance = np.linalg.norm(enu_m - point_m, axis=1)
    near = distance <= distance.min() + radius_m
    begin = int(np.argmax(near))
    end = begin + int(np.argmin(near[begin:])) if not near[begin:].all() else len(near)
    return begin + int(np.argmin(distance[begin:end]))


def observed_stretches(mask: BoolArray, joined: BoolArray) -> list[NDArray[np.int64]]:
    """Runs of sample numbers inside ``mask`` (n,), each ``joined`` (n - 1,) to the next.

    What lies between two runs was not observed: neither coverage nor safety is assumed there.
    """
    chosen = np.flatnonzero(mask)
    if chosen.size == 0:
        return []
    breaks = (np.diff(chosen) > 1) | ~joined[chosen[:-1]]
    return [np.asarray(run, dtype=np.int64) for run in np.split(chosen, np.flatnonzero(breaks) + 1)]


def lat_lon_deg(site: Site, enu_m: FloatArray) -> tuple[float, float]:
    """Latitude and longitude of a (3,) position; NaN for a site that is not georeferenced."""
    if site.frame is None:
        return np.nan, np.nan
    lat, lon, _ = site.frame.geodetic_from_enu(enu_m)
    return float(lat[0]), float(lon[0])


def position_of(site: Site, enu_m: FloatArray) -> str:
    """A position as text: latitude and longitude, or local metres without a georeference."""
    if site.frame is None:
        return f"{enu_m[0]:.0f} m east, {enu_m[1]:.0f} m north"
    lat_deg, lon_deg = lat_lon_deg(site, enu_m)
    return f"{lat_deg:.6f}, {lon_deg:.6f}"


def unobserved_stretches(
    site: Site, track: Track, enu_m: FloatArray, joined: BoolArray, route: BoolArray, motion: Motion, kept: IntArray
) -> Iterator[Unobserved]:
    """The unobserved stretches between samples that are not joined.

    Args:
        site: the scenario on its ground.
        track: the samples that are evidence.
        enu_m: (n, 3) their positions.
        joined: (n - 1,) legs that were observed.
        route: (n,) which samples belong to the planned route.
        motion: motion of the track as recorded.
        kept: (n,) numbers of the samples in the track as recorded.
    """
    # Before its first move and after its last one the vehicle stands on the ground.
    moved = np.flatnonzero(np.linalg.norm(enu_m - enu_m[0], axis=1) > MAX_JUMP_M)
    moving = np.flatnonzero(np.linalg.norm(enu_m - enu_m[-1], axis=1) > MAX_JUMP_M)
    for k in np.flatnonzero(~joined):
        seconds = float(track.time_s[k + 1] - track.time_s[k])
        moves = [move for move in motion.moves if move.first < kept[k + 1] and move.last > kept[k]]
        reason: UnobservedReason = "impossible motion" if moves else "no samples"
        detail = f"impossible motion: {moves[0]}" if moves else f"{seconds:.1f} s without samples"
        if kept[k + 1] - kept[k] > 1 and not moves:
            reason, detail = "no satellite fix", f"{seconds:.1f} s without a satellite fix"
        yield stretch_at(
            site, enu_m[k], reason=reason,
            detail=detail,
            span_s=(float(track.time_s[k]), float(track.time_s[k + 1])),
            length_m=float(np.linalg.norm(enu_m[k + 1] - enu_m[k])), on_route=bool(route[k] or route[k + 1]),
            in_flight=bool(moved.size and moving.size and k + 1 >= moved[0] and k <= moving[-1]),
        )  # fmt: skip


def stretch_at(
    site: Site, enu_m: FloatArray, *, reason: UnobservedReason, detail: str, span_s: tuple[float, float],
    length_m: float, on_route: bool, in_flight: bool = True,
) -> Unobserved:  # fmt: skip
    """An unobserved stretch that begins at a (3,) position; ``span_s`` is its first and last moment."""
    lat_deg, lon_deg = lat_lon_deg(site, enu_m)
    return Unobserved(
        reason=reason, detail=detail, start_s=span_s[0], end_s=span_s[1], length_m=length_m,
        lat_deg=lat_deg, lon_deg=lon_deg, east_m=float(enu_m[0]), north_m=float(enu_m[1]),
        phase="route" if on_route else "transit", in_flight=in_flight,
    )  # fmt: skip


def path_before_m(planned: PlannedRoute | None, passed: Passing | None) -> FloatArray:
    """(k, 3) the planned route up to the first waypoint that was passed; empty without a plan."""
    if planned is None or passed is None:
        return np.empty((0, 3))
    reached = np.flatnonzero(passed.passed)
    return planned.waypoints_m[: int(reached[0]) + 1] if reached.size else planned.waypoints_m


def path_after_m(planned: PlannedRoute | None, passed: Passing | None) -> FloatArray:
    """(k, 3) the planned route from the last waypoint that was passed; empty without a plan."""
    if planned is None or passed is None:
        return np.empty((0, 3))
    reached = np.flatnonzero(passed.passed)
    return planned.waypoints_m[int(reached[-1]) :] if reached.size else planned.waypoints_m


def paths_between_m(
    enu_m: FloatArray, joined: BoolArray, route: BoolArray, planned: PlannedRoute | None, passed: Passing | None
) -> Iterator[FloatArray]:
    """A (k, 3) path for each unobserved stretch of the route: straight, or through the planned waypoints in between.

    A stretch of a transit counts if there are such waypoints: it hides where the route begins or ends.
    """
    hidden = set[int]()  # first waypoints of such stretches: one path is enough for several of them
    for k in np.flatnonzero(~joined):
        first, between = 0, np.empty((0, 3))
        if planned is not None and passed is not None:
            done = np.flatnonzero((passed.samples >= 0) & (passed.samples <= k))
            ahead = np.flatnonzero(passed.samples > k)
            first = int(done[-1]) + 1 if done.size else 0
            last = int(ahead[0]) if ahead.size else len(planned.waypoints_m)
            between = planned.waypoints_m[first : max(first, last)]
        if route[k] or route[k + 1] or (len(between) and first not in hidden):
            hidden.add(first)
            yield np.vstack([enu_m[k], between, enu_m[k + 1]])


def length_of_m(path_m: FloatArray) -> float:
    """Length of an (n, 3) path."""
    return float(np.linalg.norm(np.diff(path_m, axis=0), axis=1).sum())

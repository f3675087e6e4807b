"""Planned times of sorties, the separation of vehicles in the air, and starts that keep it.

A vehicle may be early or late: by ``start_error_s`` at its start, and by a fraction of the time since take-off on its way. If two
paths come nearer than the separation, the times of the two vehicles there must not overlap. So every such pair of pieces excludes
an interval of the difference between the two starts; the union of all intervals gives the safe starts. A vehicle also stands at
home for a while before take-off and after landing. ``tests/naive/fleet.py`` checks every moment.
"""

import dataclasses
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uavcover.errors import InfeasibleError
from uavcover.kernels.arrays import FloatArray, IntArray
from uavcover.kernels.flight_time import Pace, landing_time, leg_times, takeoff_time, turn_times
from uavcover.missions.mission_compiler import Sortie
from uavcover.missions.transit import home_of
from uavcover.model.vehicle import AutopilotName, Fleet
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import pace_of, vehicle_sites
from uavcover.sensing.sensors import trigger_distance_m


@dataclass(frozen=True, slots=True, eq=False)
class Timeline:
    """A flight as points with their times; between them it moves at constant speed."""

    time_s: FloatArray  # (n,) since take-off, not decreasing
    position_m: FloatArray  # (n, 3) ENU metres, the ground at home first and last

    @property
    def duration_s(self) -> float:
        """Time from take-off to landing."""
        return float(self.time_s[-1])

    def positions_m(self, times_s: FloatArray) -> FloatArray:
        """(k, 3) ENU positions at (k,) times since take-off; its ends before and after the flight."""
        return np.column_stack([np.interp(times_s, self.time_s, axis) for axis in self.position_m.T])

    def nearest_time_s(self, position_m: FloatArray, *, from_s: float, to_s: float) -> float:
        """The planned time at which the flight is nearest to a (3,) place, between two times since take-off."""
        inside = self.time_s[(self.time_s > from_s) & (self.time_s < to_s)]
        times = np.clip(np.concatenate([[from_s], inside, [to_s]]), 0.0, self.duration_s)
        points = self.positions_m(times)
        along = np.diff(points, axis=0)
        squared = np.einsum("ij,ij->i", along, along)
        reach = np.einsum("ij,ij->i", position_m - points[:-1], along)
        fraction = np.clip(reach / np.where(squared > 0.0, squared, np.inf), 0.0, 1.0)
        off = np.linalg.norm(points[:-1] + fraction[:, None] * along - position_m, axis=1)
        k = int(np.argmin(off))
        return float(times[k] + fraction[k] * (times[k + 1] - times[k]))


def timeline_of(site: Site, sortie: Sortie, *, autopilot: AutopilotName) -> Timeline:
    """The planned times of a sortie; the last one is its flight time.

    The time saved by passing a waypoint without a stop is subtracted half from the leg before it and half from the leg after.

    Raises:
        InfeasibleError: the site has no home.
    """
    home = home_of(site)
    pace, path = pace_of(site, autopilot), sortie.compiled.path_m
    if trigger_distance_m(site.scenario) is not None:
        # The waypoint at which photos begin stands twice in the mission and is a stop.
        path = np.insert(path, _first_row(sortie), sortie.route.waypoints_m[0], axis=0)
    turns_s = turn_times(pace, path)
    legs_s = leg_times(pace, path) + 0.5 * (turns_s[:-1] + turns_s[1:])
    climb_s, climb_m = _climb(pace, home, float(path[0, 2] - home[2]))
    sink_s, sink_m = _descent(pace, home, float(path[-1, 2] - home[2]))
    begin_s = climb_s[-1]
    # Two sharp turns close to each other may save more than the leg between them takes: then it takes no time.
    along_s = np.maximum.accumulate(begin_s + np.concatenate([[0.0], np.cumsum(legs_s)]))
    return Timeline(
        time_s=np.concatenate([climb_s[:-1], along_s, along_s[-1] + sink_s[1:]]),
        position_m=np.vstack([climb_m[:-1], path, sink_m[1:]]),
    )


def _first_row(sortie: Sortie) -> int:
    """Row of the first planned waypoint in the path of the mission."""
    path, route = sortie.compiled.path_m, sortie.route.waypoints_m
    for row in range(len(path) - len(route) + 1):
        if np.array_equal(path[row : row + len(route)], route):
            return row
    raise InfeasibleError("the mission does not contain the planned route")


def _climb(pace: Pace, home_m: FloatArray, height_m: float) -> tuple[FloatArray, FloatArray]:
    heights = np.unique([0.0, min(pace.takeoff_slow_m, height_m), height_m])
    times = np.array([0.0, *(takeoff_time(pace, h) for h in heights[1:])])
    return times, _column(home_m, heights)


def _descent(pace: Pace, home_m: FloatArray, height_m: float) -> tuple[FloatArray, FloatArray]:
    """The descent with its slow last metres and the band above them."""
    slow_m = min(pace.land_slow_m, height_m)
    heights = np.unique([0.0, slow_m, min(slow_m + pace.land_band_m, height_m), height_m])[::-1]
    left = np.array([*(landing_time(pace, h) for h in heights[:-1]), 0.0])
    return left[0] - left, _column(home_m, heights)


def _column(home_m: FloatArray, heights_m: FloatArray) -> FloatArray:
    return np.asarray(home_m + heights_m[:, None] * np.array([0.0, 0.0, 1.0]))


_LONGEST_PIECE_M = 10.0
_ROOM_S = 1e-6
"""Margin at an excluded interval, for rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class PathPieces:
    """A flight as short straight pieces, each with the time in which the vehicle may be there."""

    begin_m: FloatArray  # (n, 3) ENU metres
    end_m: FloatArray  # (n, 3) ENU metres
    earliest_s: FloatArray  # (n,) since the planned take-off
    latest_s: FloatArray  # (n,) since the planned take-off


def pieces_of(timeline: Timeline, fleet: Fleet) -> PathPieces:
    """A flight in pieces of at most ten metres, with its time on the ground at home before and after."""
    times, positions = timeline.time_s, timeline.position_m
    lengths = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    parts = np.maximum(1, np.ceil(lengths / _LONGEST_PIECE_M)).astype(int)
    leg = np.repeat(np.arange(len(parts)), parts)
    number = np.arange(len(leg)) - np.repeat(np.cumsum(parts) - parts, parts)
    begin, end = number / parts[leg], (number + 1) / parts[leg]

    def at(values: FloatArray, fraction: FloatArray) -> FloatArray:
        fraction = fraction.reshape(-1, *[1] * (values.ndim - 1))
        return np.asarray((1.0 - fraction) * values[leg] + fraction * values[leg + 1])

    begin_s, end_s = at(times, begin), at(times, end)
    begin_s = np.concatenate([[-fleet.pad_s], begin_s, [times[-1]]])
    end_s = np.concatenate([[0.0], end_s, [times[-1] + fleet.pad_s]])
    return PathPieces(
        begin_m=np.vstack([positions[:1], at(positions, begin), positions[-1:]]),
        end_m=np.vstack([positions[:1], at(positions, end), positions[-1:]]),
        earliest_s=begin_s - late_s(begin_s, fleet),
        latest_s=end_s + late_s(end_s, fleet),
    )


def late_s(time_s: FloatArray, fleet: Fleet) -> FloatArray:
    """Seconds by which a vehicle may be early or late at a planned time since its take-off."""
    return np.asarray(fleet.timing_error_fraction * np.maximum(time_s, 0.0) + fleet.start_error_s)


def unsafe_starts(a: PathPieces, b: PathPieces, fleet: Fleet) -> FloatArray:
    """Excluded differences of two starts.

    Returns:
        (k, 2) open intervals of b's start less a's in seconds, sorted, without overlaps.
    """
    first, second, _ = near_pieces(a, b, fleet.planned_separation_m)
    return merged(np.column_stack([a.earliest_s[first] - b.latest_s[second], a.latest_s[first] - b.earliest_s[second]]))


class UnsafeStarts:
    """:func:`unsafe_starts` of pairs of flights, each found once.

    Args:
        fleet: what keeps the vehicles apart.
    """

    def __init__(self, fleet: Fleet) -> None:
        self._fleet = fleet
        self._pieces: dict[Timeline, PathPieces] = {}
        self._found: dict[tuple[Timeline, Timeline], FloatArray] = {}

    def between(self, a: Timeline, b: Timeline) -> FloatArray:
        """As :func:`unsafe_starts`."""
        if (a, b) not in self._found:
            self._found[a, b] = found = unsafe_starts(self._of(a), self._of(b), self._fleet)
            self._found[b, a] = -found[::-1, ::-1]
        return self._found[a, b]

    def _of(self, timeline: Timeline) -> PathPieces:
        if timeline not in self._pieces:
            self._pieces[timeline] = pieces_of(timeline, self._fleet)
        return self._pieces[timeline]


def merged(intervals: FloatArray) -> FloatArray:
    """(m, 2) open intervals as (k, 2) sorted ones that do not overlap."""
    if len(intervals) == 0:
        return np.empty((0, 2))
    ordered = intervals[np.argsort(intervals[:, 0], kind="stable")]
    reach = np.maximum.accumulate(ordered[:, 1])
    begins = np.concatenate([[True], ordered[1:, 0] >= reach[:-1]])
    last = np.concatenate([np.flatnonzero(begins)[1:] - 1, [len(ordered) - 1]])
    return np.column_stack([ordered[begins, 0], reach[last]])


def safe_start_s(intervals: FloatArray, wanted_s: float) -> float:
    """The least safe difference of two starts that is not below the wanted one; see :func:`unsafe_starts`."""
    k = int(np.searchsorted(intervals[:, 0], wanted_s, side="left")) - 1
    if k >= 0 and wanted_s < intervals[k, 1]:
        return float(intervals[k, 1]) + _ROOM_S
    return wanted_s


def near_pieces(a: PathPieces, b: PathPieces, separation_m: float) -> tuple[IntArray, IntArray, FloatArray]:
    """Pairs of pieces that are nearer than the separation: their numbers, (m,) each, and their distances."""
    from scipy.spatial import cKDTree  # a third of a second to load, and one vehicle needs none

    half_a = 0.5 * np.linalg.norm(a.end_m - a.begin_m, axis=1)
    half_b = 0.5 * np.linalg.norm(b.end_m - b.begin_m, axis=1)
    reach_m = separation_m + float(half_a.max() + half_b.max())
    tree_a, tree_b = cKDTree(0.5 * (a.begin_m + a.end_m)), cKDTree(0.5 * (b.begin_m + b.end_m))
    lists = tree_a.query_ball_tree(tree_b, reach_m)
    first = np.repeat(np.arange(len(lists)), [len(near) for near in lists])
    second = np.array([k for near in lists for k in near], dtype=np.int64)
    distance_m = segment_distances_m(a.begin_m[first], a.end_m[first], b.begin_m[second], b.end_m[second])
    kept = distance_m < separation_m
    return first[kept], second[kept], distance_m[kept]


def segment_distances_m(p0: FloatArray, p1: FloatArray, q0: FloatArray, q1: FloatArray) -> FloatArray:
    """(n,) distances between straight pieces p0 p1 and q0 q1, each (n, 3).

    The nearest two points are inside both pieces, or one of them is an end.
    """
    if len(p0) == 0:
        return np.empty(0)
    u, v, w = p1 - p0, q1 - q0, p0 - q0
    uu, uv, vv = (np.einsum("ij,ij->i", x, y) for x, y in ((u, u), (u, v), (v, v)))
    uw, vw = np.einsum("ij,ij->i", u, w), np.einsum("ij,ij->i", v, w)
    found = np.minimum(_from_points_m(p0, q0, v, vv), _from_points_m(p1, q0, v, vv))
    found = np.minimum(found, np.minimum(_from_points_m(q0, p0, u, uu), _from_points_m(q1, p0, u, uu)))
    size = uu * vv - uv * uv
    with np.errstate(divide="ignore", invalid="ignore"):
        s, t = (uv * vw - vv * uw) / size, (uu * vw - uv * uw) / size
        inside = (size > 1e-12 * uu * vv) & (s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0)
        across = np.linalg.norm(w + s[:, None] * u - t[:, None] * v, axis=1)
    return np.asarray(np.where(inside, np.minimum(found, across), found))


def _from_points_m(points: FloatArray, begin: FloatArray, along: FloatArray, squared: FloatArray) -> FloatArray:
    """(n,) distances of points from pieces that begin there and go along so."""
    to = points - begin
    fraction = np.einsum("ij,ij->i", to, along) / np.where(squared > 0.0, squared, math.inf)
    return np.asarray(np.linalg.norm(to - np.clip(fraction, 0.0, 1.0)[:, None] * along, axis=1))


_TRIES = 1500
"""Number of orders of the sorties that are tried."""
_LEAST_GAIN_S = 0.1


@dataclass(frozen=True, slots=True)
class Start:
    """Start of a sortie."""

    vehicle: int  # number of the vehicle, from 0
    start_s: float  # take-off, since the first take-off of all


def schedule(
    timelines: Sequence[Timeline],  # of the sorties
    fleet: Fleet,  # what keeps the vehicles apart
    *,
    # vehicle of each, from 0; None: any, because all are identical; numbered by their first take-offs
    vehicle_of: Sequence[int] | None = None,
    unsafe: UnsafeStarts | None = None,  # starts of pairs of these flights, where some are known from before
) -> tuple[Start, ...]:
    """Find starts for sorties that keep the vehicles apart.

    A sortie begins when its vehicle is ready, even after a late landing, and when the start is safe with all scheduled sorties.
    Orders of the sorties are tried by exchanging two.
    """
    search = _OrderSearch(timelines, fleet, vehicle_of, unsafe or UnsafeStarts(fleet))
    by_length = sorted(range(len(timelines)), key=lambda k: (-timelines[k].duration_s, k))
    best = min((list(range(len(timelines))), by_length), key=lambda order: search.value(order))
    best = search.improved(best)
    starts, _ = search.starts(best)
    if vehicle_of is not None:
        return tuple(starts)
    by_start = sorted(starts, key=lambda start: start.start_s)
    numbered = {old: new for new, old in enumerate(dict.fromkeys(start.vehicle for start in by_start))}
    return tuple(Start(numbered[s.vehicle], s.start_s) for s in starts)


class _OrderSearch:
    """Orders of sorties, each of which gives a schedule: one by one, each sortie gets the earliest free start."""

    def __init__(
        self, timelines: Sequence[Timeline], fleet: Fleet, vehicle_of: Sequence[int] | None, unsafe: UnsafeStarts
    ) -> None:
        self._fleet, self._vehicle_of = fleet, vehicle_of
        self.durations_s = [t.duration_s for t in timelines]
        late = late_s(np.array(self.durations_s), fleet)
        self._busy_s = (np.array(self.durations_s) + late + fleet.turnaround_s).tolist()
        self._unsafe: dict[tuple[int, int], FloatArray] = {
            (a, b): unsafe.between(timelines[a], timelines[b])
            for a, b in itertools.permutations(range(len(timelines)), 2)
        }

    def starts(self, order: Sequence[int]) -> tuple[list[Start], float]:
        """The starts in the order of the route, and when the last sortie lands."""
        ready_s = [0.0] * self._fleet.vehicles
        placed: dict[int, Start] = {}
        for sortie in order:
            may_s = ready_s if self._vehicle_of is None else [ready_s[self._vehicle_of[sortie]]]
            begins = {free_s: self._safe_s(sortie, free_s, placed) for free_s in sorted(set(may_s))}
            free_s = min(begins, key=lambda s: (begins[s], -s))
            vehicle = ready_s.index(free_s) if self._vehicle_of is None else self._vehicle_of[sortie]
            placed[sortie] = Start(vehicle, begins[free_s])
            ready_s[vehicle] = begins[free_s] + self._busy_s[sortie]
        first_s = min(start.start_s for start in placed.values())
        starts = [Start(placed[k].vehicle, placed[k].start_s - first_s) for k in range(len(order))]
        return starts, max(s.start_s + d for s, d in zip(starts, self.durations_s, strict=True))

    def _safe_s(self, sortie: int, wanted_s: float, placed: dict[int, Start]) -> float:
        at_s = wanted_s
        while True:
            before_s = at_s
            for other, start in placed.items():
                at_s = start.start_s + safe_start_s(self._unsafe[other, sortie], at_s - start.start_s)
            if at_s == before_s:
                return at_s

    def value(self, order: Sequence[int]) -> tuple[float, float]:
        """Landing time of the last sortie; then the sum of all starts."""
        starts, makespan_s = self.starts(order)
        return makespan_s, math.fsum(s.start_s for s in starts)

    def improved(self, order: list[int]) -> list[int]:
        """A better order, by exchanging two sorties until no exchange helps or enough was tried."""
        best, tries = self.value(order), 0
        better = True
        while better:
            better = False
            for i in range(len(order)):
                for j in range(i + 1, len(order)):
                    if tries >= _TRIES:
                        return order
                    tries += 1
                    other = list(order)
                    other[i], other[j] = other[j], other[i]
                    value = self.value(other)
                    if value[0] < best[0] - _LEAST_GAIN_S:
                        order, best, better = other, value, True
        return order


def scheduled(site: Site, flights: Sequence[Sortie], *, autopilot: AutopilotName) -> tuple[Sortie, ...]:
    """The flights with the vehicle that flies each and its take-off, so that all keep apart (``missions/fleet_schedule.py``)."""
    timelines = [timeline_of(site, flight, autopilot=autopilot) for flight in flights]
    starts = schedule(timelines, site.scenario.fleet)
    return tuple(
        dataclasses.replace(flight, vehicle=start.vehicle + 1, start_s=start.start_s)
        for flight, start in zip(flights, starts, strict=True)
    )


def scheduled_unlike(site: Site, flights: Sequence[Sortie]) -> tuple[Sortie, ...]:
    """The flights of different vehicles, each already allocated, with take-offs that keep all apart."""
    fleet, sites = site.scenario.fleet, vehicle_sites(site)
    if fleet.one_at_a_time:
        return _one_after_the_other(flights, fleet.turnaround_s)
    timelines = []
    for flight in flights:
        own = sites[flight.vehicle - 1]
        timelines.append(timeline_of(own, flight, autopilot=own.scenario.vehicle.autopilot))
    starts = schedule(timelines, fleet, vehicle_of=[flight.vehicle - 1 for flight in flights])
    return tuple(
        dataclasses.replace(flight, start_s=start.start_s) for flight, start in zip(flights, starts, strict=True)
    )


def _one_after_the_other(flights: Sequence[Sortie], turnaround_s: float) -> tuple[Sortie, ...]:
    """Schedule flights with this pause between landing and take-off.

    All flights from one home come before those from the next.
    """
    start_s, found = 0.0, {}
    for k in sorted(range(len(flights)), key=lambda k: (flights[k].vehicle, k)):
        found[k] = dataclasses.replace(flights[k], start_s=start_s)
        start_s += flights[k].compiled.flight_time_s + turnaround_s
    return tuple(found[k] for k in range(len(flights)))


def makespan_s(site: Site, flights: Sequence[Sortie]) -> float:
    """Planned time from the first take-off to the last landing; without take-off times, for a single vehicle."""
    if all(flight.start_s is None for flight in flights):
        times_s = [flight.compiled.flight_time_s for flight in flights]
        return math.fsum(times_s) + site.scenario.fleet.turnaround_s * (len(flights) - 1)
    return max((flight.start_s or 0.0) + flight.compiled.flight_time_s for flight in flights)

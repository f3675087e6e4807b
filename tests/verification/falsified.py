"""Tracks that nobody can have flown: honest ones, falsified by class, each with parameters of a seed."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from uavcover.model.track import Track
from uavcover.scenario.site import Site

Falsify = Callable[[Site, Track, np.random.Generator], Track]


def moved_to(site: Site, track: Track, enu_m: np.ndarray, *, time_s: np.ndarray | None = None) -> Track:
    """The track at other places, all of its columns agreeing."""
    assert site.frame is not None
    return replace(
        track,
        time_s=track.time_s.copy() if time_s is None else time_s,
        enu_m=np.array(enu_m),
        geodetic=np.column_stack(site.frame.geodetic_from_enu(enu_m)),
    )


def flying(track: Track) -> np.ndarray:
    """Samples on the planned route."""
    return np.flatnonzero(track.current_waypoint >= 1)


# Motion


def teleports(site: Site, track: Track, rng: np.random.Generator) -> Track:
    """For some seconds the vehicle is hundreds of metres away."""
    enu = track.enu_m.copy()
    for _ in range(4):
        start = rng.choice(flying(track))
        away = slice(start, start + int(rng.integers(15, 60)))
        enu[away, :2] += rng.choice([-1, 1], 2) * rng.uniform(60.0, 500.0, 2)
    return moved_to(site, track, enu)


def fast_clock(_site: Site, track: Track, rng: np.random.Generator) -> Track:
    return replace(track, time_s=track.time_s[0] + (track.time_s - track.time_s[0]) / rng.uniform(1.7, 20.0))


def slow_clock(site: Site, track: Track, rng: np.random.Generator) -> Track:
    """So slow that the vehicle never comes near its speed, and recorded as often as before."""
    by = rng.uniform(3.0, 12.0)
    start = float(track.time_s[0])
    stretched = start + (track.time_s - start) * by
    time_s = np.arange(start, stretched[-1], 0.2)
    enu = np.column_stack([np.interp(time_s, stretched, track.enu_m[:, axis]) for axis in range(3)])
    nearest = np.minimum(np.searchsorted(stretched, time_s), len(track) - 1)
    return moved_to(site, track.taken(nearest), enu, time_s=time_s)


def frozen(site: Site, track: Track, rng: np.random.Generator) -> Track:
    """The position stands still for seconds again and again, and jumps to where the vehicle is then."""
    period, still = rng.uniform(4.0, 9.0), rng.uniform(1.0, 3.5)
    stuck = (track.time_s - track.time_s[0]) % period < still
    last = np.maximum.accumulate(np.where(stuck, 0, np.arange(len(track))))
    return moved_to(site, track, track.enu_m[last])


def interpolated(site: Site, track: Track, rng: np.random.Generator) -> Track:
    """Known every few seconds only, and straight lines in between."""
    knots = np.arange(track.time_s[0], track.time_s[-1], rng.uniform(3.0, 15.0))
    at = [np.interp(knots, track.time_s, track.enu_m[:, axis]) for axis in range(3)]
    return moved_to(site, track, np.column_stack([np.interp(track.time_s, knots, values) for values in at]))


def shuffled(site: Site, track: Track, rng: np.random.Generator) -> Track:
    """Blocks of the flight in another order."""
    size = int(rng.integers(5, 100))
    blocks = np.array_split(np.arange(len(track)), len(track) // size)
    order = np.concatenate([blocks[k] for k in rng.permutation(len(blocks))])
    return moved_to(site, track, track.enu_m[order])


def height_jumps(site: Site, track: Track, rng: np.random.Generator) -> Track:
    enu = track.enu_m.copy()
    for _ in range(5):
        start = rng.choice(flying(track))
        enu[start : start + int(rng.integers(10, 80)), 2] += rng.choice([-1, 1]) * rng.uniform(8.0, 30.0)
    return moved_to(site, track, enu)


def coarse(site: Site, track: Track, rng: np.random.Generator) -> Track:
    """Places rounded to tens of metres."""
    step = rng.uniform(10.0, 120.0)
    return moved_to(site, track, np.round(track.enu_m / [step, step, 1.0]) * [step, step, 1.0])


def latitude_of_another_time(site: Site, track: Track, rng: np.random.Generator) -> Track:
    """As a log has it that was put together from two streams of messages."""
    enu, late_s = track.enu_m.copy(), rng.choice([-1, 1]) * rng.uniform(1.1, 2.0)
    enu[:, 1] = np.interp(track.time_s - late_s, track.time_s, enu[:, 1])
    return moved_to(site, track, enu)


def the_plan_itself(site: Site, track: Track, rng: np.random.Generator) -> Track:
    """The legs of the flight at one speed, corners and all."""
    corners = [0, *np.flatnonzero(np.diff(track.current_waypoint)), len(track) - 1]
    path = track.enu_m[corners]
    top = path[0] + [0.0, 0.0, 60.0]
    path = np.vstack([path[0], top, path[1:-1], top, path[-1]])
    flown = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    speed = rng.uniform(4.0, 10.0)
    time_s = track.time_s[0] + np.arange(0.0, flown[-1] / speed, 0.2)
    along = (time_s - time_s[0]) * speed
    enu = np.column_stack([np.interp(along, flown, path[:, axis]) for axis in range(3)])
    number = np.searchsorted(flown, along) - 2
    number = np.where((number >= 0) & (number < int(track.current_waypoint.max()) + 1), number, -1)
    attitude = np.tile([1.0, -1.0, 90.0], (len(enu), 1))
    whole = Track(time_s, np.empty((len(enu), 3)), enu, attitude, number)
    return moved_to(site, whole, enu)


# What was not observed


def thinned(_site: Site, track: Track, rng: np.random.Generator) -> Track:
    """A sample every few seconds, too far apart to be joined."""
    every = rng.uniform(2.5, 20.0)
    keep = np.unique(np.searchsorted(track.time_s, np.arange(track.time_s[0], track.time_s[-1], every)))
    return track.taken(keep)


def with_a_hole(_site: Site, track: Track, rng: np.random.Generator) -> Track:
    start = track.time_s[rng.choice(flying(track)[:-200])]
    return track.taken((track.time_s < start) | (track.time_s > start + rng.uniform(11.0, 40.0)))


def with_many_holes(_site: Site, track: Track, rng: np.random.Generator) -> Track:
    period = rng.uniform(20.0, 40.0)
    return track.taken((track.time_s - track.time_s[0]) % period > rng.uniform(2.5, 8.0))


def begun_in_the_air(_site: Site, track: Track, rng: np.random.Generator) -> Track:
    in_the_air = np.flatnonzero(track.enu_m[:, 2] > track.enu_m[0, 2] + 3.0)
    return track.taken(np.arange(rng.integers(in_the_air[0], flying(track)[0] + 1), len(track)))


def ended_in_the_air(_site: Site, track: Track, rng: np.random.Generator) -> Track:
    in_the_air = np.flatnonzero(track.enu_m[:, 2] > track.enu_m[-1, 2] + 3.0)
    return track.taken(np.arange(0, rng.integers(flying(track)[-1] + 1, in_the_air[-1])))


# Places, numbers and attitudes


def moved_away(site: Site, track: Track, rng: np.random.Generator) -> Track:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    away = rng.uniform(60.0, 600.0) * np.array([np.sin(angle), np.cos(angle), 0.0])
    return moved_to(site, track, track.enu_m + away)


def mirrored(site: Site, track: Track, rng: np.random.Generator) -> Track:
    enu = track.enu_m.copy()
    axis = int(rng.integers(2))
    enu[:, axis] = 2.0 * rng.uniform(0.0, 60.0) - enu[:, axis]
    return moved_to(site, track, enu)


def other_height_datum(site: Site, track: Track, rng: np.random.Generator) -> Track:
    """Ellipsoid heights where heights above sea level belong."""
    return moved_to(site, track, track.enu_m + np.array([0.0, 0.0, rng.choice([-1, 1]) * rng.uniform(15.0, 60.0)]))


def reversed_in_time(_site: Site, track: Track, _rng: np.random.Generator) -> Track:
    back = track.taken(np.arange(len(track))[::-1])
    return replace(back, time_s=track.time_s.copy())


def numbers_shifted(_site: Site, track: Track, rng: np.random.Generator) -> Track:
    """A higher or lower waypoint is told than is flown to, all along."""
    numbers = track.current_waypoint
    shifted = np.where(numbers >= 0, numbers + rng.choice([-1, 1]), numbers)
    return replace(track, current_waypoint=np.minimum(shifted, numbers.max()))


def numbers_too_high(_site: Site, track: Track, _rng: np.random.Generator) -> Track:
    return replace(track, current_waypoint=np.where(track.current_waypoint >= 0, track.current_waypoint + 1000, -1))


def twice_around(_site: Site, track: Track, _rng: np.random.Generator) -> Track:
    """The route once more behind itself, as if it had been flown twice."""
    lap = flying(track)
    start, end = lap[0], lap[-1] + 1
    order = np.concatenate([np.arange(end), np.arange(start, len(track))])
    step = float(np.median(np.diff(track.time_s)))
    time_s = track.time_s[0] + step * np.arange(len(order))
    return replace(track.taken(order), time_s=time_s)


MOTION: tuple[Falsify, ...] = (
    teleports, fast_clock, slow_clock, frozen, interpolated, shuffled, height_jumps, coarse,
    latitude_of_another_time, the_plan_itself,
)  # fmt: skip
UNOBSERVED: tuple[Falsify, ...] = (thinned, with_a_hole, with_many_holes, begun_in_the_air, ended_in_the_air)
POSITIONS: tuple[Falsify, ...] = (
    moved_away, mirrored, other_height_datum, reversed_in_time, numbers_shifted, numbers_too_high, twice_around,
)  # fmt: skip


# Attitudes


def attitude_in_radians(_site: Site, track: Track, _rng: np.random.Generator) -> Track:
    return replace(track, attitude_deg=np.radians(track.attitude_deg))


def attitude_out_of_range(_site: Site, track: Track, rng: np.random.Generator) -> Track:
    return replace(track, attitude_deg=track.attitude_deg + np.array([0.0, 0.0, rng.choice([-720.0, 720.0])]))


def attitude_zero(_site: Site, track: Track, _rng: np.random.Generator) -> Track:
    return replace(track, attitude_deg=np.zeros_like(track.attitude_deg))


def attitude_level_in_every_turn(_site: Site, track: Track, rng: np.random.Generator) -> Track:
    lean = rng.uniform(-1.5, 1.5, (len(track), 2))
    return replace(track, attitude_deg=np.column_stack([lean, track.attitude_deg[:, 2]]))


def attitude_too_old(_site: Site, track: Track, rng: np.random.Generator) -> Track:
    return replace(track, attitude_age_s=np.full(len(track), rng.uniform(1.1, 30.0)))


def attitude_empty(_site: Site, track: Track, _rng: np.random.Generator) -> Track:
    return replace(track, attitude_deg=np.full_like(track.attitude_deg, np.nan))


ATTITUDE: tuple[Falsify, ...] = (
    attitude_in_radians, attitude_out_of_range, attitude_zero, attitude_level_in_every_turn, attitude_too_old,
    attitude_empty,
)  # fmt: skip

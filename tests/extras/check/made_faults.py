"""Faults of ten kinds, put into good missions."""

import dataclasses

import numpy as np

from tests.extras.check.made_missions import MARGIN_M, NOTHING, Case, Row, ground_height_m, least_time_s, ring_of
from tests.naive.mission_check import Plane, path


def with_fault(case: Case, kind: str, rng: np.random.Generator) -> Case | None:
    """A copy with one fault; none where this mission, with these random numbers, has no place for it."""
    return _FAULTS[kind](case, rng)


def _waypoints(case: Case) -> list[int]:
    return [number for number, row in enumerate(case.rows, 1) if row[0] in (16, 82)]


def _changed(
    case: Case, rows: list[Row], expected: tuple[str, ...], items: tuple[int, int] | None, by_m: float
) -> Case | None:
    """The case with other items, if the naive judge says that one of the kinds is broken there by so much."""
    new = dataclasses.replace(case, rows=tuple(rows), expected=expected, items=items).judged()
    assert new.truth is not None
    broken = tuple(kind for kind in expected if new.worst(kind) > by_m)
    if not broken:
        return None
    pair = max(new.truth[broken[0]], key=lambda each: new.truth[broken[0]][each])  # type: ignore[index]
    return dataclasses.replace(new, expected=broken, items=pair if items is None else items)


def _hill(case: Case, rng: np.random.Generator) -> Case | None:
    if any(row[0] == 177 for row in case.rows):
        return None
    waypoints = _waypoints(case)
    first = int(rng.integers(1, len(waypoints)))
    count = int(rng.integers(1, 8))
    gone = set(waypoints[first : first + count])
    return _changed(case, [row for n, row in enumerate(case.rows, 1) if n not in gone], ("ground",), None, 2.0)


def _no_fly(case: Case, rng: np.random.Generator) -> Case | None:
    plane = Plane(*case.home)
    waypoints = _waypoints(case)
    k = int(rng.integers(0, len(waypoints) - 1))
    a, b = (plane.to(*case.rows[waypoints[n] - 1][3:5]) for n in (k, k + 1))
    length = float(np.hypot(*(b - a)))
    if length < 12.0 or waypoints[k + 1] != waypoints[k] + 1:
        return None
    u = (b - a) / length
    v = np.array([-u[1], u[0]])
    # Its corner reaches over the leg by 2 to 6 m, between the waypoints.
    middle, over = a + u * length * rng.uniform(0.35, 0.65), rng.uniform(2.0, 6.0)
    positions = [
        middle - v * over,
        middle + (u - v * 0.2) * 4.0 + v * 30.0,
        middle + v * 60.0,
        middle - u * 4.0 + v * 30.0,
    ]
    zone = (ring_of(plane, [tuple(position) for position in positions]), float(rng.choice([0.0, 10.0])), 300.0)
    new = dataclasses.replace(case, zone=zone, expected=("no-fly",)).judged()
    assert new.truth is not None
    if new.worst("no-fly") < 0.5:
        return None
    return dataclasses.replace(new, items=max(new.truth["no-fly"], key=lambda each: new.truth["no-fly"][each]))  # type: ignore[index]


def _spline(case: Case, rng: np.random.Generator) -> Case | None:
    if case.px4:
        return None
    waypoints = _waypoints(case)
    first = int(rng.integers(0, len(waypoints)))
    chosen = set(waypoints[first : first + int(rng.integers(1, 6))])
    rows = [(82, row[1], NOTHING, *row[3:]) if n in chosen else row for n, row in enumerate(case.rows, 1)]
    # The fence is drawn 5 m around the straight legs, as people draw it.
    plane = Plane(*case.home)
    straight = [(16, *row[1:]) if row[0] == 82 else row for row in case.rows]
    home_m = ground_height_m(case.terrain.ground, plane, np.zeros(2))
    flown = np.vstack([points for *_, points in path(straight, plane, home_m, case.return_m, px4=False)])
    low, high = flown[:, :2].min(axis=0) - 5.0, flown[:, :2].max(axis=0) + 5.0
    fence = ring_of(plane, [tuple(low), (high[0], low[1]), tuple(high), (low[0], high[1])])
    return _changed(dataclasses.replace(case, fence=fence), rows, ("ground", "fence"), None, MARGIN_M)  # type: ignore[arg-type]


def _jump(case: Case, rng: np.random.Generator) -> Case | None:
    if any(row[0] == 177 for row in case.rows):
        return None
    waypoints = _waypoints(case)
    at = int(rng.integers(0, len(waypoints) - 3))
    over = int(rng.integers(2, 12))
    if at + over >= len(waypoints):
        return None
    # Behind item ``number`` stands the jump, so that what follows is one number later.
    number, target = waypoints[at], waypoints[at + over] + 1
    jump: Row = (177, 2, (float(target), 1.0, 0.0, 0.0), 0.0, 0.0, 0.0)
    rows = [*case.rows[:number], jump, *case.rows[number:]]
    return _changed(case, rows, ("ground",), (number, target), 2.0)


def _frame(case: Case, rng: np.random.Generator) -> Case | None:
    waypoints = _waypoints(case)
    chosen = set(waypoints) if rng.random() < 0.4 else {int(rng.choice(waypoints))}
    rows = [(row[0], 3 - row[1], *row[2:]) if n in chosen else row for n, row in enumerate(case.rows, 1)]
    return _changed(case, rows, ("ground", "height"), (min(chosen), max(chosen)), 2.0)  # type: ignore[arg-type]


def _feet(case: Case, rng: np.random.Generator) -> Case | None:
    waypoints = _waypoints(case)
    if any(case.rows[n - 1][1] != 3 for n in waypoints):
        return None
    factor = 0.3048 if rng.random() < 0.5 else 1.0 / 0.3048
    rows = [(*row[:5], row[5] * factor) if n in waypoints else row for n, row in enumerate(case.rows, 1)]
    return _changed(case, rows, ("ground", "height"), (waypoints[0], waypoints[-1]), 2.0)  # type: ignore[arg-type]


def _swapped(case: Case, rng: np.random.Generator) -> Case | None:
    waypoints = _waypoints(case)
    how = rng.random()
    chosen = set(waypoints) if how < 0.6 else {int(rng.choice(waypoints))}
    rows = [(*row[:3], row[4], row[3], row[5]) if n in chosen else row for n, row in enumerate(case.rows, 1)]
    everything = how < 0.3
    items = (0, 0) if everything else (min(chosen), max(chosen))
    return dataclasses.replace(
        case, rows=tuple(rows), truth=None, expected=("place", "refused"), items=items, swap_home=everything
    )  # type: ignore[arg-type]


def _fence(case: Case, rng: np.random.Generator) -> Case | None:
    plane = Plane(*case.home)
    corners = np.array([plane.to(lat, lon) for lon, lat in case.fence])
    west, south = corners.min(axis=0)
    east, north = corners.max(axis=0)
    shrink = rng.uniform(27.0, 60.0)
    side = int(rng.integers(0, 4))
    west, south, east, north = (
        west + shrink * (side == 0), south + shrink * (side == 1), east - shrink * (side == 2), north - shrink * (side == 3),
    )  # fmt: skip
    fence = ring_of(plane, [(west, south), (east, south), (east, north), (west, north)])
    return _changed(dataclasses.replace(case, fence=fence), list(case.rows), ("fence",), None, MARGIN_M)


def _battery(case: Case, rng: np.random.Generator) -> Case | None:
    least_s = least_time_s(case.rows, case.home, case.terrain.ground, case.return_m, px4=case.px4)
    return dataclasses.replace(
        case, battery_s=round(least_s * rng.uniform(0.7, 1.2)), expected=("battery",), items=None
    )


def _return(case: Case, rng: np.random.Generator) -> Case | None:
    lower = dataclasses.replace(case, return_m=float(rng.uniform(15.0, max(16.0, case.return_m - 5.0))))
    return _changed(lower, list(case.rows), ("return",), None, 2.0)


_FAULTS = {
    "hill": _hill, "no-fly": _no_fly, "spline": _spline, "jump": _jump, "frame": _frame, "feet": _feet, "swapped": _swapped,
    "fence": _fence, "battery": _battery, "return": _return,
}  # fmt: skip

"""Starts that keep two flights apart, against looking at every moment; distances of pieces against many points on them."""

import dataclasses
import itertools
import math

import numpy as np
import pytest

from tests.missions.test_sorties import SPHERE, there_and_back
from tests.naive.fleet import least_distance
from tests.planner.sites import flat, hills, make_site
from uavcover.missions.fleet_schedule import (
    PathPieces,
    Timeline,
    merged,
    near_pieces,
    pieces_of,
    safe_start_s,
    schedule,
    segment_distances_m,
    timeline_of,
    unsafe_starts,
)
from uavcover.missions.flights import compile_sorties
from uavcover.model.sensor import SphereSensor
from uavcover.model.vehicle import AutopilotName, Fleet

FLEET = Fleet(vehicles=2, separation_m=15.0, timing_error_fraction=0.05, start_error_s=3.0, pad_s=0.0)


def conflict_m(a: PathPieces, b: PathPieces, fleet: Fleet, *, start_s: float) -> float:
    """Least distance of a and b where they may come too close when b starts ``start_s`` after a; infinite where they do not."""
    first, second, distance_m = near_pieces(a, b, fleet.planned_separation_m)
    meets = (b.earliest_s[second] + start_s < a.latest_s[first]) & (b.latest_s[second] + start_s > a.earliest_s[first])
    return float(distance_m[meets].min(initial=math.inf))


def random_flight(rng: np.random.Generator) -> Timeline:
    """From a common home, to some places, and back."""
    points = rng.uniform([-150.0, -150.0, 20.0], [150.0, 150.0, 60.0], (int(rng.integers(2, 6)), 3))
    path = np.vstack([[0.0, 0.0, 0.0], [0.0, 0.0, 30.0], points, [0.0, 0.0, 30.0], [0.0, 0.0, 0.0]])
    times = np.linalg.norm(np.diff(path, axis=0), axis=1) / rng.uniform(4.0, 9.0, len(path) - 1)
    return Timeline(np.concatenate([[0.0], np.cumsum(times)]), path)


def naive_distance_m(a: Timeline, b: Timeline, start_s: float, fleet: Fleet, step_s: float = 0.5) -> float:
    return least_distance(
        a.time_s, a.position_m, b.time_s, b.position_m, start_s,
        fraction=fleet.timing_error_fraction, start_error_s=fleet.start_error_s, step_s=step_s,
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(6))
def test_unsafe_starts_are_those_that_bring_two_vehicles_too_near(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = random_flight(rng), random_flight(rng)
    excluded = unsafe_starts(pieces_of(a, FLEET), pieces_of(b, FLEET), FLEET)
    assert len(excluded) > 0, "both leave from one place"
    assert (np.diff(excluded.ravel()) >= 0.0).all()
    for start_s in rng.uniform(excluded[0, 0] - 20.0, excluded[-1, 1] + 20.0, 15):
        inside = bool(((excluded[:, 0] < start_s) & (start_s < excluded[:, 1])).any())
        edge_s = float(np.abs(excluded - start_s).min())
        distance_m = naive_distance_m(a, b, start_s, FLEET)
        if not inside:
            assert distance_m >= FLEET.planned_separation_m - 1e-6
        elif edge_s > 4.0:
            # Pieces of ten metres take a little more time than their nearest points.
            assert distance_m < FLEET.planned_separation_m + 2.5
        nearest_m = conflict_m(pieces_of(a, FLEET), pieces_of(b, FLEET), FLEET, start_s=start_s)
        assert (nearest_m < math.inf) == inside
        if inside:
            assert nearest_m <= min(distance_m + 1e-6, FLEET.planned_separation_m)


def test_the_next_safe_start() -> None:
    intervals = merged(np.array([[5.0, 9.0], [-3.0, 1.0], [0.0, 4.0], [9.0, 10.0], [20.0, 21.0]]))
    assert intervals.tolist() == [[-3.0, 4.0], [5.0, 9.0], [9.0, 10.0], [20.0, 21.0]]
    for wanted, safe in ((-5.0, -5.0), (-3.0, -3.0), (-2.9, 4.0), (4.5, 4.5), (8.0, 9.0), (9.5, 10.0), (30.0, 30.0)):
        assert safe_start_s(intervals, wanted) == pytest.approx(safe, abs=1e-5)
    assert safe_start_s(np.empty((0, 2)), 7.0) == 7.0


def test_distances_of_pieces() -> None:
    rng = np.random.default_rng(5)
    ends = [rng.uniform(-5.0, 5.0, (60, 3)) for _ in range(4)]
    ends[1][:5] = ends[0][:5]  # points
    ends[3][3:8] = ends[2][3:8]
    ends[3][8:12] = ends[2][8:12] + (ends[1] - ends[0])[8:12]  # parallel
    fraction = np.linspace(0.0, 1.0, 201)[:, None]
    found = segment_distances_m(*ends)
    for k in range(60):
        p, q = (ends[i][k] + fraction * (ends[i + 1][k] - ends[i][k]) for i in (0, 2))
        dense = np.linalg.norm(p[:, None] - q[None], axis=2).min()
        assert dense - 0.06 <= found[k] <= dense + 1e-9


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
@pytest.mark.parametrize("sensor", [None, SPHERE], ids=["along the path", "at waypoints"])
def test_the_times_along_a_mission_end_with_its_flight_time(
    autopilot: AutopilotName, sensor: SphereSensor | None
) -> None:
    site = make_site(hills, **({} if sensor is None else {"sensor": sensor}))
    for sortie in compile_sorties(site, there_and_back(site, lines=6), autopilot=autopilot, vehicles=2):
        timeline = timeline_of(site, sortie, autopilot=autopilot)
        assert timeline.duration_s == pytest.approx(sortie.compiled.flight_time_s, rel=1e-9)
        assert (np.diff(timeline.time_s) >= 0.0).all()
        assert (timeline.position_m[[0, -1]] == site.home_m).all()
        speeds = np.linalg.norm(np.diff(timeline.position_m, axis=0), axis=1) / np.maximum(
            np.diff(timeline.time_s), 1e-9
        )
        assert speeds.max() < 15.0


@pytest.mark.parametrize("vehicles", [2, 3])
def test_planned_flights_stay_apart_whoever_is_late(vehicles: int) -> None:
    site = make_site(hills, vehicle={"endurance_s": 200.0})
    fleet = Fleet(vehicles=vehicles, separation_m=12.0, turnaround_s=60.0, pad_s=20.0)
    site = dataclasses.replace(site, scenario=dataclasses.replace(site.scenario, fleet=fleet))
    flights = compile_sorties(site, there_and_back(site, lines=8), autopilot="ardupilot", vehicles=vehicles)
    assert len(flights) >= vehicles
    timelines = [timeline_of(site, flight, autopilot="ardupilot") for flight in flights]
    starts = schedule(timelines, fleet)
    assert {type(start.start_s) for start in starts} == {float}, "NumPy writes its own as np.float64(...)"
    assert min(start.start_s for start in starts) == 0.0
    assert len({start.vehicle for start in starts}) >= 2
    assert {start.vehicle for start in starts} <= set(range(vehicles))
    for (i, a), (j, b) in itertools.combinations(enumerate(starts), 2):
        if a.vehicle != b.vehicle:
            apart_m = naive_distance_m(timelines[i], timelines[j], b.start_s - a.start_s, fleet, step_s=1.0)
            assert apart_m >= fleet.separation_m - 1e-6
            # And nobody flies over a vehicle that stands at home before its take-off or after its landing.
            for standing, other, since_s in ((i, j, b.start_s - a.start_s), (j, i, a.start_s - b.start_s)):
                home, landed_s = timelines[standing].position_m[:1], timelines[standing].duration_s
                for moment in (np.array([-20.0, 0.0]), np.array([landed_s, landed_s + 20.0])):
                    pad = Timeline(moment, np.vstack([home, home]))
                    assert naive_distance_m(pad, timelines[other], since_s, fleet, step_s=1.0) >= 12.0 - 1e-6
        else:
            first, second = sorted(((a.start_s, i), (b.start_s, j)))
            landed_s = first[0] + (1.0 + fleet.timing_error_fraction) * timelines[first[1]].duration_s
            assert second[0] >= landed_s + fleet.start_error_s + fleet.turnaround_s - 1e-6
    again = schedule(timelines, fleet)
    assert again == starts


def test_two_flights_from_one_place_start_one_after_the_other() -> None:
    site = make_site(flat)
    fleet = Fleet(vehicles=2)
    flights = compile_sorties(site, there_and_back(site), autopilot="ardupilot", vehicles=2)
    pieces = [pieces_of(timeline_of(site, flight, autopilot="ardupilot"), fleet) for flight in flights]
    assert conflict_m(pieces[0], pieces[1], fleet, start_s=0.0) == 0.0

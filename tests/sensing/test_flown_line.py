"""The line that is flown through waypoints, against the legs of the mock vehicle, small steps of time, and flights."""

import dataclasses
import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from scripts.bench.kinds import measure
from tests.naive.flown_line import arducopter, passed_corners, reached_positions
from tests.planner.sites import make_site
from tests.sensing.flown_lines import positions_when_passed, track_of_legs
from tests.terrain_kinds import write_scenario
from uavcover.model.vehicle import MOTIONS
from uavcover.scenario.site import Site, load_site
from uavcover.scenario.vehicles import moving_pace
from uavcover.sensing.flown_line import corners_matter, line_flown, positions_passed_m, rounded_corners
from uavcover.sensing.site_maps import judging_map

PACE = moving_pace(
    MOTIONS["ardupilot"], cruise_m_s=10.0, climb_m_s=4.0, descent_m_s=3.0, airspeed_m_s=None, wind_m_s=(0.0, 0.0)
)

ROUTES = {
    "lines of a survey": [(0, 0, 60), (200, 0, 60), (200, 40, 60), (0, 40, 60), (0, 80, 60), (200, 80, 60)],
    "a small area": [(-80, -50, 60), (-10, -4, 55), (12, 3, 58), (-80, -50, 60)],
    "sharp and flat turns": [(0, 0, 50), (120, 0, 70), (20, 15, 60), (90, 40, 60), (180, 70, 80)],
    "short legs": [(0, 0, 50), (9, 0, 50), (9, 9, 50), (20, 9, 56), (20, 30, 50)],
    "nearly straight": [(0, 0, 50), (100, 0, 50), (200, 8, 50), (300, 0, 50)],
}  # fmt: skip


_CLOSE_M = 0.12


@pytest.mark.parametrize("name", ROUTES)
def test_corners_are_flown_as_the_mock_vehicle_flies_them(name: str) -> None:
    points = np.array(ROUTES[name], dtype=float)
    track = track_of_legs(MOTIONS["ardupilot"], points, cruise_m_s=10.0, climb_m_s=4.0, descent_m_s=3.0)
    corners = rounded_corners(PACE, points).positions_m
    middles = corners[:, corners.shape[1] // 2]
    for corner in corners:
        assert max(float(np.linalg.norm(track - position, axis=1).min()) for position in corner) < _CLOSE_M
    for middle, point in zip(middles, points[1:-1], strict=True):
        nearest = float(np.linalg.norm(track - point, axis=1).min())
        assert np.linalg.norm(middle - point) == pytest.approx(nearest, abs=_CLOSE_M)
    assert np.linalg.norm(middles - points[1:-1], axis=1).max() > 0.5


@pytest.mark.parametrize("name", ROUTES)
def test_corners_are_those_of_small_steps_of_time(name: str) -> None:
    points = ROUTES[name]
    vehicle = {"cruise_speed_m_s": 10.0, "max_climb_m_s": 4.0, "max_descent_m_s": 3.0}
    slowly, steps_s = passed_corners(points, arducopter(vehicle), steps=200)
    corners, each_s = rounded_corners(PACE, np.array(points, dtype=float))
    np.testing.assert_allclose(corners[:, corners.shape[1] // 2], slowly[:, 100], atol=0.15)
    np.testing.assert_allclose((corners.shape[1] - 1) * each_s, 200 * steps_s, rtol=0.06)
    # Where on the straight leg a corner begins depends on the step of time; the line does not.
    for k, corner in enumerate(corners):
        before = np.linspace(points[k], slowly[k, 0], 2_000)
        line = np.vstack([before, slowly[k], np.linspace(slowly[k, -1], points[k + 2], 2_000)])
        assert max(float(np.linalg.norm(line - position, axis=1).min()) for position in corner) < 0.15


@pytest.mark.parametrize("name", ROUTES)
def test_px4_has_reached_a_waypoint_before_it_is_there(name: str) -> None:
    """As the mock vehicle does; it is half a metre behind the place that leads it."""
    points = np.array(ROUTES[name], dtype=float)
    site = make_site(
        home=(points[0, 0], points[0, 1]), vehicle={"autopilot": "px4"} | {"takeoff_height_m": float(points[0, 2])}
    )
    reached = positions_passed_m(site, points[1:])
    np.testing.assert_allclose(reached, reached_positions(points), atol=0.02)
    off_m = np.linalg.norm(reached - points[1:], axis=1)
    assert (off_m > 0.7).all()
    assert (off_m <= 2.2).all()
    flown = positions_when_passed(MOTIONS["px4"], points, cruise_m_s=10.0, climb_m_s=4.0, descent_m_s=3.0)
    assert np.linalg.norm(reached - flown, axis=1).max() < 1.0
    # The line ends there, and leads through the other waypoints; so does the track, but for its bends.
    line = line_flown(site, points[1:]).positions_m
    np.testing.assert_array_equal(line, [*points[1:-1], reached[-1]])
    track = track_of_legs(MOTIONS["px4"], points, cruise_m_s=10.0, climb_m_s=4.0, descent_m_s=3.0)
    dense = np.vstack([np.linspace(a, b, 300) for a, b in itertools.pairwise([points[0], *line])])
    assert np.mean([np.linalg.norm(dense - position, axis=1).min() for position in track[::10]]) < 0.5
    only_waypoints = dataclasses.replace(site.scenario.limits, applies_to="waypoints")
    paper = dataclasses.replace(site, scenario=dataclasses.replace(site.scenario, limits=only_waypoints))
    np.testing.assert_array_equal(positions_passed_m(paper, points[1:]), points[1:])


def small_site(tmp_path: Path, sensor: str, terrain: str = "40 m") -> Site:
    return load_site(str(write_scenario(tmp_path, terrain, sensor)))


def test_the_line_begins_and_ends_nearly_on_its_legs_where_its_ends_are_passed(tmp_path: Path) -> None:
    """How they are passed depends on the ways there and home: a cliff was in view from the first place, and not in flight."""
    site = small_site(tmp_path, "nadir")
    route = np.array([[62.0, 40.0, 84.0], [80.0, 55.0, 84.0], [98.0, 40.0, 84.0]])
    line, passed = line_flown(site, route).positions_m, positions_passed_m(site, route)
    off = np.linalg.norm(passed - route, axis=1)
    assert (off > 0.2).all()
    assert (off <= 2.0).all()
    assert np.linalg.norm(line - passed[1], axis=1).min() == 0.0
    for end, leg, passed_m in ((line[0], route[:2], passed[0]), (line[-1], route[:0:-1], passed[2])):
        step = (leg[1] - leg[0]) / np.linalg.norm(leg[1] - leg[0])
        beside_m = np.linalg.norm((end - leg[0]) - ((end - leg[0]) @ step) * step)
        assert beside_m < 0.35 * np.linalg.norm(passed_m - leg[0])
        assert 0.0 < (end - passed_m) @ step < 7.0
    # A single waypoint is passed on the way home.
    assert len(line_flown(site, route[:1]).positions_m) == 1
    assert 0.2 < np.linalg.norm(positions_passed_m(site, route[:1]) - route[:1]) <= 2.0


def test_pictures_by_distance_begin_at_a_stop_with_the_heading_of_the_way_there(tmp_path: Path) -> None:
    site = small_site(tmp_path, "survey")
    route = np.array([[62.0, 40.0, 84.0], [40.0, 90.0, 84.0]])
    looks = judging_map(site).flown_observations(route)
    np.testing.assert_array_equal(looks.positions_m[0], route[0])
    np.testing.assert_array_equal(looks.headings[0], route[0, :2] - site.home_m[:2])
    np.testing.assert_allclose(looks.headings[1], route[1, :2] - route[0, :2], rtol=0.2)


def test_the_nose_stays_where_it_is_while_the_vehicle_hardly_moves(tmp_path: Path) -> None:
    site = small_site(tmp_path, "tilted")
    # At the second waypoint it nearly turns back, and its nose swings around in the last centimetres of the line.
    route = np.array([[62.0, 40.0, 84.0], [80.0, 55.0, 84.0], [40.0, 28.0, 84.0]])
    line = line_flown(site, route)
    steps = np.diff(line.positions_m[:, :2], axis=0)
    off = _turned_deg(line.headings, steps)
    size_m = np.hypot(steps[:, 0], steps[:, 1])
    # Up to there it points along the line, and behind it as soon as it has come round (tests/sensing/test_yaw_in_turns.py).
    back = int(np.argmax(_turned_deg(steps, np.tile(steps[0], (len(steps), 1))) > 90.0))
    before = off[:back]
    assert before[size_m[:back] > 0.25].max() < 1e-3
    assert before.max() > 10.0
    assert size_m[:back][before > 10.0].max() < 0.15
    assert off[back:].max() > 90.0
    assert (np.diff(off[back:]) < 1e-3).all()
    assert off[-1] < 1e-3
    looks = judging_map(site).flown_observations(route)
    np.testing.assert_array_equal(looks.headings[-1], line.headings[-1])


def _turned_deg(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    across = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    return np.abs(np.degrees(np.arctan2(across, (one * other).sum(axis=1))))


def test_pictures_by_distance_are_counted_along_the_line_that_is_flown_over_any_area(tmp_path: Path) -> None:
    site = small_site(tmp_path, "sparse", "flat")
    assert corners_matter(site)
    east, north = np.array([100.0, 410.0]), 100.0 + 29.0 * np.arange(6)
    route = np.array([[e, n, 200.0] for k, n in enumerate(north) for e in (east if k % 2 == 0 else east[::-1])])
    fine = judging_map(site)
    flown, straight = fine.flown_observations(route), fine.observations(route)
    # Through the waypoints a picture is due in each bend. The vehicle passes on the inside, and all later ones come later.
    assert len(flown) < len(straight)
    late_m = np.linalg.norm(flown.positions_m - straight.positions_m[: len(flown)], axis=1)
    assert late_m[:7].max() < 0.01
    assert late_m[-1] > 100.0


@pytest.mark.parametrize(("sensor", "terrain"), [("nadir", "flat"), ("sphere", "flat"), ("tilted", "40 m")])
def test_every_sensor_sees_from_the_line_that_is_flown_over_any_area(tmp_path: Path, sensor: str, terrain: str) -> None:
    """Planned for straight lines over 460 m, flights saw up to 0.6 points less."""
    site = small_site(tmp_path, sensor, terrain)
    assert corners_matter(site)
    route = np.array([[100.0, 100.0, 84.0], [200.0, 100.0, 84.0], [200.0, 150.0, 84.0]])
    fine = judging_map(site)
    corner = fine.flown_observations(route).positions_m
    off_m = np.linalg.norm(corner - route[1], axis=1).min()
    assert 0.5 < off_m < 2.5
    assert np.linalg.norm(fine.observations(route).positions_m - route[1], axis=1).min() == 0.0


def test_lines_that_are_flown_exactly_stay_as_they_are(tmp_path: Path) -> None:
    route = np.array([[100.0, 100.0, 84.0], [200.0, 100.0, 84.0], [200.0, 150.0, 84.0]])
    small = small_site(tmp_path, "nadir")
    at_once = dataclasses.replace(small.scenario.vehicle, acceleration_m_s2=math.inf)
    waypoints_only = dataclasses.replace(small.scenario.limits, applies_to="waypoints")
    assert not corners_matter(
        dataclasses.replace(small, scenario=dataclasses.replace(small.scenario, limits=waypoints_only))
    )
    for other in (
        dataclasses.replace(small, scenario=dataclasses.replace(small.scenario, vehicle=at_once)),
        dataclasses.replace(small, home_m=None),
    ):
        assert not corners_matter(other)
        np.testing.assert_array_equal(line_flown(other, route).positions_m, route)


def test_vehicles_of_a_fleet_pass_their_ends_each_from_its_own_home(tmp_path: Path) -> None:
    site = small_site(tmp_path, "nadir")
    route = np.array([[62.0, 20.0, 60.0], [70.0, 28.0, 60.0]])
    away = dataclasses.replace(site, home_m=site.home_m + np.array([160.0, 0.0, 0.0]))
    fine = judging_map(site)
    assert (fine.observed(route) != fine.flown_from(away).observed(route)).any()


@pytest.mark.parametrize("sensor", ["nadir", "survey"])
def test_a_flight_over_a_small_area_sees_what_is_planned(sensor: str, tmp_path: Path) -> None:
    row = measure(tmp_path, "40 m", sensor, 1, evaluations=60, flown=True)
    assert row.met
    assert row.flown >= row.claimed - 0.003
    assert row.recomputed == pytest.approx(row.claimed, abs=0.003)

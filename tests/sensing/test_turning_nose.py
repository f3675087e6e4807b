"""The nose that turns at a limited rate, against small steps of time, and what a camera sees meanwhile."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from tests.naive.flown_line import px4_begins, turning
from tests.planning.sites import make_site
from tests.terrain_kinds import write_scenario
from uavcover.model.sensor import FrameCamera
from uavcover.model.vehicle import MOTIONS, AutopilotName
from uavcover.scenario.pace import moving_pace
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.coverage_map import judging_map
from uavcover.sensing.flown_line import line_flown
from uavcover.sensing.turning_nose import YAW_RATE_DEG_S, Pieces, braked_speeds_m_s, turned_line

PACE = moving_pace(
    MOTIONS["px4"], cruise_m_s=10.0, climb_m_s=4.0, descent_m_s=3.0, airspeed_m_s=None, wind_m_s=(0.0, 0.0)
)

FORWARD = FrameCamera(
    kind="frame-camera", fov_across_deg=50.0, fov_along_deg=40.0, range_m=250.0, pitch_deg=-50.0, mount="stabilised"
)

ROUTES = {
    "lines": [(0, 0, 60), (200, 0, 60), (200, 40, 60), (0, 40, 60)],
    "turns back": [(0, 0, 60), (150, 0, 60), (10, 6, 60), (160, 10, 60)],
    "a short leg back": [(0, 0, 60), (100, 0, 60), (96.4, 0.1, 60)],
    "short legs": [(0, 0, 60), (4, 0, 60), (4, 4, 60), (1, 5, 62), (2, 1, 60), (40, 1, 60)],
    "straight up": [(0, 0, 60), (50, 0, 60), (50, 0, 80), (0, 5, 80)],
}  # fmt: skip


def px4_site(sensor: FrameCamera = FORWARD) -> Site:
    return make_site(home=(-100.0, 50.0), sensor=sensor, vehicle={"autopilot": "px4"})


def courses_deg(headings: np.ndarray) -> np.ndarray:
    return np.degrees(np.arctan2(headings[:, 0], headings[:, 1]))


def off_deg(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.abs((one - other + 180.0) % 360.0 - 180.0)


def piece_at(places_m: np.ndarray, way_m: np.ndarray) -> np.ndarray:
    """(m,) number of the piece that is flown so many (m,) metres from the beginning."""
    ends_m = np.cumsum(np.linalg.norm(np.diff(places_m, axis=0), axis=1))
    return np.searchsorted(ends_m, way_m)


@pytest.mark.parametrize("before", [(0.0, 1.0), (1.0, 0.0), (-1.0, 0.3)])
@pytest.mark.parametrize("name", ROUTES)
def test_the_nose_turns_as_in_small_steps_of_time(name: str, before: tuple[float, float]) -> None:
    line = np.array(ROUTES[name], dtype=float)
    ways, legs = np.diff(line[:, :2], axis=0), np.zeros(len(line) - 1)
    begins = braked_speeds_m_s(PACE, ways, np.array(before))
    np.testing.assert_allclose(begins, px4_begins(line, before, 10.0), atol=1e-4)
    sizes_m = np.linalg.norm(np.diff(line, axis=0), axis=1)
    turned = turned_line(PACE, line, Pieces(ways, legs, sizes_m, begins), np.array(before))
    slowly, noses = turning(line, legs, ways, begins, before, PACE.cruise_m_s, PACE.acceleration_m_s2, step_s=0.002)
    np.testing.assert_array_equal(turned.places_m[turned.numbers], line)
    length_m = float(sizes_m.sum())
    way_m = np.linspace(0.01, length_m - 0.01, 4_000)
    mine, theirs = turned.headings[piece_at(turned.places_m, way_m)], np.array(noses)[piece_at(slowly, way_m)]
    np.testing.assert_array_equal(mine.any(axis=1), theirs.any(axis=1))
    known = mine.any(axis=1)
    off = off_deg(courses_deg(mine[known]), courses_deg(theirs[known]))
    # Less than 5 degrees of a turn is none.
    assert off.max() < 5.5
    assert off.mean() < 1.0


def test_the_nose_is_late_on_pieces_of_corners_and_on_the_legs_behind_them() -> None:
    # Two pieces of a corner to the north; the nose, which points east, has turned by 60 degrees behind them.
    line = np.array([[0.0, 0, 60], [1.0, 0, 60], [1.0, 1.0, 60], [1.0, 2.0, 60], [1.0, 90.0, 60]])
    ways = np.diff(line[:, :2], axis=0)
    pieces = Pieces(
        ways, np.array([0.5, 0.5, 0.5, 0.0]), np.array([1.0, 1.0, 1.0, 88.0]), np.array([0.0, 0.0, 0.0, 2.0])
    )
    turned = turned_line(PACE, line, pieces, ways[0])
    headings = courses_deg(turned.headings)
    np.testing.assert_allclose(headings[:3], [90.0, 90.0 - 0.5 * YAW_RATE_DEG_S, 90.0 - YAW_RATE_DEG_S])
    # From there 30 degrees in half a second, at 2 m/s and more.
    np.testing.assert_allclose(headings[3:], [*np.arange(28.5, 0.0, -3.0), 0.0], atol=1e-9)
    speed_m_s, half_s = 2.0, 0.5
    assert turned.places_m[-2, 1] - 2.0 == pytest.approx(speed_m_s * half_s + 0.5 * 3.0 * half_s**2)


@pytest.mark.parametrize("turn_rad", [0.0, 1e-12, 1e-3, 3.0])
def test_on_a_leg_without_length_the_nose_stays(turn_rad: float) -> None:
    line = np.array(
        [[0.0, 0.0, 60.0], [50.0, 0.0, 60.0], [50.0 + 2.0 * math.cos(turn_rad), 2.0 * math.sin(turn_rad), 60.0]]
    )
    ways = np.diff(line[:, :2], axis=0)
    pieces = Pieces(ways, np.zeros(2), np.array([50.0, 0.0]), np.zeros(2))
    turned = turned_line(PACE, line, pieces, ways[0])
    np.testing.assert_array_equal(turned.places_m, line)
    np.testing.assert_allclose(courses_deg(turned.headings), 90.0, atol=1e-6)


def test_a_short_leg_back_is_not_seen_along() -> None:
    """A plan had a last leg of 3.6 m back, claimed all of an area, and its flight saw 85 %."""
    site = px4_site()
    there = np.array([[0.0, 50.0, 60.0], [60.0, 50.0, 60.0]])
    short, longer, far = (np.vstack([there, [[60.0 - back_m, 50.0, 60.0]]]) for back_m in (3.6, 6.0, 40.0))
    turned = [
        off_deg(courses_deg(line_flown(site, route).headings), np.array(90.0)).max() for route in (short, longer, far)
    ]
    # PX4 has reached a waypoint 2 m before it: the leg of 3.6 m is over when it begins, that of 6 m has 2 m, or 1.2 s.
    assert turned[0] < 1e-6
    assert turned[1] == pytest.approx(YAW_RATE_DEG_S * math.sqrt(2.0 * 2.0 / 3.0), abs=3.0)
    assert turned[2] == pytest.approx(180.0)
    fine = judging_map(site)
    behind = fine.seen(far) & ~fine.seen(there)
    assert behind.sum() > 50
    assert (fine.seen(short) & behind).sum() < 0.1 * behind.sum()
    assert (fine.seen(longer) & behind).sum() < 0.75 * behind.sum()


def test_legs_inside_the_radius_of_px4_do_not_turn_the_nose() -> None:
    """With two waypoints 1.3 m apart the line leads back to where both count as reached, which is before the first of them."""
    site = px4_site()
    line = line_flown(site, np.array([[0.0, 50.0, 60.0], [-0.6, 51.2, 60.0]]))
    np.testing.assert_allclose(courses_deg(line.headings), 90.0, atol=1.0)


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_lines_of_sensors_that_do_not_turn_have_no_more_places(autopilot: AutopilotName) -> None:
    route = np.array([[0.0, 50.0, 60.0], [60.0, 50.0, 60.0], [54.0, 50.0, 60.0], [0.0, 0.0, 60.0]])
    held = dataclasses.replace(FORWARD, heading_deg=30.0)
    down = make_site(home=(-100.0, 50.0), vehicle={"autopilot": autopilot})
    fixed = make_site(home=(-100.0, 50.0), sensor=held, vehicle={"autopilot": autopilot})
    turns = make_site(home=(-100.0, 50.0), sensor=FORWARD, vehicle={"autopilot": autopilot})
    for one in (down, fixed):
        line = line_flown(one, route)
        assert len(line.places_m) < len(line_flown(turns, route).places_m)
        if autopilot == "px4":
            np.testing.assert_array_equal(line.places_m[:-1], route[:-1])
            np.testing.assert_array_equal(line.headings, np.diff(line.places_m[:, :2], axis=0))


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_the_line_itself_and_its_ends_stay_where_they_are(autopilot: AutopilotName) -> None:
    route = np.array([[0.0, 50.0, 60.0], [60.0, 50.0, 60.0], [20.0, 55.0, 60.0], [0.0, 0.0, 60.0]])
    down = line_flown(make_site(home=(-100.0, 50.0), vehicle={"autopilot": autopilot}), route).places_m
    turning_line = line_flown(make_site(home=(-100.0, 50.0), sensor=FORWARD, vehicle={"autopilot": autopilot}), route)
    np.testing.assert_array_equal(turning_line.places_m[[0, -1]], down[[0, -1]])
    length_m = np.linalg.norm(np.diff(turning_line.places_m, axis=0), axis=1).sum()
    assert length_m == pytest.approx(np.linalg.norm(np.diff(down, axis=0), axis=1).sum())
    assert {tuple(place) for place in down.tolist()} <= {tuple(place) for place in turning_line.places_m.tolist()}


def test_pictures_by_distance_have_the_headings_of_their_pieces(tmp_path: Path) -> None:
    site = load_site(str(write_scenario(tmp_path, "40 m", "survey")))
    px4 = dataclasses.replace(site.scenario.vehicle, autopilot="px4")
    site = dataclasses.replace(site, scenario=dataclasses.replace(site.scenario, vehicle=px4))
    route = np.array([[0.0, 0.0, 84.0], [100.0, 0.0, 84.0], [0.0, 3.0, 84.0]])
    line, looks = line_flown(site, route), judging_map(site).flown_observations(route)
    corner = int(np.argmin(np.linalg.norm(line.places_m - route[1], axis=1)))
    assert math.dist(line.places_m[corner + 1], route[1]) < 1.0
    ends_m = np.cumsum(np.linalg.norm(np.diff(line.places_m, axis=0), axis=1))
    for place, heading in zip(looks.places_m[1:], looks.headings[1:], strict=True):
        near = [k for k, each in enumerate(line.headings) if np.array_equal(each, heading)]
        off_m = [_from_piece_m(place, line.places_m[k], line.places_m[k + 1]) for k in near]
        assert min(off_m) < 1e-6
    assert len(ends_m) > len(route)


def _from_piece_m(place: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    share = np.clip((place - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
    return float(np.linalg.norm(a + share * (b - a) - place))

"""What a camera sees while the nose turns at a limited rate (the turning itself: tests/kernels/test_yaw_in_turns.py)."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from tests.kernels.test_yaw_in_turns import courses_deg, off_deg
from tests.planner.sites import make_site
from tests.terrain_kinds import write_scenario
from uavcover.model.sensor import FrameCamera
from uavcover.model.vehicle import AutopilotName
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.flown_line import line_flown
from uavcover.sensing.site_maps import judging_map

FORWARD = FrameCamera(
    kind="frame-camera", fov_across_deg=50.0, fov_along_deg=40.0, range_m=250.0, pitch_deg=-50.0, mount="stabilised"
)


def px4_site(sensor: FrameCamera = FORWARD) -> Site:
    return make_site(home=(-100.0, 50.0), sensor=sensor, vehicle={"autopilot": "px4"})


def test_a_short_leg_back_is_not_seen_along() -> None:
    """A plan had a last leg of 3.6 m back, claimed all of an area, and its flight saw 85 %."""
    site = px4_site()
    there = np.array([[0.0, 50.0, 60.0], [60.0, 50.0, 60.0]])
    short, longer, far = (np.vstack([there, [[60.0 - back_m, 50.0, 60.0]]]) for back_m in (3.6, 6.0, 60.0))
    turned = [
        off_deg(courses_deg(line_flown(site, route).headings), np.array(90.0)).max() for route in (short, longer, far)
    ]
    # PX4 has reached a waypoint 2 m before it: the leg of 3.6 m is over when it begins, that of 6 m has 2 m.
    assert turned[0] < 1e-6
    # At 4 m/s³ and then 3 m/s² these take 1.51 s, in which the nose turns at 20 degrees/s².
    assert turned[1] == pytest.approx(0.5 * 20.0 * 1.51**2, abs=1.0)
    assert turned[2] == pytest.approx(180.0)
    fine = judging_map(site)
    behind = fine.observed(far) & ~fine.observed(there)
    assert behind.sum() > 50
    assert (fine.observed(short) & behind).sum() < 0.1 * behind.sum()
    assert (fine.observed(longer) & behind).sum() < 0.75 * behind.sum()


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
        assert len(line.positions_m) < len(line_flown(turns, route).positions_m)
        if autopilot == "px4":
            np.testing.assert_array_equal(line.positions_m[:-1], route[:-1])
            np.testing.assert_array_equal(line.headings, np.diff(line.positions_m[:, :2], axis=0))


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_the_line_itself_and_its_ends_stay_where_they_are(autopilot: AutopilotName) -> None:
    route = np.array([[0.0, 50.0, 60.0], [60.0, 50.0, 60.0], [20.0, 55.0, 60.0], [0.0, 0.0, 60.0]])
    down = line_flown(make_site(home=(-100.0, 50.0), vehicle={"autopilot": autopilot}), route).positions_m
    turning_line = line_flown(make_site(home=(-100.0, 50.0), sensor=FORWARD, vehicle={"autopilot": autopilot}), route)
    np.testing.assert_array_equal(turning_line.positions_m[[0, -1]], down[[0, -1]])
    length_m = np.linalg.norm(np.diff(turning_line.positions_m, axis=0), axis=1).sum()
    assert length_m == pytest.approx(np.linalg.norm(np.diff(down, axis=0), axis=1).sum())
    assert {tuple(position) for position in down.tolist()} <= {
        tuple(position) for position in turning_line.positions_m.tolist()
    }


def test_pictures_by_distance_have_the_headings_of_their_pieces(tmp_path: Path) -> None:
    site = load_site(str(write_scenario(tmp_path, "40 m", "survey")))
    px4 = dataclasses.replace(site.scenario.vehicle, autopilot="px4")
    site = dataclasses.replace(site, scenario=dataclasses.replace(site.scenario, vehicle=px4))
    route = np.array([[0.0, 0.0, 84.0], [100.0, 0.0, 84.0], [0.0, 3.0, 84.0]])
    line, looks = line_flown(site, route), judging_map(site).flown_observations(route)
    corner = int(np.argmin(np.linalg.norm(line.positions_m - route[1], axis=1)))
    assert math.dist(line.positions_m[corner + 1], route[1]) < 1.0
    ends_m = np.cumsum(np.linalg.norm(np.diff(line.positions_m, axis=0), axis=1))
    for position, heading in zip(looks.positions_m[1:], looks.headings[1:], strict=True):
        near = [k for k, each in enumerate(line.headings) if np.array_equal(each, heading)]
        off_m = [_from_piece_m(position, line.positions_m[k], line.positions_m[k + 1]) for k in near]
        assert min(off_m) < 1e-6
    assert len(ends_m) > len(route)


def _from_piece_m(position: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    fraction = np.clip((position - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
    return float(np.linalg.norm(a + fraction * (b - a) - position))

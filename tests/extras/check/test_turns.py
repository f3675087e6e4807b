"""Turns and curves as they are flown."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
import shapely

from mission_io.model.items import Command, Fence, FenceCircle, LatLon
from tests.extras.check.test_checks import checked, found
from tests.extras.check.worlds import COPTER, PLANE, command, home, item, lat_lon, mission, up, waypoint, world
from tests.naive import turn as naive
from uavcover.extras.check.flown_path import flown_path
from uavcover.extras.check.turns import circle, spline, straight, turns_of
from uavcover.extras.check.world import default_aircraft, radius_of_bank_m

EARLY = dataclasses.replace(PLANE, acceptance_m=60.0, return_height_m=130.0)


@pytest.mark.parametrize("turn_deg", [20.0, 60.0, -90.0, 130.0, -165.0])
def test_both_ways_round_a_corner(turn_deg: float) -> None:
    legs = up(100.0), waypoint(0.0, -1.0, 100.0), waypoint(0.0, 500.0, 100.0), waypoint(
        -500.0 * math.sin(math.radians(turn_deg)), 500.0 + 500.0 * math.cos(math.radians(turn_deg)), 100.0
    )  # fmt: skip
    whole = mission(*legs)
    path = flown_path(whole, world(), EARLY)
    turns = [one for one in turns_of(path, whole, EARLY).segments if one.items[1] == 4]
    assert len(turns) == 2
    u, v = np.array([0.0, 1.0]), np.array([-math.sin(math.radians(turn_deg)), math.cos(math.radians(turn_deg))])
    cut_m = max(30.0 * math.tan(math.radians(abs(turn_deg)) / 2.0), 60.0 * min(1.0, abs(turn_deg) / 90.0))
    for one, flown in zip(turns, (naive.early(u, v, cut_m), naive.late(u, v, 30.0)), strict=True):
        ours = shapely.LineString(one.enu_m[:, :2])
        theirs = shapely.LineString(flown + np.array([0.0, 500.0]))
        assert shapely.hausdorff_distance(shapely.segmentize(ours, 1.0), theirs) < 1.5
        assert one.enu_m[:, 2] == pytest.approx(100.0, abs=0.2)


def test_ground_that_only_a_late_turn_hits() -> None:
    """The ridge begins 15 m beside the leg, and its top is 50 m above it."""
    legs = (
        up(50.0),
        waypoint(0.0, -300.0, 50.0),
        waypoint(335.0, -300.0, 50.0),
        waypoint(335.0, 0.0, 50.0),
        waypoint(0.0, 0.0, 50.0),
    )
    plane = dataclasses.replace(EARLY, turn_radius_m=60.0, acceptance_m=20.0)
    reported = [one for one in checked(*legs, aircraft=plane).findings if one.kind == "ground"]
    assert reported
    assert all("in the turn at this item" in one.what for one in reported)
    assert not [one for one in checked(*legs, aircraft=COPTER).findings if one.kind == "ground"]


def test_a_cut_corner_and_the_fence() -> None:
    circle = Fence(circles=(FenceCircle(LatLon(*lat_lon(-285.0, 285.0)), 10.0, False),))
    legs = up(50.0), waypoint(0.0, 300.0, 50.0), waypoint(-300.0, 300.0, 50.0), waypoint(-300.0, 0.0, 50.0), home()
    cut = [one.items for one in checked(*legs, aircraft=EARLY, fence=circle).findings if one.kind == "fence"]
    assert cut == [(2, 4)]
    assert not [one for one in checked(*legs, fence=circle).findings if one.kind == "fence"]


def test_the_acceptance_radius_of_px4() -> None:
    px4 = dataclasses.replace(default_aircraft("px4", "multirotor"), return_height_m=130.0)
    circle = Fence(circles=(FenceCircle(LatLon(*lat_lon(-290.0, 290.0)), 8.0, False),))
    legs = [
        up(115.0),
        waypoint(0.0, 300.0, 115.0),
        waypoint(-300.0, 300.0, 115.0),
        waypoint(-300.0, 0.0, 115.0),
        home(),
    ]
    assert not [one for one in checked(*legs, aircraft=px4, fence=circle).findings if one.kind == "fence"]
    # The arc of a radius of 30 m comes 12 m nearer to the inside of the corner than the corner itself.
    legs[2] = dataclasses.replace(legs[2], params=(0.0, 30.0, 0.0, math.nan))
    assert [one for one in checked(*legs, aircraft=px4, fence=circle).findings if one.kind == "fence"]
    stop = dataclasses.replace(legs[2], params=(5.0, 30.0, 0.0, math.nan))
    legs[2] = stop
    assert not [one for one in checked(*legs, aircraft=px4, fence=circle).findings if one.kind == "fence"]


def test_radius_by_speed_and_bank() -> None:
    assert radius_of_bank_m(15.0, 45.0) == pytest.approx(22.9, abs=0.1)
    assert PLANE.turn_radius_at(30.0) == pytest.approx(120.0)


def test_more_speed_than_the_vehicle_makes() -> None:
    slow = dataclasses.replace(COPTER, max_airspeed_m_s=9.0, return_height_m=130.0)
    assert ("speed", (0, 4)) in found(
        checked(up(), waypoint(300.0, 0.0, 115.0), waypoint(600.0, 0.0, 115.0), home(), aircraft=slow)
    )


def test_more_speed_than_any_multirotor_makes() -> None:
    at_99 = command(int(Command.DO_CHANGE_SPEED), 1.0, 99.0, -1.0)
    legs = up(), at_99, waypoint(300.0, 0.0, 115.0), waypoint(600.0, 0.0, 115.0), home()
    (fast,) = (one for one in checked(*legs).findings if one.kind == "speed")
    assert fast.what == "the mission commands 99 m/s, but multirotors fly at most 30 m/s"
    assert fast.weight == "breaks"
    assert "speed" not in {kind for kind, _ in found(checked(*legs, aircraft=PLANE))}
    able = dataclasses.replace(COPTER, max_airspeed_m_s=100.0)
    assert "speed" not in {kind for kind, _ in found(checked(*legs, aircraft=able))}


@pytest.mark.parametrize("radius_m", [80.0, -80.0])
def test_wings_leave_a_circle_where_they_head_for_the_next_place(radius_m: float) -> None:
    """ArduPlane in simulation was 63 m beside a leg from where it had come to the circle."""
    round_it = item(Command.NAV_LOITER_TURNS, 0.0, 300.0, 100.0, params=(1.0, 0.0, radius_m, 0.0))
    legs = up(100.0), round_it, waypoint(600.0, 300.0, 60.0)
    whole = mission(*legs)
    path = flown_path(whole, world(), PLANE)
    out = [one.enu_m for one in turns_of(path, whole, PLANE).segments if one.items == (2, 3)]
    centre = np.array([0.0, 300.0])
    tangent = next(line for line in out if abs(np.hypot(*(line[0, :2] - centre)) - 80.0) < 0.1)
    spoke, course = tangent[0, :2] - centre, tangent[-1, :2] - tangent[0, :2]
    assert abs(float(spoke @ course)) < 0.01 * float(np.hypot(*course)) * 80.0
    turn = float(spoke[0] * course[1] - spoke[1] * course[0])
    assert (turn < 0.0) == (radius_m > 0.0)  # clockwise circles are left clockwise
    assert min(np.hypot(*(line[0, :2] - centre)) for line in out) == pytest.approx(0.0, abs=0.1)
    assert all(line[-1, :2] == pytest.approx([600.0, 300.0], abs=0.1) for line in out)
    assert all(line[-1, 2] < line[0, 2] for line in out)


def bezier(begin, end, begin_vector, end_vector, t):
    """The same cubic by de Casteljau's construction, from the vectors as they are."""
    corners = [begin, begin + begin_vector / 3.0, end - end_vector / 3.0, end]
    while len(corners) > 1:
        corners = [a + t * (b - a) for a, b in itertools.pairwise(corners)]
    return corners[0]


@pytest.mark.parametrize("seed", range(5))
def test_a_spline_is_the_cubic_of_its_ends_and_vectors(seed: int) -> None:
    rng = np.random.default_rng(seed)
    begin, end, v0, v1 = rng.uniform(-100.0, 100.0, (4, 3))
    scale = min(1.0, 4.0 * np.linalg.norm(end - begin) / (np.linalg.norm(v0) + np.linalg.norm(v1)))
    points = spline(begin, end, v0, v1, step_m=5.0)
    for k, t in enumerate(np.linspace(0.0, 1.0, len(points))):
        assert points[k] == pytest.approx(bezier(begin, end, scale * v0, scale * v1, t), abs=1e-9)
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() < 10.0


def test_long_vectors_are_shortened_to_four_chords() -> None:
    begin, end = np.zeros(3), np.array([10.0, 0.0, 0.0])
    short = spline(begin, end, np.array([0.0, 20.0, 0.0]), np.array([0.0, 20.0, 0.0]), step_m=1.0)
    long = spline(begin, end, np.array([0.0, 2000.0, 0.0]), np.array([0.0, 2000.0, 0.0]), step_m=1.0)
    assert long == pytest.approx(short)


def test_a_spline_without_length_stays() -> None:
    position = np.array([1.0, 2.0, 3.0])
    assert (spline(position, position, position, position, step_m=1.0) == position).all()


def test_a_circle_goes_round_as_often_as_it_says() -> None:
    center, begin = np.array([100.0, 50.0, 0.0]), np.array([100.0, 80.0, 20.0])
    points = circle(center, 30.0, begin, turns=1.5, end_height_m=40.0, clockwise=True)
    away = points[:, :2] - center[:2]
    assert np.hypot(*away.T) == pytest.approx(30.0, rel=1e-3)
    turned = np.unwrap(np.arctan2(away[:, 0], away[:, 1]))
    assert turned[-1] - turned[0] == pytest.approx(3.0 * np.pi)
    assert points[[0, -1], 2] == pytest.approx([20.0, 40.0])
    back = circle(center, 30.0, begin, turns=0.25, end_height_m=20.0, clockwise=False)
    assert back[-1, 0] < center[0]


def test_a_straight_line_has_both_ends_and_short_pieces() -> None:
    points = straight(np.zeros(3), np.array([95.0, 0.0, 10.0]), step_m=10.0)
    assert len(points) == 11
    assert points[-1] == pytest.approx([95.0, 0.0, 10.0])

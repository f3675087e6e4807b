"""The nose that turns at a limited rate, against small steps of time."""

import math

import numpy as np
import pytest

from tests.naive.flown_line import px4_begins, turning
from uavcover.kernels import yaw_in_turns
from uavcover.kernels.flight_time import BRAKED, Pace
from uavcover.kernels.yaw_in_turns import Pieces, braked_speeds_m_s, turned_line
from uavcover.mock.behaviour import GUIDANCE

PACE = Pace(
    10.0, 4.0, 3.0, acceleration_m_s2=3.0, vertical_acceleration_m_s2=3.0, jerk_m_s3=4.0, corner=BRAKED,
    corner_radius_m=2.0, settling_s=3.2,
)  # fmt: skip

ROUTES = {
    "lines": [(0, 0, 60), (200, 0, 60), (200, 40, 60), (0, 40, 60)],
    "turns back": [(0, 0, 60), (150, 0, 60), (10, 6, 60), (160, 10, 60)],
    "a short leg back": [(0, 0, 60), (100, 0, 60), (96.4, 0.1, 60)],
    "short legs": [(0, 0, 60), (4, 0, 60), (4, 4, 60), (1, 5, 62), (2, 1, 60), (40, 1, 60)],
    "straight up": [(0, 0, 60), (50, 0, 60), (50, 0, 80), (0, 5, 80)],
}  # fmt: skip


def courses_deg(headings):
    return np.degrees(np.arctan2(headings[:, 0], headings[:, 1]))


def off_deg(one, other):
    return np.abs((one - other + 180.0) % 360.0 - 180.0)


def piece_at(positions_m, path_m):
    """(m,) number of the piece that is flown so many (m,) metres from the beginning."""
    ends_m = np.cumsum(np.linalg.norm(np.diff(positions_m, axis=0), axis=1))
    return np.searchsorted(ends_m, path_m)


@pytest.mark.parametrize("acceleration_deg_s2", [math.inf, 20.0])
@pytest.mark.parametrize("before", [(0.0, 1.0), (1.0, 0.0), (-1.0, 0.3)])
@pytest.mark.parametrize("name", ROUTES)
def test_the_nose_turns_as_in_small_steps_of_time(name, before, acceleration_deg_s2):
    pace = PACE._replace(yaw_acceleration_deg_s2=acceleration_deg_s2)
    line = np.array(ROUTES[name], dtype=float)
    paths, legs = np.diff(line[:, :2], axis=0), np.zeros(len(line) - 1)
    begins = braked_speeds_m_s(PACE, paths, np.array(before))
    np.testing.assert_allclose(begins, px4_begins(line, before, 10.0), atol=1e-4)
    sizes_m = np.linalg.norm(np.diff(line, axis=0), axis=1)
    turned = turned_line(pace, line, Pieces(paths, legs, sizes_m, begins), np.array(before))
    slowly, yaws = turning(
        line, legs, paths, begins, before, PACE.cruise_m_s, PACE.acceleration_m_s2, step_s=0.002,
        yaw_acceleration_deg_s2=acceleration_deg_s2,
    )  # fmt: skip
    np.testing.assert_array_equal(turned.positions_m[turned.numbers], line)
    length_m = float(sizes_m.sum())
    path_m = np.linspace(0.01, length_m - 0.01, 4_000)
    mine, theirs = turned.headings[piece_at(turned.positions_m, path_m)], np.array(yaws)[piece_at(slowly, path_m)]
    np.testing.assert_array_equal(mine.any(axis=1), theirs.any(axis=1))
    known = mine.any(axis=1)
    off = off_deg(courses_deg(mine[known]), courses_deg(theirs[known]))
    # Less than 5 degrees of a turn is none. A nose that comes with a rate onto a short leg is braked by another rule there.
    assert off.max() < (24.0 if name == "short legs" and acceleration_deg_s2 < math.inf else 7.0)
    assert off.mean() < (2.5 if name == "short legs" and acceleration_deg_s2 < math.inf else 1.0)


def test_px4_is_late_as_the_mock_vehicle_is():
    """The mock shares no code with the planner; these three were measured once, for both."""
    in_plans = yaw_in_turns._LACKING, yaw_in_turns._MADE_UP, yaw_in_turns._LACKING_LONGER
    assert in_plans == (GUIDANCE.late_fraction, GUIDANCE.kept_fraction, GUIDANCE.longer_ratio)


def test_the_nose_is_late_on_pieces_of_corners_and_on_the_legs_behind_them():
    # Two pieces of a corner to the north; the nose, which points east, has turned by 60 degrees behind them.
    line = np.array([[0.0, 0, 60], [1.0, 0, 60], [1.0, 1.0, 60], [1.0, 2.0, 60], [1.0, 90.0, 60]])
    paths = np.diff(line[:, :2], axis=0)
    pieces = Pieces(
        paths, np.array([0.5, 0.5, 0.5, 0.0]), np.array([1.0, 1.0, 1.0, 88.0]), np.array([0.0, 0.0, 0.0, 2.0])
    )
    turned = turned_line(PACE, line, pieces, paths[0])
    headings = courses_deg(turned.headings)
    np.testing.assert_allclose(headings[:3], [90.0, 90.0 - 0.5 * PACE.yaw_rate_deg_s, 90.0 - PACE.yaw_rate_deg_s])
    # From there 30 degrees in half a second, at 2 m/s and more.
    np.testing.assert_allclose(headings[3:], [*np.arange(28.5, 0.0, -3.0), 0.0], atol=1e-9)
    speed_m_s, half_s = 2.0, 0.5
    assert turned.positions_m[-2, 1] - 2.0 == pytest.approx(speed_m_s * half_s + 0.5 * 3.0 * half_s**2)


@pytest.mark.parametrize("turn_rad", [0.0, 1e-12, 1e-3, 3.0])
def test_on_a_leg_without_length_the_nose_stays(turn_rad):
    line = np.array(
        [[0.0, 0.0, 60.0], [50.0, 0.0, 60.0], [50.0 + 2.0 * math.cos(turn_rad), 2.0 * math.sin(turn_rad), 60.0]]
    )
    paths = np.diff(line[:, :2], axis=0)
    pieces = Pieces(paths, np.zeros(2), np.array([50.0, 0.0]), np.zeros(2))
    turned = turned_line(PACE, line, pieces, paths[0])
    np.testing.assert_array_equal(turned.positions_m, line)
    np.testing.assert_allclose(courses_deg(turned.headings), 90.0, atol=1e-6)

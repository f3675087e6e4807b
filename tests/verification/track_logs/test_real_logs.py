"""Logs of simulated ArduCopter 4.7 and PX4 1.17, a square of 40 m flown by ``sitl_tests``, cut to positions and attitudes."""

from pathlib import Path

import numpy as np
import pytest

from uavcover.model.track import Track
from uavcover.model.vehicle import Vehicle, Wind
from uavcover.terrain.frames import LocalFrame
from uavcover.verification.possible_motion import Motion, judge_motion, motion_limits
from uavcover.verification.track_logs.readers import read_foreign_log

DATA = Path(__file__).with_name("data")
HOME = LocalFrame(36.4762, -84.216, 485.424)
SQUARE_M = np.array([(0.0, 30.0, 25.0), (40.0, 30.0, 25.0), (40.0, 70.0, 25.0), (0.0, 70.0, 25.0), (0.0, 0.0, 25.0)])
LOGS = sorted(path.name for path in DATA.iterdir())


def track(name: str) -> Track:
    return read_foreign_log(DATA / name, HOME).track


@pytest.mark.parametrize("name", LOGS)
def test_the_flown_square_is_in_the_log(name: str) -> None:
    flown = track(name)
    for corner in SQUARE_M:
        assert np.linalg.norm(flown.enu_m - corner, axis=1).min() < 3.0
    # Home's height is only as good as a barometer.
    np.testing.assert_allclose(flown.enu_m[[0, -1]], 0.0, atol=1.5)
    assert flown.enu_m[:, 2].max() < 28.0
    assert (np.diff(flown.time_s) > 0.0).all()


@pytest.mark.parametrize("name", LOGS)
def test_attitudes_are_those_of_a_flight_with_the_nose_along_the_path(name: str) -> None:
    flown = track(name)
    assert np.abs(flown.attitude_deg[:, :2]).max() < 45.0
    east = np.gradient(flown.enu_m[:, 0], flown.time_s) > 3.0
    assert east.sum() > 10
    assert np.median(np.abs(flown.attitude_deg[east, 2] - 90.0)) < 10.0


@pytest.mark.parametrize("name", ["arducopter_square.bin", "arducopter_square.tlog"])
def test_reported_velocities_agree_with_the_positions_and_turned_ones_do_not(name: str) -> None:
    flown = track(name)
    limits = motion_limits(Vehicle(), Wind())

    def judged(velocity_m_s: np.ndarray) -> Motion:
        return judge_motion(flown.time_s, flown.enu_m, limits, max_gap_s=2.0, velocity_m_s=velocity_m_s)

    motion = judged(flown.velocity_enu_m_s)
    assert motion.moves == ()
    assert motion.contradiction is None
    assert np.isfinite(flown.velocity_enu_m_s).all(axis=1).mean() > 0.95
    assert judged(flown.velocity_enu_m_s[:, [1, 0, 2]]).contradiction is not None


def test_two_logs_of_one_flight_tell_the_same() -> None:
    """The autopilot's own log and what it told the ground station, by the same clock."""
    own, told = track("arducopter_square.bin"), track("arducopter_square.tlog")
    inside = (own.time_s > told.time_s[0]) & (own.time_s < told.time_s[-1])
    assert inside.sum() > 300
    for axis in range(3):
        expected = np.interp(own.time_s[inside], told.time_s, told.enu_m[:, axis])
        assert np.abs(own.enu_m[inside, axis] - expected).max() < 0.5

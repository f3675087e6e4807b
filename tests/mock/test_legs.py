"""Legs that lead the mock vehicle: what routes of missions have, and plans have not."""

import numpy as np
import pytest

from tests.sensing.flown_lines import places_when_passed
from uavcover.model.vehicle import MOTIONS, AutopilotName


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_waypoint_may_stand_twice(autopilot: AutopilotName) -> None:
    """It does where pictures by distance begin; the vehicle of PX4 was divided by the length of the leg between the two."""
    points = np.array([(0, 0, 60), (80, 0, 60), (80, 0, 60), (80, 40, 70), (80, 40, 70), (0, 40, 70)], dtype=float)
    passed = places_when_passed(MOTIONS[autopilot], points, cruise_m_s=10.0, climb_m_s=4.0, descent_m_s=3.0)
    assert len(passed) == 5
    assert np.linalg.norm(passed - points[1:], axis=1).max() < 3.0

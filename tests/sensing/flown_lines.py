"""Tracks of the mock vehicle's legs, flown without a delay."""

import numpy as np

from uavcover.mock.behaviour import BODY, GUIDANCE, Speeds
from uavcover.mock.guidance import Leg, legs_of
from uavcover.model.vehicle import AutopilotMotion


def track_of_legs(
    motion: AutopilotMotion, points: np.ndarray, *, cruise_m_s: float, climb_m_s: float, descent_m_s: float
) -> np.ndarray:
    """(k, 3) places of a mass with the mock's controller and no limits, from rest at the first point to the last."""
    return _flown(motion, points, cruise_m_s=cruise_m_s, climb_m_s=climb_m_s, descent_m_s=descent_m_s)[0]


def positions_when_passed(
    motion: AutopilotMotion, points: np.ndarray, *, cruise_m_s: float, climb_m_s: float, descent_m_s: float
) -> np.ndarray:
    """(n - 1, 3) places of the same mass when the points behind the first count as passed."""
    return _flown(motion, points, cruise_m_s=cruise_m_s, climb_m_s=climb_m_s, descent_m_s=descent_m_s)[1]


def _flown(
    motion: AutopilotMotion, points: np.ndarray, *, cruise_m_s: float, climb_m_s: float, descent_m_s: float
) -> tuple[np.ndarray, np.ndarray]:
    speeds = Speeds(cruise_m_s, climb_m_s, descent_m_s)
    start, *ends = (tuple(map(float, point)) for point in points)
    legs = legs_of(motion, start, [Leg(end, speeds) for end in ends])
    position, velocity, track, passed = np.array(start), np.zeros(3), [np.array(start)], []
    while legs.passed < len(ends):
        wanted = np.array(legs.wanted_velocity(tuple(position)))
        velocity = velocity + BODY.step_s * GUIDANCE.velocity_gain_1_s * (wanted - velocity)
        position = position + BODY.step_s * velocity
        track.append(position)
        passed += [position] * (legs.passed - len(passed))
    return np.array(track), np.array(passed)

import dataclasses

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4
from tests.flight.scene import make_scene, mission, plan_for
from uavcover.mock.behaviour import Settings
from uavcover.model.track import EventKind


def warnings(autopilot, settings, **planned):
    scene = make_scene(autopilot, settings=settings)
    scene.upload(mission())
    scene.fly(plan=dataclasses.replace(plan_for(mission()), **planned))
    return [text for text in scene.told(EventKind.WARNING) if "but the plan assumes" in text]


@pytest.mark.parametrize(("autopilot", "name"), [(ARDUPILOT, "WPNAV_SPEED_UP"), (PX4, "MPC_Z_V_AUTO_UP")])
def test_a_vehicle_that_climbs_slower_than_planned_is_told(autopilot, name):
    told = warnings(autopilot, Settings(climb_m_s=2.5, descent_m_s=5.0), max_climb_m_s=5.0, max_descent_m_s=5.0)
    assert told == [
        f"the vehicle climbs at 2.5 m/s ({name}), but the plan assumes 5 m/s: the flight takes longer than planned; "
        "plan with the vehicle's speed, or set the parameter"
    ]


def test_a_vehicle_that_is_as_fast_as_planned_is_not_told():
    assert warnings(ARDUPILOT, Settings(climb_m_s=5.0, descent_m_s=5.0), max_climb_m_s=5.0, max_descent_m_s=5.0) == []


def test_a_plan_that_does_not_say_is_not_compared():
    assert warnings(ARDUPILOT, Settings(climb_m_s=1.0)) == []

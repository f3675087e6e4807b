"""An ArduPilot that accepts only one ground station is refused by name, and minded with that station's number."""

import contextlib
import dataclasses

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT
from mission_io.links.simulated import Conditions
from tests.flight.scene import make_scene, mission
from tests.flight.test_limits import the_plan
from uavcover.flight.monitor import open_vehicle
from uavcover.model.outcome import Ending, EventKind, FlightFailedError


def enforcing(number: int = 250, **options):
    scene = make_scene(ARDUPILOT, **options)
    scene.upload(mission())
    scene.vehicle.parameters.put("MAV_GCS_SYSID", float(number))
    scene.vehicle.parameters.put("MAV_OPTIONS", 1.0)
    return scene


def test_a_vehicle_that_minds_another_station_is_refused_with_what_to_do():
    with pytest.raises(FlightFailedError) as caught:
        enforcing().fly()
    assert caught.value.outcome.ending is Ending.NOT_ARMED
    text = str(caught.value)
    assert "vehicle 1 sends heartbeats, but does not answer this program (system 255); it may accept only" in text
    assert "set --own-system to its MAV_GCS_SYSID" in text
    assert "--yes" not in text


def test_with_its_number_the_mission_is_flown():
    scene = enforcing()
    scene.client, scene.monitor = open_vehicle(scene.link, own_system=250)
    assert scene.fly().ending is Ending.LANDED


def test_a_station_that_is_not_minded_is_told_that_its_silence_does_not_count():
    scene = enforcing()
    scene.vehicle.parameters.put("MAV_OPTIONS", 0.0)
    scene.vehicle.parameters.put("FS_GCS_ENABLE", 1.0)
    plan = dataclasses.replace(the_plan(), needs=None)
    with contextlib.suppress(FlightFailedError):  # the vehicle returns: it has not heard its own station since
        scene.fly(plan=plan)
    assert any("(MAV_GCS_SYSID), planned 255" in text for text in scene.told(EventKind.WARNING))


def test_a_bad_link_is_no_deaf_vehicle():
    scene = make_scene(ARDUPILOT, conditions=Conditions(delay_s=0.1, loss=0.2))
    scene.upload(mission())
    assert scene.fly().ending is Ending.LANDED

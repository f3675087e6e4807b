import pytest

from mission_io.autopilots.autopilot import PX4
from mission_io.autopilots.flight_modes import Mode
from tests.flight.scene import make_scene, mission, plan_for, way_home
from uavcover.flight.fly import fly
from uavcover.flight.orders import OnBreach, Orders, Precautions
from uavcover.model.outcome import Ending, EventKind, FlightEvent, FlightFailedError


def test_a_vehicle_that_goes_back_to_its_mission_mode_on_the_ground_was_still_taken_over():
    """As PX4 does: after a return of its own it is in mission mode again once it has landed."""
    scene = make_scene(PX4)
    scene.upload(mission())

    def interfere(event: FlightEvent) -> None:
        scene.events.append(event)
        if event.kind is EventKind.WAYPOINT and event.waypoint == 1:
            scene.vehicle.control.set_mode(Mode.RETURN)
        if event.text == "Disarming motors":
            scene.vehicle.control.set_mode(Mode.MISSION)

    with pytest.raises(FlightFailedError) as failed:
        fly(
            scene.client,
            scene.monitor,
            plan_for(mission()),
            Orders(
                on_sample=scene.samples.append, on_event=interfere, precautions=Precautions(on_breach=OnBreach.TELL)
            ),
            plan_return=way_home,
        )
    outcome = failed.value.outcome
    [taken] = outcome.incidents
    assert (taken.kind, taken.end_s) == (Ending.PILOT_TOOK_OVER, None), "nothing gave the vehicle back"
    assert outcome.ending is Ending.PILOT_TOOK_OVER

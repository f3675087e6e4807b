"""What happens in the minutes when something else happens: falls, glitches, other stations, wind, pilots, holds, batteries."""

import numpy as np
import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Mode
from tests.flight.scene import FRAME, HOME, Scene, make_scene, mission, plan_for, presses
from uavcover.flight.orders import FlightTimeouts, OnBreach, OperatingVolume, PlanNeeds, Precautions
from uavcover.kernels.flight_time import Pace
from uavcover.mock.dynamics import BatteryData, WindModel
from uavcover.mock.faults import parse_fault
from uavcover.model.track import Ending, EventKind, FlightEvent, FlightFailedError
from uavcover.model.vehicle import Vehicle

AUTOPILOTS = pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
HOME_UP_M = float(FRAME.enu_from_geodetic(HOME.lat_deg, HOME.lon_deg, HOME.alt_amsl_m)[0][2])
PACE = Pace(8.0, 2.5, 1.5, 25.0, 0.0, 0.0, 2.5, 2.5, 5.0, 0, 2.0)


def volume(**changes) -> OperatingVolume:
    values = {
        "ground_up_m": lambda _e, _n: HOME_UP_M,
        "outside_fence_m": lambda _e, _n: 0.0,
        "min_height_agl_m": 40.0,
        "max_height_agl_m": 90.0,
    }
    return OperatingVolume(**{**values, **changes})


def scene_of(autopilot, *faults: str, **options) -> Scene:
    scene = make_scene(autopilot, faults=[parse_fault(fault) for fault in faults], **options)
    scene.upload(mission())
    return scene


def flown(scene: Scene, *, needs: PlanNeeds | None = None, around: OperatingVolume | None = None, **options):
    plan = plan_for(mission(), volume=around or volume(), needs=needs, ground_at=None)
    options.setdefault("precautions", Precautions(on_breach=OnBreach.HOLD))
    options.setdefault("timeouts", FlightTimeouts(held_s=30.0))
    try:
        outcome = scene.fly(plan=plan, **options)
    except FlightFailedError as error:
        return error.outcome, str(error)
    return outcome, ""


def incident(outcome, kind: Ending):
    found = [i for i in outcome.incidents if i.kind is kind]
    assert found, [i.kind.key for i in outcome.incidents]
    return found[0]


@AUTOPILOTS
def test_a_fall_under_power_is_a_crash_that_says_from_where_and_that_it_is_armed(autopilot):
    scene = scene_of(autopilot, "motor-failure@35s")
    outcome, text = flown(scene)
    assert outcome.ending is Ending.CRASHED
    assert "fell from" in text
    assert "its motors may start, so keep away" in text
    fall = incident(outcome, Ending.FALLING)
    assert fall.begin_s - scene.vehicle.faults.begun[0].trigger.value < 45.0
    assert scene.vehicle.armed


@AUTOPILOTS
def test_an_item_set_back_by_another_station_is_said_so(autopilot):
    scene = scene_of(autopilot, "item-set-back@45s")
    outcome, _ = flown(scene, precautions=Precautions(on_breach=OnBreach.TELL))
    assert "another station set the current item" in incident(outcome, Ending.MISSION_CHANGED).text
    assert not any(i.kind in (Ending.OFF_ROUTE, Ending.WIND_ABOVE_LIMITS) for i in outcome.incidents)


@AUTOPILOTS
def test_a_glitch_of_the_position_is_no_wind(autopilot):
    scene = scene_of(autopilot, "gps-glitch:60@40s")
    outcome, _ = flown(scene, precautions=Precautions(on_breach=OnBreach.TELL))
    found = incident(outcome, Ending.OFF_ROUTE)
    assert "but the position may be wrong" in found.text
    assert any("jumped by" in sign or "Glitch" in sign for sign in found.evidence)
    assert all("vehicle time" in sign for sign in found.evidence)
    assert Ending.WIND_ABOVE_LIMITS not in [i.kind for i in outcome.incidents]


def test_wind_that_pushes_it_off_its_leg_is_wind():
    scene = scene_of(
        ARDUPILOT, "strong-wind:25@20s", wind=WindModel(gust_m_s=0.5), battery=BatteryData(endurance_s=300.0)
    )
    outcome, _ = flown(scene, precautions=Precautions(on_breach=OnBreach.TELL))
    kinds = [i.kind for i in outcome.incidents]
    assert Ending.WIND_ABOVE_LIMITS in kinds
    assert Ending.OFF_ROUTE not in kinds


@AUTOPILOTS
def test_wind_that_pushes_it_off_its_leg_is_told_without_heartbeats(autopilot):
    """Following by its other messages, only the lost heartbeats were told, 2 km from the route."""
    scene = scene_of(autopilot, "strong-wind:25@20s", "heartbeat-loss@15s")
    _, text = flown(scene, stop=presses(scene, 90.0, 91.0), precautions=Precautions(on_breach=OnBreach.TELL))
    assert "the state of the vehicle is unknown" in text
    assert [event for event in scene.events if event.alarm and "off the planned leg to item" in event.text]
    still = scene_of(autopilot, "heartbeat-loss@15s")
    outcome, _ = flown(still, precautions=Precautions(on_breach=OnBreach.TELL))
    assert [i.kind for i in outcome.incidents] == [Ending.HEARTBEAT_LOST]


def test_a_vehicle_whose_motors_fail_at_take_off_lies_on_the_ground():
    """It was 'stuck, in the air, 0 m above home': ArduCopter goes on saying that it flies."""
    for more in ((), ("heartbeat-loss@12s",)):
        outcome, text = flown(scene_of(ARDUPILOT, "motor-failure@item1", *more))
        assert outcome.ending is Ending.CRASHED
        assert "the vehicle should be in the air but is on the ground" in text
        assert "now: on the ground, according to its motion, armed" in text


@AUTOPILOTS
def test_a_flight_that_another_station_slows_down_is_said_to_be_late(autopilot):
    needs = PlanNeeds(pace=PACE, return_height_m=30.0, fence=False, vehicle=Vehicle(endurance_s=900.0))
    scene = scene_of(autopilot, "speed-changed:2@30s", battery=BatteryData(endurance_s=2000.0))
    outcome, text = flown(scene, needs=needs)
    assert outcome.ending is Ending.LANDED, text
    found = incident(outcome, Ending.LATE)
    assert "s late" in found.text
    assert "instead of" in found.text
    assert any(e.alarm and "late" in e.text for e in scene.events)


@AUTOPILOTS
def test_an_undisturbed_flight_is_not_late(autopilot):
    needs = PlanNeeds(pace=PACE, return_height_m=30.0, fence=False, vehicle=Vehicle(endurance_s=900.0))
    outcome, text = flown(scene_of(autopilot), needs=needs)
    assert (outcome.ending, outcome.incidents) == (Ending.LANDED, ()), text


@AUTOPILOTS
def test_a_battery_that_lasts_only_for_the_way_home_brings_it_home(autopilot):
    needs = PlanNeeds(
        pace=PACE, return_height_m=30.0, fence=False, vehicle=Vehicle(endurance_s=600.0, reserve_fraction=0.2),
        return_s=lambda _: 45.0,
    )  # fmt: skip
    scene = scene_of(autopilot, "speed-changed:2.5@25s", battery=BatteryData(endurance_s=190.0))
    outcome, text = flown(scene, needs=needs)
    assert outcome.ending is Ending.RESERVE_KEPT, text
    assert scene.vehicle.body.battery.remaining > 0.1
    assert any("the vehicle returns now" in reported for reported in scene.reported(EventKind.STOP))


@AUTOPILOTS
@pytest.mark.parametrize(("charge", "warned"), [(1.0, False), (0.5, True)])
def test_a_battery_that_does_not_last_for_the_mission_is_told_before_arming(autopilot, charge, warned):
    needs = PlanNeeds(
        pace=PACE, return_height_m=30.0, fence=False, vehicle=Vehicle(endurance_s=150.0, reserve_fraction=0.2)
    )
    scene = scene_of(autopilot, battery=BatteryData(endurance_s=1000.0))
    scene.vehicle.body.battery.remaining = charge
    flown(scene, needs=needs)
    said = [event.text for event in scene.events]
    warnings = [
        text for text in said if text.startswith(f"the battery has {100.0 * charge:.0f} % left, but the mission")
    ]
    assert len(warnings) == warned
    if warned:
        assert "and the reserve is 20 %" in warnings[0]
        assert said.index(warnings[0]) < said.index("armed")


@AUTOPILOTS
def test_a_landing_on_the_reserve_is_no_good_flight(autopilot):
    needs = PlanNeeds(pace=PACE, return_height_m=30.0, fence=False, vehicle=Vehicle(endurance_s=200.0))
    outcome, text = flown(
        scene_of(autopilot, "speed-changed:1.5@25s", battery=BatteryData(endurance_s=300.0)), needs=needs
    )
    assert outcome.ending is Ending.RESERVE_USED, text
    assert "the flight is using its battery reserve: the" in text


@AUTOPILOTS
def test_a_hold_ends_when_its_breach_is_over_and_the_mission_goes_on(autopilot):
    """The fence is left for some seconds of the flight only: as by a position that was wrong for a moment."""
    bad = [30.0, 33.0]
    scene = scene_of(autopilot)

    def outside(_east: float, _north: float) -> float:
        return 5.0 if bad[0] < scene.vehicle.powered_s < bad[1] else 0.0

    outcome, text = flown(scene, around=volume(outside_fence_m=outside))
    assert outcome.ending is Ending.LANDED, text
    stops = scene.reported(EventKind.STOP)
    assert any("the vehicle now holds its position" in reported for reported in stops)
    assert any("the reason for the hold is gone: the vehicle continues" in reported for reported in stops)
    assert outcome.waypoints_reached == 4


def test_a_hold_that_the_wind_blows_away_is_lost_and_said_so():
    bad = [25.0, 1e9]
    scene = scene_of(ARDUPILOT, "strong-wind:25@32s", battery=BatteryData(endurance_s=250.0))

    def outside(_east: float, _north: float) -> float:
        return 5.0 if bad[0] < scene.vehicle.powered_s < bad[1] else 0.0

    outcome, _ = flown(scene, around=volume(outside_fence_m=outside), timeouts=FlightTimeouts(held_s=120.0))
    assert "from its hold position" in incident(outcome, Ending.HOLD_LOST).text


def taken_and_given_back(scene, away_m, **options):
    """Fly it; a pilot takes it at waypoint 2 and gives it back 8 s later at another place."""
    taken: list[float] = []

    def interfere(event: FlightEvent) -> None:
        scene.events.append(event)
        if event.kind is EventKind.WAYPOINT and event.waypoint == 2 and not taken:
            taken.append(scene.vehicle.powered_s)
            scene.vehicle.control.set_mode(Mode.HOLD if scene.vehicle.autopilot is PX4 else Mode.GUIDED)

    def pause() -> bool:
        if taken and scene.vehicle.mode is not Mode.MISSION and scene.vehicle.powered_s > taken[0] + 8.0:
            point = scene.vehicle.body.point
            point.position_m = tuple(np.add(point.position_m, away_m).tolist())  # the pilot has flown it there
            scene.vehicle.body.believed.step()
            scene.vehicle.control.set_mode(Mode.MISSION)
            taken[0] = 1e9
        return False

    return flown(scene, on_event=interfere, pause=pause, **options)


@AUTOPILOTS
def test_a_pilot_who_gives_it_back_far_off_the_leg_is_not_stopped(autopilot):
    outcome, text = taken_and_given_back(scene_of(autopilot), (60.0, -60.0, 0.0))
    assert outcome.ending is Ending.LANDED, text
    assert Ending.OFF_ROUTE not in [i.kind for i in outcome.incidents]


@AUTOPILOTS
def test_a_line_back_to_the_route_that_comes_near_the_ground_is_said_so(autopilot):
    """A ridge lies beside the route, between the place where a pilot gives the vehicle back and the next waypoint."""
    east_m, _, _ = FRAME.enu_from_geodetic(HOME.lat_deg, HOME.lon_deg, HOME.alt_amsl_m)[0]

    def ground(east: float, _north: float) -> float:
        return HOME_UP_M + (50.0 if 95.0 < east - east_m < 130.0 else 0.0)

    around = volume(ground_up_m=ground)
    outcome, text = taken_and_given_back(scene_of(autopilot), (80.0, 0.0, 0.0), around=around)
    assert "comes within" in incident(outcome, Ending.UNSAFE_LINE).text
    assert outcome.ending is Ending.UNSAFE_LINE, text


@AUTOPILOTS
@pytest.mark.parametrize("text", ["\x1b[2JPolygon fence breached", "Fence Breached"])
def test_a_fence_notice_names_the_fence_and_no_pilot(autopilot, text):
    """ArduPilot reports a breach as a notice, which is less than a warning."""
    scene = scene_of(autopilot)

    def interfere(event: FlightEvent) -> None:
        scene.events.append(event)
        if event.kind is EventKind.WAYPOINT and event.waypoint == 1:
            scene.vehicle.say(5, text)
            scene.vehicle.control.set_mode(Mode.RETURN)

    outcome, _ = flown(scene, on_event=interfere)
    assert outcome.ending is Ending.FENCE_BREACHED
    assert "notice" in incident(outcome, Ending.FENCE_BREACHED).evidence[0]
